//! How the hand stands at a block, or at its target.

use super::{
    TransferPhase,
    decision_context::{DecisionContext, ReachGoal},
    movement::ANGULAR_TOLERANCE_RAD,
};
use crate::reach::HandGoal;
use nalgebra::UnitQuaternion;
use proact_types::{JointVector, Pose, Vector};

/// The hand may lean toward the shoulder by these angles, rad: the arm reaches further then.
const TILTS_RAD: [f64; 5] = [0.0, 0.2, 0.35, 0.5, -0.2];
/// ... and turn about the upright by these, rad.
const YAWS: [f64; 5] = [0.0, 0.4, -0.4, 0.8, -0.8];
/// Of the ways in which the hand could stand, this many are tried.
const MAX_CANDIDATES: usize = 6;
/// With the elbow less bent than this, rad, the arm is called stretched.
const ELBOW_STRETCHED: f64 = 0.45;
const ELBOW: usize = 3;
/// The hand turns about the upright once it is this near to its place, metres.
const YAW_START_DISTANCE_M: f64 = 0.06;

/// The attitude of the hand, thought of once for each way to a block and to its target.
pub(crate) struct HandTilt {
    /// The hand leans toward the shoulder, rad.
    tilt_rad: f64,
    /// `base_from_tip`'s rotation with which method B takes the block, or puts it down; none if its yaw is free.
    target_orientation: Option<UnitQuaternion<f64>>,
    /// The same, also where the yaw is free, and the arm's angles there, rad.
    planned_posture: Option<(UnitQuaternion<f64>, JointVector)>,
    /// The hand has come near enough to its place to turn to that attitude.
    is_near: bool,
    /// A stage began for which the attitude has to be thought of.
    needs_planning: bool,
}

impl HandTilt {
    pub(crate) fn new() -> Self {
        Self {
            tilt_rad: 0.0,
            target_orientation: None,
            planned_posture: None,
            is_near: false,
            needs_planning: true,
        }
    }

    /// Another stage begins.
    pub(crate) fn begin(&mut self, stage: TransferPhase) {
        self.needs_planning = matches!(stage, TransferPhase::Above | TransferPhase::Carry);
    }

    /// How far the hand leans toward the shoulder, rad.
    pub(crate) fn tilt_rad(&self) -> f64 {
        self.tilt_rad
    }

    /// How the hand stands at the object or at its target in the way that was thought of last: `base_from_tip`'s rotation, its yaw
    /// included, and the arm's angles, rad.
    pub(crate) fn planned_posture(&self) -> Option<&(UnitQuaternion<f64>, JointVector)> {
        self.planned_posture.as_ref()
    }

    /// If it is time to: thinks of the ways in which the hand could stand at the block, or at its target, and takes the
    /// best one; after the arm got `stuck` so often, one that is that much worse.
    pub(crate) fn choose_orientation(&mut self, context: &DecisionContext, stuck: usize) {
        if !std::mem::take(&mut self.needs_planning) {
            return;
        }
        let Some(now) = context.arm_angles() else { return };
        let DecisionContext { sense, frame: seen, .. } = context;
        let obstacles = context.obstacles();
        let stage =
            if seen.hand.held_object.is_some() { TransferPhase::Lower } else { TransferPhase::Descend };
        let here = sense.forward(now).rotation;
        let mut tilts = Vec::new();
        for lean in TILTS_RAD {
            let goal = context.hand_goal_of(stage, lean);
            let axis = here * goal.axis;
            let upright = UnitQuaternion::rotation_between(&axis, &goal.up).unwrap_or_default() * here;
            for yaw in YAWS {
                let wanted = UnitQuaternion::from_scaled_axis(goal.up * yaw) * upright;
                let goal = HandGoal { orientation: Some(wanted), ..goal };
                let q = sense.inverse(now, &goal, u32::MAX);
                let pose = sense.forward(&q);
                let (off, turn) = goal.error(&pose);
                let stretched = (ELBOW_STRETCHED - q[ELBOW]).max(0.0);
                let far =
                    (off - goal.point_tolerance_m).max(0.0) + 0.1 * (turn - ANGULAR_TOLERANCE_RAD).max(0.0);
                // Metres that fingers are in something or short of it, a stretched arm, and turns: in that order.
                let depth = obstacles.penetration_depth_m(&seen.world_from_base, &sense.posture(&q));
                let cost = 100.0 * (depth + far) + 2.0 * stretched + 0.3 * lean.abs() + 3.0 * yaw.abs();
                tilts.push((cost, lean, yaw != 0.0, (wanted, q)));
            }
        }
        tilts.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (_, lean, turns, thought_of) = tilts.swap_remove(stuck % MAX_CANDIDATES);
        (self.tilt_rad, self.target_orientation, self.is_near) = (lean, turns.then_some(thought_of.0), false);
        self.planned_posture = Some(thought_of);
    }

    /// What is left to turn along the axes of the base, rad, for a hand that leans off upright by `tilt`, rad, and
    /// whose place is `off` away, metres.
    pub(super) fn remaining_rotation(
        &mut self,
        reach_goal: &ReachGoal,
        base_from_tip: &Pose,
        off: &Vector,
        tilt: &Vector,
    ) -> Vector {
        let aside = off - reach_goal.hand_goal.up * off.dot(&reach_goal.hand_goal.up);
        self.is_near |= aside.norm() < YAW_START_DISTANCE_M;
        match &self.target_orientation {
            // Straight up in any attitude.
            _ if reach_goal.hand_goal.tilt_tolerance_rad > 0.9 => Vector::zeros(),
            Some(wanted) if self.is_near => (wanted * base_from_tip.rotation.inverse()).scaled_axis(),
            _ => *tilt,
        }
    }
}
