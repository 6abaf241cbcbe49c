//! What the nodes of single stages share: their loop, the world from messages, a sign of life.

use super::{Graph, NodeError, convert, graph::Jobs};
use crate::{
    messages::{
        gazebo_grasp_plugin_ros::GazeboGraspEvent,
        gazebo_msgs::ModelStates,
        rosgraph_msgs::Clock,
        sensor_msgs::JointState,
        std_msgs::{Bool, String as Text},
    },
    world::{StageClock, World, block_of_collision},
};
use proact_types::{BodyState, SimTime, Vector};
use rosrust::{Publisher, Subscriber};
use std::{ops::RangeInclusive, sync::Arc, time::Duration};

/// How long a stage waits for something to happen before it looks after the graph.
const PATIENCE: Duration = Duration::from_millis(20);

/// A stage of the testbed as a node.
pub(super) trait Stage: 'static {
    /// What all stages have.
    fn common(&mut self) -> &mut Common;

    /// These ticks have passed. `now` for stamps is that of [`Common::stamp`].
    fn ticks(&mut self, ticks: RangeInclusive<u64>) -> rosrust::error::Result<()>;
}

/// What all stages have.
pub(super) struct Common {
    pub clock: StageClock,
    pub faults: Arc<super::Faults>,
    name: String,
    heartbeat: Publisher<Text>,
}

impl Common {
    pub(super) fn new(graph: &Graph) -> Result<Self, NodeError> {
        Ok(Self {
            clock: StageClock::default(),
            faults: graph.faults().clone(),
            name: rosrust::name(),
            heartbeat: graph.publish("proact/heartbeat", 10, false)?,
        })
    }

    /// The stage's own time.
    pub(super) fn now(&self) -> SimTime {
        self.clock.now()
    }

    /// The graph's time.
    pub(super) fn stamp(&self) -> SimTime {
        self.clock.graph().unwrap_or_default()
    }

    /// Refuses what could not be sent or taken.
    pub(super) fn note<E: std::fmt::Display>(&self, kind: &'static str, done: Result<(), E>) {
        if let Err(error) = done {
            self.faults.refuse(kind, &error.to_string());
        }
    }
}

/// Runs a stage until the graph ends the node.
pub(super) fn run<S: Stage>(mut graph: Graph, jobs: &Jobs<S>, stage: &mut S) -> Result<(), NodeError> {
    let _clock = graph.listen("/clock", 10, jobs, |stage: &mut S, message: Clock| {
        let common = stage.common();
        let ticks = match common.clock.take(convert::tick(&message.clock)) {
            Ok(ticks) => ticks,
            Err(reason) => return common.faults.refuse("time", &reason),
        };
        let alive = common.heartbeat.send(Text { data: common.name.clone() });
        let done = stage.ticks(ticks).and(alive);
        stage.common().note("publish", done);
    })?;
    graph.watch_master()?;
    while graph.is_ok() {
        jobs.run_next(stage, PATIENCE);
        graph.tell(convert::time(stage.common().stamp()));
    }
    graph.stop_watching();
    Ok(())
}

/// A stage that knows the world.
pub(super) trait Worldly: Stage {
    /// Its world.
    fn world(&mut self) -> &mut World;
}

/// Keeps a stage's world up to date: joints, models, and what the hand holds.
pub(super) fn listen_to_world<S: Worldly>(
    graph: &Graph,
    jobs: &Jobs<S>,
) -> Result<Vec<Subscriber>, NodeError> {
    Ok(vec![
        graph.listen("mpl_right_arm/wrapped_joint_states", 1, jobs, |stage: &mut S, m: JointState| {
            let done = stage.world().take_joints(&m.name, &m.position, &m.velocity);
            stage.common().note("joint_states", done);
        })?,
        graph.listen("gazebo/model_states", 1, jobs, |stage: &mut S, m: ModelStates| {
            let done = take_models(stage.world(), &m);
            stage.common().note("model_states", done);
        })?,
        graph.listen(
            "grasp_event_republisher/grasp_events",
            1,
            jobs,
            |stage: &mut S, m: GazeboGraspEvent| match block_of_collision(&m.object) {
                Some(block) => stage.world().take_grasp(block, m.attached),
                None => {
                    let reason = format!("{:?} is no block's collision", m.object);
                    stage.common().faults.refuse("grasp_events", &reason);
                }
            },
        )?,
        graph.listen("grasp_status", 1, jobs, |stage: &mut S, m: Bool| {
            stage.world().take_grasp_status(m.data);
        })?,
    ])
}

fn take_models(world: &mut World, message: &ModelStates) -> Result<(), String> {
    let (names, poses, twists) = (&message.name, &message.pose, &message.twist);
    if poses.len() != names.len() || twists.len() != names.len() {
        return Err(format!("{} names, {} poses, {} twists", names.len(), poses.len(), twists.len()));
    }
    // All or nothing: half an instant would be a world that never was.
    let bodies: Vec<BodyState> = poses
        .iter()
        .zip(twists)
        .map(|(pose, twist)| {
            let vector = |v: &crate::messages::geometry_msgs::Vector3| Vector::new(v.x, v.y, v.z);
            let (linear, angular) = (vector(&twist.linear), vector(&twist.angular));
            if !linear.iter().chain(angular.iter()).all(|v| v.is_finite()) {
                return Err("a twist is not finite".to_owned());
            }
            Ok(BodyState { pose: convert::read_pose(pose)?, linear, angular })
        })
        .collect::<Result<_, String>>()?;
    for (name, body) in names.iter().zip(bodies) {
        if name == super::outlets::ARM_MODEL {
            world.take_base(body.pose);
        }
        world.take_body(name, body);
    }
    Ok(())
}
