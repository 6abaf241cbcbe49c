//! From a request to a reply: the start is left, ways to the goal are found, a search connects the two.

use crate::error::check;
use crate::reach::{self, Limits, Reach};
use crate::timing::{Curve, MotionLimits};
use crate::ways::Way;
use crate::{CancelFlag, CollisionScene, PlannerOptions, PlanningError, SearchLimits, SearchOutcome};
use nalgebra::Unit;
use proact_control::ports::ArmKinematics;
use proact_types::{
    ArmModel, AttachedObject, Obstacle, PlanGoal, PlanReply, PlanRequest, PlanStatus, Point, Pose, Shape,
    Trajectory, Vector,
};
use std::sync::Arc;

/// Plans motions of one arm: what it holds depends on nothing but the model and the options, so equal requests
/// get equal replies, bit for bit, whatever was asked before and whatever other threads do.
pub struct ArmPlanner {
    pub(crate) model: Arc<ArmModel>,
    pub(crate) kinematics: Box<dyn ArmKinematics + Send>,
    pub(crate) scene: CollisionScene,
    pub(crate) limits: Limits,
    pub(crate) options: PlannerOptions,
    pub(crate) cancel: CancelFlag,
    motion_limits: MotionLimits,
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

/// A request in the planner's own terms.
pub(crate) struct Problem<'a> {
    pub request: &'a PlanRequest,
    pub base_from_world: Pose,
    /// The start, inside the joint limits.
    pub start: Vec<f64>,
    /// Straight up, base frame.
    pub up: Vector,
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
/// An obstacle whose centre is this close to the grasp centre stands between the fingers, metres.
const IN_HAND: f64 = 0.07;
/// Longest straight way that is tried in order to get clear of contacts at the start, metres.
const LONGEST_LEAVE: f64 = 0.14;
/// Distance of the control points of the smoothed path, rad: it cuts corners by at most a third of this.
const SPACING: f64 = 0.02;

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
        options.validate()?;
        let scene = CollisionScene::new(&model)?;
        if kinematics.joint_count() != model.arm.len() {
            return Err(PlanningError::WrongLength {
                what: "the kinematic chain",
                got: kinematics.joint_count(),
                expected: model.arm.len(),
            });
        }
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
        Ok(Self { model, kinematics, scene, limits, options, cancel: CancelFlag::new(), motion_limits })
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

    /// Answers `request`. Never fails otherwise than by the status of the reply.
    pub fn solve(&mut self, request: &PlanRequest) -> PlanReply {
        let (status, trajectory, reason) = match self.solve_inner(request) {
            Ok((path, None)) => (PlanStatus::Ok, path, String::new()),
            Ok((path, Some(reason))) => (PlanStatus::Intermediate, path, reason),
            Err(failure) => (failure.status, Trajectory::default(), failure.reason),
        };
        PlanReply { id: request.id, status, trajectory, reason }
    }

    fn solve_inner(&mut self, request: &PlanRequest) -> Result<(Trajectory, Option<String>), Failure> {
        let problem = self.accept(request)?;
        let mut path = self.leave(&problem)?;
        let from = path[path.len() - 1].clone();
        let (rest, shortfall) = match self.ways_to_goal(&problem, &from) {
            Ok(ways) => (self.connect(&problem, &from, &ways)?, None),
            Err(failure) if failure.status == PlanStatus::Unreachable => {
                let way = self.way_to_intermediate(&problem, &from).map_err(|other| {
                    // Nothing useful on the way either: the first reason is the one that helps.
                    if other.status == PlanStatus::Cancelled { other } else { failure.clone() }
                })?;
                (way, Some(failure.reason))
            }
            Err(failure) => return Err(failure),
        };
        path.extend(rest.into_iter().skip(1));
        if self.cancel.is_raised() {
            return Err(cancelled());
        }
        Ok((self.timed(&path), shortfall))
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
        self.scene.set_obstacles(obstacles)?;
        self.scene.set_attached(attached)
    }

    /// Sets how much room the next questions leave, and withdraws allowed contacts.
    pub(crate) fn set_room(&mut self, room: Room) -> Result<(), PlanningError> {
        self.scene.forget_allowed_contacts()?;
        self.scene.set_padding(match room {
            Room::Transit => self.options.padding,
            Room::Contact => self.options.contact_padding,
        })
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

    /// From the start to where the search may begin: straight up while the hand is around a block, touches
    /// something, or carries an object that stands on the table; otherwise the start alone.
    fn leave(&mut self, problem: &Problem) -> Result<Vec<Vec<f64>>, Failure> {
        let request = problem.request;
        let mut path = vec![request.start.to_vec()];
        if problem.start != path[0] {
            path.push(problem.start.clone());
        }
        self.set_room(Room::Transit)?;
        let touching = self.scene.collisions(&problem.start)?;
        let base_from_tip = self.kinematics.forward(&problem.start).map_err(PlanningError::from)?;
        let world_from_tip = request.world_from_base * base_from_tip;
        let grasp_centre = Point::from(self.model.grasp_centre);
        let world_grasp = world_from_tip * grasp_centre;
        let around_block = request.attached.is_none()
            && request.obstacles.iter().any(|o| {
                (o.pose.translation.vector - world_grasp.coords).norm() < IN_HAND && thickness(&o.shape) < 0.1
            });
        let carries = matches!(request.goal, PlanGoal::Place { .. });
        if touching.is_empty() && !around_block && !carries {
            return Ok(path);
        }
        self.refuse_deep_contact(problem)?;

        // What is touched at the start may go on being touched on the way up; all else is kept clear of.
        let grazed: Vec<String> = request
            .obstacles
            .iter()
            .filter(|o| touching.iter().any(|(_, b)| *b == o.name) || (around_block && near(o, &world_grasp)))
            .map(|o| o.name.clone())
            .collect();
        let (point, wanted) = match &request.attached {
            Some(object) => {
                (Point::from(object.tip_from_object.translation.vector), self.options.lift_height)
            }
            None => (grasp_centre, if around_block { self.options.retreat_height } else { 0.0 }),
        };
        let mut best: Option<Vec<Vec<f64>>> = None;
        for direction in ways_out(&problem.up, &base_from_tip) {
            let reach = Reach {
                point,
                axis: base_from_tip.rotation.inverse() * problem.up,
                target: base_from_tip * point,
                direction: problem.up,
            };
            let along = direction * wanted.max(LONGEST_LEAVE);
            let line = reach::line(&mut *self.kinematics, &self.limits, &reach, &along, &problem.start)?;
            let (free, covered) = self.clear_part(problem, &line, &grazed, &touching, wanted)?;
            let better = best.as_ref().is_none_or(|b| free.len() > b.len());
            if !free.is_empty() && better {
                best = Some(free);
            }
            if covered {
                break;
            }
        }
        match best {
            Some(line) => {
                path.extend(line.into_iter().skip(1));
                Ok(path)
            }
            None => {
                let (a, b) = touching.first().cloned().unwrap_or_default();
                Err(Failure::new(
                    PlanStatus::StartInCollision,
                    format!("The arm touches something and finds no straight way off it: {a} and {b}."),
                ))
            }
        }
    }

    /// The part of a way out from its start to the first point, at least `wanted` metres on, that is clear for
    /// transit; if there is none that far, to the last clear one. The flag says that `wanted` was covered.
    fn clear_part(
        &mut self,
        problem: &Problem,
        line: &[Vec<f64>],
        grazed: &[String],
        touching: &[(String, String)],
        wanted: f64,
    ) -> Result<(Vec<Vec<f64>>, bool), Failure> {
        let mut clear_at = None;
        let enough = reach::line_steps(wanted.max(LONGEST_LEAVE)) as f64 * wanted / wanted.max(LONGEST_LEAVE);
        for (k, q) in line.iter().enumerate() {
            if self.cancel.is_raised() {
                return Err(cancelled());
            }
            self.set_room(Room::Contact)?;
            for name in grazed {
                self.allow_hand(name, problem)?;
            }
            let hits = self.scene.collisions(q)?;
            if hits.iter().any(|pair| !touching.contains(pair)) {
                break;
            }
            self.set_room(Room::Transit)?;
            if self.scene.is_free(q)? {
                clear_at = Some(k);
                if k as f64 >= enough - 1e-9 {
                    return Ok((line[..=k].to_vec(), true));
                }
            }
        }
        Ok((clear_at.map_or_else(Vec::new, |k| line[..=k].to_vec()), false))
    }

    /// A start that is farther inside an obstacle than a graze is refused: pulling a hand out of a wall is no
    /// plan. Obstacles too thin to tell are left to the way out.
    fn refuse_deep_contact(&mut self, problem: &Problem) -> Result<(), Failure> {
        let depth = self.options.graze_depth;
        self.scene.set_padding(-depth)?;
        let deep = self.scene.collisions(&problem.start)?.into_iter().find(|(_, b)| {
            let obstacle = problem.request.obstacles.iter().find(|o| o.name == *b);
            obstacle.is_some_and(|o| thickness(&o.shape) > 2.2 * depth)
        });
        match deep {
            Some((a, b)) => Err(Failure::new(
                PlanStatus::StartInCollision,
                format!("The arm starts deep inside something: {a} and {b}."),
            )),
            None => Ok(()),
        }
    }

    /// A path from `from` along one of `ways`, to its end.
    pub(crate) fn connect(
        &mut self,
        problem: &Problem,
        from: &[f64],
        ways: &[Way],
    ) -> Result<Vec<Vec<f64>>, Failure> {
        self.set_room(Room::Transit)?;
        let goals: Vec<Vec<f64>> = ways.iter().map(|w| w.points[0].clone()).collect();
        let limits: SearchLimits = self.options.search;
        match self.scene.search(from, &goals, problem.request.seed, &limits, &self.cancel)? {
            SearchOutcome::Solved { mut path, goal } => {
                path.extend(ways[goal].points.iter().skip(1).cloned());
                Ok(path)
            }
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

    fn timed(&self, path: &[Vec<f64>]) -> Trajectory {
        match Curve::along(path, SPACING) {
            Some(curve) => curve.timed(&self.motion_limits),
            // Already there: a trajectory of one point says so.
            None => Trajectory {
                points: vec![proact_types::TrajectoryPoint {
                    time_secs: 0.0,
                    q: proact_types::joints(&path[0]),
                    qd: proact_types::zeros(path[0].len()),
                }],
            },
        }
    }
}

/// The reply's words for a cancel.
pub(crate) fn cancelled() -> Failure {
    Failure::new(PlanStatus::Cancelled, "The request was cancelled.")
}

/// Directions in which a contact may be left, base frame: straight up first, then up and back towards the
/// person, then up and off the palm.
fn ways_out(up: &Vector, base_from_tip: &Pose) -> Vec<Vector> {
    let back = -base_from_tip.translation.vector;
    let level = back - up * up.dot(&back);
    let palm = base_from_tip.rotation * (Vector::z() + Vector::y());
    [Some(*up), blend(up, &level), blend(up, &palm)].into_iter().flatten().collect()
}

fn blend(up: &Vector, aside: &Vector) -> Option<Vector> {
    let aside = Unit::try_new(*aside, 1e-6)?;
    Unit::try_new(up + 0.7 * aside.into_inner(), 1e-6).map(Unit::into_inner)
}

fn near(obstacle: &Obstacle, point: &Point) -> bool {
    (obstacle.pose.translation.vector - point.coords).norm() < IN_HAND
}

/// Smallest extent of a shape, metres.
pub(crate) fn thickness(shape: &Shape) -> f64 {
    match *shape {
        Shape::Box { size } => size[0].min(size[1]).min(size[2]),
        Shape::Sphere { radius } => 2.0 * radius,
        Shape::Cylinder { radius, length } => (2.0 * radius).min(length),
        Shape::Capsule { radius, .. } => 2.0 * radius,
    }
}
