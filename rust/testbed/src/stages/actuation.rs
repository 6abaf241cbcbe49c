use crate::{ArmMotion, GraspSelector, HandMotion, JointControl, TestbedError, TrialConfig};
use proact_arm::{ArmModel, JointLimits, MimicCouplings, OPEN_POSE};
use proact_control::{FingerCommand, HandCommand, MotionCommand, MotionState};
use proact_localization::ShoulderFilter;
use proact_types::{EventKind, JointVector, PlantCommand, PlantState, Pose, Scene, SimTime};

/// From commands to joint targets: the arm's motion, the hand's, and the base that follows the shoulder.
pub struct ActuationStage {
    arm: ArmMotion,
    hand: HandMotion,
    /// What the hand was told last.
    last_hand_command: HandCommand,
    grasp_selector: GraspSelector,
    base: ShoulderFilter,
    /// Arm and hand stand still: the base does not follow the shoulder.
    is_paused: bool,
    couplings: MimicCouplings,
    /// Of the hand joints.
    hand_limits: Vec<JointLimits>,
    /// Single fingers were commanded last: no pose of the hand takes their place.
    finger_control: bool,
    /// Nobody wears the arm: no tracked shoulder moves it.
    has_fixed_base: bool,
    /// An arm at rest gives up targets that it does not reach. Gains alone never reach theirs: they would let the arm sink.
    releases_unreached_targets: bool,
}

/// What enters actuation in one tick.
#[derive(Clone, Debug)]
pub struct ActuationInput<'a> {
    /// New tracked shoulder pose, `world_from_shoulder`.
    pub shoulder: Option<Pose>,
    /// For the arm, in place of the command before.
    pub motion: Option<MotionCommand>,
    /// For the hand, in place of the command before.
    pub hand: Option<HandCommand>,
    /// For single fingers, in place of the poses that `hand` means.
    pub fingers: Option<FingerCommand>,
    /// Angles of the fingers on a block that was taken in the tick before, rad: they stay there.
    pub frozen_fingers: Option<&'a JointVector>,
    /// Joints that somebody else's controllers drive in this tick; what was commanded before is given up there.
    pub external_targets: &'a [ExternalJointTarget],
    /// The world after the tick before.
    pub world: &'a PlantState,
}

/// The target of a joint that somebody else's controller drives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExternalJointTarget {
    /// Its place among the moving joints.
    pub joint: usize,
    /// rad, finite.
    pub position: f64,
    /// rad/s, finite.
    pub velocity: f64,
}

/// What somebody else's controllers ask for in one tick, beside the method.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ExternalTargets {
    /// Targets of joints.
    pub joints: Vec<ExternalJointTarget>,
    /// For the hand, in place of the command before.
    pub hand: Option<HandCommand>,
    /// The fingers stay where they are asked to be.
    pub hold_hand: bool,
}

/// What is asked of the joints in one tick.
#[derive(Clone, Debug, PartialEq)]
pub struct ActuationOutput {
    /// Targets of all moving joints, and of the base.
    pub command: PlantCommand,
    /// What the arm does.
    pub motion: MotionState,
    /// Arm angles at the end of the path that is followed, rad; none while no path is followed.
    pub goal: Option<JointVector>,
    /// The targets of the hand's joints still move.
    pub hand_moving: bool,
    /// Arm and hand stand still: the tracked shoulder has jumped.
    pub paused: bool,
    /// What happened.
    pub events: Vec<EventKind>,
}

impl ActuationStage {
    /// An arm that holds its pose `start`, with an open hand, at the shoulder of the trial's set-up, among the objects of
    /// `scene`.
    ///
    /// # Errors
    /// An arm without the poses `start`, `open` and `closed`, or without those that its grasps name.
    pub fn new(config: &TrialConfig, model: &ArmModel, scene: &Scene) -> Result<Self, TestbedError> {
        let open = model.pose("hand", OPEN_POSE)?;
        Ok(Self {
            arm: ArmMotion::new(model, model.pose("arm", "start")?),
            hand: HandMotion::new(open, config.motion.hand_rad_per_s, model.hand_per_radian()),
            last_hand_command: HandCommand::Open,
            grasp_selector: GraspSelector::new(model, scene)?,
            base: ShoulderFilter::new(
                config.setup.body.shoulder_pose(&Default::default()),
                config.motion.shoulder(),
            ),
            is_paused: false,
            couplings: model.couplings(),
            hand_limits: model.hand.iter().map(|&joint| model.joints[joint].limits).collect(),
            finger_control: false,
            has_fixed_base: model.settings.fixed_base.is_some(),
            releases_unreached_targets: config.physics.joint_control == JointControl::FeedForward,
        })
    }

    /// One tick.
    pub fn step(&mut self, _now: SimTime, input: ActuationInput<'_>) -> ActuationOutput {
        if let Some(fingers) = input.frozen_fingers {
            self.hand.hold_at(fingers);
        }
        if let Some(pose) = input.shoulder.filter(|_| !self.has_fixed_base) {
            self.base.set_tracked_pose(pose);
        }
        self.base.step();
        if let Some(command) = input.motion {
            self.arm.apply(command);
        }
        match input.fingers {
            Some(fingers) => self.set_finger_targets(fingers, input.hand, input.world),
            None => self.update_hand_target(input.hand, input.world),
        }
        let change = self.watch_base(input.world);
        if !self.is_paused {
            self.arm.step();
            self.hand.step();
            let arm = self.arm.position().len();
            for driven in input.external_targets {
                match driven.joint.checked_sub(arm) {
                    None => self.arm.override_joint(driven.joint, driven.position, driven.velocity),
                    Some(joint) => {
                        self.hand.override_joint(&self.couplings, joint, driven.position, driven.velocity)
                    }
                }
            }
        }
        if self.releases_unreached_targets {
            self.arm.release_unreached_targets(&input.world.position[..self.arm.position().len()]);
        }
        let mut output = self.output();
        output.events.extend(change);
        output
    }

    /// What is asked of the joints now: before the first tick, what they hold.
    pub fn output(&self) -> ActuationOutput {
        let both = |arm: &JointVector, hand: &JointVector| -> JointVector {
            arm.iter().chain(hand).copied().collect()
        };
        let mut velocity = both(self.arm.velocity(), self.hand.velocity());
        if self.is_paused {
            velocity.iter_mut().for_each(|speed| *speed = 0.0);
        }
        ActuationOutput {
            command: PlantCommand {
                position: both(self.arm.position(), self.hand.position()),
                velocity,
                world_from_base: self.base.pose(),
            },
            motion: self.arm.state(),
            goal: self.arm.goal(),
            hand_moving: self.hand.is_moving(),
            paused: self.is_paused,
            events: Vec::new(),
        }
    }

    /// Sends the hand to the pose of the grasp for the object that it is about: on a command, and where an open hand comes
    /// to an object of another grasp.
    fn update_hand_target(&mut self, command: Option<HandCommand>, world: &PlantState) {
        self.last_hand_command = command.unwrap_or(self.last_hand_command);
        self.finger_control &= command.is_none();
        if self.finger_control {
            return;
        }
        match self.last_hand_command {
            HandCommand::Close if command.is_some() => {
                self.hand.go_to(self.grasp_selector.closed_angles(world))
            }
            HandCommand::Close => {}
            HandCommand::Open => {
                let open = self.grasp_selector.open_angles(world);
                if command.is_some() || self.hand.goal() != open {
                    self.hand.go_to(open);
                }
            }
        }
    }

    /// Sends each finger where `fingers` says, within its limits; `command` says whether they open or close.
    fn set_finger_targets(
        &mut self,
        fingers: FingerCommand,
        command: Option<HandCommand>,
        world: &PlantState,
    ) {
        self.last_hand_command = command.unwrap_or(self.last_hand_command);
        self.finger_control = true;
        match fingers {
            // Fingers stay as they took what they hold: what presses it harder would push it out of the physics' reach.
            FingerCommand::Goto(_)
                if world.attached.is_some() && self.last_hand_command == HandCommand::Close => {}
            FingerCommand::Goto(mut angles) if angles.len() == self.hand_limits.len() => {
                for (angle, limits) in angles.iter_mut().zip(&self.hand_limits) {
                    *angle = angle.clamp(limits.lower, limits.upper);
                }
                let mut speeds = angles.clone();
                self.couplings.apply(&mut angles, &mut speeds);
                self.hand.move_joints_to(angles);
            }
            FingerCommand::Goto(_) | FingerCommand::Hold => self.hand.hold(),
        }
    }

    /// Stops arm and hand while the base does not follow the shoulder.
    fn watch_base(&mut self, world: &PlantState) -> Option<EventKind> {
        let paused = self.base.update_pause(world.base_held, world.world_from_base);
        if paused == self.is_paused {
            return None;
        }
        self.is_paused = paused;
        let offset = self.base.tracked_pose().translation.vector - world.world_from_base.translation.vector;
        Some(if paused { EventKind::BaseHeld { distance: offset.norm() } } else { EventKind::BaseFollows })
    }
}
