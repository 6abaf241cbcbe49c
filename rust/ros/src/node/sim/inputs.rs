//! What the simulator listens to: our own stages in typed messages, and other people's in the original's.

use super::{COMMAND, PERSON, SimNode};
use crate::{
    messages::{
        gazebo_msgs::LinkState,
        geometry_msgs::PoseStamped,
        proact_msgs::{Command as CommandMessage, Person},
        std_msgs::String as Text,
        trajectory_msgs::JointTrajectory,
    },
    node::{
        NodeError, RosGraph,
        arm_actions::ArmActions,
        convert,
        graph::Jobs,
        wire::{self, MethodCommand},
    },
};
use proact_control::MotionCommand;
use proact_messages::original::{ARM_MODEL, relative};
use proact_types::{Command, EventKind, SimTime};
use rosrust::Subscriber;

pub(super) fn subscribe(
    graph: &RosGraph,
    jobs: &Jobs<SimNode>,
    node: &SimNode,
) -> Result<Vec<Subscriber>, NodeError> {
    let mut all = ArmActions::subscribe(graph, jobs)?;
    let names: Vec<String> = node.actions.controllers.list().iter().map(|c| c.name().to_owned()).collect();
    for name in names {
        let topic = format!("{ARM_MODEL}/{name}/command");
        all.push(graph.subscribe_with_caller(
            &topic,
            1,
            jobs,
            move |node: &mut SimNode, message: JointTrajectory, caller| {
                // The method says it in full, too.
                if !node.typed_callers.contains(caller) {
                    node.actions.receive_command(&name, &message);
                }
            },
        )?);
    }
    all.push(graph.subscribe(
        relative::SET_LINK_STATE,
        10,
        jobs,
        |node: &mut SimNode, link: LinkState| {
            if let Err(reason) = node.set_link(&link) {
                node.node_diagnostics.record_refusal("pose", &reason);
            }
        },
    )?);
    all.push(graph.subscribe_with_caller(
        relative::SHOULDER,
        1,
        jobs,
        |node: &mut SimNode, m: PoseStamped, caller| {
            if !node.typed_callers.contains(caller) {
                node.receive_shoulder(&m);
            }
        },
    )?);
    all.push(graph.subscribe_with_caller(PERSON, 100, jobs, |node: &mut SimNode, m: Person, caller| {
        node.register_typed_caller(caller);
        match wire::read_person(&m) {
            Ok(both) if node.lockstep => {
                node.person.update(SimTime(m.tick), both);
            }
            Ok((input, head)) => {
                node.record_input(PERSON, convert::tick(&m.header.stamp), caller);
                node.task_publisher.head = head;
                if let Some(pose) = input.shoulder {
                    node.robot.set_shoulder(pose);
                }
            }
            Err(reason) => node.node_diagnostics.record_refusal("person", &reason),
        }
    })?);
    all.push(graph.subscribe_with_caller(
        COMMAND,
        100,
        jobs,
        |node: &mut SimNode, m: CommandMessage, caller| {
            node.register_typed_caller(caller);
            match wire::read_command(&m, node.counts) {
                Ok(method_command) if node.lockstep => {
                    node.command.update(SimTime(m.tick), method_command);
                }
                Ok(method_command) => {
                    // A method's display comes with each of its steps; a bare command promises no other.
                    if method_command.method_status.is_some() {
                        node.record_input(COMMAND, convert::tick(&m.header.stamp), caller);
                    }
                    node.release_hold(&method_command);
                    node.apply_command(method_command);
                }
                Err(reason) => node.node_diagnostics.record_refusal("command", &reason),
            }
        },
    )?);
    all.push(graph.subscribe("proact/heartbeat", 100, jobs, |node: &mut SimNode, message: Text| {
        node.receive_heartbeat(&message.data);
    })?);
    Ok(all)
}

impl SimNode {
    fn receive_shoulder(&mut self, message: &PoseStamped) {
        let stamp = message.header.stamp.seconds();
        if stamp != 0.0 && stamp < self.base_stamp {
            let reason =
                format!("Shoulderpad_filtered_pose goes back from {} s to {stamp} s", self.base_stamp);
            return self.node_diagnostics.record_refusal("time", &reason);
        }
        match convert::read_pose(&message.pose) {
            Ok(pose) => {
                self.base_stamp = stamp;
                self.robot.set_shoulder(pose);
            }
            Err(reason) => {
                self.node_diagnostics.record_refusal("pose", &format!("Shoulderpad_filtered_pose: {reason}"))
            }
        }
    }

    pub(super) fn set_link(&mut self, link: &LinkState) -> Result<(), String> {
        let base = format!("{}::{}", ARM_MODEL, self.robot.model().links[0].name);
        if link.link_name != base {
            return Err(format!("link {:?} cannot be set, only {base:?}", link.link_name));
        }
        if !matches!(link.reference_frame.as_str(), "" | "world") {
            return Err(format!("reference frame {:?}, expected world", link.reference_frame));
        }
        self.robot.set_shoulder(convert::read_pose(&link.pose)?);
        Ok(())
    }

    fn register_typed_caller(&mut self, caller: &str) {
        if !self.typed_callers.contains(caller) {
            self.typed_callers.insert(caller.to_owned());
        }
    }

    /// The arm is not held any more if the method is heard again, and stops the arm itself or sees a relaxed hand.
    fn release_hold(&mut self, method_command: &MethodCommand) {
        let relaxed =
            method_command.method_status.as_ref().is_some_and(|status| status.gesture == Command::NoMotion);
        if relaxed && self.inputs.stale().any(|topic| *topic == PERSON) {
            // A hand that is seen to relax may go on without a person who does not come back.
            self.inputs.forget(&PERSON);
        }
        let stops = matches!(method_command.motion, Some(MotionCommand::Hold));
        let is_command_fresh = self.inputs.stale().all(|topic| *topic != COMMAND);
        if (relaxed || stops) && is_command_fresh && self.task_publisher.hold_stop.take().is_some() {
            self.events.push(EventKind::Rearmed);
        }
    }

    /// What our own method asks for.
    pub(super) fn apply_command(&mut self, method_command: MethodCommand) {
        if let Some(command) = method_command.motion {
            // Where the arm is held the method learns from the state that its command was not followed.
            self.robot.last_command_number = method_command.command_number;
            if self.task_publisher.hold_stop.is_none() {
                self.robot.command_arm(command);
                self.actions.preempt_arm();
            }
        }
        if let Some(command) = method_command.hand {
            self.robot.command_hand(command);
            self.actions.preempt_hand();
        }
        if method_command.method_status.is_some() {
            self.task_publisher.method_status = method_command.method_status;
        }
        self.events.extend(method_command.events);
    }
}
