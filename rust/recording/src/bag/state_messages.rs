//! The messages that a trial's bag has of a state, from one to the next.

use super::messages as ros;
use proact_messages::original::ARM_MODEL;

/// What a state is recorded as.
#[derive(Clone, Debug, Default)]
pub(super) struct StateMessages {
    pub(super) joints: ros::JointState,
    pub(super) limit_efforts: ros::JointState,
    pub(super) links: ros::TfMessage,
    pub(super) models: ros::ModelStates,
}

impl StateMessages {
    /// With the names of joints, by alphabet, and of objects' models; `links` are as the state orders them.
    pub(super) fn new(
        joints: Vec<String>,
        links: Vec<ros::TransformStamped>,
        objects: impl Iterator<Item = String>,
    ) -> Self {
        let joints = ros::JointState { name: joints, ..Default::default() };
        let models = ros::ModelStates {
            name: std::iter::once(ARM_MODEL.to_owned()).chain(objects).collect(),
            ..Default::default()
        };
        Self { limit_efforts: joints.clone(), joints, links: ros::TfMessage { transforms: links }, models }
    }
}
