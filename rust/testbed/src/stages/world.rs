use crate::{
    GraspAction, GraspDetector, GraspSelector, TestbedError, TrialConfig,
    grasp_failure::GraspFailureDetector,
    ports::{Plant, PlantError},
};
use proact_arm::ArmModel;
use proact_control::{HandCommand, HandStateEstimator};
use proact_types::{
    BodyState, EventKind, HandView, JointVector, ObjectId, PlantCommand, PlantState, Point, Scene, SimTime,
    joints,
};
use std::sync::Arc;

/// Arm, hand, box and blocks: the physics, and the rule by which the hand takes a block and lets it go.
pub struct WorldStage {
    model: Arc<ArmModel>,
    plant: Box<dyn Plant>,
    grasp_detector: GraspDetector,
    grasp_failure_detector: GraspFailureDetector,
    grasp_selector: GraspSelector,
    /// Links of the fingers on the block that is held.
    grasping_links: Vec<String>,
    hand_state_estimator: HandStateEstimator,
    /// Ticks whose contacts were solved inexactly.
    unsolved_ticks: u64,
    contacts_solved: bool,
}

/// What enters the world in one tick.
#[derive(Clone, Copy, Debug)]
pub struct WorldInput<'a> {
    /// Targets of the joints, and where the base goes.
    pub command: &'a PlantCommand,
    /// What the hand was told in this tick.
    pub hand: Option<HandCommand>,
    /// The targets of the hand's joints still move.
    pub hand_moving: bool,
}

/// What the world shows after one tick, beside [`WorldStage::state`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WorldOutput {
    /// The hand, from its joints and from what is attached.
    pub hand: HandView,
    /// The block that was attached while the physics moved, an index in `Scene::blocks`; one that the hand takes in
    /// this tick is not yet.
    pub carried_object: Option<usize>,
    /// Angles of the fingers on a block that was taken in this tick, rad: they stay there.
    pub frozen_fingers: Option<JointVector>,
    /// What happened.
    pub events: Vec<EventKind>,
}

impl WorldStage {
    /// The stage of a trial: `plant` holds the arm at its pose `start` with an open hand, among the objects of `scene`.
    ///
    /// # Errors
    /// An arm without the poses `open` and `closed`, or without those that its grasps name.
    pub fn new(
        config: &TrialConfig,
        model: Arc<ArmModel>,
        scene: &Scene,
        plant: Box<dyn Plant>,
    ) -> Result<Self, TestbedError> {
        Ok(Self {
            grasp_detector: GraspDetector::new(&config.physics, &model),
            grasp_failure_detector: GraspFailureDetector::new(&config.physics, &model),
            grasp_selector: GraspSelector::new(&model, scene)?,
            hand_state_estimator: HandStateEstimator::new(&model)?,
            grasping_links: Vec::new(),
            unsolved_ticks: 0,
            contacts_solved: true,
            plant,
            model,
        })
    }

    /// The physics.
    pub fn plant(&self) -> &dyn Plant {
        self.plant.as_ref()
    }

    /// Joints, base and blocks after the last tick.
    pub fn state(&self) -> &PlantState {
        self.plant.state()
    }

    /// Ticks so far in which the physics met the laws of contact inexactly.
    pub fn unsolved_ticks(&self) -> u64 {
        self.unsolved_ticks
    }

    /// The hand after the last tick.
    pub fn hand(&self) -> HandView {
        let holds = self.plant.state().attached.map(|(object, _)| ObjectId::new(object));
        HandView { state: self.hand_state_estimator.state(), held_object: holds }
    }

    /// Puts a block somewhere, see [`Plant::place_point`].
    ///
    /// # Errors
    /// What the physics refuse; the block is then where it was.
    pub fn place(&mut self, block: usize, body: &BodyState) -> Result<(), PlantError> {
        self.plant.place(block, body)
    }

    /// Puts objects where the rules of the task have them. One whose place is taken stays where it was: the rules see that.
    pub fn rearrange(&mut self, placements: &[(ObjectId, BodyState)]) {
        for (object, body) in placements {
            // Refused where something is in the way.
            let _ = self.plant.place(object.index(), body);
        }
    }

    /// One step of physics under the joint targets, then the grasp rule.
    ///
    /// # Errors
    /// What the physics refuse; the trial cannot go on then.
    pub fn step(&mut self, now: SimTime, input: WorldInput<'_>) -> Result<WorldOutput, TestbedError> {
        let refused = |source| TestbedError::Plant { time: now, source };
        if let Some(command) = input.hand {
            self.hand_state_estimator.set_command(command);
        }
        self.plant.step(input.command).map_err(refused)?;
        let state = self.plant.state();
        let carried = state.attached.map(|(block, _)| block);
        let arm = self.model.arm_count();
        let fingers = &state.position[arm..];
        let hand = self.hand_state_estimator.step(fingers, &state.velocity[arm..], input.hand_moving);
        let action = self.grasp_detector.step(&self.model, state, hand, self.hand_state_estimator.command());
        let mut output = WorldOutput { carried_object: carried, ..WorldOutput::default() };
        let solved = self.plant.contacts_solved();
        self.unsolved_ticks += u64::from(!solved);
        if self.contacts_solved && !solved {
            output.events.push(EventKind::ContactsUnsolved);
        }
        self.contacts_solved = solved;
        let block_position = |block: usize| Point::from(state.objects[block].pose.translation.vector);
        match action {
            Some(GraspAction::Attach(block)) => {
                self.grasping_links = self.grasp_detector.fingers_on(&self.model, &state.contacts, block);
                let (links, block_position) = (self.grasping_links.clone(), block_position(block));
                output.events.push(EventKind::GraspMade {
                    object: ObjectId::new(block),
                    links,
                    place: block_position,
                });
                output.frozen_fingers = Some(joints(fingers));
                self.plant.attach(block, self.model.tip).map_err(refused)?;
            }
            Some(GraspAction::Release) => {
                if let Some(block) = carried {
                    let (links, block_position) =
                        (std::mem::take(&mut self.grasping_links), block_position(block));
                    output.events.push(EventKind::GraspEnded {
                        object: ObjectId::new(block),
                        links,
                        place: block_position,
                    });
                }
                self.plant.release();
            }
            None => {}
        }
        let state = self.plant.state();
        let near = || self.grasp_selector.nearest(state);
        output.events.extend(self.grasp_failure_detector.step(
            input.hand,
            hand,
            &state.contacts,
            state.attached.is_some(),
            near,
        ));
        output.hand = self.hand();
        Ok(output)
    }
}
