use proact_arm::{ArmModel, JointLimits};
use proact_messages::original::{ARM_MODEL, topic};
use proact_types::{Scene, SimTime};
use std::f64::consts::TAU;

/// A state of the arm or of an object that is older than this is not scored, milliseconds: 25 messages at the original's 50 Hz. A gap
/// in the bag stays a gap in the trace.
pub(super) const MAX_STATE_AGE_MS: u64 = 500;

/// When each part of the state of a trial was last received from a bag.
pub(super) struct ReceiptTimes {
    /// The moving joints, in their order.
    pub(super) joints: Vec<Option<SimTime>>,
    pub(super) base: Option<SimTime>,
    /// The objects, in the order of the scene.
    pub(super) objects: Vec<Option<SimTime>>,
}

impl ReceiptTimes {
    /// Before the first message.
    pub(super) fn new(joints: usize, objects: usize) -> Self {
        Self { joints: vec![None; joints], base: None, objects: vec![None; objects] }
    }

    pub(super) fn has_any_joint(&self) -> bool {
        self.joints.iter().any(Option::is_some)
    }

    pub(super) fn has_any_object(&self) -> bool {
        self.objects.iter().any(Option::is_some)
    }

    /// Whether all joints, the base and all objects were received within [`MAX_STATE_AGE_MS`] before `time`.
    pub(super) fn is_complete(&self, time: SimTime) -> bool {
        let recent = |at: &Option<SimTime>| at.is_some_and(|at| time.millis_since(at) <= MAX_STATE_AGE_MS);
        self.joints.iter().chain(&self.objects).chain([&self.base]).all(recent)
    }

    /// What was never received, with the topic that has it.
    pub(super) fn missing(&self, arm: &ArmModel, scene: &Scene) -> Vec<String> {
        let joints = arm.moving().zip(&self.joints).filter(|(_, at)| at.is_none());
        let joints: Vec<&str> = joints.map(|(joint, _)| arm.joints[joint].name.as_str()).collect();
        let objects = scene.objects.iter().zip(&self.objects).filter(|(_, at)| at.is_none());
        let objects: Vec<&str> = objects.map(|(object, _)| object.ros_name.as_str()).collect();
        let base: &[&str] = if self.base.is_none() { &[ARM_MODEL] } else { &[] };
        let parts = [
            ("joints", joints.as_slice(), topic::WRAPPED_JOINT_STATES),
            ("the base", base, topic::MODEL_STATES),
            ("objects", objects.as_slice(), topic::MODEL_STATES),
        ];
        let incomplete = parts.into_iter().filter(|(_, names, _)| !names.is_empty());
        incomplete.map(|(what, names, topic)| format!("{what} {} in {topic}", names.join(", "))).collect()
    }
}

/// A bag has angles in (-pi, pi]: the equal angle that is nearest to the one before, of the first one to the middle of its limits, rad.
pub(super) fn unwrap_angle(angle: f64, before: Option<f64>, limits: &JointLimits) -> f64 {
    let near = before.unwrap_or((limits.lower + limits.upper) / 2.0);
    angle + TAU * ((near - angle) / TAU).round()
}
