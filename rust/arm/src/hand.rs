//! What hangs on the tip.

use crate::ArmModel;
use proact_types::{Point, Pose, Vector};
use serde::{Deserialize, Serialize};

/// The last bone of a finger has this share of the length of the one before it. Assumed: a description says where joints
/// are, not where fingers end.
const LAST_BONE: f64 = 0.8;

/// How the hand grips what stands upright, from above: with its grasp centre ([`ArmModel::grasp_centre`]) in the middle of
/// the object, rolled about x of the tip's frame and leaning about y. Planner and simulated participants go by it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct Grasp {
    /// Roll at which the fingers close best, rad: at zero z of the tip's frame is up.
    pub roll: f64,
    /// Smallest and largest roll at which they close, rad.
    pub roll_range: [f64; 2],
    /// Largest lean, both ways, rad.
    pub lean: f64,
    /// An object whose centre is this near to the grasp centre is between the fingers, metres.
    pub opening: f64,
    /// Where the open hand may come off an object other than straight up: a direction in the tip's frame, of any length.
    #[cfg_attr(feature = "ts", ts(as = "[f64; 3]"))]
    pub withdrawal: Vector,
}

impl Default for Grasp {
    /// That of the MPL right hand, for a hand whose description does not say. The original's fixed grasp orientation has a
    /// roll of 25.6 degrees; the rest is assumed.
    fn default() -> Self {
        Self {
            roll: 25.6_f64.to_radians(),
            roll_range: [-10_f64.to_radians(), 60_f64.to_radians()],
            lean: 15_f64.to_radians(),
            opening: 0.07,
            withdrawal: Vector::new(0.0, 1.0, 1.0),
        }
    }
}

/// The axis of the tip's frame that points up when the hand is rolled and leans by so much, rad; unit length.
pub fn upright_axis(roll: f64, lean: f64) -> Vector {
    Vector::new(-lean.sin(), lean.cos() * roll.sin(), lean.cos() * roll.cos())
}

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
    use nalgebra::UnitQuaternion;

    #[test]
    fn a_hand_that_is_rolled_and_leans_has_its_upright_axis_up() {
        let (roll, lean) = (0.4, -0.2);
        let turned = UnitQuaternion::from_axis_angle(&Vector::x_axis(), roll) * upright_axis(roll, lean);
        assert!((turned - Vector::new(-lean.sin(), 0.0, lean.cos())).norm() < 1e-12, "{turned}");
        let upright = UnitQuaternion::from_axis_angle(&Vector::y_axis(), lean) * turned;
        assert!((upright - Vector::z()).norm() < 1e-12, "{upright}");
    }

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
