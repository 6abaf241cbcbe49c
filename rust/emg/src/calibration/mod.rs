//! Screen-guided calibration as a state machine: it says what to prompt for, collects the repetitions, judges them
//! after each round, and makes the model.

mod config;
mod events;
mod score;
#[cfg(test)]
mod tests;

pub(crate) use config::moving;
pub use config::{CalibrationConfig, ZeroLevel};
pub use events::{CalibrationEvent, Phase, Prompt, Refusal, Repetition};
pub use score::{CalibrationReport, DriveScore, RepetitionScore, cross_validate};

use crate::model::{centred, check_imu, median};
use crate::{ChannelQuality, EmgConfig, EmgError, EmgModel, Light, QualityMonitor, StreamQuality};
use proact_types::{EmgSample, GestureName, SimTime};
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
    kept: Vec<Repetition>,
    waiting: VecDeque<GestureName>,
    state: State,
    /// Time of the newest sample.
    heard: Option<SimTime>,
    now: SimTime,
    report: Option<CalibrationReport>,
    refusals: usize,
}

#[derive(Clone, Debug)]
enum State {
    /// Before the first step, and between two prompts.
    Next,
    Blocked(Prompt),
    Preparing(Prompt, SimTime),
    Recording(Prompt, Vec<EmgSample>, Light),
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
            kept: Vec::new(),
            waiting,
            state: State::Next,
            heard: None,
            now: SimTime(0),
            report: None,
            refusals: 0,
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
            let mut level = self.config.emg.electrodes(sample);
            level.channels.iter_mut().for_each(|v| *v -= self.config.nominal_zero);
            self.quality.push(now, &level);
            self.heard = Some(now);
            self.record(sample, &mut events);
            self.advance(&mut events)?;
        }
        Ok(events)
    }

    /// Goes on to the next prompt where one is due.
    fn advance(&mut self, events: &mut Vec<CalibrationEvent>) -> Result<(), EmgError> {
        match &self.state {
            State::Next => match self.waiting.front() {
                Some(&gesture) => {
                    let prompt = Prompt { gesture, repetition: self.count(gesture) };
                    self.prompt(prompt, events);
                }
                None => {
                    self.state = State::Reviewing;
                    self.judge()?;
                    events.push(CalibrationEvent::RoundFinished);
                }
            },
            State::Blocked(prompt) => {
                let prompt = *prompt;
                if self.trouble().is_none() {
                    self.prompt(prompt, events);
                }
            }
            State::Preparing(prompt, begins) if self.now >= *begins => {
                let prompt = *prompt;
                match self.trouble() {
                    Some(trouble) => {
                        self.state = State::Blocked(prompt);
                        events.push(CalibrationEvent::Blocked(prompt, trouble));
                    }
                    None => {
                        let samples = Vec::with_capacity(self.config.samples());
                        self.state = State::Recording(prompt, samples, Light::Green);
                        events.push(CalibrationEvent::Recording(prompt));
                    }
                }
            }
            State::Recording(..) if self.silent() => self.refuse(Refusal::Silence, events),
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
        let light = self.quality.light();
        let State::Recording(prompt, samples, worst) = &mut self.state else { return };
        let prompt = *prompt;
        *worst = light.max(*worst);
        let expected = samples.last().map_or(sample.counter, |s| s.counter.saturating_add(1));
        if sample.counter < expected && expected - sample.counter <= self.config.samples() as u64 {
            return; // Repeated or late: it has been counted already.
        }
        let usable = usable(&self.config.emg, sample);
        let begin = samples.first().map_or(sample.counter, |s| s.counter);
        // Up to this sample; a counter that began anew is before its begin.
        let span = sample.counter.checked_sub(begin);
        let length = self.config.samples();
        let gap = sample.counter.saturating_sub(expected);
        let lost = span.map_or(0, |span| span.saturating_sub(samples.len() as u64));
        if span.is_none() || sample.counter < expected || !usable || !self.config.stands(gap, lost, length) {
            self.refuse(Refusal::Gap { lost: if usable { lost } else { 0 } }, events);
            return;
        }
        // The end may lie in a gap.
        let over = span.is_some_and(|span| span >= length as u64);
        if !over {
            samples.push(sample.clone());
        }
        if *worst == Light::Red {
            let red = self.red();
            self.refuse(red, events);
        } else if over || span.is_some_and(|span| span + 1 == length as u64) {
            let (samples, light) = (std::mem::take(samples), *worst);
            if check_imu(&self.config.emg, prompt.gesture, &samples).is_err() {
                self.refuse(Refusal::Imu, events);
                return;
            }
            self.kept.push(Repetition { gesture: prompt.gesture, samples, light });
            self.waiting.pop_front();
            self.refusals = 0;
            self.state = State::Next;
            events.push(CalibrationEvent::Kept(prompt));
        }
    }

    fn refuse(&mut self, refusal: Refusal, events: &mut Vec<CalibrationEvent>) {
        if let State::Recording(prompt, ..) = self.state {
            self.refusals += 1;
            self.state = State::Next;
            events.push(CalibrationEvent::Refused(prompt, refusal));
        }
    }

    fn silent(&self) -> bool {
        self.heard.is_none_or(|at| self.now.millis_since(at) > SILENCE_MILLIS)
    }

    /// What forbids recording now.
    fn trouble(&self) -> Option<Refusal> {
        if self.silent() {
            return Some(Refusal::Silence);
        }
        (self.quality.light() == Light::Red).then(|| self.red())
    }

    fn red(&self) -> Refusal {
        let channels = self.quality.channels().iter().enumerate();
        Refusal::Red {
            channels: channels.filter(|(_, q)| q.light == Light::Red).map(|(k, q)| (k, q.fault)).collect(),
            stream: self.quality.stream().light == Light::Red,
        }
    }

    fn count(&self, gesture: GestureName) -> usize {
        self.kept.iter().filter(|r| r.gesture == gesture).count()
    }

    /// Judges all repetitions, if there are two of each gesture.
    fn judge(&mut self) -> Result<(), EmgError> {
        self.report = None;
        if self.config.gestures.iter().any(|g| self.count(*g) < 2) {
            return Ok(());
        }
        let centring = self.centring();
        let level = |r: &Repetition| {
            let samples = r.samples.iter().map(|s| centred(s, &centring)).collect();
            (r.gesture, samples)
        };
        let repetitions: Vec<(GestureName, Vec<EmgSample>)> = self.kept.iter().map(level).collect();
        let emg = &self.config.emg;
        let mut report = cross_validate(emg, &repetitions)?;
        if !emg.imu.features.is_empty() {
            let without = EmgConfig { imu: emg.imu.without_features(), ..emg.clone() };
            report.accuracy_without_imu = Some(cross_validate(&without, &repetitions)?.accuracy);
        }
        let recognised = report.accuracy >= self.config.target_accuracy
            && report.recall.iter().all(|recall| *recall >= self.config.target_recall);
        // What counts for a regressor is how far it drives, not which gesture is driven most.
        let driven = report.drives.iter().all(|drive| drive.r2 >= self.config.target_r2);
        let reached = if report.drives.is_empty() { recognised } else { driven };
        report.good_enough = report.rounds >= self.config.needed_rounds() && reached;
        self.report = Some(report);
        Ok(())
    }

    /// The zero level of each channel, as far as it is known.
    pub fn centring(&self) -> Vec<f64> {
        let channels = self.config.emg.channels;
        match self.config.zero {
            ZeroLevel::Fixed(level) => vec![level; channels],
            ZeroLevel::RestMedian => {
                let at_rest = |r: &&Repetition| r.gesture == self.config.emg.rest;
                let rested = self.kept.iter().any(|r| at_rest(&r));
                let samples: Vec<&EmgSample> =
                    self.kept.iter().filter(|r| !rested || at_rest(r)).flat_map(|r| &r.samples).collect();
                (0..channels)
                    .map(|c| median(samples.iter().map(|s| s.channels[c]).collect()))
                    .map(|level| level.unwrap_or(self.config.nominal_zero))
                    .collect()
            }
        }
    }

    /// Adds a repetition that was recorded before, in place of prompting for it. Call [`Calibration::review`] when all
    /// are in.
    ///
    /// # Errors
    /// A gesture that is not asked for, a gap, too few samples for a window, or samples that are unusable.
    pub fn add(&mut self, gesture: impl Into<GestureName>, samples: Vec<EmgSample>) -> Result<(), EmgError> {
        let gesture = gesture.into();
        if !self.config.gestures.contains(&gesture) {
            return Err(EmgError::NotTrained(gesture));
        }
        if let Some(bad) = samples.iter().find(|s| !usable(&self.config.emg, s)) {
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
            if gap.is_none_or(|gap| !self.config.stands(gap, lost, length)) {
                return Err(EmgError::Gap { after, next });
            }
        }
        let window = self.config.emg.window_samples()?;
        if samples.len() < window {
            return Err(EmgError::ShortRepetition { gesture, got: samples.len(), expected: window });
        }
        self.kept.push(Repetition { gesture, samples, light: Light::Green });
        Ok(())
    }

    /// Goes on with a calibration that was interrupted: `kept` is what it had kept, in the order in which it was recorded.
    /// Asked for next is what its round still lacks; if it lacks nothing, the round is reviewed.
    ///
    /// # Errors
    /// As [`Calibration::add`] and [`Calibration::review`].
    pub fn resume(&mut self, kept: Vec<(GestureName, Vec<EmgSample>)>) -> Result<(), EmgError> {
        for (gesture, samples) in kept {
            self.add(gesture, samples)?;
        }
        let round = self.config.gestures.iter().map(|gesture| self.count(*gesture)).max().unwrap_or(0);
        // One that is lacking from an earlier round was dropped to be recorded again.
        self.waiting = (0..round)
            .flat_map(|before| self.config.gestures.iter().map(move |gesture| (before, *gesture)))
            .filter(|(before, gesture)| self.count(*gesture) <= *before)
            .map(|(_, gesture)| gesture)
            .collect();
        if round == 0 {
            self.waiting = self.config.gestures.iter().copied().collect();
        }
        self.state = State::Next;
        if self.waiting.is_empty() { self.review() } else { Ok(()) }
    }

    /// Ends prompting and judges what there is.
    ///
    /// # Errors
    /// What the classifier refuses.
    pub fn review(&mut self) -> Result<(), EmgError> {
        self.waiting.clear();
        self.state = State::Reviewing;
        self.judge()
    }

    /// Begins another round. False unless a round is being reviewed and there may be more.
    pub fn proceed(&mut self) -> bool {
        let may = matches!(self.state, State::Reviewing) && self.rounds() < self.config.most_rounds;
        if may {
            self.waiting = self.config.gestures.iter().copied().collect();
            self.state = State::Next;
        }
        may
    }

    /// Drops a repetition of a gesture, the newest if none is named, and asks for the gesture again. False unless a
    /// round is being reviewed and there is such a repetition.
    pub fn record_again(&mut self, gesture: impl Into<GestureName>, repetition: Option<usize>) -> bool {
        let gesture = gesture.into();
        if !matches!(self.state, State::Reviewing) {
            return false;
        }
        let mut of_gesture = (0..self.kept.len()).filter(|k| self.kept[*k].gesture == gesture);
        let index = match repetition {
            None => of_gesture.next_back(),
            Some(number) => of_gesture.nth(number),
        };
        let Some(index) = index else { return false };
        self.kept.remove(index);
        self.waiting.push_back(gesture);
        self.state = State::Next;
        true
    }

    /// Trains on everything that was kept and ends the session.
    ///
    /// # Errors
    /// What [`EmgModel::train`] refuses, such as fewer than two gestures; the session goes on then.
    pub fn finish(&mut self) -> Result<EmgModel, EmgError> {
        let slices: Vec<(GestureName, &[EmgSample])> =
            self.kept.iter().map(|r| (r.gesture, r.samples.as_slice())).collect();
        let model = EmgModel::train(&self.config.emg, &self.centring(), &slices)?;
        self.state = State::Finished;
        Ok(model)
    }

    /// What the session is doing.
    pub fn phase(&self) -> Phase {
        match &self.state {
            State::Next => match self.waiting.front() {
                Some(&gesture) => {
                    let prompt = Prompt { gesture, repetition: self.count(gesture) };
                    Phase::Preparing { prompt, left_secs: self.config.prepare_secs }
                }
                None => Phase::Reviewing,
            },
            State::Blocked(prompt) => Phase::Blocked { prompt: *prompt },
            State::Preparing(prompt, begins) => {
                let left_secs = begins.0.saturating_sub(self.now.0) as f64 / 1000.0;
                Phase::Preparing { prompt: *prompt, left_secs }
            }
            State::Recording(prompt, samples, _) => Phase::Recording {
                prompt: *prompt,
                share: recorded(samples) as f64 / self.config.samples().max(1) as f64,
            },
            State::Reviewing => Phase::Reviewing,
            State::Finished => Phase::Finished,
        }
    }

    /// The position of the limb in which the next repetition, or that which is being recorded, is asked for; none if none are
    /// named, or nothing is asked for.
    pub fn position(&self) -> Option<&str> {
        match self.phase() {
            Phase::Blocked { prompt } | Phase::Preparing { prompt, .. } | Phase::Recording { prompt, .. } => {
                self.config.position_of(prompt.repetition)
            }
            Phase::Reviewing | Phase::Finished => None,
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
        &self.kept
    }

    /// Repetitions refused in a row: after a few the person should look at the band instead of trying on.
    pub fn refusals(&self) -> usize {
        self.refusals
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
fn usable(config: &EmgConfig, sample: &EmgSample) -> bool {
    let used = config.imu.used();
    let needed = |k: usize| k < config.channels || used.contains(&(k - config.channels));
    sample.channels.len() == config.sample_channels()
        && sample.channels.iter().enumerate().all(|(k, v)| v.is_finite() || !needed(k))
}

/// Samples from the first to the newest, those that were lost included.
fn recorded(samples: &[EmgSample]) -> u64 {
    match (samples.first(), samples.last()) {
        (Some(first), Some(last)) => last.counter - first.counter + 1,
        _ => 0,
    }
}
