//! Poses of a ROS 1 graph as motion capture: `ros:/TOPIC` and `tf:PARENT/FRAME`.

use proact_devices::DeviceError;
use proact_devices::motion_capture::{CaptureScheme, HostClock, MotionCapture, split};
use proact_localization::UpAxis;

/// The kinds of motion capture that need a graph. Without the feature `ros` they are named, and say what they need.
pub const ROS_SCHEMES: [CaptureScheme; 2] = [
    CaptureScheme {
        scheme: "ros",
        form: "ros:/TOPIC",
        split: split::whole,
        up: UpAxis::Z,
        open: |topic, _, clock| open_topic(topic, clock),
    },
    CaptureScheme {
        scheme: "tf",
        form: "tf:PARENT/FRAME",
        split: split::first_slash,
        up: UpAxis::Z,
        open: open_tf,
    },
];

type Opened = Result<Box<dyn MotionCapture>, DeviceError>;

#[cfg(feature = "ros")]
mod on_a_graph {
    use super::{HostClock, Opened};
    use proact_devices::motion_capture::{Inflow, ThreadedCapture};
    use proact_localization::{Nanos, RawBodyPose};
    use proact_ros::node::{TakesPoses, follow_pose_topic, follow_tf};

    /// What the reader's thread hands over to.
    #[derive(Clone)]
    struct Taker(Inflow);

    impl TakesPoses for Taker {
        fn now(&self) -> Nanos {
            self.0.clock.now()
        }

        fn push(&self, pose: RawBodyPose) {
            self.0.push(pose);
        }

        fn wait(&self, reason: String) {
            self.0.wait(reason);
        }

        fn is_over(&self) -> bool {
            self.0.is_over()
        }
    }

    fn start(name: String, clock: HostClock, follow: impl FnOnce(&Taker) + Send + 'static) -> Opened {
        let waiting_for = format!("{name} has not been heard of yet");
        Ok(Box::new(ThreadedCapture::start(name, clock, waiting_for, |inflow| follow(&Taker(inflow)))))
    }

    pub(super) fn open_topic(topic: &str, clock: HostClock) -> Opened {
        let named = topic.to_owned();
        start(format!("ROS topic {topic}"), clock, move |taker| follow_pose_topic(&named, taker))
    }

    pub(super) fn open_tf(parent: &str, frame: &str, clock: HostClock) -> Opened {
        let (above, named) = (parent.to_owned(), frame.to_owned());
        start(format!("tf, {frame} in {parent}"), clock, move |taker| follow_tf(&above, &named, taker))
    }
}

#[cfg(not(feature = "ros"))]
mod on_a_graph {
    use super::{DeviceError, HostClock, Opened};

    fn none(name: String) -> Opened {
        Err(DeviceError::Source { name, reason: crate::NO_ROS.to_owned() })
    }

    pub(super) fn open_topic(topic: &str, _: HostClock) -> Opened {
        none(format!("ros:{topic}"))
    }

    pub(super) fn open_tf(parent: &str, frame: &str, _: HostClock) -> Opened {
        none(format!("tf:{parent}/{frame}"))
    }
}

use on_a_graph::{open_tf, open_topic};

#[cfg(test)]
mod tests {
    use crate::Registry;
    use proact_devices::motion_capture::body_of;

    #[test]
    fn topics_are_bodies_and_frames_are_split_from_what_they_are_in() {
        let captures = Registry::standard().captures;
        let body = |name: &str| body_of(&captures, &name.parse().unwrap()).map(str::to_owned);
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
