//! From a request to a reply: the start is left, ways to the goal are found, a search connects the two.

use crate::chain::Chain;
use crate::effort::{PlanEffort, PlanStage, StageCell, thread_cpu_secs};
use crate::error::check;
use crate::reach::Limits;
use crate::timing::MotionLimits;
use crate::ways::Way;
use crate::{
    CancelFlag, CollisionScene, MeshObstacle, PlannerOptions, PlanningError, Roadmap, SearchEffort,
    SearchLimits, SearchOutcome,
};
use proact_control::ports::ArmKinematics;
use proact_types::{
    ArmModel, AttachedObject, Obstacle, PlanGoal, PlanReply, PlanRequest, PlanStatus, Pose, Trajectory,
    Vector,
};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Plans motions of one arm: what it holds depends on nothing but the model and the options, so equal requests
/// get equal replies, bit for bit, whatever was asked before and whatever other threads do.
pub struct ArmPlanner {
    pub(crate) model: Arc<ArmModel>,
    pub(crate) kinematics: Box<dyn ArmKinematics + Send>,
    pub(crate) chain: Chain,
    pub(crate) scene: CollisionScene,
    pub(crate) limits: Limits,
    pub(crate) options: PlannerOptions,
    pub(crate) cancel: CancelFlag,
    pub(crate) attempt: Attempt,
    meshes: Vec<MeshObstacle>,
    /// When the present request must have been answered.
    deadline: Option<Instant>,
    stage: StageCell,
    effort: PlanEffort,
    pub(crate) motion_limits: MotionLimits,
}

/// Why there is no full plan.
#[derive(Clone, Debug)]
pub(crate) struct Failure {
    pub status: PlanStatus,
    pub reason: String,
}

impl Failure {
    pub fn new(status: PlanStatus, reason: impl Into<String>) -> Self {
        Self { status, reason: reason.into() }
    }
}

impl From<PlanningError> for Failure {
    fn from(error: PlanningError) -> Self {
        Self::new(PlanStatus::Invalid, error.to_string())
    }
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

/// A request in the planner's own terms.
pub(crate) struct Problem<'a> {
    pub request: &'a PlanRequest,
    pub base_from_world: Pose,
    /// The start, inside the joint limits.
    pub start: Vec<f64>,
    /// Straight up, base frame.
    pub up: Vector,
}

/// A path from where the start was left to the goal.
pub(crate) struct Connection {
    pub points: Vec<Vec<f64>>,
    /// Index of the point at which the straight way into the goal begins.
    pub entry: usize,
}

/// What one attempt at a request keeps to.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Attempt {
    /// Free space around everything in transit, metres.
    transit: f64,
    /// Free space on the straight ways, metres.
    contact: f64,
    /// Batches of postures from which ways to the goal are sought.
    pub batches: usize,
}

/// How much room the next questions to the scene leave.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Room {
    /// The full padding, everything is an obstacle.
    Transit,
    /// Close to things that are meant to be approached.
    Contact,
}

/// Largest overshoot of a joint limit at the start that is taken for noise of the measurement, rad.
const LIMIT_SLACK: f64 = 0.05;
/// Batches of postures with the usual room, a narrow one and next to none.
const BATCHES: [usize; 3] = [3, 6, 35];
/// Room of the last attempt, metres: what rounding and the search for arm angles may stray.
const NEXT_TO_NONE: f64 = 2e-5;
/// Finest half step between checked states, metres.
const SMALLEST_HALF_STEP: f64 = 0.00025;

impl ArmPlanner {
    /// A planner for `model`. `kinematics` is that of the same arm: base to tip of the model.
    ///
    /// # Errors
    /// Options that make no sense, a model that the scene refuses, kinematics with another number of joints.
    pub fn new(
        model: Arc<ArmModel>,
        mut kinematics: Box<dyn ArmKinematics + Send>,
        options: PlannerOptions,
    ) -> Result<Self, PlanningError> {
        options.validate()?;
        let mut scene = CollisionScene::new(&model)?;
        scene.set_roadmap(options.roadmap.as_deref())?;
        if kinematics.joint_count() != model.arm.len() {
            return Err(PlanningError::WrongLength {
                what: "the kinematic chain",
                got: kinematics.joint_count(),
                expected: model.arm.len(),
            });
        }
        let chain = Chain::new(&model, &mut *kinematics)?;
        let arm = || model.arm.iter().map(|&j| &model.joints[j].limits);
        let limits =
            Limits { lower: arm().map(|l| l.lower).collect(), upper: arm().map(|l| l.upper).collect() };
        let motion_limits = MotionLimits {
            velocity: arm()
                .map(|l| {
                    if l.velocity > 0.0 { l.velocity.min(options.max_velocity) } else { options.max_velocity }
                })
                .collect(),
            acceleration: arm().map(|_| options.max_acceleration).collect(),
        };
        let [attempt, ..] = attempts(&options);
        let cancel = CancelFlag::new();
        Ok(Self {
            model,
            kinematics,
            chain,
            scene,
            limits,
            options,
            cancel,
            attempt,
            meshes: Vec::new(),
            motion_limits,
            deadline: None,
            stage: StageCell::default(),
            effort: PlanEffort::default(),
        })
    }

    /// The arm that is planned for.
    pub fn model(&self) -> &ArmModel {
        &self.model
    }

    /// The settings in force.
    pub fn options(&self) -> &PlannerOptions {
        &self.options
    }

    /// A handle that ends a running [`ArmPlanner::solve`] from another thread. It stays raised until lowered.
    pub fn cancel_flag(&self) -> CancelFlag {
        self.cancel.clone()
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
        self.set_scene(hand, obstacles, attached, world_from_base)?;
        self.scene.set_padding(0.0)?;
        self.scene.collisions(q)
    }

    /// Meshes that stand in the way of every request, beside its own obstacles.
    ///
    /// # Errors
    /// A mesh without triangles, with a vertex that is not finite or a triangle that names none, a name used twice.
    pub fn set_meshes(&mut self, meshes: Vec<MeshObstacle>) -> Result<(), PlanningError> {
        self.scene.set_obstacles_and_meshes(&[], &meshes)?;
        self.meshes = meshes;
        Ok(())
    }

    /// Grows a roadmap of so many milestones among `obstacles`, with the usual padding: for [`PlannerOptions::roadmap`].
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
        self.set_scene(hand, obstacles, None, world_from_base)?;
        self.scene.forget_allowed_contacts()?;
        self.scene.set_padding(self.options.padding)?;
        self.scene.grow_roadmap(milestones, seed, &self.options.search, &self.cancel)
    }

    /// What the planner is doing, for another thread to look at.
    pub(crate) fn stage(&self) -> StageCell {
        self.stage.clone()
    }

    /// What the last [`ArmPlanner::solve`] took.
    pub fn effort(&self) -> &PlanEffort {
        &self.effort
    }

    /// Goes on unless a cancel or the deadline says otherwise.
    pub(crate) fn go_on(&self) -> Result<(), Failure> {
        if self.cancel.is_raised() {
            return Err(cancelled());
        }
        if self.deadline.is_some_and(|deadline| Instant::now() >= deadline) {
            return Err(out_of_time());
        }
        Ok(())
    }

    /// Answers `request`. Never fails otherwise than by the status of the reply.
    pub fn solve(&mut self, request: &PlanRequest) -> PlanReply {
        let (begin, cpu_begin) = (Instant::now(), thread_cpu_secs());
        self.deadline = self.options.deadline_secs.map(|secs| begin + Duration::from_secs_f64(secs));
        self.scene.effort = SearchEffort::default();
        let reply = self.reply(request);
        self.stage.set(PlanStage::Idle);
        let timed_out = self.deadline.is_some_and(|deadline| Instant::now() >= deadline);
        self.effort = PlanEffort {
            request: request.id,
            status: reply.status,
            iterations: self.scene.effort.iterations,
            state_checks: self.scene.effort.state_checks,
            wall_secs: begin.elapsed().as_secs_f64(),
            cpu_secs: thread_cpu_secs() - cpu_begin,
            timed_out: timed_out || self.scene.effort.timed_out,
        };
        reply
    }

    fn reply(&mut self, request: &PlanRequest) -> PlanReply {
        let (status, trajectory, reason) = match self.solve_inner(request) {
            Ok((path, None)) => (PlanStatus::Ok, path, String::new()),
            Ok((path, Some(reason))) => (PlanStatus::Intermediate, path, reason),
            Err(failure) => (failure.status, Trajectory::default(), failure.reason),
        };
        PlanReply { id: request.id, status, trajectory, reason }
    }

    fn solve_inner(&mut self, request: &PlanRequest) -> Result<(Trajectory, Option<String>), Failure> {
        let problem = self.accept(request)?;
        // Where the usual room is not to be had, a narrower way, looked at more finely, is better than none.
        let mut first: Option<Setback> = None;
        for attempt in attempts(&self.options) {
            self.attempt = attempt;
            match self.solve_with_room(&problem) {
                Ok(plan) if plan.1.is_none() || first.is_none() => return Ok(plan),
                Ok(_) => break,
                Err(setback) => {
                    let again = could_do_with_less_room(setback.failure.status);
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
        [self.attempt, ..] = attempts(&self.options);
        let Some(setback) = first else { return Err(out_of_time()) };
        match setback.way_out {
            // No way on, but a way out of the box: from up there another base or another try may reach.
            Some(path) => {
                let end = path.len() - 1;
                Ok((self.timed(&path, end, end)?, Some(setback.failure.reason)))
            }
            None => Err(setback.failure),
        }
    }

    fn solve_with_room(&mut self, problem: &Problem) -> Result<(Trajectory, Option<String>), Setback> {
        self.stage.set(PlanStage::Leaving);
        let mut path = self.leave(problem)?;
        self.stage.set(PlanStage::SeekingGoals);
        let left = path.len() - 1;
        let from = path[left].clone();
        let (found, shortfall) = match self.way_on(problem, &from) {
            Ok(found) => found,
            Err(failure) => {
                let moved = from != problem.start && failure.status != PlanStatus::Cancelled;
                return Err(Setback { failure, way_out: moved.then_some(path) });
            }
        };
        let entered = left + found.entry;
        path.extend(found.points.into_iter().skip(1));
        self.go_on()?;
        self.stage.set(PlanStage::Smoothing);
        Ok((self.timed(&path, left, entered)?, shortfall))
    }

    /// From `from` to the goal, or with the reason for falling short to a point on the way.
    fn way_on(&mut self, problem: &Problem, from: &[f64]) -> Result<(Connection, Option<String>), Failure> {
        let failure = match self.ways_to_goal(problem, from) {
            Ok(ways) => return Ok((self.connect(problem, from, &ways)?, None)),
            Err(failure) if failure.status == PlanStatus::Unreachable => failure,
            Err(failure) => return Err(failure),
        };
        let way = self.way_to_intermediate(problem, from).map_err(|other| {
            // Nothing useful on the way either: the first reason is the one that helps.
            if other.status == PlanStatus::Cancelled { other } else { failure.clone() }
        })?;
        Ok((way, Some(failure.reason)))
    }

    /// Checks the request and puts its scene up.
    fn accept<'a>(&mut self, request: &'a PlanRequest) -> Result<Problem<'a>, Failure> {
        let joints = self.model.arm.len();
        check("start", &request.start, joints)?;
        match &request.goal {
            PlanGoal::Pick { centre, .. } => check("block centre", centre.coords.as_slice(), 3)?,
            PlanGoal::Place { point } => {
                check("place", point.coords.as_slice(), 3)?;
                if request.attached.is_none() {
                    return Err(Failure::new(PlanStatus::Invalid, "There is nothing in the hand to place."));
                }
            }
            PlanGoal::Joints { q } => check("goal", q, joints)?,
            PlanGoal::TipPose { pose } => {
                let p = pose.translation.vector;
                let r = pose.rotation.coords;
                check("goal pose", &[p.x, p.y, p.z, r.x, r.y, r.z, r.w], 7)?;
            }
        }
        self.set_scene(
            &request.hand,
            &request.obstacles,
            request.attached.as_ref(),
            &request.world_from_base,
        )?;
        if let Some(carried) = &request.attached
            && request.obstacles.iter().any(|o| o.name == carried.name)
        {
            let reason = format!("{} is both in the hand and in the way.", carried.name);
            return Err(Failure::new(PlanStatus::Invalid, reason));
        }
        if !self.limits.contain(&request.start, LIMIT_SLACK) {
            return Err(Failure::new(PlanStatus::Invalid, "The start is outside the joint limits."));
        }
        let base_from_world = request.world_from_base.inverse();
        let up = base_from_world.rotation * Vector::z();
        Ok(Problem { request, base_from_world, start: self.limits.clamp(&request.start), up })
    }

    fn set_scene(
        &mut self,
        hand: &[f64],
        obstacles: &[Obstacle],
        attached: Option<&AttachedObject>,
        world_from_base: &Pose,
    ) -> Result<(), PlanningError> {
        self.scene.set_base(world_from_base)?;
        self.scene.set_hand(hand)?;
        self.scene.set_obstacles_and_meshes(obstacles, &self.meshes)?;
        self.scene.set_attached(attached)
    }

    /// Sets how much room the next questions leave, and withdraws allowed contacts.
    pub(crate) fn set_room(&mut self, room: Room) -> Result<(), PlanningError> {
        self.scene.forget_allowed_contacts()?;
        self.scene.set_padding(match room {
            Room::Transit => self.attempt.transit,
            Room::Contact => self.attempt.contact,
        })
    }

    /// Bounds of a search that keeps `padding`: what hides between two checked states must not be deeper.
    fn limits_with(&self, padding: f64) -> SearchLimits {
        let step = 2.0 * padding.max(SMALLEST_HALF_STEP);
        let usual = self.options.search;
        SearchLimits { step_metres: usual.step_metres.min(step), ..usual }
    }

    /// Bounds of questions about motions in transit of the present attempt.
    pub(crate) fn limits_of_transit(&self) -> SearchLimits {
        self.limits_with(self.attempt.transit)
    }

    /// Bounds of questions about the straight ways of the present attempt.
    pub(crate) fn limits_of_contact(&self) -> SearchLimits {
        self.limits_with(self.attempt.contact)
    }

    /// True if the present attempt leaves next to no room, so that what is to be run must itself be looked at.
    pub(crate) fn is_tight(&self) -> bool {
        self.attempt.contact <= NEXT_TO_NONE
    }

    /// Lets the whole hand and what it carries touch `obstacle`.
    pub(crate) fn allow_hand(&mut self, obstacle: &str, problem: &Problem) -> Result<(), PlanningError> {
        let model = self.model.clone();
        for link in &model.links {
            self.scene.allow_contact(&link.name, obstacle)?;
        }
        match &problem.request.attached {
            Some(object) => self.scene.allow_contact(&object.name, obstacle),
            None => Ok(()),
        }
    }

    /// A path from `from` along one of `ways`, to its end.
    pub(crate) fn connect(
        &mut self,
        problem: &Problem,
        from: &[f64],
        ways: &[Way],
    ) -> Result<Connection, Failure> {
        self.set_room(Room::Transit)?;
        let goals: Vec<Vec<f64>> = ways.iter().map(|w| w.points[0].clone()).collect();
        self.stage.set(PlanStage::Searching);
        let mut limits = self.limits_of_transit();
        if let Some(deadline) = self.deadline {
            let left = deadline.saturating_duration_since(Instant::now()).as_secs_f64().max(1e-3);
            limits.max_secs = Some(limits.max_secs.map_or(left, |secs| secs.min(left)));
        }
        let seed = problem.request.seed;
        let (planner, parameters) = (self.options.planner, &self.options.planner_parameters);
        match self.scene.search_by(planner, parameters, from, &goals, seed, &limits, &self.cancel)? {
            SearchOutcome::Solved { path: mut points, goal } => {
                let entry = points.len() - 1;
                points.extend(ways[goal].points.iter().skip(1).cloned());
                Ok(Connection { points, entry })
            }
            SearchOutcome::NoPlan if self.scene.effort.timed_out => Err(out_of_time()),
            SearchOutcome::NoPlan => Err(Failure::new(
                PlanStatus::NoPlan,
                format!("No way to the goal was found in {} iterations.", limits.max_iterations),
            )),
            SearchOutcome::StartInCollision => {
                Err(Failure::new(PlanStatus::StartInCollision, "The arm starts too close to something."))
            }
            SearchOutcome::GoalsInCollision => {
                Err(Failure::new(PlanStatus::GoalInCollision, "The arm would touch something at the goal."))
            }
            SearchOutcome::Cancelled => Err(cancelled()),
        }
    }
}

/// The usual room, then a narrow one, then next to none.
fn attempts(options: &PlannerOptions) -> [Attempt; 3] {
    let contact = options.contact_padding.min(options.padding);
    let none = contact.min(NEXT_TO_NONE);
    let rooms = [(options.padding, options.contact_padding), (contact, contact), (none, none)];
    std::array::from_fn(|k| Attempt { transit: rooms[k].0, contact: rooms[k].1, batches: BATCHES[k] })
}

fn could_do_with_less_room(status: PlanStatus) -> bool {
    matches!(status, PlanStatus::StartInCollision | PlanStatus::GoalInCollision | PlanStatus::NoPlan)
}

fn out_of_time() -> Failure {
    Failure::new(PlanStatus::NoPlan, "No way to the goal was found in time.")
}

/// The reply's words for a cancel.
pub(crate) fn cancelled() -> Failure {
    Failure::new(PlanStatus::Cancelled, "The request was cancelled.")
}
