//! From the points of a path to a trajectory that touches nothing either.

use crate::arm_planner::{ArmPlanner, Failure, Room};
use crate::timing::{Curve, GRID, MotionLimits, averaged};
use proact_types::{PlanStatus, Trajectory, TrajectoryPoint};

/// Distances of the control points of the smoothed path that are tried, rad. The curve cuts a corner by at most
/// a third of one: with the last, by less than a millimetre at the fingertips.
const SPACINGS: [f64; 4] = [0.02, 0.01, 0.005, 0.0025];

impl ArmPlanner {
    /// The path as a trajectory. Between the points `left` and `entered` it was found free with padding; there
    /// the smoothed curve, which cuts corners, is checked again and drawn closer to the path if need be.
    pub(crate) fn timed(
        &mut self,
        path: &[Vec<f64>],
        left: usize,
        entered: usize,
    ) -> Result<Trajectory, Failure> {
        let (path, entered) = &self.blended(path, left, entered)?;
        let entered = *entered;
        self.set_room(Room::Contact)?;
        for spacing in SPACINGS {
            self.go_on()?;
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
                if !self.scene.is_free(&q)? {
                    free = false;
                    break;
                }
            }
            if !free && !closest {
                continue;
            }
            let (limits, window) = self.motion_limits_of(closest);
            self.go_on()?;
            let timed = curve.timed(&limits);
            if window == 0.0 {
                return Ok(timed);
            }
            self.go_on()?;
            let smooth = averaged(&timed, window);
            let at = |u: f64| timed.points[u as usize * GRID].time_secs;
            if (closest && !self.is_tight()) || self.is_free_between(&smooth, at(from) + window, at(to))? {
                return Ok(smooth);
            }
        }
        Err(Failure::new(PlanStatus::Invalid, "The path could not be smoothed."))
    }

    /// Limits of the trajectory before it is averaged, and the window for that, s. Beside obstacles that leave no
    /// room for what averaging cuts off, a quarter of the acceleration makes that 64 times less.
    fn motion_limits_of(&self, careful: bool) -> (MotionLimits, f64) {
        let mut limits = self.motion_limits.clone();
        let window = 2.0 * self.options.max_acceleration / self.options.max_jerk;
        if careful && window > 0.0 {
            limits.acceleration.iter_mut().for_each(|a| *a /= 4.0);
            return (limits, window / 4.0);
        }
        (limits, window)
    }

    /// True if nothing touches from `begin` to `end`, seconds, at every point of the trajectory; with next to no room,
    /// between them as well.
    fn is_free_between(&mut self, trajectory: &Trajectory, begin: f64, end: f64) -> Result<bool, Failure> {
        let limits = self.limits_of_contact();
        let within = |point: &&TrajectoryPoint| point.time_secs >= begin && point.time_secs <= end;
        let points: Vec<&TrajectoryPoint> = trajectory.points.iter().filter(within).collect();
        for pair in points.windows(2) {
            self.go_on()?;
            let free = if self.is_tight() {
                self.scene.motion_is_free(&pair[0].q, &pair[1].q, &limits)?
            } else {
                self.scene.is_free(&pair[1].q)?
            };
            if !free {
                return Ok(false);
            }
        }
        Ok(true)
    }
}
