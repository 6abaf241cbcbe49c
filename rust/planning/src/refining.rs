//! A path that was found is made quicker and shorter: its corners are moved where the curve around them stays free, and the goal is
//! sought again near its last corner.

use crate::approach_paths::{Aim, ApproachPaths};
use crate::blending::BlendedPath;
use crate::context::{Clearance, PlanningContext};
use crate::failure::Failure;
use crate::problem::Problem;
use crate::route::distance;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::ops::RangeInclusive;

/// How often the corners are moved, and then the goal sought again.
const ROUNDS: usize = 2;
/// Places of a corner that promise a better path and are looked at in each round.
const LOOKS: usize = 20;
/// Draws in each round, most of which promise nothing.
const DRAWS: usize = 400;
/// Farthest that a draw moves each joint at a corner, rad; others move them by a half of it, a quarter and so on, down to the
/// last of so many.
const FARTHEST: f64 = 0.6;
const SCALES: usize = 5;
/// A path must be so much better to be looked at.
const LEAST_GAIN: f64 = 0.005;
/// Shares of the room for the blend into a new way to the goal that are tried; the last is a corner.
const SHARES_OF_WAY: [f64; 3] = [1.0, 0.5, 0.0];
/// What corners cost, radians, by the change of the speed of the joint that changes it most, as a share of full speed: at a
/// corner; for each radian that its blend lacks for the change; and where a straight way meets the rest.
const TURN: f64 = 0.03;
const NO_ROOM: f64 = 0.8;
const TURN_OF_WAY: f64 = 0.1;
/// What another joint goes while one comes to full speed, rad: at 0.5 rad/s and 1 rad/s^2, and some more for the blend, along
/// which the change is not even.
const ROOM: f64 = 0.3;

/// A path that is being refined.
struct Refining<'a> {
    context: &'a mut PlanningContext,
    problem: &'a Problem<'a>,
    path: &'a mut BlendedPath,
    random: ChaCha8Rng,
}

/// Makes `path`, whose end was sought for `aim`, quicker and shorter.
pub(crate) fn refine(
    context: &mut PlanningContext,
    problem: &Problem,
    paths: &ApproachPaths,
    aim: Option<&Aim>,
    path: &mut BlendedPath,
) -> Result<(), Failure> {
    let [left, entered] = path.ways;
    if entered <= left {
        return Ok(());
    }
    let random = ChaCha8Rng::seed_from_u64(problem.request.seed);
    let mut refining = Refining { context, problem, path, random };
    refining.seek_goal(paths, aim)?;
    for _ in 0..ROUNDS {
        refining.move_corners()?;
        refining.seek_goal(paths, aim)?;
    }
    Ok(())
}

/// What was moved, for putting it back.
struct Moved {
    point: Vec<f64>,
    /// Of the point before it, its own and of the one behind it.
    shares: [f64; 3],
}

impl Refining<'_> {
    /// Moves corners to drawn places that make the path better, and on in the same direction, each time twice as far, as long as
    /// that does.
    fn move_corners(&mut self) -> Result<(), Failure> {
        let [left, entered] = self.path.ways;
        let corners = entered - left - 1;
        if corners == 0 {
            return Ok(());
        }
        self.context.set_clearance(Clearance::Transit)?;
        let limits = self.context.limits_with(self.context.attempt.transit);
        let (mut looks, mut draws) = (0, 0);
        let mut going_well: Option<(usize, Vec<f64>)> = None;
        while looks < LOOKS && draws < DRAWS {
            let (k, step) = going_well.take().unwrap_or_else(|| {
                draws += 1;
                let farthest = FARTHEST * 0.5_f64.powi((draws % SCALES) as i32);
                (left + 1 + draws % corners, self.draw(farthest))
            });
            let before = self.cost(k - 1..=k + 1);
            let moved = self.move_corner(k, &step);
            if self.cost(k - 1..=k + 1) < before - LEAST_GAIN {
                self.context.go_on()?;
                looks += 1;
                let curve = self.path.curve_around(k);
                if self.context.scene.path_is_free(curve.iter().map(Vec::as_slice), &limits)? {
                    going_well = Some((k, step.iter().map(|by| 2.0 * by).collect()));
                    continue;
                }
            }
            self.path.points[k] = moved.point;
            self.path.shares[k - 1..=k + 1].copy_from_slice(&moved.shares);
        }
        Ok(())
    }

    /// Moves the corner `k` by `step`, with the widest blends there and at the corners beside it.
    fn move_corner(&mut self, k: usize, step: &[f64]) -> Moved {
        let BlendedPath { points, ways: [left, entered], shares } = &mut *self.path;
        let place: Vec<f64> = points[k].iter().zip(step).map(|(q, by)| q + by).collect();
        let point = std::mem::replace(&mut points[k], self.context.limits.clamp(&place));
        let moved = Moved { point, shares: [shares[k - 1], shares[k], shares[k + 1]] };
        shares[(k - 1).max(*left + 1)..=(k + 1).min(*entered - 1)].fill(1.0);
        moved
    }

    /// A change of each joint by at most `farthest`, rad.
    fn draw(&mut self, farthest: f64) -> Vec<f64> {
        let mut unit = || (self.random.next_u64() >> 11) as f64 / (1_u64 << 52) as f64 - 1.0;
        self.path.points[0].iter().map(|_| farthest * unit()).collect()
    }

    /// Another way into the goal, sought near the last corner, in the place of the present one if that makes the path better.
    fn seek_goal(&mut self, paths: &ApproachPaths, aim: Option<&Aim>) -> Result<(), Failure> {
        let Some(aim) = aim else { return Ok(()) };
        self.context.go_on()?;
        let [left, entered] = self.path.ways;
        let most = self.cost(left..=entered) - LEAST_GAIN;
        let promises = |this: &Self, path: &BlendedPath| cost(this.context, path, left..=entered) < most;
        let Some(way) = paths.near(self.context, self.problem, aim, &self.path.points[entered - 1]) else {
            return Ok(());
        };
        if !promises(self, &self.path.with_way_in(way.clone())) {
            return Ok(());
        }
        let Some(way) = paths.confirmed(self.context, self.problem, aim, &way)? else { return Ok(()) };
        let mut other = self.path.with_way_in(way);
        if !promises(self, &other) {
            return Ok(());
        }
        self.context.set_clearance(Clearance::Transit)?;
        let limits = self.context.limits_with(self.context.attempt.transit);
        for share in SHARES_OF_WAY {
            other.shares[entered] = share;
            let curve = other.curve_around(entered);
            if self.context.scene.path_is_free(curve.iter().map(Vec::as_slice), &limits)? {
                *self.path = other;
                break;
            }
        }
        Ok(())
    }

    fn cost(&self, part: RangeInclusive<usize>) -> f64 {
        cost(self.context, self.path, part)
    }
}

/// About how long a part of a path takes, in radians of the joint that is behind, and its length, rad (L2): it is to be quick and
/// short. Of its points the corners count, and the motions to the next ones.
fn cost(context: &PlanningContext, path: &BlendedPath, part: RangeInclusive<usize>) -> f64 {
    let BlendedPath { points, ways: [left, entered], shares } = path;
    let motion = |a: &[f64], b: &[f64]| farthest(a, b) + distance(a, b);
    let mut cost = 0.0;
    for k in part {
        let here = &points[k];
        if k < *entered {
            cost += motion(here, &points[k + 1]);
        }
        if k > *left && k < *entered {
            let (before, after) = (&points[k - 1], &points[k + 1]);
            let turn = turn(before, here, after);
            let room = shares[k] * farthest(before, here).min(farthest(here, after));
            cost += TURN * turn + NO_ROOM * (ROOM * turn - room).max(0.0);
        } else if k == *left && k > 0 {
            cost += TURN_OF_WAY * turn(&points[0], here, &points[k + 1]);
        } else if k == *entered {
            cost += context.limits.squeeze(here);
            let goal = &points[points.len() - 1];
            if k + 1 < points.len() {
                cost += motion(here, goal) + TURN_OF_WAY * turn(&points[k - 1], here, goal);
            }
        }
    }
    cost
}

/// The farthest way of any joint from `a` to `b`, rad.
fn farthest(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Change of the speed of the joint that changes it most between the motions from `a` to `b` and from there to `c`, as a share of
/// full speed.
fn turn(a: &[f64], b: &[f64], c: &[f64]) -> f64 {
    let (before, after) = (farthest(a, b), farthest(b, c));
    if before == 0.0 || after == 0.0 {
        return 0.0;
    }
    let change = |((a, b), c): ((&f64, &f64), &f64)| ((b - a) / before - (c - b) / after).abs();
    a.iter().zip(b).zip(c).map(change).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_joint_that_turns_back_changes_its_speed_twice_and_one_that_goes_on_not_at_all() {
        assert_eq!(turn(&[0.0, 0.0], &[1.0, 0.0], &[0.5, 0.0]), 2.0);
        assert_eq!(turn(&[0.0, 0.0], &[1.0, 0.5], &[3.0, 1.5]), 0.0);
        // The other joint comes to full speed while the first comes to rest.
        assert_eq!(turn(&[0.0, 0.0], &[1.0, 0.0], &[1.0, 1.0]), 1.0);
        assert_eq!(turn(&[0.0, 0.0], &[0.0, 0.0], &[1.0, 1.0]), 0.0);
    }
}
