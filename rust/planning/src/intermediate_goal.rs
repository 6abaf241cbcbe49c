//! When the goal is out of reach: the farthest useful point on the way to it.

use crate::approach_paths::{ApproachPath, grasp_axes, is_same_posture, posture_cost, sort_by_cost};
use crate::axis_ik::{self, IkGoal};
use crate::connected_path::ConnectedPath;
use crate::context::{ClearanceMode, PlanningContext};
use crate::failure::PlanFailure;
use crate::problem::PlanProblem;
use crate::{PlannerOptions, PlanningError};
use proact_control::ports::IkOutcome;
use proact_types::{PlanGoal, PlanStatus, Point, Pose, Vector};

/// Finds points on the way to a goal that is out of reach. Settings as in [`PlannerOptions`].
pub(crate) struct IntermediateGoalPlanner {
    ik_seeds: usize,
    approach_height_m: f64,
}

/// Shares of the way to the goal, farthest first. The original tried 75 and 56 per cent.
const GOAL_FRACTIONS: [f64; 5] = [0.9, 0.75, 0.5625, 0.42, 0.3];
/// A point on the way that brings the hand less closer than this is of no use, metres.
const MIN_PROGRESS_M: f64 = 0.03;
/// Hand orientations that are tried at each point.
const MAX_ORIENTATIONS: usize = 9;

impl IntermediateGoalPlanner {
    pub fn new(options: &PlannerOptions) -> Self {
        Self { ik_seeds: options.ik_seeds, approach_height_m: options.approach_height_m }
    }

    /// A path to the farthest point on the way at which the arm can be.
    pub fn find(
        &self,
        context: &mut PlanningContext,
        problem: &PlanProblem,
        from: &[f64],
    ) -> Result<ConnectedPath, PlanFailure> {
        let none = || PlanFailure::new(PlanStatus::Unreachable, "No useful point on the way can be reached.");
        let here = context.kinematics.forward(from).map_err(PlanningError::from)?;
        let postures = context.ik_seeds(problem, from, 1, self.ik_seeds + 1);
        let (point, goal) = match &problem.request.goal {
            PlanGoal::Joints { .. } => return Err(none()),
            PlanGoal::TipPose { pose } => {
                return self.find_pose(
                    context,
                    problem,
                    from,
                    &here,
                    &(problem.base_from_world * pose),
                    &postures,
                );
            }
            PlanGoal::Pick { center, .. } => (Point::from(problem.grasp.center), *center),
            PlanGoal::Place { point } => {
                let object = problem.request.attached.as_ref().ok_or_else(none)?;
                (Point::from(object.tip_from_object.translation.vector), *point)
            }
        };
        // Aim above the goal, where an approach would begin, so that the way never leads through the table.
        let above = problem.base_from_world * (goal + Vector::z() * (self.approach_height_m + 0.03));
        let start = here * point;
        let axes = match &problem.request.attached {
            Some(_) => vec![(here.rotation.inverse() * problem.up, 0.0)],
            None => grasp_axes(&problem.grasp),
        };
        for share in GOAL_FRACTIONS {
            let target = start + (above - start) * share;
            if (target - start).norm() < MIN_PROGRESS_M {
                break;
            }
            let mut paths: Vec<ApproachPath> = Vec::new();
            context.set_clearance(ClearanceMode::Transit)?;
            for (axis, off) in axes.iter().take(MAX_ORIENTATIONS) {
                let reach = IkGoal {
                    point,
                    axis: *axis,
                    target,
                    direction: problem.up,
                    orientation: None,
                    tolerance: context.goal_tolerance,
                };
                for posture in &postures {
                    context.check_interrupt()?;
                    let found = axis_ik::solve_ik(&context.chain, &context.limits, &reach, posture);
                    let Some(q) = found else { continue };
                    if !paths.iter().any(|w| is_same_posture(&w.waypoints[0], &q))
                        && context.scene.is_free(&q)?
                    {
                        paths.push(ApproachPath {
                            cost: posture_cost(&context.limits, from, &q, *off),
                            waypoints: vec![q],
                            opening_blocked: false,
                            approach_goal: None,
                        });
                    }
                }
                if !paths.is_empty() {
                    break;
                }
            }
            if let Some(path) = try_connect(context, problem, from, paths)? {
                return Ok(path);
            }
        }
        Err(none())
    }

    fn find_pose(
        &self,
        context: &mut PlanningContext,
        problem: &PlanProblem,
        from: &[f64],
        here: &Pose,
        goal: &Pose,
        postures: &[Vec<f64>],
    ) -> Result<ConnectedPath, PlanFailure> {
        for share in GOAL_FRACTIONS {
            let translation = here.translation.vector.lerp(&goal.translation.vector, share);
            if (translation - here.translation.vector).norm() < MIN_PROGRESS_M {
                break;
            }
            // Turning half-way round has no shortest direction; the goal's own orientation serves then.
            let rotation = here.rotation.try_slerp(&goal.rotation, share, 1e-9).unwrap_or(goal.rotation);
            let pose = Pose::from_parts(translation.into(), rotation);
            let mut paths: Vec<ApproachPath> = Vec::new();
            context.set_clearance(ClearanceMode::Transit)?;
            for posture in postures {
                context.check_interrupt()?;
                let found = context.kinematics.inverse(&pose, posture).map_err(PlanningError::from)?;
                let IkOutcome::Solved(q) = found else { continue };
                let q = q.to_vec();
                if context.limits.contains(&q, 1e-9)
                    && !paths.iter().any(|w| is_same_posture(&w.waypoints[0], &q))
                    && context.scene.is_free(&q)?
                {
                    let cost = posture_cost(&context.limits, from, &q, 0.0);
                    paths.push(ApproachPath {
                        cost,
                        waypoints: vec![q],
                        opening_blocked: false,
                        approach_goal: None,
                    });
                }
            }
            if let Some(path) = try_connect(context, problem, from, paths)? {
                return Ok(path);
            }
        }
        Err(PlanFailure::new(PlanStatus::Unreachable, "No useful point on the way can be reached."))
    }
}

/// A path to the best of `paths`; none if there is no way or no path, so that a nearer point may be tried.
fn try_connect(
    context: &mut PlanningContext,
    problem: &PlanProblem,
    from: &[f64],
    paths: Vec<ApproachPath>,
) -> Result<Option<ConnectedPath>, PlanFailure> {
    if paths.is_empty() {
        return Ok(None);
    }
    match ConnectedPath::search(context, problem, from, &sort_by_cost(paths)) {
        Ok(path) => Ok(Some(path)),
        Err(failure) if failure.status == PlanStatus::NoPlan => Ok(None),
        Err(failure) => Err(failure),
    }
}
