//! The person's own limb on its way.

use proact_types::{JointVector, SimTime, joints};

/// No joint of the limb is faster than this, rad/s: unhurried. [assumed]
const JOINT_SPEED: f64 = 0.8;
/// The arm has caught up when no joint is further behind than this, rad; what it has not caught up after this time, it will not, ms.
const BEHIND: f64 = 0.02;
const WAITS_MILLIS: u64 = 1200;

/// Where the limb is meant to be. The arm follows it, and is seen later.
#[derive(Clone, Debug, Default)]
pub(super) struct OwnHand {
    meant: Option<JointVector>,
    moved_at: Option<SimTime>,
    /// Since when the limb is where it was to go.
    there: Option<SimTime>,
}

impl OwnHand {
    /// The limb's joints, rad; none before it has moved.
    pub(super) fn to(&self) -> Option<JointVector> {
        self.meant.clone()
    }

    /// Another way begins where the last one ended.
    pub(super) fn begin(&mut self) {
        (self.moved_at, self.there) = (None, None);
    }

    /// The next way begins where the arm is seen to be: something is in the way of the last one.
    pub(super) fn begin_anew(&mut self) {
        self.meant = None;
    }

    /// Moves on toward the angles `to`, all joints at once, before an arm that is seen at `q`; true once the limb is there and the
    /// arm has caught up.
    pub(super) fn toward(&mut self, now: SimTime, q: &[f64], to: &[f64]) -> bool {
        let meant = self.meant.get_or_insert_with(|| joints(q));
        let gap =
            |a: &[f64], b: &[f64]| a.iter().zip(b).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
        if let Some(there) = self.there {
            return gap(&meant[..], q) < BEHIND || now.millis_since(there) > WAITS_MILLIS;
        }
        let secs = self.moved_at.map_or(0.0, |before| now.millis_since(before) as f64 * 1e-3).min(0.1);
        self.moved_at = Some(now);
        let left = gap(to, &meant[..]);
        let share = (JOINT_SPEED * secs / left.max(1e-9)).min(1.0);
        meant.iter_mut().zip(to).for_each(|(at, to)| *at += share * (to - *at));
        if share >= 1.0 {
            self.there = Some(now);
        }
        false
    }
}
