//! Measures the other nodes from outside, as a node of its own: for `proact bench ros`.

use super::{
    NodeError, RosGraph,
    graph::{Jobs, parameter},
};
use crate::messages::{
    sensor_msgs::JointState, std_msgs::String as Text, tf2_msgs::TFMessage, trajectory_msgs::JointTrajectory,
};
use crate::publishing::Publisher;
use proact_messages::original::{ARM_MODEL, relative, topic};
use proact_types::Command;
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};

/// Between two gestures of a kind, as an armband has it.
const DECISION_PERIOD: Duration = Duration::from_millis(50);
/// Decisions from one movement to the next.
const DECISIONS_PER_MOVEMENT: usize = 4;

/// What was measured.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct NodeLatencies {
    /// From a gesture's message to the joint command that follows from it, ms, each.
    pub command_ms: Vec<f64>,
    /// From one message of the joint states to the next, ms, each.
    pub joint_states_ms: Vec<f64>,
    /// The same of the frames.
    pub tf_ms: Vec<f64>,
}

#[derive(Default)]
struct LatencyMeter {
    latencies: NodeLatencies,
    gesture_sent_at: Option<Instant>,
    last_joint_states_at: Option<Instant>,
    last_tf_at: Option<Instant>,
}

/// Lets method A move a joint to and fro, `~count` times, and measures. The method's nodes must run already.
///
/// # Errors
/// [`NodeError`]; [`NodeError::Setup`] if the method does not answer.
pub fn run_meter() -> Result<NodeLatencies, NodeError> {
    let graph = RosGraph::join("proact_meter")?;
    let count: i32 = parameter("~count", 200, "how many commands are measured")?;
    let emg: Publisher<Text> = graph.advertise(relative::EMG, 10, false)?;
    let jobs: Jobs<LatencyMeter> = Jobs::default();
    // Time is taken where the message arrives, before it waits for the loop.
    let since = |last: &mut Option<Instant>, at: Instant, all: &mut Vec<f64>| {
        if let Some(before) = last.replace(at) {
            all.push(at.duration_since(before).as_secs_f64() * 1e3);
        }
    };
    let _command = graph.subscribe_with_arrival(
        &format!("{ARM_MODEL}/j0_controller/command"),
        10,
        &jobs,
        |meter: &mut LatencyMeter, m: JointTrajectory, at, _| {
            if !m.points.is_empty()
                && let Some(sent_at) = meter.gesture_sent_at.take()
            {
                meter.latencies.command_ms.push(at.duration_since(sent_at).as_secs_f64() * 1e3);
            }
        },
    )?;
    let _states = graph.subscribe_with_arrival(
        relative::JOINT_STATES,
        100,
        &jobs,
        move |meter: &mut LatencyMeter, _: JointState, at, _| {
            since(&mut meter.last_joint_states_at, at, &mut meter.latencies.joint_states_ms);
        },
    )?;
    let _tf = graph.subscribe_with_arrival(
        "/tf",
        100,
        &jobs,
        move |meter: &mut LatencyMeter, _: TFMessage, at, _| {
            since(&mut meter.last_tf_at, at, &mut meter.latencies.tf_ms);
        },
    )?;

    let mut meter = LatencyMeter::default();
    let (mut sent, mut wait_until) = (0_usize, Instant::now());
    let give_up = Instant::now() + Duration::from_secs(60 + count as u64);
    while graph.is_ok() && meter.latencies.command_ms.len() < count as usize {
        if Instant::now() > give_up {
            let got = meter.latencies.command_ms.len();
            return Err(NodeError::Setup {
                what: "the method node".to_owned(),
                reason: format!("{got} commands of {count} came; does `proact node method --method A` run?"),
            });
        }
        if Instant::now() >= wait_until {
            let command = match sent % (2 * DECISIONS_PER_MOVEMENT) {
                0 => Command::WristExtension,
                DECISIONS_PER_MOVEMENT => Command::WristFlexion,
                _ => Command::NoMotion,
            };
            meter.gesture_sent_at =
                (command != Command::NoMotion).then(Instant::now).or(meter.gesture_sent_at);
            emg.send(Text { data: command.ros_name().to_owned() })
                .map_err(|e| NodeError::Setup { what: topic::EMG.to_owned(), reason: e.to_string() })?;
            sent += 1;
            wait_until = Instant::now() + DECISION_PERIOD;
        }
        jobs.run_next(&mut meter, wait_until.saturating_duration_since(Instant::now()));
    }
    Ok(meter.latencies)
}
