//! Arm and hand as the trial's stages move them, and the controllers of ros_control in front for other people's
//! trajectories.

use crate::controllers::{Controllers, Ending};
use proact_arm::ArmModel;
use proact_control::{HandCommand, MotionCommand};
use proact_testbed::{
    TestbedError, TrialConfig,
    ports::{Plant, PlantError},
    stages::{ActuationInput, ActuationOutput, ActuationStage, WorldInput, WorldOutput, WorldStage},
};
use proact_types::{EventKind, HandState, JointVector, PlantState, Pose, Scene, SimTime};
use std::sync::Arc;

/// Makes the physics anew: at the start and for each reset.
pub type PlantFactory = Box<dyn Fn() -> Result<Box<dyn Plant>, PlantError>>;

/// What one tick brought.
#[derive(Default)]
pub(super) struct Moved {
    /// Goals' trajectories that ended, by controller.
    pub endings: Vec<(String, Ending)>,
    /// The hand has arrived, or stopped at a block, after a command to close or open.
    pub hand_arrived: bool,
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
    pub controllers: Controllers,
    actuation: ActuationStage,
    world: WorldStage,
    pub said: ActuationOutput,
    frozen: Option<JointVector>,
    asked: Asked,
    /// The number of the method's last command for the arm.
    pub acted_on: u64,
    /// A command for the hand that has not ended.
    hand_on_its_way: bool,
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
            controllers: Controllers::new(&model, &said.command.position),
            world: WorldStage::new(&config, model.clone(), &scene, plant)?,
            actuation,
            said,
            frozen: None,
            asked: Asked::default(),
            acted_on: 0,
            hand_on_its_way: false,
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

    /// A tracked shoulder. The caller has checked that it is finite.
    pub(super) fn track(&mut self, world_from_base: Pose) {
        self.asked.shoulder = Some(world_from_base);
    }

    /// A command for the arm, in place of whatever drives it.
    pub(super) fn command_arm(&mut self, command: MotionCommand) {
        self.controllers.let_go(0..self.model.arm_count());
        self.asked.motion = Some(command);
    }

    /// A command for the hand, in place of whatever drives it.
    pub(super) fn command_hand(&mut self, command: HandCommand) {
        self.controllers.let_go(self.model.arm_count()..self.model.moving_count());
        self.asked.hand = Some(command);
        self.hand_on_its_way = true;
    }

    /// The fingers stay where they are asked to be; a command for them is given up.
    pub(super) fn hold_hand(&mut self) {
        self.asked.hand = None;
        self.hand_on_its_way = false;
        self.frozen = Some(proact_types::joints(&self.said.command.position[self.model.arm_count()..]));
    }

    /// Puts arm and blocks back to the start.
    pub(super) fn reset(&mut self) -> Result<(), TestbedError> {
        let plant = (self.factory)().map_err(|source| TestbedError::Plant { time: SimTime(0), source })?;
        // The base is where the shoulder is, not where it was at the start.
        let base = self.said.command.world_from_base;
        self.world = WorldStage::new(&self.config, self.model.clone(), &self.scene, plant)?;
        self.actuation = ActuationStage::new(&self.config, &self.model, &self.scene)?;
        self.said = self.actuation.output();
        self.controllers = Controllers::new(&self.model, &self.said.command.position);
        self.frozen = None;
        self.asked = Asked { shoulder: Some(base), ..Asked::default() };
        self.hand_on_its_way = false;
        Ok(())
    }

    /// Tick `now`.
    pub(super) fn step(&mut self, now: SimTime) -> Result<Moved, TestbedError> {
        let state = self.world.state();
        let endings = self.controllers.step(now, &state.position, &state.velocity);
        let driven = self.controllers.driven();
        let Asked { motion, hand, shoulder } = std::mem::take(&mut self.asked);
        let input = ActuationInput {
            shoulder,
            motion,
            hand,
            frozen: self.frozen.as_ref(),
            driven: &driven,
            world: self.world.state(),
        };
        self.said = self.actuation.step(now, input);
        self.controllers.follow_targets(&self.said.command.position);
        let input = WorldInput { command: &self.said.command, hand, hand_moving: self.said.hand_moving };
        let world = self.world.step(now, input)?;
        self.frozen = world.frozen.clone();
        let events = self.said.events.iter().chain(&world.events).cloned().collect();
        let at_rest = matches!(world.hand.state, HandState::Open | HandState::Closed);
        let still = world.frozen.is_some() || (!self.said.hand_moving && at_rest);
        let hand_arrived = self.hand_on_its_way && still;
        self.hand_on_its_way &= !hand_arrived;
        Ok(Moved { endings, hand_arrived, world, events })
    }
}
