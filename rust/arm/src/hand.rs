//! What hangs on the tip.

use crate::{ArmModel, Mimic};
use proact_types::{PlanRequest, Point, Pose, Vector};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// The last bone of a finger has this share of the length of the one before it. Assumed: a description says where joints
/// are, not where fingers end.
const DISTAL_BONE_RATIO: f64 = 0.8;

/// How the hand grips what stands upright and is so wide, from above: with the grasp's centre in the middle of the object,
/// rolled about x of the tip's frame and leaning about y. Hand, planner and simulated participants go by it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct Grasp {
    /// Widths of the objects that it holds, metres: the smallest and the largest.
    #[serde(rename = "widths")]
    pub width_range_m: [f64; 2],
    /// Where the centre of a grasped object lies, in the tip's frame, metres.
    #[cfg_attr(feature = "ts", ts(as = "[f64; 3]"))]
    #[serde(rename = "centre")]
    pub center: Vector,
    /// Pose of the hand before it closes: room for the object, and no wider than its neighbours allow.
    pub open_pose: Cow<'static, str>,
    /// Pose of the hand that it closes to; the object stops it on the way.
    pub closed_pose: Cow<'static, str>,
    /// Where the digits close in one direction: this direction in the tip's frame, of any length. A box is then gripped
    /// by two of its faces where the arm can.
    #[cfg_attr(feature = "ts", ts(as = "Option<[f64; 3]>"))]
    #[serde(rename = "closing")]
    pub closing_direction: Option<Vector>,
    /// Roll at which the fingers close best, rad: at zero z of the tip's frame is up.
    #[serde(rename = "roll")]
    pub roll_rad: f64,
    /// Smallest and largest roll at which they close, rad.
    #[serde(rename = "roll_range")]
    pub roll_range_rad: [f64; 2],
    /// Largest lean, both ways, rad.
    #[serde(rename = "lean")]
    pub max_lean_rad: f64,
    /// An object whose centre is this near to the grasp's is between the fingers, metres.
    #[serde(rename = "opening")]
    pub capture_radius_m: f64,
    /// Where the open hand may come off an object other than straight up: a direction in the tip's frame, of any length.
    #[cfg_attr(feature = "ts", ts(as = "[f64; 3]"))]
    #[serde(rename = "withdrawal")]
    pub withdrawal_direction: Vector,
}

/// The hand pose that stands for open, where a grasp does not say.
pub const OPEN_POSE: &str = "open";
/// The hand pose that stands for closed, where a grasp does not say.
pub const CLOSED_POSE: &str = "closed";

/// The grasp of a hand whose description has none. The angles are those of the MPL right hand: the original's fixed grasp
/// orientation has a roll of 25.6 degrees; the rest is assumed.
static DEFAULT_GRASP: Grasp = Grasp {
    width_range_m: [0.0, 1.0],
    center: Vector::new(0.0, 0.0, 0.0),
    open_pose: Cow::Borrowed(OPEN_POSE),
    closed_pose: Cow::Borrowed(CLOSED_POSE),
    closing_direction: None,
    roll_rad: 25.6_f64.to_radians(),
    roll_range_rad: [-10_f64.to_radians(), 60_f64.to_radians()],
    max_lean_rad: 15_f64.to_radians(),
    capture_radius_m: 0.07,
    withdrawal_direction: Vector::new(0.0, 1.0, 1.0),
};

impl Default for Grasp {
    /// That of a hand whose description does not say: for objects of any width.
    fn default() -> Self {
        DEFAULT_GRASP.clone()
    }
}

impl Grasp {
    /// True if it is meant for objects of this width, metres.
    pub fn fits_width(&self, width: f64) -> bool {
        self.width_mismatch_m(width) == 0.0
    }

    /// How much wider or narrower its objects are at least, metres.
    fn width_mismatch_m(&self, width: f64) -> f64 {
        (self.width_range_m[0] - width).max(width - self.width_range_m[1]).max(0.0)
    }
}

/// The axis of the tip's frame that points up when the hand is rolled and leans by so much, rad; unit length.
pub fn upright_axis(roll: f64, lean: f64) -> Vector {
    Vector::new(-lean.sin(), lean.cos() * roll.sin(), lean.cos() * roll.cos())
}

/// Which hand joints follow which, by their places among the hand joints.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MimicCouplings(Vec<MimicCoupling>);

#[derive(Clone, Copy, Debug, PartialEq)]
struct MimicCoupling {
    joint: usize,
    master: usize,
    multiplier: f64,
    offset: f64,
}

impl MimicCouplings {
    /// Puts the joints that follow others where their masters take them, rad or m.
    ///
    /// # Panics
    /// If there are fewer values than hand joints.
    pub fn place(&self, position: &mut [f64]) {
        for MimicCoupling { joint, master, multiplier, offset } in &self.0 {
            position[*joint] = multiplier * position[*master] + offset;
        }
    }

    /// The master of a joint that follows one, by their places among the hand joints.
    pub fn master_of(&self, joint: usize) -> Option<usize> {
        self.0.iter().find(|coupling| coupling.joint == joint).map(|coupling| coupling.master)
    }

    /// Puts the joints that follow others where their masters take them, rad and rad/s.
    ///
    /// # Panics
    /// If there are fewer values than hand joints.
    pub fn apply(&self, position: &mut [f64], velocity: &mut [f64]) {
        self.place(position);
        for MimicCoupling { joint, master, multiplier, .. } in &self.0 {
            velocity[*joint] = multiplier * velocity[*master];
        }
    }
}

impl ArmModel {
    /// Which hand joints follow which.
    pub fn couplings(&self) -> MimicCouplings {
        let hand_index = |joint: usize| self.hand.iter().position(|&own| own == joint);
        let coupling = |mimic: &Mimic| {
            let (joint, master) = hand_index(mimic.joint).zip(hand_index(mimic.master))?;
            Some(MimicCoupling { joint, master, multiplier: mimic.multiplier, offset: mimic.offset })
        };
        MimicCouplings(self.mimics.iter().filter_map(coupling).collect())
    }

    /// The grasp for an object of this width, metres ([`proact_types::Shape::grip_width`]): the first that is meant for it;
    /// where none is, the one whose objects are nearest in width, of which [`Grasp::fits_width`] is false.
    pub fn grasp_for(&self, width: f64) -> &Grasp {
        let nearer = |a: &&Grasp, b: &&Grasp| a.width_mismatch_m(width).total_cmp(&b.width_mismatch_m(width));
        self.grasps.iter().min_by(nearer).unwrap_or(&DEFAULT_GRASP)
    }

    /// The grasp for what `request` picks or carries; that for the widest objects where it is about none.
    pub fn grasp_for_request(&self, request: &PlanRequest) -> &Grasp {
        request.grip_width().map_or_else(|| self.widest_grasp(), |width| self.grasp_for(width))
    }

    /// The grasp for the widest objects: where nothing is known of an object.
    pub fn widest_grasp(&self) -> &Grasp {
        self.grasps.last().unwrap_or(&DEFAULT_GRASP)
    }

    /// For each link the digit that it belongs to, named by the digit's first link: each branch that moves behind the palm is
    /// one. None for arm and palm, which is the tip with all that is fixed to it.
    pub fn digits(&self) -> Vec<Option<usize>> {
        let palm = self.palm();
        let mut digit = vec![None; self.links.len()];
        for (index, joint) in self.joints.iter().enumerate() {
            // Parents stand before their children, so the parent's digit is known.
            digit[joint.child] = match digit[joint.parent] {
                None if palm[joint.parent] && joint.kind.moves() && !self.arm.contains(&index) => {
                    Some(joint.child)
                }
                of_parent => of_parent,
            };
        }
        digit
    }

    /// Writes `tip_from_link` of palm and digits at positions of the moving joints, rad or m; the poses of other links mean nothing.
    pub(crate) fn hand_poses_into(&self, positions: &[f64], poses: &mut Vec<Pose>) {
        // The digits hang on the first link of the tip's rigid body.
        let (mut root, mut root_from_tip) = (self.tip, Pose::identity());
        while let Some(carrier) =
            root.checked_sub(1).map(|joint| &self.joints[joint]).filter(|j| !j.kind.moves())
        {
            (root, root_from_tip) = (carrier.parent, carrier.origin * root_from_tip);
        }
        self.link_poses_from(root, &root_from_tip.inverse(), positions, poses);
    }

    /// Of each link, whether it is part of the rigid body of the tip.
    pub fn palm(&self) -> Vec<bool> {
        let mut bodies = vec![0; self.links.len()];
        for joint in &self.joints {
            bodies[joint.child] = if joint.kind.moves() { joint.child } else { bodies[joint.parent] };
        }
        bodies.iter().map(|body| *body == bodies[self.tip]).collect()
    }

    /// For each link the place of its digit in the order of the digits' first links. None for arm and palm.
    pub fn digit_indices(&self) -> Vec<Option<usize>> {
        let first_links = self.digits();
        let mut order: Vec<usize> = first_links.iter().flatten().copied().collect();
        order.sort_unstable();
        order.dedup();
        first_links.iter().map(|first| first.and_then(|link| order.binary_search(&link).ok())).collect()
    }

    /// The middle of each bone of the digits, the joint at its end, and the tips, in the tip's frame, at angles of the
    /// moving joints, rad; zero for those left out.
    pub fn finger_points(&self, angles: &[f64]) -> Vec<Point> {
        let mut poses = Vec::new();
        self.hand_poses_into(angles, &mut poses);
        let digits = self.digits();
        let mut points = Vec::new();
        for joint in self.joints.iter().filter(|joint| digits[joint.child].is_some()) {
            let (from, to) = (poses[joint.parent].translation.vector, poses[joint.child].translation.vector);
            points.push(Point::from((to + from) / 2.0));
            points.push(Point::from(to));
            if !self.joints.iter().any(|next| next.parent == joint.child) {
                points.push(Point::from(to + (to - from) * DISTAL_BONE_RATIO));
            }
        }
        points
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Joint, Link, doubles::three_joint_arm};
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
    fn the_grasp_is_that_of_the_objects_width_and_otherwise_the_nearest() {
        let grasp = |low: f64, high: f64| Grasp { width_range_m: [low, high], ..Grasp::default() };
        let mut model = three_joint_arm();
        assert_eq!(model.grasp_for(0.05), &Grasp::default(), "a hand that is not described");
        model.grasps = vec![grasp(0.02, 0.03), grasp(0.046, 0.1)];
        for (width, low) in
            [(0.025, 0.02), (0.05, 0.046), (0.001, 0.02), (0.035, 0.02), (0.04, 0.046), (1.0, 0.046)]
        {
            let found = model.grasp_for(width);
            assert_eq!(found.width_range_m[0], low, "{width} m");
            assert_eq!(found.fits_width(width), width == 0.025 || width == 0.05);
        }
        assert_eq!(model.widest_grasp(), &model.grasps[1]);
    }

    #[test]
    fn the_points_of_a_finger_bend_with_it_and_do_not_move_with_the_arm() {
        // The last joint of the arm becomes a finger on the second link.
        let mut model = three_joint_arm();
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
