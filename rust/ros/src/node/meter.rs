//! Measures the other nodes from outside, as a node of its own: for `proact bench ros`.

use super::{
    NodeError, RosGraph,
    graph::{Jobs, parameter},
};
use crate::messages::{
    sensor_msgs::JointState, std_msgs::String as Text, tf2_msgs::TFMessage, trajectory_msgs::JointTrajectory,
};
use proact_messages::original::{ARM_MODEL, relative, topic};
use proact_types::Gesture;
use rosrust::Publisher;
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};

/// Between two gestures of a kind, as an armband has it.
const DECISION: Duration = Duration::from_millis(50);
/// Decisions from one movement to the next.
const CYCLE: usize = 4;

/// What was measured.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// From a gesture's message to the joint command that follows from it, ms, each.
    pub command_ms: Vec<f64>,
    /// From one message of the joint states to the next, ms, each.
    pub joint_states_ms: Vec<f64>,
    /// The same of the frames.
    pub tf_ms: Vec<f64>,
}

#[derive(Default)]
struct Meter {
    measured: Measured,
    asked: Option<Instant>,
    joint_states: Option<Instant>,
    tf: Option<Instant>,
}

/// Lets method A move a joint to and fro, `~count` times, and measures. The method's nodes must run already.
///
/// # Errors
/// [`NodeError`]; [`NodeError::Setup`] if the method does not answer.
pub fn run_meter() -> Result<Measured, NodeError> {
    let graph = RosGraph::join("proact_meter")?;
    let count: i32 = parameter("~count", 200, "how many commands are measured")?;
    let emg: Publisher<Text> = graph.publish(relative::EMG, 10, false)?;
    let jobs: Jobs<Meter> = Jobs::default();
    // Time is taken where the message arrives, before it waits for the loop.
    let since = |last: &mut Option<Instant>, at: Instant, all: &mut Vec<f64>| {
        if let Some(before) = last.replace(at) {
            all.push(at.duration_since(before).as_secs_f64() * 1e3);
        }
    };
    let _command = graph.listen_at(
        &format!("{ARM_MODEL}/j0_controller/command"),
        10,
        &jobs,
        |meter: &mut Meter, m: JointTrajectory, at, _| {
            if !m.points.is_empty()
                && let Some(asked) = meter.asked.take()
            {
                meter.measured.command_ms.push(at.duration_since(asked).as_secs_f64() * 1e3);
            }
        },
    )?;
    let _states = graph.listen_at(
        relative::JOINT_STATES,
        100,
        &jobs,
        move |meter: &mut Meter, _: JointState, at, _| {
            since(&mut meter.joint_states, at, &mut meter.measured.joint_states_ms);
        },
    )?;
    let _tf = graph.listen_at("/tf", 100, &jobs, move |meter: &mut Meter, _: TFMessage, at, _| {
        since(&mut meter.tf, at, &mut meter.measured.tf_ms);
    })?;

    let mut meter = Meter::default();
    let (mut sent, mut wait_until) = (0_usize, Instant::now());
    let give_up = Instant::now() + Duration::from_secs(60 + count as u64);
    while graph.is_ok() && meter.measured.command_ms.len() < count as usize {
        if Instant::now() > give_up {
            let got = meter.measured.command_ms.len();
            return Err(NodeError::Setup {
                what: "the method node".to_owned(),
                reason: format!("{got} commands of {count} came; does `proact node method --method A` run?"),
            });
        }
        if Instant::now() >= wait_until {
            let gesture = match sent % (2 * CYCLE) {
                0 => Gesture::WristExtension,
                CYCLE => Gesture::WristFlexion,
                _ => Gesture::NoMotion,
            };
            meter.asked = (gesture != Gesture::NoMotion).then(Instant::now).or(meter.asked);
            emg.send(Text { data: gesture.ros_name().to_owned() })
                .map_err(|e| NodeError::Setup { what: topic::EMG.to_owned(), reason: e.to_string() })?;
            sent += 1;
            wait_until = Instant::now() + DECISION;
        }
        jobs.run_next(&mut meter, wait_until.saturating_duration_since(Instant::now()));
    }
    Ok(meter.measured)
}
