use crate::ports::ArmKinematics;
use crate::{
    ControlInput, ControlMethod, ControlOutput, HandCommand, MethodDisplay, MotionCommand, MotionState,
    PlanCommand, ToggleLocksProfile,
};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use proact_arm::{ArmModel, Chain, ChainPoses};
use proact_types::{
    Command, MethodEvent, ObjectId, PlanGoal, PlanReply, PlanStatus, PlannerView, Point, Pose, SimTime,
    TargetView,
};
use std::f64::consts::FRAC_PI_2;

/// Methods C and D as the original's `pick_place.cpp` has them, for comparisons.
///
/// Kept: gestures act when they change; WF toggles a lock for blocks and one for places, the latter on from the
/// start with the origin of `world`; WE goes to what was locked last (the first object before that); NM alone stops; the hand's
/// state is what was commanded, and losing a block commands the hand open; goals come from a two-link arm of wrong
/// lengths, without approach or descent; the end of an intermediate plan ends the motion.
///
/// Not kept, because in doubt the arm stops: planning and the hand block no other gesture, so NM cancels a plan in
/// the making, and a plan that arrives late moves nothing. A goal out of the two-link arm's reach is NaN in the
/// original and fails eight times in silence; here it is refused with the reason. Other gestures than NM leave a plan
/// in the making alone, as the motion. The sequence of fall-back goals is the planner's.
#[derive(Clone, Debug)]
pub struct GazeToggled {
    rules: ToggleLocksProfile,
    chain: Chain,
    command: Command,
    held_object: Option<ObjectId>,
    closed: bool,
    pick_locked: bool,
    place_locked: bool,
    block: ObjectId,
    place: Point,
    motion_phase: ToggledMotionPhase,
}

#[derive(Clone, Debug)]
enum ToggledMotionPhase {
    Idle,
    Planning,
    Following { intermediate: bool, progress: f64 },
    Arrived { intermediate: bool },
    Failed { status: PlanStatus, reason: String },
}

impl GazeToggled {
    /// A method for the arm `model`.
    pub fn new(rules: ToggleLocksProfile, model: &ArmModel) -> Self {
        Self {
            rules,
            chain: Chain::new(model),
            command: Command::NoMotion,
            held_object: None,
            closed: false,
            pick_locked: false,
            place_locked: true,
            block: ObjectId(0),
            place: Point::origin(),
            motion_phase: ToggledMotionPhase::Idle,
        }
    }

    /// Origin of the second arm joint's link in `world`: the original's shoulder point.
    fn shoulder(&self, input: &ControlInput<'_>) -> Point {
        let mut poses = ChainPoses::default();
        self.chain.link_poses_into(input.measured, &mut poses);
        input.world_from_base * poses.links.get(1).map_or(Point::origin(), |link| link * Point::origin())
    }

    /// The hand's heading by which a two-link arm reaches `point` from `shoulder`; NaN where it does not.
    fn heading(&self, point: &Point, shoulder: &Point) -> f64 {
        let rules = &self.rules;
        let away = point - shoulder;
        let (x, y, z) = (-away.y, away.x, -away.z);
        let (reach, bearing) = (x.hypot(y), y.atan2(x));
        let beta = (rules.elbow_drop_m / rules.upper_arm_length_m).asin();
        let gamma = ((z - rules.upper_arm_length_m * beta.sin()) / rules.forearm_length_m).asin();
        let (m1, m2) = (rules.upper_arm_length_m * beta.cos(), rules.forearm_length_m * gamma.cos());
        let phi = ((reach * reach + m2 * m2 - m1 * m1) / (2.0 * reach * m2)).acos();
        phi + bearing - FRAC_PI_2
    }

    /// The constant orientation of a grasp with its heading replaced.
    fn orientation(&self, heading: f64) -> UnitQuaternion<f64> {
        let [w, x, y, z] = self.rules.grasp_orientation_wxyz;
        let (roll, pitch, _) = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).euler_angles();
        UnitQuaternion::from_euler_angles(roll, pitch, heading)
    }

    /// `world_from_tip` at the grasp of `block`.
    fn pick_pose(&self, block: &Point, shoulder: &Point) -> Pose {
        let heading = self.heading(block, shoulder);
        let (sin, cos) = (heading - FRAC_PI_2).sin_cos();
        let back = self.rules.standoff_m * Vector3::new(cos, sin, 0.0);
        let position = block.coords - back + Vector3::z() * self.rules.pick_height_m;
        Pose::from_parts(position.into(), self.orientation(heading))
    }

    /// `world_from_tip` that brings the block in hand over the place. `tip_from_block` is its centre in the tip.
    fn place_pose(&self, place_point: &Point, shoulder: &Point, tip_from_block: &Vector3<f64>) -> Pose {
        let orientation = self.orientation(self.heading(place_point, shoulder));
        let block = place_point.coords + Vector3::z() * self.rules.place_height_m;
        Pose::from_parts((block - orientation * tip_from_block).into(), orientation)
    }

    fn request_plan(
        &mut self,
        input: &ControlInput<'_>,
        kinematics: &mut dyn ArmKinematics,
        output: &mut ControlOutput,
    ) {
        let shoulder = self.shoulder(input);
        let pose = match self.held_object {
            None => Ok(self.pick_pose(&input.objects[self.block.index()], &shoulder)),
            Some(held) => {
                kinematics.forward(input.measured).map_err(|e| e.to_string()).map(|base_from_tip| {
                    let world_from_tip = input.world_from_base * base_from_tip;
                    let tip_from_block = world_from_tip.inverse_transform_point(&input.objects[held.index()]);
                    self.place_pose(&self.place, &shoulder, &tip_from_block.coords)
                })
            }
        };
        let finite = |pose: &Pose| {
            pose.translation.vector.iter().chain(pose.rotation.coords.iter()).all(|v| v.is_finite())
        };
        self.motion_phase = match pose {
            Ok(pose) if finite(&pose) => {
                output.plan = Some(PlanCommand::Request(PlanGoal::TipPose { pose }));
                ToggledMotionPhase::Planning
            }
            Ok(_) => ToggledMotionPhase::Failed {
                status: PlanStatus::Unreachable,
                reason: "the two-link arm does not reach the target: its heading is not a number".to_owned(),
            },
            Err(reason) => ToggledMotionPhase::Failed { status: PlanStatus::Invalid, reason },
        };
    }

    /// Follows grasp events: a block taken or lost.
    fn follow_grasp(&mut self, input: &ControlInput<'_>, output: &mut ControlOutput) {
        let held = std::mem::replace(&mut self.held_object, input.hand.held_object);
        if held.is_some() && self.held_object.is_none() {
            self.closed = false;
            output.hand = Some(HandCommand::Open);
        }
    }

    fn act(
        &mut self,
        input: &ControlInput<'_>,
        kinematics: &mut dyn ArmKinematics,
        output: &mut ControlOutput,
    ) {
        match self.command {
            Command::HandClose if !self.closed => {
                self.closed = true;
                output.hand = Some(HandCommand::Close);
            }
            Command::HandOpen if self.closed => {
                self.closed = false;
                output.hand = Some(HandCommand::Open);
            }
            Command::HandClose | Command::HandOpen => {}
            Command::WristFlexion => {
                let (lock, block) = match self.held_object {
                    None => {
                        self.pick_locked = !self.pick_locked;
                        self.block = input.highlight.filter(|_| self.pick_locked).unwrap_or(self.block);
                        (self.pick_locked, Some(self.block))
                    }
                    Some(_) => {
                        self.place_locked = !self.place_locked;
                        self.place = if self.place_locked { input.place_point } else { self.place };
                        (self.place_locked, None)
                    }
                };
                output.events.push(if lock {
                    MethodEvent::Locked { object: block }
                } else {
                    MethodEvent::Unlocked
                });
            }
            Command::WristExtension => self.request_plan(input, kinematics, output),
            Command::NoMotion => {
                match self.motion_phase {
                    ToggledMotionPhase::Planning => output.plan = Some(PlanCommand::Cancel),
                    ToggledMotionPhase::Following { .. } => {
                        output.motion = Some(MotionCommand::Hold);
                        output.events.push(MethodEvent::MotionStopped);
                    }
                    _ => return,
                }
                self.motion_phase = ToggledMotionPhase::Idle;
            }
        }
    }

    /// A plan in force and what became of it.
    fn advance(&mut self, input: &ControlInput<'_>, output: &mut ControlOutput) {
        if let (ToggledMotionPhase::Planning, Some(reply)) = (&self.motion_phase, input.plan) {
            self.motion_phase = Self::take_plan(reply, output);
            return;
        }
        if let ToggledMotionPhase::Following { intermediate, progress } = &mut self.motion_phase {
            match input.motion {
                MotionState::Following(now) => *progress = now,
                MotionState::Finished => {
                    output.events.push(MethodEvent::MotionFinished);
                    self.motion_phase = ToggledMotionPhase::Arrived { intermediate: *intermediate };
                }
                MotionState::Holding => {}
            }
        }
    }

    fn take_plan(reply: &PlanReply, output: &mut ControlOutput) -> ToggledMotionPhase {
        match reply.status {
            PlanStatus::Ok | PlanStatus::Intermediate => {
                output.motion = Some(MotionCommand::Follow(reply.trajectory.clone()));
                let intermediate = reply.status == PlanStatus::Intermediate;
                ToggledMotionPhase::Following { intermediate, progress: 0.0 }
            }
            status => ToggledMotionPhase::Failed { status, reason: reply.reason.clone() },
        }
    }
}

impl ControlMethod for GazeToggled {
    fn step(
        &mut self,
        _now: SimTime,
        input: &ControlInput<'_>,
        kinematics: &mut dyn ArmKinematics,
    ) -> ControlOutput {
        let mut output = ControlOutput::default();
        self.follow_grasp(input, &mut output);
        self.advance(input, &mut output);
        if std::mem::replace(&mut self.command, input.command) != input.command {
            self.act(input, kinematics, &mut output);
        }
        let live = if self.pick_locked { Some(self.block) } else { input.highlight };
        let target = TargetView {
            object: live.filter(|_| self.held_object.is_none()),
            place: Some(if self.place_locked { self.place } else { input.place_point }),
            locked: if self.held_object.is_some() { self.place_locked } else { self.pick_locked },
            posterior: input.posterior.to_vec(),
        };
        output.display = MethodDisplay { mode: None, target, planner: self.planner_view() };
        output
    }
}

impl GazeToggled {
    fn planner_view(&self) -> PlannerView {
        match &self.motion_phase {
            ToggledMotionPhase::Idle => PlannerView::Idle,
            ToggledMotionPhase::Planning => PlannerView::Planning,
            ToggledMotionPhase::Following { intermediate, progress } => {
                PlannerView::Executing { progress: *progress, intermediate: *intermediate }
            }
            ToggledMotionPhase::Arrived { intermediate } => {
                PlannerView::Arrived { intermediate: *intermediate }
            }
            ToggledMotionPhase::Failed { status, reason } => {
                PlannerView::Failed { status: *status, reason: reason.clone() }
            }
        }
    }
}
