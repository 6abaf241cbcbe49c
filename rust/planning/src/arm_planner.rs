//! From a request to a reply: the start is left, paths to the goal are found, a search connects the two.

use crate::approach_paths::{ApproachPath, ApproachPaths};
use crate::blending::BlendedPath;
use crate::connection::Connection;
use crate::context::{Attempt, PlanningContext};
use crate::effort::{PlanEffort, PlanStage, StageCell, thread_cpu_secs};
use crate::endless::EndlessJoints;
use crate::failure::Failure;
use crate::intermediate::Intermediate;
use crate::leave::Leaving;
use crate::part::solve_part;
use crate::problem::Problem;
use crate::refining::refine;
use crate::route::Route;
use crate::smoothing::{Smoother, Timed};
use crate::widening::widened;
use crate::{CancelFlag, MeshObstacle, PlannerOptions, PlanningError, Roadmap, SearchEffort};
use proact_arm::ArmModel;
use proact_control::ports::ArmKinematics;
use proact_types::{AttachedObject, Obstacle, PlanReply, PlanRequest, PlanStatus, Pose};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Plans motions of one arm: what it holds depends on nothing but the model and the options, so equal requests
/// get equal replies, bit for bit, whatever was asked before and whatever other threads do.
pub struct ArmPlanner {
    pub(crate) context: PlanningContext,
    leaving: Leaving,
    paths: ApproachPaths,
    intermediate: Intermediate,
    smoother: Smoother,
    effort: PlanEffort,
    endless: EndlessJoints,
}

/// A failure, and how far the arm could still go: off what it was on or around.
struct Setback {
    failure: Failure,
    way_out: Option<Vec<Vec<f64>>>,
}

impl From<Failure> for Setback {
    fn from(failure: Failure) -> Self {
        Self { failure, way_out: None }
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
        let (endless, model) = EndlessJoints::of(model);
        let context = PlanningContext::new(model, kinematics, options)?;
        Ok(Self {
            leaving: Leaving::new(&context.options),
            paths: ApproachPaths::new(&context.options),
            intermediate: Intermediate::new(&context.options),
            smoother: Smoother::new(&context.model, &context.options),
            effort: PlanEffort::default(),
            endless,
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

    /// A handle that ends a running [`ArmPlanner::solve`] from another thread. It stays raised until lowered.
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
        context.scene.forget_allowed_contacts()?;
        context.scene.set_padding(context.options.padding)?;
        context.scene.grow_roadmap(milestones, seed, &context.options.search, &context.cancel)
    }

    /// What the planner is doing, for another thread to look at.
    pub(crate) fn stage(&self) -> StageCell {
        self.context.stage.clone()
    }

    /// What the last [`ArmPlanner::solve`] took.
    pub fn effort(&self) -> &PlanEffort {
        &self.effort
    }

    /// Answers `request`. Never fails otherwise than by the status of the reply.
    pub fn solve(&mut self, request: &PlanRequest) -> PlanReply {
        let (begin, cpu_begin) = (Instant::now(), thread_cpu_secs());
        self.context.deadline =
            self.context.options.deadline_secs.map(|secs| begin + Duration::from_secs_f64(secs));
        self.context.scene.effort = SearchEffort::default();
        let reply = match self.endless.near_zero(request) {
            Some((near, taken)) => {
                let mut reply = self.reply(&near);
                EndlessJoints::put_back(&mut reply, &taken);
                reply
            }
            None => self.reply(request),
        };
        self.context.stage.set(PlanStage::Idle);
        let timed_out = self.context.is_out_of_time();
        self.effort = PlanEffort {
            request: request.id,
            status: reply.status,
            reason: reply.reason.clone(),
            clearance: reply.clearance,
            iterations: self.context.scene.effort.iterations,
            state_checks: self.context.scene.effort.state_checks,
            wall_secs: begin.elapsed().as_secs_f64(),
            cpu_secs: thread_cpu_secs() - cpu_begin,
            timed_out: timed_out || self.context.scene.effort.timed_out,
        };
        reply
    }

    fn reply(&mut self, request: &PlanRequest) -> PlanReply {
        if request.held.is_empty() { self.answer(request) } else { solve_part(self, request) }
    }

    /// The answer to a request that holds no joint.
    pub(crate) fn answer(&mut self, request: &PlanRequest) -> PlanReply {
        let id = request.id;
        match self.solve_inner(request) {
            Ok((Timed { trajectory, clearance }, shortfall)) => {
                let status = if shortfall.is_some() { PlanStatus::Intermediate } else { PlanStatus::Ok };
                PlanReply { id, status, trajectory, reason: shortfall.unwrap_or_default(), clearance }
            }
            Err(failure) => PlanReply::without_a_way(id, failure.status, failure.reason),
        }
    }

    fn solve_inner(&mut self, request: &PlanRequest) -> Result<(Timed, Option<String>), Failure> {
        let problem = Problem::accept(&mut self.context, request)?;
        // Where the usual clearance is not to be had, a narrower way, looked at more finely, is better than none.
        let mut first: Option<Setback> = None;
        for attempt in Attempt::all(&self.context.options) {
            self.context.attempt = attempt;
            match self.solve_with_clearance(&problem) {
                Ok(plan) if plan.1.is_none() || first.is_none() => return Ok(plan),
                Ok(_) => break,
                Err(setback) => {
                    let again = could_do_with_less_clearance(setback.failure.status);
                    if setback.failure.status == PlanStatus::Cancelled {
                        return Err(setback.failure);
                    }
                    first = first.or(Some(setback));
                    if !again {
                        break;
                    }
                }
            }
        }
        [self.context.attempt, ..] = Attempt::all(&self.context.options);
        let Some(setback) = first else { return Err(Failure::out_of_time()) };
        match setback.way_out {
            // No way on, but a way out of the box: from up there another base or another try may reach.
            Some(points) => {
                let end = points.len() - 1;
                let route = Route { points, curved: [end, end], searched: self.context.attempt.transit };
                Ok((self.smoother.timed(&mut self.context, &route, 0.0)?, Some(setback.failure.reason)))
            }
            None => Err(setback.failure),
        }
    }

    fn solve_with_clearance(&mut self, problem: &Problem) -> Result<(Timed, Option<String>), Setback> {
        self.context.stage.set(PlanStage::Leaving);
        let mut path = self.leaving.path(&mut self.context, problem)?;
        self.context.stage.set(PlanStage::SeekingGoals);
        let left = path.len() - 1;
        let from = path[left].clone();
        let (found, shortfall) = match self.path_on(problem, &from) {
            Ok(found) => found,
            Err(failure) => {
                let moved = from != problem.start && failure.status != PlanStatus::Cancelled;
                return Err(Setback { failure, way_out: moved.then_some(path) });
            }
        };
        path.extend(found.points.into_iter().skip(1));
        let mut path = BlendedPath::new(path, [left, left + found.entry]);
        let transit = self.context.attempt.transit;
        path.widen(&mut self.context, transit)?;
        // Paths to compare with stay as OMPL simplifies them.
        if self.context.options.search.equal_steps.is_none() {
            refine(&mut self.context, problem, &self.paths, found.aim.as_ref(), &mut path)?;
        }
        let route = path.route(transit);
        let (context, smoother) = (&mut self.context, &self.smoother);
        context.go_on()?;
        context.stage.set(PlanStage::Smoothing);
        let timed = smoother.timed(context, &route, 0.0)?;
        Ok((widened(context, problem, smoother, &route, timed)?, shortfall))
    }

    /// From `from` to the goal, or with the reason for falling short to a point on the way.
    fn path_on(&mut self, problem: &Problem, from: &[f64]) -> Result<(Connection, Option<String>), Failure> {
        let failure = match self.paths.find(&mut self.context, problem, from) {
            Ok(paths) => return Ok((self.search(problem, from, &paths)?, None)),
            Err(failure) if failure.status == PlanStatus::Unreachable => failure,
            Err(failure) => return Err(failure),
        };
        let way = self.intermediate.find(&mut self.context, problem, from).map_err(|other| {
            // Nothing useful on the way either: the first reason is the one that helps.
            if other.status == PlanStatus::Cancelled { other } else { failure.clone() }
        })?;
        Ok((way, Some(failure.reason)))
    }

    /// To one of `paths`, best first: to one where the hand has room to open, if any of these can be got to.
    fn search(
        &mut self,
        problem: &Problem,
        from: &[f64],
        paths: &[ApproachPath],
    ) -> Result<Connection, Failure> {
        let roomy = paths.partition_point(|path| !path.cramped);
        if (1..paths.len()).contains(&roomy) {
            match Connection::search(&mut self.context, problem, from, &paths[..roomy]) {
                Err(failure) if failure.status == PlanStatus::NoPlan && self.context.go_on().is_ok() => {}
                other => return other,
            }
        }
        Connection::search(&mut self.context, problem, from, paths)
    }
}

fn could_do_with_less_clearance(status: PlanStatus) -> bool {
    matches!(status, PlanStatus::StartInCollision | PlanStatus::GoalInCollision | PlanStatus::NoPlan)
}
