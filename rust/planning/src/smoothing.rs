//! From the points of a path to a trajectory that touches nothing either.

use crate::PlannerOptions;
use crate::blending::blended;
use crate::context::{Clearance, PlanningContext};
use crate::failure::Failure;
use crate::timing::{Curve, GRID, MotionLimits, averaged};
use proact_arm::ArmModel;
use proact_types::{PlanStatus, Trajectory, TrajectoryPoint};

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

    /// The path as a trajectory. Between the points `left` and `entered` it was found free with padding; there
    /// the smoothed curve, which cuts corners, is checked again and drawn closer to the path if need be.
    pub fn timed(
        &self,
        context: &mut PlanningContext,
        path: &[Vec<f64>],
        left: usize,
        entered: usize,
    ) -> Result<Trajectory, Failure> {
        let (path, entered) = &blended(context, path, left, entered)?;
        let entered = *entered;
        context.set_clearance(Clearance::Contact)?;
        for spacing in SPACINGS {
            context.go_on()?;
            let Some(curve) = Curve::along(path, spacing) else {
                // Already there: a trajectory of one point says so.
                let qd = proact_types::zeros(path[0].len());
                let point = TrajectoryPoint { time_secs: 0.0, q: proact_types::joints(&path[0]), qd };
                return Ok(Trajectory { points: vec![point] });
            };
            let (from, to) = (curve.path_parameter[left], curve.path_parameter[entered]);
            // The closest curve strays less from the path than the padding is wide.
            let closest = spacing == SPACINGS[SPACINGS.len() - 1];
            let mut free = true;
            for k in 0..=(2.0 * (to - from)) as usize {
                let [q, _, _] = curve.at(from + 0.5 * k as f64);
                if !context.scene.is_free(&q)? {
                    free = false;
                    break;
                }
            }
            if !free && !closest {
                continue;
            }
            let (limits, window) = self.motion_limits_of(closest);
            context.go_on()?;
            let timed = curve.timed(&limits);
            if window == 0.0 {
                return Ok(timed);
            }
            context.go_on()?;
            let smooth = averaged(&timed, window);
            let at = |u: f64| timed.points[u as usize * GRID].time_secs;
            if (closest && !context.is_tight())
                || is_free_between(context, &smooth, at(from) + window, at(to))?
            {
                return Ok(smooth);
            }
        }
        Err(Failure::new(PlanStatus::Invalid, "The path could not be smoothed."))
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

/// True if nothing touches from `begin` to `end`, seconds, at every point of the trajectory; with next to no clearance,
/// between them as well.
fn is_free_between(
    context: &mut PlanningContext,
    trajectory: &Trajectory,
    begin: f64,
    end: f64,
) -> Result<bool, Failure> {
    let limits = context.limits_of_contact();
    let within = |point: &&TrajectoryPoint| point.time_secs >= begin && point.time_secs <= end;
    let points: Vec<&TrajectoryPoint> = trajectory.points.iter().filter(within).collect();
    for pair in points.windows(2) {
        context.go_on()?;
        let free = if context.is_tight() {
            context.scene.motion_is_free(&pair[0].q, &pair[1].q, &limits)?
        } else {
            context.scene.is_free(&pair[1].q)?
        };
        if !free {
            return Ok(false);
        }
    }
    Ok(true)
}
