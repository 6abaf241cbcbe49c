//! The person's own limb on its way.

use proact_types::{JointVector, SimTime, joints};

/// No joint of the limb is faster than this, rad/s: unhurried. [assumed]
const JOINT_SPEED: f64 = 0.8;
/// The arm has caught up when no joint is further behind than this, rad; what it has not caught up after this time, it will not, ms.
const TRACKING_TOLERANCE_RAD: f64 = 0.02;
const MAX_CATCH_UP_MS: u64 = 1200;

/// Where the limb is meant to be. The arm follows it, and is seen later.
#[derive(Clone, Debug, Default)]
pub(super) struct LeadingLimb {
    target_joints: Option<JointVector>,
    moved_at: Option<SimTime>,
    /// Since when the limb is where it was to go.
    arrived_at: Option<SimTime>,
}

impl LeadingLimb {
    /// The limb's joints, rad; none before it has moved.
    pub(super) fn joints(&self) -> Option<JointVector> {
        self.target_joints.clone()
    }

    /// Another way begins where the last one ended.
    pub(super) fn begin(&mut self) {
        (self.moved_at, self.arrived_at) = (None, None);
    }

    /// The next way begins where the arm is seen to be: something is in the way of the last one.
    pub(super) fn restart_from_arm(&mut self) {
        self.target_joints = None;
    }

    /// Moves on toward the angles `to`, all joints at once, before an arm that is seen at `q`; true once the limb is there and the
    /// arm has caught up.
    pub(super) fn move_toward(&mut self, now: SimTime, q: &[f64], to: &[f64]) -> bool {
        let target_joints = self.target_joints.get_or_insert_with(|| joints(q));
        let gap = |a: &[f64], b: &[f64]| a.iter().zip(b).fold(0.0_f64, |max, (a, b)| max.max((a - b).abs()));
        if let Some(there) = self.arrived_at {
            return gap(&target_joints[..], q) < TRACKING_TOLERANCE_RAD
                || now.millis_since(there) > MAX_CATCH_UP_MS;
        }
        let secs = self.moved_at.map_or(0.0, |before| now.millis_since(before) as f64 * 1e-3).min(0.1);
        self.moved_at = Some(now);
        let left = gap(to, &target_joints[..]);
        let share = (JOINT_SPEED * secs / left.max(1e-9)).min(1.0);
        target_joints.iter_mut().zip(to).for_each(|(at, to)| *at += share * (to - *at));
        if share >= 1.0 {
            self.arrived_at = Some(now);
        }
        false
    }
}
