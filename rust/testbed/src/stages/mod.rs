//! The stages of the testbed, one file each: what goes in, what comes out, and the state between.
//!
//! Each has `step(now, input) -> output`, its own state, and the slice of the configuration that it was made with.
//! None reaches into another: [`Testbed`](crate::Testbed) and the nodes of a ROS graph hand outputs on.
//!
//! | stage | in | out |
//! |---|---|---|
//! | [`PersonStage`] | the display, or what live devices bring | [`TickInput`](proact_types::TickInput) |
//! | [`EmgStage`] | samples, a gesture given directly | the gesture in force |
//! | [`IntentStage`] | gaze, blocks, task | posterior, highlighted block, place |
//! | [`MethodStage`] | gesture, intent, arm and hand | commands for arm and hand, plan requests, stops |
//! | [`ActuationStage`] | these commands, the tracked shoulder | joint targets, `world_from_base` |
//! | [`WorldStage`] | joint targets | joints, blocks, the block in the hand |
//! | [`TaskStage`] | blocks, the block in the hand | the task's state and events |
//! | [`FeedbackStage`] | events | what is to be heard and felt |
//! | [`DisplayStage`] | all of these | one frame, 60 times a second |

mod actuation;
mod display;
mod emg;
mod feedback;
mod intent;
mod method;
mod person;
mod task;
mod world;

use proact_types::{PlantState, Point};

pub use actuation::{ActuationInput, ActuationOutput, ActuationStage, DrivenJoint};
pub use display::{DisplayInput, DisplayStage};
pub use emg::{EmgStage, EmgStageInput, EmgStageOutput};
pub use feedback::{Cue, FeedbackCue, FeedbackStage, Tone, Vibration};
pub use intent::{GazeFilter, GazeHeard, GazeMeasurement, IntentInput, IntentOutput, IntentStage};
pub use method::{MethodInput, MethodOutput, MethodStage, MethodView};
pub use person::{PersonInput, PersonParts, PersonStage};
pub use task::{TaskInput, TaskOutput, TaskStage};
pub use world::{WorldInput, WorldOutput, WorldStage};

/// Centres of the blocks in `world`, `BlockId::ALL` order.
fn block_centres(state: &PlantState) -> [Point; 4] {
    std::array::from_fn(|k| Point::from(state.blocks[k].pose.translation.vector))
}
