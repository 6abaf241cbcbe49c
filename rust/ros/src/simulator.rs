//! Arm, box and blocks under the controllers of ros_control: what Gazebo was to the original.

use crate::controllers::{Controllers, Ending};
use proact_control::{HandCommand, HandTracker};
use proact_tasks::BoxAndBlocks;
use proact_testbed::{
    BaseMotion, Grasp, GraspAction, GraspRuleName, HandMotion, TestbedError,
    ports::{Plant, PlantError},
};
use proact_types::{
    ArmModel, BlockId, Event, EventKind, HandView, JointVector, PlantCommand, PlantState, Pose, SimTime,
    joints,
};
use std::sync::Arc;

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
    rule: GraspRuleName,
    grasp: Grasp,
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
            rule: GraspRuleName::default(),
            grasp: Grasp::new(GraspRuleName::default(), &model),
            base: BaseMotion::new(base),
            now: SimTime(0),
            blank_task: task.clone(),
            model,
            factory,
            plant,
            task,
        })
    }

    /// The same with another rule for when the hand takes a block and lets it go.
    pub fn with_grasp_rule(mut self, rule: GraspRuleName) -> Self {
        self.rule = rule;
        self.grasp = Grasp::new(rule, &self.model);
        self
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
        self.grasp = Grasp::new(self.rule, &self.model);
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
        let action = self.grasp.step(&self.model, state, hand, self.hand_tracker.command());
        match action {
            Some(GraspAction::Attach(block)) => {
                self.plant.attach(block, self.model.tip)?;
                if let Some(hand) = &mut self.hand {
                    hand.freeze(&fingers);
                }
            }
            Some(GraspAction::Release) => {
                self.plant.release();
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

#[cfg(test)]
mod tests {
    use super::*;
    use proact_tasks::Arrangement;
    use proact_types::{
        BodyState, Contact, Joint, JointKind, JointLimits, Link, NamedPose, Point, Vector, zeros,
    };

    /// A palm with thumb and middle finger.
    fn hand() -> ArmModel {
        let link =
            |name: &str| Link { name: name.into(), inertial: None, collisions: vec![], visuals: vec![] };
        let joint = |child: usize| Joint {
            name: format!("j{child}"),
            kind: JointKind::Revolute,
            parent: 0,
            child,
            origin: Pose::identity(),
            axis: Vector::z(),
            limits: JointLimits { lower: -1.0, upper: 1.0, velocity: 1.0, effort: 1.0 },
            damping: 0.0,
            friction: 0.0,
        };
        let pose = |group: &str, name: &str, angles: &[f64]| NamedPose {
            group: group.into(),
            name: name.into(),
            angles: angles.to_vec(),
        };
        ArmModel {
            name: "hand".into(),
            links: ["palm", "arm__thumb3_link", "arm__middle3_link"].map(link).into(),
            joints: vec![joint(1), joint(2)],
            arm: vec![],
            hand: vec![0, 1],
            tip: 0,
            poses: vec![
                pose("arm", "start", &[]),
                pose("hand", "open", &[0.0, 0.0]),
                pose("hand", "closed", &[0.5, 0.5]),
            ],
            allowed_collisions: vec![],
            grasp_centre: Vector::zeros(),
        }
    }

    /// Physics in which thumb and finger press a block for ever.
    struct Pinched(PlantState);

    impl Plant for Pinched {
        fn step(&mut self, _command: &PlantCommand) -> Result<(), PlantError> {
            Ok(())
        }

        fn state(&self) -> &PlantState {
            &self.0
        }

        fn attach(&mut self, block: usize, _link: usize) -> Result<(), PlantError> {
            self.0.attached = Some((block, Pose::identity()));
            Ok(())
        }

        fn release(&mut self) {
            self.0.attached = None;
        }
    }

    fn pinched(task: &BoxAndBlocks) -> Pinched {
        let still = |pose| BodyState { pose, linear: Vector::zeros(), angular: Vector::zeros() };
        let contact = |link: usize, side: f64| Contact {
            block: 0,
            link,
            point: Point::new(0.0, 0.025 * side, 0.0),
            normal: Vector::y() * -side,
            force: 1.0,
        };
        Pinched(PlantState {
            position: zeros(2),
            velocity: zeros(2),
            effort: zeros(2),
            world_from_base: Pose::identity(),
            blocks: task.scene().blocks.iter().map(|block| still(block.pose)).collect(),
            attached: None,
            contacts: [contact(1, -1.0), contact(2, 1.0)].into_iter().collect(),
            base_held: false,
        })
    }

    #[test]
    fn each_grasp_rule_takes_the_block_in_its_own_time_after_a_reset_too() {
        let task = BoxAndBlocks::new(Arrangement::numbered(1).expect("there are 24"));
        for (rule, expected) in [(GraspRuleName::Opposing, 1..=200), (GraspRuleName::Original, 1250..=1250)] {
            let world = task.clone();
            let factory: PlantFactory = Box::new(move || Ok(Box::new(pinched(&world))));
            let mut sim = Simulator::new(Arc::new(hand()), task.clone(), Pose::identity(), factory)
                .expect("a hand with its poses")
                .with_grasp_rule(rule);
            for _ in 0..2 {
                sim.command_hand(HandCommand::Close).expect("it has the pose");
                let taken = (1..=2000).find(|_| {
                    sim.step().expect("no physics to fail");
                    sim.hand_view().holds.is_some()
                });
                assert!(
                    taken.is_some_and(|tick| expected.contains(&tick)),
                    "{rule:?} took it after {taken:?} ms"
                );
                sim.reset().expect("no physics to fail");
            }
        }
    }
}
