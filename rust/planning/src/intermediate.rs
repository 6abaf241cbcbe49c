//! When the goal is out of reach: the farthest useful point on the way to it.

use crate::arm_planner::{ArmPlanner, Connection, Failure, Problem, Room};
use crate::reach::{self, Reach};
use crate::ways::{Way, same, sorted};
use proact_control::ports::IkOutcome;
use proact_types::{PlanGoal, PlanStatus, Point, Pose, Vector};

/// Shares of the way to the goal, farthest first. The original tried 75 and 56 per cent.
const SHARES: [f64; 5] = [0.9, 0.75, 0.5625, 0.42, 0.3];
/// A point on the way that brings the hand less closer than this is of no use, metres.
const USEFUL: f64 = 0.03;
/// Hand orientations that are tried at each point.
const ORIENTATIONS: usize = 9;

impl ArmPlanner {
    /// A path to the farthest point on the way at which the arm can be.
    pub(crate) fn way_to_intermediate(
        &mut self,
        problem: &Problem,
        from: &[f64],
    ) -> Result<Connection, Failure> {
        let none = || Failure::new(PlanStatus::Unreachable, "No useful point on the way can be reached.");
        let here = self.kinematics.forward(from).map_err(crate::PlanningError::from)?;
        let postures = self.postures(problem, from, self.options.postures + 1);
        let (point, goal) = match &problem.request.goal {
            PlanGoal::Joints { .. } => return Err(none()),
            PlanGoal::TipPose { pose } => {
                return self.way_to_intermediate_pose(
                    problem,
                    from,
                    &here,
                    &(problem.base_from_world * pose),
                    &postures,
                );
            }
            PlanGoal::Pick { centre, .. } => (Point::from(self.model.grasp_centre), *centre),
            PlanGoal::Place { point } => {
                let object = problem.request.attached.as_ref().ok_or_else(none)?;
                (Point::from(object.tip_from_object.translation.vector), *point)
            }
        };
        // Aim above the goal, where an approach would begin, so that the way never leads through the table.
        let above = problem.base_from_world * (goal + Vector::z() * (self.options.approach_height + 0.03));
        let start = here * point;
        let axes = match &problem.request.attached {
            Some(_) => vec![(here.rotation.inverse() * problem.up, 0.0)],
            None => self.grasp_axes(),
        };
        for share in SHARES {
            let target = start + (above - start) * share;
            if (target - start).norm() < USEFUL {
                break;
            }
            let mut ways: Vec<Way> = Vec::new();
            self.set_room(Room::Transit)?;
            for (axis, off) in axes.iter().take(ORIENTATIONS) {
                let reach = Reach { point, axis: *axis, target, direction: problem.up, orientation: None };
                for posture in &postures {
                    self.go_on()?;
                    let found = reach::solve(&mut self.chain, &self.limits, &reach, posture);
                    let Some(q) = found else { continue };
                    if !ways.iter().any(|w| same(&w.points[0], &q)) && self.scene.is_free(&q)? {
                        ways.push(Way { cost: self.cost(from, &q, *off), points: vec![q] });
                    }
                }
                if !ways.is_empty() {
                    break;
                }
            }
            if let Some(path) = self.connect_or_go_on(problem, from, ways)? {
                return Ok(path);
            }
        }
        Err(none())
    }

    fn way_to_intermediate_pose(
        &mut self,
        problem: &Problem,
        from: &[f64],
        here: &Pose,
        goal: &Pose,
        postures: &[Vec<f64>],
    ) -> Result<Connection, Failure> {
        for share in SHARES {
            let translation = here.translation.vector.lerp(&goal.translation.vector, share);
            if (translation - here.translation.vector).norm() < USEFUL {
                break;
            }
            // Turning half-way round has no shortest direction; the goal's own orientation serves then.
            let rotation = here.rotation.try_slerp(&goal.rotation, share, 1e-9).unwrap_or(goal.rotation);
            let pose = Pose::from_parts(translation.into(), rotation);
            let mut ways: Vec<Way> = Vec::new();
            self.set_room(Room::Transit)?;
            for posture in postures {
                self.go_on()?;
                let found = self.kinematics.inverse(&pose, posture).map_err(crate::PlanningError::from)?;
                let IkOutcome::Solved(q) = found else { continue };
                let q = q.to_vec();
                if self.limits.contain(&q, 1e-9)
                    && !ways.iter().any(|w| same(&w.points[0], &q))
                    && self.scene.is_free(&q)?
                {
                    ways.push(Way { cost: self.cost(from, &q, 0.0), points: vec![q] });
                }
            }
            if let Some(path) = self.connect_or_go_on(problem, from, ways)? {
                return Ok(path);
            }
        }
        Err(Failure::new(PlanStatus::Unreachable, "No useful point on the way can be reached."))
    }

    /// A path to the best of `ways`; none if there is no way or no path, so that a nearer point may be tried.
    fn connect_or_go_on(
        &mut self,
        problem: &Problem,
        from: &[f64],
        ways: Vec<Way>,
    ) -> Result<Option<Connection>, Failure> {
        if ways.is_empty() {
            return Ok(None);
        }
        match self.connect(problem, from, &sorted(ways)) {
            Ok(path) => Ok(Some(path)),
            Err(failure) if failure.status == PlanStatus::NoPlan => Ok(None),
            Err(failure) => Err(failure),
        }
    }
}
