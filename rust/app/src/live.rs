//! A trial that a person drives in real time.

use crate::{
    CardTally, Experimenter, LivePerson, Pace, Recorder, ResultCards,
    experimenter::store_gaze_check,
    person::drive_by_page,
    run::{finish, tell_faults},
};
use crate::{experimenter::begins_or_ends, latency::StageClock};
use crate::{vmpl::is_by_decoder, vmpl_ghost::GhostReceiver};
use proact_bridge::{ClientInput, GazeCheck, PageServer};
use proact_intent::GazeOffset;
use proact_recording::seal;
use proact_testbed::{Session, TrialEnd, TrialResult};
use proact_types::DisplayFrame;
use std::{
    error::Error,
    path::PathBuf,
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

/// From report to report of the tracking sources.
pub(crate) const TRACKING_EVERY: Duration = Duration::from_millis(50);

/// Why a live trial ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ended {
    /// By the task: all blocks are settled, or time is up.
    Finished,
    /// By the experimenter.
    Aborted,
    /// By the page, for another trial.
    Restart {
        /// By this method, if the page chose one.
        method: Option<String>,
        /// With the same blocks.
        again: bool,
    },
    /// By Ctrl-C or a request to end.
    Interrupted,
}

/// Where what concerns a trial comes from: its page, and whoever conducts a study around it.
pub trait TrialInputs {
    /// Everything since the last call, oldest first.
    fn drain(&mut self) -> Vec<ClientInput>;
    /// This instant is on the page.
    fn shown(&mut self, _frame: &DisplayFrame) {}
    /// The trial is over.
    fn ended(&mut self, _result: &TrialResult) {}
}

impl TrialInputs for &PageServer {
    fn drain(&mut self) -> Vec<ClientInput> {
        self.drain_inputs()
    }
}

/// A trial before a person, its page and its record.
pub struct LiveTrial<'a> {
    /// The trial.
    pub session: Session,
    /// What writes it down, if it is recorded.
    pub recorder: Option<Recorder>,
    /// Where it is recorded.
    pub dir: Option<PathBuf>,
    /// What the person sees.
    pub page: &'a PageServer,
    /// What the person and others do.
    pub inputs: &'a mut dyn TrialInputs,
    /// What the person has connected.
    pub person: &'a mut LivePerson,
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
    pub fn run(&mut self) -> Result<(Ended, TrialResult), Box<dyn Error>> {
        let start = Instant::now();
        self.session.person().set_gaze_offset(*self.gaze_offset);
        if let (Some(dir), Some(calibrations)) = (&self.dir, self.person.calibrations()) {
            calibrations.keep(dir)?;
        }
        let mut tally = CardTally::default();
        let ended = self.drive(&mut tally)?;
        self.person.end_trial();
        let end = match &ended {
            Ended::Finished => self.session.result().ended,
            Ended::Aborted => TrialEnd::Abort,
            Ended::Restart { .. } => TrialEnd::Restart,
            Ended::Interrupted => TrialEnd::Interrupt,
        };
        if let Some(dir) = &self.dir {
            self.person.keep_trunk(dir)?;
        }
        let result = finish(&self.session, self.recorder.take(), self.dir.as_deref(), start, end)?;
        tell_faults(&result);
        self.inputs.ended(&result);
        let most = self.session.testbed().task().briefing().most;
        if let Some(results) = &mut self.results {
            results.show(self.page, most, &result, "You", tally, &[]);
        }
        Ok((ended, result))
    }

    /// Ticks in real time on what the page and the person's devices send. Where the page alone drives, time waits at the first
    /// instant that is displayed until the person acts.
    fn drive(&mut self, tally: &mut CardTally) -> Result<Ended, Box<dyn Error>> {
        let mut pace = Pace::new();
        let mut experimenter = Experimenter::new(
            self.page,
            self.session.testbed(),
            self.dir.as_deref(),
            self.person.gaze_source(),
        );
        let mut ghost = GhostReceiver::of(self.session.testbed());
        let mut shown_tracking = Instant::now();
        let (mut ending, mut shown, mut began_at_page) = (None, None, !self.waits());
        loop {
            if self.session.testbed().frame_is_due() || self.session.testbed().now().0 == 0 {
                let mut inputs = self.inputs.drain();
                // What comes in the first instants is not to wait for itself.
                let begun = inputs.iter().any(begins_or_ends);
                if shown.is_some() && !std::mem::replace(&mut began_at_page, true) && !begun {
                    experimenter.wait_for_first_action();
                }
                let still =
                    experimenter.wait_while_still(&mut pace, shown.as_ref(), self.inputs, self.interrupted);
                inputs.extend(still);
                if shown.is_some() {
                    self.person.begin_trial(self.session.testbed().now().as_secs());
                }
                for input in drive_by_page(self.page, inputs, &mut self.session) {
                    match input {
                        ClientInput::Restart { method, again } => {
                            ending = Some(Ended::Restart { method, again })
                        }
                        ClientInput::Study(action) if experimenter.act(action) => {
                            ending = Some(Ended::Aborted);
                        }
                        ClientInput::Hold(on) => experimenter.hold(on),
                        ClientInput::GazeCheck(check) => {
                            self.take_gaze_check(&check)?;
                            self.session.person().set_gaze_offset(*self.gaze_offset);
                        }
                        ClientInput::Controller(told) => self.person.take_controller(&told),
                        // A refused action; the person's inputs have been taken.
                        _ => {}
                    }
                }
                self.person.drive(&mut self.session)?;
                if shown_tracking.elapsed() >= TRACKING_EVERY {
                    shown_tracking = Instant::now();
                    self.person.show_tracking(self.page, true);
                }
                if self.interrupted.load(Ordering::Relaxed) {
                    ending = Some(Ended::Interrupted);
                }
            }
            // The tick that ends a trial closes its digest.
            let mut clock = StageClock::start();
            let step = self.session.step_watched(ending.is_some(), &mut |stage| clock.done(stage))?;
            experimenter.take(&step, &self.session, &clock);
            if let Some(recorder) = &mut self.recorder {
                recorder.write(&step, self.session.testbed().plant().state())?;
            }
            if let Some(frame) = &step.frame {
                self.page.publish(frame);
                if let Some(ghost) = &mut ghost {
                    self.page.publish_ghost(ghost.latest().as_ref());
                }
                self.inputs.shown(frame);
                tally.add(frame);
                // Shown again while time stands still; what happened in it happened once.
                shown = Some(DisplayFrame { events: vec![], feedback: vec![], ..DisplayFrame::clone(frame) });
            }
            self.person.show(&step);
            let over = step.output.finished.then_some(Ended::Finished);
            if let Some(ended) = ending.take().or(over) {
                if let Some(dir) = &self.dir {
                    experimenter.keep(dir)?;
                }
                return Ok(ended);
            }
            pace.tick();
        }
    }

    /// Whether time waits for the first action at the page: where nothing else gives gestures, gaze or angles.
    fn waits(&self) -> bool {
        let config = self.session.testbed().config();
        config.emg.is_none() && !is_by_decoder(config) && self.person.has_page_alone()
    }

    /// Keeps the last frame on the page until the person asks for a new trial or the command is ended.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn wait_for_restart(&mut self) -> Result<Ended, Box<dyn Error>> {
        while !self.interrupted.load(Ordering::Relaxed) {
            self.person.show_tracking(self.page, false);
            for input in self.inputs.drain() {
                match input {
                    ClientInput::Restart { method, again } => return Ok(Ended::Restart { method, again }),
                    ClientInput::GazeCheck(check) => {
                        self.take_gaze_check(&check)?;
                        // The record was closed already, and now holds more.
                        self.dir.as_deref().map_or(Ok(()), seal)?;
                    }
                    ClientInput::Controller(told) => self.person.take_controller(&told),
                    _ => {}
                }
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        Ok(Ended::Interrupted)
    }

    /// Records a gaze check. The error that a calibration found comes on top of what is taken off already.
    fn take_gaze_check(&mut self, check: &GazeCheck) -> std::io::Result<()> {
        if let Some([left, up]) = check.correction_deg {
            *self.gaze_offset += GazeOffset { left: left.to_radians(), up: up.to_radians() };
        }
        store_gaze_check(self.dir.as_deref(), self.session.testbed().now(), check)
    }
}
