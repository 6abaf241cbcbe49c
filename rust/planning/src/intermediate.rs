//! When the goal is out of reach: the farthest useful point on the way to it.

use crate::approach_paths::{ApproachPath, cost, grasp_axes, same, sorted};
use crate::connection::Connection;
use crate::context::{Clearance, PlanningContext};
use crate::failure::Failure;
use crate::problem::Problem;
use crate::reach::{self, Reach};
use crate::{PlannerOptions, PlanningError};
use proact_control::ports::IkOutcome;
use proact_types::{PlanGoal, PlanStatus, Point, Pose, Vector};

/// Finds points on the way to a goal that is out of reach. Settings as in [`PlannerOptions`].
pub(crate) struct Intermediate {
    postures: usize,
    approach_height: f64,
}

/// Shares of the way to the goal, farthest first. The original tried 75 and 56 per cent.
const SHARES: [f64; 5] = [0.9, 0.75, 0.5625, 0.42, 0.3];
/// A point on the way that brings the hand less closer than this is of no use, metres.
const USEFUL: f64 = 0.03;
/// Hand orientations that are tried at each point.
const ORIENTATIONS: usize = 9;

impl Intermediate {
    pub fn new(options: &PlannerOptions) -> Self {
        Self { postures: options.postures, approach_height: options.approach_height }
    }

    /// A path to the farthest point on the way at which the arm can be.
    pub fn find(
        &self,
        context: &mut PlanningContext,
        problem: &Problem,
        from: &[f64],
    ) -> Result<Connection, Failure> {
        let none = || Failure::new(PlanStatus::Unreachable, "No useful point on the way can be reached.");
        let here = context.kinematics.forward(from).map_err(PlanningError::from)?;
        let postures = context.postures(problem, from, 1, self.postures + 1);
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
            PlanGoal::Pick { centre, .. } => (Point::from(problem.grasp.centre), *centre),
            PlanGoal::Place { point } => {
                let object = problem.request.attached.as_ref().ok_or_else(none)?;
                (Point::from(object.tip_from_object.translation.vector), *point)
            }
        };
        // Aim above the goal, where an approach would begin, so that the way never leads through the table.
        let above = problem.base_from_world * (goal + Vector::z() * (self.approach_height + 0.03));
        let start = here * point;
        let axes = match &problem.request.attached {
            Some(_) => vec![(here.rotation.inverse() * problem.up, 0.0)],
            None => grasp_axes(&problem.grasp),
        };
        for share in SHARES {
            let target = start + (above - start) * share;
            if (target - start).norm() < USEFUL {
                break;
            }
            let mut paths: Vec<ApproachPath> = Vec::new();
            context.set_clearance(Clearance::Transit)?;
            for (axis, off) in axes.iter().take(ORIENTATIONS) {
                let reach = Reach {
                    point,
                    axis: *axis,
                    target,
                    direction: problem.up,
                    orientation: None,
                    slack: context.slack,
                };
                for posture in &postures {
                    context.go_on()?;
                    let found = reach::solve(&context.chain, &context.limits, &reach, posture);
                    let Some(q) = found else { continue };
                    if !paths.iter().any(|w| same(&w.points[0], &q)) && context.scene.is_free(&q)? {
                        paths.push(ApproachPath {
                            cost: cost(&context.limits, from, &q, *off),
                            points: vec![q],
                            cramped: false,
                            aim: None,
                        });
                    }
                }
                if !paths.is_empty() {
                    break;
                }
            }
            if let Some(path) = connect_or_go_on(context, problem, from, paths)? {
                return Ok(path);
            }
        }
        Err(none())
    }

    fn find_pose(
        &self,
        context: &mut PlanningContext,
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
            let mut paths: Vec<ApproachPath> = Vec::new();
            context.set_clearance(Clearance::Transit)?;
            for posture in postures {
                context.go_on()?;
                let found = context.kinematics.inverse(&pose, posture).map_err(PlanningError::from)?;
                let IkOutcome::Solved(q) = found else { continue };
                let q = q.to_vec();
                if context.limits.contain(&q, 1e-9)
                    && !paths.iter().any(|w| same(&w.points[0], &q))
                    && context.scene.is_free(&q)?
                {
                    let cost = cost(&context.limits, from, &q, 0.0);
                    paths.push(ApproachPath { cost, points: vec![q], cramped: false, aim: None });
                }
            }
            if let Some(path) = connect_or_go_on(context, problem, from, paths)? {
                return Ok(path);
            }
        }
        Err(Failure::new(PlanStatus::Unreachable, "No useful point on the way can be reached."))
    }
}

/// A path to the best of `paths`; none if there is no way or no path, so that a nearer point may be tried.
fn connect_or_go_on(
    context: &mut PlanningContext,
    problem: &Problem,
    from: &[f64],
    paths: Vec<ApproachPath>,
) -> Result<Option<Connection>, Failure> {
    if paths.is_empty() {
        return Ok(None);
    }
    match Connection::search(context, problem, from, &sorted(paths)) {
        Ok(path) => Ok(Some(path)),
        Err(failure) if failure.status == PlanStatus::NoPlan => Ok(None),
        Err(failure) => Err(failure),
    }
}
