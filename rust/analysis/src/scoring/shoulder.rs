//! What the body did instead of the arm.

use super::{Trace, TracePoint, motion::PathMetrics};
use proact_types::{Point, Pose, SimTime, Vector};

/// From one pose of the paper's sums to the next, milliseconds.
const PAPER_STEP_MS: u64 = 100;

fn shoulder(instant: &TracePoint) -> Point {
    Point::from(instant.world_from_base.translation.vector)
}

/// Poses of the base at 10 Hz from the first instant on, and the last one.
fn at_10_hz(trace: &Trace, from: SimTime, to: SimTime) -> Vec<&Pose> {
    let steps = (from.0..=to.0).step_by(PAPER_STEP_MS as usize);
    steps.filter_map(|time| trace.at(SimTime(time))).map(|instant| &instant.world_from_base).collect()
}

/// Sum of the shoulder's steps at 10 Hz, metres.
pub(super) fn translation_sum10(trace: &Trace, from: SimTime, to: SimTime) -> Option<f64> {
    let poses = at_10_hz(trace, from, to);
    let steps = poses.windows(2).map(|two| (two[1].translation.vector - two[0].translation.vector).norm());
    (poses.len() > 1).then(|| steps.sum())
}

/// Sum of the shoulder's turns at 10 Hz, degrees.
pub(super) fn rotation_sum10(trace: &Trace, from: SimTime, to: SimTime) -> Option<f64> {
    let poses = at_10_hz(trace, from, to);
    let turns = poses.windows(2).map(|two| two[0].rotation.angle_to(&two[1].rotation).to_degrees());
    (poses.len() > 1).then(|| turns.sum())
}

/// Length of the shoulder's way, low-passed, metres.
pub(super) fn path(trace: &Trace, from: SimTime, to: SimTime) -> Option<f64> {
    PathMetrics::of(trace.between(from, to), shoulder).map(|metrics| metrics.length())
}

/// Highest speed of the shoulder, low-passed, metres a second.
pub(super) fn peak_speed(trace: &Trace, from: SimTime, to: SimTime) -> Option<f64> {
    PathMetrics::of(trace.between(from, to), shoulder)?.peak_speed_and_time().map(|peak| peak[0])
}

/// Furthest of the shoulder from where it was first, low-passed, metres.
pub(super) fn max_displacement_m(trace: &Trace, from: SimTime, to: SimTime) -> Option<f64> {
    PathMetrics::of(trace.between(from, to), shoulder).map(|metrics| metrics.max_displacement_m())
}

/// Furthest turn of the shoulder from how it was first, degrees.
pub(super) fn max_turn_deg(trace: &Trace, from: SimTime, to: SimTime) -> Option<f64> {
    let within = trace.between(from, to);
    let first = within.first()?.world_from_base.rotation;
    let turns = within.iter().map(|instant| first.angle_to(&instant.world_from_base.rotation).to_degrees());
    turns.reduce(f64::max)
}

/// Furthest of the trunk's body from where it was first, metres; none where it was not tracked.
pub(super) fn max_trunk_displacement_m(trace: &Trace, from: SimTime, to: SimTime) -> Option<f64> {
    let within = trace.trunk_between(from, to);
    let first = within.first()?.1.translation.vector;
    within.iter().map(|(_, pose)| (pose.translation.vector - first).norm()).reduce(f64::max)
}

/// Furthest turn of the trunk from how it was first, degrees; none where it was not tracked.
pub(super) fn max_trunk_turn_deg(trace: &Trace, from: SimTime, to: SimTime) -> Option<f64> {
    let within = trace.trunk_between(from, to);
    let first = within.first()?.1.rotation;
    within.iter().map(|(_, pose)| first.angle_to(&pose.rotation).to_degrees()).reduce(f64::max)
}

/// Share of the hand's way from where it was first to where it was last that the base brought it, the rest is the joints'; none where
/// the hand went less than a centimetre.
///
/// In each step the base's part is where the hand would have gone had no joint moved. The parts are added up along the straight line;
/// they may be below 0 or above 1 where base and joints worked against each other.
pub(super) fn base_contribution(trace: &Trace, from: SimTime, to: SimTime) -> Option<f64> {
    const MIN_REACH_M: f64 = 0.01;
    let within = trace.between(from, to);
    let line: Vector = within.last()?.grasp_center - within.first()?.grasp_center;
    let distance = line.norm();
    if distance < MIN_REACH_M {
        return None;
    }
    let by_base = within.windows(2).map(|two| {
        let carried = two[1].world_from_base * (two[0].world_from_base.inverse() * two[0].grasp_center);
        (carried - two[0].grasp_center).dot(&line)
    });
    Some(by_base.sum::<f64>() / (distance * distance))
}
