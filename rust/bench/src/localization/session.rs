//! One session through calibration, drift correction and filter, ours beside the original's method.

use super::simulated::{Arrival, CALIBRATION_SECS, Conditions, END_SECS, Simulated, Truth};
use nalgebra::UnitQuaternion;
use proact_localization::{
    BodySample, CalibrationOptions, DriftCorrection, FollowState, PoseFilter, PoseFilterConfig, TimedPose,
    calibrate, one_shot, pair_streams,
};
use proact_types::Pose;
use std::error::Error;

/// What may be off by this much, m and degrees.
pub(super) const GOAL: (f64, f64) = (0.005, 0.5);

#[derive(Default)]
pub(super) struct Errors {
    pub m: Vec<f64>,
    pub deg: Vec<f64>,
}

impl Errors {
    fn push(&mut self, is: &Pose, truth: &Pose) {
        self.m.push((is.translation.vector - truth.translation.vector).norm());
        self.deg.push(is.rotation.angle_to(&truth.rotation).to_degrees());
    }

    /// Share of those that are within 5 mm and 0.5 degrees.
    pub(super) fn within(&self) -> f64 {
        self.within_where(|_| true)
    }

    /// The same of those whose index is chosen; NaN of none.
    pub(super) fn within_where(&self, chosen: impl Fn(usize) -> bool) -> f64 {
        let all: Vec<usize> = (0..self.m.len()).filter(|k| chosen(*k)).collect();
        let good = all.iter().filter(|k| self.m[**k] <= GOAL.0 && self.deg[**k] <= GOAL.1).count();
        good as f64 / all.len() as f64
    }

    fn append(&mut self, other: Self) {
        self.m.extend(other.m);
        self.deg.extend(other.deg);
    }
}

/// Over sessions: calibration at the head, displayed base, lag, ms.
#[derive(Default)]
pub(super) struct Found {
    pub calibration: Errors,
    pub shown: Errors,
    pub lag_ms: Vec<f64>,
    /// Of each frame: the base in `tracking`, without what the headset adds;
    pub followed: Errors,
    /// the headset's world at the shoulder, without the shoulder's filter;
    pub headset: Errors,
    /// whether the cameras saw the brace in the last 60 ms.
    pub seen: Vec<bool>,
}

impl Found {
    /// The sessions of `other` after these.
    pub(super) fn append(&mut self, other: Self) {
        self.calibration.append(other.calibration);
        self.shown.append(other.shown);
        self.followed.append(other.followed);
        self.headset.append(other.headset);
        self.lag_ms.extend(other.lag_ms);
        self.seen.extend(other.seen);
    }
}

/// The shift of the truth that what was shown is nearest to, ms.
fn lag_ms(shown: &[(f64, Pose)], truth: &Truth) -> f64 {
    let cost = |ms: i32| {
        let parts = shown.iter().step_by(4).map(|(t, pose)| {
            (pose.translation.vector - truth.shoulder(t - f64::from(ms) * 1e-3).translation.vector)
                .norm_squared()
        });
        parts.sum::<f64>()
    };
    (-20..200).min_by(|a, b| cost(*a).total_cmp(&cost(*b))).map_or(0.0, f64::from)
}

/// Runs the session of `seed`; what it finds is appended to both.
pub(super) fn session(
    seed: u64,
    conditions: &Conditions,
    ours: &mut Found,
    original: &mut Found,
) -> Result<(), Box<dyn Error>> {
    let Simulated { truth, markers, head, shoulder } = Simulated::new(seed, conditions);
    let timed = |all: &[Arrival]| -> Vec<TimedPose> {
        all.iter().map(|(t, _, pose)| TimedPose { stamp_secs: *t, pose: *pose }).collect()
    };
    let (head, markers) = (timed(&head), timed(&markers));
    let minute = |all: &[TimedPose]| -> Vec<TimedPose> {
        all.iter().filter(|timed| timed.stamp_secs < CALIBRATION_SECS).copied().collect()
    };
    let found = calibrate(&minute(&head), &minute(&markers), &CalibrationOptions::default())?;
    // At the head: where the calibration is used.
    let place = Pose::from_parts(found.head_place.into(), UnitQuaternion::identity());
    let truly = truth.headset_world_from_tracking(found.end_secs) * place;
    ours.calibration.push(&(found.headset_world_from_tracking * place), &truly);
    let pairs = pair_streams(&head, &markers, found.clock_offset_secs);
    let one = pairs.iter().find(|pair| pair.stamp_secs >= CALIBRATION_SECS).ok_or("no pair")?;
    let frozen = one_shot(&truth.x, &one.head, &one.markers);
    original
        .calibration
        .push(&(frozen * place), &(truth.headset_world_from_tracking(one.stamp_secs) * place));

    let mut drift = DriftCorrection::new(&found);
    let mut filter = PoseFilter::new(PoseFilterConfig::default());
    let (mut next, mut pair, mut newest) = (0, 0, None);
    let (mut shown, mut shown_original) = (Vec::new(), Vec::new());
    let mut told = None;
    for frame in 0..((END_SECS - 2.0) * 60.0) as u32 {
        let now = f64::from(frame) / 60.0;
        while let Some((t, arrival, pose)) = shoulder.get(next).filter(|(_, arrival, _)| *arrival <= now) {
            let nanos = |secs: f64| (secs * 1e9) as i64;
            let (stamp, arrival) = (nanos(*t), nanos(*arrival));
            filter.take(&BodySample {
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
                drift.take(both.stamp_secs, &both.head, &both.markers);
            }
            pair += 1;
        }
        let followed = filter.at((now * 1e9) as i64);
        // The original tells the headset ten times a second, unfiltered.
        if frame % 6 == 0 {
            told = newest;
        }
        let (Some(followed), Some(told)) = (followed, told) else { continue };
        if now < CALIBRATION_SECS + 1.0 {
            continue;
        }
        let (in_tracking, headset) = (truth.shoulder(now), truth.headset_world_from_tracking(now));
        let truly = headset * in_tracking;
        let corrected = drift.headset_world_from_tracking();
        ours.shown.push(&(corrected * followed.pose), &truly);
        ours.followed.push(&followed.pose, &in_tracking);
        ours.headset.push(&(corrected * in_tracking), &truly);
        ours.seen.push(followed.state == FollowState::Tracked);
        original.shown.push(&(frozen * told), &truly);
        shown.push((now, followed.pose));
        shown_original.push((now, told));
    }
    ours.lag_ms.push(lag_ms(&shown, &truth));
    original.lag_ms.push(lag_ms(&shown_original, &truth));
    Ok(())
}
