//! What the joints of the arm did.

use super::{Trace, TracePoint};
use proact_types::SimTime;

/// A phase in which no joint went further than this, rad, was done without the method: some ten times what a resting arm wanders.
const METHOD_USED_RAD: f64 = 0.05;

/// The way of the joint at `joint_index` of the arm, from 0 at the base, rad; steps that a sensor's noise could make do not count.
pub(super) fn joint_path_rad(trace: &Trace, from: SimTime, to: SimTime, joint_index: usize) -> Option<f64> {
    const STEP_RAD: f64 = 0.002;
    let mut angles = trace
        .between(from, to)
        .iter()
        .filter_map(|instant| instant.joint_positions.get(joint_index).copied());
    let mut last = angles.next()?;
    let mut path = 0.0;
    for angle in angles {
        let step = (angle - last).abs();
        if step >= STEP_RAD {
            path += step;
            last = angle;
        }
    }
    Some(path)
}

/// The highest speed of a joint as a share of its limit, between two instants; none where the limits are not known.
pub(super) fn max_speed_ratio(trace: &Trace, from: SimTime, to: SimTime) -> Option<f64> {
    let share = |two: &[TracePoint]| {
        let secs = two[1].time.millis_since(two[0].time) as f64 * 1e-3;
        let angles = two[0].joint_positions.iter().zip(&two[1].joint_positions).zip(&trace.joints);
        angles.map(|((a, b), range)| (b - a).abs() / secs / range.max_speed_rad_per_s).reduce(f64::max)
    };
    trace.between(from, to).windows(2).filter_map(share).reduce(f64::max)
}

/// How far a joint was outside its limits at most, rad; zero within them, none where they are not known.
pub(super) fn max_limit_excess_rad(trace: &Trace, from: SimTime, to: SimTime) -> Option<f64> {
    let beyond = |instant: &TracePoint| {
        let angles = instant.joint_positions.iter().zip(&trace.joints);
        angles
            .map(|(angle, range)| (range.lower_rad - angle).max(angle - range.upper_rad).max(0.0))
            .reduce(f64::max)
    };
    trace.between(from, to).iter().filter_map(beyond).reduce(f64::max)
}

/// Whether the person used the method to move the arm: a joint went further than 0.05 rad from where it was first.
pub(super) fn is_method_used(trace: &Trace, from: SimTime, to: SimTime) -> Option<bool> {
    let within = trace.between(from, to);
    let first = within.first()?;
    let far = |joints: &[f64]| {
        first.joint_positions.iter().zip(joints).any(|(a, b)| (a - b).abs() > METHOD_USED_RAD)
    };
    (!first.joint_positions.is_empty()).then(|| within.iter().any(|instant| far(&instant.joint_positions)))
}

/// Milliseconds from each gesture that is no rest to the first motion that followed it, of those that were followed by one within two seconds
/// and before the next gesture.
pub(super) fn gesture_to_motion_latencies_ms(trace: &Trace, changes: &[(SimTime, bool)]) -> Vec<f64> {
    const MAX_LATENCY_MS: u64 = 2000;
    const MOTION_THRESHOLD_RAD: f64 = 0.002;
    let mut found = Vec::new();
    for (joint_index, (at, rests)) in changes.iter().enumerate() {
        let next = changes.get(joint_index + 1).map_or(trace.duration, |next| next.0);
        let until = next.min(at.plus_millis(MAX_LATENCY_MS));
        let (Some(before), false) = (trace.at(*at), *rests) else { continue };
        let moved = |joints: &[f64]| {
            before.joint_positions.iter().zip(joints).any(|(a, b)| (a - b).abs() > MOTION_THRESHOLD_RAD)
        };
        let first = trace.between(*at, until).iter().find(|instant| moved(&instant.joint_positions));
        found.extend(first.map(|instant| instant.time.millis_since(*at) as f64));
    }
    found
}
