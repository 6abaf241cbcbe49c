//! Motion planning for an arm among obstacles: OMPL searches, FCL tells what touches.
//!
//! [`ArmPlanner`] answers a [`PlanRequest`](proact_types::PlanRequest): it leaves the start (straight up, while
//! the hand is around or on something), finds paths of entering the goal (a grip from above, an upright place, a
//! pose, arm angles), connects the two in joint space by RRTConnect or another [`PlannerName`], and times the whole under speed and
//! acceleration limits. [`PlanWorker`] does so on a thread of its own. [`CollisionScene`] is the layer below.
//!
//! The reply depends on the request alone: every random choice is seeded by it and searches are bounded by
//! iterations, never by the clock. No files, no ROS. All state validity checks stay in C++.
//!
//! Frames: requests are in `world`; joint vectors are arm joints, base to tip. Metres, radians, seconds.

// The worker is this crate's purpose: planning beside the tick needs a thread.
#![allow(clippy::disallowed_methods)]
// One of the four crates that talk to C++; each block says why it is sound.
#![allow(unsafe_code)]
#![cfg_attr(test, allow(clippy::unwrap_used))]

mod approach_paths;
mod approach_search;
mod arm_planner;
mod axis_ik;
mod blending;
mod bridge;
mod clearance;
mod connected_path;
mod context;
mod continuous_joints;
mod departure;
mod error;
mod failure;
mod grasp_yaw;
mod intermediate_goal;
mod joint_path;
mod partial_arm;
mod path_refinement;
mod person;
mod plan_stats;
mod problem;
mod scene;
mod search;
mod smoothing;
mod state_check;
mod status_label;
mod timing;
mod worker;

pub use arm_planner::ArmPlanner;
pub use error::PlanningError;
pub use person::{PersonGeometry, person_obstacles};
pub use plan_stats::{PlanStage, PlanStats, thread_cpu_secs};
pub use proact_testbed::{PlannerName, PlannerOptions, SearchLimits};
pub use scene::CollisionScene;
pub use search::{BaselineOutcome, CancelFlag, MeshObstacle, Roadmap, SearchOutcome, SearchStats};
pub use status_label::status_label;
pub use worker::{PlanLog, PlanWorker};
