//! What the participant has before the eyes and knows of the arm, and where the hand should go in it.

use super::{FIRST_AXIS, Stage, obstacles::Obstacles};
use crate::{
    habits::Habits,
    reach::{ArmSense, HandGoal},
};
use proact_types::{DisplayFrame, Moves, ObjectId, Point, Pose, Scene, TrunkPosture, Vector};

/// The hand passes over walls and partition with its grasp centre this high above the table, metres.
const CARRY_HEIGHT: f64 = 0.26;
/// ... and joint by joint it is out of the blocks when its grasp centre is this high above the table: the way over
/// the walls is thought of with what follows, metres.
const CLEAR_HEIGHT: f64 = 0.13;
/// From here the hand goes straight down, metres above the block's centre.
const HOVER_HEIGHT: f64 = 0.11;
/// A block is let go with its centre this far above where it rests, metres.
const DROP_HEIGHT: f64 = 0.012;
/// Joint by joint, a metre that hand or block are too high counts as this many: the hand grips a block above its
/// middle too, and a block may fall a little.
const HIGH_COUNTS: f64 = 0.6;

/// The trunk is thought of for ways up to this long, metres ...
const TRUNK_REACH: f64 = 0.15;
/// ... on which nothing is met deeper than this, metres.
const CLEAR: f64 = 0.003;

/// What is seen, what is known of the arm and of the scene, and the block that all is about.
pub(crate) struct Situation<'a> {
    pub(crate) sense: &'a ArmSense,
    pub(crate) scene: &'a Scene,
    pub(crate) seen: &'a DisplayFrame,
    pub(crate) block: ObjectId,
    /// Where it goes, on the table top.
    pub(crate) target: Point,
}

/// Where the hand should go now.
pub(super) struct Aim {
    pub(super) stage: Stage,
    pub(super) goal: HandGoal,
    /// The joint or axis that is selected, its number of `/mode`.
    pub(super) mode: u8,
}

impl Aim {
    /// True where the method moves the hand along axes, and not joint by joint.
    pub(super) fn by_axis(&self) -> bool {
        self.mode >= FIRST_AXIS
    }

    /// True where the hand only has to get out of the box.
    pub(super) fn goes_up(&self) -> bool {
        matches!(self.stage, Stage::Lift | Stage::Retreat)
    }

    /// True where the hand goes down into the box.
    pub(super) fn goes_down(&self) -> bool {
        matches!(self.stage, Stage::Hover | Stage::Down | Stage::Lower)
    }
}

impl<'a> Situation<'a> {
    /// Angles of the arm, rad; none if the display does not show that many.
    pub(crate) fn arm_angles(&self) -> Option<&'a [f64]> {
        self.seen.joints.get(..self.sense.joints())
    }

    /// How wide the block is for the fingers, metres.
    pub(super) fn width(&self) -> f64 {
        self.scene.objects[self.block.index()].shape.grip_width()
    }

    /// Where the hand is.
    pub(crate) fn base_from_tip(&self) -> Pose {
        self.seen.world_from_base.inv_mul(&self.seen.world_from_tip)
    }

    /// What stands where the hand would go.
    pub(super) fn obstacles(&self) -> Obstacles<'a> {
        Obstacles::new(self.scene, self.seen, self.block, self.sense.fingers(&self.seen.joints))
    }

    /// The posture of the trunk that brings the hand to the `goal` as the arm stands, clear of everything; none if there is
    /// none near, or the hand is there already.
    pub(super) fn by_trunk(&self, goal: &HandGoal, habits: &Habits) -> Option<TrunkPosture> {
        if habits.options.person.body_share <= 0.0 || goal.reached(&self.base_from_tip()) {
            return None;
        }
        let base = &self.seen.world_from_base;
        let here = self.seen.world_from_tip * goal.point;
        let shift = base * goal.target - here;
        if shift.norm() > TRUNK_REACH {
            return None;
        }
        let (moved, posture) = habits.trunk_moves(&here, &shift)?;
        let axis = moved.rotation * (self.seen.world_from_tip.rotation * goal.axis);
        if axis.angle(&(base.rotation * goal.up)) > goal.tilt_done {
            return None;
        }
        let stance = self.sense.stance(self.arm_angles()?);
        let obstacles = self.obstacles();
        let depth = obstacles.depth(base, &stance) + CLEAR;
        let halfway = Pose::identity().lerp_slerp(&moved, 0.5);
        let clear = [halfway, moved].iter().all(|moved| obstacles.depth(&(moved * base), &stance) <= depth);
        clear.then_some(posture)
    }

    /// Where the hand should be at `stage`, leaning toward the shoulder by `lean`, rad.
    pub(crate) fn goal_of(&self, stage: Stage, lean: f64) -> HandGoal {
        let Self { sense, scene, seen, block, target } = self;
        let half = scene.objects[block.index()].shape.half_height();
        let grasp_centre = sense.grasp_centre(self.width());
        let at = |pose: &Pose| Point::from(pose.translation.vector);
        // Not joint by joint: along axes, or by the own limb.
        let by_axis = seen.mode.as_ref().is_none_or(|mode| !matches!(mode.moves, Moves::Joint(_)));
        let standing = at(&seen.objects[block.index()]);
        let high = |point: &Point, height: f64| Point::new(point.x, point.y, scene.table_height + height);
        let over = |point: &Point, height: f64| Point::new(point.x, point.y, point.z + height);
        let tip = &seen.world_from_tip;
        let centre = tip * grasp_centre;
        // Place, how far off the hand may be of it, and of upright.
        let (place, point_done, tilt_done) = match stage {
            Stage::Above => (high(&standing, CARRY_HEIGHT), 0.025, 0.35),
            Stage::Hover => (standing + Vector::z() * HOVER_HEIGHT, 0.012, 0.3),
            Stage::Down | Stage::Grip => (standing, 0.012, 0.3),
            Stage::Lift | Stage::Retreat if by_axis => {
                let height = CARRY_HEIGHT.max(centre.z - scene.table_height);
                (high(&centre, height), 0.04, 1.0)
            }
            Stage::Lift | Stage::Retreat => {
                let height = CLEAR_HEIGHT.max(centre.z - scene.table_height);
                (high(&centre, height), 0.05, 3.2)
            }
            Stage::Carry if by_axis => (high(target, CARRY_HEIGHT), 0.025, 0.4),
            Stage::Carry => (over(target, half + HOVER_HEIGHT), 0.015, 0.4),
            Stage::Lower | Stage::Release => (over(target, half + DROP_HEIGHT), 0.015, 0.3),
        };
        let held = seen.hand.holds.map(|b| tip.inv_mul(&seen.objects[b.index()]));
        let to_shoulder = seen.world_from_base.translation.vector - place.coords;
        let lean = lean.tan();
        let toward = Vector::new(to_shoulder.x, to_shoulder.y, 0.0).try_normalize(1e-6).unwrap_or_default();
        let base_from_world = seen.world_from_base.inverse();
        HandGoal {
            point: held.map_or(grasp_centre, |pose| at(&pose)),
            axis: held.map_or(sense.grasp_axis(self.width()), |pose| {
                let axis = pose.rotation * Vector::z();
                // A block stands on either end.
                if axis.z < 0.0 { -axis } else { axis }
            }),
            target: base_from_world * place,
            up: base_from_world * (Vector::z() + toward * lean).normalize(),
            high_counts: if by_axis { 1.0 } else { HIGH_COUNTS },
            point_done,
            tilt_done,
            attitude: None,
        }
    }
}
