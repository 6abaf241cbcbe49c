//! The arm as data, and its mathematics.
//!
//! What it does: holds the model of an arm with its hand ([`ArmModel`]); computes where its links are
//! ([`ArmModel::place_links`], [`Chain`]), the Jacobian of a point of the hand ([`Chain::column`]) and damped
//! least-squares steps ([`damped_step`]).
//! What it never does: read files, decide where the arm should go, or judge what touches. Control, planning and
//! `proact query` ask KDL through `proact-kinematics`; tests there compare the two.
//!
//! Pure: no clock, no files, no threads, no randomness. SI and radians; a transform is `target_from_source`; twists and
//! Jacobians are linear first, then angular.
//!
//! ```
//! use proact_arm::{Chain, ChainPoses, doubles::three_joints};
//! let chain = Chain::new(&three_joints());
//! let mut poses = ChainPoses::default();
//! chain.place(&[0.0, 0.5, -0.5], &mut poses);
//! assert_eq!(poses.tip, chain.forward(&[0.0, 0.5, -0.5]));
//! ```

mod chain;
mod damped;
pub mod doubles;
mod hand;
mod hand_fit;
mod limb_fit;
mod model;
mod pinch;
mod settings;
mod sized;

pub use chain::{Chain, ChainPoses, Columns};
pub use damped::{damped_step, damped_step_within};
pub use hand::{CLOSED_POSE, Couplings, Grasp, OPEN_POSE, upright_axis};
pub use hand_fit::HandFit;
pub use limb_fit::{LimbFit, LimbFitError};
pub use model::{
    ArmModel, ArmModelError, CollisionShape, Inertial, Joint, JointKind, JointLimits, Link, Mimic, NamedPose,
    Side, Visual, VisualGeometry,
};
pub use pinch::{Pinch, PinchError, find_pinch};
pub use settings::{ArmSettings, JointEntry, JointGains, Stand, is_named};
pub use sized::{FOREARM_SHARE, SegmentLengths, SizeError, UPPER_ARM_SHARE, sized_for};
