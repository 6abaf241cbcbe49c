//! Arm, box and blocks under the controllers of ros_control: what Gazebo was to the original.

use crate::controllers::{Controllers, Ending};
use proact_control::{HandCommand, HandTracker};
use proact_tasks::BoxAndBlocks;
use proact_testbed::{
    BaseMotion, GraspAction, GraspRule, HandMotion, TestbedError,
    ports::{Plant, PlantError},
};
use proact_types::{
    ArmModel, BlockId, Event, EventKind, HandView, JointVector, PlantCommand, PlantState, Pose, SimTime,
    joints,
};
use std::sync::Arc;

/// A finger joint that has opened by this much since the grasp lets the block go, rad.
const OPENED: f64 = 0.01;

/// Makes the physics anew: at the start and for each reset.
pub type PlantFactory = Box<dyn Fn() -> Result<Box<dyn Plant>, PlantError>>;

/// What one tick brought.
#[derive(Clone, Debug, Default)]
pub struct SimOutput {
    /// Goals' trajectories that ended, by controller.
    pub endings: Vec<(String, Ending)>,
    /// Blocks taken and let go, and what the task made of it.
    pub events: Vec<Event>,
    /// The hand has arrived, or stopped at a block, after a command to close or open.
    pub hand_arrived: bool,
}

/// The simulator. Deterministic for the same commands at the same ticks.
pub struct Simulator {
    model: Arc<ArmModel>,
    factory: PlantFactory,
    plant: Box<dyn Plant>,
    blank_task: BoxAndBlocks,
    task: BoxAndBlocks,
    controllers: Controllers,
    hand: Option<HandMotion>,
    hand_tracker: HandTracker,
    grasp: GraspRule,
    grasped_at: Option<JointVector>,
    base: BaseMotion,
    now: SimTime,
}

impl Simulator {
    /// A simulator at time zero. The plants of `factory` hold the arm at its pose `start` with an open hand and the
    /// blocks of `task`.
    ///
    /// # Errors
    /// An arm without the poses `start`, `open` and `closed`; physics that cannot be set up.
    pub fn new(
        model: Arc<ArmModel>,
        task: BoxAndBlocks,
        base: Pose,
        factory: PlantFactory,
    ) -> Result<Self, TestbedError> {
        let start: JointVector =
            model.pose("arm", "start")?.iter().chain(model.pose("hand", "open")?).copied().collect();
        model.pose("hand", "closed")?;
        let plant = factory().map_err(|source| TestbedError::Plant { time: SimTime(0), source })?;
        Ok(Self {
            controllers: Controllers::new(&model, &start),
            hand: None,
            hand_tracker: HandTracker::new(model.pose("hand", "open")?),
            grasp: GraspRule::new(&model),
            grasped_at: None,
            base: BaseMotion::new(base),
            now: SimTime(0),
            blank_task: task.clone(),
            model,
            factory,
            plant,
            task,
        })
    }

    /// The arm.
    pub fn model(&self) -> &Arc<ArmModel> {
        &self.model
    }

    /// The task, which judges where blocks end.
    pub fn task(&self) -> &BoxAndBlocks {
        &self.task
    }

    /// The controllers, to look at.
    pub fn controllers_ref(&self) -> &Controllers {
        &self.controllers
    }

    /// The controllers.
    pub fn controllers(&mut self) -> &mut Controllers {
        &mut self.controllers
    }

    /// The physics after the last tick.
    pub fn state(&self) -> &PlantState {
        self.plant.state()
    }

    /// Ticks so far.
    pub fn now(&self) -> SimTime {
        self.now
    }

    /// The hand.
    pub fn hand_view(&self) -> HandView {
        let held = self.plant.state().attached;
        HandView {
            state: self.hand_tracker.state(),
            holds: held.and_then(|(block, _)| BlockId::ALL.get(block).copied()),
        }
    }

    /// Where the base shall be; it gets there in ten ticks. The caller has checked that it is finite.
    pub fn track(&mut self, world_from_base: Pose) {
        self.base.track(world_from_base);
    }

    /// Closes or opens the hand, from where its joints are asked to be.
    ///
    /// # Errors
    /// An arm without the poses `open` and `closed`; [`Simulator::new`] has looked.
    pub fn command_hand(&mut self, command: HandCommand) -> Result<(), TestbedError> {
        let arm = self.model.arm_count();
        let mut motion =
            HandMotion::new(self.model.pose("hand", "open")?, self.model.pose("hand", "closed")?);
        self.give_hand_back();
        motion.freeze(&self.controllers.position()[arm..]);
        motion.apply(command);
        self.hand_tracker.note(command);
        self.hand = Some(motion);
        Ok(())
    }

    /// Ends [`Simulator::command_hand`]: the hand's controller holds the fingers where they are.
    pub fn give_hand_back(&mut self) {
        let arm = self.model.arm_count();
        if let Some(hand) = self.hand.take() {
            self.controllers.place(arm, hand.position());
        }
        self.controllers.hold_here("hand_controller");
    }

    /// Puts arm and blocks back to the start. Time goes on.
    ///
    /// # Errors
    /// If the physics cannot be set up; the world is then as it was.
    pub fn reset(&mut self) -> Result<(), TestbedError> {
        let time = self.now;
        let plant = (self.factory)().map_err(|source| TestbedError::Plant { time, source })?;
        let start = plant.state().position.clone();
        self.plant = plant;
        self.task = self.blank_task.clone();
        self.controllers = Controllers::new(&self.model, &start);
        self.hand = None;
        self.hand_tracker = HandTracker::new(self.model.pose("hand", "open")?);
        self.grasp = GraspRule::new(&self.model);
        self.grasped_at = None;
        Ok(())
    }

    /// Advances by one tick.
    ///
    /// # Errors
    /// If the physics refuse.
    pub fn step(&mut self) -> Result<SimOutput, TestbedError> {
        self.now = self.now.plus_millis(1);
        let time = self.now;
        let state = self.plant.state();
        let mut output = SimOutput {
            endings: self.controllers.step(time, &state.position, &state.velocity),
            ..SimOutput::default()
        };
        // After a jump of the shoulder the base waits, and in the end goes slowly to where that stays.
        self.base.paused(state.base_held, state.world_from_base);
        self.base.step();

        // The hand's own motion stands in for its controller while it lasts.
        let arm = self.model.arm_count();
        let mut position = self.controllers.position().clone();
        let mut velocity = self.controllers.velocity().clone();
        if let Some(hand) = &mut self.hand {
            hand.step();
            for (k, (q, v)) in hand.position().iter().zip(hand.velocity()).enumerate() {
                position[arm + k] = *q;
                velocity[arm + k] = *v;
            }
        }
        let command = PlantCommand { position, velocity, world_from_base: self.base.pose() };
        let plant = |source| TestbedError::Plant { time, source };
        self.plant.step(&command).map_err(plant)?;
        self.grip(&mut output).map_err(plant)?;

        let held = self.hand_view().holds;
        let judged = self.task.step(time, &self.plant.state().blocks, held);
        output.events.extend(judged.events.into_iter().map(|kind| Event { time, kind }));
        Ok(output)
    }

    fn grip(&mut self, output: &mut SimOutput) -> Result<(), PlantError> {
        let arm = self.model.arm_count();
        let state = self.plant.state();
        let fingers = joints(&state.position[arm..]);
        let moving = self.hand.as_ref().is_some_and(HandMotion::moving);
        let hand = self.hand_tracker.step(&fingers, &state.velocity[arm..], moving);
        let attached = state.attached.map(|(block, _)| block);
        let opened = self.hand_tracker.command() == HandCommand::Open
            && self
                .grasped_at
                .as_ref()
                .is_some_and(|at| at.iter().zip(&fingers).any(|(at, now)| (at - now).abs() > OPENED));
        match self.grasp.step(&state.contacts, hand, attached, opened) {
            Some(GraspAction::Attach(block)) => {
                self.plant.attach(block, self.model.tip)?;
                if let Some(hand) = &mut self.hand {
                    hand.freeze(&fingers);
                }
                self.grasped_at = Some(fingers);
            }
            Some(GraspAction::Release) => {
                self.plant.release();
                self.grasped_at = None;
            }
            None => {}
        }
        // The motion is kept when it has ended: its last angles are what the hand holds.
        let still = !self.hand.as_ref().is_some_and(HandMotion::moving);
        output.hand_arrived = self.hand.is_some() && still;
        Ok(())
    }
}

/// True if an event says that a block was taken or let go.
pub fn is_grasp(kind: &EventKind) -> bool {
    matches!(kind, EventKind::BlockAttached { .. } | EventKind::BlockReleased { .. })
}
