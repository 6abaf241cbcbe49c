//! The arm as data, and its mathematics.
//!
//! What it does: holds the model of an arm with its hand ([`ArmModel`]); computes where its links are
//! ([`ArmModel::link_poses_into`], [`Chain`]), the Jacobian of a point of the hand ([`Chain::jacobian_column`]) and damped
//! least-squares steps ([`damped_step`]).
//! What it never does: read files, decide where the arm should go, or judge what touches. Control, planning and
//! `proact query` ask KDL through `proact-kinematics`; tests there compare the two.
//!
//! Pure: no clock, no files, no threads, no randomness. SI and radians; a transform is `target_from_source`; twists and
//! Jacobians are linear first, then angular.
//!
//! ```
//! use proact_arm::{Chain, ChainPoses, doubles::three_joint_arm};
//! let chain = Chain::new(&three_joint_arm());
//! let mut poses = ChainPoses::default();
//! chain.link_poses_into(&[0.0, 0.5, -0.5], &mut poses);
//! assert_eq!(poses.tip, chain.forward(&[0.0, 0.5, -0.5]));
//! ```

mod chain;
mod damped_least_squares;
pub mod doubles;
mod hand;
mod hand_fit;
mod limb_fit;
mod model;
mod pinch_grasp;
mod settings;
mod stature_scaling;

pub use chain::{Chain, ChainPoses, JacobianColumns};
pub use damped_least_squares::{damped_step, damped_step_within_limits};
pub use hand::{CLOSED_POSE, Grasp, MimicCouplings, OPEN_POSE, upright_axis};
pub use hand_fit::HandFit;
pub use limb_fit::{LimbFit, LimbFitError};
pub use model::{
    ArmModel, ArmModelError, CollisionShape, Inertial, Joint, JointKind, JointLimits, Link, Mimic, NamedPose,
    Side, Visual, VisualGeometry,
};
pub use pinch_grasp::{PinchError, PinchGrasp, find_pinch};
pub use settings::{ArmSettings, FixedBase, JointEntry, JointGains, matches_short_name};
pub use stature_scaling::{
    FOREARM_RATIO, SegmentLengths, StatureScalingError, UPPER_ARM_RATIO, scale_to_stature,
};
