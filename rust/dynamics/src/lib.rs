//! Rigid-body dynamics of arm, box and blocks at 1 kHz, computed by ODE.
//!
//! [`RigidBodyPlant`] is the [`Plant`](proact_testbed::ports::Plant) that the tick drives: joints under effort-limited
//! position control, a base that follows its commanded pose, blocks with contacts, and a block that can be
//! attached to a link. It reads no clock, no file and starts no thread.
//!
//! Deterministic: the same construction and commands give the same bits, whatever other plants do in the same
//! process. A plant stays in the thread that made it (it is neither `Send` nor `Sync`), because ODE keeps data
//! for each thread.
//!
//! How it is kept fast: the arm moves in joint angles ([`PhysicsEngine::Reduced`]), hand joints whose command has stood still and
//! been reached become rigid, a carried block shares the body of the link that holds it, resting blocks sleep. On one
//! core of two a tick took 2 us with a still hand, 10 us while the hand closes on a block, and 15 us with 27 free joints
//! and a pinch (`cargo run --release -p proact-dynamics --example tick_times`).
//!
//! Known weaknesses: links of the arm do not collide with each other; the round face of a block stands on six
//! points; blocks roll against an assumed rolling resistance of 0.01; a hand joint that is rigid bears any load and
//! reports no effort; a base pose takes the arm along whatever stands in the way.
//!
//! ```no_run
//! # fn example(model: &proact_arm::ArmModel, scene: &proact_types::Scene, start: &[f64]) -> Result<(), proact_testbed::ports::PlantError> {
//! use proact_dynamics::{DynamicsOptions, RigidBodyPlant};
//! use proact_testbed::ports::Plant;
//! use proact_types::{PlantCommand, Pose, joints, zeros};
//! let shoulder = Pose::translation(-0.39, 0.12, 1.5);
//! let mut plant = RigidBodyPlant::new(model, scene, start, &shoulder, DynamicsOptions::default())?;
//! plant.step(&PlantCommand { position: joints(start), velocity: zeros(start.len()), world_from_base: shoulder })?;
//! println!("{:?}", plant.state().position);
//! # Ok(())
//! # }
//! ```

mod bench;
// cxx writes the unsafe code of the bridge; all that can throw is declared `Result`.
#[allow(unsafe_code)]
mod bridge;
mod rigid_body_plant;
mod snapshot;

pub use bench::{TickTimes, bench_ticks};
pub use proact_testbed::{JointControl, MassSet, PhysicsEngine};
pub use rigid_body_plant::{DynamicsOptions, RigidBodyPlant, Solver};
pub use snapshot::Snapshot;
