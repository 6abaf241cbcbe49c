//! What the experimenter's page gets from a trial that runs in real time, and what its buttons do.

use crate::{
    dense_spectra::DenseSpectra,
    intent_view::IntentView,
    latency::{Latency, StageClock},
    live::TrialInputs,
    pace::Pace,
    trace_envelope::{self, TraceEnvelope},
};
use proact_bridge::{
    ClientInput, GazeCheck, InertialValue, PageServer, Recognition, Signals, StudyAction, TrialStatus,
};
use proact_emg::{EmgConfig, Light, QualityConfig, QualityMonitor};
use proact_testbed::{Session, Step, Testbed};
use proact_types::{DisplayFrame, Gesture, SimTime};
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
const STILL_PERIOD: Duration = Duration::from_millis(100);
/// Most seconds of EMG in one message.
const MAX_SIGNAL_SECS: f64 = 0.33;
/// Gaze checks of a trial, one JSON object a line.
const GAZE_CHECK_FILE: &str = "gaze_checks.jsonl";

/// A trial's side of the experimenter's page.
pub struct Experimenter<'a> {
    page: &'a PageServer,
    status: TrialStatus,
    signals: Signals,
    emg: Option<EmgConfig>,
    quality: Option<QualityMonitor>,
    envelope: Option<TraceEnvelope>,
    /// Of a stream whose samples the page does not get.
    spectra: Option<DenseSpectra>,
    intent: Option<IntentView>,
    sent: Instant,
    sent_time: SimTime,
    ticks: u32,
    busy: Duration,
    busiest: Duration,
    seen_gaze: Option<SimTime>,
    counted: Counted,
    latency: Latency,
}

/// Samples since the last count.
struct Counted {
    since: Instant,
    gaze: u32,
    tracking: u32,
}

impl<'a> Experimenter<'a> {
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
        let thinned = envelope.as_ref().is_some_and(TraceEnvelope::is_thinned);
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
            intent: IntentView::of(testbed),
            sent: Instant::now(),
            sent_time: SimTime(0),
            ticks: 0,
            busy: Duration::ZERO,
            busiest: Duration::ZERO,
            seen_gaze: None,
            counted: Counted { since: Instant::now(), gaze: 0, tracking: 0 },
            latency: Latency::default(),
        }
    }

    /// Does what a button asks. True if the trial is to end.
    pub fn act(&mut self, action: StudyAction) -> bool {
        match action {
            StudyAction::Pause => self.status.paused = true,
            StudyAction::Resume => self.status.paused = false,
            StudyAction::CheckGaze => self.page.ask_for_gaze(false),
            StudyAction::CalibrateGaze => self.page.ask_for_gaze(true),
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
    pub fn hold(&mut self, on: bool) {
        self.status.held = on;
        self.page.set_status(&self.status);
    }

    /// While time stands still, waits for inputs and hands them on; the record knows nothing of it. `shown` is the instant
    /// on display, which pages go on getting. Other inputs than those that concern the trial, and the first action that
    /// time waits for, are dropped.
    pub fn wait_while_still(
        &mut self,
        pace: &mut Pace,
        shown: Option<&DisplayFrame>,
        inputs: &mut dyn TrialInputs,
        interrupted: &AtomicBool,
    ) -> Vec<ClientInput> {
        let mut kept = Vec::new();
        let stood = self.stands_still();
        let mut told = Instant::now();
        while self.stands_still() && kept.is_empty() && !interrupted.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(10));
            for input in inputs.drain() {
                match input {
                    ClientInput::Study(action) if !self.act(action) => {}
                    ClientInput::Study(_) | ClientInput::Restart { .. } => kept.push(input),
                    ClientInput::Hold(on) => self.hold(on),
                    input if self.status.waiting && !self.status.held && acts(&input) => {
                        self.status.waiting = false;
                        self.page.set_status(&self.status);
                        kept.push(input);
                    }
                    // What follows the first action is the trial's.
                    input if !kept.is_empty() => kept.push(input),
                    _ => {}
                }
            }
            if let Some(frame) = shown.filter(|_| told.elapsed() > STILL_PERIOD) {
                self.page.publish(frame);
                told = Instant::now();
            }
        }
        if stood {
            *pace = Pace::new();
            self.sent = Instant::now();
        }
        kept
    }

    fn stands_still(&self) -> bool {
        self.status.paused || self.status.held || self.status.waiting
    }

    /// Keeps what a trial has to tell beside its inputs with the record in `dir`, before that is closed.
    ///
    /// # Errors
    /// What the disk refuses.
    pub(crate) fn keep(&mut self, dir: &Path) -> Result<(), String> {
        self.latency.see(&self.page.take_picture_ages());
        self.latency.keep(dir)
    }

    /// Takes in one tick of `session`, whose stages took what `clock` says, and tells the page when it is time.
    pub(crate) fn take(&mut self, step: &Step, session: &Session, clock: &StageClock) {
        let (testbed, spent) = (session.testbed(), clock.took());
        self.latency.take(step, session, clock);
        self.ticks += 1;
        self.busy += spent;
        self.busiest = self.busiest.max(spent);
        for sample in &step.input.emg {
            let Some(emg) = &self.emg else { break };
            let imu = sample.channels.get(emg.channels..).unwrap_or_default();
            for (shown, value) in self.signals.inertial.iter_mut().zip(imu) {
                shown.value = Some(*value).filter(|value| value.is_finite());
            }
            let stripped;
            let sample = if emg.imu.channels.is_empty() {
                sample
            } else {
                stripped = emg.electrodes(sample);
                &stripped
            };
            if let Some(quality) = &mut self.quality {
                quality.push(step.time, sample);
            }
            if let Some(spectra) = &mut self.spectra {
                spectra.push(&sample.channels);
            }
            let most = MAX_SIGNAL_SECS * self.signals.emg_row_hz;
            if let Some(envelope) = self.envelope.as_mut().filter(|_| (self.signals.emg.len() as f64) < most)
            {
                envelope.push(&sample.channels, &mut self.signals.emg);
            }
        }
        if let Some((recognition, window)) = self.signals.recognition.as_mut().zip(step.output.emg.as_ref()) {
            recognition.posterior = window.posterior.to_vec();
            (recognition.window_class, recognition.effort) = (window.class, window.effort);
        }
        if let Some(gaze) = &step.input.gaze {
            self.counted.gaze += 1;
            if gaze.valid {
                self.seen_gaze = Some(step.time);
            }
        }
        if let Some((intent, gaze)) = self.intent.as_mut().zip(step.input.gaze) {
            intent.look(gaze);
        }
        self.counted.tracking += u32::from(step.input.shoulder.is_some());
        let now = Instant::now();
        if now.duration_since(self.sent) >= SIGNAL_PERIOD {
            if let Some(recognition) = &mut self.signals.recognition {
                let muscles = testbed.muscles();
                (recognition.in_force, recognition.armed) = (muscles.recognised, muscles.armed);
                recognition.fault = muscles.fault.as_ref().map(|(_, sentence)| sentence.clone());
            }
            self.signals.intent = self.intent.as_mut().and_then(|intent| intent.told(step.time, testbed));
            self.tell(now, step.time);
        }
    }

    fn tell(&mut self, now: Instant, time: SimTime) {
        let real = now.duration_since(self.sent).as_secs_f64();
        let since = now.duration_since(self.counted.since);
        if since >= RATE_PERIOD {
            self.signals.gaze_hz = f64::from(self.counted.gaze) / since.as_secs_f64();
            self.signals.tracking_hz = f64::from(self.counted.tracking) / since.as_secs_f64();
            self.counted = Counted { since: now, gaze: 0, tracking: 0 };
        }
        let signals = &mut self.signals;
        signals.time = time;
        signals.pace = time.millis_since(self.sent_time) as f64 * 1e-3 / real.max(1e-9);
        signals.tick_mean_us = self.busy.as_secs_f64() * 1e6 / f64::from(self.ticks.max(1));
        signals.tick_max_us = self.busiest.as_secs_f64() * 1e6;
        signals.gaze_age_ms = self.seen_gaze.map(|seen| time.millis_since(seen));
        signals.pages = self.page.client_count();
        self.latency.see(&self.page.take_picture_ages());
        signals.latency = self.latency.rows();
        signals.spectra = match &mut self.spectra {
            Some(spectra) if signals.pages > 0 => spectra.turn(),
            _ => Vec::new(),
        };
        if let Some(quality) = &self.quality {
            let light = |light| {
                match light {
                    Light::Green => "green",
                    Light::Amber => "amber",
                    Light::Red => "red",
                }
                .to_owned()
            };
            signals.lights = quality.channels().iter().map(|channel| light(channel.light)).collect();
            signals.faults = quality
                .channels()
                .iter()
                .map(|channel| channel.fault.as_ref().map(proact_analysis::table::word))
                .collect();
            signals.emg_lost_share = quality.stream().lost_share;
        }
        trace_envelope::round(&mut signals.emg);
        self.page.publish_signals(signals);
        signals.emg.clear();
        (self.sent, self.sent_time) = (now, time);
        (self.ticks, self.busy, self.busiest) = (0, Duration::ZERO, Duration::ZERO);
    }
}

/// Whether it is the person's own doing that begins a trial. Letting go of a key is not.
fn acts(input: &ClientInput) -> bool {
    match input {
        ClientInput::Gesture(gesture) => *gesture != Gesture::NoMotion,
        ClientInput::Gaze { .. } | ClientInput::Trunk(_) | ClientInput::Head(_) => true,
        _ => false,
    }
}

/// Whether a trial whose time waits for the person's first action need not wait with `input`.
pub(crate) fn begins_or_ends(input: &ClientInput) -> bool {
    acts(input) || matches!(input, ClientInput::Restart { .. } | ClientInput::Study(StudyAction::Abort))
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
    use proact_devices::{SyntheticEmg, SyntheticModel, stream};
    use proact_emg::EmgModel;
    use proact_testbed::{Setup, TrialConfig, ports};
    use proact_types::{EmgSample, GestureName};

    /// Relaxed for half a second, then closes the hand; silent from the second second on.
    struct Armband(SyntheticEmg);

    fn generator(seed: u64) -> SyntheticEmg {
        SyntheticEmg::new(&SyntheticModel::shipped().unwrap(), 1000.0, 8, 1.0, stream(seed, "test")).unwrap()
    }

    impl ports::EmgSource for Armband {
        fn sample_at(&mut self, now: SimTime, _intended: Gesture) -> Vec<EmgSample> {
            let gesture = if now.0 < 500 { Gesture::NoMotion } else { Gesture::HandClose };
            let sample = EmgSample { counter: now.0, channels: self.0.next(gesture) };
            (now.0 < 2000).then_some(sample).into_iter().collect()
        }
    }

    fn model() -> EmgModel {
        let mut emg = generator(1);
        let mut take = |gesture| -> Vec<EmgSample> {
            (0..3000).map(|counter| EmgSample { counter, channels: emg.next(gesture) }).collect()
        };
        let takes = Gesture::ALL.map(|gesture| (gesture, take(gesture)));
        let slices: Vec<(Gesture, &[EmgSample])> = takes.iter().map(|(g, s)| (*g, s.as_slice())).collect();
        EmgModel::train(&EmgConfig::default(), &[0.0; 8], &slices).unwrap()
    }

    // What stood on the page was seen by eye alone before.
    #[test]
    fn the_page_is_told_what_the_muscles_say_and_why_they_say_nothing() {
        let (model, config) = (model(), TrialConfig::new("A", 1, Setup::named("still").unwrap()));
        let worn = trial::Armband { trained: &model, samples: Box::new(Armband(generator(2))) };
        let arm = Arm::of(&config).unwrap();
        let methods = MethodRegistry::standard();
        let mut session = trial::live_with(&methods, &arm, config, Some(worn)).unwrap().session;
        let content = crate::page_content::page_content(session.testbed(), &arm);
        let page = PageServer::start(PageOptions { port: 0, ..PageOptions::default() }, content).unwrap();
        let mut experimenter = Experimenter::new(&page, session.testbed(), None, None);
        let begin = experimenter.signals.recognition.clone().unwrap();
        assert_eq!(begin.gestures, Gesture::ALL.map(GestureName::from), "alphabetical, as the posterior");
        assert!(begin.posterior.is_empty() && begin.window_class.is_none());
        let mut heard_at = |tick: u64| {
            while session.testbed().now().0 < tick {
                let step = session.step(false).unwrap();
                // As if the time of a message had passed.
                experimenter.sent -= SIGNAL_PERIOD;
                experimenter.take(&step, &session, &StageClock::start());
            }
            experimenter.signals.recognition.clone().unwrap()
        };
        let relaxed = heard_at(480);
        assert_eq!((relaxed.in_force, relaxed.effort), (GestureName::default(), 0.0));
        let closing = heard_at(1400);
        let close = GestureName::from(Gesture::HandClose);
        assert_eq!((closing.in_force, closing.window_class), (close, Some(close)));
        assert!(closing.posterior[Gesture::HandClose.index()] > 0.5 && closing.effort > 0.0);
        assert!((closing.posterior.iter().sum::<f64>() - 1.0).abs() < 1e-9);
        assert!(closing.armed && closing.fault.is_none());
        let silent = heard_at(2400);
        assert_eq!((silent.in_force, silent.window_class), (GestureName::default(), None));
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
