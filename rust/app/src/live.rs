//! A trial that a person drives in real time.

use crate::{
    RealTimePacer, Recorder, ResultCardCounter, ResultCards, StatusPublisher, UserDevices,
    run::{finish_trial, print_faults},
    status_publisher::store_gaze_check,
    user_devices::apply_page_inputs,
};
use crate::{latency::StageTimer, status_publisher::starts_or_ends_trial};
use crate::{vmpl::is_vmpl_trial, vmpl_ghost::GhostReceiver};
use proact_bridge::{ClientInput, GazeCheck, PageServer};
use proact_intent::GazeOffset;
use proact_recording::write_manifest;
use proact_testbed::{RunningTrial, TrialEnd, TrialResult};
use proact_types::DisplayFrame;
use std::{
    error::Error,
    path::PathBuf,
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

/// From report to report of the tracking sources.
pub(crate) const TRACKING_REPORT_PERIOD: Duration = Duration::from_millis(50);

/// Why a live trial ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LiveTrialEnd {
    /// By the task: all blocks are settled, or time is up.
    Finished,
    /// By the experimenter.
    Aborted,
    /// By the page, for another trial.
    Restart {
        /// By this method, if the page chose one.
        method: Option<String>,
        /// With the same blocks.
        same_arrangement: bool,
    },
    /// By Ctrl-C or a request to end.
    Interrupted,
}

/// Where what concerns a trial comes from: its page, and whoever conducts a study around it.
pub trait TrialInputs {
    /// Everything since the last call, oldest first.
    fn drain(&mut self) -> Vec<ClientInput>;
    /// This instant is on the page.
    fn frame_shown(&mut self, _frame: &DisplayFrame) {}
    /// The trial is over.
    fn trial_ended(&mut self, _result: &TrialResult) {}
}

impl TrialInputs for &PageServer {
    fn drain(&mut self) -> Vec<ClientInput> {
        self.drain_inputs()
    }
}

/// A trial before a person, its page and its record.
pub struct LiveTrial<'a> {
    /// The trial.
    pub trial: RunningTrial,
    /// What writes it down, if it is recorded.
    pub recorder: Option<Recorder>,
    /// Where it is recorded.
    pub dir: Option<PathBuf>,
    /// What the person sees.
    pub page: &'a PageServer,
    /// What the person and others do.
    pub inputs: &'a mut dyn TrialInputs,
    /// What the person has connected.
    pub devices: &'a mut UserDevices,
    /// Taken off every gaze; what a calibration finds comes on top.
    pub gaze_offset: &'a mut GazeOffset,
    /// Results of the trials of this page; none where the page is not to show any.
    pub results: Option<&'a mut ResultCards>,
    /// Raised by Ctrl-C or a request to end.
    pub interrupted: &'a AtomicBool,
}

impl LiveTrial<'_> {
    /// Runs to the end, and closes the record.
    ///
    /// # Errors
    /// A native library, a device or the disk refuses.
    pub fn run(&mut self) -> Result<(LiveTrialEnd, TrialResult), Box<dyn Error>> {
        let start = Instant::now();
        self.trial.person_stage_mut().set_gaze_offset(*self.gaze_offset);
        if let (Some(dir), Some(calibrations)) = (&self.dir, self.devices.calibrations()) {
            calibrations.save_to_record(dir)?;
        }
        let mut card_counter = ResultCardCounter::default();
        let ended = self.run_loop(&mut card_counter)?;
        self.devices.end_trial();
        let end = match &ended {
            LiveTrialEnd::Finished => self.trial.result().ended,
            LiveTrialEnd::Aborted => TrialEnd::Abort,
            LiveTrialEnd::Restart { .. } => TrialEnd::Restart,
            LiveTrialEnd::Interrupted => TrialEnd::Interrupt,
        };
        if let Some(dir) = &self.dir {
            self.devices.save_trunk(dir)?;
        }
        let result = finish_trial(&self.trial, self.recorder.take(), self.dir.as_deref(), start, end)?;
        print_faults(&result);
        self.inputs.trial_ended(&result);
        let max_score = self.trial.testbed().task().briefing().max_score;
        if let Some(results) = &mut self.results {
            results.show(self.page, max_score, &result, "You", card_counter, &[]);
        }
        Ok((ended, result))
    }

    /// Ticks in real time on what the page and the person's devices send. Where the page alone drives, time waits at the first
    /// instant that is displayed until the person acts.
    fn run_loop(&mut self, card_counter: &mut ResultCardCounter) -> Result<LiveTrialEnd, Box<dyn Error>> {
        let mut pace = RealTimePacer::new();
        let mut experimenter = StatusPublisher::new(
            self.page,
            self.trial.testbed(),
            self.dir.as_deref(),
            self.devices.gaze_source(),
        );
        let mut ghost = GhostReceiver::for_testbed(self.trial.testbed());
        let mut shown_tracking = Instant::now();
        let (mut ending, mut shown, mut began_at_page) = (None, None, !self.waits_for_first_action());
        loop {
            if self.trial.testbed().frame_is_due() || self.trial.testbed().now().0 == 0 {
                let mut inputs = self.inputs.drain();
                // What comes in the first instants is not to wait for itself.
                let starts_trial = inputs.iter().any(starts_or_ends_trial);
                if shown.is_some() && !std::mem::replace(&mut began_at_page, true) && !starts_trial {
                    experimenter.wait_for_first_action();
                }
                let still =
                    experimenter.wait_while_paused(&mut pace, shown.as_ref(), self.inputs, self.interrupted);
                inputs.extend(still);
                if shown.is_some() {
                    self.devices.begin_trial(self.trial.testbed().now().as_secs());
                }
                for input in apply_page_inputs(self.page, inputs, &mut self.trial) {
                    match input {
                        ClientInput::Restart { method, same_seed: again } => {
                            ending = Some(LiveTrialEnd::Restart { method, same_arrangement: again })
                        }
                        ClientInput::Study(action) if experimenter.apply_action(action) => {
                            ending = Some(LiveTrialEnd::Aborted);
                        }
                        ClientInput::Hold(on) => experimenter.set_held(on),
                        ClientInput::GazeCheck(check) => {
                            self.record_gaze_check(&check)?;
                            self.trial.person_stage_mut().set_gaze_offset(*self.gaze_offset);
                        }
                        ClientInput::Controller(controller_pose) => {
                            self.devices.update_controller(&controller_pose)
                        }
                        // A refused action; the person's inputs have been taken.
                        _ => {}
                    }
                }
                self.devices.apply_to(&mut self.trial)?;
                if shown_tracking.elapsed() >= TRACKING_REPORT_PERIOD {
                    shown_tracking = Instant::now();
                    self.devices.show_tracking(self.page, true);
                }
                if self.interrupted.load(Ordering::Relaxed) {
                    ending = Some(LiveTrialEnd::Interrupted);
                }
            }
            // The tick that ends a trial closes its digest.
            let mut clock = StageTimer::start();
            let step =
                self.trial.step_with_stage_timing(ending.is_some(), &mut |stage| clock.stage_ended(stage))?;
            experimenter.record_tick(&step, &self.trial, &clock);
            if let Some(recorder) = &mut self.recorder {
                recorder.write(&step, self.trial.testbed().plant().state())?;
            }
            if let Some(frame) = &step.frame {
                self.page.publish(frame);
                if let Some(ghost) = &mut ghost {
                    self.page.publish_ghost(ghost.latest().as_ref());
                }
                self.inputs.frame_shown(frame);
                card_counter.add(frame);
                // Shown again while time stands still; what happened in it happened once.
                shown = Some(DisplayFrame { events: vec![], feedback: vec![], ..DisplayFrame::clone(frame) });
            }
            self.devices.publish(&step);
            let over = step.output.finished.then_some(LiveTrialEnd::Finished);
            if let Some(ended) = ending.take().or(over) {
                if let Some(dir) = &self.dir {
                    experimenter.save(dir)?;
                }
                return Ok(ended);
            }
            pace.wait_for_tick();
        }
    }

    /// Whether time waits for the first action at the page: where nothing else gives gestures, gaze or angles.
    fn waits_for_first_action(&self) -> bool {
        let config = self.trial.testbed().config();
        config.emg.is_none() && !is_vmpl_trial(config) && self.devices.is_page_only()
    }

    /// Keeps the last frame on the page until the person asks for a new trial or the command is ended.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn wait_for_restart(&mut self) -> Result<LiveTrialEnd, Box<dyn Error>> {
        while !self.interrupted.load(Ordering::Relaxed) {
            self.devices.show_tracking(self.page, false);
            for input in self.inputs.drain() {
                match input {
                    ClientInput::Restart { method, same_seed: again } => {
                        return Ok(LiveTrialEnd::Restart { method, same_arrangement: again });
                    }
                    ClientInput::GazeCheck(check) => {
                        self.record_gaze_check(&check)?;
                        // The record was closed already, and now holds more.
                        self.dir.as_deref().map_or(Ok(()), write_manifest)?;
                    }
                    ClientInput::Controller(controller_pose) => {
                        self.devices.update_controller(&controller_pose)
                    }
                    _ => {}
                }
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        Ok(LiveTrialEnd::Interrupted)
    }

    /// Records a gaze check. The error that a calibration found comes on top of what is taken off already.
    fn record_gaze_check(&mut self, check: &GazeCheck) -> std::io::Result<()> {
        if let Some([left, up]) = check.correction_deg {
            *self.gaze_offset += GazeOffset { left_rad: left.to_radians(), up_rad: up.to_radians() };
        }
        store_gaze_check(self.dir.as_deref(), self.trial.testbed().now(), check)
    }
}
