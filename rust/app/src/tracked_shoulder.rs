//! A shoulder that a motion capture system sees, from its poses to the trial.

use crate::tell;
use nalgebra::UnitQuaternion;
use proact_bridge::TrackingReport;
use proact_devices::motion_capture::{CaptureLink, OpenedCapture};
use proact_http::Repeats;
use proact_localization::{
    BodySample, ExpectedPlace, Nanos, PoseFault, RawBodyPose, StreamCheck, TrackingAxes, check_handedness,
    check_window,
};
use proact_testbed::Session;
use proact_types::{Pose, Vector};
use std::{collections::VecDeque, str::FromStr, time::Instant};

const SECOND: Nanos = 1_000_000_000;
/// A body is looked at for so long before the arm follows it, ns, and at least in so many poses.
const LOOK: Nanos = SECOND / 2;
const LEAST_POSES: usize = 10;
/// What is kept to judge by, ns.
const KEPT: Nanos = 10 * SECOND;
/// Poses of these that are compared for the hand of the axes.
const COMPARED: usize = 200;
/// From judgement to judgement, ns.
const JUDGE_EVERY: Nanos = SECOND;
/// After what makes a whole stream doubtful, nothing of it is used for so long, ns.
const REFUSED_FOR: Nanos = 3 * SECOND / 2;

/// How the laboratory's axes lie: what the tracking system does not say itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MocapAxes {
    /// Which axis is up; by default what the kind of system usually has.
    pub up: Option<proact_localization::UpAxis>,
    /// Length of the system's unit, m; 1 by default.
    pub metres_per_unit: Option<f64>,
    /// Where the person looks: from the x axis of the system with z up, counter-clockwise seen from above, rad.
    pub heading_rad: f64,
}

/// What stands in the place of axes.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{got:?} is none of up=x|y|z, metres_per_unit=NUMBER above 0, heading_deg=NUMBER from -360 to 360; several are \
     separated by commas, such as up=y,metres_per_unit=0.001"
)]
pub struct MocapAxesError {
    /// What was given.
    got: String,
}

impl FromStr for MocapAxes {
    type Err = MocapAxesError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        use proact_localization::UpAxis;
        let mut axes = Self::default();
        for part in text.split(',') {
            let wrong = || MocapAxesError { got: part.to_owned() };
            let (key, value) = part.trim().split_once('=').ok_or_else(wrong)?;
            let number = || value.parse::<f64>().ok().filter(|number| number.is_finite());
            match (key, value) {
                ("up", "x") => axes.up = Some(UpAxis::X),
                ("up", "y") => axes.up = Some(UpAxis::Y),
                ("up", "z") => axes.up = Some(UpAxis::Z),
                ("metres_per_unit", _) => {
                    axes.metres_per_unit = Some(number().filter(|metres| *metres > 0.0).ok_or_else(wrong)?);
                }
                ("heading_deg", _) => {
                    let degrees = number().filter(|degrees| degrees.abs() <= 360.0).ok_or_else(wrong)?;
                    axes.heading_rad = degrees.to_radians();
                }
                _ => return Err(wrong()),
            }
        }
        Ok(axes)
    }
}

/// A body before it is a shoulder: everything that came of it was looked at.
pub struct TrackedBody {
    opened: OpenedCapture,
    axes: TrackingAxes,
    check: StreamCheck,
    link: CaptureLink,
    raw: Vec<RawBodyPose>,
    bodies: Vec<String>,
    window: VecDeque<BodySample>,
    last: Option<RawBodyPose>,
    occluded: bool,
    fault: Option<(Nanos, PoseFault)>,
    refused_until: Nanos,
    judged: Option<Nanos>,
    handed: bool,
}

/// What [`TrackedBody::poll`] found.
#[derive(Clone, Debug, PartialEq)]
pub struct Followable {
    /// The newest pose that can be used.
    pub sample: BodySample,
    /// It is that before, bit for bit.
    pub repeats: bool,
}

/// A body that is silent for so long is said to be, s.
const SILENT_SECS: f64 = 0.25;

impl TrackedBody {
    /// The body of `opened`, in the laboratory's `axes`.
    pub fn new(opened: OpenedCapture, axes: MocapAxes) -> Self {
        let declared = TrackingAxes {
            up: axes.up.unwrap_or(opened.axes.up),
            metres_per_unit: axes.metres_per_unit.unwrap_or(opened.axes.metres_per_unit),
        };
        Self {
            opened,
            axes: declared,
            check: StreamCheck::new(),
            link: CaptureLink::Connected,
            raw: Vec::new(),
            bodies: Vec::new(),
            window: VecDeque::new(),
            last: None,
            occluded: false,
            fault: None,
            refused_until: 0,
            judged: None,
            handed: false,
        }
    }

    /// Looks at what came since the last call. Never waits. The newest pose, if the body can be followed.
    ///
    /// # Errors
    /// The source cannot be used any more.
    pub fn poll(&mut self) -> Result<Option<Followable>, proact_devices::DeviceError> {
        let before = std::mem::replace(&mut self.link, CaptureLink::Ended);
        self.raw.clear();
        self.link = self.opened.capture.take(&mut self.raw)?;
        if matches!(before, CaptureLink::Waiting { .. }) && self.link == CaptureLink::Connected {
            // A server that was started again counts anew; so does its clock.
            self.check = StreamCheck::new();
            (self.judged, self.handed) = (None, false);
            self.window.clear();
        }
        let mut newest = None;
        for raw in std::mem::take(&mut self.raw) {
            if !self.bodies.contains(&raw.body) && self.bodies.len() < MOST_NAMED {
                self.bodies.push(raw.body.clone());
                self.bodies.sort();
            }
            if raw.body == self.opened.body {
                newest = self.look_at(raw).or(newest);
            }
        }
        let now = self.opened.clock.now();
        let oldest = now - KEPT;
        let stale = self.window.iter().take_while(|sample| sample.arrival < oldest).count();
        self.window.drain(..stale);
        self.judge(now);
        let usable = self.judged.is_some() && now >= self.refused_until;
        Ok(newest.filter(|_| usable))
    }

    /// One pose of the body.
    fn look_at(&mut self, raw: RawBodyPose) -> Option<Followable> {
        let arrival = raw.arrival;
        self.occluded = !raw.tracked;
        if self.occluded {
            return None;
        }
        match self.check.take(&raw).and_then(|()| self.convert(&raw)) {
            Ok(sample) => {
                let same =
                    |last: &RawBodyPose| (last.position, last.quaternion) == (raw.position, raw.quaternion);
                let repeats = self.last.as_ref().is_some_and(same);
                self.last = Some(raw);
                self.window.push_back(sample.clone());
                Some(Followable { sample, repeats })
            }
            Err(fault) => {
                self.refuse(arrival, fault);
                None
            }
        }
    }

    /// The pose in metres with z up. What is further off than anything can be is named as millimetres if it is that.
    fn convert(&self, raw: &RawBodyPose) -> Result<BodySample, PoseFault> {
        self.axes.convert(raw).map_err(|fault| {
            let milli = TrackingAxes { metres_per_unit: self.axes.metres_per_unit / 1000.0, ..self.axes };
            let mistaken = milli.convert(raw).map(|mut sample| {
                sample.pose.translation.vector *= 1000.0;
                sample
            });
            match (&fault, mistaken) {
                (PoseFault::Far { .. }, Ok(sample)) => {
                    check_window(&[sample], &ExpectedPlace::default()).err().unwrap_or(fault)
                }
                _ => fault,
            }
        })
    }

    fn refuse(&mut self, now: Nanos, fault: PoseFault) {
        // One pose that is none is left out; what makes the stream doubtful stops it.
        let alone = matches!(
            fault,
            PoseFault::NotFinite { .. } | PoseFault::NoRotation { .. } | PoseFault::Far { .. }
        );
        if !alone {
            self.refused_until = now + REFUSED_FOR;
        }
        self.fault = Some((now, fault));
    }

    /// Judges unit, axes and hand by the last seconds.
    fn judge(&mut self, now: Nanos) {
        let (Some(first), Some(last)) = (self.window.front(), self.window.back()) else { return };
        let enough = last.arrival - first.arrival >= LOOK && self.window.len() >= LEAST_POSES;
        let due = self.judged.is_none_or(|at| now - at >= JUDGE_EVERY);
        if !enough || !due {
            return;
        }
        let recent: Vec<BodySample> = self
            .window
            .iter()
            .filter(|sample| last.arrival - sample.arrival <= JUDGE_EVERY)
            .cloned()
            .collect();
        let mut verdict = check_window(&recent, &ExpectedPlace::default());
        if verdict.is_ok() && !self.handed {
            let step = self.window.len().div_ceil(COMPARED);
            let spread: Vec<BodySample> = self.window.iter().step_by(step).cloned().collect();
            verdict = check_handedness(&spread).map(|moved| self.handed = moved);
        }
        match verdict {
            Ok(()) => self.judged = Some(now),
            Err(fault) => self.refuse(now, fault),
        }
    }

    /// Mean place and newest attitude of the last half second.
    fn rest(&self) -> Option<Pose> {
        let last = self.window.back()?;
        let recent = || self.window.iter().filter(|sample| last.arrival - sample.arrival <= LOOK);
        let sum: Vector = recent().map(|sample| sample.pose.translation.vector).sum();
        Some(Pose::from_parts((sum / recent().count() as f64).into(), last.pose.rotation))
    }

    /// Standard deviation of one axis of the places in the last second, m. Of a place that is moved smoothly the second
    /// differences are noise alone, six times its variance.
    fn noise(&self) -> Option<f64> {
        let last = self.window.back()?;
        let recent: Vec<Vector> = self
            .window
            .iter()
            .filter(|sample| last.arrival - sample.arrival <= SECOND)
            .map(|sample| sample.pose.translation.vector)
            .collect();
        let bends = recent.windows(3).map(|p| (p[0] - 2.0 * p[1] + p[2]).norm_squared());
        (recent.len() >= LEAST_POSES).then(|| (bends.sum::<f64>() / (18 * (recent.len() - 2)) as f64).sqrt())
    }

    /// How it stands now.
    pub fn report(&self) -> TrackingReport {
        let now = self.opened.clock.now();
        let last = self.window.back();
        let recent = self.window.iter().rev().take_while(|sample| now - sample.arrival <= 2 * SECOND).count();
        let age_secs = last.map(|sample| (now - sample.arrival) as f64 * 1e-9);
        let body = &self.opened.body;
        let recent_fault = self.fault.as_ref().filter(|(at, _)| now - at <= REFUSED_FOR);
        let (fault_name, fault) = if let CaptureLink::Waiting { reason } = &self.link {
            (Some("waiting"), Some(reason.clone()))
        } else if let Some((_, fault)) = recent_fault {
            (Some(fault.name()), Some(fault.to_string()))
        } else if self.occluded {
            let reason =
                format!("body {body:?} is not seen; clear the view of the cameras, check its markers");
            (Some("occluded"), Some(reason))
        } else if last.is_none() && !self.bodies.is_empty() {
            let known = self.bodies.join(", ");
            (
                Some("no_body"),
                Some(format!("no body {body:?}, got {known}; name one of these behind the slash")),
            )
        } else if age_secs.is_none_or(|age| age > SILENT_SECS) {
            (
                Some("silent"),
                Some(format!("nothing comes of body {body:?}; is it defined, seen and streamed?")),
            )
        } else {
            (None, None)
        };
        TrackingReport {
            source: self.opened.name.to_string(),
            body: body.clone(),
            bodies: self.bodies.clone(),
            rate_hz: recent as f64 / 2.0,
            age_secs,
            noise_m: self.noise(),
            malformed: self.opened.capture.malformed(),
            tracking_from_body: last.map(|sample| sample.pose),
            world_from_tracking: None,
            world_from_shoulder: None,
            fault,
            fault_name: fault_name.map(str::to_owned),
        }
    }
}

/// Names of bodies that are kept, for people to choose from.
const MOST_NAMED: usize = 64;

/// A tracked body that is the shoulder of trials.
///
/// At the start of each trial the body is where the set-up has the shoulder: its own place in the room need not be known, only
/// where the person looks ([`MocapAxes::heading_rad`]). From there on the base of the arm moves as the body does.
pub struct TrackedShoulder {
    body: TrackedBody,
    heading_rad: f64,
    /// `world_from_tracking` and `body_from_shoulder`, once the body has been seen.
    placed: Option<(Pose, Pose)>,
    said: Repeats,
    fault: Option<String>,
}

impl TrackedShoulder {
    /// Follows the body of `opened`.
    pub fn new(opened: OpenedCapture, axes: MocapAxes) -> Self {
        Self {
            body: TrackedBody::new(opened, axes),
            heading_rad: axes.heading_rad,
            placed: None,
            said: Repeats::default(),
            fault: None,
        }
    }

    /// Another trial begins: where the body is then, is where its set-up has the shoulder.
    pub fn restart(&mut self) {
        self.placed = None;
    }

    /// How it stands now.
    pub fn report(&self) -> TrackingReport {
        let report = self.body.report();
        let Some((world_from_tracking, body_from_shoulder)) = self.placed else { return report };
        let world_from_shoulder =
            report.tracking_from_body.map(|pose| world_from_tracking * pose * body_from_shoulder);
        TrackingReport { world_from_tracking: Some(world_from_tracking), world_from_shoulder, ..report }
    }

    /// Between trials: whether a pose that can be used came since the last call.
    pub fn listen(&mut self) -> bool {
        matches!(self.body.poll(), Ok(Some(_)))
    }

    /// Hands the newest pose to a person's trial. False if none came that can be used: the trial sees a silence, which stops
    /// the arm. Why is told once, and when it is over.
    ///
    /// # Errors
    /// The source cannot be used any more.
    pub fn drive(&mut self, session: &mut Session) -> Result<bool, proact_devices::DeviceError> {
        let found = self.body.poll()?;
        self.say();
        let Some(Followable { sample, repeats }) = found else { return Ok(false) };
        let (world_from_tracking, body_from_shoulder) = match self.placed {
            Some(placed) => placed,
            None => {
                let Some(rest) = self.body.rest() else { return Ok(false) };
                let shoulder = session.testbed().config().setup.body.shoulder_pose(&Default::default());
                *self.placed.insert(place(&rest, &shoulder, self.heading_rad))
            }
        };
        let world_from_shoulder = world_from_tracking * sample.pose * body_from_shoulder;
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
