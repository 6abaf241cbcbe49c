//! Arm and hand as the trial's stages move them.

use super::super::judge;
use proact_arm::ArmModel;
use proact_control::{HandCommand, MotionCommand};
use proact_testbed::{
    TestbedError, TrialConfig,
    ports::{Plant, PlantError},
    stages::{ActuationInput, ActuationOutput, ActuationStage, Driven, WorldInput, WorldOutput, WorldStage},
};
use proact_types::{
    BodyState, EventKind, HandState, HandView, JointVector, ObjectId, PlantState, Pose, Scene, SimTime,
};
use std::sync::Arc;

/// Makes the physics anew: at the start and for each reset.
pub type PlantFactory = Box<dyn Fn() -> Result<Box<dyn Plant>, PlantError>>;

/// What one tick brought.
#[derive(Default)]
pub(super) struct Moved {
    /// The hand has arrived where it was told to go, or holds a block.
    pub hand_rests: bool,
    pub world: WorldOutput,
    pub events: Vec<EventKind>,
}

/// What comes for the next tick.
#[derive(Default)]
struct Asked {
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
    pub said: ActuationOutput,
    frozen: Option<JointVector>,
    asked: Asked,
    /// The number of the method's last command for the arm.
    pub acted_on: u64,
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
        let said = actuation.output();
        Ok(Self {
            world: WorldStage::new(&config, model.clone(), &scene, plant)?,
            actuation,
            said,
            frozen: None,
            asked: Asked::default(),
            acted_on: 0,
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
    pub(super) fn moved(&self, hand: HandView) -> judge::Moved<'_> {
        judge::Moved { world: self.state(), hand, actuation: &self.said, acted_on: self.acted_on }
    }

    /// A tracked shoulder. The caller has checked that it is finite.
    pub(super) fn track(&mut self, world_from_base: Pose) {
        self.asked.shoulder = Some(world_from_base);
    }

    /// A command for the arm, in place of the one before.
    pub(super) fn command_arm(&mut self, command: MotionCommand) {
        self.asked.motion = Some(command);
    }

    /// A command for the hand, in place of the one before.
    pub(super) fn command_hand(&mut self, command: HandCommand) {
        self.asked.hand = Some(command);
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
        let base = self.said.command.world_from_base;
        self.world = WorldStage::new(&self.config, self.model.clone(), &self.scene, plant)?;
        self.actuation = ActuationStage::new(&self.config, &self.model, &self.scene)?;
        self.said = self.actuation.output();
        self.frozen = None;
        self.asked = Asked { shoulder: Some(base), ..Asked::default() };
        Ok(())
    }

    /// Tick `now`; `driven` is what the controllers ask for in it.
    pub(super) fn step(&mut self, now: SimTime, driven: Driven) -> Result<Moved, TestbedError> {
        let Driven { joints, hand: asked, hold_hand } = driven;
        let Asked { motion, hand, shoulder } = std::mem::take(&mut self.asked);
        let hand = hand.or(asked);
        if hold_hand && hand.is_none() {
            self.frozen = Some(proact_types::joints(&self.said.command.position[self.model.arm_count()..]));
        }
        let input = ActuationInput {
            shoulder,
            motion,
            hand,
            fingers: None,
            frozen: self.frozen.as_ref(),
            driven: &joints,
            world: self.world.state(),
        };
        self.said = self.actuation.step(now, input);
        let input = WorldInput { command: &self.said.command, hand, hand_moving: self.said.hand_moving };
        let world = self.world.step(now, input)?;
        self.frozen = world.frozen.clone();
        let events = self.said.events.iter().chain(&world.events).cloned().collect();
        let at_rest = matches!(world.hand.state, HandState::Open | HandState::Closed);
        let hand_rests = world.frozen.is_some() || (!self.said.hand_moving && at_rest);
        Ok(Moved { hand_rests, world, events })
    }
}
