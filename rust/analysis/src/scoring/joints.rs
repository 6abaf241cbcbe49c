//! What the joints of the arm did.

use super::{Instant, Trace};
use proact_types::SimTime;

/// A phase in which no joint went further than this, rad, was done without the method: some ten times what a resting arm wanders.
const USED_RAD: f64 = 0.05;

/// The way of the joint at `place` of the arm, from 0 at the base, rad; steps that a sensor's noise could make do not count.
pub(super) fn path(trace: &Trace, from: SimTime, to: SimTime, place: usize) -> Option<f64> {
    const STEP_RAD: f64 = 0.002;
    let mut angles = trace.between(from, to).iter().filter_map(|instant| instant.joints.get(place).copied());
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
pub(super) fn speed_share(trace: &Trace, from: SimTime, to: SimTime) -> Option<f64> {
    let share = |two: &[Instant]| {
        let secs = two[1].time.millis_since(two[0].time) as f64 * 1e-3;
        let angles = two[0].joints.iter().zip(&two[1].joints).zip(&trace.joints);
        angles.map(|((a, b), range)| (b - a).abs() / secs / range.speed).reduce(f64::max)
    };
    trace.between(from, to).windows(2).filter_map(share).reduce(f64::max)
}

/// How far a joint was outside its limits at most, rad; zero within them, none where they are not known.
pub(super) fn beyond(trace: &Trace, from: SimTime, to: SimTime) -> Option<f64> {
    let beyond = |instant: &Instant| {
        let angles = instant.joints.iter().zip(&trace.joints);
        angles.map(|(angle, range)| (range.lower - angle).max(angle - range.upper).max(0.0)).reduce(f64::max)
    };
    trace.between(from, to).iter().filter_map(beyond).reduce(f64::max)
}

/// Whether the person used the method to move the arm: a joint went further than 0.05 rad from where it was first.
pub(super) fn used(trace: &Trace, from: SimTime, to: SimTime) -> Option<bool> {
    let within = trace.between(from, to);
    let first = within.first()?;
    let far = |joints: &[f64]| first.joints.iter().zip(joints).any(|(a, b)| (a - b).abs() > USED_RAD);
    (!first.joints.is_empty()).then(|| within.iter().any(|instant| far(&instant.joints)))
}

/// Milliseconds from each gesture that is no rest to the first motion that followed it, of those that were followed by one within two seconds
/// and before the next gesture.
pub(super) fn latencies(trace: &Trace, changes: &[(SimTime, bool)]) -> Vec<f64> {
    const LATEST_MS: u64 = 2000;
    const MOVED_RAD: f64 = 0.002;
    let mut found = Vec::new();
    for (place, (at, rests)) in changes.iter().enumerate() {
        let next = changes.get(place + 1).map_or(trace.length, |next| next.0);
        let until = next.min(at.plus_millis(LATEST_MS));
        let (Some(before), false) = (trace.at(*at), *rests) else { continue };
        let moved = |joints: &[f64]| before.joints.iter().zip(joints).any(|(a, b)| (a - b).abs() > MOVED_RAD);
        let first = trace.between(*at, until).iter().find(|instant| moved(&instant.joints));
        found.extend(first.map(|instant| instant.time.millis_since(*at) as f64));
    }
    found
}
