//! A path that was found is made quicker and shorter: its corners are moved where the way stays free, and the goal is sought again near its
//! last corner.

use crate::approach_paths::{Aim, ApproachPaths};
use crate::connection::Connection;
use crate::context::{Clearance, PlanningContext};
use crate::failure::Failure;
use crate::problem::Problem;
use crate::route::distance;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

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
/// What corners cost, radians, by the change of the speed of the joint that changes it most, as a share of full speed: at a
/// corner; for each radian that is missing for the change beside it; and where a straight way meets the rest. By least squares
/// over the durations of 400 plans, as `slowness` of the search.
const TURN: f64 = 0.03;
const NO_ROOM: f64 = 0.5;
const TURN_OF_WAY: f64 = 0.1;
/// What another joint goes while one comes to full speed, rad: at 0.5 rad/s and 1 rad/s^2, less what is rounded off.
const ROOM: f64 = 0.23;

/// The part of a path that was searched for, and what it joins.
struct Refining<'a> {
    context: &'a mut PlanningContext,
    problem: &'a Problem<'a>,
    /// From where the start was left straight, if it was.
    before: Option<&'a [f64]>,
    /// From where the search began to where the straight way into the goal begins.
    points: Vec<Vec<f64>>,
    /// The straight way into the goal, behind its first point.
    way: Vec<Vec<f64>>,
    random: ChaCha8Rng,
}

/// Makes `found`, behind a straight way that began at `before`, quicker and shorter.
pub(crate) fn refine(
    context: &mut PlanningContext,
    problem: &Problem,
    paths: &ApproachPaths,
    before: Option<&[f64]>,
    found: &mut Connection,
) -> Result<(), Failure> {
    let mut points = std::mem::take(&mut found.points);
    let way = points.split_off(found.entry + 1);
    let random = ChaCha8Rng::seed_from_u64(problem.request.seed);
    let mut refining = Refining { context, problem, before, points, way, random };
    let refined = refining.refine(paths, found.aim.as_ref());
    found.points = refining.points;
    found.points.append(&mut refining.way);
    refined
}

impl Refining<'_> {
    fn refine(&mut self, paths: &ApproachPaths, aim: Option<&Aim>) -> Result<(), Failure> {
        self.seek_goal(paths, aim)?;
        for _ in 0..ROUNDS {
            self.move_corners()?;
            self.seek_goal(paths, aim)?;
        }
        Ok(())
    }

    /// About how long a path takes, in radians of the joint that is behind, and its length, rad (L2): it is to be quick and short.
    /// Behind it a straight way leads to `goal`, if there is one.
    fn cost(&self, points: &[Vec<f64>], goal: Option<&[f64]>) -> f64 {
        let motion = |a: &[f64], b: &[f64]| farthest(a, b) + distance(a, b);
        let corner = |three: &[Vec<f64>]| {
            let [a, b, c] = three else { return 0.0 };
            let turn = turn(a, b, c);
            TURN * turn + NO_ROOM * (ROOM * turn - farthest(a, b).min(farthest(b, c))).max(0.0)
        };
        let [.., before_last, last] = points else { return 0.0 };
        let motions: f64 = points.windows(2).map(|pair| motion(&pair[0], &pair[1])).sum();
        let corners: f64 = points.windows(3).map(corner).sum();
        let way_out = self.before.map_or(0.0, |before| TURN_OF_WAY * turn(before, &points[0], &points[1]));
        let way_in =
            goal.map_or(0.0, |goal| motion(last, goal) + TURN_OF_WAY * turn(before_last, last, goal));
        motions + corners + way_out + way_in + self.context.limits.squeeze(last)
    }

    fn goal(&self) -> Option<&[f64]> {
        self.way.last().map(Vec::as_slice)
    }

    /// Moves inner points to drawn places that make the path better, and on in the same direction as long as that does.
    fn move_corners(&mut self) -> Result<(), Failure> {
        let corners = self.points.len().saturating_sub(2);
        if corners == 0 {
            return Ok(());
        }
        self.context.set_clearance(Clearance::Transit)?;
        let limits = self.context.limits_with(self.context.attempt.transit);
        let mut least = self.cost(&self.points, self.goal());
        let (mut looks, mut draws) = (0, 0);
        let mut going_well: Option<(usize, Vec<f64>)> = None;
        while looks < LOOKS && draws < DRAWS {
            let (k, step) = going_well.take().unwrap_or_else(|| {
                draws += 1;
                (1 + draws % corners, self.draw(FARTHEST * 0.5_f64.powi((draws % SCALES) as i32)))
            });
            let moved: Vec<f64> = self.points[k].iter().zip(&step).map(|(q, by)| q + by).collect();
            let moved = self.context.limits.clamp(&moved);
            let was = std::mem::replace(&mut self.points[k], moved);
            let cost = self.cost(&self.points, self.goal());
            if cost < least - LEAST_GAIN {
                self.context.go_on()?;
                looks += 1;
                let around = self.points[k - 1..=k + 1].iter().map(Vec::as_slice);
                if self.context.scene.path_is_free(around, &limits)? {
                    least = cost;
                    going_well = Some((k, step));
                    continue;
                }
            }
            self.points[k] = was;
        }
        Ok(())
    }

    /// A change of each joint by at most `farthest`, rad.
    fn draw(&mut self, farthest: f64) -> Vec<f64> {
        let mut unit = || (self.random.next_u64() >> 11) as f64 / (1_u64 << 52) as f64 - 1.0;
        self.points[0].iter().map(|_| farthest * unit()).collect()
    }

    /// Another way into the goal, sought near the last corner, in the place of the present one if that makes the path better.
    fn seek_goal(&mut self, paths: &ApproachPaths, aim: Option<&Aim>) -> Result<(), Failure> {
        let Some(aim) = aim else { return Ok(()) };
        self.context.go_on()?;
        let last = self.points.len() - 1;
        let cost = self.cost(&self.points, self.goal());
        let is_better = |this: &Self, way: &[Vec<f64>]| {
            let mut points = this.points.clone();
            points[last].clone_from(&way[0]);
            this.cost(&points, way[1..].last().map(Vec::as_slice)) < cost - LEAST_GAIN
        };
        let Some(way) = paths.near(self.context, self.problem, aim, &self.points[last - 1]) else {
            return Ok(());
        };
        if !is_better(self, &way) {
            return Ok(());
        }
        let Some(mut way) = paths.confirmed(self.context, self.problem, aim, &way)? else { return Ok(()) };
        self.context.set_clearance(Clearance::Transit)?;
        let limits = self.context.limits_with(self.context.attempt.transit);
        if is_better(self, &way)
            && self.context.scene.motion_is_free(&self.points[last - 1], &way[0], &limits)?
        {
            self.points[last] = way.remove(0);
            self.way = way;
        }
        Ok(())
    }
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
