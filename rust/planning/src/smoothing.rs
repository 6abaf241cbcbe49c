//! From the points of a path to a trajectory that touches nothing either.

use crate::PlannerOptions;
use crate::context::{ClearanceMode, PlanningContext};
use crate::failure::PlanFailure;
use crate::joint_path::{JointPath, middle_range};
use crate::timing::{GRID_POINTS_PER_SPAN, JointSpline, MotionLimits, moving_average};
use proact_arm::ArmModel;
use proact_types::{JointVector, PlanStatus, Trajectory, TrajectoryPoint};
use std::ops::Range;

/// Smooths and times paths under the limits of one arm.
pub(crate) struct Smoother {
    limits: MotionLimits,
    /// Width of the average that keeps the jerk bounded, s; zero for none.
    window_secs: f64,
}

/// Distances of the control points of the smoothed path that are tried, rad. The curve cuts a corner by at most
/// a third of one: with the last, by less than a millimetre at the fingertips.
const CONTROL_SPACINGS_RAD: [f64; 4] = [0.02, 0.01, 0.005, 0.0025];

impl Smoother {
    pub fn new(model: &ArmModel, options: &PlannerOptions) -> Self {
        let arm = || model.arm.iter().map(|&j| &model.joints[j].limits);
        let limits = MotionLimits {
            velocity_rad_per_s: arm()
                .map(|l| {
                    if l.velocity > 0.0 {
                        l.velocity.min(options.max_velocity_rad_per_s)
                    } else {
                        options.max_velocity_rad_per_s
                    }
                })
                .collect(),
            acceleration_rad_per_s2: arm().map(|_| options.max_acceleration_rad_per_s2).collect(),
        };
        Self { limits, window_secs: 2.0 * options.max_acceleration_rad_per_s2 / options.max_jerk_rad_per_s3 }
    }

    /// The route as a trajectory. Between its straight ways it was found free with padding; there the smoothed curve, which
    /// cuts corners, is checked again and drawn closer to the route if need be: until it touches nothing, and until its middle
    /// keeps `wanted`, metres, if any of the curves does.
    pub fn smooth(
        &self,
        context: &mut PlanningContext,
        route: &JointPath,
        wanted: f64,
    ) -> Result<CheckedTrajectory, PlanFailure> {
        let JointPath { waypoints: path, blend_range: [left, entered], .. } = route;
        let mut widest: Option<CheckedTrajectory> = None;
        for spacing in CONTROL_SPACINGS_RAD {
            context.check_interrupt()?;
            let Some(curve) = JointSpline::from_path(path, [*left, *entered], spacing) else {
                // Already there: a trajectory of one point says so.
                let qd = proact_types::zeros(path[0].len());
                let point = TrajectoryPoint { time_secs: 0.0, q: proact_types::joints(&path[0]), qd };
                return Ok(CheckedTrajectory {
                    trajectory: Trajectory { points: vec![point] },
                    clearance_m: None,
                });
            };
            let [from, to] = curve.kept_parameters;
            // The closest curve strays less from the path than the padding is wide.
            let closest = spacing == CONTROL_SPACINGS_RAD[CONTROL_SPACINGS_RAD.len() - 1];
            if closest && widest.is_some() {
                // It would be run at a quarter of the acceleration.
                break;
            }
            if !closest && !curve_is_free(context, &curve, from, to)? {
                continue;
            }
            let (limits, window) = self.motion_limits_of(closest);
            context.check_interrupt()?;
            let mut trajectory = curve.time_optimal(&limits);
            let at = |u: f64| trajectory.points[u as usize * GRID_POINTS_PER_SPAN].time_secs;
            let (begin, end) = (at(from) + window, at(to));
            if window > 0.0 {
                context.check_interrupt()?;
                trajectory = moving_average(&trajectory, window);
            }
            let middle = TrajectoryMiddle::of_trajectory(context, &trajectory);
            let keeps_clearance = middle.keeps_clearance(context, context.options.padding_m)?;
            let free = window == 0.0
                || (closest && !context.is_tight())
                || trajectory_is_free(context, &trajectory, begin, end, keeps_clearance.then_some(&middle))?;
            if free {
                let clearance = middle.clearance(context, keeps_clearance)?;
                let found = CheckedTrajectory { trajectory, clearance_m: clearance };
                if clearance.is_none_or(|clearance| clearance >= wanted) {
                    return Ok(found);
                }
                if widest.as_ref().is_none_or(|widest| clearance > widest.clearance_m) {
                    widest = Some(found);
                }
            }
        }
        widest.ok_or_else(|| PlanFailure::new(PlanStatus::Invalid, "The path could not be smoothed."))
    }

    /// Limits of the trajectory before it is averaged, and the window for that, s. Beside obstacles that leave no
    /// room for what averaging cuts off, a quarter of the acceleration makes that 64 times less.
    fn motion_limits_of(&self, careful: bool) -> (MotionLimits, f64) {
        let mut limits = self.limits.clone();
        if careful && self.window_secs > 0.0 {
            limits.acceleration_rad_per_s2.iter_mut().for_each(|a| *a /= 4.0);
            return (limits, self.window_secs / 4.0);
        }
        (limits, self.window_secs)
    }
}

/// A trajectory and its clearance, as in the reply to a request.
pub(crate) struct CheckedTrajectory {
    pub trajectory: Trajectory,
    pub clearance_m: Option<f64>,
}

/// True if nothing touches the smoothed curve between two of its parameters.
fn curve_is_free(
    context: &mut PlanningContext,
    curve: &JointSpline,
    from: f64,
    to: f64,
) -> Result<bool, PlanFailure> {
    context.set_clearance(ClearanceMode::Contact)?;
    let states: Vec<JointVector> =
        (0..=(2.0 * (to - from)) as usize).map(|k| curve.position(from + 0.5 * k as f64)).collect();
    Ok(context.scene.states_are_free(states.iter().map(|q| &**q))?)
}

/// True if nothing touches from `begin` to `end`, seconds, at every point of the trajectory but in its middle if that is
/// `known` to have room; with next to no clearance, between the points as well.
fn trajectory_is_free(
    context: &mut PlanningContext,
    trajectory: &Trajectory,
    begin: f64,
    end: f64,
    known: Option<&TrajectoryMiddle>,
) -> Result<bool, PlanFailure> {
    context.set_clearance(ClearanceMode::Contact)?;
    let limits = context.contact_search_limits();
    let points = &trajectory.points;
    let within = |k: &usize| points[*k].time_secs >= begin && points[*k].time_secs <= end;
    let is_known = |k: &usize| known.is_some_and(|middle| middle.indices.contains(k));
    let checked: Vec<usize> = (0..points.len()).filter(within).collect();
    for part in checked.chunk_by(|a, b| is_known(a) == is_known(b)) {
        context.check_interrupt()?;
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

/// The middle of a trajectory: its points that are more than [`END_MARGIN_M`](crate::route::ENDS) away from both ends.
struct TrajectoryMiddle<'a> {
    points: &'a [TrajectoryPoint],
    indices: Range<usize>,
}

/// A clearance that is less than usual is measured so finely, metres.
const CLEARANCE_RESOLUTION_M: f64 = 2e-5;

impl<'a> TrajectoryMiddle<'a> {
    fn of_trajectory(context: &PlanningContext, trajectory: &'a Trajectory) -> Self {
        let points = &trajectory.points;
        let states: Vec<&[f64]> = points.iter().map(|point| &*point.q).collect();
        Self { points, indices: middle_range(&context.chain, &states) }
    }

    /// True if the middle has so much free space around it, metres.
    fn keeps_clearance(&self, context: &mut PlanningContext, padding: f64) -> Result<bool, PlanFailure> {
        context.require_clearance(padding)?;
        context.check_interrupt()?;
        let states = self.points[self.indices.clone()].iter().map(|point| &*point.q);
        Ok(context.scene.states_are_free(states)?)
    }

    /// The free space around the middle, metres: at most the usual padding, which one that `keeps_clearance` keeps. None if
    /// there is no middle.
    fn clearance(
        &self,
        context: &mut PlanningContext,
        keeps_clearance: bool,
    ) -> Result<Option<f64>, PlanFailure> {
        let (mut kept, mut lost) = (0.0, context.options.padding_m);
        if self.indices.is_empty() || keeps_clearance {
            return Ok((!self.indices.is_empty()).then_some(lost));
        }
        let mut near: Vec<&TrajectoryPoint> = self.points[self.indices.clone()].iter().collect();
        while lost - kept > CLEARANCE_RESOLUTION_M {
            context.check_interrupt()?;
            let padding = 0.5 * (kept + lost);
            context.require_clearance(padding)?;
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
