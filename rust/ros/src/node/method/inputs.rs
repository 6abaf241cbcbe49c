//! What the method listens to, beside the world.

use super::{GazeWord, MethodNode};
use crate::{
    joy,
    messages::{
        geometry_msgs::{PoseStamped, Vector3Stamped},
        mpl_control::graspActionResult,
        proact_msgs::View,
        sensor_msgs::Joy,
        std_msgs::String as Text,
    },
    node::{Graph, NodeError, convert, graph::Jobs, intent::IntentView},
};
use proact_types::{BlockId, Gesture, InputSource, Point, SignKind};
use rosrust::Subscriber;

pub(super) fn listen(graph: &Graph, jobs: &Jobs<MethodNode>) -> Result<Vec<Subscriber>, NodeError> {
    Ok(vec![
        graph.listen("emg", 1, jobs, |node: &mut MethodNode, m: Text| match m.data.parse::<Gesture>() {
            Ok(gesture) => {
                node.joy_acts = false;
                node.act(gesture);
            }
            Err(error) => node.common.faults.refuse("emg", &error.to_string()),
        })?,
        graph.listen("joy", 1, jobs, |node: &mut MethodNode, m: Joy| {
            let gesture = joy::gesture(&m.axes, &m.buttons, node.gazes(), node.is_closed());
            // A joystick at rest repeats itself; it must not talk over the armband.
            if gesture != node.joy || gesture != Gesture::NoMotion {
                (node.joy, node.joy_acts) = (gesture, true);
                node.act(gesture);
            } else if node.joy_acts {
                node.watch.hear(node.common.now(), InputSource::GestureTopic, SignKind::Alive);
            }
        })?,
        graph.listen("block_id", 1, jobs, |node: &mut MethodNode, m: Text| {
            let now = node.common.now();
            match BlockId::ALL.into_iter().find(|id| id.ros_name() == m.data) {
                Some(block) => {
                    node.highlight = Some((now, block));
                    node.hear_gaze(GazeWord::Block, &[]);
                }
                None => node.common.faults.refuse("block_id", &format!("{:?} is no block", m.data)),
            }
        })?,
        graph.listen("gaze_table_hit_location", 1, jobs, |node: &mut MethodNode, m: Vector3Stamped| {
            let point = Point::new(m.vector.x, m.vector.y, m.vector.z);
            if !point.iter().all(|v| v.is_finite()) {
                return node.common.faults.refuse("gaze", "the gaze's place on the table is not finite");
            }
            node.place = point;
            node.hear_gaze(GazeWord::Table, point.coords.as_slice());
        })?,
        graph.listen(
            "proact/intent",
            1,
            jobs,
            |node: &mut MethodNode, m: View| match serde_json::from_str::<IntentView>(&m.json) {
                Ok(view) => {
                    node.posterior = view.posterior.to_vec();
                    node.gaze = view.gaze;
                    if let Some(gaze) = view.gaze.filter(|gaze| gaze.valid) {
                        let ray: Vec<f64> =
                            gaze.origin.iter().chain(gaze.direction.iter()).copied().collect();
                        node.hear_gaze(GazeWord::Ray, &ray);
                    }
                }
                Err(error) => node.common.faults.refuse("intent", &error.to_string()),
            },
        )?,
        // The simulator judges the pose; here it only counts that it comes and moves.
        graph.listen("Shoulderpad_filtered_pose", 1, jobs, |node: &mut MethodNode, m: PoseStamped| {
            if let Ok(pose) = convert::read_pose(&m.pose) {
                node.hear_shoulder(pose);
            }
        })?,
        graph.listen("grasp/result", 10, jobs, |node: &mut MethodNode, m: graspActionResult| {
            let done = node.hand_done(&m.status.goal_id.id);
            node.common.note("publish", done);
        })?,
        graph.listen("proact/heartbeat", 100, jobs, |node: &mut MethodNode, m: Text| {
            if m.data != rosrust::name() {
                node.lost.remove(&m.data);
                node.others.insert(m.data, node.common.now());
            }
        })?,
    ])
}
