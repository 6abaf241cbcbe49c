//! From the points of a path to a trajectory that touches nothing either.

use crate::PlannerOptions;
use crate::context::{Clearance, PlanningContext};
use crate::failure::Failure;
use crate::route::{Route, away_from_ends};
use crate::timing::{Curve, GRID, MotionLimits, averaged};
use proact_arm::ArmModel;
use proact_types::{JointVector, PlanStatus, Trajectory, TrajectoryPoint};
use std::ops::Range;

/// Smooths and times paths under the limits of one arm.
pub(crate) struct Smoother {
    limits: MotionLimits,
    /// Width of the average that keeps the jerk bounded, s; zero for none.
    window: f64,
}

/// Distances of the control points of the smoothed path that are tried, rad. The curve cuts a corner by at most
/// a third of one: with the last, by less than a millimetre at the fingertips.
const SPACINGS: [f64; 4] = [0.02, 0.01, 0.005, 0.0025];

impl Smoother {
    pub fn new(model: &ArmModel, options: &PlannerOptions) -> Self {
        let arm = || model.arm.iter().map(|&j| &model.joints[j].limits);
        let limits = MotionLimits {
            velocity: arm()
                .map(|l| {
                    if l.velocity > 0.0 { l.velocity.min(options.max_velocity) } else { options.max_velocity }
                })
                .collect(),
            acceleration: arm().map(|_| options.max_acceleration).collect(),
        };
        Self { limits, window: 2.0 * options.max_acceleration / options.max_jerk }
    }

    /// The route as a trajectory. Between its straight ways it was found free with padding; there the smoothed curve, which
    /// cuts corners, is checked again and drawn closer to the route if need be: until it touches nothing, and until its middle
    /// keeps `wanted`, metres, if any of the curves does.
    pub fn timed(&self, context: &mut PlanningContext, route: &Route, wanted: f64) -> Result<Timed, Failure> {
        let Route { points: path, curved: [left, entered], .. } = route;
        let mut widest: Option<Timed> = None;
        for spacing in SPACINGS {
            context.go_on()?;
            let Some(curve) = Curve::along(path, [*left, *entered], spacing) else {
                // Already there: a trajectory of one point says so.
                let qd = proact_types::zeros(path[0].len());
                let point = TrajectoryPoint { time_secs: 0.0, q: proact_types::joints(&path[0]), qd };
                return Ok(Timed { trajectory: Trajectory { points: vec![point] }, clearance: None });
            };
            let [from, to] = curve.kept;
            // The closest curve strays less from the path than the padding is wide.
            let closest = spacing == SPACINGS[SPACINGS.len() - 1];
            if closest && widest.is_some() {
                // It would be run at a quarter of the acceleration.
                break;
            }
            if !closest && !is_free_along(context, &curve, from, to)? {
                continue;
            }
            let (limits, window) = self.motion_limits_of(closest);
            context.go_on()?;
            let mut trajectory = curve.timed(&limits);
            let at = |u: f64| trajectory.points[u as usize * GRID].time_secs;
            let (begin, end) = (at(from) + window, at(to));
            if window > 0.0 {
                context.go_on()?;
                trajectory = averaged(&trajectory, window);
            }
            let room = Room::along(context, &trajectory);
            let roomy = room.keeps(context, context.options.padding)?;
            let free = window == 0.0
                || (closest && !context.is_tight())
                || is_free_between(context, &trajectory, begin, end, roomy.then_some(&room))?;
            if free {
                let clearance = room.clearance(context, roomy)?;
                let found = Timed { trajectory, clearance };
                if clearance.is_none_or(|clearance| clearance >= wanted) {
                    return Ok(found);
                }
                if widest.as_ref().is_none_or(|widest| clearance > widest.clearance) {
                    widest = Some(found);
                }
            }
        }
        widest.ok_or_else(|| Failure::new(PlanStatus::Invalid, "The path could not be smoothed."))
    }

    /// Limits of the trajectory before it is averaged, and the window for that, s. Beside obstacles that leave no
    /// room for what averaging cuts off, a quarter of the acceleration makes that 64 times less.
    fn motion_limits_of(&self, careful: bool) -> (MotionLimits, f64) {
        let mut limits = self.limits.clone();
        if careful && self.window > 0.0 {
            limits.acceleration.iter_mut().for_each(|a| *a /= 4.0);
            return (limits, self.window / 4.0);
        }
        (limits, self.window)
    }
}

/// A trajectory and its clearance, as in the reply to a request.
pub(crate) struct Timed {
    pub trajectory: Trajectory,
    pub clearance: Option<f64>,
}

/// True if nothing touches the smoothed curve between two of its parameters.
fn is_free_along(context: &mut PlanningContext, curve: &Curve, from: f64, to: f64) -> Result<bool, Failure> {
    context.set_clearance(Clearance::Contact)?;
    let states: Vec<JointVector> =
        (0..=(2.0 * (to - from)) as usize).map(|k| curve.position(from + 0.5 * k as f64)).collect();
    Ok(context.scene.states_are_free(states.iter().map(|q| &**q))?)
}

/// True if nothing touches from `begin` to `end`, seconds, at every point of the trajectory but in its middle if that is
/// `known` to have room; with next to no clearance, between the points as well.
fn is_free_between(
    context: &mut PlanningContext,
    trajectory: &Trajectory,
    begin: f64,
    end: f64,
    known: Option<&Room>,
) -> Result<bool, Failure> {
    context.set_clearance(Clearance::Contact)?;
    let limits = context.limits_of_contact();
    let points = &trajectory.points;
    let within = |k: &usize| points[*k].time_secs >= begin && points[*k].time_secs <= end;
    let is_known = |k: &usize| known.is_some_and(|room| room.middle.contains(k));
    let checked: Vec<usize> = (0..points.len()).filter(within).collect();
    for part in checked.chunk_by(|a, b| is_known(a) == is_known(b)) {
        context.go_on()?;
        if is_known(&part[0]) {
            continue;
        }
        // With the neighbours in what is known.
        let first = part[0].saturating_sub(1).max(checked[0]);
        let last = (part[part.len() - 1] + 1).min(checked[checked.len() - 1]);
        let states = points[first..=last].iter().map(|point| &*point.q);
        let free = if context.is_tight() {
            context.scene.path_is_free(states, &limits)?
        } else {
            context.scene.states_are_free(states)?
        };
        if !free {
            return Ok(false);
        }
    }
    Ok(true)
}

/// The middle of a trajectory: its points that are more than [`ENDS`](crate::route::ENDS) away from both ends.
struct Room<'a> {
    points: &'a [TrajectoryPoint],
    middle: Range<usize>,
}

/// A clearance that is less than usual is measured so finely, metres.
const MEASURED_TO: f64 = 2e-5;

impl<'a> Room<'a> {
    fn along(context: &PlanningContext, trajectory: &'a Trajectory) -> Self {
        let points = &trajectory.points;
        let states: Vec<&[f64]> = points.iter().map(|point| &*point.q).collect();
        Self { points, middle: away_from_ends(&context.chain, &states) }
    }

    /// True if the middle has so much free space around it, metres.
    fn keeps(&self, context: &mut PlanningContext, padding: f64) -> Result<bool, Failure> {
        context.keep(padding)?;
        context.go_on()?;
        let states = self.points[self.middle.clone()].iter().map(|point| &*point.q);
        Ok(context.scene.states_are_free(states)?)
    }

    /// The free space around the middle, metres: at most the usual padding, which a `roomy` one keeps. None if there is no
    /// middle.
    fn clearance(&self, context: &mut PlanningContext, roomy: bool) -> Result<Option<f64>, Failure> {
        let (mut kept, mut lost) = (0.0, context.options.padding);
        if self.middle.is_empty() || roomy {
            return Ok((!self.middle.is_empty()).then_some(lost));
        }
        let mut near: Vec<&TrajectoryPoint> = self.points[self.middle.clone()].iter().collect();
        while lost - kept > MEASURED_TO {
            context.go_on()?;
            let padding = 0.5 * (kept + lost);
            context.keep(padding)?;
            let mut hit = Vec::new();
            for &point in &near {
                if !context.scene.is_free(&point.q)? {
                    hit.push(point);
                }
            }
            if hit.is_empty() {
                kept = padding;
            } else {
                // The others are farther away.
                (lost, near) = (padding, hit);
            }
        }
        Ok(Some(kept))
    }
}
