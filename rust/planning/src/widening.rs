//! The middle of a path with as much room as can be had: what is tight at one end need not be tight all the way.

use crate::blending::BlendedPath;
use crate::context::{FOR_ROUNDING, PlanningContext};
use crate::failure::Failure;
use crate::problem::Problem;
use crate::route::{ENDS, Route, Station};
use crate::smoothing::{Smoother, Timed};
use crate::{SearchLimits, SearchOutcome};
use proact_types::PlanStatus;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::time::{Duration, Instant};

/// Shares of the usual padding that are wanted, one after the other, while the plan has less.
const SHARES: [f64; 5] = [1.0, 0.7, 0.4, 0.2, 0.1];
/// A wider middle begins and ends so near to the ends, metres of the tip's path: between stations, and where corners are cut,
/// nothing is left out.
const NEAR_ENDS: f64 = ENDS - 0.006;
/// Iterations of a search for a wider middle: where there is one, it takes some tens.
const MAX_ITERATIONS: u32 = 2000;
/// Share of the time left that a wider middle may take: a narrow path in time is better than none.
const SHARE_OF_TIME: f64 = 0.5;
/// Draws around one station in the search for room beside a path.
const DRAWS: usize = 24;
/// Distances, along the tip's path, of the stations around which is drawn, metres.
const DRAWN_FROM: [f64; 4] = [0.035, 0.025, 0.015, 0.005];
/// Largest change of the joint vector in a draw, rad (L2), where the tip would hardly move.
const LONGEST_DRAW: f64 = 0.15;

/// `timed`, or a trajectory whose middle has more room: the same route followed more closely, or with its middle planned anew.
pub(crate) fn widened(
    context: &mut PlanningContext,
    problem: &Problem,
    smoother: &Smoother,
    route: &Route,
    mut timed: Timed,
) -> Result<Timed, Failure> {
    let deadline = context.deadline;
    context.deadline = deadline.map(|deadline| {
        let now = Instant::now();
        let left = deadline.saturating_duration_since(now).as_secs_f64();
        now + Duration::from_secs_f64(SHARE_OF_TIME * left)
    });
    let ended = widen(context, problem, smoother, route, &mut timed);
    context.deadline = deadline;
    match ended {
        // Out of time: what was found until then will do.
        Err(failure) if failure.status != PlanStatus::NoPlan => Err(failure),
        _ => Ok(timed),
    }
}

fn widen(
    context: &mut PlanningContext,
    problem: &Problem,
    smoother: &Smoother,
    route: &Route,
    best: &mut Timed,
) -> Result<(), Failure> {
    let padding = context.options.padding;
    let has = |timed: &Timed, wanted: f64| timed.clearance.is_none_or(|clearance| clearance >= wanted);
    if has(best, padding) {
        return Ok(());
    }
    let stations = route.stations(&context.chain);
    let total = stations.last().map_or(0.0, |s| s.travelled);
    let away = |s: &&Station| s.travelled > NEAR_ENDS && total - s.travelled > NEAR_ENDS;
    let middle: Vec<&Station> = stations.iter().filter(away).collect();
    for share in SHARES {
        let (wanted, searched) = (share * padding, FOR_ROUNDING * share * padding);
        if has(best, wanted) {
            break;
        }
        if keeps(context, route, &middle, searched)? {
            let route = Route { points: route.points.clone(), searched, ..*route };
            follow(context, smoother, &route, wanted, best)?;
        } else if let Some(wider) = joined(context, problem, route, &stations, searched)? {
            follow(context, smoother, &wider, wanted, best)?;
        }
    }
    Ok(())
}

/// A trajectory along `route` in the place of `best`, if its middle has more room.
fn follow(
    context: &mut PlanningContext,
    smoother: &Smoother,
    route: &Route,
    wanted: f64,
    best: &mut Timed,
) -> Result<(), Failure> {
    match smoother.timed(context, route, wanted) {
        Ok(other) if other.clearance.is_none() || other.clearance > best.clearance => *best = other,
        // No better.
        Ok(_) => {}
        Err(failure) if failure.status == PlanStatus::Invalid => {}
        Err(failure) => return Err(failure),
    }
    Ok(())
}

/// True if the middle of the route keeps `padding`.
fn keeps(
    context: &mut PlanningContext,
    route: &Route,
    middle: &[&Station],
    padding: f64,
) -> Result<bool, Failure> {
    context.keep(padding)?;
    let limits = context.limits_with(padding);
    // What was searched for was looked at with the attempt's padding.
    let known =
        |s: &Station| route.searched >= padding && s.motion >= route.curved[0] && s.motion < route.curved[1];
    // What is unknown lies before what was searched for, and behind it.
    let mut end = 0;
    for part in middle.chunk_by(|a, b| known(a) == known(b)) {
        context.go_on()?;
        let begin = end;
        end += part.len();
        if known(part[0]) {
            continue;
        }
        // With the motion to the next part.
        let states = middle[begin..middle.len().min(end + 1)].iter().map(|station| station.q.as_slice());
        if !context.scene.path_is_free(states, &limits)? {
            return Ok(false);
        }
    }
    Ok(true)
}

/// A route that keeps `padding` from near the start to near the goal; none if one of the ends has no room beside it, or no
/// way was found.
fn joined(
    context: &mut PlanningContext,
    problem: &Problem,
    route: &Route,
    stations: &[Station],
    padding: f64,
) -> Result<Option<Route>, Failure> {
    let total = stations.last().map_or(0.0, |s| s.travelled);
    let outward: Vec<(f64, &Station)> = stations.iter().map(|s| (s.travelled, s)).collect();
    let inward: Vec<(f64, &Station)> = stations.iter().rev().map(|s| (total - s.travelled, s)).collect();
    let seed = problem.request.seed;
    let Some((leaves, exit)) = room_beside(context, &outward, padding, seed, |s| s.motion < route.curved[0])?
    else {
        return Ok(None);
    };
    let Some((enters, entry)) =
        room_beside(context, &inward, padding, !seed, |s| s.motion >= route.curved[1])?
    else {
        return Ok(None);
    };
    context.keep(padding)?;
    let usual = context.limits_with(padding);
    let max_iterations = usual.max_iterations.min(MAX_ITERATIONS);
    let limits = SearchLimits { max_iterations, max_secs: context.secs_left(), more_searches: 0, ..usual };
    let (planner, parameters) = (context.options.name, &context.options.parameters);
    let goals = [entry];
    let outcome =
        context.scene.search_by(planner, parameters, &exit, &goals, seed, &limits, &context.cancel)?;
    let SearchOutcome::Solved { path, .. } = outcome else {
        context.go_on()?;
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
    add(&route.points[..=leaves.motion]);
    let left = add(std::slice::from_ref(&leaves.q)).min(route.curved[0]);
    add(&path);
    let entered = add(std::slice::from_ref(&enters.q));
    let last = add(&route.points[enters.motion + 1..]);
    let behind = (route.points.len() - 1 - route.curved[1]).min(last - entered);
    let mut joined = BlendedPath::new(points, [left, last - behind]);
    joined.widen(context, padding)?;
    Ok(Some(joined.route(padding)))
}

/// Arm angles with `padding` around them that a short free motion joins with one of `stations`, which lie along a path,
/// each with its distance from the path's end: both within [`NEAR_ENDS`]. On the path itself if there are any, else beside
/// a station that is not `straight`: up off a block that was let go, and down to one, the hand turns nowhere. The farther
/// stations come first.
fn room_beside<'a>(
    context: &mut PlanningContext,
    stations: &[(f64, &'a Station)],
    padding: f64,
    seed: u64,
    straight: impl Fn(&Station) -> bool,
) -> Result<Option<(&'a Station, Vec<f64>)>, Failure> {
    context.keep(padding)?;
    let near: Vec<&(f64, &Station)> = stations.iter().take_while(|(off, _)| *off <= NEAR_ENDS).collect();
    for (_, station) in near.iter().rev() {
        context.go_on()?;
        if context.scene.is_free(&station.q)? {
            return Ok(Some((station, station.q.clone())));
        }
    }
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut unit = || (random.next_u64() >> 11) as f64 / (1_u64 << 52) as f64 - 1.0;
    for from in DRAWN_FROM {
        let Some((off, station)) = near.iter().rev().find(|(off, _)| *off <= from) else { continue };
        if straight(station) {
            continue;
        }
        let room = NEAR_ENDS - off;
        let mut roomy: Vec<Vec<f64>> = Vec::new();
        for draw in 0..DRAWS {
            let direction: Vec<f64> = station.q.iter().map(|_| unit()).collect();
            // Near draws and far ones.
            let share = (draw % 3 + 1) as f64 / 3.0;
            let q = beside(context, &station.q, &direction, share * room);
            if context.limits.contain(&q, 0.0) && context.scene.is_free(&q)? {
                roomy.push(q);
            }
        }
        context.go_on()?;
        context.keep(context.attempt.contact)?;
        let limits = context.limits_of_contact();
        for q in roomy {
            if context.scene.motion_is_free(&station.q, &q, &limits)? {
                return Ok(Some((station, q)));
            }
        }
        context.keep(padding)?;
    }
    Ok(None)
}

/// Arm angles off `q` in a direction of joint space, so far that the tip has gone by 0.9 of `length`, metres.
fn beside(context: &PlanningContext, q: &[f64], direction: &[f64], length: f64) -> Vec<f64> {
    const PROBE: f64 = 1e-3;
    let norm = direction.iter().map(|d| d * d).sum::<f64>().sqrt().max(1e-9);
    let off = |by: f64| -> Vec<f64> { q.iter().zip(direction).map(|(q, d)| q + by * d / norm).collect() };
    let tip = |q: &[f64]| context.chain.forward(q).translation.vector;
    let rate = (tip(&off(PROBE)) - tip(q)).norm() / PROBE;
    off((0.9 * length / rate.max(1e-9)).min(LONGEST_DRAW))
}
