//! The search in joint space that connects where the start was left with a way into the goal.

use crate::approach_paths::{ApproachGoal, ApproachPath};
use crate::context::{ClearanceMode, PlanningContext};
use crate::failure::PlanFailure;
use crate::plan_stats::PlanStage;
use crate::problem::PlanProblem;
use crate::{SearchLimits, SearchOutcome};
use proact_types::PlanStatus;

/// A path from where the start was left to the goal.
pub(crate) struct ConnectedPath {
    pub waypoints: Vec<Vec<f64>>,
    /// Index of the point at which the straight way into the goal begins.
    pub approach_start: usize,
    /// What its end was sought for; none if it must stay where it is.
    pub approach_goal: Option<ApproachGoal>,
}

impl ConnectedPath {
    /// A path from `from` along one of `paths`, to its end.
    pub fn search(
        context: &mut PlanningContext,
        problem: &PlanProblem,
        from: &[f64],
        paths: &[ApproachPath],
    ) -> Result<Self, PlanFailure> {
        context.set_clearance(ClearanceMode::Transit)?;
        let goals: Vec<Vec<f64>> = paths.iter().map(|w| w.waypoints[0].clone()).collect();
        context.stage.set(PlanStage::PathSearch);
        let usual = context.search_limits_for(context.attempt.transit_clearance_m);
        let limits = SearchLimits { max_secs: context.secs_left(), ..usual };
        let seed = problem.request.seed;
        let (planner, parameters) = (context.options.name, &context.options.parameters);
        match context.scene.search_with(planner, parameters, from, &goals, seed, &limits, &context.cancel)? {
            SearchOutcome::Solved { path: mut points, goal } => {
                let entry = points.len() - 1;
                points.extend(paths[goal].waypoints.iter().skip(1).cloned());
                Ok(Self {
                    waypoints: points,
                    approach_start: entry,
                    approach_goal: paths[goal].approach_goal,
                })
            }
            SearchOutcome::NoPlan if context.scene.stats.timed_out => Err(PlanFailure::timed_out()),
            SearchOutcome::NoPlan => Err(PlanFailure::new(
                PlanStatus::NoPlan,
                format!("No way to the goal was found in {} iterations.", limits.max_iterations),
            )),
            SearchOutcome::StartInCollision => {
                let what = "The arm starts too close to something";
                Err(collision_failure(context, PlanStatus::StartInCollision, what, &[from.to_vec()])?)
            }
            SearchOutcome::GoalsInCollision => {
                let what = "The arm would touch something at the goal";
                Err(collision_failure(context, PlanStatus::GoalInCollision, what, &goals)?)
            }
            SearchOutcome::Cancelled => Err(PlanFailure::cancelled()),
        }
    }
}

/// The failure with `status` that names the first pair in collision at one of the arm angles `states`.
fn collision_failure(
    context: &mut PlanningContext,
    status: PlanStatus,
    what: &str,
    states: &[Vec<f64>],
) -> Result<PlanFailure, PlanFailure> {
    for q in states {
        if let Some((a, b)) = context.scene.collisions(q)?.into_iter().next() {
            return Ok(PlanFailure::new(status, format!("{what}: {a} and {b}.")));
        }
    }
    Ok(PlanFailure::new(status, format!("{what}.")))
}
