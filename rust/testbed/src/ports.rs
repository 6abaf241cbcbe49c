//! What the testbed asks of the outside: physics, plans, EMG and gaze. Implemented by `dynamics`, `planning` and
//! `devices`, and by the replay, which answers from the log.

use proact_types::{
    BodyState, Command, EmgSample, GazeSample, PlanReply, PlanRequest, PlantCommand, PlantState, Point,
    SimTime, Vector,
};
use std::time::Duration;

/// Why the physics could not take a step.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PlantError {
    /// The command has another length than the model has moving joints.
    #[error("{what} has {got} values, the plant has {expected} moving joints")]
    WrongLength {
        /// Such as `position`.
        what: &'static str,
        /// Values handed in.
        got: usize,
        /// Moving joints.
        expected: usize,
    },
    /// A value is NaN or infinite.
    #[error("{what} {index} is {value}, expected a finite number")]
    NotFinite {
        /// Such as `position`.
        what: &'static str,
        /// Which one.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// The scene or the arm cannot be simulated as described.
    #[error("{0}")]
    Model(String),
    /// The library refused, or the simulation left the finite numbers.
    #[error("ODE: {0}")]
    Library(String),
}

/// The simulated arm, box and blocks. One step is one tick of 1 ms.
pub trait Plant {
    /// Advances by one tick under `command`.
    ///
    /// # Errors
    /// [`PlantError`]; the state is then that of the tick before.
    fn step(&mut self, command: &PlantCommand) -> Result<(), PlantError>;

    /// The state after the last step.
    fn state(&self) -> &PlantState;

    /// Whether the last step met the laws of contact; else its state is the solver's last try.
    fn contacts_solved(&self) -> bool {
        true
    }

    /// Attaches block `block` to link `link` (an index in `ArmModel::links`) rigidly, where it is now.
    ///
    /// # Errors
    /// If there is no such block or link, or a block is attached already.
    fn attach(&mut self, block: usize, link: usize) -> Result<(), PlantError>;

    /// Lets go of the attached block; it keeps its velocity. Without one, nothing happens.
    fn release(&mut self);

    /// Puts block `block` somewhere, with a velocity, as the services of a simulator do; no trial does.
    ///
    /// # Errors
    /// If there is no such block, it is attached, a number is not finite, or the place is taken; nothing is changed then.
    fn place(&mut self, block: usize, body: &BodyState) -> Result<(), PlantError>;
}

/// Motion plans, computed beside the tick.
///
/// A request at tick t takes effect at t + L. In batch, that tick calls [`PlanService::wait`]; live, each tick
/// from then on calls [`PlanService::poll`].
pub trait PlanService {
    /// Hands in a request. A request still running is cancelled: the newest wins.
    fn submit(&mut self, request: PlanRequest);

    /// The reply to request `id`, if it is there. Never blocks.
    fn poll(&mut self, id: u64) -> Option<PlanReply>;

    /// The reply to request `id`; blocks until it is there.
    fn wait(&mut self, id: u64) -> PlanReply;

    /// Cancels whatever runs.
    fn cancel(&mut self);
}

/// An armband on the arm of somebody who intends a gesture.
pub trait EmgSource {
    /// Samples that arrive in tick `now`, at most [`MAX_TICK_SAMPLES`](proact_types::MAX_TICK_SAMPLES), oldest first, while the wearer performs `intended`. Called once per tick.
    fn sample_at(&mut self, now: SimTime, intended: Command) -> Vec<EmgSample>;

    /// How long the oldest of these waited since it came, where samples come by themselves.
    fn oldest_sample_wait(&self) -> Option<Duration> {
        None
    }
}

/// An eye tracker.
pub trait GazeTracker {
    /// The measurement that arrives in tick `now`, if one does. `eye` and `direction` are the truth, in `world`.
    fn sample_at(&mut self, now: SimTime, eye: &Point, direction: &Vector, open: bool) -> Option<GazeSample>;
}
