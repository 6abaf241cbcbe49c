use crate::{ArmMotion, GraspChoice, HandMotion, JointControl, TestbedError, TrialConfig};
use proact_arm::{ArmModel, Couplings, JointLimits, OPEN_POSE};
use proact_control::{FingerCommand, HandCommand, MotionCommand, MotionState};
use proact_localization::BaseMotion;
use proact_types::{EventKind, JointVector, PlantCommand, PlantState, Pose, Scene, SimTime};

/// From commands to joint targets: the arm's motion, the hand's, and the base that follows the shoulder.
pub struct ActuationStage {
    arm: ArmMotion,
    hand: HandMotion,
    /// What the hand was told last.
    told: HandCommand,
    grasps: GraspChoice,
    base: BaseMotion,
    /// Arm and hand stand still: the base does not follow the shoulder.
    paused: bool,
    couplings: Couplings,
    /// Of the hand joints.
    hand_limits: Vec<JointLimits>,
    /// Single fingers were commanded last: no pose of the hand takes their place.
    by_fingers: bool,
    /// Nobody wears the arm: no tracked shoulder moves it.
    stands: bool,
    /// An arm at rest gives up targets that it does not reach. Gains alone never reach theirs: they would let the arm sink.
    yields: bool,
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
    pub frozen: Option<&'a JointVector>,
    /// Joints that somebody else's controllers drive in this tick; what was commanded before is given up there.
    pub driven: &'a [DrivenJoint],
    /// The world after the tick before.
    pub world: &'a PlantState,
}

/// The target of a joint that somebody else's controller drives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DrivenJoint {
    /// Its place among the moving joints.
    pub joint: usize,
    /// rad, finite.
    pub position: f64,
    /// rad/s, finite.
    pub velocity: f64,
}

/// What somebody else's controllers ask for in one tick, beside the method.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Driven {
    /// Targets of joints.
    pub joints: Vec<DrivenJoint>,
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
            hand: HandMotion::new(open, config.motion.hand_rad_per_s),
            told: HandCommand::Open,
            grasps: GraspChoice::new(model, scene)?,
            base: BaseMotion::new(
                config.setup.body.shoulder_pose(&Default::default()),
                config.motion.shoulder(),
            ),
            paused: false,
            couplings: model.couplings(),
            hand_limits: model.hand.iter().map(|&joint| model.joints[joint].limits).collect(),
            by_fingers: false,
            stands: model.settings.stand.is_some(),
            yields: config.physics.joint_control == JointControl::FeedForward,
        })
    }

    /// One tick.
    pub fn step(&mut self, _now: SimTime, input: ActuationInput<'_>) -> ActuationOutput {
        if let Some(fingers) = input.frozen {
            self.hand.freeze(fingers);
        }
        if let Some(pose) = input.shoulder.filter(|_| !self.stands) {
            self.base.track(pose);
        }
        self.base.step();
        if let Some(command) = input.motion {
            self.arm.apply(command);
        }
        match input.fingers {
            Some(fingers) => self.aim_fingers(fingers, input.hand, input.world),
            None => self.shape_hand(input.hand, input.world),
        }
        let change = self.watch_base(input.world);
        if !self.paused {
            self.arm.step();
            self.hand.step();
            let arm = self.arm.position().len();
            for driven in input.driven {
                match driven.joint.checked_sub(arm) {
                    None => self.arm.drive(driven.joint, driven.position, driven.velocity),
                    Some(joint) => self.hand.drive(&self.couplings, joint, driven.position, driven.velocity),
                }
            }
        }
        if self.yields {
            self.arm.yield_to(&input.world.position[..self.arm.position().len()]);
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
        if self.paused {
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
            hand_moving: self.hand.moving(),
            paused: self.paused,
            events: Vec::new(),
        }
    }

    /// Sends the hand to the pose of the grasp for the object that it is about: on a command, and where an open hand comes
    /// to an object of another grasp.
    fn shape_hand(&mut self, command: Option<HandCommand>, world: &PlantState) {
        self.told = command.unwrap_or(self.told);
        self.by_fingers &= command.is_none();
        if self.by_fingers {
            return;
        }
        match self.told {
            HandCommand::Close if command.is_some() => self.hand.go_to(self.grasps.closed(world)),
            HandCommand::Close => {}
            HandCommand::Open => {
                let open = self.grasps.open(world);
                if command.is_some() || self.hand.goal() != open {
                    self.hand.go_to(open);
                }
            }
        }
    }

    /// Sends each finger where `fingers` says, within its limits; `command` says whether they open or close.
    fn aim_fingers(&mut self, fingers: FingerCommand, command: Option<HandCommand>, world: &PlantState) {
        self.told = command.unwrap_or(self.told);
        self.by_fingers = true;
        match fingers {
            // Fingers stay as they took what they hold: what presses it harder would push it out of the physics' reach.
            FingerCommand::Goto(_) if world.attached.is_some() && self.told == HandCommand::Close => {}
            FingerCommand::Goto(mut angles) if angles.len() == self.hand_limits.len() => {
                for (angle, limits) in angles.iter_mut().zip(&self.hand_limits) {
                    *angle = angle.clamp(limits.lower, limits.upper);
                }
                let mut speeds = angles.clone();
                self.couplings.follow(&mut angles, &mut speeds);
                self.hand.track(angles);
            }
            FingerCommand::Goto(_) | FingerCommand::Hold => self.hand.hold(),
        }
    }

    /// Stops arm and hand while the base does not follow the shoulder.
    fn watch_base(&mut self, world: &PlantState) -> Option<EventKind> {
        let paused = self.base.paused(world.base_held, world.world_from_base);
        if paused == self.paused {
            return None;
        }
        self.paused = paused;
        let way = self.base.goal().translation.vector - world.world_from_base.translation.vector;
        Some(if paused { EventKind::BaseHeld { distance: way.norm() } } else { EventKind::BaseFollows })
    }
}
