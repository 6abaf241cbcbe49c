//! What all parts of the planner work with: the arm, the scene about it, the clearance to keep, and whether to go on.

use crate::axis_ik::ArmJointLimits;
use crate::failure::PlanFailure;
use crate::partial_arm::GoalTolerance;
use crate::plan_stats::SharedPlanStage;
use crate::problem::PlanProblem;
use crate::{CancelFlag, CollisionScene, MeshObstacle, PlannerOptions, PlanningError, SearchLimits};
use proact_arm::{ArmModel, Chain, JointLimits};
use proact_control::ports::ArmKinematics;
use proact_types::{AttachedObject, Obstacle, Pose};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::sync::Arc;
use std::time::Instant;

/// The arm, the scene of the present request, and the bounds of the present attempt at it.
pub(crate) struct PlanningContext {
    pub model: Arc<ArmModel>,
    pub kinematics: Box<dyn ArmKinematics + Send>,
    /// Searching for arm angles asks for its pose and Jacobian some ten thousand times a plan, without a call into a
    /// library.
    pub chain: Chain,
    pub scene: CollisionScene,
    pub limits: ArmJointLimits,
    pub options: PlannerOptions,
    pub attempt: Attempt,
    pub cancel: CancelFlag,
    /// When the present request must have been answered.
    pub deadline: Option<Instant>,
    pub stage: SharedPlanStage,
    meshes: Vec<MeshObstacle>,
    /// How far off a goal the hand may be: of part of an arm.
    pub goal_tolerance: Option<GoalTolerance>,
}

/// What one attempt at a request keeps to.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Attempt {
    /// Free space around everything in transit, metres.
    pub transit_clearance_m: f64,
    /// Free space on the straight paths, metres.
    pub contact_clearance_m: f64,
    /// Batches of postures from which paths to the goal are sought.
    pub seed_batches: usize,
}

/// How much clearance the next questions to the scene leave.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum ClearanceMode {
    /// The full padding, everything is an obstacle.
    Transit,
    /// Close to things that are meant to be approached.
    Contact,
}

/// Batches of postures with the usual clearance, a narrow one and next to none.
const SEED_BATCHES: [usize; 3] = [4, 7, 36];
/// What is searched for keeps so much more than what is wanted of the trajectory, as a share: rounding the corners and
/// averaging over time stray from it.
pub(crate) const BLENDING_MARGIN: f64 = 1.1;
/// Clearance of the last attempt, metres: what rounding and the search for arm angles may stray.
const MINIMAL_CLEARANCE_M: f64 = 2e-5;
/// Largest difference between the planner's chain and the kinematics library that is rounding, metres and rad.
const KINEMATICS_TOLERANCE: f64 = 1e-9;
/// Draws near a posture lie this share of the way from it to draws from the joint ranges: what is found from them is nearer to
/// the start.
const NEAR_START_FRACTION: f64 = 0.4;
/// Finest half step between checked states, metres.
const MIN_HALF_STEP_M: f64 = 0.00025;

impl Attempt {
    /// The usual clearance, then a narrow one, then next to none.
    pub fn all(options: &PlannerOptions) -> [Self; 3] {
        let contact = options.contact_padding_m.min(options.padding_m);
        let none = contact.min(MINIMAL_CLEARANCE_M);
        let usual = (BLENDING_MARGIN * options.padding_m, options.contact_padding_m);
        let clearances = [usual, (contact, contact), (none, none)];
        std::array::from_fn(|k| Self {
            transit_clearance_m: clearances[k].0,
            contact_clearance_m: clearances[k].1,
            seed_batches: SEED_BATCHES[k],
        })
    }
}

impl PlanningContext {
    /// The context of `model`, whose kinematics are `kinematics`, before any request.
    ///
    /// # Errors
    /// Options that make no sense, a model that the scene refuses, kinematics with another number of joints.
    pub fn new(
        model: Arc<ArmModel>,
        mut kinematics: Box<dyn ArmKinematics + Send>,
        options: PlannerOptions,
    ) -> Result<Self, PlanningError> {
        options.check()?;
        crate::scene::check_planner(options.name, &options.parameters)?;
        let scene = CollisionScene::new(&model)?;
        if kinematics.joint_count() != model.arm.len() {
            return Err(PlanningError::WrongLength {
                what: "the kinematic chain",
                got: kinematics.joint_count(),
                expected: model.arm.len(),
            });
        }
        let chain = Chain::new(&model);
        let limits = ArmJointLimits(chain.limits().to_vec());
        check_kinematics(&chain, &limits, &mut *kinematics)?;
        let [attempt, ..] = Attempt::all(&options);
        Ok(Self {
            model,
            kinematics,
            chain,
            scene,
            limits,
            options,
            attempt,
            cancel: CancelFlag::new(),
            deadline: None,
            stage: SharedPlanStage::default(),
            meshes: Vec::new(),
            goal_tolerance: None,
        })
    }

    /// Goes on unless a cancel or the deadline says otherwise.
    pub fn check_interrupt(&self) -> Result<(), PlanFailure> {
        if self.cancel.is_raised() {
            return Err(PlanFailure::cancelled());
        }
        if self.is_out_of_time() {
            return Err(PlanFailure::timed_out());
        }
        Ok(())
    }

    /// True once the present request must have been answered.
    pub fn is_out_of_time(&self) -> bool {
        self.deadline.is_some_and(|deadline| Instant::now() >= deadline)
    }

    /// Puts up what one request is about, meshes included.
    pub fn set_scene(
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

    /// Meshes that stand in the way of every request, beside its own obstacles.
    pub fn set_meshes(&mut self, meshes: Vec<MeshObstacle>) -> Result<(), PlanningError> {
        self.scene.set_obstacles_and_meshes(&[], &meshes)?;
        self.meshes = meshes;
        Ok(())
    }

    /// Meshes that stand in the way of every request.
    pub fn meshes(&self) -> &[MeshObstacle] {
        &self.meshes
    }

    /// Sets how much clearance the next questions leave, and withdraws allowed contacts.
    pub fn set_clearance(&mut self, clearance: ClearanceMode) -> Result<(), PlanningError> {
        self.require_clearance(match clearance {
            ClearanceMode::Transit => self.attempt.transit_clearance_m,
            ClearanceMode::Contact => self.attempt.contact_clearance_m,
        })
    }

    /// The same, with so much free space around everything, metres.
    pub fn require_clearance(&mut self, padding: f64) -> Result<(), PlanningError> {
        self.scene.clear_allowed_contacts()?;
        self.scene.set_padding(padding)
    }

    /// Bound on the time of the next search, seconds.
    pub fn secs_left(&self) -> Option<f64> {
        let left = |deadline: Instant| deadline.saturating_duration_since(Instant::now()).as_secs_f64();
        let until = self.deadline.map(|deadline| left(deadline).max(1e-3));
        [until, self.options.search.max_secs].into_iter().flatten().reduce(f64::min)
    }

    /// Bounds of questions about the straight paths of the present attempt.
    pub fn contact_search_limits(&self) -> SearchLimits {
        self.search_limits_for(self.attempt.contact_clearance_m)
    }

    /// Bounds of a search that keeps `padding`: what hides between two checked states must not be deeper.
    pub fn search_limits_for(&self, padding: f64) -> SearchLimits {
        let step = 2.0 * padding.max(MIN_HALF_STEP_M);
        let usual = self.options.search;
        SearchLimits { step_m: usual.step_m.min(step), ..usual }
    }

    /// True if the present attempt leaves next to no clearance, so that what is to be run must itself be looked at.
    pub fn is_tight(&self) -> bool {
        self.attempt.contact_clearance_m <= MINIMAL_CLEARANCE_M
    }

    /// Arm postures from which hand poses are sought: the present one, draws near it up to the number `near`, then draws from
    /// the joint ranges.
    pub fn ik_seeds(&self, problem: &PlanProblem, from: &[f64], near: usize, count: usize) -> Vec<Vec<f64>> {
        let mut random = ChaCha8Rng::seed_from_u64(problem.request.seed);
        let mut unit = || (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
        let mut postures = vec![from.to_vec()];
        while postures.len() < count {
            let share = if postures.len() < near { NEAR_START_FRACTION } else { 1.0 };
            let draw = |(limits, from): (&JointLimits, &f64)| {
                let drawn = limits.lower + (limits.upper - limits.lower) * unit();
                from + share * (drawn - from)
            };
            postures.push(self.limits.0.iter().zip(from).map(draw).collect());
        }
        postures
    }
}

/// Refuses kinematics of another arm than `chain`: they must put the tip at the same places.
fn check_kinematics(
    chain: &Chain,
    limits: &ArmJointLimits,
    kinematics: &mut dyn ArmKinematics,
) -> Result<(), PlanningError> {
    for share in [0.0, 0.3, 1.0] {
        let q: Vec<f64> = limits.0.iter().map(|l| l.lower + share * (l.upper - l.lower)).collect();
        let (ours, theirs) = (chain.forward(&q), kinematics.forward(&q)?);
        let off = (ours.translation.vector - theirs.translation.vector).norm();
        let agrees =
            off < KINEMATICS_TOLERANCE && ours.rotation.angle_to(&theirs.rotation) < KINEMATICS_TOLERANCE;
        if !agrees {
            return Err(PlanningError::Kinematics("they are of another arm than the model".to_owned()));
        }
    }
    Ok(())
}
