//! A body that motion capture sees as the shoulder of trials.

use crate::{Calibrations, Followable, MocapAxes, TrackedBody, WornHeadset, tell};
use nalgebra::UnitQuaternion;
use proact_bridge::{CalibrationInUse, TrackingReport};
use proact_devices::motion_capture::OpenedCapture;
use proact_http::Repeats;
use proact_testbed::Session;
use proact_types::{Pose, Vector};
use std::{path::Path, time::Instant};

/// A tracked body that is the shoulder of trials.
///
/// At the start of each trial the body is where the set-up has the shoulder: its own place in the room need not be known, only
/// where the person looks ([`MocapAxes::heading_rad`]). From there on the base of the arm moves as the body does.
pub struct TrackedShoulder {
    body: TrackedBody,
    heading_rad: f64,
    calibrations: Calibrations,
    headset: Option<WornHeadset>,
    /// `world_from_tracking` and `body_from_shoulder`, once the body has been seen.
    placed: Option<(Pose, Pose)>,
    said: Repeats,
    fault: Option<String>,
}

impl TrackedShoulder {
    /// Follows the body of `opened`, with what was calibrated: see [`Calibrations::of_body`].
    pub fn new(opened: OpenedCapture, axes: MocapAxes, calibrations: Calibrations) -> Self {
        let calibrations = calibrations.of_body(&opened.body);
        let headset = calibrations.headset.as_ref().map(WornHeadset::new);
        let markers = headset.as_ref().map(|headset| headset.markers().to_owned());
        let mut shoulder = Self {
            body: TrackedBody::new(opened, axes).with_beside(markers),
            heading_rad: axes.heading_rad,
            calibrations,
            headset,
            placed: None,
            said: Repeats::default(),
            fault: None,
        };
        shoulder.restart();
        shoulder
    }

    /// The same, with all poses and the head's recorded to `path`: written when a trial begins, and at the end.
    pub fn recording(mut self, path: Option<&Path>) -> Self {
        self.body.record_to(path);
        self
    }

    /// Another trial begins: without a calibration the body is where its set-up has the shoulder.
    pub fn restart(&mut self) {
        self.placed = self.calibrated();
        self.body.write_log();
        if let Some(headset) = &mut self.headset {
            headset.restart();
        }
    }

    fn calibrated(&self) -> Option<(Pose, Pose)> {
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
        let lines = self.calibrations.lines().into_iter();
        report.calibrations = lines
            .map(|(kind, line, usable)| CalibrationInUse { kind: kind.to_owned(), line, usable })
            .collect();
        let placed = self.placed.map(|(world_from_tracking, _)| world_from_tracking);
        report.headset = self.headset.as_ref().map(|headset| headset.line(placed.as_ref()));
        let Some((_, body_from_shoulder)) = self.placed else { return report };
        report.world_from_tracking = self.world_from_tracking();
        report.world_from_shoulder = report
            .tracking_from_body
            .zip(report.world_from_tracking)
            .map(|(pose, world_from_tracking)| world_from_tracking * pose * body_from_shoulder);
        report
    }

    /// As the wearer of a calibrated headset sees it; else as it was placed.
    fn world_from_tracking(&self) -> Option<Pose> {
        let seen = self.headset.as_ref().and_then(WornHeadset::world_from_tracking);
        seen.or(self.placed.map(|(world_from_tracking, _)| world_from_tracking))
    }

    /// Between trials: whether a pose that can be used came since the last call.
    pub fn listen(&mut self) -> bool {
        matches!(self.body.poll(), Ok(Some(_)))
    }

    /// Hands the pose of now to a person's trial. False if none came that can be used: the trial sees a silence, which stops
    /// the arm. Why is told once, and when it is over.
    ///
    /// # Errors
    /// The source cannot be used any more.
    pub fn drive(&mut self, session: &mut Session) -> Result<bool, proact_devices::DeviceError> {
        let found = self.body.poll()?;
        if let Some(head) = session.headset() {
            self.body.log_head(&head);
        }
        self.say();
        let Some(Followable { sample, repeats }) = found else { return Ok(false) };
        if let (Some(headset), Some(head)) = (&mut self.headset, session.headset()) {
            headset.take(self.body.now_secs(), head, self.body.beside());
        }
        let (_, body_from_shoulder) = match self.placed {
            Some(placed) => placed,
            None => {
                let Some(rest) = self.body.rest() else { return Ok(false) };
                let shoulder = session.testbed().config().setup.body.shoulder_pose(&Default::default());
                *self.placed.insert(place(&rest, &shoulder, self.heading_rad))
            }
        };
        let Some(world_from_tracking) = self.world_from_tracking() else { return Ok(false) };
        let pose = self.body.followed().unwrap_or(sample.pose);
        let world_from_shoulder = world_from_tracking * pose * body_from_shoulder;
        if repeats {
            session.person().track_shoulder_again(world_from_shoulder);
        } else {
            session.person().track_shoulder(world_from_shoulder);
        }
        Ok(true)
    }

    /// Tells what is wrong when it begins, and that it is over.
    fn say(&mut self) {
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
        if let Some(words) = self.said.tell(kind, words, Instant::now()) {
            tell(words);
        }
    }
}

/// `world_from_tracking` and `body_from_shoulder` that put a body at `rest` on `shoulder`, if ahead is at `heading_rad`.
fn place(rest: &Pose, shoulder: &Pose, heading_rad: f64) -> (Pose, Pose) {
    let turn = UnitQuaternion::from_axis_angle(&Vector::z_axis(), -heading_rad);
    let way = shoulder.translation.vector - turn * rest.translation.vector;
    let body_from_shoulder = (turn * rest.rotation).inverse() * shoulder.rotation;
    (Pose::from_parts(way.into(), turn), Pose::from_parts(Vector::zeros().into(), body_from_shoulder))
}
