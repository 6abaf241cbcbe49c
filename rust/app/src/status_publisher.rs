//! What the experimenter's page gets from a trial that runs in real time, and what its buttons do.

use crate::{
    dense_spectra::DenseSpectra,
    intent_view::IntentView,
    latency::{LatencyTable, StageTimer},
    live::TrialInputs,
    real_time_pacer::RealTimePacer,
    trace_envelope::{self, TraceEnvelope},
};
use proact_bridge::{
    ClientInput, GazeCheck, InertialValue, PageServer, Recognition, Signals, StudyAction, TrialStatus,
};
use proact_emg::{ChannelStatus, EmgConfig, QualityConfig, QualityMonitor};
use proact_testbed::{RunningTrial, Testbed, TrialStep};
use proact_types::{Command, DisplayFrame, SimTime};
use std::{
    fs::OpenOptions,
    io::Write,
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

/// From one message of signals to the next.
const SIGNAL_PERIOD: Duration = Duration::from_millis(100);
/// Rates are counted over this long.
const RATE_PERIOD: Duration = Duration::from_secs(1);
/// From one frame to the next while time stands still.
const PAUSED_FRAME_PERIOD: Duration = Duration::from_millis(100);
/// Most seconds of EMG in one message.
const MAX_SIGNAL_SECS: f64 = 0.33;
/// Gaze checks of a trial, one JSON object a line.
const GAZE_CHECK_FILE: &str = "gaze_checks.jsonl";

/// A trial's side of the experimenter's page.
pub struct StatusPublisher<'a> {
    page: &'a PageServer,
    status: TrialStatus,
    signals: Signals,
    emg: Option<EmgConfig>,
    quality: Option<QualityMonitor>,
    envelope: Option<TraceEnvelope>,
    /// Of a stream whose samples the page does not get.
    spectra: Option<DenseSpectra>,
    intent: Option<IntentView>,
    last_sent: Instant,
    last_sent_time: SimTime,
    ticks: u32,
    total_tick_time: Duration,
    max_tick_time: Duration,
    last_valid_gaze: Option<SimTime>,
    rate_counts: RateCounts,
    latency: LatencyTable,
}

/// Samples since the last count.
struct RateCounts {
    since: Instant,
    gaze: u32,
    tracking: u32,
}

impl<'a> StatusPublisher<'a> {
    /// Announces the trial of `testbed`, recorded in `dir` if anywhere, in which `gaze_source` gives gaze instead of the page.
    pub fn new(
        page: &'a PageServer,
        testbed: &Testbed,
        dir: Option<&Path>,
        gaze_source: Option<&str>,
    ) -> Self {
        let config = testbed.config();
        let status = TrialStatus {
            can_pause: true,
            seed: config.seed,
            record: dir.map(|dir| dir.display().to_string()),
            gaze_source: gaze_source.map(str::to_owned),
            ..TrialStatus::default()
        };
        page.set_status(&status);
        let emg = config.emg.as_ref();
        let envelope = emg.map(|emg| TraceEnvelope::new(emg.rate_hz, emg.channels));
        let thinned = envelope.as_ref().is_some_and(TraceEnvelope::is_decimated);
        let spectra = emg.filter(|_| thinned).map(|emg| DenseSpectra::new(emg.rate_hz, emg.channels));
        let rates = emg.zip(envelope.as_ref()).map(|(emg, rows)| (emg.rate_hz, rows.row_hz(emg.rate_hz)));
        let (emg_rate_hz, emg_row_hz) = rates.unwrap_or_default();
        let gestures = testbed.emg_gestures().to_vec();
        let imu = emg.map_or(&[][..], |emg| &emg.imu.channels);
        let inertial =
            imu.iter().map(|c| InertialValue { name: c.name.clone(), unit: c.unit.clone(), value: None });
        let inertial: Vec<InertialValue> = inertial.collect();
        let recognition = emg.map(|_| Recognition { gestures, ..Recognition::default() });
        let monitor = |emg: &EmgConfig| {
            let config = QualityConfig { rails: emg.liveness.rails, ..QualityConfig::default() };
            QualityMonitor::new(config, emg.rate_hz, emg.channels, &[])
        };
        Self {
            page,
            status,
            emg: emg.cloned(),
            signals: Signals { emg_rate_hz, emg_row_hz, recognition, inertial, ..Signals::default() },
            envelope,
            spectra,
            quality: emg.map(monitor),
            intent: IntentView::for_testbed(testbed),
            last_sent: Instant::now(),
            last_sent_time: SimTime(0),
            ticks: 0,
            total_tick_time: Duration::ZERO,
            max_tick_time: Duration::ZERO,
            last_valid_gaze: None,
            rate_counts: RateCounts { since: Instant::now(), gaze: 0, tracking: 0 },
            latency: LatencyTable::default(),
        }
    }

    /// Does what a button asks. True if the trial is to end.
    pub fn apply_action(&mut self, action: StudyAction) -> bool {
        match action {
            StudyAction::Pause => self.status.paused = true,
            StudyAction::Resume => self.status.paused = false,
            StudyAction::CheckGaze => self.page.request_gaze_check(false),
            StudyAction::CalibrateGaze => self.page.request_gaze_check(true),
            StudyAction::Abort => (self.status.aborted, self.status.paused) = (true, false),
        }
        self.page.set_status(&self.status);
        self.status.aborted
    }

    /// From now on time waits for the person's first action.
    pub fn wait_for_first_action(&mut self) {
        self.status.waiting = true;
        self.page.set_status(&self.status);
    }

    /// Time stands still from now on, because who drives reads a dialog; or it goes on.
    pub fn set_held(&mut self, on: bool) {
        self.status.paused_by_dialog = on;
        self.page.set_status(&self.status);
    }

    /// While time stands still, waits for inputs and hands them on; the record knows nothing of it. `display_frame` is the instant
    /// on display, which pages go on getting. Other inputs than those that concern the trial, and the first action that
    /// time waits for, are dropped.
    pub fn wait_while_paused(
        &mut self,
        pace: &mut RealTimePacer,
        display_frame: Option<&DisplayFrame>,
        inputs: &mut dyn TrialInputs,
        interrupted: &AtomicBool,
    ) -> Vec<ClientInput> {
        let mut kept = Vec::new();
        let stood = self.is_time_stopped();
        let mut last_frame_at = Instant::now();
        while self.is_time_stopped() && kept.is_empty() && !interrupted.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(10));
            for input in inputs.drain() {
                match input {
                    ClientInput::Study(action) if !self.apply_action(action) => {}
                    ClientInput::Study(_) | ClientInput::Restart { .. } => kept.push(input),
                    ClientInput::Hold(on) => self.set_held(on),
                    input
                        if self.status.waiting
                            && !self.status.paused_by_dialog
                            && is_person_action(&input) =>
                    {
                        self.status.waiting = false;
                        self.page.set_status(&self.status);
                        kept.push(input);
                    }
                    // What follows the first action is the trial's.
                    input if !kept.is_empty() => kept.push(input),
                    _ => {}
                }
            }
            if let Some(frame) = display_frame.filter(|_| last_frame_at.elapsed() > PAUSED_FRAME_PERIOD) {
                self.page.publish(frame);
                last_frame_at = Instant::now();
            }
        }
        if stood {
            *pace = RealTimePacer::new();
            self.last_sent = Instant::now();
        }
        kept
    }

    fn is_time_stopped(&self) -> bool {
        self.status.paused || self.status.paused_by_dialog || self.status.waiting
    }

    /// Keeps what a trial has to tell beside its inputs with the record in `dir`, before that is closed.
    ///
    /// # Errors
    /// What the disk refuses.
    pub(crate) fn save(&mut self, dir: &Path) -> Result<(), String> {
        self.latency.record_picture_ages(&self.page.take_frame_latencies());
        self.latency.save(dir)
    }

    /// Takes in one tick of `trial`, whose stages took what `clock` says, and tells the page when it is time.
    pub(crate) fn record_tick(&mut self, step: &TrialStep, trial: &RunningTrial, clock: &StageTimer) {
        let (testbed, spent) = (trial.testbed(), clock.total());
        self.latency.record_tick(step, trial, clock);
        self.ticks += 1;
        self.total_tick_time += spent;
        self.max_tick_time = self.max_tick_time.max(spent);
        for sample in &step.input.emg {
            let Some(emg) = &self.emg else { break };
            let imu = sample.channels.get(emg.channels..).unwrap_or_default();
            for (latest, value) in self.signals.inertial.iter_mut().zip(imu) {
                latest.value = Some(*value).filter(|value| value.is_finite());
            }
            let stripped;
            let sample = if emg.imu.channels.is_empty() {
                sample
            } else {
                stripped = emg.electrode_sample(sample);
                &stripped
            };
            if let Some(quality) = &mut self.quality {
                quality.push(step.time, sample);
            }
            if let Some(spectra) = &mut self.spectra {
                spectra.push(&sample.channels);
            }
            let max_rows = MAX_SIGNAL_SECS * self.signals.emg_row_hz;
            if let Some(envelope) =
                self.envelope.as_mut().filter(|_| (self.signals.emg.len() as f64) < max_rows)
            {
                envelope.push(&sample.channels, &mut self.signals.emg);
            }
        }
        if let Some((recognition, window)) = self.signals.recognition.as_mut().zip(step.output.emg.as_ref()) {
            recognition.posterior = window.posterior.to_vec();
            (recognition.window_class, recognition.effort) = (window.class, window.effort);
        }
        if let Some(gaze) = &step.input.gaze {
            self.rate_counts.gaze += 1;
            if gaze.valid {
                self.last_valid_gaze = Some(step.time);
            }
        }
        if let Some((intent, gaze)) = self.intent.as_mut().zip(step.input.gaze) {
            intent.update_gaze(gaze);
        }
        self.rate_counts.tracking += u32::from(step.input.shoulder.is_some());
        let now = Instant::now();
        if now.duration_since(self.last_sent) >= SIGNAL_PERIOD {
            if let Some(recognition) = &mut self.signals.recognition {
                let muscles = testbed.emg_output();
                (recognition.in_force, recognition.armed) = (muscles.recognized_gesture, muscles.armed);
                recognition.fault = muscles.fault.as_ref().map(|(_, sentence)| sentence.clone());
            }
            self.signals.intent =
                self.intent.as_mut().and_then(|intent| intent.current_intent(step.time, testbed));
            self.publish(now, step.time);
        }
    }

    fn publish(&mut self, now: Instant, time: SimTime) {
        let real = now.duration_since(self.last_sent).as_secs_f64();
        let since = now.duration_since(self.rate_counts.since);
        if since >= RATE_PERIOD {
            self.signals.gaze_hz = f64::from(self.rate_counts.gaze) / since.as_secs_f64();
            self.signals.tracking_hz = f64::from(self.rate_counts.tracking) / since.as_secs_f64();
            self.rate_counts = RateCounts { since: now, gaze: 0, tracking: 0 };
        }
        let signals = &mut self.signals;
        signals.time = time;
        signals.real_time_factor = time.millis_since(self.last_sent_time) as f64 * 1e-3 / real.max(1e-9);
        signals.tick_mean_us = self.total_tick_time.as_secs_f64() * 1e6 / f64::from(self.ticks.max(1));
        signals.tick_max_us = self.max_tick_time.as_secs_f64() * 1e6;
        signals.gaze_age_ms = self.last_valid_gaze.map(|seen| time.millis_since(seen));
        signals.page_count = self.page.client_count();
        self.latency.record_picture_ages(&self.page.take_frame_latencies());
        signals.latency = self.latency.rows();
        signals.spectra = match &mut self.spectra {
            Some(spectra) if signals.page_count > 0 => spectra.next_spectra(),
            _ => Vec::new(),
        };
        if let Some(quality) = &self.quality {
            let light = |light| {
                match light {
                    ChannelStatus::Green => "green",
                    ChannelStatus::Amber => "amber",
                    ChannelStatus::Red => "red",
                }
                .to_owned()
            };
            signals.channel_status = quality.channels().iter().map(|channel| light(channel.status)).collect();
            signals.faults = quality
                .channels()
                .iter()
                .map(|channel| channel.fault.as_ref().map(proact_analysis::table::serialized_name))
                .collect();
            signals.emg_lost_share = quality.stream().lost_share;
        }
        trace_envelope::round(&mut signals.emg);
        self.page.publish_signals(signals);
        signals.emg.clear();
        (self.last_sent, self.last_sent_time) = (now, time);
        (self.ticks, self.total_tick_time, self.max_tick_time) = (0, Duration::ZERO, Duration::ZERO);
    }
}

/// Whether it is the person's own doing that begins a trial. Letting go of a key is not.
fn is_person_action(input: &ClientInput) -> bool {
    match input {
        ClientInput::Gesture(command) => *command != Command::NoMotion,
        ClientInput::Gaze { .. } | ClientInput::Trunk(_) | ClientInput::Head(_) => true,
        _ => false,
    }
}

/// Whether a trial whose time waits for the person's first action need not wait with `input`.
pub(crate) fn starts_or_ends_trial(input: &ClientInput) -> bool {
    is_person_action(input)
        || matches!(input, ClientInput::Restart { .. } | ClientInput::Study(StudyAction::Abort))
}

/// Adds a gaze check to the record of a trial; without a record it is only shown.
pub fn store_gaze_check(dir: Option<&Path>, time: SimTime, check: &GazeCheck) -> std::io::Result<()> {
    let Some(dir) = dir else { return Ok(()) };
    let mut line = serde_json::json!({ "time": time, "check": check }).to_string();
    line.push('\n');
    OpenOptions::new().create(true).append(true).open(dir.join(GAZE_CHECK_FILE))?.write_all(line.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Arm, trial};
    use proact_bridge::PageOptions;
    use proact_control::MethodRegistry;
    use proact_devices::{SyntheticEmg, SyntheticModel, random_stream};
    use proact_emg::EmgModel;
    use proact_testbed::{Setup, TrialConfig, ports};
    use proact_types::{EmgSample, Gesture};

    /// Relaxed for half a second, then closes the hand; silent from the second second on.
    struct Armband(SyntheticEmg);

    fn generator(seed: u64) -> SyntheticEmg {
        SyntheticEmg::new(&SyntheticModel::shipped().unwrap(), 1000.0, 8, 1.0, random_stream(seed, "test"))
            .unwrap()
    }

    impl ports::EmgSource for Armband {
        fn sample_at(&mut self, now: SimTime, _intended: Command) -> Vec<EmgSample> {
            let gesture = if now.0 < 500 { Command::NoMotion } else { Command::HandClose };
            let sample = EmgSample { counter: now.0, channels: self.0.next(gesture) };
            (now.0 < 2000).then_some(sample).into_iter().collect()
        }
    }

    fn model() -> EmgModel {
        let mut emg = generator(1);
        let mut take = |gesture| -> Vec<EmgSample> {
            (0..3000).map(|counter| EmgSample { counter, channels: emg.next(gesture) }).collect()
        };
        let takes = Command::ALL.map(|gesture| (gesture, take(gesture)));
        let slices: Vec<(Command, &[EmgSample])> = takes.iter().map(|(g, s)| (*g, s.as_slice())).collect();
        EmgModel::train(&EmgConfig::default(), &[0.0; 8], &slices).unwrap()
    }

    // What stood on the page was seen by eye alone before.
    #[test]
    fn the_page_is_told_what_the_muscles_say_and_why_they_say_nothing() {
        let (model, config) = (model(), TrialConfig::new("A", 1, Setup::named("still").unwrap()));
        let worn = trial::TrainedArmband { trained: &model, samples: Box::new(Armband(generator(2))) };
        let arm = Arm::from_config(&config).unwrap();
        let methods = MethodRegistry::standard();
        let mut trial = trial::live_trial_with_armband(&methods, &arm, config, Some(worn)).unwrap().trial;
        let content = crate::page_content::page_content(trial.testbed(), &arm);
        let page = PageServer::start(PageOptions { port: 0, ..PageOptions::default() }, content).unwrap();
        let mut experimenter = StatusPublisher::new(&page, trial.testbed(), None, None);
        let begin = experimenter.signals.recognition.clone().unwrap();
        assert_eq!(begin.gestures, Command::ALL.map(Gesture::from), "alphabetical, as the posterior");
        assert!(begin.posterior.is_empty() && begin.window_class.is_none());
        let mut published_at = |tick: u64| {
            while trial.testbed().now().0 < tick {
                let step = trial.step(false).unwrap();
                // As if the time of a message had passed.
                experimenter.last_sent -= SIGNAL_PERIOD;
                experimenter.record_tick(&step, &trial, &StageTimer::start());
            }
            experimenter.signals.recognition.clone().unwrap()
        };
        let relaxed = published_at(480);
        assert_eq!((relaxed.in_force, relaxed.effort), (Gesture::default(), 0.0));
        let closing = published_at(1400);
        let close = Gesture::from(Command::HandClose);
        assert_eq!((closing.in_force, closing.window_class), (close, Some(close)));
        assert!(closing.posterior[Command::HandClose.index()] > 0.5 && closing.effort > 0.0);
        assert!((closing.posterior.iter().sum::<f64>() - 1.0).abs() < 1e-9);
        assert!(closing.armed && closing.fault.is_none());
        let silent = published_at(2400);
        assert_eq!((silent.in_force, silent.window_class), (Gesture::default(), None));
        assert!(silent.posterior.iter().all(|p| *p == 0.0) && silent.effort == 0.0 && !silent.armed);
        assert!(silent.fault.is_some_and(|fault| fault.contains("silent")));
    }

    #[test]
    fn gaze_checks_are_added_to_the_record_line_by_line() {
        let dir = tempfile::tempdir().unwrap();
        let check = GazeCheck { source: "mouse".into(), points: vec![], correction_deg: None };
        store_gaze_check(Some(dir.path()), SimTime(5), &check).unwrap();
        store_gaze_check(Some(dir.path()), SimTime(9), &check).unwrap();
        store_gaze_check(None, SimTime(9), &check).unwrap();
        let text = std::fs::read_to_string(dir.path().join(GAZE_CHECK_FILE)).unwrap();
        let times: Vec<serde_json::Value> = text
            .lines()
            .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap()["time"].clone())
            .collect();
        assert_eq!(times, [5, 9]);
        assert!(store_gaze_check(Some(&dir.path().join("missing")), SimTime(1), &check).is_err());
    }
}
