//! Screen-guided calibration as a state machine: it says what to prompt for, collects the repetitions, judges them
//! after each round, and makes the model.

mod config;
mod score;
#[cfg(test)]
mod tests;

pub(crate) use config::moving;
pub use config::{CalibrationConfig, ZeroLevel};
pub use score::{CalibrationReport, RepetitionScore, cross_validate};

use crate::model::{centred, median};
use crate::{ChannelFault, ChannelQuality, EmgError, EmgModel, Light, QualityMonitor, StreamQuality};
use proact_types::{EmgSample, GestureName, SimTime};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// What the person is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct Prompt {
    /// The gesture.
    pub gesture: GestureName,
    /// Which repetition of it, from 0.
    pub repetition: usize,
}

/// What the session is doing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(tag = "name", rename_all = "snake_case")]
pub enum Phase {
    /// A channel or the stream is red, or no samples come: the prompt waits.
    Blocked {
        /// What comes next.
        prompt: Prompt,
    },
    /// The gesture is shown; the recording begins in so many seconds.
    Preparing {
        /// What is asked for.
        prompt: Prompt,
        /// Seconds until the recording begins.
        left_secs: f64,
    },
    /// The gesture is being recorded.
    Recording {
        /// What is asked for.
        prompt: Prompt,
        /// Share recorded, 0 to 1.
        share: f64,
    },
    /// A round is over: look at the report, then proceed, record a gesture again, or finish.
    Reviewing,
    /// The model is made.
    Finished,
}

/// Why a repetition was not kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "reason", rename_all = "snake_case")]
pub enum Refusal {
    /// Samples were lost on the way or were unusable.
    Gap {
        /// Samples lost; 0 for one with a NaN or another number of channels.
        lost: u64,
    },
    /// Samples stopped coming.
    Silence,
    /// Channels were red.
    Red {
        /// Which, from 0, and why.
        channels: Vec<(usize, Option<ChannelFault>)>,
        /// The stream as a whole was red: losses or a wrong rate.
        stream: bool,
    },
}

/// What happened in a step.
#[derive(Clone, Debug, PartialEq)]
pub enum CalibrationEvent {
    /// The person is asked for a gesture.
    Prompted(Prompt),
    /// Recording began.
    Recording(Prompt),
    /// The repetition was kept.
    Kept(Prompt),
    /// The repetition was not kept, and the same prompt comes again.
    Refused(Prompt, Refusal),
    /// The prompt waits: red, or no samples.
    Blocked(Prompt, Refusal),
    /// All gestures of a round were recorded. There is a report from the second round on.
    RoundFinished,
}

/// Silence after which no prompt goes on, milliseconds.
const SILENCE_MILLIS: u64 = 500;

/// A repetition that was kept: raw codes, and the worst light while it was recorded.
#[derive(Clone, Debug, PartialEq)]
pub struct Repetition {
    /// What the person was asked for.
    pub gesture: GestureName,
    /// Raw codes, counters rising by one.
    pub samples: Vec<EmgSample>,
    /// The worst light; never red.
    pub light: Light,
}

/// A calibration session: prompts, repetitions, rounds and their reports. It has no clock: time comes in with the
/// samples, and the same samples at the same times give the same model.
///
/// Recording is paced by the stream's own counter, so that a repetition has exactly as many samples as it should,
/// whatever the host's clock does. A repetition with a gap, or while which a light was red, is not kept.
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
            let mut level = sample.clone();
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
        let usable = sample.channels.len() == self.config.emg.channels
            && sample.channels.iter().all(|v| v.is_finite());
        if sample.counter != expected || !usable {
            let lost = sample.counter.saturating_sub(expected);
            self.refuse(Refusal::Gap { lost }, events);
            return;
        }
        samples.push(sample.clone());
        if *worst == Light::Red {
            let red = self.red();
            self.refuse(red, events);
        } else if samples.len() == self.config.samples() {
            let (samples, light) = (std::mem::take(samples), *worst);
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
        let mut report = cross_validate(&self.config.emg, &repetitions)?;
        report.good_enough = report.rounds >= self.config.least_rounds
            && report.accuracy >= self.config.target_accuracy
            && report.recall.iter().all(|recall| *recall >= self.config.target_recall);
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
        let channels = self.config.emg.channels;
        let usable = |s: &EmgSample| s.channels.len() == channels && s.channels.iter().all(|v| v.is_finite());
        if let Some(bad) = samples.iter().find(|s| !usable(s)) {
            let (counter, got) = (bad.counter, bad.channels.len());
            return Err(EmgError::BadSample { counter, channels: got, expected: channels });
        }
        if let Some(pair) = samples.windows(2).find(|p| p[1].counter != p[0].counter.wrapping_add(1)) {
            return Err(EmgError::Gap { after: pair[0].counter, next: pair[1].counter });
        }
        let window = self.config.emg.window_samples()?;
        if samples.len() < window {
            return Err(EmgError::ShortRepetition { gesture, got: samples.len(), expected: window });
        }
        self.kept.push(Repetition { gesture, samples, light: Light::Green });
        Ok(())
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
                share: samples.len() as f64 / self.config.samples().max(1) as f64,
            },
            State::Reviewing => Phase::Reviewing,
            State::Finished => Phase::Finished,
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
