//! What control methods ask of the outside: a kinematics library (implemented by the `kinematics` crate) and, for
//! methods of other languages, a process (implemented by `cli`, and by the replay from the log).

use nalgebra::DMatrix;
use proact_types::{JointVector, MethodAnswer, Pose, SimTime};

/// A process that holds a control method.
pub trait MethodProcess: Send {
    /// Hands over the line of the control step `now` (one JSON object, no line break) and gives the line that
    /// answers it. Answers to earlier lines are skipped. Waits for a bounded time.
    fn ask(&mut self, now: SimTime, line: &str) -> MethodAnswer;
}

/// Stands where no method asks a process.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoProcess;

impl MethodProcess for NoProcess {
    fn ask(&mut self, _now: SimTime, _line: &str) -> MethodAnswer {
        MethodAnswer::Failed("there is no process to ask".to_owned())
    }
}

/// Why a kinematic question could not be answered.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum KinematicsError {
    /// The number of angles is not the number of joints of the chain.
    #[error("got {got} joint values, the chain has {expected} joints")]
    WrongJointCount {
        /// Values handed in.
        got: usize,
        /// Joints of the chain.
        expected: usize,
    },
    /// A value is NaN or infinite.
    #[error("{what} {index} is {value}, expected a finite number")]
    NotFinite {
        /// Such as `joint angle`.
        what: &'static str,
        /// Which one.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// The library refused.
    #[error("KDL: {0}")]
    Library(String),
}

/// Outcome of an inverse kinematics question. Not finding a solution is a normal answer.
#[derive(Clone, Debug, PartialEq)]
pub enum IkOutcome {
    /// Angles within the limits whose pose is the target's within the solver's tolerance.
    Solved(JointVector),
    /// No solution was found from this seed.
    NotFound,
}

/// Kinematics of the arm chain, from `base_link` to the tip. All methods take `&mut self`: KDL writes to caches
/// even where it looks read-only.
pub trait ArmKinematics {
    /// Number of joints of the chain.
    fn joint_count(&self) -> usize;

    /// `base_from_tip` at the angles `q`.
    ///
    /// # Errors
    /// Wrong length or a value that is not finite.
    fn forward(&mut self, q: &[f64]) -> Result<Pose, KinematicsError>;

    /// Geometric Jacobian at `q`, 6 rows by joints: twist of the tip in base axes, linear rows first.
    ///
    /// # Errors
    /// Wrong length or a value that is not finite.
    fn jacobian(&mut self, q: &[f64]) -> Result<DMatrix<f64>, KinematicsError>;

    /// Angles within the joint limits at which the tip is at `base_from_tip`, searched from `seed`.
    ///
    /// # Errors
    /// Wrong length or a value that is not finite.
    fn inverse(&mut self, base_from_tip: &Pose, seed: &[f64]) -> Result<IkOutcome, KinematicsError>;
}
