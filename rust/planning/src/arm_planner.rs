//! From a request to a reply: the start is left, paths to the goal are found, a search connects the two.

use crate::approach_paths::{ApproachPath, ApproachPlanner};
use crate::blending::BlendedPath;
use crate::clearance::increase_clearance;
use crate::connected_path::ConnectedPath;
use crate::context::{Attempt, PlanningContext};
use crate::continuous_joints::TurnNormalizer;
use crate::departure::DeparturePlanner;
use crate::failure::PlanFailure;
use crate::intermediate_goal::IntermediateGoalPlanner;
use crate::joint_path::JointPath;
use crate::partial_arm::plan_with_held_joints;
use crate::path_refinement::refine;
use crate::plan_stats::{PlanStage, PlanStats, SharedPlanStage, thread_cpu_secs};
use crate::problem::PlanProblem;
use crate::smoothing::{CheckedTrajectory, Smoother};
use crate::{CancelFlag, MeshObstacle, PlannerOptions, PlanningError, Roadmap, SearchStats};
use proact_arm::ArmModel;
use proact_control::ports::ArmKinematics;
use proact_types::{AttachedObject, Obstacle, PlanReply, PlanRequest, PlanStatus, Pose};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Plans motions of one arm: what it holds depends on nothing but the model and the options, so equal requests
/// get equal replies, bit for bit, whatever was asked before and whatever other threads do.
pub struct ArmPlanner {
    pub(crate) context: PlanningContext,
    departure: DeparturePlanner,
    approach: ApproachPlanner,
    intermediate: IntermediateGoalPlanner,
    smoother: Smoother,
    stats: PlanStats,
    turns: TurnNormalizer,
}

/// A failure, and how far the arm could still go: off what it was on or around.
struct PartialPlan {
    failure: PlanFailure,
    retreat_path: Option<Vec<Vec<f64>>>,
}

impl From<PlanFailure> for PartialPlan {
    fn from(failure: PlanFailure) -> Self {
        Self { failure, retreat_path: None }
    }
}

impl ArmPlanner {
    /// A planner for `model`. `kinematics` is that of the same arm: base to tip of the model.
    ///
    /// # Errors
    /// Options that make no sense, a model that the scene refuses, kinematics with another number of joints.
    pub fn new(
        model: Arc<ArmModel>,
        kinematics: Box<dyn ArmKinematics + Send>,
        options: PlannerOptions,
    ) -> Result<Self, PlanningError> {
        let (turn_normalizer, model) = TurnNormalizer::for_model(model);
        let context = PlanningContext::new(model, kinematics, options)?;
        Ok(Self {
            departure: DeparturePlanner::new(&context.options),
            approach: ApproachPlanner::new(&context.options),
            intermediate: IntermediateGoalPlanner::new(&context.options),
            smoother: Smoother::new(&context.model, &context.options),
            stats: PlanStats::default(),
            turns: turn_normalizer,
            context,
        })
    }

    /// The arm that is planned for.
    pub fn model(&self) -> &ArmModel {
        &self.context.model
    }

    /// The settings in force.
    pub fn options(&self) -> &PlannerOptions {
        &self.context.options
    }

    /// A handle that ends a running [`ArmPlanner::solve_ik`] from another thread. It stays raised until lowered.
    pub fn cancel_flag(&self) -> CancelFlag {
        self.context.cancel.clone()
    }

    /// Names of the pairs that touch at the arm angles `q` with the hand at `hand`, obstacles in `world`.
    /// Unpadded; links of the hand are not compared with each other.
    ///
    /// # Errors
    /// Wrong lengths, values that are not finite, shapes that the scene refuses.
    pub fn collisions(
        &mut self,
        q: &[f64],
        hand: &[f64],
        obstacles: &[Obstacle],
        attached: Option<&AttachedObject>,
        world_from_base: &Pose,
    ) -> Result<Vec<(String, String)>, PlanningError> {
        self.context.set_scene(hand, obstacles, attached, world_from_base)?;
        self.context.scene.set_padding(0.0)?;
        self.context.scene.collisions(q)
    }

    /// Meshes that stand in the way of every request, beside its own obstacles.
    ///
    /// # Errors
    /// A mesh without triangles, with a vertex that is not finite or a triangle that names none, a name used twice.
    pub fn set_meshes(&mut self, meshes: Vec<MeshObstacle>) -> Result<(), PlanningError> {
        self.context.set_meshes(meshes)
    }

    /// What PRM begins with from now on; none for a roadmap made anew for each request.
    ///
    /// # Errors
    /// A milestone of another arm, an edge that names no milestone.
    pub fn set_roadmap(&mut self, roadmap: Option<&Roadmap>) -> Result<(), PlanningError> {
        self.context.scene.set_roadmap(roadmap)
    }

    /// Grows a roadmap of so many milestones among `obstacles`, with the usual padding: for [`ArmPlanner::set_roadmap`].
    ///
    /// # Errors
    /// Wrong lengths, values that are not finite, shapes that the scene refuses.
    pub fn grow_roadmap(
        &mut self,
        milestones: usize,
        hand: &[f64],
        obstacles: &[Obstacle],
        world_from_base: &Pose,
        seed: u64,
    ) -> Result<Roadmap, PlanningError> {
        let context = &mut self.context;
        context.set_scene(hand, obstacles, None, world_from_base)?;
        context.scene.clear_allowed_contacts()?;
        context.scene.set_padding(context.options.padding_m)?;
        context.scene.grow_roadmap(milestones, seed, &context.options.search, &context.cancel)
    }

    /// What the planner is doing, for another thread to look at.
    pub(crate) fn stage(&self) -> SharedPlanStage {
        self.context.stage.clone()
    }

    /// What the last [`ArmPlanner::solve_ik`] took.
    pub fn stats(&self) -> &PlanStats {
        &self.stats
    }

    /// Answers `request`. Never fails otherwise than by the status of the reply.
    pub fn solve(&mut self, request: &PlanRequest) -> PlanReply {
        let (begin, cpu_begin) = (Instant::now(), thread_cpu_secs());
        self.context.deadline =
            self.context.options.deadline_secs.map(|secs| begin + Duration::from_secs_f64(secs));
        self.context.scene.stats = SearchStats::default();
        let reply = match self.turns.wrap(request) {
            Some((near, taken)) => {
                let mut reply = self.reply(&near);
                TurnNormalizer::unwrap(&mut reply, &taken);
                reply
            }
            None => self.reply(request),
        };
        self.context.stage.set(PlanStage::Idle);
        let timed_out = self.context.is_out_of_time();
        self.stats = PlanStats {
            request: request.id,
            status: reply.status,
            reason: reply.reason.clone(),
            clearance_m: reply.clearance_m,
            iterations: self.context.scene.stats.iterations,
            state_checks: self.context.scene.stats.state_checks,
            wall_secs: begin.elapsed().as_secs_f64(),
            cpu_secs: thread_cpu_secs() - cpu_begin,
            timed_out: timed_out || self.context.scene.stats.timed_out,
        };
        reply
    }

    fn reply(&mut self, request: &PlanRequest) -> PlanReply {
        if request.held_joints.is_empty() {
            self.plan_all_joints(request)
        } else {
            plan_with_held_joints(self, request)
        }
    }

    /// The answer to a request that holds no joint.
    pub(crate) fn plan_all_joints(&mut self, request: &PlanRequest) -> PlanReply {
        let id = request.id;
        match self.solve_inner(request) {
            Ok((CheckedTrajectory { trajectory, clearance_m: clearance }, shortfall)) => {
                let status = if shortfall.is_some() { PlanStatus::Intermediate } else { PlanStatus::Ok };
                PlanReply {
                    id,
                    status,
                    trajectory,
                    reason: shortfall.unwrap_or_default(),
                    clearance_m: clearance,
                }
            }
            Err(failure) => PlanReply::without_plan(id, failure.status, failure.reason),
        }
    }

    fn solve_inner(
        &mut self,
        request: &PlanRequest,
    ) -> Result<(CheckedTrajectory, Option<String>), PlanFailure> {
        let problem = PlanProblem::from_request(&mut self.context, request)?;
        // Where the usual clearance is not to be had, a narrower way, looked at more finely, is better than none.
        let mut first: Option<PartialPlan> = None;
        for attempt in Attempt::all(&self.context.options) {
            self.context.attempt = attempt;
            match self.solve_with_clearance(&problem) {
                Ok(plan) if plan.1.is_none() || first.is_none() => return Ok(plan),
                Ok(_) => break,
                Err(partial_plan) => {
                    let again = is_clearance_limited(partial_plan.failure.status);
                    if partial_plan.failure.status == PlanStatus::Cancelled {
                        return Err(partial_plan.failure);
                    }
                    first = first.or(Some(partial_plan));
                    if !again {
                        break;
                    }
                }
            }
        }
        [self.context.attempt, ..] = Attempt::all(&self.context.options);
        let Some(partial_plan) = first else { return Err(PlanFailure::timed_out()) };
        match partial_plan.retreat_path {
            // No way on, but a way out of the box: from up there another base or another try may reach.
            Some(points) => {
                let end = points.len() - 1;
                let route = JointPath {
                    waypoints: points,
                    blend_range: [end, end],
                    clearance_m: self.context.attempt.transit_clearance_m,
                };
                Ok((self.smoother.smooth(&mut self.context, &route, 0.0)?, Some(partial_plan.failure.reason)))
            }
            None => Err(partial_plan.failure),
        }
    }

    fn solve_with_clearance(
        &mut self,
        problem: &PlanProblem,
    ) -> Result<(CheckedTrajectory, Option<String>), PartialPlan> {
        self.context.stage.set(PlanStage::Departure);
        let mut path = self.departure.path(&mut self.context, problem)?;
        self.context.stage.set(PlanStage::ApproachSearch);
        let left = path.len() - 1;
        let from = path[left].clone();
        let (found, shortfall) = match self.path_to_goal(problem, &from) {
            Ok(found) => found,
            Err(failure) => {
                let moved = from != problem.start && failure.status != PlanStatus::Cancelled;
                return Err(PartialPlan { failure, retreat_path: moved.then_some(path) });
            }
        };
        path.extend(found.waypoints.into_iter().skip(1));
        let mut path = BlendedPath::new(path, [left, left + found.approach_start]);
        let transit = self.context.attempt.transit_clearance_m;
        path.maximize_blends(&mut self.context, transit)?;
        // Paths to compare with stay as OMPL simplifies them.
        if self.context.options.search.fixed_validity_step.is_none() {
            refine(&mut self.context, problem, &self.approach, found.approach_goal.as_ref(), &mut path)?;
        }
        let route = path.to_joint_path(transit);
        let (context, smoother) = (&mut self.context, &self.smoother);
        context.check_interrupt()?;
        context.stage.set(PlanStage::Smoothing);
        let timed = smoother.smooth(context, &route, 0.0)?;
        Ok((increase_clearance(context, problem, smoother, &route, timed)?, shortfall))
    }

    /// From `from` to the goal, or with the reason for falling short to a point on the way.
    fn path_to_goal(
        &mut self,
        problem: &PlanProblem,
        from: &[f64],
    ) -> Result<(ConnectedPath, Option<String>), PlanFailure> {
        let failure = match self.approach.find(&mut self.context, problem, from) {
            Ok(paths) => return Ok((self.search(problem, from, &paths)?, None)),
            Err(failure) if failure.status == PlanStatus::Unreachable => failure,
            Err(failure) => return Err(failure),
        };
        let path = self.intermediate.find(&mut self.context, problem, from).map_err(|other| {
            // Nothing useful on the way either: the first reason is the one that helps.
            if other.status == PlanStatus::Cancelled { other } else { failure.clone() }
        })?;
        Ok((path, Some(failure.reason)))
    }

    /// To one of `paths`, best first: to one where the hand has room to open, if any of these can be got to.
    fn search(
        &mut self,
        problem: &PlanProblem,
        from: &[f64],
        paths: &[ApproachPath],
    ) -> Result<ConnectedPath, PlanFailure> {
        let clear_count = paths.partition_point(|path| !path.opening_blocked);
        if (1..paths.len()).contains(&clear_count) {
            match ConnectedPath::search(&mut self.context, problem, from, &paths[..clear_count]) {
                Err(failure)
                    if failure.status == PlanStatus::NoPlan && self.context.check_interrupt().is_ok() => {}
                other => return other,
            }
        }
        ConnectedPath::search(&mut self.context, problem, from, paths)
    }
}

fn is_clearance_limited(status: PlanStatus) -> bool {
    matches!(status, PlanStatus::StartInCollision | PlanStatus::GoalInCollision | PlanStatus::NoPlan)
}
