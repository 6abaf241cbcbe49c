//! What the participant has before the eyes and knows of the arm, and where the hand should go in it.

use super::{FIRST_AXIS_MODE, TransferPhase, obstacles::Obstacles};
use crate::{
    reach::{HandGoal, InternalArmModel},
    sensorimotor::SensorimotorModel,
};
use proact_types::{ControlledDof, DisplayFrame, ObjectId, Point, Pose, Scene, TrunkPosture, Vector};

/// The hand passes over walls and partition with its grasp centre this high above the table, metres.
const CARRY_HEIGHT: f64 = 0.26;
/// ... and joint by joint it is out of the blocks when its grasp centre is this high above the table: the way over
/// the walls is thought of with what follows, metres.
const CLEAR_HEIGHT: f64 = 0.13;
/// From here the hand goes straight down, metres above the block's centre.
const HOVER_HEIGHT: f64 = 0.11;
/// A block is let go with its centre this far above where it rests, metres.
const RELEASE_HEIGHT_M: f64 = 0.012;
/// Joint by joint, a metre that hand or block are too high counts as this many: the hand grips a block above its
/// middle too, and a block may fall a little.
const EXCESS_HEIGHT_WEIGHT: f64 = 0.6;

/// The trunk is thought of for ways up to this long, metres ...
const MAX_TRUNK_SHIFT_M: f64 = 0.15;
/// ... on which nothing is met deeper than this, metres.
const MAX_PENETRATION_M: f64 = 0.003;

/// What is seen, what is known of the arm and of the scene, and the block that all is about.
pub(crate) struct DecisionContext<'a> {
    pub(crate) sense: &'a InternalArmModel,
    pub(crate) scene: &'a Scene,
    pub(crate) frame: &'a DisplayFrame,
    pub(crate) block: ObjectId,
    /// Where it goes, on the table top.
    pub(crate) target: Point,
}

/// Where the hand should go now.
pub(super) struct ReachGoal {
    pub(super) phase: TransferPhase,
    pub(super) hand_goal: HandGoal,
    /// The joint or axis that is selected, its number of `/mode`.
    pub(super) selected_mode: u8,
}

impl ReachGoal {
    /// True where the method moves the hand along axes, and not joint by joint.
    pub(super) fn jogs_axes(&self) -> bool {
        self.selected_mode >= FIRST_AXIS_MODE
    }

    /// True where the hand only has to get out of the box.
    pub(super) fn is_retreat(&self) -> bool {
        matches!(self.phase, TransferPhase::Lift | TransferPhase::Retreat)
    }

    /// True where the hand goes down into the box.
    pub(super) fn is_descent(&self) -> bool {
        matches!(self.phase, TransferPhase::Hover | TransferPhase::Descend | TransferPhase::Lower)
    }
}

impl<'a> DecisionContext<'a> {
    /// Angles of the arm, rad; none if the display does not show that many.
    pub(crate) fn arm_angles(&self) -> Option<&'a [f64]> {
        self.frame.joints.get(..self.sense.joints())
    }

    /// How wide the block is for the fingers, metres.
    pub(super) fn grip_width_m(&self) -> f64 {
        self.scene.objects[self.block.index()].shape.grip_width()
    }

    /// Where the hand is.
    pub(crate) fn base_from_tip(&self) -> Pose {
        self.frame.world_from_base.inv_mul(&self.frame.world_from_tip)
    }

    /// What stands where the hand would go.
    pub(super) fn obstacles(&self) -> Obstacles<'a> {
        Obstacles::new(self.scene, self.frame, self.block, self.sense.finger_points(&self.frame.joints))
    }

    /// The posture of the trunk that brings the hand to the `goal` as the arm stands, clear of everything; none if there is
    /// none near, or the hand is there already.
    pub(super) fn trunk_posture_for(
        &self,
        goal: &HandGoal,
        sensorimotor: &SensorimotorModel,
    ) -> Option<TrunkPosture> {
        if sensorimotor.options.person.trunk_share <= 0.0 || goal.is_reached(&self.base_from_tip()) {
            return None;
        }
        let base = &self.frame.world_from_base;
        let here = self.frame.world_from_tip * goal.point;
        let shift = base * goal.target - here;
        if shift.norm() > MAX_TRUNK_SHIFT_M {
            return None;
        }
        let (moved, posture) = sensorimotor.trunk_posture_for_shift(&here, &shift)?;
        let axis = moved.rotation * (self.frame.world_from_tip.rotation * goal.axis);
        if axis.angle(&(base.rotation * goal.up)) > goal.tilt_tolerance_rad {
            return None;
        }
        let stance = self.sense.posture(self.arm_angles()?);
        let obstacles = self.obstacles();
        let depth = obstacles.penetration_depth_m(base, &stance) + MAX_PENETRATION_M;
        let halfway = Pose::identity().lerp_slerp(&moved, 0.5);
        let clear = [halfway, moved]
            .iter()
            .all(|moved| obstacles.penetration_depth_m(&(moved * base), &stance) <= depth);
        clear.then_some(posture)
    }

    /// Where the hand should be at `stage`, leaning toward the shoulder by `lean`, rad.
    pub(crate) fn hand_goal_of(&self, stage: TransferPhase, lean: f64) -> HandGoal {
        let Self { sense, scene, frame: seen, block, target } = self;
        let half = scene.objects[block.index()].shape.half_height();
        let grasp_center = sense.grasp_center(self.grip_width_m());
        let at = |pose: &Pose| Point::from(pose.translation.vector);
        // Not joint by joint: along axes, or by the own limb.
        let by_axis =
            seen.mode.as_ref().is_none_or(|mode| !matches!(mode.controlled_dof, ControlledDof::Joint(_)));
        let standing = at(&seen.objects[block.index()]);
        let high = |point: &Point, height: f64| Point::new(point.x, point.y, scene.table_height + height);
        let over = |point: &Point, height: f64| Point::new(point.x, point.y, point.z + height);
        let tip = &seen.world_from_tip;
        let center = tip * grasp_center;
        // Place, how far off the hand may be of it, and of upright.
        let (goal_point, point_done, tilt_done) = match stage {
            TransferPhase::Above => (high(&standing, CARRY_HEIGHT), 0.025, 0.35),
            TransferPhase::Hover => (standing + Vector::z() * HOVER_HEIGHT, 0.012, 0.3),
            TransferPhase::Descend | TransferPhase::Grip => (standing, 0.012, 0.3),
            TransferPhase::Lift | TransferPhase::Retreat if by_axis => {
                let height = CARRY_HEIGHT.max(center.z - scene.table_height);
                (high(&center, height), 0.04, 1.0)
            }
            TransferPhase::Lift | TransferPhase::Retreat => {
                let height = CLEAR_HEIGHT.max(center.z - scene.table_height);
                (high(&center, height), 0.05, 3.2)
            }
            TransferPhase::Carry if by_axis => (high(target, CARRY_HEIGHT), 0.025, 0.4),
            TransferPhase::Carry => (over(target, half + HOVER_HEIGHT), 0.015, 0.4),
            TransferPhase::Lower | TransferPhase::Release => {
                (over(target, half + RELEASE_HEIGHT_M), 0.015, 0.3)
            }
        };
        let held = seen.hand.held_object.map(|b| tip.inv_mul(&seen.objects[b.index()]));
        let to_shoulder = seen.world_from_base.translation.vector - goal_point.coords;
        let lean = lean.tan();
        let toward = Vector::new(to_shoulder.x, to_shoulder.y, 0.0).try_normalize(1e-6).unwrap_or_default();
        let base_from_world = seen.world_from_base.inverse();
        HandGoal {
            point: held.map_or(grasp_center, |pose| at(&pose)),
            axis: held.map_or(sense.grasp_axis(self.grip_width_m()), |pose| {
                let axis = pose.rotation * Vector::z();
                // A block stands on either end.
                if axis.z < 0.0 { -axis } else { axis }
            }),
            target: base_from_world * goal_point,
            up: base_from_world * (Vector::z() + toward * lean).normalize(),
            excess_height_weight: if by_axis { 1.0 } else { EXCESS_HEIGHT_WEIGHT },
            point_tolerance_m: point_done,
            tilt_tolerance_rad: tilt_done,
            orientation: None,
        }
    }
}
