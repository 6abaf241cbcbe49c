//! A body that a motion capture system sees, from its poses to what can be followed.

use crate::{PoseLog, print_status};
use proact_bridge::{PoseStreamStatistics, TrackingReport};
use proact_devices::motion_capture::{CaptureStatus, OpenedCapture};
use proact_localization::{
    BodySample, ClockOffset, ExpectedHeight, FilterProfile, Nanos, PoseFault, PoseFilter, PoseFilterConfig,
    PoseStreamCheck, RawBodyPose, StreamMeter, TimedPose, TrackingAxes, check_handedness, check_height,
};
use proact_types::{Pose, Vector};
use std::{collections::VecDeque, path::Path, str::FromStr};

/// Names of bodies that are kept, for people to choose from.
const MAX_BODY_NAMES: usize = 64;

const SECOND_NS: Nanos = 1_000_000_000;
/// A body is looked at for so long before the arm follows it, ns, and at least in so many poses.
const MIN_CHECK_NS: Nanos = SECOND_NS / 2;
const MIN_CHECK_POSES: usize = 10;
/// What is kept to judge by, ns.
const WINDOW_NS: Nanos = 10 * SECOND_NS;
/// Poses of these that are compared for the hand of the axes.
const MAX_HANDEDNESS_POSES: usize = 200;
/// From judgement to judgement, ns.
const CHECK_PERIOD_NS: Nanos = SECOND_NS;
/// After what makes a whole stream doubtful, nothing of it is used for so long, ns.
const REFUSAL_NS: Nanos = 3 * SECOND_NS / 2;

/// How the laboratory's axes lie: what the tracking system does not say itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MocapAxes {
    /// Which axis is up; by default what the kind of system usually has.
    pub up: Option<proact_localization::UpAxis>,
    /// Length of the system's unit, m; 1 by default.
    pub meters_per_unit: Option<f64>,
    /// Where the person looks: from the x axis of the system with z up, counter-clockwise seen from above, rad.
    pub heading_rad: f64,
}

/// What stands in the place of axes.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{got:?} is none of up=x|y|z, meters_per_unit=NUMBER above 0, heading_deg=NUMBER from -360 to 360; several are \
     separated by commas, such as up=y,meters_per_unit=0.001"
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
                // The second is its name before, of which the program tells.
                ("meters_per_unit" | "metres_per_unit", _) => {
                    axes.meters_per_unit =
                        Some(number().filter(|meters| (1e-6..=1e6).contains(meters)).ok_or_else(wrong)?);
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
    check: PoseStreamCheck,
    link: CaptureStatus,
    raw: Vec<RawBodyPose>,
    bodies: Vec<String>,
    window: VecDeque<BodySample>,
    last: Option<RawBodyPose>,
    occluded: bool,
    fault: Option<(Nanos, PoseFault)>,
    refused_until: Nanos,
    last_check: Option<Nanos>,
    handedness_checked: bool,
    meter: StreamMeter,
    filter: PoseFilter,
    filter_config: PoseFilterConfig,
    /// Other bodies of the same system, on headset or limb, with their newest poses on this machine's clock.
    extra_bodies: Vec<ExtraBody>,
    log: Option<PoseLog>,
}

impl Drop for TrackedBody {
    fn drop(&mut self) {
        self.write_log();
    }
}

/// A further body, whose poses are kept for a while.
struct ExtraBody {
    name: String,
    check: PoseStreamCheck,
    clock: ClockOffset,
    poses: VecDeque<TimedPose>,
    /// When the newest of them came.
    last_arrival: Nanos,
}

/// Poses of further bodies are kept for so long, s.
const EXTRA_BODY_SECS: f64 = 2.0;

/// What is shown of a body comes back at once after a gap: the base of the arm is led there by the physics' own filter, which
/// also waits after jumps.
const FOLLOW_FILTER: PoseFilterConfig = PoseFilterConfig { resume_secs: 0.0, ..PoseFilterConfig::DEFAULT };

impl ExtraBody {
    fn new(name: String) -> Self {
        Self {
            name,
            check: PoseStreamCheck::new(),
            clock: ClockOffset::default(),
            poses: VecDeque::new(),
            last_arrival: 0,
        }
    }

    /// A pose of it; one that is none, or not tracked, is left out.
    fn push_pose(&mut self, raw: &RawBodyPose, axes: &TrackingAxes) {
        if !raw.tracked || self.check.check(raw).is_err() {
            return;
        }
        let Ok(sample) = axes.convert(raw) else { return };
        let stamp_secs = self.clock.update(sample.stamp, sample.arrival);
        self.last_arrival = sample.arrival;
        self.poses.push_back(TimedPose { stamp_secs, pose: sample.pose });
        while self.poses.front().is_some_and(|first| first.stamp_secs < stamp_secs - EXTRA_BODY_SECS) {
            self.poses.pop_front();
        }
    }
}

/// What [`TrackedBody::poll`] found.
#[derive(Clone, Debug, PartialEq)]
pub struct UsablePose {
    /// The newest pose that can be used.
    pub sample: BodySample,
    /// It is that before, bit for bit.
    pub is_repeated: bool,
}

/// A body that is silent for so long is said to be, s.
const SILENCE_TIMEOUT_SECS: f64 = 0.25;

impl TrackedBody {
    /// The body of `opened`, in the laboratory's `axes`.
    pub fn new(opened: OpenedCapture, axes: MocapAxes) -> Self {
        let declared = TrackingAxes {
            up: axes.up.unwrap_or(opened.axes.up),
            meters_per_unit: axes.meters_per_unit.unwrap_or(opened.axes.meters_per_unit),
        };
        Self {
            opened,
            axes: declared,
            check: PoseStreamCheck::new(),
            link: CaptureStatus::Connected,
            raw: Vec::new(),
            bodies: Vec::new(),
            window: VecDeque::new(),
            last: None,
            occluded: false,
            fault: None,
            refused_until: 0,
            last_check: None,
            handedness_checked: false,
            meter: StreamMeter::default(),
            filter: PoseFilter::new(FOLLOW_FILTER),
            filter_config: FOLLOW_FILTER,
            extra_bodies: Vec::new(),
            log: None,
        }
    }

    /// The same, with the poses of the bodies `names` kept as well.
    pub fn with_extra_bodies(mut self, names: impl IntoIterator<Item = String>) -> Self {
        self.extra_bodies.extend(names.into_iter().map(ExtraBody::new));
        self
    }

    /// The same, filtered as the original filters: a mean of ten poses with a dead band, some 45 ms late.
    pub fn with_original_filter(mut self) -> Self {
        self.filter_config = PoseFilterConfig { profile: FilterProfile::Original, ..FOLLOW_FILTER };
        self.filter = PoseFilter::new(self.filter_config);
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
            log.push_head(now, world_from_head);
        }
    }

    pub(crate) fn write_log(&mut self) {
        if let Some(Err(error)) = self.log.as_mut().map(PoseLog::write) {
            print_status(format_args!("poses are not recorded: {error}"));
        }
    }

    /// The newest poses of the further body `name`, oldest first, with stamps on this machine's clock; none of a body that was not
    /// asked for.
    pub fn extra_body_poses(&mut self, name: &str) -> &[TimedPose] {
        let found = self.extra_bodies.iter_mut().find(|beside| beside.name == name);
        found.map_or(&[], |beside| beside.poses.make_contiguous())
    }

    /// The newest pose of the further body `name`, if it came in the last `age_secs`. By arrival: stamps of a clock that runs slower
    /// than it says would look ever older.
    pub fn newest_extra_pose(&self, name: &str, age_secs: f64) -> Option<&TimedPose> {
        let beside = self.extra_bodies.iter().find(|beside| beside.name == name)?;
        let age = self.opened.clock.now() - beside.last_arrival;
        beside.poses.back().filter(|_| (age as f64) < age_secs * 1e9)
    }

    /// A pose that comes another way than by the source's own, such as by the page.
    pub fn inject_pose(&mut self, pose: RawBodyPose) {
        let arrival = self.opened.clock.now();
        self.opened.capture.push_pose(RawBodyPose { arrival, ..pose });
    }

    /// This machine's clock, as arrivals are stamped by it, s.
    pub fn now_secs(&self) -> f64 {
        self.opened.clock.now() as f64 * 1e-9
    }

    /// The body now, filtered, and predicted to this moment from the newest sample on: over 30 ms at most, since a clock that
    /// runs slower than it says makes samples look ever older.
    pub fn predicted_pose(&mut self) -> Option<Pose> {
        const MAX_PREDICTION_SECS: f64 = 0.03;
        let until = ((self.filter.newest_secs()? + MAX_PREDICTION_SECS) * 1e9) as Nanos;
        let now = self.opened.clock.now().min(until);
        self.filter.pose_at(now).map(|followed| followed.pose)
    }

    /// Looks at what came since the last call. Never waits. The newest pose, if the body can be followed.
    ///
    /// # Errors
    /// The source cannot be used any more.
    pub fn poll(&mut self) -> Result<Option<UsablePose>, proact_devices::DeviceError> {
        let before = std::mem::replace(&mut self.link, CaptureStatus::Ended);
        self.raw.clear();
        self.link = self.opened.capture.drain_poses(&mut self.raw)?;
        if matches!(before, CaptureStatus::Waiting { .. }) && self.link == CaptureStatus::Connected {
            // A server that was started again counts anew; so does its clock.
            self.check = PoseStreamCheck::new();
            (self.last_check, self.handedness_checked) = (None, false);
            self.window.clear();
            (self.meter, self.filter) = (StreamMeter::default(), PoseFilter::new(self.filter_config));
            self.extra_bodies =
                self.extra_bodies.drain(..).map(|beside| ExtraBody::new(beside.name)).collect();
        }
        let mut newest = None;
        for raw in std::mem::take(&mut self.raw) {
            if !self.bodies.contains(&raw.body) && self.bodies.len() < MAX_BODY_NAMES {
                self.bodies.push(raw.body.clone());
                self.bodies.sort();
            }
            if let Some(log) = &mut self.log {
                log.push_pose(&raw);
            }
            for beside in self.extra_bodies.iter_mut().filter(|beside| beside.name == raw.body) {
                beside.push_pose(&raw, &self.axes);
            }
            if raw.body == self.opened.body {
                newest = self.process_pose(raw).or(newest);
            }
        }
        let now = self.opened.clock.now();
        let oldest = now - WINDOW_NS;
        let stale = self.window.iter().take_while(|sample| sample.arrival < oldest).count();
        self.window.drain(..stale);
        self.check_stream(now);
        let usable = self.last_check.is_some() && now >= self.refused_until;
        Ok(newest.filter(|_| usable))
    }

    /// One pose of the body.
    fn process_pose(&mut self, raw: RawBodyPose) -> Option<UsablePose> {
        let arrival = raw.arrival;
        self.occluded = !raw.tracked;
        if self.occluded {
            return None;
        }
        match self.check.check(&raw).and_then(|()| self.axes.convert(&raw)) {
            Ok(sample) => {
                let same =
                    |last: &RawBodyPose| (last.position, last.quaternion) == (raw.position, raw.quaternion);
                let repeats = self.last.as_ref().is_some_and(same);
                self.last = Some(raw);
                self.window.push_back(sample.clone());
                self.meter.update(sample.stamp, sample.arrival);
                self.filter.update(&sample);
                Some(UsablePose { sample, is_repeated: repeats })
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
            PoseFault::NotFinite { .. } | PoseFault::InvalidQuaternion { .. } | PoseFault::TooFar { .. }
        );
        if !alone {
            self.refused_until = now + REFUSAL_NS;
        }
        self.fault = Some((now, fault));
    }

    /// Judges unit, axes and hand by the last seconds.
    fn check_stream(&mut self, now: Nanos) {
        let (Some(first), Some(last)) = (self.window.front(), self.window.back()) else { return };
        let enough = last.arrival - first.arrival >= MIN_CHECK_NS && self.window.len() >= MIN_CHECK_POSES;
        let due = self.last_check.is_none_or(|at| now - at >= CHECK_PERIOD_NS);
        if !enough || !due {
            return;
        }
        let recent: Vec<BodySample> = self
            .window
            .iter()
            .filter(|sample| last.arrival - sample.arrival <= CHECK_PERIOD_NS)
            .cloned()
            .collect();
        let mut verdict = check_height(&recent, &ExpectedHeight::default());
        if verdict.is_ok() && !self.handedness_checked {
            let step = self.window.len().div_ceil(MAX_HANDEDNESS_POSES);
            let spread: Vec<BodySample> = self.window.iter().step_by(step).cloned().collect();
            verdict = check_handedness(&spread).map(|moved| self.handedness_checked = moved);
        }
        match verdict {
            Ok(()) => self.last_check = Some(now),
            Err(fault) => self.refuse(now, fault),
        }
    }

    /// Mean place and newest attitude of the last half second.
    pub(crate) fn recent_mean_pose(&self) -> Option<Pose> {
        let last = self.window.back()?;
        let recent = || self.window.iter().filter(|sample| last.arrival - sample.arrival <= MIN_CHECK_NS);
        let sum: Vector = recent().map(|sample| sample.pose.translation.vector).sum();
        Some(Pose::from_parts((sum / recent().count() as f64).into(), last.pose.rotation))
    }

    /// How it stands now.
    pub fn report(&self) -> TrackingReport {
        let now = self.opened.clock.now();
        let last = self.window.back();
        let recent =
            self.window.iter().rev().take_while(|sample| now - sample.arrival <= 2 * SECOND_NS).count();
        let stream = self.meter.timing(now).map(|quality| PoseStreamStatistics {
            lag_secs: quality.lag_secs,
            jitter_secs: quality.jitter_secs,
            dropouts: quality.dropouts,
            longest_gap_secs: quality.longest_dropout_secs,
            missing_fraction: quality.missing_share,
        });
        let age_secs = last.map(|sample| (now - sample.arrival) as f64 * 1e-9);
        let body = &self.opened.body;
        let recent_fault = self.fault.as_ref().filter(|(at, _)| now - at <= REFUSAL_NS);
        let (fault_name, fault) = if let CaptureStatus::Waiting { reason } = &self.link {
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
        } else if age_secs.is_none_or(|age| age > SILENCE_TIMEOUT_SECS) {
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
            noise_m: self.filter.noise().map(|(position_noise, _)| position_noise),
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
