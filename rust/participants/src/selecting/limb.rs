//! The person's own limb with methods C and D: it brings the hand near by itself, because what is left of the arm reaches
//! only what is near its end.

use crate::reach::{ArmSense, HandGoal};
use proact_arm::ArmModel;
use proact_types::{DisplayFrame, JointVector, ObjectId, Point, Scene, SimTime, Vector, joints};
use std::sync::Arc;

/// The hand passes over walls and partition with its grasp centre this high above the table, metres.
const CARRY_HEIGHT: f64 = 0.26;
/// A hand this near to above where it goes down has arrived there, metres.
const ABOVE: f64 = 0.03;
/// ... and one this near to where it goes down to, there, metres.
const AT: f64 = 0.008;
/// Joints this near to where they were meant to be are there, rad.
const THERE: f64 = 0.02;
/// A limb that has not got to where it was meant to be by now is in the way of something, ms.
const MOST_MILLIS: u64 = 1500;
/// An object is let go with its centre this far above where it rests, metres.
const DROP_HEIGHT: f64 = 0.012;
/// The hand stops so far above the middle of what it is to take: fingers that touch the table leave the planner no way,
/// metres.
const GRIP_ABOVE: f64 = 0.012;
/// Movements of the limb at one stage; what is still missing then, it does not reach.
const MOST_TRIES: u32 = 8;
/// Over how far a way joints go at once, metres: longer ones would be arcs through what stands there.
const WAY: f64 = 0.06;

/// The way of the limb to one object or place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd)]
enum Stage {
    Up,
    Across,
    Down,
    There,
}

/// The person's own joints, and where they go.
pub(super) struct OwnLimb {
    sense: ArmSense,
    /// Positions among the arm joints.
    own: Vec<usize>,
    to: Option<JointVector>,
    until: SimTime,
    stage: Stage,
    tries: u32,
}

/// What the hand is to be brought to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Errand {
    pub(super) object: ObjectId,
    /// Where it goes, on the table; none while it is to be taken.
    pub(super) place: Option<Point>,
}

impl OwnLimb {
    pub(super) fn new(model: Arc<ArmModel>, own: Vec<usize>) -> Self {
        Self { sense: ArmSense::new(model), own, to: None, until: SimTime(0), stage: Stage::Up, tries: 0 }
    }

    /// Where the limb goes, in the joints of the arm, rad.
    pub(super) fn to(&self) -> Option<JointVector> {
        self.to.clone()
    }

    /// Another object or place, or another try: up again first.
    pub(super) fn begin(&mut self) {
        self.stage = Stage::Up;
        self.tries = 0;
    }

    /// Brings the hand to the errand; true once it is there, as near as the limb gets it.
    pub(super) fn bring(&mut self, now: SimTime, scene: &Scene, seen: &DisplayFrame, errand: Errand) -> bool {
        let count = self.sense.joint_count();
        let Some(q) = seen.joints.get(..count) else { return true };
        while self.stage != Stage::There {
            if self.under_way(now, q) {
                return false;
            }
            let goal = self.goal(scene, seen, errand);
            let here = self.sense.forward(q) * goal.point;
            let off = goal.target - here;
            // Arrived, or no nearer by anything that it could do.
            let near = off.norm() < if self.stage == Stage::Down { AT } else { ABOVE };
            self.tries += 1;
            if near || self.tries > MOST_TRIES || !self.goes(now, q, &goal, off) {
                self.stage = match self.stage {
                    Stage::Up => Stage::Across,
                    Stage::Across => Stage::Down,
                    Stage::Down | Stage::There => Stage::There,
                };
                self.tries = 0;
                continue;
            }
            return false;
        }
        !self.under_way(now, q)
    }

    /// Sets off along `off`, one step of the way; false if the limb cannot get nearer.
    fn goes(&mut self, now: SimTime, q: &[f64], goal: &HandGoal, off: Vector) -> bool {
        let step = HandGoal { target: goal.target - off + off.cap_magnitude(WAY), ..*goal };
        let set = self.own.iter().fold(0, |set, joint| set | 1 << joint);
        let wanted = self.sense.inverse(q, &step, set);
        let mut to = self.to.clone().unwrap_or_else(|| joints(q));
        self.own.iter().for_each(|&joint| to[joint] = wanted[joint]);
        let gain = off.norm() - (goal.target - self.sense.forward(&wanted) * goal.point).norm();
        if gain < 0.1 * off.norm().min(WAY) {
            return false;
        }
        self.to = Some(to);
        self.until = now.plus_millis(MOST_MILLIS);
        true
    }

    fn under_way(&self, now: SimTime, q: &[f64]) -> bool {
        let far = |to: &JointVector| self.own.iter().any(|&joint| (to[joint] - q[joint]).abs() > THERE);
        now < self.until && self.to.as_ref().is_some_and(far)
    }

    /// Where the hand should be now.
    fn goal(&self, scene: &Scene, seen: &DisplayFrame, errand: Errand) -> HandGoal {
        let shape = scene.objects[errand.object.index()].shape;
        let at = |object: ObjectId| Point::from(seen.objects[object.index()].translation.vector);
        let held = seen.hand.holds.map(|object| {
            let pose = seen.world_from_tip.inv_mul(&seen.objects[object.index()]);
            (Point::from(pose.translation.vector), pose.rotation * Vector::z())
        });
        let width = shape.grip_width();
        let (point, axis) =
            held.unwrap_or_else(|| (self.sense.grasp_centre(width), self.sense.grasp_axis(width)));
        let axis = if (seen.world_from_tip * axis).z < 0.0 { -axis } else { axis };
        let low = errand.place.map_or_else(
            || at(errand.object) + Vector::z() * GRIP_ABOVE,
            |place| place + Vector::z() * (shape.half_height() + DROP_HEIGHT),
        );
        let here = seen.world_from_tip * point;
        let high = |at: Point| Point::new(at.x, at.y, scene.table_height + CARRY_HEIGHT);
        let world = match self.stage {
            Stage::Up => high(here),
            Stage::Across => high(low),
            Stage::Down | Stage::There => low,
        };
        let base_from_world = seen.world_from_base.inverse();
        HandGoal {
            point,
            axis,
            target: base_from_world * world,
            up: base_from_world * Vector::z(),
            high_counts: 1.0,
            point_done: ABOVE,
            tilt_done: 0.3,
            attitude: None,
        }
    }
}
