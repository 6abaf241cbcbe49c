use crate::{ArmSettings, Grasp};
use nalgebra::{Translation3, Unit, UnitQuaternion};
use proact_types::{JointVector, MAX_JOINTS, Pose, Shape, Vector};
use serde::{Deserialize, Serialize};

/// The arm: immutable, shared by kinematics, planning, dynamics and display.
///
/// `joints` holds every joint of the tree; vectors of joint values run over [`ArmModel::moving`], arm joints
/// first, base to tip, then hand joints in the order of the semantic group.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct ArmModel {
    /// Name of the robot.
    pub name: String,
    /// Links; a parent always stands before its children, the first is the base.
    pub links: Vec<Link>,
    /// Joints, fixed ones included, sorted by child link: joint `k` moves link `k + 1`.
    pub joints: Vec<Joint>,
    /// Indices into `joints` of the arm group, base to tip.
    pub arm: Vec<usize>,
    /// Indices into `joints` of the hand group in the order of the semantic group.
    pub hand: Vec<usize>,
    /// Hand joints that follow others. Each has its place in the vectors of joint values, and a motor of its own that is
    /// told the master's angle: what stops one of the two does not stop the other.
    #[serde(default)]
    pub mimics: Vec<Mimic>,
    /// Index of the link at which the arm group ends and that carries the hand.
    pub tip: usize,
    /// Named poses, such as `open` and `closed`.
    pub poses: Vec<NamedPose>,
    /// Pairs of link indices that may touch: neighbours, and pairs that overlap by construction.
    pub allowed_collisions: Vec<(usize, usize)>,
    /// How the hand grips from above, objects of ascending width.
    #[serde(default)]
    pub grasps: Vec<Grasp>,
    /// Whose arm it is.
    #[serde(default)]
    pub side: Side,
    /// How it is shown and driven.
    #[serde(default)]
    pub settings: ArmSettings,
}

/// The wearer's side that an arm belongs to. Where a left arm differs from a right one, the world is mirrored across the
/// wearer's sagittal plane, x and z of `world`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// The right shoulder, at negative y of the wearer.
    #[default]
    Right,
    /// The left shoulder, at positive y of the wearer.
    Left,
}

impl Side {
    /// Factor of a coordinate along y that is given for a right arm: 1 or -1.
    pub fn sign(self) -> f64 {
        match self {
            Self::Right => 1.0,
            Self::Left => -1.0,
        }
    }
}

/// A rigid link.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct Link {
    /// Unique name.
    pub name: String,
    /// None for frames without mass.
    pub inertial: Option<Inertial>,
    /// Shapes that collide.
    pub collisions: Vec<CollisionShape>,
    /// Shapes that are drawn.
    pub visuals: Vec<Visual>,
}

/// Mass properties of a link.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct Inertial {
    /// kg, above zero.
    pub mass: f64,
    /// `link_from_inertial`: the origin is the centre of mass.
    #[cfg_attr(feature = "ts", ts(as = "proact_types::typescript::Pose"))]
    pub pose: Pose,
    /// ixx, ixy, ixz, iyy, iyz, izz about the centre of mass, in the inertial frame's axes, kg m^2.
    pub inertia: [f64; 6],
}

/// A collision shape of a link.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct CollisionShape {
    /// `link_from_shape`.
    #[cfg_attr(feature = "ts", ts(as = "proact_types::typescript::Pose"))]
    pub pose: Pose,
    /// The shape.
    pub shape: Shape,
}

/// A drawn shape of a link.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct Visual {
    /// `link_from_visual`.
    #[cfg_attr(feature = "ts", ts(as = "proact_types::typescript::Pose"))]
    pub pose: Pose,
    /// What is drawn.
    pub geometry: VisualGeometry,
    /// Red, green, blue, alpha, 0 to 1.
    #[serde(rename = "colour")]
    pub color: [f64; 4],
}

/// What is drawn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(rename_all = "snake_case")]
pub enum VisualGeometry {
    /// A primitive.
    Shape(Shape),
    /// A mesh file, by the address that the description gives, with scale factors.
    Mesh {
        /// Such as `package://proact_description/meshes/palm.stl`.
        file: String,
        /// Along x, y, z.
        scale: [f64; 3],
    },
}

/// Kinds of joint that an arm may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(rename_all = "snake_case")]
pub enum JointKind {
    /// Does not move.
    Fixed,
    /// Turns about its axis, with limits.
    Revolute,
    /// Turns about its axis for ever. Its limits are [`JointLimits::CONTINUOUS_RANGE_RAD`] either way: angles are counted on over whole
    /// turns, and only a planner takes those a turn apart for the same.
    Continuous,
    /// Slides along its axis, with limits. Its positions are in metres, its speeds in m/s, its efforts in N.
    Prismatic,
}

impl JointKind {
    /// False for what is fixed.
    pub fn moves(self) -> bool {
        self != Self::Fixed
    }

    /// Unit of its positions: `m` of what slides, else `rad`.
    pub fn unit(self) -> &'static str {
        if self == Self::Prismatic { "m" } else { "rad" }
    }

    /// What a tolerance or a speed in radians is multiplied by to be one of such a joint: metres of what slides, at about a finger's
    /// lever of 0.1 m, else 1.
    pub fn per_radian(self) -> f64 {
        if self == Self::Prismatic { 0.1 } else { 1.0 }
    }

    /// Unit of its efforts: `N` of what slides, else `N m`.
    pub fn effort_unit(self) -> &'static str {
        if self == Self::Prismatic { "N" } else { "N m" }
    }
}

/// A joint that another one takes along.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct Mimic {
    /// Index into `joints` of the joint that follows.
    pub joint: usize,
    /// Index into `joints` of the joint that it follows.
    pub master: usize,
    /// The follower's angle per angle of the master.
    pub multiplier: f64,
    /// The follower's angle where the master's is zero, rad.
    pub offset: f64,
}

/// A joint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct Joint {
    /// Unique name.
    pub name: String,
    /// How it moves.
    pub kind: JointKind,
    /// Index of the parent link.
    pub parent: usize,
    /// Index of the child link.
    pub child: usize,
    /// `parent_from_child` at position zero.
    #[cfg_attr(feature = "ts", ts(as = "proact_types::typescript::Pose"))]
    pub origin: Pose,
    /// Unit axis in the joint frame.
    #[cfg_attr(feature = "ts", ts(as = "[f64; 3]"))]
    pub axis: Vector,
    /// Limits; zero for a fixed joint.
    pub limits: JointLimits,
    /// Viscous damping, N m s/rad or N s/m.
    pub damping: f64,
    /// Coulomb friction, N m or N.
    pub friction: f64,
}

impl Joint {
    /// `parent_from_child` at `position`, rad, of a prismatic joint m.
    pub fn transform_at(&self, position: f64) -> Pose {
        let motion = self.motion_at(position);
        match self.kind {
            JointKind::Prismatic => self.origin * motion.translation,
            _ => self.origin * motion.rotation,
        }
    }

    fn motion_at(&self, position: f64) -> Pose {
        let axis = Unit::new_normalize(self.axis);
        match self.kind {
            JointKind::Prismatic => Translation3::from(axis.into_inner() * position).into(),
            _ => Pose::from_parts(Translation3::identity(), UnitQuaternion::from_axis_angle(&axis, position)),
        }
    }
}

impl JointLimits {
    /// How far a continuous joint turns either way, rad: a hundred turns.
    pub const CONTINUOUS_RANGE_RAD: f64 = 200.0 * std::f64::consts::PI;
}

/// Limits of a joint.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct JointLimits {
    /// Smallest position, rad or m.
    pub lower: f64,
    /// Largest position, rad or m.
    pub upper: f64,
    /// Highest speed, rad/s or m/s.
    pub velocity: f64,
    /// Highest effort, N m or N.
    pub effort: f64,
}

/// Joint angles with a name.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct NamedPose {
    /// Such as `open`.
    pub name: String,
    /// Group it belongs to: `arm` or `hand`.
    pub group: String,
    /// One position per joint of the group, rad, of prismatic joints m.
    pub angles: Vec<f64>,
}

/// Why an arm model is not usable.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ArmModelError {
    /// A name that is looked up does not exist.
    #[error("{kind} \"{name}\" is not in the model {model:?}; it has: {known}")]
    Unknown {
        /// `link`, `joint` or `pose`.
        kind: &'static str,
        /// What was asked for.
        name: String,
        /// The model's name.
        model: String,
        /// What there is.
        known: String,
    },
    /// More joints than fit.
    #[error("{got} moving joints, at most {MAX_JOINTS} are supported")]
    TooManyJoints {
        /// Number of moving joints.
        got: usize,
    },
}

impl ArmModel {
    /// Indices into `joints` of all moving joints: arm, then hand. The order of every full joint vector.
    pub fn moving(&self) -> impl ExactSizeIterator<Item = usize> + Clone + '_ {
        let arm = self.arm.len();
        (0..arm + self.hand.len()).map(move |k| if k < arm { self.arm[k] } else { self.hand[k - arm] })
    }

    /// [`JointKind::per_radian`] of the hand's joints.
    pub fn hand_per_radian(&self) -> JointVector {
        self.hand.iter().map(|&joint| self.joints[joint].kind.per_radian()).collect()
    }

    /// Number of arm joints.
    pub fn arm_count(&self) -> usize {
        self.arm.len()
    }

    /// Number of moving joints.
    pub fn moving_count(&self) -> usize {
        self.arm.len() + self.hand.len()
    }

    /// `base_from_link` of all links, in their order, at angles of the moving joints, rad; zero for those left out.
    pub fn link_poses(&self, angles: &[f64]) -> Vec<Pose> {
        let mut poses = Vec::new();
        self.link_poses_into(&Pose::identity(), angles, &mut poses);
        poses
    }

    /// Forward kinematics: writes `world_from_link` of all links, in their order, at angles of the moving joints, rad;
    /// zero for those left out. Allocates only where `poses` has too little room.
    pub fn link_poses_into(&self, world_from_base: &Pose, angles: &[f64], poses: &mut Vec<Pose>) {
        self.link_poses_from(0, world_from_base, angles, poses);
    }

    /// As [`ArmModel::link_poses_into`], with the link `first` at `pose`. The poses of links that do not hang on it mean
    /// nothing.
    pub(crate) fn link_poses_from(&self, first: usize, pose: &Pose, angles: &[f64], poses: &mut Vec<Pose>) {
        poses.clear();
        poses.resize(self.links.len(), Pose::identity());
        // Each link first waits with the motion of its joint.
        for (joint, position) in self.moving().zip(angles) {
            let joint = &self.joints[joint];
            poses[joint.child] = joint.motion_at(*position);
        }
        poses[first] = *pose;
        // Joint k moves link k + 1, and parents stand before their children.
        for joint in &self.joints[first..] {
            let at_zero = poses[joint.parent] * joint.origin;
            let motion = &poses[joint.child];
            poses[joint.child] = match joint.kind {
                JointKind::Prismatic => at_zero * motion.translation,
                _ => at_zero * motion.rotation,
            };
        }
    }

    /// Index of the link called `name`.
    ///
    /// # Errors
    /// [`ArmModelError::Unknown`] with the names there are.
    pub fn link(&self, name: &str) -> Result<usize, ArmModelError> {
        self.links.iter().position(|l| l.name == name).ok_or_else(|| self.unknown("link", name))
    }

    /// Index of the joint called `name`.
    ///
    /// # Errors
    /// [`ArmModelError::Unknown`] with the names there are.
    pub fn joint(&self, name: &str) -> Result<usize, ArmModelError> {
        self.joints.iter().position(|j| j.name == name).ok_or_else(|| self.unknown("joint", name))
    }

    /// Angles of the pose called `name` of the group `arm` or `hand`.
    ///
    /// # Errors
    /// [`ArmModelError::Unknown`] with the names there are.
    pub fn pose(&self, group: &str, name: &str) -> Result<&[f64], ArmModelError> {
        self.poses
            .iter()
            .find(|p| p.group == group && p.name == name)
            .map(|p| p.angles.as_slice())
            .ok_or_else(|| self.unknown("pose", name))
    }

    /// The same arm with some of its arm joints held: `held` says which, by their positions in the arm group, and at which
    /// positions, rad or m. They are fixed joints then, and named poses of the arm are without them. Positions that the arm does
    /// not have are left out.
    pub fn with_held_joints(&self, held: &[(usize, f64)]) -> Self {
        let mut model = self.clone();
        for &(position, angle) in held {
            let Some(&joint) = self.arm.get(position) else { continue };
            let joint = &mut model.joints[joint];
            joint.origin = joint.transform_at(angle);
            joint.kind = JointKind::Fixed;
            joint.limits = JointLimits::default();
        }
        let stays = |position: usize| !held.iter().any(|(of, _)| *of == position);
        let kept = |angles: &[f64]| {
            angles.iter().enumerate().filter(|(k, _)| stays(*k)).map(|(_, angle)| *angle).collect()
        };
        model.arm = (0..self.arm.len()).filter(|k| stays(*k)).map(|k| self.arm[k]).collect();
        for pose in model.poses.iter_mut().filter(|pose| pose.group == "arm") {
            pose.angles = kept(&pose.angles);
        }
        model
    }

    fn unknown(&self, kind: &'static str, name: &str) -> ArmModelError {
        let known: Vec<&str> = match kind {
            "link" => self.links.iter().map(|l| l.name.as_str()).collect(),
            "joint" => self.joints.iter().map(|j| j.name.as_str()).collect(),
            _ => self.poses.iter().map(|p| p.name.as_str()).collect(),
        };
        ArmModelError::Unknown {
            kind,
            name: name.to_owned(),
            model: self.name.clone(),
            known: known.join(", "),
        }
    }
}
