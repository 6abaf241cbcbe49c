//! The gaze of an eye tracker as the original's two messages bring it, moved from the frame that they name to the world by
//! what `/tf` says.

use super::{NodeDiagnostics, NodeError, RosGraph, convert, graph::Jobs};
use crate::{
    frames::{HEADSET_WORLD, WORLD},
    gaze_pairs::GazePairs,
    messages::{geometry_msgs::Vector3Stamped, tf2_msgs::TFMessage},
};
use proact_localization::{FrameTree, Nanos, TransformTime};
use proact_messages::original::relative;
use proact_types::{GazeSample, Point, Pose, Vector};
use rosrust::Subscriber;
use std::{
    sync::Arc,
    time::{Duration, Instant},
};

/// A frame on the way from the gaze to the world that moved, and of which nothing was heard for so long, is lost: the
/// original's tools send the slowest ones every 100 ms.
const STALE: Duration = Duration::from_secs(1);

/// A node that takes gazes.
pub(super) trait GazeTopicNode: 'static {
    /// What was heard until now.
    fn gaze_topics(&mut self) -> &mut GazeTopics;
    /// What could not be taken.
    fn node_diagnostics(&self) -> &Arc<NodeDiagnostics>;
    /// The eye sees along this ray, in the world.
    fn receive_gaze(&mut self, gaze: GazeSample);
    /// Whether the two messages of a node are passed over.
    fn ignores_caller(&self, _caller: &str) -> bool {
        false
    }
}

/// Frames and half gazes. Frames are filed by the time at which they came: publishers of one tree may live by clocks of
/// their own, and what matters is what is newest.
pub(super) struct GazeTopics {
    pairs: GazePairs,
    frames: FrameTree,
    started_at: Instant,
}

impl Default for GazeTopics {
    fn default() -> Self {
        Self { pairs: GazePairs::default(), frames: FrameTree::default(), started_at: Instant::now() }
    }
}

/// Listens to the gaze and to what moves it to the world.
pub(super) fn subscribe<S: GazeTopicNode>(
    graph: &RosGraph,
    jobs: &Jobs<S>,
) -> Result<Vec<Subscriber>, NodeError> {
    let half = |topic: &str, is_position: bool| {
        graph.subscribe_with_arrival(
            topic,
            10,
            jobs,
            move |node: &mut S, message: Vector3Stamped, came, caller| {
                if node.ignores_caller(caller) {
                    return;
                }
                match node.gaze_topics().pair_gaze(&message, came, is_position) {
                    Ok(Some(gaze)) => node.receive_gaze(gaze),
                    Ok(None) => {}
                    Err(reason) => node.node_diagnostics().record_refusal("gaze", &reason),
                }
            },
        )
    };
    let tree = |topic: &str, moves: bool| {
        graph.subscribe_with_arrival(
            topic,
            100,
            jobs,
            move |node: &mut S, message: TFMessage, came, _: &str| {
                if let Err(reason) = node.gaze_topics().receive_transforms(&message, came, moves) {
                    node.node_diagnostics().record_refusal("tf", &reason);
                }
            },
        )
    };
    Ok(vec![
        tree("/tf_static", false)?,
        tree("/tf", true)?,
        half(relative::GAZE_POSITION, true)?,
        half(relative::GAZE_DIRECTION, false)?,
    ])
}

impl GazeTopics {
    /// Takes what `/tf` or `/tf_static` brought; the first frame that cannot be is the reason, and the others are taken.
    fn receive_transforms(&mut self, message: &TFMessage, came: Instant, moves: bool) -> Result<(), String> {
        let stamp = self.since_start(came);
        let mut done = Ok(());
        for transform in &message.transforms {
            let (parent, child) = (
                strip_leading_slash(&transform.header.frame_id),
                strip_leading_slash(&transform.child_frame_id),
            );
            let taken = match convert::read_transform(&transform.transform) {
                Err(reason) => Err(format!("frame {child:?}: {reason}")),
                Ok(pose) if moves => {
                    self.frames.set_transform(parent, child, stamp, pose).map_err(|error| error.to_string())
                }
                Ok(pose) => {
                    self.frames.set_static_transform(parent, child, pose).map_err(|error| error.to_string())
                }
            };
            done = done.and(taken);
        }
        done
    }

    /// Takes half a gaze; the whole, in the world, when the other half is there.
    fn pair_gaze(
        &mut self,
        message: &Vector3Stamped,
        came: Instant,
        is_position: bool,
    ) -> Result<Option<GazeSample>, String> {
        let world_from_tracker = self.world_from(&message.header.frame_id, came)?;
        let (v, stamp) = (&message.vector, message.header.stamp.nanos());
        let pair = if is_position {
            self.pairs.add_position(stamp, world_from_tracker * Point::new(v.x, v.y, v.z))
        } else {
            self.pairs.add_direction(stamp, world_from_tracker * Vector::new(v.x, v.y, v.z))
        };
        pair.map(|(origin, direction)| checked_gaze(origin, direction)).transpose()
    }

    /// `world_from_frame` as it was last heard of. The original's headset names no frame, and means its own world.
    fn world_from(&self, frame: &str, now: Instant) -> Result<Pose, String> {
        let named = strip_leading_slash(frame);
        if named == WORLD {
            return Ok(Pose::identity());
        }
        let source = if named.is_empty() { HEADSET_WORLD } else { named };
        let lost = |reason: String| {
            let unnamed = if named.is_empty() { ", in which a gaze without a frame is," } else { "" };
            format!("frame {source:?} of a gaze{unnamed} is not known in {WORLD:?}: {reason}")
        };
        let found = self.frames.lookup_transform(WORLD, source, TransformTime::Latest);
        let world_from_source = found.map_err(|error| lost(error.to_string()))?;
        let newest =
            self.frames.latest_common_time(WORLD, source).map_err(|error| lost(error.to_string()))?;
        let age = newest.map_or(0, |received_at| self.since_start(now) - received_at);
        if age > STALE.as_nanos() as Nanos {
            return Err(lost(format!("/tf was last heard of it {:.1} s ago", age as f64 * 1e-9)));
        }
        Ok(world_from_source)
    }

    fn since_start(&self, at: Instant) -> Nanos {
        at.saturating_duration_since(self.started_at).as_nanos() as Nanos
    }
}

/// tf's names once began with a stroke, and some still send it.
fn strip_leading_slash(frame: &str) -> &str {
    frame.strip_prefix('/').unwrap_or(frame)
}

/// A gaze as it came in; the headset publishes none while it has lost the eye.
fn checked_gaze(origin: Point, direction: Vector) -> Result<GazeSample, String> {
    let values = || origin.iter().chain(direction.iter());
    if let Some(bad) = values().find(|v| !v.is_finite()) {
        return Err(format!("a gaze holds {bad}, expected finite numbers"));
    }
    match direction.try_normalize(1e-9) {
        Some(direction) => Ok(GazeSample { origin, direction, valid: true }),
        None => Err("a gaze has no direction".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        frames::Frame,
        messages::{geometry_msgs::Vector3, std_msgs::Header},
    };
    use nalgebra::{Translation3, UnitQuaternion, vector};
    use proact_types::SimTime;

    fn half(frame: &str, [x, y, z]: [f64; 3]) -> Vector3Stamped {
        let stamp = rosrust::Time { sec: 7, nsec: 0 };
        Vector3Stamped {
            header: Header { seq: 0, stamp, frame_id: frame.to_owned() },
            vector: Vector3 { x, y, z },
        }
    }

    fn tf(parent: &str, child: &str, pose: Pose) -> TFMessage {
        let frame = Frame { parent: parent.into(), child: child.into(), pose };
        TFMessage { transforms: vec![convert::transform(SimTime(0), &frame)] }
    }

    /// A quarter of a turn to the left, a metre ahead.
    fn turned() -> Pose {
        let turn = UnitQuaternion::from_euler_angles(0.0, 0.0, std::f64::consts::FRAC_PI_2);
        Pose::from_parts(Translation3::new(1.0, 0.0, 0.0), turn)
    }

    fn look(topics: &mut GazeTopics, frame: &str, at: Instant) -> Result<GazeSample, String> {
        topics.pair_gaze(&half(frame, [0.1, 0.0, 1.5]), at, true)?;
        Ok(topics.pair_gaze(&half(frame, [1.0, 0.0, 0.0]), at, false)?.expect("both halves are there"))
    }

    #[test]
    fn a_gaze_is_moved_from_the_frame_that_it_names() {
        let mut topics = GazeTopics::default();
        let now = topics.started_at;
        topics.receive_transforms(&tf("world", "room", turned()), now, false).unwrap();
        topics
            .receive_transforms(&tf("room", "/tracker", Pose::translation(0.0, 0.0, 0.2)), now, true)
            .unwrap();
        for (frame, origin, direction) in [
            ("tracker", vector![1.0, 0.1, 1.7], vector![0.0, 1.0, 0.0]),
            ("/room", vector![1.0, 0.1, 1.5], vector![0.0, 1.0, 0.0]),
            ("world", vector![0.1, 0.0, 1.5], vector![1.0, 0.0, 0.0]),
        ] {
            let gaze = look(&mut topics, frame, now).unwrap();
            assert!((gaze.origin.coords - origin).norm() < 1e-12, "{frame}: {}", gaze.origin);
            assert!((gaze.direction - direction).norm() < 1e-12, "{frame}: {}", gaze.direction);
        }
    }

    #[test]
    fn a_gaze_without_a_frame_is_in_the_headsets_world() {
        let mut topics = GazeTopics::default();
        let now = topics.started_at;
        let error = look(&mut topics, "", now).unwrap_err();
        assert!(
            error.contains("\"hololens_world_test\" of a gaze, in which a gaze without a frame is,"),
            "{error}"
        );
        topics.receive_transforms(&tf("world", HEADSET_WORLD, turned()), now, true).unwrap();
        assert!((look(&mut topics, "", now).unwrap().origin.y - 0.1).abs() < 1e-12);
    }

    #[test]
    fn a_frame_that_is_silent_unknown_or_broken_stops_the_gaze() {
        let mut topics = GazeTopics::default();
        let now = topics.started_at;
        topics.receive_transforms(&tf("world", "tracker", turned()), now, true).unwrap();
        assert!(look(&mut topics, "tracker", now + STALE).is_ok());
        let later = now + STALE + Duration::from_millis(100);
        let silent = look(&mut topics, "tracker", later).unwrap_err();
        assert!(silent.ends_with("/tf was last heard of it 1.1 s ago"), "{silent}");
        assert!(look(&mut topics, "hat", now).unwrap_err().ends_with("there is no frame \"hat\""));

        let mut broken = tf("world", "tracker", turned());
        broken.transforms[0].transform.translation.x = f64::NAN;
        broken.transforms.extend(tf("world", "other", turned()).transforms);
        let reason = topics.receive_transforms(&broken, later, true).unwrap_err();
        assert!(reason.starts_with("frame \"tracker\": a transform holds NaN"), "{reason}");
        assert!(look(&mut topics, "tracker", later).is_err(), "what it was before stays silent");
        assert!(look(&mut topics, "other", later).is_ok(), "the rest of the message counts");
        // What is still does not age.
        topics.receive_transforms(&tf("world", "tracker", turned()), later, false).unwrap();
        assert!(look(&mut topics, "tracker", later + Duration::from_secs(3600)).is_ok());
    }
}
