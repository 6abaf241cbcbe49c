//! A body that a motion capture system sees, from its poses to what can be followed.

use crate::{PoseLog, tell};
use proact_bridge::{StreamFigures, TrackingReport};
use proact_devices::motion_capture::{CaptureLink, OpenedCapture};
use proact_localization::{
    BodySample, ClockOffset, ExpectedPlace, FilterProfile, Nanos, PoseFault, PoseFilter, PoseFilterConfig,
    RawBodyPose, StreamCheck, StreamMeter, TimedPose, TrackingAxes, check_handedness, check_window,
};
use proact_types::{Pose, Vector};
use std::{collections::VecDeque, path::Path, str::FromStr};

/// Names of bodies that are kept, for people to choose from.
const MOST_NAMED: usize = 64;

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
                    axes.metres_per_unit =
                        Some(number().filter(|metres| (1e-6..=1e6).contains(metres)).ok_or_else(wrong)?);
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
    meter: StreamMeter,
    filter: PoseFilter,
    filtered_by: PoseFilterConfig,
    /// Other bodies of the same system, on headset or limb, with their newest poses on this machine's clock.
    beside: Vec<Beside>,
    log: Option<PoseLog>,
}

impl Drop for TrackedBody {
    fn drop(&mut self) {
        self.write_log();
    }
}

/// A further body, whose poses are kept for a while.
struct Beside {
    name: String,
    check: StreamCheck,
    clock: ClockOffset,
    poses: VecDeque<TimedPose>,
    /// When the newest of them came.
    arrived: Nanos,
}

/// Poses of further bodies are kept for so long, s.
const BESIDE_SECS: f64 = 2.0;

/// What is shown of a body comes back at once after a gap: the base of the arm is led there by the physics' own filter, which
/// also waits after jumps.
const FOLLOWING: PoseFilterConfig = PoseFilterConfig { resume_secs: 0.0, ..PoseFilterConfig::DEFAULT };

impl Beside {
    fn new(name: String) -> Self {
        Self {
            name,
            check: StreamCheck::new(),
            clock: ClockOffset::default(),
            poses: VecDeque::new(),
            arrived: 0,
        }
    }

    /// A pose of it; one that is none, or not tracked, is left out.
    fn take(&mut self, raw: &RawBodyPose, axes: &TrackingAxes) {
        if !raw.tracked || self.check.take(raw).is_err() {
            return;
        }
        let Ok(sample) = axes.convert(raw) else { return };
        let stamp_secs = self.clock.take(sample.stamp, sample.arrival);
        self.arrived = sample.arrival;
        self.poses.push_back(TimedPose { stamp_secs, pose: sample.pose });
        while self.poses.front().is_some_and(|first| first.stamp_secs < stamp_secs - BESIDE_SECS) {
            self.poses.pop_front();
        }
    }
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
            meter: StreamMeter::default(),
            filter: PoseFilter::new(FOLLOWING),
            filtered_by: FOLLOWING,
            beside: Vec::new(),
            log: None,
        }
    }

    /// The same, with the poses of the bodies `names` kept as well.
    pub fn with_beside(mut self, names: impl IntoIterator<Item = String>) -> Self {
        self.beside.extend(names.into_iter().map(Beside::new));
        self
    }

    /// The same, filtered as the original filters: a mean of ten poses with a dead band, some 45 ms late.
    pub fn with_original_filter(mut self) -> Self {
        self.filtered_by = PoseFilterConfig { profile: FilterProfile::Original, ..FOLLOWING };
        self.filter = PoseFilter::new(self.filtered_by);
        self
    }

    /// Records all that comes from now on.
    pub(crate) fn record_to(&mut self, path: Option<&Path>) {
        self.log = path.map(PoseLog::new);
    }

    /// The head as a headset tracks it now.
    pub(crate) fn log_head(&mut self, world_from_head: &Pose) {
        let now = self.opened.clock.now();
        if let Some(log) = &mut self.log {
            log.take_head(now, world_from_head);
        }
    }

    pub(crate) fn write_log(&mut self) {
        if let Some(Err(error)) = self.log.as_mut().map(PoseLog::write) {
            tell(format_args!("poses are not recorded: {error}"));
        }
    }

    /// The newest poses of the further body `name`, oldest first, with stamps on this machine's clock; none of a body that was not
    /// asked for.
    pub fn beside(&mut self, name: &str) -> &[TimedPose] {
        let found = self.beside.iter_mut().find(|beside| beside.name == name);
        found.map_or(&[], |beside| beside.poses.make_contiguous())
    }

    /// The newest pose of the further body `name`, if it came in the last `age_secs`. By arrival: stamps of a clock that runs slower
    /// than it says would look ever older.
    pub fn newest_beside(&self, name: &str, age_secs: f64) -> Option<&TimedPose> {
        let beside = self.beside.iter().find(|beside| beside.name == name)?;
        let age = self.opened.clock.now() - beside.arrived;
        beside.poses.back().filter(|_| (age as f64) < age_secs * 1e9)
    }

    /// A pose that comes another way than by the source's own, such as by the page.
    pub fn feed(&mut self, pose: RawBodyPose) {
        let arrival = self.opened.clock.now();
        self.opened.capture.feed(RawBodyPose { arrival, ..pose });
    }

    /// This machine's clock, as arrivals are stamped by it, s.
    pub fn now_secs(&self) -> f64 {
        self.opened.clock.now() as f64 * 1e-9
    }

    /// The body now, filtered, and predicted to this moment from the newest sample on: over 30 ms at most, since a clock that
    /// runs slower than it says makes samples look ever older.
    pub fn followed(&mut self) -> Option<Pose> {
        const FURTHEST_SECS: f64 = 0.03;
        let until = ((self.filter.newest_secs()? + FURTHEST_SECS) * 1e9) as Nanos;
        let now = self.opened.clock.now().min(until);
        self.filter.at(now).map(|followed| followed.pose)
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
            (self.meter, self.filter) = (StreamMeter::default(), PoseFilter::new(self.filtered_by));
            self.beside = self.beside.drain(..).map(|beside| Beside::new(beside.name)).collect();
        }
        let mut newest = None;
        for raw in std::mem::take(&mut self.raw) {
            if !self.bodies.contains(&raw.body) && self.bodies.len() < MOST_NAMED {
                self.bodies.push(raw.body.clone());
                self.bodies.sort();
            }
            if let Some(log) = &mut self.log {
                log.take(&raw);
            }
            for beside in self.beside.iter_mut().filter(|beside| beside.name == raw.body) {
                beside.take(&raw, &self.axes);
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
        match self.check.take(&raw).and_then(|()| self.axes.convert(&raw)) {
            Ok(sample) => {
                let same =
                    |last: &RawBodyPose| (last.position, last.quaternion) == (raw.position, raw.quaternion);
                let repeats = self.last.as_ref().is_some_and(same);
                self.last = Some(raw);
                self.window.push_back(sample.clone());
                self.meter.take(sample.stamp, sample.arrival);
                self.filter.take(&sample);
                Some(Followable { sample, repeats })
            }
            Err(fault) => {
                self.refuse(arrival, fault);
                None
            }
        }
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
    pub(crate) fn rest(&self) -> Option<Pose> {
        let last = self.window.back()?;
        let recent = || self.window.iter().filter(|sample| last.arrival - sample.arrival <= LOOK);
        let sum: Vector = recent().map(|sample| sample.pose.translation.vector).sum();
        Some(Pose::from_parts((sum / recent().count() as f64).into(), last.pose.rotation))
    }

    /// How it stands now.
    pub fn report(&self) -> TrackingReport {
        let now = self.opened.clock.now();
        let last = self.window.back();
        let recent = self.window.iter().rev().take_while(|sample| now - sample.arrival <= 2 * SECOND).count();
        let stream = self.meter.quality(now).map(|quality| StreamFigures {
            lag_secs: quality.lag_secs,
            jitter_secs: quality.jitter_secs,
            dropouts: quality.dropouts,
            longest_secs: quality.longest_secs,
            missing: quality.missing,
        });
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
            stream,
            noise_m: self.filter.noise().map(|(place, _)| place),
            noise_rad: self.filter.noise().map(|(_, turn)| turn),
            malformed: self.opened.capture.malformed(),
            tracking_from_body: last.map(|sample| sample.pose),
            world_from_tracking: None,
            world_from_shoulder: None,
            calibrations: Vec::new(),
            headset: None,
            limb: None,
            posture: None,
            reach: None,
            fault,
            fault_name: fault_name.map(str::to_owned),
        }
    }
}
