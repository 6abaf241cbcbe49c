//! Arm and hand as the trial's stages move them.

use super::super::task_outputs;
use proact_arm::ArmModel;
use proact_control::{HandCommand, MotionCommand};
use proact_testbed::{
    TestbedError, TrialConfig,
    ports::{Plant, PlantError},
    stages::{
        ActuationInput, ActuationOutput, ActuationStage, ExternalTargets, WorldInput, WorldOutput, WorldStage,
    },
};
use proact_types::{
    BodyState, EventKind, HandState, HandView, JointVector, ObjectId, PlantState, Pose, Scene, SimTime,
};
use std::sync::Arc;

/// Makes the physics anew: at the start and for each reset.
pub type PlantFactory = Box<dyn Fn() -> Result<Box<dyn Plant>, PlantError>>;

/// What one tick brought.
#[derive(Default)]
pub(super) struct RobotStep {
    /// The hand has arrived where it was told to go, or holds a block.
    pub hand_rests: bool,
    pub world: WorldOutput,
    pub events: Vec<EventKind>,
}

/// What comes for the next tick.
#[derive(Default)]
struct PendingCommands {
    motion: Option<MotionCommand>,
    hand: Option<HandCommand>,
    shoulder: Option<Pose>,
}

pub(super) struct Robot {
    config: TrialConfig,
    model: Arc<ArmModel>,
    factory: PlantFactory,
    scene: Scene,
    actuation: ActuationStage,
    world: WorldStage,
    pub last_actuation: ActuationOutput,
    frozen_posture: Option<JointVector>,
    pending: PendingCommands,
    /// The number of the method's last command for the arm.
    pub last_command_number: u64,
}

impl Robot {
    pub(super) fn new(
        config: TrialConfig,
        model: Arc<ArmModel>,
        factory: PlantFactory,
        scene: Scene,
    ) -> Result<Self, TestbedError> {
        let plant = factory().map_err(|source| TestbedError::Plant { time: SimTime(0), source })?;
        let actuation = ActuationStage::new(&config, &model, &scene)?;
        let actuation_output = actuation.output();
        Ok(Self {
            world: WorldStage::new(&config, model.clone(), &scene, plant)?,
            actuation,
            last_actuation: actuation_output,
            frozen_posture: None,
            pending: PendingCommands::default(),
            last_command_number: 0,
            config,
            model,
            factory,
            scene,
        })
    }

    pub(super) fn model(&self) -> &Arc<ArmModel> {
        &self.model
    }

    /// The physics after the last tick.
    pub(super) fn state(&self) -> &PlantState {
        self.world.state()
    }

    /// What there is to judge and to tell, with the hand as the world stage has it.
    pub(super) fn world_update(&self, hand: HandView) -> task_outputs::WorldUpdate<'_> {
        task_outputs::WorldUpdate {
            world: self.state(),
            hand,
            actuation: &self.last_actuation,
            last_command_number: self.last_command_number,
        }
    }

    /// A tracked shoulder. The caller has checked that it is finite.
    pub(super) fn set_shoulder(&mut self, world_from_base: Pose) {
        self.pending.shoulder = Some(world_from_base);
    }

    /// A command for the arm, in place of the one before.
    pub(super) fn command_arm(&mut self, command: MotionCommand) {
        self.pending.motion = Some(command);
    }

    /// A command for the hand, in place of the one before.
    pub(super) fn command_hand(&mut self, command: HandCommand) {
        self.pending.hand = Some(command);
    }

    /// Puts a block somewhere.
    pub(super) fn place(&mut self, block: usize, body: &BodyState) -> Result<(), PlantError> {
        self.world.place(block, body)
    }

    /// Puts objects where the rules of the task have them.
    pub(super) fn rearrange(&mut self, placements: &[(ObjectId, BodyState)]) {
        self.world.rearrange(placements);
    }

    /// Puts arm and blocks back to the start.
    pub(super) fn reset(&mut self) -> Result<(), TestbedError> {
        let plant = (self.factory)().map_err(|source| TestbedError::Plant { time: SimTime(0), source })?;
        // The base is where the shoulder is, not where it was at the start.
        let base = self.last_actuation.command.world_from_base;
        self.world = WorldStage::new(&self.config, self.model.clone(), &self.scene, plant)?;
        self.actuation = ActuationStage::new(&self.config, &self.model, &self.scene)?;
        self.last_actuation = self.actuation.output();
        self.frozen_posture = None;
        self.pending = PendingCommands { shoulder: Some(base), ..PendingCommands::default() };
        Ok(())
    }

    /// Tick `now`; `driven` is what the controllers ask for in it.
    pub(super) fn step(&mut self, now: SimTime, driven: ExternalTargets) -> Result<RobotStep, TestbedError> {
        let ExternalTargets { joints, hand: hand_command, hold_hand } = driven;
        let PendingCommands { motion, hand, shoulder } = std::mem::take(&mut self.pending);
        let hand = hand.or(hand_command);
        if hold_hand && hand.is_none() {
            self.frozen_posture =
                Some(proact_types::joints(&self.last_actuation.command.position[self.model.arm_count()..]));
        }
        let input = ActuationInput {
            shoulder,
            motion,
            hand,
            fingers: None,
            frozen_fingers: self.frozen_posture.as_ref(),
            external_targets: &joints,
            world: self.world.state(),
        };
        self.last_actuation = self.actuation.step(now, input);
        let input = WorldInput {
            command: &self.last_actuation.command,
            hand,
            hand_moving: self.last_actuation.hand_moving,
        };
        let world = self.world.step(now, input)?;
        self.frozen_posture = world.frozen_fingers.clone();
        let events = self.last_actuation.events.iter().chain(&world.events).cloned().collect();
        let at_rest = matches!(world.hand.state, HandState::Open | HandState::Closed);
        let hand_rests = world.frozen_fingers.is_some() || (!self.last_actuation.hand_moving && at_rest);
        Ok(RobotStep { hand_rests, world, events })
    }
}
