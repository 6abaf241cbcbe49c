//! Commands for the arm's trajectory controllers.

use crate::{
    messages::{
        controller_manager_msgs::{
            ListControllers, ListControllersReq, LoadController, LoadControllerReq, SwitchController,
            SwitchControllerReq,
        },
        trajectory_msgs::{JointTrajectory, JointTrajectoryPoint},
    },
    node::{NodeError, RosGraph, convert},
    publishing::Publisher,
};
use proact_arm::{ArmModel, JointLimits};
use proact_control::MotionCommand;
use proact_messages::original::ARM_MODEL;
use proact_types::SimTime;
use rosrust::error::Result;
use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

/// A speed holds this long without another, s. Silence stops the arm; a message that is late does not.
const VELOCITY_HOLD_SECS: f64 = 0.1;
/// Between two looks at the controllers.
const CONTROLLER_CHECK_PERIOD: Duration = Duration::from_millis(500);
const STRICT: i32 = 2;

/// The publishers of one method: the arm's controller, or one a joint.
pub(super) struct ArmCommandPublisher {
    names: Vec<String>,
    limits: Vec<JointLimits>,
    /// One for all joints, or one each.
    publishers: Vec<Publisher<JointTrajectory>>,
}

impl ArmCommandPublisher {
    pub(super) fn new(
        graph: &RosGraph,
        model: &ArmModel,
        single: bool,
    ) -> std::result::Result<Self, NodeError> {
        let publish = |name: &str| graph.advertise(&format!("{ARM_MODEL}/{name}/command"), 1, false);
        let publishers = if single {
            (0..model.arm_count())
                .map(|j| publish(&single_controller(j)))
                .collect::<std::result::Result<_, _>>()?
        } else {
            vec![publish("arm_controller")?]
        };
        let joints = model.arm.iter().map(|j| &model.joints[*j]);
        Ok(Self {
            names: joints.clone().map(|joint| joint.name.clone()).collect(),
            limits: joints.map(|joint| joint.limits).collect(),
            publishers,
        })
    }

    /// Stops and holds.
    pub(super) fn hold(&self, stamp: SimTime) -> Result<()> {
        self.trajectory(&[], stamp)
    }

    /// Sends a command; `position` is what the arm is asked for now, rad, at the graph's time `stamp`.
    pub(super) fn send(&self, command: &MotionCommand, position: &[f64], stamp: SimTime) -> Result<()> {
        match command {
            MotionCommand::Hold => self.hold(stamp),
            MotionCommand::Follow(path) => {
                let points: Vec<CommandPoint> =
                    path.points.iter().map(|p| (p.time_secs, p.q.to_vec(), p.qd.to_vec())).collect();
                self.trajectory(&points, stamp)
            }
            MotionCommand::Velocity(speeds) => {
                let there = position.iter().zip(speeds).map(|(q, v)| q + v * VELOCITY_HOLD_SECS).collect();
                self.trajectory(&[(VELOCITY_HOLD_SECS, there, vec![])], stamp)
            }
            MotionCommand::Goto(angles) => {
                let secs = |((goal, q), limits): ((&f64, &f64), &JointLimits)| {
                    (goal - q).abs() / limits.velocity.max(1e-3)
                };
                let max_secs = angles.iter().zip(position).zip(&self.limits).map(secs).fold(1e-3, f64::max);
                self.trajectory(&[(max_secs, angles.to_vec(), vec![])], stamp)
            }
        }
    }

    /// `(seconds, angles, speeds or none)` per point; without points the controllers hold.
    fn trajectory(&self, points: &[CommandPoint], stamp: SimTime) -> Result<()> {
        let whole = self.publishers.len() == 1;
        for (k, publisher) in self.publishers.iter().enumerate() {
            let joints = if whole { 0..self.names.len() } else { k..k + 1 };
            let part =
                |values: &[f64]| if values.is_empty() { vec![] } else { values[joints.clone()].to_vec() };
            publisher.send(JointTrajectory {
                joint_names: self.names[joints.clone()].to_vec(),
                points: points
                    .iter()
                    .map(|(secs, q, qd)| JointTrajectoryPoint {
                        positions: part(q),
                        velocities: part(qd),
                        time_from_start: convert::duration(*secs),
                        ..Default::default()
                    })
                    .collect(),
                // rosrust would fill an empty stamp with the wall's time.
                header: convert::header(stamp, ""),
            })?;
        }
        Ok(())
    }

    /// Sees to it that the controllers that this method commands run, now and after a restart of theirs.
    pub(super) fn spawn_controllers(&self) -> ControllerSpawner {
        let arm = vec!["arm_controller".to_owned()];
        let single = (0..self.names.len()).map(single_controller).collect();
        let (start, stop) = if self.publishers.len() == 1 { (arm, single) } else { (single, arm) };
        ControllerSpawner::new(start, stop)
    }
}

type CommandPoint = (f64, Vec<f64>, Vec<f64>);

fn single_controller(joint: usize) -> String {
    format!("j{joint}_controller")
}

/// A thread that looks after the controllers until it is dropped. It is not waited for then: rosrust tries a service that
/// has gone for half a minute.
pub(super) struct ControllerSpawner {
    ended: Arc<AtomicBool>,
    thread: std::thread::Thread,
}

impl ControllerSpawner {
    fn new(start: Vec<String>, stop: Vec<String>) -> Self {
        let ended = Arc::new(AtomicBool::new(false));
        let seen = ended.clone();
        let running = std::thread::spawn(move || {
            while !seen.load(Ordering::Relaxed) {
                // A manager that is not there, or goes while it is asked, is looked for again.
                let _ = ensure_running(&start, &stop);
                std::thread::park_timeout(CONTROLLER_CHECK_PERIOD);
            }
        });
        Self { ended, thread: running.thread().clone() }
    }
}

impl Drop for ControllerSpawner {
    fn drop(&mut self) {
        self.ended.store(true, Ordering::Relaxed);
        self.thread.unpark();
    }
}

fn error_text(error: impl std::fmt::Display) -> String {
    error.to_string()
}

fn ensure_running(start: &[String], stop: &[String]) -> std::result::Result<(), String> {
    let service = |name: &str| format!("{ARM_MODEL}/controller_manager/{name}");
    let list = rosrust::client::<ListControllers>(&service("list_controllers")).map_err(error_text)?;
    let listed = list.req(&ListControllersReq {}).map_err(error_text)??.controller;
    let is = |name: &String, state: &str| listed.iter().any(|c| c.name == *name && c.state == state);
    if start.iter().all(|name| is(name, "running")) {
        return Ok(());
    }
    let load = rosrust::client::<LoadController>(&service("load_controller")).map_err(error_text)?;
    for name in start.iter().filter(|name| !listed.iter().any(|c| c.name == **name)) {
        load.req(&LoadControllerReq { name: name.clone() }).map_err(error_text)??;
    }
    let switch = rosrust::client::<SwitchController>(&service("switch_controller")).map_err(error_text)?;
    let request = SwitchControllerReq {
        start_controllers: start.to_vec(),
        stop_controllers: stop.iter().filter(|name| is(name, "running")).cloned().collect(),
        strictness: STRICT,
        ..Default::default()
    };
    switch.req(&request).map_err(error_text)??;
    Ok(())
}
