use crate::ports::ArmKinematics;
use crate::{
    ControlInput, ControlMethod, ControlOutput, HandCommand, MotionCommand, MotionState, PlanCommand, Shown,
    ToggleLocksProfile,
};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use proact_arm::{ArmModel, Chain, ChainPoses};
use proact_types::{
    Gesture, MethodEvent, ObjectId, PlanGoal, PlanReply, PlanStatus, PlannerView, Point, Pose, SimTime,
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
    gesture: Gesture,
    holds: Option<ObjectId>,
    closed: bool,
    pick_locked: bool,
    place_locked: bool,
    block: ObjectId,
    place: Point,
    drive: Drive,
}

#[derive(Clone, Debug)]
enum Drive {
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
            gesture: Gesture::NoMotion,
            holds: None,
            closed: false,
            pick_locked: false,
            place_locked: true,
            block: ObjectId(0),
            place: Point::origin(),
            drive: Drive::Idle,
        }
    }

    /// Origin of the second arm joint's link in `world`: the original's shoulder point.
    fn shoulder(&self, input: &ControlInput<'_>) -> Point {
        let mut poses = ChainPoses::default();
        self.chain.place(input.measured, &mut poses);
        input.world_from_base * poses.links.get(1).map_or(Point::origin(), |link| link * Point::origin())
    }

    /// The hand's heading by which a two-link arm reaches `point` from `shoulder`; NaN where it does not.
    fn heading(&self, point: &Point, shoulder: &Point) -> f64 {
        let rules = &self.rules;
        let away = point - shoulder;
        let (x, y, z) = (-away.y, away.x, -away.z);
        let (reach, bearing) = (x.hypot(y), y.atan2(x));
        let beta = (rules.elbow_drop_m / rules.upper_m).asin();
        let gamma = ((z - rules.upper_m * beta.sin()) / rules.fore_m).asin();
        let (m1, m2) = (rules.upper_m * beta.cos(), rules.fore_m * gamma.cos());
        let phi = ((reach * reach + m2 * m2 - m1 * m1) / (2.0 * reach * m2)).acos();
        phi + bearing - FRAC_PI_2
    }

    /// The constant orientation of a grasp with its heading replaced.
    fn orientation(&self, heading: f64) -> UnitQuaternion<f64> {
        let [w, x, y, z] = self.rules.grasp_wxyz;
        let (roll, pitch, _) = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).euler_angles();
        UnitQuaternion::from_euler_angles(roll, pitch, heading)
    }

    /// `world_from_tip` at the grasp of `block`.
    fn pick_pose(&self, block: &Point, shoulder: &Point) -> Pose {
        let heading = self.heading(block, shoulder);
        let (sin, cos) = (heading - FRAC_PI_2).sin_cos();
        let back = self.rules.back_off_m * Vector3::new(cos, sin, 0.0);
        let position = block.coords - back + Vector3::z() * self.rules.pick_height_m;
        Pose::from_parts(position.into(), self.orientation(heading))
    }

    /// `world_from_tip` that brings the block in hand over the place. `tip_from_block` is its centre in the tip.
    fn place_pose(&self, place: &Point, shoulder: &Point, tip_from_block: &Vector3<f64>) -> Pose {
        let orientation = self.orientation(self.heading(place, shoulder));
        let block = place.coords + Vector3::z() * self.rules.place_height_m;
        Pose::from_parts((block - orientation * tip_from_block).into(), orientation)
    }

    fn request(
        &mut self,
        input: &ControlInput<'_>,
        kinematics: &mut dyn ArmKinematics,
        output: &mut ControlOutput,
    ) {
        let shoulder = self.shoulder(input);
        let pose = match self.holds {
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
        self.drive = match pose {
            Ok(pose) if finite(&pose) => {
                output.plan = Some(PlanCommand::Request(PlanGoal::TipPose { pose }));
                Drive::Planning
            }
            Ok(_) => Drive::Failed {
                status: PlanStatus::Unreachable,
                reason: "the two-link arm does not reach the target: its heading is not a number".to_owned(),
            },
            Err(reason) => Drive::Failed { status: PlanStatus::Invalid, reason },
        };
    }

    /// Follows grasp events: a block taken or lost.
    fn follow_grasp(&mut self, input: &ControlInput<'_>, output: &mut ControlOutput) {
        let held = std::mem::replace(&mut self.holds, input.hand.holds);
        if held.is_some() && self.holds.is_none() {
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
        match self.gesture {
            Gesture::HandClose if !self.closed => {
                self.closed = true;
                output.hand = Some(HandCommand::Close);
            }
            Gesture::HandOpen if self.closed => {
                self.closed = false;
                output.hand = Some(HandCommand::Open);
            }
            Gesture::HandClose | Gesture::HandOpen => {}
            Gesture::WristFlexion => {
                let (lock, block) = match self.holds {
                    None => {
                        self.pick_locked = !self.pick_locked;
                        self.block = input.highlight.filter(|_| self.pick_locked).unwrap_or(self.block);
                        (self.pick_locked, Some(self.block))
                    }
                    Some(_) => {
                        self.place_locked = !self.place_locked;
                        self.place = if self.place_locked { input.place } else { self.place };
                        (self.place_locked, None)
                    }
                };
                output.events.push(if lock {
                    MethodEvent::Locked { object: block }
                } else {
                    MethodEvent::Unlocked
                });
            }
            Gesture::WristExtension => self.request(input, kinematics, output),
            Gesture::NoMotion => {
                match self.drive {
                    Drive::Planning => output.plan = Some(PlanCommand::Cancel),
                    Drive::Following { .. } => {
                        output.motion = Some(MotionCommand::Hold);
                        output.events.push(MethodEvent::MotionStopped);
                    }
                    _ => return,
                }
                self.drive = Drive::Idle;
            }
        }
    }

    /// A plan in force and what became of it.
    fn advance(&mut self, input: &ControlInput<'_>, output: &mut ControlOutput) {
        if let (Drive::Planning, Some(reply)) = (&self.drive, input.plan) {
            self.drive = Self::take_plan(reply, output);
            return;
        }
        if let Drive::Following { intermediate, progress } = &mut self.drive {
            match input.motion {
                MotionState::Following(now) => *progress = now,
                MotionState::Finished => {
                    output.events.push(MethodEvent::MotionFinished);
                    self.drive = Drive::Arrived { intermediate: *intermediate };
                }
                MotionState::Holding => {}
            }
        }
    }

    fn take_plan(reply: &PlanReply, output: &mut ControlOutput) -> Drive {
        match reply.status {
            PlanStatus::Ok | PlanStatus::Intermediate => {
                output.motion = Some(MotionCommand::Follow(reply.trajectory.clone()));
                let intermediate = reply.status == PlanStatus::Intermediate;
                Drive::Following { intermediate, progress: 0.0 }
            }
            status => Drive::Failed { status, reason: reply.reason.clone() },
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
        if std::mem::replace(&mut self.gesture, input.gesture) != input.gesture {
            self.act(input, kinematics, &mut output);
        }
        let live = if self.pick_locked { Some(self.block) } else { input.highlight };
        let target = TargetView {
            object: live.filter(|_| self.holds.is_none()),
            place: Some(if self.place_locked { self.place } else { input.place }),
            locked: if self.holds.is_some() { self.place_locked } else { self.pick_locked },
            posterior: input.posterior.to_vec(),
        };
        output.shown = Shown { mode: None, target, planner: self.planner() };
        output
    }
}

impl GazeToggled {
    fn planner(&self) -> PlannerView {
        match &self.drive {
            Drive::Idle => PlannerView::Idle,
            Drive::Planning => PlannerView::Planning,
            Drive::Following { intermediate, progress } => {
                PlannerView::Executing { progress: *progress, intermediate: *intermediate }
            }
            Drive::Arrived { intermediate } => PlannerView::Arrived { intermediate: *intermediate },
            Drive::Failed { status, reason } => {
                PlannerView::Failed { status: *status, reason: reason.clone() }
            }
        }
    }
}
