//! Poses of a ROS 1 graph as motion capture: `ros:/TOPIC` and `tf:PARENT/FRAME`.

use proact_devices::DeviceError;
use proact_devices::motion_capture::{CaptureScheme, HostClock, MotionCapture, split};
use proact_localization::UpAxis;

/// The kinds of motion capture that need a graph. Without the feature `ros` they are named, and say what they need.
pub const ROS_SCHEMES: [CaptureScheme; 2] = [
    CaptureScheme {
        scheme: "ros",
        form: "ros:/TOPIC",
        split: split::unsplit,
        up_axis: UpAxis::Z,
        open: |topic, _, clock| open_topic(topic, clock),
    },
    CaptureScheme {
        scheme: "tf",
        form: "tf:PARENT/FRAME",
        split: split::first_slash,
        up_axis: UpAxis::Z,
        open: open_tf,
    },
];

type OpenResult = Result<Box<dyn MotionCapture>, DeviceError>;

#[cfg(feature = "ros")]
mod ros_graph {
    use super::{HostClock, OpenResult};
    use proact_devices::motion_capture::{PoseQueue, ThreadedCapture};
    use proact_localization::{Nanos, RawBodyPose};
    use proact_ros::node::{PoseSink, follow_pose_topic, follow_tf};

    /// What the reader's thread hands over to.
    #[derive(Clone)]
    struct InflowPoseSink(PoseQueue);

    impl PoseSink for InflowPoseSink {
        fn now(&self) -> Nanos {
            self.0.clock.now()
        }

        fn push(&self, pose: RawBodyPose) {
            self.0.push(pose);
        }

        fn report_waiting(&self, reason: String) {
            self.0.set_waiting(reason);
        }

        fn is_closed(&self) -> bool {
            self.0.is_closed()
        }
    }

    fn start_capture(
        name: String,
        clock: HostClock,
        follow: impl FnOnce(&InflowPoseSink) + Send + 'static,
    ) -> OpenResult {
        let waiting_for = format!("{name} has not been heard of yet");
        Ok(Box::new(ThreadedCapture::start(name, clock, waiting_for, |inflow| {
            follow(&InflowPoseSink(inflow))
        })))
    }

    pub(super) fn open_topic(topic: &str, clock: HostClock) -> OpenResult {
        let named = topic.to_owned();
        start_capture(format!("ROS topic {topic}"), clock, move |sink| follow_pose_topic(&named, sink))
    }

    pub(super) fn open_tf(parent: &str, frame: &str, clock: HostClock) -> OpenResult {
        let (above, named) = (parent.to_owned(), frame.to_owned());
        start_capture(format!("tf, {frame} in {parent}"), clock, move |sink| follow_tf(&above, &named, sink))
    }
}

#[cfg(not(feature = "ros"))]
mod ros_graph {
    use super::{DeviceError, HostClock, OpenResult};

    fn none(name: String) -> OpenResult {
        Err(DeviceError::Source { name, reason: crate::NO_ROS.to_owned() })
    }

    pub(super) fn open_topic(topic: &str, _: HostClock) -> OpenResult {
        none(format!("ros:{topic}"))
    }

    pub(super) fn open_tf(parent: &str, frame: &str, _: HostClock) -> OpenResult {
        none(format!("tf:{parent}/{frame}"))
    }
}

use ros_graph::{open_tf, open_topic};

#[cfg(test)]
mod tests {
    use crate::Registry;
    use proact_devices::motion_capture::body_name;

    #[test]
    fn topics_are_bodies_and_frames_are_split_from_what_they_are_in() {
        let captures = Registry::standard().captures;
        let body = |name: &str| body_name(&captures, &name.parse().unwrap()).map(str::to_owned);
        let topic = "/vrpn_client_node/Shoulderpad/pose";
        assert_eq!(body(&format!("ros:{topic}")).unwrap(), topic);
        assert_eq!(body("tf:optitrack_world/left/base_link").unwrap(), "left/base_link");
        for wrong in ["tf:Shoulderpad", "tf:/base_link", "ros:"] {
            let error = body(wrong).unwrap_err().to_string();
            assert!(error.contains("tf:PARENT/FRAME") && error.contains("ros:/TOPIC"), "{error}");
        }
    }

    #[cfg(not(feature = "ros"))]
    #[test]
    fn a_build_without_ros_says_what_it_needs() {
        let name = "tf:world/Shoulderpad".parse().unwrap();
        let opened =
            proact_devices::motion_capture::OpenedCapture::open(&Registry::standard().captures, &name);
        assert!(opened.err().unwrap().to_string().contains("--features ros"));
    }
}
