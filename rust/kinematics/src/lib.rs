//! Kinematics and inverse dynamics of an arm with a hand, computed by KDL.
//!
//! [`Kinematics`] is built from an `ArmModel` and answers for the chain from `base` to `tip` (pose, Jacobian,
//! inverse) and for the whole tree (link poses, inverse dynamics with a carried body). It implements the port
//! [`proact_control::ports::ArmKinematics`]. SI units and radians; twists and Jacobians are linear first, then
//! angular. No clock except in [`time_raw_kdl`], no files, no randomness but from seeds handed in.
//!
//! [`effort_limits`] computes what torque each joint needs at rest; the example of the same name prints it.

#[expect(
    unsafe_code,
    reason = "the bridge is what cxx generates; each signature is checked by its C++ compiler run"
)]
mod bridge;
mod effort_limits;
mod kinematics;

pub use effort_limits::{EffortLimit, EffortOptions, effort_limits};
pub use kinematics::{Kinematics, time_raw_kdl};
pub use proact_control::ports::{ArmKinematics, IkOutcome, KinematicsError};
