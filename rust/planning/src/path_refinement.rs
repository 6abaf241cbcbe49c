//! A path that was found is made quicker and shorter: its corners are moved where the curve around them stays free, and the goal is
//! sought again near its last corner.

use crate::approach_paths::{ApproachGoal, ApproachPlanner};
use crate::blending::BlendedPath;
use crate::context::{ClearanceMode, PlanningContext};
use crate::failure::PlanFailure;
use crate::joint_path::distance;
use crate::problem::PlanProblem;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::ops::RangeInclusive;

/// How often the corners are moved, and then the goal sought again.
const ROUNDS: usize = 2;
/// Places of a corner that promise a better path and are looked at in each round.
const MAX_CHECKED_MOVES: usize = 20;
/// Draws in each round, most of which promise nothing.
const MAX_SAMPLED_MOVES: usize = 400;
/// Farthest that a draw moves each joint at a corner, rad; others move them by a half of it, a quarter and so on, down to the
/// last of so many.
const MAX_CORNER_STEP_RAD: f64 = 0.6;
const STEP_SCALES: usize = 5;
/// A path must be so much better to be looked at.
const MIN_GAIN_RAD: f64 = 0.005;
/// Shares of the room for the blend into a new way to the goal that are tried; the last is a corner.
const APPROACH_BLEND_FRACTIONS: [f64; 3] = [1.0, 0.5, 0.0];
/// What corners cost, radians, by the change of the speed of the joint that changes it most, as a share of full speed: at a
/// corner; for each radian that its blend lacks for the change; and where a straight way meets the rest.
const CORNER_COST_RAD: f64 = 0.03;
const SHORT_BLEND_COST: f64 = 0.8;
const STRAIGHT_CORNER_COST_RAD: f64 = 0.1;
/// What another joint goes while one comes to full speed, rad: at 0.5 rad/s and 1 rad/s^2, and some more for the blend, along
/// which the change is not even.
const SPEED_CHANGE_LENGTH_RAD: f64 = 0.3;

/// A path that is being refined.
struct PathRefiner<'a> {
    context: &'a mut PlanningContext,
    problem: &'a PlanProblem<'a>,
    path: &'a mut BlendedPath,
    random: ChaCha8Rng,
}

/// Makes `path`, whose end was sought for `approach_goal`, quicker and shorter.
pub(crate) fn refine(
    context: &mut PlanningContext,
    problem: &PlanProblem,
    paths: &ApproachPlanner,
    approach_goal: Option<&ApproachGoal>,
    path: &mut BlendedPath,
) -> Result<(), PlanFailure> {
    let [left, entered] = path.transit_range;
    if entered <= left {
        return Ok(());
    }
    let random = ChaCha8Rng::seed_from_u64(problem.request.seed);
    let mut refining = PathRefiner { context, problem, path, random };
    refining.improve_approach(paths, approach_goal)?;
    for _ in 0..ROUNDS {
        refining.move_corners()?;
        refining.improve_approach(paths, approach_goal)?;
    }
    Ok(())
}

/// What was moved, for putting it back.
struct CornerUndo {
    waypoint: Vec<f64>,
    /// Of the point before it, its own and of the one behind it.
    blend_fractions: [f64; 3],
}

impl PathRefiner<'_> {
    /// Moves corners to drawn places that make the path better, and on in the same direction, each time twice as far, as long as
    /// that does.
    fn move_corners(&mut self) -> Result<(), PlanFailure> {
        let [left, entered] = self.path.transit_range;
        let corners = entered - left - 1;
        if corners == 0 {
            return Ok(());
        }
        self.context.set_clearance(ClearanceMode::Transit)?;
        let limits = self.context.search_limits_for(self.context.attempt.transit_clearance_m);
        let (mut checked_moves, mut draws) = (0, 0);
        let mut going_well: Option<(usize, Vec<f64>)> = None;
        while checked_moves < MAX_CHECKED_MOVES && draws < MAX_SAMPLED_MOVES {
            let (k, step) = going_well.take().unwrap_or_else(|| {
                draws += 1;
                let farthest = MAX_CORNER_STEP_RAD * 0.5_f64.powi((draws % STEP_SCALES) as i32);
                (left + 1 + draws % corners, self.sample_step(farthest))
            });
            let before = self.partial_cost(k - 1..=k + 1);
            let moved = self.move_corner(k, &step);
            if self.partial_cost(k - 1..=k + 1) < before - MIN_GAIN_RAD {
                self.context.check_interrupt()?;
                checked_moves += 1;
                let curve = self.path.curve_around(k);
                if self.context.scene.path_is_free(curve.iter().map(Vec::as_slice), &limits)? {
                    going_well = Some((k, step.iter().map(|by| 2.0 * by).collect()));
                    continue;
                }
            }
            self.path.waypoints[k] = moved.waypoint;
            self.path.blend_fractions[k - 1..=k + 1].copy_from_slice(&moved.blend_fractions);
        }
        Ok(())
    }

    /// Moves the corner `k` by `step`, with the widest blends there and at the corners beside it.
    fn move_corner(&mut self, k: usize, step: &[f64]) -> CornerUndo {
        let BlendedPath { waypoints: points, transit_range: [left, entered], blend_fractions: shares } =
            &mut *self.path;
        let moved_point: Vec<f64> = points[k].iter().zip(step).map(|(q, by)| q + by).collect();
        let point = std::mem::replace(&mut points[k], self.context.limits.clamp(&moved_point));
        let moved =
            CornerUndo { waypoint: point, blend_fractions: [shares[k - 1], shares[k], shares[k + 1]] };
        shares[(k - 1).max(*left + 1)..=(k + 1).min(*entered - 1)].fill(1.0);
        moved
    }

    /// A change of each joint by at most `farthest`, rad.
    fn sample_step(&mut self, farthest: f64) -> Vec<f64> {
        let mut unit = || (self.random.next_u64() >> 11) as f64 / (1_u64 << 52) as f64 - 1.0;
        self.path.waypoints[0].iter().map(|_| farthest * unit()).collect()
    }

    /// Another way into the goal, sought near the last corner, in the place of the present one if that makes the path better.
    fn improve_approach(
        &mut self,
        paths: &ApproachPlanner,
        approach_goal: Option<&ApproachGoal>,
    ) -> Result<(), PlanFailure> {
        let Some(approach_goal) = approach_goal else { return Ok(()) };
        self.context.check_interrupt()?;
        let [left, entered] = self.path.transit_range;
        let max_cost = self.partial_cost(left..=entered) - MIN_GAIN_RAD;
        let promises =
            |this: &Self, path: &BlendedPath| path_cost(this.context, path, left..=entered) < max_cost;
        let Some(approach) =
            paths.approach_near(self.context, self.problem, approach_goal, &self.path.waypoints[entered - 1])
        else {
            return Ok(());
        };
        if !promises(self, &self.path.with_approach(approach.clone())) {
            return Ok(());
        }
        let Some(approach) = paths.verified_approach(self.context, self.problem, approach_goal, &approach)?
        else {
            return Ok(());
        };
        let mut other = self.path.with_approach(approach);
        if !promises(self, &other) {
            return Ok(());
        }
        self.context.set_clearance(ClearanceMode::Transit)?;
        let limits = self.context.search_limits_for(self.context.attempt.transit_clearance_m);
        for share in APPROACH_BLEND_FRACTIONS {
            other.blend_fractions[entered] = share;
            let curve = other.curve_around(entered);
            if self.context.scene.path_is_free(curve.iter().map(Vec::as_slice), &limits)? {
                *self.path = other;
                break;
            }
        }
        Ok(())
    }

    fn partial_cost(&self, part: RangeInclusive<usize>) -> f64 {
        path_cost(self.context, self.path, part)
    }
}

/// About how long a part of a path takes, in radians of the joint that is behind, and its length, rad (L2): it is to be quick and
/// short. Of its points the corners count, and the motions to the next ones.
fn path_cost(context: &PlanningContext, path: &BlendedPath, part: RangeInclusive<usize>) -> f64 {
    let BlendedPath { waypoints: points, transit_range: [left, entered], blend_fractions: shares } = path;
    let motion = |a: &[f64], b: &[f64]| max_joint_distance(a, b) + distance(a, b);
    let mut cost = 0.0;
    for k in part {
        let here = &points[k];
        if k < *entered {
            cost += motion(here, &points[k + 1]);
        }
        if k > *left && k < *entered {
            let (before, after) = (&points[k - 1], &points[k + 1]);
            let turn = speed_change(before, here, after);
            let max_step = shares[k] * max_joint_distance(before, here).min(max_joint_distance(here, after));
            cost += CORNER_COST_RAD * turn
                + SHORT_BLEND_COST * (SPEED_CHANGE_LENGTH_RAD * turn - max_step).max(0.0);
        } else if k == *left && k > 0 {
            cost += STRAIGHT_CORNER_COST_RAD * speed_change(&points[0], here, &points[k + 1]);
        } else if k == *entered {
            cost += context.limits.limit_cost(here);
            let goal = &points[points.len() - 1];
            if k + 1 < points.len() {
                cost +=
                    motion(here, goal) + STRAIGHT_CORNER_COST_RAD * speed_change(&points[k - 1], here, goal);
            }
        }
    }
    cost
}

/// The farthest way of any joint from `a` to `b`, rad.
fn max_joint_distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Change of the speed of the joint that changes it most between the motions from `a` to `b` and from there to `c`, as a share of
/// full speed.
fn speed_change(a: &[f64], b: &[f64], c: &[f64]) -> f64 {
    let (before, after) = (max_joint_distance(a, b), max_joint_distance(b, c));
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
        assert_eq!(speed_change(&[0.0, 0.0], &[1.0, 0.0], &[0.5, 0.0]), 2.0);
        assert_eq!(speed_change(&[0.0, 0.0], &[1.0, 0.5], &[3.0, 1.5]), 0.0);
        // The other joint comes to full speed while the first comes to rest.
        assert_eq!(speed_change(&[0.0, 0.0], &[1.0, 0.0], &[1.0, 1.0]), 1.0);
        assert_eq!(speed_change(&[0.0, 0.0], &[0.0, 0.0], &[1.0, 1.0]), 0.0);
    }
}
