//! One session through calibration, drift correction and filter, ours beside the original's method.

use super::simulated_tracking::{
    CALIBRATION_SECS, END_SECS, GroundTruth, PoseArrival, SimulatedTracking, TrackingConditions,
};
use nalgebra::UnitQuaternion;
use proact_localization::{
    BodySample, DriftCorrection, HeadsetCalibrationOptions, PoseFilter, PoseFilterConfig, PoseFilterState,
    TimedPose, calibrate_headset, calibrate_headset_from_one_pair, pair_streams,
};
use proact_types::Pose;
use std::error::Error;

/// What may be off by this much, m and degrees.
pub(super) const TOLERANCE_M_DEG: (f64, f64) = (0.005, 0.5);

#[derive(Default)]
pub(super) struct PoseErrors {
    pub position_m: Vec<f64>,
    pub rotation_deg: Vec<f64>,
}

impl PoseErrors {
    fn push(&mut self, is: &Pose, truth: &Pose) {
        self.position_m.push((is.translation.vector - truth.translation.vector).norm());
        self.rotation_deg.push(is.rotation.angle_to(&truth.rotation).to_degrees());
    }

    /// Share of those that are within 5 mm and 0.5 degrees.
    pub(super) fn proportion_within(&self) -> f64 {
        self.proportion_within_where(|_| true)
    }

    /// The same of those whose index is chosen; NaN of none.
    pub(super) fn proportion_within_where(&self, chosen: impl Fn(usize) -> bool) -> f64 {
        let all: Vec<usize> = (0..self.position_m.len()).filter(|k| chosen(*k)).collect();
        let good = all
            .iter()
            .filter(|k| {
                self.position_m[**k] <= TOLERANCE_M_DEG.0 && self.rotation_deg[**k] <= TOLERANCE_M_DEG.1
            })
            .count();
        good as f64 / all.len() as f64
    }

    fn append(&mut self, other: Self) {
        self.position_m.extend(other.position_m);
        self.rotation_deg.extend(other.rotation_deg);
    }
}

/// Over sessions: calibration at the head, displayed base, lag, ms.
#[derive(Default)]
pub(super) struct LocalizationResults {
    pub calibration: PoseErrors,
    pub displayed_base: PoseErrors,
    pub lag_ms: Vec<f64>,
    /// Of each frame: the base in `tracking`, without what the headset adds;
    pub tracked_base: PoseErrors,
    /// the headset's world at the shoulder, without the shoulder's filter;
    pub headset_world: PoseErrors,
    /// whether the cameras saw the brace in the last 60 ms.
    pub brace_visible: Vec<bool>,
}

impl LocalizationResults {
    /// The sessions of `other` after these.
    pub(super) fn append(&mut self, other: Self) {
        self.calibration.append(other.calibration);
        self.displayed_base.append(other.displayed_base);
        self.tracked_base.append(other.tracked_base);
        self.headset_world.append(other.headset_world);
        self.lag_ms.extend(other.lag_ms);
        self.brace_visible.extend(other.brace_visible);
    }
}

/// The shift of the truth that what was shown is nearest to, ms.
fn lag_ms(displayed: &[(f64, Pose)], truth: &GroundTruth) -> f64 {
    let cost = |ms: i32| {
        let parts = displayed.iter().step_by(4).map(|(t, pose)| {
            (pose.translation.vector - truth.shoulder(t - f64::from(ms) * 1e-3).translation.vector)
                .norm_squared()
        });
        parts.sum::<f64>()
    };
    (-20..200).min_by(|a, b| cost(*a).total_cmp(&cost(*b))).map_or(0.0, f64::from)
}

/// Runs the session of `seed`; what it finds is appended to both.
pub(super) fn simulate_run(
    seed: u64,
    conditions: &TrackingConditions,
    ours: &mut LocalizationResults,
    original: &mut LocalizationResults,
) -> Result<(), Box<dyn Error>> {
    let SimulatedTracking { truth, markers, head, shoulder } = SimulatedTracking::new(seed, conditions);
    let timed = |all: &[PoseArrival]| -> Vec<TimedPose> {
        all.iter().map(|(t, _, pose)| TimedPose { stamp_secs: *t, pose: *pose }).collect()
    };
    let (head, markers) = (timed(&head), timed(&markers));
    let minute = |all: &[TimedPose]| -> Vec<TimedPose> {
        all.iter().filter(|timed| timed.stamp_secs < CALIBRATION_SECS).copied().collect()
    };
    let found = calibrate_headset(&minute(&head), &minute(&markers), &HeadsetCalibrationOptions::default())?;
    // At the head: where the calibration is used.
    let head_pose = Pose::from_parts(found.head_position.into(), UnitQuaternion::identity());
    let truly = truth.headset_world_from_tracking(found.end_secs) * head_pose;
    ours.calibration.push(&(found.headset_world_from_tracking * head_pose), &truly);
    let pairs = pair_streams(&head, &markers, found.clock_offset_secs);
    let one = pairs.iter().find(|pair| pair.stamp_secs >= CALIBRATION_SECS).ok_or("no pair")?;
    let frozen = calibrate_headset_from_one_pair(&truth.head_from_markers, &one.head, &one.markers);
    original
        .calibration
        .push(&(frozen * head_pose), &(truth.headset_world_from_tracking(one.stamp_secs) * head_pose));

    let mut drift = DriftCorrection::new(&found);
    let mut filter = PoseFilter::new(PoseFilterConfig::default());
    let (mut next, mut pair, mut newest) = (0, 0, None);
    let (mut displayed, mut shown_original) = (Vec::new(), Vec::new());
    let mut original_pose = None;
    for frame in 0..((END_SECS - 2.0) * 60.0) as u32 {
        let now = f64::from(frame) / 60.0;
        while let Some((t, arrival, pose)) = shoulder.get(next).filter(|(_, arrival, _)| *arrival <= now) {
            let nanos = |secs: f64| (secs * 1e9) as i64;
            let (stamp, arrival) = (nanos(*t), nanos(*arrival));
            filter.update(&BodySample {
                body: "pad".into(),
                id: None,
                stamp,
                arrival,
                pose: *pose,
                tracked: true,
            });
            newest = Some(*pose);
            next += 1;
        }
        // Pairs have both streams' delay and the next pose of the markers.
        while let Some(both) = pairs.get(pair).filter(|both| both.stamp_secs + 0.04 <= now) {
            if both.stamp_secs > CALIBRATION_SECS {
                drift.update(both.stamp_secs, &both.head, &both.markers);
            }
            pair += 1;
        }
        let followed = filter.pose_at((now * 1e9) as i64);
        // The original tells the headset ten times a second, unfiltered.
        if frame % 6 == 0 {
            original_pose = newest;
        }
        let (Some(followed), Some(original_pose)) = (followed, original_pose) else { continue };
        if now < CALIBRATION_SECS + 1.0 {
            continue;
        }
        let (in_tracking, headset) = (truth.shoulder(now), truth.headset_world_from_tracking(now));
        let truly = headset * in_tracking;
        let corrected = drift.headset_world_from_tracking();
        ours.displayed_base.push(&(corrected * followed.pose), &truly);
        ours.tracked_base.push(&followed.pose, &in_tracking);
        ours.headset_world.push(&(corrected * in_tracking), &truly);
        ours.brace_visible.push(followed.state == PoseFilterState::Tracked);
        original.displayed_base.push(&(frozen * original_pose), &truly);
        displayed.push((now, followed.pose));
        shown_original.push((now, original_pose));
    }
    ours.lag_ms.push(lag_ms(&displayed, &truth));
    original.lag_ms.push(lag_ms(&shown_original, &truth));
    Ok(())
}
