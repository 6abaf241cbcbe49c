//! The person's own limb with methods C and D: it brings the hand near by itself, because what is left of the arm reaches
//! only what is near its end.

use crate::reach::{HandGoal, InternalArmModel};
use proact_arm::ArmModel;
use proact_types::{DisplayFrame, JointVector, ObjectId, Point, Scene, SimTime, Vector, joints};
use std::sync::Arc;

/// The hand passes over walls and partition with its grasp centre this high above the table, metres.
const CARRY_HEIGHT: f64 = 0.26;
/// A hand this near to above where it goes down has arrived there, metres.
const ABOVE_TOLERANCE_M: f64 = 0.03;
/// ... and one this near to where it goes down to, there, metres.
const GOAL_TOLERANCE_M: f64 = 0.008;
/// Joints this near to where they were meant to be are there, rad.
const JOINT_TOLERANCE_RAD: f64 = 0.02;
/// A limb that has not got to where it was meant to be by now is in the way of something, ms.
const LIMB_TIMEOUT_MS: u64 = 1500;
/// An object is let go with its centre this far above where it rests, metres.
const RELEASE_HEIGHT_M: f64 = 0.012;
/// The hand stops so far above the middle of what it is to take: fingers that touch the table leave the planner no way,
/// metres.
const GRASP_OFFSET_M: f64 = 0.012;
/// Movements of the limb at one stage; what is still missing then, it does not reach.
const MAX_ATTEMPTS: u32 = 8;
/// Over how far a way joints go at once, metres: longer ones would be arcs through what stands there.
const MAX_STEP_M: f64 = 0.06;

/// The way of the limb to one object or place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd)]
enum LimbPhase {
    Up,
    Across,
    Down,
    Arrived,
}

/// The person's own joints, and where they go.
pub(super) struct ResidualLimbReach {
    arm_model: InternalArmModel,
    /// Positions among the arm joints.
    own_joints: Vec<usize>,
    target_joints: Option<JointVector>,
    until: SimTime,
    phase: LimbPhase,
    tries: u32,
}

/// What the hand is to be brought to.
#[derive(Clone, Copy, Debug)]
pub(super) struct LimbGoal {
    pub(super) object: ObjectId,
    /// Where it goes, on the table; none while it is to be taken.
    pub(super) place: Option<Point>,
}

impl ResidualLimbReach {
    pub(super) fn new(model: Arc<ArmModel>, own: Vec<usize>) -> Self {
        Self {
            arm_model: InternalArmModel::new(model),
            own_joints: own,
            target_joints: None,
            until: SimTime(0),
            phase: LimbPhase::Up,
            tries: 0,
        }
    }

    /// Where the limb goes, in the joints of the arm, rad.
    pub(super) fn target_joints(&self) -> Option<JointVector> {
        self.target_joints.clone()
    }

    /// Another object or place, or another try: up again first.
    pub(super) fn restart(&mut self) {
        self.phase = LimbPhase::Up;
        self.tries = 0;
    }

    /// Brings the hand to the errand; true once it is there, as near as the limb gets it.
    pub(super) fn move_toward(
        &mut self,
        now: SimTime,
        scene: &Scene,
        seen: &DisplayFrame,
        errand: LimbGoal,
    ) -> bool {
        let count = self.arm_model.joint_count();
        let Some(q) = seen.joints.get(..count) else { return true };
        while self.phase != LimbPhase::Arrived {
            if self.is_moving(now, q) {
                return false;
            }
            let goal = self.hand_goal(scene, seen, errand);
            let here = self.arm_model.forward(q) * goal.point;
            let off = goal.target - here;
            // Arrived, or no nearer by anything that it could do.
            let near =
                off.norm() < if self.phase == LimbPhase::Down { GOAL_TOLERANCE_M } else { ABOVE_TOLERANCE_M };
            self.tries += 1;
            if near || self.tries > MAX_ATTEMPTS || !self.start_step(now, q, &goal, off) {
                self.phase = match self.phase {
                    LimbPhase::Up => LimbPhase::Across,
                    LimbPhase::Across => LimbPhase::Down,
                    LimbPhase::Down | LimbPhase::Arrived => LimbPhase::Arrived,
                };
                self.tries = 0;
                continue;
            }
            return false;
        }
        !self.is_moving(now, q)
    }

    /// Sets off along `off`, one step of the way; false if the limb cannot get nearer.
    fn start_step(&mut self, now: SimTime, q: &[f64], goal: &HandGoal, off: Vector) -> bool {
        let step = HandGoal { target: goal.target - off + off.cap_magnitude(MAX_STEP_M), ..*goal };
        let set = self.own_joints.iter().fold(0, |set, joint| set | 1 << joint);
        let wanted = self.arm_model.inverse(q, &step, set);
        let mut to = self.target_joints.clone().unwrap_or_else(|| joints(q));
        self.own_joints.iter().for_each(|&joint| to[joint] = wanted[joint]);
        let gain = off.norm() - (goal.target - self.arm_model.forward(&wanted) * goal.point).norm();
        if gain < 0.1 * off.norm().min(MAX_STEP_M) {
            return false;
        }
        self.target_joints = Some(to);
        self.until = now.plus_millis(LIMB_TIMEOUT_MS);
        true
    }

    fn is_moving(&self, now: SimTime, q: &[f64]) -> bool {
        let far = |to: &JointVector| {
            self.own_joints.iter().any(|&joint| (to[joint] - q[joint]).abs() > JOINT_TOLERANCE_RAD)
        };
        now < self.until && self.target_joints.as_ref().is_some_and(far)
    }

    /// Where the hand should be now.
    fn hand_goal(&self, scene: &Scene, seen: &DisplayFrame, errand: LimbGoal) -> HandGoal {
        let shape = scene.objects[errand.object.index()].shape;
        let at = |object: ObjectId| Point::from(seen.objects[object.index()].translation.vector);
        let held = seen.hand.held_object.map(|object| {
            let pose = seen.world_from_tip.inv_mul(&seen.objects[object.index()]);
            (Point::from(pose.translation.vector), pose.rotation * Vector::z())
        });
        let width = shape.grip_width();
        let (point, axis) =
            held.unwrap_or_else(|| (self.arm_model.grasp_center(width), self.arm_model.grasp_axis(width)));
        let axis = if (seen.world_from_tip * axis).z < 0.0 { -axis } else { axis };
        let low = errand.place.map_or_else(
            || at(errand.object) + Vector::z() * GRASP_OFFSET_M,
            |place_point| place_point + Vector::z() * (shape.half_height() + RELEASE_HEIGHT_M),
        );
        let here = seen.world_from_tip * point;
        let high = |at: Point| Point::new(at.x, at.y, scene.table_height + CARRY_HEIGHT);
        let world = match self.phase {
            LimbPhase::Up => high(here),
            LimbPhase::Across => high(low),
            LimbPhase::Down | LimbPhase::Arrived => low,
        };
        let base_from_world = seen.world_from_base.inverse();
        HandGoal {
            point,
            axis,
            target: base_from_world * world,
            up: base_from_world * Vector::z(),
            excess_height_weight: 1.0,
            point_tolerance_m: ABOVE_TOLERANCE_M,
            tilt_tolerance_rad: 0.3,
            orientation: None,
        }
    }
}
