//! What connects a person to a trial beside the page: an eye tracker, a tracked limb, and something to hear or feel.

use crate::vmpl::VmplPublisher;
use crate::{
    Calibrations, HeadTrackedShoulder, LimbReceiver, Rosbridge, TrackedShoulder, TrialMarkers, print_status,
};
use proact_bridge::{ClientInput, ControllerPose, PageHeartbeat, PageServer};
use proact_devices::{DeviceError, FeedbackSinks, GazeDevice, GazeFrame, RawGazeSample};
use proact_testbed::{RunningTrial, TrialStep};
use proact_types::{FeedbackCue, GazeSample, InputSource};
use std::{
    error::Error,
    path::Path,
    time::{Duration, Instant},
};

/// Hands cues to what makes them heard or felt, and tells what becomes of it.
pub fn send_feedback(sinks: &mut FeedbackSinks, cues: &[FeedbackCue]) {
    sinks.send_cues(cues).into_iter().for_each(print_status);
}

/// What a person who drives has connected.
pub struct UserDevices {
    eye_tracker: Option<EyeTracker>,
    limb: Option<LimbReceiver>,
    shoulder: Option<TrackedShoulder>,
    head_tracked_shoulder: Option<HeadTrackedShoulder>,
    feedback: FeedbackSinks,
    rosbridge: Option<Rosbridge>,
    vmpl: Option<VmplPublisher>,
    markers: Option<TrialMarkers>,
}

impl UserDevices {
    /// A person with `tracker`, `limb` and `rosbridge` where there are such, whose cues go to `feedback`.
    pub fn new(
        tracker: Option<Box<dyn GazeDevice>>,
        limb: Option<LimbReceiver>,
        feedback: FeedbackSinks,
        rosbridge: Option<Rosbridge>,
    ) -> Self {
        Self {
            eye_tracker: tracker.map(EyeTracker::new),
            limb,
            shoulder: None,
            head_tracked_shoulder: None,
            feedback,
            rosbridge,
            vmpl: None,
            markers: None,
        }
    }

    /// The same with markers of its trials for other recorders.
    pub fn with_markers(mut self, markers: Option<TrialMarkers>) -> Self {
        self.markers = markers;
        self
    }

    /// The time of a trial runs, and is `age_secs` after zero by now.
    pub(crate) fn begin_trial(&mut self, age_secs: f64) {
        if let Some(markers) = &mut self.markers {
            markers.begin(age_secs);
        }
    }

    /// A trial is over.
    pub(crate) fn end_trial(&mut self) {
        if let Some(markers) = &mut self.markers {
            markers.end();
        }
    }

    /// The same with a vMPL that shows the arm.
    pub fn with_vmpl(mut self, vmpl: Option<VmplPublisher>) -> Self {
        self.vmpl = vmpl;
        self
    }

    /// The same with a shoulder that motion capture sees, in the trial of `trial` first.
    pub fn with_shoulder(mut self, shoulder: Option<TrackedShoulder>, trial: &RunningTrial) -> Self {
        self.shoulder = shoulder;
        if let Some(shoulder) = &mut self.shoulder {
            shoulder.measure_reach(trial);
        }
        self
    }

    /// The same with a shoulder that goes with the head of a headset.
    pub fn with_head_tracked_shoulder(mut self, carried: bool) -> Self {
        self.head_tracked_shoulder = carried.then(HeadTrackedShoulder::default);
        self
    }

    /// The page told where a headset's controller is.
    pub fn update_controller(&mut self, controller_pose: &ControllerPose) {
        if let Some(shoulder) = &mut self.shoulder {
            shoulder.inject_controller(controller_pose);
        }
    }

    /// Keeps where a tracked trunk was with the record in `dir`.
    ///
    /// # Errors
    /// What the disk refuses.
    pub fn save_trunk(&mut self, dir: &Path) -> Result<(), String> {
        self.shoulder.as_mut().map_or(Ok(()), |shoulder| shoulder.save_trunk(dir))
    }

    /// The calibrations that a tracked shoulder rests on; none without one.
    pub fn calibrations(&self) -> Option<&Calibrations> {
        self.shoulder.as_ref().map(TrackedShoulder::calibrations)
    }

    /// What gives gaze instead of the page; none if nothing does.
    pub fn gaze_source(&self) -> Option<&'static str> {
        self.eye_tracker.as_ref().map(|_| "eye tracker")
    }

    /// Whether nothing but the page brings what the person does.
    pub fn is_page_only(&self) -> bool {
        self.eye_tracker.is_none()
            && self.limb.is_none()
            && self.shoulder.is_none()
            && self.rosbridge.is_none()
    }

    /// Shows on the page how the tracked shoulder stands; between trials what came is of no trial.
    pub fn show_tracking(&mut self, page: &PageServer, in_trial: bool) {
        if let Some(shoulder) = &mut self.shoulder {
            if !in_trial {
                shoulder.poll_between_trials();
            }
            page.set_tracking(&[shoulder.report()]);
        }
    }

    /// Between trials: whether a tracked shoulder is ready for one, and how it stands; none without one.
    pub fn shoulder_status(&mut self) -> Option<(bool, String)> {
        let shoulder = self.shoulder.as_mut()?;
        shoulder.poll_between_trials();
        let report = shoulder.report();
        if let Some(fault) = report.fault {
            return Some((false, fault));
        }
        let (sits, posture) =
            shoulder.posture().unwrap_or((true, "tracked, without a calibration".to_owned()));
        let reach = report.reach.map_or(String::new(), |reach| format!("; {}", reach.summary));
        Some((sits, posture + &reach))
    }

    /// Between trials: whether eye tracker and limb sent anything since the last call; none where there is no such. What they sent
    /// is of no trial.
    pub fn poll_between_trials(&mut self) -> [Option<bool>; 2] {
        let gaze = self.eye_tracker.as_mut().map(|eye| eye.tracker.latest().is_ok_and(|sent| sent.is_some()));
        let limb = self.limb.as_mut().map(LimbReceiver::discard_received);
        self.report_refused();
        [gaze, limb]
    }

    /// Another trial begins.
    ///
    /// # Errors
    /// As [`Rosbridge::restart`].
    pub fn restart(&mut self, trial: &RunningTrial) -> Result<(), Box<dyn Error>> {
        if let Some(shoulder) = &mut self.shoulder {
            shoulder.restart();
            shoulder.measure_reach(trial);
        }
        if let Some(shoulder) = &mut self.head_tracked_shoulder {
            shoulder.restart();
        }
        self.rosbridge.as_ref().map_or(Ok(()), |rosbridge| rosbridge.restart(trial))
    }

    /// Reports messages of the devices that were refused.
    fn report_refused(&mut self) {
        let now = Instant::now();
        let gaze = self.eye_tracker.as_mut().and_then(|eye| eye.tracker.report_refused(now));
        let limb = self.limb.as_mut().and_then(|limb| limb.report_refused(now));
        for (device, report) in [("eye tracker", gaze), ("limb", limb)] {
            report.iter().for_each(|report| print_status(format_args!("{device}: {report}")));
        }
    }

    /// Hands over what came in. Of several sources of gaze the eye tracker counts.
    pub fn apply_to(&mut self, trial: &mut RunningTrial) -> Result<(), Box<dyn Error>> {
        if let Some(rosbridge) = &self.rosbridge {
            rosbridge.apply_to(trial);
        }
        if let Some(limb) = &mut self.limb {
            limb.apply_to(trial);
        }
        if let Some(shoulder) = &mut self.shoulder {
            shoulder.apply_to(trial)?;
        }
        if let Some(shoulder) = &mut self.head_tracked_shoulder {
            shoulder.apply_to(trial);
        }
        if let Some(tracker) = &mut self.eye_tracker {
            tracker.apply_to(trial)?;
        }
        self.report_refused();
        Ok(())
    }

    /// Publishes an instant, and begins the cues of a tick.
    pub fn publish(&mut self, step: &TrialStep) {
        if let (Some(vmpl), Some(frame)) = (&self.vmpl, &step.frame) {
            vmpl.send(&frame.joints);
        }
        send_feedback(&mut self.feedback, &step.output.cues);
        if let (Some(rosbridge), Some(frame)) = (&self.rosbridge, &step.frame) {
            rosbridge.publish(frame);
        }
    }
}

/// Hands what the page in control brought, `inputs`, to a person's trial. What is not the person's comes back.
pub fn apply_page_inputs(
    page: &PageServer,
    inputs: Vec<ClientInput>,
    trial: &mut RunningTrial,
) -> Vec<ClientInput> {
    let mut others = Vec::new();
    for input in inputs {
        match input {
            ClientInput::Gesture(command) => {
                trial.person_stage_mut().set_command_from(InputSource::Page, command)
            }
            ClientInput::Gaze { origin, direction, measured } => {
                let gaze = GazeSample { origin, direction, valid: true };
                if measured {
                    trial.person_stage_mut().set_gaze(gaze)
                } else {
                    trial.person_stage_mut().set_pointer_gaze(gaze)
                }
            }
            ClientInput::Trunk(posture) => trial.person_stage_mut().set_trunk_target(posture),
            ClientInput::Head(pose) => trial.person_stage_mut().track_head(pose),
            ClientInput::Disconnected => trial.person_stage_mut().record_closed_connection(InputSource::Page),
            other => others.push(other),
        }
    }
    let limit =
        trial.testbed().config().profile.dead_man.map(|ages| Duration::from_millis(ages.max_delay_ms));
    match page.take_heartbeat(limit) {
        Some(PageHeartbeat::Alive) => trial.person_stage_mut().record_heartbeat(InputSource::Page),
        Some(PageHeartbeat::Delayed) => trial.person_stage_mut().record_delayed_heartbeat(InputSource::Page),
        Some(PageHeartbeat::Silent) => trial.person_stage_mut().record_silence(InputSource::Page),
        None => {}
    }
    others
}

/// An eye tracker, and what it sent last.
pub struct EyeTracker {
    tracker: Box<dyn GazeDevice>,
    last: Option<RawGazeSample>,
}

impl EyeTracker {
    /// What `tracker` sends.
    pub fn new(tracker: Box<dyn GazeDevice>) -> Self {
        Self { tracker, last: None }
    }

    /// Hands the newest sample to a person's trial. False if none came.
    pub fn apply_to(&mut self, trial: &mut RunningTrial) -> Result<bool, DeviceError> {
        let Some(sent) = self.tracker.latest()? else { return Ok(false) };
        let GazeSample { origin, direction, valid } = sent.sample;
        let gaze = match sent.frame {
            GazeFrame::World => sent.sample,
            GazeFrame::Head => {
                let head = trial.head_pose();
                GazeSample { origin: head * origin, direction: head.rotation * direction, valid }
            }
        };
        // Compared as sent: a frozen ray would move in the world with the head.
        let repeats = self.last.replace(sent) == Some(sent);
        if repeats && valid {
            trial.person_stage_mut().set_repeated_gaze(gaze)
        } else {
            trial.person_stage_mut().set_gaze(gaze)
        }
        Ok(true)
    }
}
