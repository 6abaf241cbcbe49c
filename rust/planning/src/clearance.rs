//! The middle of a path with as much room as can be had: what is tight at one end need not be tight all the way.

use crate::blending::BlendedPath;
use crate::context::{BLENDING_MARGIN, PlanningContext};
use crate::failure::PlanFailure;
use crate::joint_path::{END_MARGIN_M, JointPath, PathSample};
use crate::problem::PlanProblem;
use crate::smoothing::{CheckedTrajectory, Smoother};
use crate::{SearchLimits, SearchOutcome};
use proact_types::PlanStatus;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::time::{Duration, Instant};

/// Shares of the usual padding that are wanted, one after the other, while the plan has less.
const PADDING_FRACTIONS: [f64; 5] = [1.0, 0.7, 0.4, 0.2, 0.1];
/// A wider middle begins and ends so near to the ends, metres of the tip's path: between stations, and where corners are cut,
/// nothing is left out.
const MIDDLE_MARGIN_M: f64 = END_MARGIN_M - 0.006;
/// Iterations of a search for a wider middle: where there is one, it takes some tens.
const MAX_ITERATIONS: u32 = 2000;
/// Share of the time left that a wider middle may take: a narrow path in time is better than none.
const TIME_FRACTION: f64 = 0.5;
/// Draws around one station in the search for room beside a path.
const SAMPLES_PER_STATE: usize = 24;
/// Distances, along the tip's path, of the stations around which is drawn, metres.
const SAMPLE_DISTANCES_M: [f64; 4] = [0.035, 0.025, 0.015, 0.005];
/// Largest change of the joint vector in a draw, rad (L2), where the tip would hardly move.
const MAX_SAMPLE_STEP_RAD: f64 = 0.15;

/// `timed`, or a trajectory whose middle has more room: the same route followed more closely, or with its middle planned anew.
pub(crate) fn increase_clearance(
    context: &mut PlanningContext,
    problem: &PlanProblem,
    smoother: &Smoother,
    route: &JointPath,
    mut timed: CheckedTrajectory,
) -> Result<CheckedTrajectory, PlanFailure> {
    let deadline = context.deadline;
    context.deadline = deadline.map(|deadline| {
        let now = Instant::now();
        let left = deadline.saturating_duration_since(now).as_secs_f64();
        now + Duration::from_secs_f64(TIME_FRACTION * left)
    });
    let ended = increase_clearance_stepwise(context, problem, smoother, route, &mut timed);
    context.deadline = deadline;
    match ended {
        // Out of time: what was found until then will do.
        Err(failure) if failure.status != PlanStatus::NoPlan => Err(failure),
        _ => Ok(timed),
    }
}

fn increase_clearance_stepwise(
    context: &mut PlanningContext,
    problem: &PlanProblem,
    smoother: &Smoother,
    route: &JointPath,
    best: &mut CheckedTrajectory,
) -> Result<(), PlanFailure> {
    let padding = context.options.padding_m;
    let has = |timed: &CheckedTrajectory, wanted: f64| {
        timed.clearance_m.is_none_or(|clearance| clearance >= wanted)
    };
    if has(best, padding) {
        return Ok(());
    }
    let samples = route.samples(&context.chain);
    let total = samples.last().map_or(0.0, |s| s.distance_m);
    let away = |s: &&PathSample| s.distance_m > MIDDLE_MARGIN_M && total - s.distance_m > MIDDLE_MARGIN_M;
    let middle: Vec<&PathSample> = samples.iter().filter(away).collect();
    for share in PADDING_FRACTIONS {
        let (wanted, searched) = (share * padding, BLENDING_MARGIN * share * padding);
        if has(best, wanted) {
            break;
        }
        if middle_keeps_clearance(context, route, &middle, searched)? {
            let route = JointPath { waypoints: route.waypoints.clone(), clearance_m: searched, ..*route };
            retime_if_clearer(context, smoother, &route, wanted, best)?;
        } else if let Some(wider) = replan_middle(context, problem, route, &samples, searched)? {
            retime_if_clearer(context, smoother, &wider, wanted, best)?;
        }
    }
    Ok(())
}

/// A trajectory along `route` in the place of `best`, if its middle has more room.
fn retime_if_clearer(
    context: &mut PlanningContext,
    smoother: &Smoother,
    route: &JointPath,
    wanted: f64,
    best: &mut CheckedTrajectory,
) -> Result<(), PlanFailure> {
    match smoother.smooth(context, route, wanted) {
        Ok(other) if other.clearance_m.is_none() || other.clearance_m > best.clearance_m => *best = other,
        // No better.
        Ok(_) => {}
        Err(failure) if failure.status == PlanStatus::Invalid => {}
        Err(failure) => return Err(failure),
    }
    Ok(())
}

/// True if the middle of the route keeps `padding`.
fn middle_keeps_clearance(
    context: &mut PlanningContext,
    route: &JointPath,
    middle: &[&PathSample],
    padding: f64,
) -> Result<bool, PlanFailure> {
    context.require_clearance(padding)?;
    let limits = context.search_limits_for(padding);
    // What was searched for was looked at with the attempt's padding.
    let known = |s: &PathSample| {
        route.clearance_m >= padding && s.segment >= route.blend_range[0] && s.segment < route.blend_range[1]
    };
    // What is unknown lies before what was searched for, and behind it.
    let mut end = 0;
    for part in middle.chunk_by(|a, b| known(a) == known(b)) {
        context.check_interrupt()?;
        let begin = end;
        end += part.len();
        if known(part[0]) {
            continue;
        }
        // With the motion to the next part.
        let states = middle[begin..middle.len().min(end + 1)].iter().map(|sample| sample.q.as_slice());
        if !context.scene.path_is_free(states, &limits)? {
            return Ok(false);
        }
    }
    Ok(true)
}

/// A route that keeps `padding` from near the start to near the goal; none if one of the ends has no room beside it, or no
/// way was found.
fn replan_middle(
    context: &mut PlanningContext,
    problem: &PlanProblem,
    route: &JointPath,
    samples: &[PathSample],
    padding: f64,
) -> Result<Option<JointPath>, PlanFailure> {
    let total = samples.last().map_or(0.0, |s| s.distance_m);
    let outward: Vec<(f64, &PathSample)> = samples.iter().map(|s| (s.distance_m, s)).collect();
    let inward: Vec<(f64, &PathSample)> = samples.iter().rev().map(|s| (total - s.distance_m, s)).collect();
    let seed = problem.request.seed;
    let Some((leaves, exit)) =
        sample_clear_neighbor(context, &outward, padding, seed, |s| s.segment < route.blend_range[0])?
    else {
        return Ok(None);
    };
    let Some((enters, entry)) =
        sample_clear_neighbor(context, &inward, padding, !seed, |s| s.segment >= route.blend_range[1])?
    else {
        return Ok(None);
    };
    context.require_clearance(padding)?;
    let usual = context.search_limits_for(padding);
    let max_iterations = usual.max_iterations.min(MAX_ITERATIONS);
    let limits = SearchLimits { max_iterations, max_secs: context.secs_left(), more_searches: 0, ..usual };
    let (planner, parameters) = (context.options.name, &context.options.parameters);
    let goals = [entry];
    let outcome =
        context.scene.search_with(planner, parameters, &exit, &goals, seed, &limits, &context.cancel)?;
    let SearchOutcome::Solved { path, .. } = outcome else {
        context.check_interrupt()?;
        return Ok(None);
    };
    let mut points = Vec::new();
    let mut add = |more: &[Vec<f64>]| {
        for q in more {
            // The stations may be points of the route.
            if points.last() != Some(q) {
                points.push(q.clone());
            }
        }
        points.len() - 1
    };
    add(&route.waypoints[..=leaves.segment]);
    let left = add(std::slice::from_ref(&leaves.q)).min(route.blend_range[0]);
    add(&path);
    let entered = add(std::slice::from_ref(&enters.q));
    let last = add(&route.waypoints[enters.segment + 1..]);
    let behind = (route.waypoints.len() - 1 - route.blend_range[1]).min(last - entered);
    let mut joined = BlendedPath::new(points, [left, last - behind]);
    joined.maximize_blends(context, padding)?;
    Ok(Some(joined.to_joint_path(padding)))
}

/// Arm angles with `padding` around them that a short free motion joins with one of `samples`, which lie along a path,
/// each with its distance from the path's end: both within [`MIDDLE_MARGIN_M`]. On the path itself if there are any, else beside
/// a station that is not `straight`: up off a block that was let go, and down to one, the hand turns nowhere. The farther
/// stations come first.
fn sample_clear_neighbor<'a>(
    context: &mut PlanningContext,
    samples: &[(f64, &'a PathSample)],
    padding: f64,
    seed: u64,
    straight: impl Fn(&PathSample) -> bool,
) -> Result<Option<(&'a PathSample, Vec<f64>)>, PlanFailure> {
    context.require_clearance(padding)?;
    let near: Vec<&(f64, &PathSample)> =
        samples.iter().take_while(|(off, _)| *off <= MIDDLE_MARGIN_M).collect();
    for (_, sample) in near.iter().rev() {
        context.check_interrupt()?;
        if context.scene.is_free(&sample.q)? {
            return Ok(Some((sample, sample.q.clone())));
        }
    }
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut unit = || (random.next_u64() >> 11) as f64 / (1_u64 << 52) as f64 - 1.0;
    for from in SAMPLE_DISTANCES_M {
        let Some((off, sample)) = near.iter().rev().find(|(off, _)| *off <= from) else { continue };
        if straight(sample) {
            continue;
        }
        let margin_m = MIDDLE_MARGIN_M - off;
        let mut clear_path: Vec<Vec<f64>> = Vec::new();
        for draw in 0..SAMPLES_PER_STATE {
            let direction: Vec<f64> = sample.q.iter().map(|_| unit()).collect();
            // Near draws and far ones.
            let share = (draw % 3 + 1) as f64 / 3.0;
            let q = offset_in_joint_space(context, &sample.q, &direction, share * margin_m);
            if context.limits.contains(&q, 0.0) && context.scene.is_free(&q)? {
                clear_path.push(q);
            }
        }
        context.check_interrupt()?;
        context.require_clearance(context.attempt.contact_clearance_m)?;
        let limits = context.contact_search_limits();
        for q in clear_path {
            if context.scene.motion_is_free(&sample.q, &q, &limits)? {
                return Ok(Some((sample, q)));
            }
        }
        context.require_clearance(padding)?;
    }
    Ok(None)
}

/// Arm angles off `q` in a direction of joint space, so far that the tip has gone by 0.9 of `length`, metres.
fn offset_in_joint_space(context: &PlanningContext, q: &[f64], direction: &[f64], length: f64) -> Vec<f64> {
    const PROBE: f64 = 1e-3;
    let norm = direction.iter().map(|d| d * d).sum::<f64>().sqrt().max(1e-9);
    let off = |by: f64| -> Vec<f64> { q.iter().zip(direction).map(|(q, d)| q + by * d / norm).collect() };
    let tip = |q: &[f64]| context.chain.forward(q).translation.vector;
    let rate = (tip(&off(PROBE)) - tip(q)).norm() / PROBE;
    off((0.9 * length / rate.max(1e-9)).min(MAX_SAMPLE_STEP_RAD))
}
