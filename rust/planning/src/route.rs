//! A path on its way to becoming a trajectory, and how much room it keeps where.

use proact_arm::Chain;
use std::ops::Range;

/// So near to the start and to the goal, along the tip's path, things may be closer than the padding, metres: where the
/// arm stands or is sent may leave no more room.
pub(crate) const ENDS: f64 = 0.05;

/// Arm angles from start to goal, straight motions between them.
pub(crate) struct Route {
    pub points: Vec<Vec<f64>>,
    /// First and last point of the part whose corners are rounded: outside lie the straight ways off the start and into the
    /// goal.
    pub curved: [usize; 2],
    /// Free space that was kept in the search for what lies between these two, metres; of a route that was widened, more than
    /// [`ENDS`] away from both ends. A blend was looked at in longer pieces than it has here, and may lie closer by a millimetre.
    pub searched: f64,
}

/// A point on a route, and how far the tip has come there.
pub(crate) struct Station {
    pub q: Vec<f64>,
    /// Length of the tip's path from the start, metres.
    pub travelled: f64,
    /// Index of the route's point at which the motion begins that it lies on.
    pub motion: usize,
}

/// Longest joint motion between two stations, rad (L2): a fingertip moves by half a centimetre at most.
const STATION_STEP: f64 = 0.0075;

impl Route {
    /// Points all along the route, its own among them.
    pub fn stations(&self, chain: &Chain) -> Vec<Station> {
        let mut stations: Vec<Station> = Vec::new();
        let mut tip = None;
        let mut travelled = 0.0;
        let mut add = |q: Vec<f64>, motion: usize| {
            let now = chain.forward(&q).translation.vector;
            travelled += tip.replace(now).map_or(0.0, |before| (now - before).norm());
            stations.push(Station { q, travelled, motion });
        };
        for (motion, pair) in self.points.windows(2).enumerate() {
            let pieces = (distance(&pair[0], &pair[1]) / STATION_STEP).ceil().max(1.0) as usize;
            for k in 0..pieces {
                add(mix(&pair[0], &pair[1], k as f64 / pieces as f64), motion);
            }
        }
        if let Some(last) = self.points.last() {
            add(last.clone(), self.points.len().saturating_sub(2));
        }
        stations
    }
}

/// Of `states` along a path those that are more than [`ENDS`] of the tip's path away from the first and the last.
pub(crate) fn away_from_ends(chain: &Chain, states: &[&[f64]]) -> Range<usize> {
    let first = near_the_first(chain, states.iter().copied());
    let last = states.len() - near_the_first(chain, states.iter().rev().copied());
    first.min(last)..last
}

/// How many of the states, in this order, are within [`ENDS`] of the first.
fn near_the_first<'a>(chain: &Chain, states: impl Iterator<Item = &'a [f64]>) -> usize {
    let (mut before, mut travelled) = (None, 0.0);
    let near = |q: &&[f64]| {
        let now = chain.forward(q).translation.vector;
        travelled += before.replace(now).map_or(0.0, |before| (now - before).norm());
        travelled <= ENDS
    };
    states.take_while(near).count()
}

/// The point a share of the way from `a` to `b`.
pub(crate) fn mix(a: &[f64], b: &[f64], share: f64) -> Vec<f64> {
    a.iter().zip(b).map(|(x, y)| x + share * (y - x)).collect()
}

/// Length of the straight motion from `a` to `b`, rad (L2).
pub(crate) fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum::<f64>().sqrt()
}
