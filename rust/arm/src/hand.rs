//! What hangs on the tip.

use crate::ArmModel;
use proact_types::{Point, Pose};

/// The last bone of a finger has this share of the length of the one before it. Assumed: a description says where joints
/// are, not where fingers end.
const LAST_BONE: f64 = 0.8;

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

    /// The middle of each bone of the digits, the joint at its end, and the tips, in the tip's frame, at angles of the
    /// moving joints, rad; zero for those left out.
    pub fn finger_points(&self, angles: &[f64]) -> Vec<Point> {
        let mut poses = Vec::new();
        self.place_from(self.tip, &Pose::identity(), angles, &mut poses);
        let digits = self.digits();
        let mut points = Vec::new();
        for joint in self.joints.iter().filter(|joint| digits[joint.child].is_some()) {
            let (from, to) = (poses[joint.parent].translation.vector, poses[joint.child].translation.vector);
            points.push(Point::from((to + from) / 2.0));
            points.push(Point::from(to));
            if !self.joints.iter().any(|next| next.parent == joint.child) {
                points.push(Point::from(to + (to - from) * LAST_BONE));
            }
        }
        points
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Joint, Link, doubles::three_joints};

    #[test]
    fn the_points_of_a_finger_bend_with_it_and_do_not_move_with_the_arm() {
        // The last joint of the arm becomes a finger on the second link.
        let mut model = three_joints();
        (model.arm, model.hand, model.tip) = (vec![0, 1], vec![2], 2);
        assert_eq!(model.digits(), [None, None, None, Some(3)]);
        // Its joint is 0.3 m ahead of the tip's own, so that this is the one bone that is known.
        let expected = [0.15, 0.3, 0.54].map(|x| Point::new(x, 0.0, 0.0));
        for angles in [[0.0, 0.0, 0.0], [0.7, -0.4, 0.0]] {
            assert_eq!(model.finger_points(&angles), expected);
        }
        let tip = Joint { parent: 3, child: 4, ..model.joints[2].clone() };
        model.links.push(Link { name: "l4".to_owned(), ..model.links[3].clone() });
        model.joints.push(tip);
        let bent = model.finger_points(&[0.3, 0.2, std::f64::consts::FRAC_PI_2]);
        let last = bent.last().expect("a finger");
        assert!((last - Point::new(0.3, 0.0, -0.54)).norm() < 1e-12, "{last}");
    }
}
