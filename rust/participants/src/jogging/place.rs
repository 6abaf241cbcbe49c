//! Where the hand goes at each stage, and how it stands there.

use super::{
    BLOCK, FIRST_AXIS, JOINTS, JoggingParticipant, Stage, movement::ANGULAR_DONE, obstacles::Obstacles,
};
use crate::reach::HandGoal;
use nalgebra::UnitQuaternion;
use proact_types::{BlockId, DisplayFrame, Point, Pose, Vector};

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
/// Roll of the hand at which its fingers close around a standing block, rad: the original's 25.6 degrees.
const ROLL: f64 = 25.6 * std::f64::consts::PI / 180.0;
/// The hand may lean toward the shoulder by these angles, rad: the arm reaches further then.
const LEANS: [f64; 5] = [0.0, 0.2, 0.35, 0.5, -0.2];
/// ... and turn about the upright by these, rad.
const YAWS: [f64; 5] = [0.0, 0.4, -0.4, 0.8, -0.8];
/// Of the ways in which the hand could stand, this many are tried.
const MOST_WAYS: usize = 6;
/// With the elbow less bent than this, rad, the arm is called stretched.
const ELBOW_STRETCHED: f64 = 0.45;
const ELBOW: usize = 3;

impl JoggingParticipant {
    /// Thinks of the ways in which the hand could stand at the block, or at its target, and takes the best one; each
    /// time the arm got stuck, the next best.
    pub(super) fn choose_attitude(&mut self, seen: &DisplayFrame, block: BlockId) {
        let Some(now) = seen.joints.get(..JOINTS.into()) else { return };
        let obstacles = Obstacles::new(&self.scene, seen, block, self.sense.fingers(&seen.joints));
        let stage = if seen.hand.holds.is_some() { Stage::Lower } else { Stage::Down };
        let here = self.sense.forward(now).rotation;
        let mut ways = Vec::new();
        for lean in LEANS {
            let goal = self.goal_of(stage, lean, seen, block);
            let axis = here * goal.axis;
            let upright = UnitQuaternion::rotation_between(&axis, &goal.up).unwrap_or_default() * here;
            for yaw in YAWS {
                let wanted = UnitQuaternion::from_scaled_axis(goal.up * yaw) * upright;
                let goal = HandGoal { attitude: Some(wanted), ..goal };
                let q = self.sense.inverse(now, &goal, (1 << JOINTS) - 1);
                let pose = self.sense.forward(&q);
                let (off, turn) = goal.off(&pose);
                let stretched = (ELBOW_STRETCHED - q[ELBOW]).max(0.0);
                let far = (off - goal.point_done).max(0.0) + 0.1 * (turn - ANGULAR_DONE).max(0.0);
                // Metres that fingers are in something or short of it, a stretched arm, and turns: in that order.
                let depth = obstacles.depth(&seen.world_from_base, &self.sense.stance(&q));
                let cost = 100.0 * (depth + far) + 2.0 * stretched + 0.3 * lean.abs() + 3.0 * yaw.abs();
                ways.push((cost, lean, (yaw != 0.0).then_some(wanted)));
            }
        }
        ways.sort_by(|a, b| a.0.total_cmp(&b.0));
        let chosen = ways[self.stuck % MOST_WAYS];
        (self.lean, self.attitude, self.near) = (chosen.1, chosen.2, false);
    }

    /// Where the hand should be at `stage`, leaning toward the shoulder by `lean`, rad.
    pub(super) fn goal_of(&self, stage: Stage, lean: f64, seen: &DisplayFrame, block: BlockId) -> HandGoal {
        let at = |pose: &Pose| Point::from(pose.translation.vector);
        let by_axis = seen.mode.as_ref().is_some_and(|mode| mode.number >= FIRST_AXIS);
        let standing = at(&seen.blocks[block.index()]);
        let target = self.scene.targets[block.index()].centre;
        let high =
            |point: &Point, height: f64| Point::new(point.x, point.y, self.scene.table_height + height);
        let tip = &seen.world_from_tip;
        let centre = tip * self.grasp_centre;
        // Place, how far off the hand may be of it, and of upright.
        let (place, point_done, tilt_done) = match stage {
            Stage::Above => (high(&standing, CARRY_HEIGHT), 0.025, 0.35),
            Stage::Hover => (standing + Vector::z() * HOVER_HEIGHT, 0.012, 0.3),
            Stage::Down | Stage::Grip => (standing, 0.012, 0.3),
            Stage::Lift | Stage::Retreat if by_axis => {
                let height = CARRY_HEIGHT.max(centre.z - self.scene.table_height);
                (high(&centre, height), 0.04, 1.0)
            }
            Stage::Lift | Stage::Retreat => {
                let height = CLEAR_HEIGHT.max(centre.z - self.scene.table_height);
                (high(&centre, height), 0.05, 3.2)
            }
            Stage::Carry if by_axis => (high(&target, CARRY_HEIGHT), 0.025, 0.4),
            Stage::Carry => (high(&target, BLOCK + HOVER_HEIGHT), 0.015, 0.4),
            Stage::Lower | Stage::Release => (high(&target, BLOCK + DROP_HEIGHT), 0.015, 0.3),
        };
        let held = seen.hand.holds.map(|b| tip.inv_mul(&seen.blocks[b.index()]));
        let to_shoulder = seen.world_from_base.translation.vector - place.coords;
        let lean = lean.tan();
        let toward = Vector::new(to_shoulder.x, to_shoulder.y, 0.0).try_normalize(1e-6).unwrap_or_default();
        let base_from_world = seen.world_from_base.inverse();
        HandGoal {
            point: held.map_or(self.grasp_centre, |pose| at(&pose)),
            axis: held.map_or(Vector::new(0.0, ROLL.sin(), ROLL.cos()), |pose| {
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
