//! A body that motion capture sees as the shoulder of trials.

use crate::{
    Calibrations, HeadsetAlignment, LimbBodies, MocapAxes, ReachMap, TRUNK_FILE, TrackedBody, TrackedLimb,
    TrackedLimbError, UsablePose, print_status, trunk_text,
};
use nalgebra::UnitQuaternion;
use proact_arm::Side;
use proact_bridge::{ActiveCalibration, ControllerPose, ReachGrid, TrackingReport};
use proact_devices::DeviceError;
use proact_devices::motion_capture::{LEFT_CONTROLLER, OpenedCapture, RIGHT_CONTROLLER};
use proact_files::write_atomically;
use proact_http::LogThrottle;
use proact_localization::{FilterProfile, Nanos, RawBodyPose};
use proact_testbed::RunningTrial;
use proact_types::{Number, Pose, SimTime, Vector};
use std::{path::Path, time::Instant};

/// A person who sits as for the calibration is this near to it: m, degrees. People breathe and settle; a belt that slipped, or a
/// chair that was moved, is further.
const POSTURE_TOLERANCE_M: f64 = 0.03;
const POSTURE_TOLERANCE_DEG: f64 = 10.0;

/// Why a tracked shoulder cannot be used any more.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrackedShoulderError {
    /// Its source.
    #[error(transparent)]
    Source(#[from] DeviceError),
    /// The limb below it.
    #[error(transparent)]
    Limb(#[from] TrackedLimbError),
}

/// A body on the trunk, for the record.
struct TrackedTrunk {
    body: String,
    /// Stamp of the pose that was taken last, s.
    last_stamp_secs: f64,
    poses: Vec<(SimTime, Pose)>,
}

/// A tracked body that is the shoulder of trials.
///
/// At the start of each trial the body is where the set-up has the shoulder: its own place in the room need not be known, only
/// where the person looks ([`MocapAxes::heading_rad`]). From there on the base of the arm moves as the body does.
pub struct TrackedShoulder {
    body: TrackedBody,
    heading_rad: f64,
    calibrations: Calibrations,
    headset: Option<HeadsetAlignment>,
    limb: Option<TrackedLimb>,
    reach: Option<ReachGrid>,
    trunk: Option<TrackedTrunk>,
    /// `world_from_tracking` and `body_from_shoulder`, once the body has been seen.
    placement: Option<(Pose, Pose)>,
    log_throttle: LogThrottle,
    fault: Option<String>,
}

impl TrackedShoulder {
    /// Follows the body of `opened`, with what was calibrated: see [`Calibrations::for_body`].
    pub fn new(opened: OpenedCapture, axes: MocapAxes, calibrations: Calibrations) -> Self {
        let calibrations = calibrations.for_body(&opened.body);
        let headset = calibrations.headset.as_ref().map(HeadsetAlignment::new);
        let markers = headset.as_ref().map(|headset| headset.markers().to_owned());
        let mut shoulder = Self {
            body: TrackedBody::new(opened, axes).with_extra_bodies(markers),
            limb: None,
            reach: None,
            trunk: None,
            heading_rad: axes.heading_rad,
            calibrations,
            headset,
            placement: None,
            log_throttle: LogThrottle::default(),
            fault: None,
        };
        shoulder.restart();
        shoulder
    }

    /// The same, with the person's own limb by further bodies of the same system.
    pub fn with_limb(mut self, bodies: Option<LimbBodies>) -> Self {
        let Some(bodies) = bodies else { return self };
        self.body = self.body.with_extra_bodies(bodies.names().cloned());
        self.limb = Some(TrackedLimb::new(bodies));
        self
    }

    /// The same, filtered as `profile` says.
    pub fn with_filter(mut self, profile: FilterProfile) -> Self {
        if profile == FilterProfile::Original {
            self.body = self.body.with_original_filter();
        }
        self
    }

    /// How the person sits, against how they sat when the shoulder was calibrated: whether it is as it was, and in words. None
    /// without a calibration, or before the body was seen.
    pub fn posture(&self) -> Option<(bool, String)> {
        let saved = &self.calibrations.shoulder.as_ref()?.calibration;
        let placement = &saved.placement;
        let now = placement.world_from_tracking * self.body.recent_mean_pose()? * saved.body_from_shoulder;
        Some(check_posture(&placement.world_from_shoulder, &now))
    }

    /// The same, with the trunk by a further body of the same system: it moves nothing, and is kept with the record.
    pub fn with_trunk(mut self, body: Option<String>) -> Self {
        let Some(body) = body else { return self };
        self.body = self.body.with_extra_bodies([body.clone()]);
        self.trunk = Some(TrackedTrunk { body, last_stamp_secs: f64::NEG_INFINITY, poses: Vec::new() });
        self
    }

    /// Writes where the trunk was in the trial whose record is `dir`; nothing where it was not seen.
    ///
    /// # Errors
    /// What the disk refuses.
    pub fn save_trunk(&mut self, dir: &Path) -> Result<(), String> {
        let poses = self.trunk.as_mut().map(|trunk| std::mem::take(&mut trunk.poses)).unwrap_or_default();
        if poses.is_empty() {
            return Ok(());
        }
        Ok(write_atomically(&dir.join(TRUNK_FILE), trunk_text(&poses))?)
    }

    /// Finds what is in reach in a trial that is about to begin.
    pub fn measure_reach(&mut self, trial: &RunningTrial) {
        let testbed = trial.testbed();
        let (scene, body) = (testbed.task().scene(), &testbed.config().setup.body);
        self.reach = Some(ReachMap::new(testbed.model(), scene, body).to_page_picture());
    }

    /// A controller of a headset, of which its page tells. Of other systems nothing is taken.
    pub fn inject_controller(&mut self, controller_pose: &ControllerPose) {
        let body = match controller_pose.hand {
            Side::Left => LEFT_CONTROLLER,
            Side::Right => RIGHT_CONTROLLER,
        };
        self.body.inject_pose(RawBodyPose {
            body: body.to_owned(),
            id: None,
            stamp: (controller_pose.time_ms * 1e6) as Nanos,
            arrival: 0,
            position: controller_pose.position,
            quaternion: controller_pose.quaternion,
            tracked: controller_pose.tracked,
        });
    }

    /// The same, with all poses and the head's recorded to `path`: written when a trial begins, and at the end.
    pub fn with_pose_log(mut self, path: Option<&Path>) -> Self {
        self.body.record_to(path);
        self
    }

    /// Another trial begins: without a calibration the body is where its set-up has the shoulder.
    pub fn restart(&mut self) {
        self.placement = self.calibrated_placement();
        self.body.write_log();
        if let Some(headset) = &mut self.headset {
            headset.restart();
        }
        if let Some(limb) = &mut self.limb {
            limb.restart();
        }
        if let Some(trunk) = &mut self.trunk {
            trunk.poses.clear();
        }
    }

    fn calibrated_placement(&self) -> Option<(Pose, Pose)> {
        let saved = self.calibrations.shoulder.as_ref().map(|saved| &saved.calibration)?;
        Some((saved.placement.world_from_tracking, saved.body_from_shoulder))
    }

    /// The calibrations that are in use, to be kept with the record.
    pub fn calibrations(&self) -> &Calibrations {
        &self.calibrations
    }

    /// How it stands now.
    pub fn report(&self) -> TrackingReport {
        let mut report = self.body.report();
        let lines = self.calibrations.summaries().into_iter();
        report.calibrations = lines
            .map(|(kind, line, usable)| ActiveCalibration { kind: kind.to_owned(), summary: line, usable })
            .collect();
        let placed = self.placement.map(|(world_from_tracking, _)| world_from_tracking);
        report.posture = self.posture().map(|(_, words)| words);
        report.reach = self.reach.clone();
        report.limb = self.limb.as_ref().map(|limb| limb.status_line().to_owned());
        report.headset = self.headset.as_ref().map(|headset| headset.status_line(placed.as_ref()));
        let Some((_, body_from_shoulder)) = self.placement else { return report };
        report.world_from_tracking = self.world_from_tracking();
        report.world_from_shoulder = report
            .tracking_from_body
            .zip(report.world_from_tracking)
            .map(|(pose, world_from_tracking)| world_from_tracking * pose * body_from_shoulder);
        report
    }

    /// As the wearer of a calibrated headset sees it; else as it was placed.
    fn world_from_tracking(&self) -> Option<Pose> {
        let seen = self.headset.as_ref().and_then(HeadsetAlignment::world_from_tracking);
        seen.or(self.placement.map(|(world_from_tracking, _)| world_from_tracking))
    }

    /// Between trials: whether a pose that can be used came since the last call.
    pub fn poll_between_trials(&mut self) -> bool {
        matches!(self.body.poll(), Ok(Some(_)))
    }

    /// Hands the pose of now to a person's trial. False if none came that can be used: the trial sees a silence, which stops
    /// the arm. Why is told once, and when it is over.
    ///
    /// # Errors
    /// The source cannot be used any more, or the arm has no limb to follow.
    pub fn apply_to(&mut self, trial: &mut RunningTrial) -> Result<bool, TrackedShoulderError> {
        let found = self.body.poll()?;
        if let Some(head) = trial.headset_pose() {
            self.body.log_head(&head);
        }
        self.report_fault_changes();
        let Some(UsablePose { sample, is_repeated: repeats }) = found else { return Ok(false) };
        if let (Some(headset), Some(head)) = (&mut self.headset, trial.headset_pose()) {
            let now_secs = self.body.now_secs();
            let markers = headset.markers().to_owned();
            headset.push_poses(now_secs, head, self.body.extra_body_poses(&markers));
        }
        let (_, body_from_shoulder) = match self.placement {
            Some(placed) => placed,
            None => {
                let Some(rest) = self.body.recent_mean_pose() else { return Ok(false) };
                let shoulder = trial.testbed().config().setup.body.shoulder_pose(&Default::default());
                *self.placement.insert(compute_placement(&rest, &shoulder, self.heading_rad))
            }
        };
        let Some(world_from_tracking) = self.world_from_tracking() else { return Ok(false) };
        if let Some(trunk) = &mut self.trunk
            && let Some(last) = self
                .body
                .extra_body_poses(&trunk.body)
                .last()
                .filter(|last| last.stamp_secs > trunk.last_stamp_secs)
        {
            trunk.last_stamp_secs = last.stamp_secs;
            trunk.poses.push((trial.testbed().now(), world_from_tracking * last.pose));
        }
        let pose = self.body.predicted_pose().unwrap_or(sample.pose);
        if let Some(limb) = &mut self.limb {
            limb.apply_to(trial, &(pose * body_from_shoulder), &self.body)?;
        }
        let world_from_shoulder = world_from_tracking * pose * body_from_shoulder;
        if repeats {
            trial.person_stage_mut().track_repeated_shoulder(world_from_shoulder);
        } else {
            trial.person_stage_mut().track_shoulder(world_from_shoulder);
        }
        Ok(true)
    }

    /// Tells what is wrong when it begins, and that it is over.
    fn report_fault_changes(&mut self) {
        let report = self.body.report();
        if report.fault_name == self.fault {
            return;
        }
        let source = &report.source;
        let words = match &report.fault {
            Some(fault) => format!("motion capture {source}: the arm stands: {fault}"),
            None => format!("motion capture {source}: body {:?} is tracked", report.body),
        };
        // Each is of its own kind, so that of a source that comes and goes both are said, and counted.
        let kind = if report.fault.is_some() { "motion capture" } else { "motion capture again" };
        self.fault = report.fault_name;
        if let Some(words) = self.log_throttle.report(kind, words, Instant::now()) {
            print_status(words);
        }
    }
}

/// Whether a shoulder is now where it was when it was calibrated, and in words.
fn check_posture(was: &Pose, now: &Pose) -> (bool, String) {
    let displacement = now.translation.vector - was.translation.vector;
    let lean = (now.rotation * Vector::z()).angle(&(was.rotation * Vector::z())).to_degrees();
    let good = displacement.norm() <= POSTURE_TOLERANCE_M && lean <= POSTURE_TOLERANCE_DEG;
    let [ahead, left, up] =
        [displacement.x, displacement.y, displacement.z].map(|meters| Number(1e3 * meters));
    let words = format!(
        "the shoulder is {:.0} mm from where it was calibrated ({ahead:+.0} ahead, {left:+.0} left, {up:+.0} up), and leans by \
         {lean:.0} degrees",
        1e3 * displacement.norm()
    );
    let advice = if good { "" } else { ": sit as for the calibration, or calibrate anew" };
    (good, words + advice)
}

/// `world_from_tracking` and `body_from_shoulder` that put a body at `rest` on `shoulder`, if ahead is at `heading_rad`.
fn compute_placement(rest: &Pose, shoulder: &Pose, heading_rad: f64) -> (Pose, Pose) {
    let turn = UnitQuaternion::from_axis_angle(&Vector::z_axis(), -heading_rad);
    let translation = shoulder.translation.vector - turn * rest.translation.vector;
    let body_from_shoulder = (turn * rest.rotation).inverse() * shoulder.rotation;
    (Pose::from_parts(translation.into(), turn), Pose::from_parts(Vector::zeros().into(), body_from_shoulder))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Translation3;

    fn moved(x: f64, y: f64, z: f64, lean_deg: f64) -> Pose {
        let lean = UnitQuaternion::from_axis_angle(&Vector::y_axis(), lean_deg.to_radians());
        // Turning about the vertical is no lean.
        let turned = lean * UnitQuaternion::from_axis_angle(&Vector::z_axis(), 0.5);
        Pose::from_parts(Translation3::new(x, y, 1.0 + z), turned)
    }

    #[test]
    fn who_moved_or_leans_is_told_by_how_much_and_what_to_do() {
        let was = moved(0.0, 0.0, 0.0, 0.0);
        let (good, words) = check_posture(&was, &moved(0.01, -0.02, 0.005, 9.0));
        assert!(good && !words.contains("calibrate anew"), "{words}");
        assert!(words.contains("23 mm") && words.contains("+10 ahead, -20 left, +5 up"), "{words}");
        assert!(words.contains("leans by 9 degrees"), "{words}");
        let (good, words) = check_posture(&was, &moved(0.0, 0.0, -0.04, 0.0));
        assert!(!good && words.contains("-40 up") && words.ends_with("or calibrate anew"), "{words}");
        let (good, words) = check_posture(&was, &moved(0.0, 0.0, 0.0, 12.0));
        assert!(!good && words.contains("0 mm") && words.contains("12 degrees"), "{words}");
    }
}
