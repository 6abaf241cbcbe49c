//! A headset's controller as a tracked body: the page in the headset tells where it is.

use super::{CaptureStatus, HostClock, MotionCapture};
use crate::DeviceError;
use proact_localization::RawBodyPose;
use std::collections::VecDeque;

/// The controller of the left hand, as a body.
pub const LEFT_CONTROLLER: &str = "left_controller";
/// The controller of the right hand, as a body.
pub const RIGHT_CONTROLLER: &str = "right_controller";
/// Poses that may wait for whoever takes them; of more the oldest go.
const MAX_QUEUED_POSES: usize = 512;

/// What a headset's page tells of a controller, in its `world`: metres with z up. Whoever hears the page feeds it.
#[derive(Debug)]
pub struct ControllerCapture {
    name: String,
    body: String,
    poses: VecDeque<RawBodyPose>,
    connected: bool,
}

impl ControllerCapture {
    /// The controller `body`, one of [`LEFT_CONTROLLER`] and [`RIGHT_CONTROLLER`].
    ///
    /// # Errors
    /// [`DeviceError::UnknownSource`] for another name.
    pub fn open(body: &str, _clock: HostClock) -> Result<Self, DeviceError> {
        if ![LEFT_CONTROLLER, RIGHT_CONTROLLER].contains(&body) {
            let known = format!("headset:{LEFT_CONTROLLER}, headset:{RIGHT_CONTROLLER}");
            return Err(DeviceError::UnknownSource { got: format!("headset:{body}"), known });
        }
        let name = format!("headset, {}", body.replace('_', " "));
        Ok(Self { name, body: body.to_owned(), poses: VecDeque::new(), connected: false })
    }
}

impl MotionCapture for ControllerCapture {
    fn name(&self) -> &str {
        &self.name
    }

    fn drain_poses(&mut self, poses: &mut Vec<RawBodyPose>) -> Result<CaptureStatus, DeviceError> {
        poses.extend(self.poses.drain(..));
        if self.connected {
            return Ok(CaptureStatus::Connected);
        }
        let reason = format!(
            "no {} has been heard of: open the page in the headset (serve --headset), enter AR or VR, and wake the controller",
            self.body.replace('_', " ")
        );
        Ok(CaptureStatus::Waiting { reason })
    }

    fn push_pose(&mut self, pose: RawBodyPose) {
        self.connected = true;
        if self.poses.len() >= MAX_QUEUED_POSES {
            self.poses.pop_front();
        }
        self.poses.push_back(pose);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_fed_comes_out_in_order_and_a_controller_that_there_is_not_is_refused() {
        let clock = HostClock::start();
        let error = ControllerCapture::open("third_controller", clock).unwrap_err().to_string();
        assert!(error.contains("headset:left_controller"), "{error}");
        let mut capture = ControllerCapture::open(LEFT_CONTROLLER, clock).unwrap();
        let mut poses = Vec::new();
        let CaptureStatus::Waiting { reason } = capture.drain_poses(&mut poses).unwrap() else {
            panic!("nobody fed it")
        };
        assert!(reason.contains("no left controller has been heard of"), "{reason}");
        let pose = |stamp| RawBodyPose {
            body: LEFT_CONTROLLER.to_owned(),
            id: None,
            stamp,
            arrival: stamp,
            position: [0.0; 3],
            quaternion: [0.0, 0.0, 0.0, 1.0],
            tracked: true,
        };
        (0..2 * MAX_QUEUED_POSES as i64).for_each(|stamp| capture.push_pose(pose(stamp)));
        assert_eq!(capture.drain_poses(&mut poses).unwrap(), CaptureStatus::Connected);
        assert_eq!((poses.len(), poses[0].stamp), (MAX_QUEUED_POSES, MAX_QUEUED_POSES as i64), "the newest");
    }
}
