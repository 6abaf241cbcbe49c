//! From the samples of one body to its pose at the time of a display.

use crate::{
    BodySample, Nanos, clock_offset::ClockOffset, motion_estimate::MotionEstimate,
    original_filter::OriginalFilter,
};
use nalgebra::UnitQuaternion;
use proact_types::{Pose, Vector};
use serde::{Deserialize, Serialize};

/// Whose filter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FilterProfile {
    /// Kalman filters of place and turn, read at the time of the display.
    #[default]
    Default,
    /// The original's `pose_filter.py`: a mean of ten with a dead band; no prediction, no limit for an occlusion.
    Original,
}

/// How a body is followed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PoseFilterConfig {
    /// Whose filter.
    pub profile: FilterProfile,
    /// From the light on the markers to the arrival of the quickest sample, s, as the tracking system's maker states it: the
    /// pose is predicted across it.
    pub latency_secs: f64,
    /// A body that is not seen for longer than this, s, stands still, and the arm with it.
    pub occlusion_secs: f64,
    /// Longest time in which a body that is seen again is caught up with, s.
    pub resume_secs: f64,
    /// A sample as far as this from where it is expected, m, is an outlier.
    pub outlier_m: f64,
    /// The same for its attitude, degrees.
    pub outlier_deg: f64,
}

impl Default for PoseFilterConfig {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl PoseFilterConfig {
    /// That of [`Default`], as a constant.
    pub const DEFAULT: Self = Self {
        profile: FilterProfile::Default,
        latency_secs: 0.004,
        occlusion_secs: 0.25,
        resume_secs: 0.2,
        outlier_m: 0.03,
        outlier_deg: 8.0,
    };

    /// The original's filter.
    pub fn original() -> Self {
        Self { profile: FilterProfile::Original, ..Self::default() }
    }

    fn is_outlier(&self, motion: &MotionEstimate, time: f64, pose: &Pose) -> bool {
        let expected = motion.pose_at(time);
        // The longer nothing was seen, the less is known: as fast as a person moves.
        let more = 1.0 + 10.0 * (time - motion.time()).max(0.0);
        let distance = (expected.translation.vector - pose.translation.vector).norm();
        let turn = expected.rotation.angle_to(&pose.rotation).to_degrees();
        distance > self.outlier_m * more || turn > self.outlier_deg * more
    }
}

/// What a pose rests on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PoseFilterState {
    /// Samples of the last moments.
    Tracked,
    /// A gap that is bridged.
    Predicted,
    /// A gap that is too long: it stands still, and the arm must too.
    Frozen,
}

/// A pose for the display.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilteredPose {
    /// `tracking_from_body`.
    pub pose: Pose,
    /// What it rests on.
    pub state: PoseFilterState,
}

/// Outliers for longer than this are where the body is now, s.
const OUTLIERS_SECS: f64 = 0.1;
/// What a gap left is given up at this speed, m/s and rad/s, and within [`PoseFilterConfig::resume_secs`] if that is less.
const CATCH_UP_M_PER_S: f64 = 0.3;
const CATCH_UP_RAD_PER_S: f64 = 1.0;
/// A gap longer than this, s, is told as such: two and a half frames of the slowest systems.
const GAP_SECS: f64 = 0.06;

/// Follows one body: smooths without a lag for steady motion, bridges short gaps, stands still in long ones and comes back
/// without a jump. Deterministic; times come with samples and questions.
///
/// Behind it are Kalman filters of place and turn, each for three kinds of motion at once ([`crate::imm_filter`]). What a person
/// turns by when the shoulder moves, as in a lean, is learned on the way and predicted from the place, which a tracking system
/// knows better. The noise of the samples is learned too. Weakness: in a gap that begins in a quick movement the body is taken
/// to go on, and there is nothing to tell where it stopped.
#[derive(Clone, Debug)]
pub struct PoseFilter {
    config: PoseFilterConfig,
    clock: ClockOffset,
    /// On our clock.
    motion: Option<MotionEstimate>,
    /// Samples that were not believed, since when, s.
    outliers_since_secs: Option<f64>,
    original: OriginalFilter,
    displayed: Option<DisplayedPose>,
}

#[derive(Clone, Copy, Debug)]
struct DisplayedPose {
    at: f64,
    pose: Pose,
    /// What the samples said then.
    measured: Pose,
    state: PoseFilterState,
    /// What is left of the way from where it was shown to where the samples say it is: m and rad, with the time it began at.
    residual_offset: (Vector, Vector),
    since: f64,
}

impl PoseFilter {
    /// A filter that has seen nothing.
    pub fn new(config: PoseFilterConfig) -> Self {
        Self {
            config,
            clock: ClockOffset::default(),
            motion: None,
            outliers_since_secs: None,
            original: OriginalFilter::default(),
            displayed: None,
        }
    }

    /// The next sample in the order of arrival. Those that are not tracked, or no later than the one before, are passed over.
    pub fn update(&mut self, sample: &BodySample) {
        if !sample.tracked {
            return;
        }
        self.original.update(&sample.pose);
        let time = self.clock.update(sample.stamp, sample.arrival) - self.config.latency_secs;
        let Some(motion) = &mut self.motion else {
            self.motion = Some(MotionEstimate::new(time, &sample.pose));
            return;
        };
        if time <= motion.time() {
            return;
        }
        if self.config.is_outlier(motion, time, &sample.pose) {
            if time - *self.outliers_since_secs.get_or_insert(time) >= OUTLIERS_SECS {
                // It has stayed there: what came before is of no use.
                *motion = MotionEstimate::new(time, &sample.pose);
                self.outliers_since_secs = None;
            }
            return;
        }
        self.outliers_since_secs = None;
        motion.update(time, &sample.pose);
    }

    /// The body at `now` on our clock, ns: the time at which a display shows it. None before the first sample.
    pub fn pose_at(&mut self, now: Nanos) -> Option<FilteredPose> {
        let now = now as f64 * 1e-9;
        if self.config.profile == FilterProfile::Original {
            return self.original.pose().map(|pose| FilteredPose { pose, state: PoseFilterState::Tracked });
        }
        let motion = self.motion.as_ref()?;
        let newest = motion.time();
        let gap = now - newest;
        let state = match gap {
            gap if gap > self.config.occlusion_secs => PoseFilterState::Frozen,
            gap if gap > GAP_SECS => PoseFilterState::Predicted,
            _ => PoseFilterState::Tracked,
        };
        let until = now.min(newest + self.config.occlusion_secs);
        let measured = motion.pose_at(until);
        let displayed = self.blend_after_gap(now, state, &measured);
        self.displayed = Some(displayed);
        Some(FilteredPose { pose: displayed.pose, state })
    }

    /// When the newest sample that counts was measured, on our clock, s.
    pub fn newest_secs(&self) -> Option<f64> {
        self.motion.as_ref().map(MotionEstimate::time)
    }

    /// Standard deviation of a sample about a straight motion, m and rad; none before there are enough.
    pub fn noise(&self) -> Option<(f64, f64)> {
        self.motion.as_ref()?.noise()
    }

    /// What is shown of what was measured: after a gap the difference between the two is given up smoothly.
    fn blend_after_gap(&self, now: f64, state: PoseFilterState, measured: &Pose) -> DisplayedPose {
        let fresh = DisplayedPose {
            at: now,
            pose: *measured,
            measured: *measured,
            state,
            residual_offset: (Vector::zeros(), Vector::zeros()),
            since: f64::NEG_INFINITY,
        };
        let Some(before) = self.displayed else { return fresh };
        let offset = before.pose.translation.vector - measured.translation.vector;
        let turn = (before.pose.rotation * measured.rotation.inverse()).scaled_axis();
        // Seen again, or a step that no body makes from one question to the next.
        let secs = (now - before.at).max(1e-3);
        let returns = before.state != PoseFilterState::Tracked && state == PoseFilterState::Tracked;
        let step = (before.measured.translation.vector - measured.translation.vector).norm();
        let bend = before.measured.rotation.angle_to(&measured.rotation);
        let jumps = step > 0.01 + 2.0 * secs || bend > 0.05 + 6.0 * secs;
        let mut next =
            DisplayedPose { residual_offset: before.residual_offset, since: before.since, ..fresh };
        if returns || jumps {
            (next.residual_offset, next.since) = ((offset, turn), now);
        }
        let (offset, turn) = next.residual_offset;
        let needs = (offset.norm() / CATCH_UP_M_PER_S).max(turn.norm() / CATCH_UP_RAD_PER_S);
        let share = 1.0 - ((now - next.since) / needs.min(self.config.resume_secs).max(1e-3)).clamp(0.0, 1.0);
        // From 1 to 0 with no speed at either end.
        let share = share * share * (3.0 - 2.0 * share);
        next.pose = Pose::from_parts(
            (measured.translation.vector + offset * share).into(),
            UnitQuaternion::from_scaled_axis(turn * share) * measured.rotation,
        );
        next
    }
}
