use crate::{JointVector, MAX_OBJECTS, Point, Pose, Vector};
use arrayvec::ArrayVec;
use serde::{Deserialize, Serialize};

/// Pose and twist of one free body.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BodyState {
    /// `world_from_body`.
    pub pose: Pose,
    /// Linear velocity of the centre of mass, m/s, world axes.
    #[serde(rename = "linear")]
    pub linear_velocity: Vector,
    /// Angular velocity, rad/s, world axes.
    #[serde(rename = "angular")]
    pub angular_velocity: Vector,
}

/// An object touched by a link of the arm during the last tick.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Contact {
    /// Index of the object in `Scene::objects`.
    pub object: usize,
    /// Index of the link in `ArmModel::links`.
    pub link: usize,
    /// Where, in `world`.
    pub point: Point,
    /// Unit vector from the link into the object, `world`.
    pub normal: Vector,
    /// Normal force on the object, N, not negative.
    pub force: f64,
}

/// What the controllers ask of the plant for one tick.
#[derive(Clone, Debug, PartialEq)]
pub struct PlantCommand {
    /// Angle asked of each moving joint of the arm model, in its order, rad.
    pub position: JointVector,
    /// Speed that goes with it, rad/s.
    pub velocity: JointVector,
    /// `world_from_base` at the end of the tick: the base is kinematic.
    pub world_from_base: Pose,
}

/// What the plant shows after a tick.
#[derive(Clone, Debug, PartialEq)]
pub struct PlantState {
    /// Angle of each moving joint of the arm model, in its order, rad.
    pub position: JointVector,
    /// Speed, rad/s.
    pub velocity: JointVector,
    /// Torque of the motors, within their limits, N m.
    pub effort: JointVector,
    /// What the joints' stops, and gears that are turned faster than their motors can, bore beside them, N m.
    pub limit_effort: JointVector,
    /// `world_from_base`.
    pub world_from_base: Pose,
    /// The base stood still in the last tick, because it was told to jump.
    pub base_held: bool,
    /// Objects in `Scene::objects` order.
    pub objects: ArrayVec<BodyState, MAX_OBJECTS>,
    /// The attached object, as an index, and `link_from_object` in the link that holds it.
    pub attached: Option<(usize, Pose)>,
    /// Contacts between links and objects in the last tick.
    pub contacts: ArrayVec<Contact, 64>,
}
