//! The stages of the testbed, one file each: what goes in, what comes out, and the state between.
//!
//! Each has `step(now, input) -> output`, its own state, and the slice of the configuration that it was made with.
//! None reaches into another: [`Testbed`](crate::Testbed) and the nodes of a ROS graph hand outputs on.
//!
//! | stage | in | out |
//! |---|---|---|
//! | [`PersonStage`] | the display, or what live devices bring | [`TickInput`](proact_types::TickInput) |
//! | [`EmgStage`] | samples, a gesture given directly | the gesture in force |
//! | [`IntentStage`] | gaze, objects, task | posterior, highlighted object, place |
//! | [`MethodStage`] | gesture, intent, arm and hand | commands for arm and hand, plan requests, stops |
//! | [`ActuationStage`] | these commands, the tracked shoulder | joint targets, `world_from_base` |
//! | [`WorldStage`] | joint targets | joints, objects, the object in the hand |
//! | [`TaskStage`] | objects, hand | the task's state and events |
//! | [`FeedbackStage`] | events, contact forces | what is to be heard and felt |
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

pub use actuation::{ActuationInput, ActuationOutput, ActuationStage, ExternalJointTarget, ExternalTargets};
pub use display::{DisplayInput, DisplayStage};
pub use emg::{EmgStage, EmgStageInput, EmgStageOutput};
pub use feedback::{FeedbackInput, FeedbackStage};
pub use intent::{
    GAZE_MAX_AGE_MS, GazeFilter, GazeFreshness, GazeMeasurement, IntentInput, IntentOutput, IntentStage,
};
pub use method::{MethodInput, MethodOutput, MethodStage, MethodView};
pub use person::{PersonInput, PersonParts, PersonStage};
pub use task::{TaskOutput, TaskStage, TaskStageInput};
pub use world::{WorldInput, WorldOutput, WorldStage};

/// The stages that compute in a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StageName {
    /// [`EmgStage`].
    Emg,
    /// [`IntentStage`].
    Intent,
    /// [`MethodStage`].
    Method,
    /// [`ActuationStage`].
    Actuation,
    /// [`WorldStage`].
    World,
    /// [`TaskStage`] and [`FeedbackStage`].
    Task,
}

/// Centres of the objects in `world`, in the order of the scene.
fn object_centers(state: &PlantState) -> Vec<Point> {
    state.objects.iter().map(|object| Point::from(object.pose.translation.vector)).collect()
}
