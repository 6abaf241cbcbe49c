//! How the hand stands at a block, or at its target.

use super::{
    Stage,
    movement::ANGULAR_DONE,
    situation::{Aim, Situation},
};
use crate::reach::HandGoal;
use nalgebra::UnitQuaternion;
use proact_types::{JointVector, Pose, Vector};

/// The hand may lean toward the shoulder by these angles, rad: the arm reaches further then.
const LEANS: [f64; 5] = [0.0, 0.2, 0.35, 0.5, -0.2];
/// ... and turn about the upright by these, rad.
const YAWS: [f64; 5] = [0.0, 0.4, -0.4, 0.8, -0.8];
/// Of the ways in which the hand could stand, this many are tried.
const MOST_WAYS: usize = 6;
/// With the elbow less bent than this, rad, the arm is called stretched.
const ELBOW_STRETCHED: f64 = 0.45;
const ELBOW: usize = 3;
/// The hand turns about the upright once it is this near to its place, metres.
const YAW_NEAR: f64 = 0.06;

/// The attitude of the hand, thought of once for each way to a block and to its target.
pub(crate) struct Attitude {
    /// The hand leans toward the shoulder, rad.
    lean: f64,
    /// `base_from_tip`'s rotation with which method B takes the block, or puts it down; none if its yaw is free.
    wanted: Option<UnitQuaternion<f64>>,
    /// The same, also where the yaw is free, and the arm's angles there, rad.
    thought_of: Option<(UnitQuaternion<f64>, JointVector)>,
    /// The hand has come near enough to its place to turn to that attitude.
    near: bool,
    /// A stage began for which the attitude has to be thought of.
    due: bool,
}

impl Attitude {
    pub(crate) fn new() -> Self {
        Self { lean: 0.0, wanted: None, thought_of: None, near: false, due: true }
    }

    /// Another stage begins.
    pub(crate) fn begin(&mut self, stage: Stage) {
        self.due = matches!(stage, Stage::Above | Stage::Carry);
    }

    /// How far the hand leans toward the shoulder, rad.
    pub(crate) fn lean(&self) -> f64 {
        self.lean
    }

    /// How the hand stands at the object or at its target in the way that was thought of last: `base_from_tip`'s rotation, its yaw
    /// included, and the arm's angles, rad.
    pub(crate) fn thought_of(&self) -> Option<&(UnitQuaternion<f64>, JointVector)> {
        self.thought_of.as_ref()
    }

    /// If it is time to: thinks of the ways in which the hand could stand at the block, or at its target, and takes the
    /// best one; after the arm got `stuck` so often, one that is that much worse.
    pub(crate) fn choose(&mut self, situation: &Situation, stuck: usize) {
        if !std::mem::take(&mut self.due) {
            return;
        }
        let Some(now) = situation.arm_angles() else { return };
        let Situation { sense, seen, .. } = situation;
        let obstacles = situation.obstacles();
        let stage = if seen.hand.holds.is_some() { Stage::Lower } else { Stage::Down };
        let here = sense.forward(now).rotation;
        let mut ways = Vec::new();
        for lean in LEANS {
            let goal = situation.goal_of(stage, lean);
            let axis = here * goal.axis;
            let upright = UnitQuaternion::rotation_between(&axis, &goal.up).unwrap_or_default() * here;
            for yaw in YAWS {
                let wanted = UnitQuaternion::from_scaled_axis(goal.up * yaw) * upright;
                let goal = HandGoal { attitude: Some(wanted), ..goal };
                let q = sense.inverse(now, &goal, u32::MAX);
                let pose = sense.forward(&q);
                let (off, turn) = goal.off(&pose);
                let stretched = (ELBOW_STRETCHED - q[ELBOW]).max(0.0);
                let far = (off - goal.point_done).max(0.0) + 0.1 * (turn - ANGULAR_DONE).max(0.0);
                // Metres that fingers are in something or short of it, a stretched arm, and turns: in that order.
                let depth = obstacles.depth(&seen.world_from_base, &sense.stance(&q));
                let cost = 100.0 * (depth + far) + 2.0 * stretched + 0.3 * lean.abs() + 3.0 * yaw.abs();
                ways.push((cost, lean, yaw != 0.0, (wanted, q)));
            }
        }
        ways.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (_, lean, turns, thought_of) = ways.swap_remove(stuck % MOST_WAYS);
        (self.lean, self.wanted, self.near) = (lean, turns.then_some(thought_of.0), false);
        self.thought_of = Some(thought_of);
    }

    /// What is left to turn along the axes of the base, rad, for a hand that leans off upright by `tilt`, rad, and
    /// whose place is `off` away, metres.
    pub(super) fn turn_left(
        &mut self,
        aim: &Aim,
        base_from_tip: &Pose,
        off: &Vector,
        tilt: &Vector,
    ) -> Vector {
        let aside = off - aim.goal.up * off.dot(&aim.goal.up);
        self.near |= aside.norm() < YAW_NEAR;
        match &self.wanted {
            // Straight up in any attitude.
            _ if aim.goal.tilt_done > 0.9 => Vector::zeros(),
            Some(wanted) if self.near => (wanted * base_from_tip.rotation.inverse()).scaled_axis(),
            _ => *tilt,
        }
    }
}
