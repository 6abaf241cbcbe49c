//! Screen-guided calibration as a state machine: it says what to prompt for, collects the repetitions, judges them
//! after each round, and makes the model.

mod config;
mod events;
mod score;
#[cfg(test)]
mod tests;

pub(crate) use config::prompted_gestures;
pub use config::{CalibrationConfig, DcOffsetSource};
pub use events::{CalibrationEvent, CalibrationPhase, Prompt, Repetition, RepetitionRejection};
pub use score::{CalibrationReport, DriveScore, RepetitionScore, cross_validate};

use crate::model::{check_imu, median, subtract_dc_offset};
use crate::{ChannelQuality, ChannelStatus, EmgConfig, EmgError, EmgModel, QualityMonitor, StreamQuality};
use proact_types::{EmgSample, Gesture, SimTime};
use std::collections::VecDeque;

/// Silence after which no prompt goes on, milliseconds.
const SILENCE_MILLIS: u64 = 500;

/// A calibration session: prompts, repetitions, rounds and their reports. It has no clock: time comes in with the
/// samples, and the same samples at the same times give the same model.
///
/// Recording is paced by the stream's own counter, so that a repetition is exactly as long as it should be, whatever the
/// host's clock does. A repetition with a long gap or many lost samples, or while which a light was red, is not kept; the
/// windows that a short gap touches are not trained on.
#[derive(Clone, Debug)]
pub struct Calibration {
    config: CalibrationConfig,
    quality: QualityMonitor,
    accepted: Vec<Repetition>,
    pending_gestures: VecDeque<Gesture>,
    state: State,
    /// Time of the newest sample.
    last_sample_at: Option<SimTime>,
    now: SimTime,
    report: Option<CalibrationReport>,
    consecutive_rejections: usize,
}

#[derive(Clone, Debug)]
enum State {
    /// Before the first step, and between two prompts.
    Next,
    Blocked(Prompt),
    Preparing(Prompt, SimTime),
    Recording(Prompt, Vec<EmgSample>, ChannelStatus),
    Reviewing,
    Finished,
}

impl Calibration {
    /// A session before its first prompt.
    ///
    /// # Errors
    /// Settings that cannot work.
    pub fn new(config: CalibrationConfig) -> Result<Calibration, EmgError> {
        config.check()?;
        let quality =
            QualityMonitor::new(config.quality.clone(), config.emg.rate_hz, config.emg.channels, &[]);
        let waiting = config.gestures.iter().copied().collect();
        Ok(Calibration {
            config,
            quality,
            accepted: Vec::new(),
            pending_gestures: waiting,
            state: State::Next,
            last_sample_at: None,
            now: SimTime(0),
            report: None,
            consecutive_rejections: 0,
        })
    }

    /// Takes the raw samples that arrived at `now`, oldest first; call it without samples too, so that time goes on.
    /// Times must not go back.
    ///
    /// # Errors
    /// What the classifier refuses when a round is judged. The repetitions stay.
    pub fn step(&mut self, now: SimTime, samples: &[EmgSample]) -> Result<Vec<CalibrationEvent>, EmgError> {
        let mut events = Vec::new();
        self.now = now;
        self.advance(&mut events)?;
        for sample in samples {
            let mut level = self.config.emg.electrode_sample(sample);
            level.channels.iter_mut().for_each(|v| *v -= self.config.nominal_dc_offset);
            self.quality.push(now, &level);
            self.last_sample_at = Some(now);
            self.record(sample, &mut events);
            self.advance(&mut events)?;
        }
        Ok(events)
    }

    /// Goes on to the next prompt where one is due.
    fn advance(&mut self, events: &mut Vec<CalibrationEvent>) -> Result<(), EmgError> {
        match &self.state {
            State::Next => match self.pending_gestures.front() {
                Some(&gesture) => {
                    let prompt = Prompt { gesture, repetition: self.count(gesture) };
                    self.prompt(prompt, events);
                }
                None => {
                    self.state = State::Reviewing;
                    self.score_repetitions()?;
                    events.push(CalibrationEvent::RoundFinished);
                }
            },
            State::Blocked(prompt) => {
                let prompt = *prompt;
                if self.blocking_reason().is_none() {
                    self.prompt(prompt, events);
                }
            }
            State::Preparing(prompt, begins) if self.now >= *begins => {
                let prompt = *prompt;
                match self.blocking_reason() {
                    Some(trouble) => {
                        self.state = State::Blocked(prompt);
                        events.push(CalibrationEvent::Blocked(prompt, trouble));
                    }
                    None => {
                        let samples = Vec::with_capacity(self.config.samples());
                        self.state = State::Recording(prompt, samples, ChannelStatus::Green);
                        events.push(CalibrationEvent::Recording(prompt));
                    }
                }
            }
            State::Recording(..) if self.is_silent() => {
                self.reject_repetition(RepetitionRejection::Silence, events)
            }
            _ => {}
        }
        Ok(())
    }

    fn prompt(&mut self, prompt: Prompt, events: &mut Vec<CalibrationEvent>) {
        let prepare = (self.config.prepare_secs * 1000.0).round() as u64;
        self.state = State::Preparing(prompt, SimTime(self.now.0 + prepare));
        events.push(CalibrationEvent::Prompted(prompt));
    }

    /// Adds a sample to the repetition that is being recorded.
    fn record(&mut self, sample: &EmgSample, events: &mut Vec<CalibrationEvent>) {
        let light = self.quality.status();
        let State::Recording(prompt, samples, worst) = &mut self.state else { return };
        let prompt = *prompt;
        *worst = light.max(*worst);
        let expected = samples.last().map_or(sample.counter, |s| s.counter.saturating_add(1));
        if sample.counter < expected && expected - sample.counter <= self.config.samples() as u64 {
            return; // Repeated or late: it has been counted already.
        }
        let usable = is_usable(&self.config.emg, sample);
        let begin = samples.first().map_or(sample.counter, |s| s.counter);
        // Up to this sample; a counter that began anew is before its begin.
        let span = sample.counter.checked_sub(begin);
        let length = self.config.samples();
        let gap = sample.counter.saturating_sub(expected);
        let lost = span.map_or(0, |span| span.saturating_sub(samples.len() as u64));
        if span.is_none()
            || sample.counter < expected
            || !usable
            || !self.config.gap_is_acceptable(gap, lost, length)
        {
            self.reject_repetition(RepetitionRejection::Gap { lost: if usable { lost } else { 0 } }, events);
            return;
        }
        // The end may lie in a gap.
        let over = span.is_some_and(|span| span >= length as u64);
        if !over {
            samples.push(sample.clone());
        }
        if *worst == ChannelStatus::Red {
            let red = self.red_status();
            self.reject_repetition(red, events);
        } else if over || span.is_some_and(|span| span + 1 == length as u64) {
            let (samples, light) = (std::mem::take(samples), *worst);
            if check_imu(&self.config.emg, prompt.gesture, &samples).is_err() {
                self.reject_repetition(RepetitionRejection::Imu, events);
                return;
            }
            self.accepted.push(Repetition { gesture: prompt.gesture, samples, status: light });
            self.pending_gestures.pop_front();
            self.consecutive_rejections = 0;
            self.state = State::Next;
            events.push(CalibrationEvent::RepetitionAccepted(prompt));
        }
    }

    fn reject_repetition(&mut self, refusal: RepetitionRejection, events: &mut Vec<CalibrationEvent>) {
        if let State::Recording(prompt, ..) = self.state {
            self.consecutive_rejections += 1;
            self.state = State::Next;
            events.push(CalibrationEvent::RepetitionRejected(prompt, refusal));
        }
    }

    fn is_silent(&self) -> bool {
        self.last_sample_at.is_none_or(|at| self.now.millis_since(at) > SILENCE_MILLIS)
    }

    /// What forbids recording now.
    fn blocking_reason(&self) -> Option<RepetitionRejection> {
        if self.is_silent() {
            return Some(RepetitionRejection::Silence);
        }
        (self.quality.status() == ChannelStatus::Red).then(|| self.red_status())
    }

    fn red_status(&self) -> RepetitionRejection {
        let channels = self.quality.channels().iter().enumerate();
        RepetitionRejection::Red {
            channels: channels
                .filter(|(_, q)| q.status == ChannelStatus::Red)
                .map(|(k, q)| (k, q.fault))
                .collect(),
            stream: self.quality.stream().status == ChannelStatus::Red,
        }
    }

    fn count(&self, gesture: Gesture) -> usize {
        self.accepted.iter().filter(|r| r.gesture == gesture).count()
    }

    /// Judges all repetitions, if there are two of each gesture.
    fn score_repetitions(&mut self) -> Result<(), EmgError> {
        self.report = None;
        if self.config.gestures.iter().any(|g| self.count(*g) < 2) {
            return Ok(());
        }
        let dc_offset = self.dc_offset();
        let level = |r: &Repetition| {
            let samples = r.samples.iter().map(|s| subtract_dc_offset(s, &dc_offset)).collect();
            (r.gesture, samples)
        };
        let repetitions: Vec<(Gesture, Vec<EmgSample>)> = self.accepted.iter().map(level).collect();
        let emg = &self.config.emg;
        let mut report = cross_validate(emg, &repetitions)?;
        if !emg.imu.features.is_empty() {
            let without = EmgConfig { imu: emg.imu.without_features(), ..emg.clone() };
            report.accuracy_without_imu = Some(cross_validate(&without, &repetitions)?.accuracy);
        }
        let is_recognized = report.accuracy >= self.config.target_accuracy
            && report.recall.iter().all(|recall| *recall >= self.config.target_recall);
        // What counts for a regressor is how far it drives, not which gesture is driven most.
        let driven = report.drives.iter().all(|drive| drive.r2 >= self.config.target_r2);
        let reached = if report.drives.is_empty() { is_recognized } else { driven };
        report.good_enough = report.rounds >= self.config.needed_rounds() && reached;
        self.report = Some(report);
        Ok(())
    }

    /// The zero level of each channel, as far as it is known.
    pub fn dc_offset(&self) -> Vec<f64> {
        let channels = self.config.emg.channels;
        match self.config.dc_offset {
            DcOffsetSource::Fixed(level) => vec![level; channels],
            DcOffsetSource::RestMedian => {
                let at_rest = |r: &&Repetition| r.gesture == self.config.emg.rest;
                let rested = self.accepted.iter().any(|r| at_rest(&r));
                let samples: Vec<&EmgSample> =
                    self.accepted.iter().filter(|r| !rested || at_rest(r)).flat_map(|r| &r.samples).collect();
                (0..channels)
                    .map(|c| median(samples.iter().map(|s| s.channels[c]).collect()))
                    .map(|level| level.unwrap_or(self.config.nominal_dc_offset))
                    .collect()
            }
        }
    }

    /// Adds a repetition that was recorded before, in place of prompting for it. Call [`Calibration::review`] when all
    /// are in.
    ///
    /// # Errors
    /// A gesture that is not asked for, a gap, too few samples for a window, or samples that are unusable.
    pub fn add(&mut self, gesture: impl Into<Gesture>, samples: Vec<EmgSample>) -> Result<(), EmgError> {
        let gesture = gesture.into();
        if !self.config.gestures.contains(&gesture) {
            return Err(EmgError::NotTrained(gesture));
        }
        if let Some(bad) = samples.iter().find(|s| !is_usable(&self.config.emg, s)) {
            let (counter, channels) = (bad.counter, bad.channels.len());
            let expected = self.config.emg.sample_channels();
            return Err(EmgError::BadSample { counter, channels, expected });
        }
        check_imu(&self.config.emg, gesture, &samples)?;
        let (mut lost, length) = (0_u64, samples.len());
        for pair in samples.windows(2) {
            let (after, next) = (pair[0].counter, pair[1].counter);
            let gap = next.checked_sub(after).and_then(|step| step.checked_sub(1));
            lost = lost.saturating_add(gap.unwrap_or(0));
            if gap.is_none_or(|gap| !self.config.gap_is_acceptable(gap, lost, length)) {
                return Err(EmgError::Gap { after, next });
            }
        }
        let window = self.config.emg.window_samples()?;
        if samples.len() < window {
            return Err(EmgError::ShortRepetition { gesture, got: samples.len(), expected: window });
        }
        self.accepted.push(Repetition { gesture, samples, status: ChannelStatus::Green });
        Ok(())
    }

    /// Goes on with a calibration that was interrupted: `kept` is what it had kept, in the order in which it was recorded.
    /// Asked for next is what its round still lacks; if it lacks nothing, the round is reviewed.
    ///
    /// # Errors
    /// As [`Calibration::add`] and [`Calibration::review`].
    pub fn resume(&mut self, kept: Vec<(Gesture, Vec<EmgSample>)>) -> Result<(), EmgError> {
        for (gesture, samples) in kept {
            self.add(gesture, samples)?;
        }
        let round = self.config.gestures.iter().map(|gesture| self.count(*gesture)).max().unwrap_or(0);
        // One that is lacking from an earlier round was dropped to be recorded again.
        self.pending_gestures = (0..round)
            .flat_map(|before| self.config.gestures.iter().map(move |gesture| (before, *gesture)))
            .filter(|(before, gesture)| self.count(*gesture) <= *before)
            .map(|(_, gesture)| gesture)
            .collect();
        if round == 0 {
            self.pending_gestures = self.config.gestures.iter().copied().collect();
        }
        self.state = State::Next;
        if self.pending_gestures.is_empty() { self.review() } else { Ok(()) }
    }

    /// Ends prompting and judges what there is.
    ///
    /// # Errors
    /// What the classifier refuses.
    pub fn review(&mut self) -> Result<(), EmgError> {
        self.pending_gestures.clear();
        self.state = State::Reviewing;
        self.score_repetitions()
    }

    /// Begins another round. False unless a round is being reviewed and there may be more.
    pub fn start_next_round(&mut self) -> bool {
        let may = matches!(self.state, State::Reviewing) && self.rounds() < self.config.max_rounds;
        if may {
            self.pending_gestures = self.config.gestures.iter().copied().collect();
            self.state = State::Next;
        }
        may
    }

    /// Drops a repetition of a gesture, the newest if none is named, and asks for the gesture again. False unless a
    /// round is being reviewed and there is such a repetition.
    pub fn redo_repetition(&mut self, gesture: impl Into<Gesture>, repetition: Option<usize>) -> bool {
        let gesture = gesture.into();
        if !matches!(self.state, State::Reviewing) {
            return false;
        }
        let mut of_gesture = (0..self.accepted.len()).filter(|k| self.accepted[*k].gesture == gesture);
        let index = match repetition {
            None => of_gesture.next_back(),
            Some(number) => of_gesture.nth(number),
        };
        let Some(index) = index else { return false };
        self.accepted.remove(index);
        self.pending_gestures.push_back(gesture);
        self.state = State::Next;
        true
    }

    /// Trains on everything that was kept and ends the session.
    ///
    /// # Errors
    /// What [`EmgModel::train`] refuses, such as fewer than two gestures; the session goes on then.
    pub fn finish(&mut self) -> Result<EmgModel, EmgError> {
        let slices: Vec<(Gesture, &[EmgSample])> =
            self.accepted.iter().map(|r| (r.gesture, r.samples.as_slice())).collect();
        let model = EmgModel::train(&self.config.emg, &self.dc_offset(), &slices)?;
        self.state = State::Finished;
        Ok(model)
    }

    /// What the session is doing.
    pub fn phase(&self) -> CalibrationPhase {
        match &self.state {
            State::Next => match self.pending_gestures.front() {
                Some(&gesture) => {
                    let prompt = Prompt { gesture, repetition: self.count(gesture) };
                    CalibrationPhase::Preparing { prompt, remaining_secs: self.config.prepare_secs }
                }
                None => CalibrationPhase::Reviewing,
            },
            State::Blocked(prompt) => CalibrationPhase::Blocked { prompt: *prompt },
            State::Preparing(prompt, begins) => {
                let left_secs = begins.0.saturating_sub(self.now.0) as f64 / 1000.0;
                CalibrationPhase::Preparing { prompt: *prompt, remaining_secs: left_secs }
            }
            State::Recording(prompt, samples, _) => CalibrationPhase::Recording {
                prompt: *prompt,
                share: recorded_span(samples) as f64 / self.config.samples().max(1) as f64,
            },
            State::Reviewing => CalibrationPhase::Reviewing,
            State::Finished => CalibrationPhase::Finished,
        }
    }

    /// The position of the limb in which the next repetition, or that which is being recorded, is asked for; none if none are
    /// named, or nothing is asked for.
    pub fn position(&self) -> Option<&str> {
        match self.phase() {
            CalibrationPhase::Blocked { prompt }
            | CalibrationPhase::Preparing { prompt, .. }
            | CalibrationPhase::Recording { prompt, .. } => self.config.position_of(prompt.repetition),
            CalibrationPhase::Reviewing | CalibrationPhase::Finished => None,
        }
    }

    /// Complete rounds.
    pub fn rounds(&self) -> usize {
        self.config.gestures.iter().map(|g| self.count(*g)).min().unwrap_or(0)
    }

    /// The judgement of the newest round; none before the second.
    pub fn report(&self) -> Option<&CalibrationReport> {
        self.report.as_ref()
    }

    /// What was kept, oldest first.
    pub fn repetitions(&self) -> &[Repetition] {
        &self.accepted
    }

    /// Repetitions refused in a row: after a few the person should look at the band instead of trying on.
    pub fn consecutive_rejections(&self) -> usize {
        self.consecutive_rejections
    }

    /// Lights per channel.
    pub fn channels(&self) -> &[ChannelQuality] {
        self.quality.channels()
    }

    /// Light of the stream.
    pub fn stream(&self) -> &StreamQuality {
        self.quality.stream()
    }

    /// The settings.
    pub fn config(&self) -> &CalibrationConfig {
        &self.config
    }
}

/// Of the stream's length, and what decisions need are numbers.
fn is_usable(config: &EmgConfig, sample: &EmgSample) -> bool {
    let used = config.imu.feature_indices();
    let needed = |k: usize| k < config.channels || used.contains(&(k - config.channels));
    sample.channels.len() == config.sample_channels()
        && sample.channels.iter().enumerate().all(|(k, v)| v.is_finite() || !needed(k))
}

/// Samples from the first to the newest, those that were lost included.
fn recorded_span(samples: &[EmgSample]) -> u64 {
    match (samples.first(), samples.last()) {
        (Some(first), Some(last)) => last.counter - first.counter + 1,
        _ => 0,
    }
}
