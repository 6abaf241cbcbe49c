//! A path on its way to becoming a trajectory, and how much room it keeps where.

use proact_arm::Chain;
use std::ops::Range;

/// So near to the start and to the goal, along the tip's path, things may be closer than the padding, metres: where the
/// arm stands or is sent may leave no more room.
pub(crate) const END_MARGIN_M: f64 = 0.05;

/// Arm angles from start to goal, straight motions between them.
pub(crate) struct JointPath {
    pub waypoints: Vec<Vec<f64>>,
    /// First and last point of the part whose corners are rounded: outside lie the straight ways off the start and into the
    /// goal.
    pub blend_range: [usize; 2],
    /// Free space that was kept in the search for what lies between these two, metres; of a route that was widened, more than
    /// [`END_MARGIN_M`] away from both ends. A blend was looked at in longer pieces than it has here, and may lie closer by a millimetre.
    pub clearance_m: f64,
}

/// A point on a route, and how far the tip has come there.
pub(crate) struct PathSample {
    pub q: Vec<f64>,
    /// Length of the tip's path from the start, metres.
    pub distance_m: f64,
    /// Index of the route's point at which the motion begins that it lies on.
    pub segment: usize,
}

/// Longest joint motion between two stations, rad (L2): a fingertip moves by half a centimetre at most.
const SAMPLE_STEP_RAD: f64 = 0.0075;

impl JointPath {
    /// Points all along the route, its own among them.
    pub fn samples(&self, chain: &Chain) -> Vec<PathSample> {
        let mut path_samples: Vec<PathSample> = Vec::new();
        let mut tip = None;
        let mut traveled = 0.0;
        let mut add = |q: Vec<f64>, motion: usize| {
            let now = chain.forward(&q).translation.vector;
            traveled += tip.replace(now).map_or(0.0, |before| (now - before).norm());
            path_samples.push(PathSample { q, distance_m: traveled, segment: motion });
        };
        for (motion, pair) in self.waypoints.windows(2).enumerate() {
            let pieces = (distance(&pair[0], &pair[1]) / SAMPLE_STEP_RAD).ceil().max(1.0) as usize;
            for k in 0..pieces {
                add(interpolate(&pair[0], &pair[1], k as f64 / pieces as f64), motion);
            }
        }
        if let Some(last) = self.waypoints.last() {
            add(last.clone(), self.waypoints.len().saturating_sub(2));
        }
        path_samples
    }
}

/// Of `states` along a path those that are more than [`END_MARGIN_M`] of the tip's path away from the first and the last.
pub(crate) fn middle_range(chain: &Chain, states: &[&[f64]]) -> Range<usize> {
    let first = count_near_start(chain, states.iter().copied());
    let last = states.len() - count_near_start(chain, states.iter().rev().copied());
    first.min(last)..last
}

/// How many of the states, in this order, are within [`END_MARGIN_M`] of the first.
fn count_near_start<'a>(chain: &Chain, states: impl Iterator<Item = &'a [f64]>) -> usize {
    let (mut before, mut traveled) = (None, 0.0);
    let near = |q: &&[f64]| {
        let now = chain.forward(q).translation.vector;
        traveled += before.replace(now).map_or(0.0, |before| (now - before).norm());
        traveled <= END_MARGIN_M
    };
    states.take_while(near).count()
}

/// The point a share of the way from `a` to `b`.
pub(crate) fn interpolate(a: &[f64], b: &[f64], share: f64) -> Vec<f64> {
    a.iter().zip(b).map(|(x, y)| x + share * (y - x)).collect()
}

/// Length of the straight motion from `a` to `b`, rad (L2).
pub(crate) fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum::<f64>().sqrt()
}
