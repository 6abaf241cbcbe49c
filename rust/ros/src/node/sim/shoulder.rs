//! An interactive marker in rviz that carries the shoulder.

use super::SimNode;
use crate::{
    frames::WORLD,
    messages::{
        geometry_msgs::Quaternion,
        std_msgs::{ColorRGBA, Header},
        visualization_msgs::{
            InteractiveMarker, InteractiveMarkerControl, InteractiveMarkerFeedback, InteractiveMarkerInit,
            InteractiveMarkerUpdate, Marker,
        },
    },
    node::{NodeError, RosGraph, convert, graph::Jobs},
    publishing::Publisher,
};
use proact_types::{Pose, SimTime};
use rosrust::{Subscriber, error::Result};

/// The server's topics are below this name, as the interactive_markers package has it.
const SERVER: &str = "proact/shoulder";
const MARKER: &str = "shoulder";

/// The server of one marker.
pub(super) struct ShoulderMarker {
    init: Publisher<InteractiveMarkerInit>,
    update: Publisher<InteractiveMarkerUpdate>,
    _feedback: Subscriber,
}

impl ShoulderMarker {
    pub(super) fn new(
        graph: &RosGraph,
        jobs: &Jobs<SimNode>,
        world_from_base: &Pose,
    ) -> std::result::Result<Self, NodeError> {
        let marker = Self {
            init: graph.advertise(&format!("{SERVER}/update_full"), 1, true)?,
            update: graph.advertise(&format!("{SERVER}/update"), 10, false)?,
            _feedback: graph.subscribe(
                &format!("{SERVER}/feedback"),
                1,
                jobs,
                |node: &mut SimNode, message: InteractiveMarkerFeedback| {
                    if let Err(reason) = node.handle_feedback(&message) {
                        node.node_diagnostics.record_refusal("pose", &reason);
                    }
                },
            )?,
        };
        let first = InteractiveMarkerInit {
            server_id: SERVER.to_owned(),
            seq_num: 0,
            markers: vec![interactive_marker(world_from_base)],
        };
        marker
            .init
            .send(first)
            .map_err(|e| NodeError::Setup { what: SERVER.to_owned(), reason: e.to_string() })?;
        Ok(marker)
    }

    /// A sign of life; rviz takes the marker away without.
    pub(super) fn keep_alive(&self) -> Result<()> {
        self.update.send(InteractiveMarkerUpdate {
            server_id: SERVER.to_owned(),
            type_: InteractiveMarkerUpdate::KEEP_ALIVE,
            ..Default::default()
        })
    }
}

impl SimNode {
    /// Somebody has dragged the marker.
    fn handle_feedback(&mut self, message: &InteractiveMarkerFeedback) -> std::result::Result<(), String> {
        if message.marker_name != MARKER {
            return Err(format!("marker {:?} is none of ours, expected {MARKER:?}", message.marker_name));
        }
        if message.event_type != InteractiveMarkerFeedback::POSE_UPDATE {
            return Ok(());
        }
        if !matches!(message.header.frame_id.trim_start_matches('/'), "" | WORLD) {
            return Err(format!("the marker is in frame {:?}, expected {WORLD}", message.header.frame_id));
        }
        self.robot.set_shoulder(convert::read_pose(&message.pose)?);
        Ok(())
    }
}

/// A ball with an arrow to pull and a ring to turn along each axis.
fn interactive_marker(world_from_base: &Pose) -> InteractiveMarker {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let axes = [("x", [1.0, 0.0, 0.0]), ("y", [0.0, 0.0, 1.0]), ("z", [0.0, 1.0, 0.0])];
    let mut controls = vec![InteractiveMarkerControl {
        always_visible: true,
        markers: vec![sphere_marker()],
        ..Default::default()
    }];
    for (name, [x, y, z]) in axes {
        // The control acts along its own x: half a turn of the diagonal brings x onto the axis.
        let orientation = Quaternion { w: half, x: x * half, y: y * half, z: z * half };
        for (kind, mode) in
            [("move", InteractiveMarkerControl::MOVE_AXIS), ("turn", InteractiveMarkerControl::ROTATE_AXIS)]
        {
            controls.push(InteractiveMarkerControl {
                name: format!("{kind}_{name}"),
                orientation: orientation.clone(),
                interaction_mode: mode,
                ..Default::default()
            });
        }
    }
    InteractiveMarker {
        header: Header { frame_id: WORLD.to_owned(), ..convert::header(SimTime(0), WORLD) },
        pose: convert::pose(world_from_base),
        name: MARKER.to_owned(),
        description: "shoulder".to_owned(),
        scale: 0.2,
        controls,
        ..Default::default()
    }
}

fn sphere_marker() -> Marker {
    let mut ball = Marker {
        type_: Marker::SPHERE as i32,
        color: ColorRGBA { r: 0.9, g: 0.9, b: 0.2, a: 0.6 },
        ..Marker::default()
    };
    (ball.scale.x, ball.scale.y, ball.scale.z) = (0.05, 0.05, 0.05);
    ball.pose.orientation.w = 1.0;
    ball
}
