//! What hangs on the tip.

use crate::ArmModel;

impl ArmModel {
    /// For each link the digit that it belongs to, named by the digit's first link: each branch behind the tip is one.
    /// None for arm and palm.
    pub fn digits(&self) -> Vec<Option<usize>> {
        let mut digit = vec![None; self.links.len()];
        for joint in &self.joints {
            // Parents stand before their children, so the parent's digit is known.
            digit[joint.child] =
                if joint.parent == self.tip { Some(joint.child) } else { digit[joint.parent] };
        }
        digit
    }
}
