//! The arm as data: links, joints, groups, named poses.
//!
//! Pure: no clock, no files, no threads, no randomness. SI and radians; a transform is `target_from_source`.

mod model;

pub use model::{
    ArmModel, ArmModelError, CollisionShape, Inertial, Joint, JointKind, JointLimits, Link, NamedPose,
    Visual, VisualGeometry,
};
