//! The search in joint space that connects where the start was left with a way into the goal.

use crate::approach_paths::{Aim, ApproachPath};
use crate::context::{Clearance, PlanningContext};
use crate::effort::PlanStage;
use crate::failure::Failure;
use crate::problem::Problem;
use crate::{SearchLimits, SearchOutcome};
use proact_types::PlanStatus;

/// A path from where the start was left to the goal.
pub(crate) struct Connection {
    pub points: Vec<Vec<f64>>,
    /// Index of the point at which the straight way into the goal begins.
    pub entry: usize,
    /// What its end was sought for; none if it must stay where it is.
    pub aim: Option<Aim>,
}

impl Connection {
    /// A path from `from` along one of `paths`, to its end.
    pub fn search(
        context: &mut PlanningContext,
        problem: &Problem,
        from: &[f64],
        paths: &[ApproachPath],
    ) -> Result<Self, Failure> {
        context.set_clearance(Clearance::Transit)?;
        let goals: Vec<Vec<f64>> = paths.iter().map(|w| w.points[0].clone()).collect();
        context.stage.set(PlanStage::Searching);
        let usual = context.limits_with(context.attempt.transit);
        let limits = SearchLimits { max_secs: context.secs_left(), ..usual };
        let seed = problem.request.seed;
        let (planner, parameters) = (context.options.name, &context.options.parameters);
        match context.scene.search_by(planner, parameters, from, &goals, seed, &limits, &context.cancel)? {
            SearchOutcome::Solved { path: mut points, goal } => {
                let entry = points.len() - 1;
                points.extend(paths[goal].points.iter().skip(1).cloned());
                Ok(Self { points, entry, aim: paths[goal].aim })
            }
            SearchOutcome::NoPlan if context.scene.effort.timed_out => Err(Failure::out_of_time()),
            SearchOutcome::NoPlan => Err(Failure::new(
                PlanStatus::NoPlan,
                format!("No way to the goal was found in {} iterations.", limits.max_iterations),
            )),
            SearchOutcome::StartInCollision => {
                let what = "The arm starts too close to something";
                Err(in_collision(context, PlanStatus::StartInCollision, what, &[from.to_vec()])?)
            }
            SearchOutcome::GoalsInCollision => {
                let what = "The arm would touch something at the goal";
                Err(in_collision(context, PlanStatus::GoalInCollision, what, &goals)?)
            }
            SearchOutcome::Cancelled => Err(Failure::cancelled()),
        }
    }
}

/// The failure with `status` that names the first pair in collision at one of the arm angles `states`.
fn in_collision(
    context: &mut PlanningContext,
    status: PlanStatus,
    what: &str,
    states: &[Vec<f64>],
) -> Result<Failure, Failure> {
    for q in states {
        if let Some((a, b)) = context.scene.collisions(q)?.into_iter().next() {
            return Ok(Failure::new(status, format!("{what}: {a} and {b}.")));
        }
    }
    Ok(Failure::new(status, format!("{what}.")))
}
