//! What the simulator listens to: our own stages in typed messages, and other people's in the original's.

use super::{MOST_HEARTBEATS, SimNode};
use crate::{
    messages::{
        gazebo_msgs::LinkState,
        geometry_msgs::PoseStamped,
        proact_msgs::{Command, Person},
        std_msgs::String as Text,
        trajectory_msgs::JointTrajectory,
    },
    node::{
        NodeError, RosGraph,
        arm_actions::ArmActions,
        convert,
        graph::Jobs,
        wire::{self, Asked},
    },
};
use proact_messages::original::{ARM_MODEL, relative};
use proact_types::SimTime;
use rosrust::Subscriber;

pub(super) fn listen(
    graph: &RosGraph,
    jobs: &Jobs<SimNode>,
    node: &SimNode,
) -> Result<Vec<Subscriber>, NodeError> {
    let mut all = ArmActions::listen(graph, jobs)?;
    let names: Vec<String> = node.actions.controllers.list().iter().map(|c| c.name().to_owned()).collect();
    for name in names {
        let topic = format!("{ARM_MODEL}/{name}/command");
        all.push(graph.listen_from(
            &topic,
            1,
            jobs,
            move |node: &mut SimNode, message: JointTrajectory, caller| {
                // The method says it in full, too.
                if !node.typed.contains(caller) {
                    node.actions.command(&name, &message);
                }
            },
        )?);
    }
    all.push(graph.listen(relative::SET_LINK_STATE, 10, jobs, |node: &mut SimNode, link: LinkState| {
        if let Err(reason) = node.set_link(&link) {
            node.faults.refuse("pose", &reason);
        }
    })?);
    all.push(graph.listen_from(
        relative::SHOULDER,
        1,
        jobs,
        |node: &mut SimNode, m: PoseStamped, caller| {
            if !node.typed.contains(caller) {
                node.shoulder(&m);
            }
        },
    )?);
    all.push(graph.listen_from("proact/person", 100, jobs, |node: &mut SimNode, m: Person, caller| {
        node.prefer(caller);
        match wire::read_person(&m) {
            Ok(both) if node.lockstep => {
                node.person.take(SimTime(m.tick), both);
            }
            Ok((input, head)) => {
                node.judge.head = head;
                if let Some(pose) = input.shoulder {
                    node.robot.track(pose);
                }
            }
            Err(reason) => node.faults.refuse("person", &reason),
        }
    })?);
    all.push(graph.listen_from("proact/command", 100, jobs, |node: &mut SimNode, m: Command, caller| {
        node.prefer(caller);
        match wire::read_command(&m, node.counts) {
            Ok(asked) if node.lockstep => {
                node.command.take(SimTime(m.tick), asked);
            }
            Ok(asked) => node.take_command(asked),
            Err(reason) => node.faults.refuse("command", &reason),
        }
    })?);
    all.push(graph.listen("proact/heartbeat", 100, jobs, |node: &mut SimNode, message: Text| {
        let now = node.now;
        if node.heartbeats.len() < MOST_HEARTBEATS || node.heartbeats.contains_key(&message.data) {
            node.heartbeats.insert(message.data, now);
        }
    })?);
    Ok(all)
}

impl SimNode {
    fn shoulder(&mut self, message: &PoseStamped) {
        let stamp = message.header.stamp.seconds();
        if stamp != 0.0 && stamp < self.base_stamp {
            let reason =
                format!("Shoulderpad_filtered_pose goes back from {} s to {stamp} s", self.base_stamp);
            return self.faults.refuse("time", &reason);
        }
        match convert::read_pose(&message.pose) {
            Ok(pose) => {
                self.base_stamp = stamp;
                self.robot.track(pose);
            }
            Err(reason) => self.faults.refuse("pose", &format!("Shoulderpad_filtered_pose: {reason}")),
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
        self.robot.track(convert::read_pose(&link.pose)?);
        Ok(())
    }

    fn prefer(&mut self, caller: &str) {
        if !self.typed.contains(caller) {
            self.typed.insert(caller.to_owned());
        }
    }

    /// What our own method asks for.
    pub(super) fn take_command(&mut self, asked: Asked) {
        if let Some(command) = asked.motion {
            self.robot.command_arm(command);
            self.robot.acted_on = asked.number;
            self.actions.method_has_arm();
        }
        if let Some(command) = asked.hand {
            self.robot.command_hand(command);
            self.actions.method_has_hand();
        }
        if asked.shown.is_some() {
            self.judge.shown = asked.shown;
        }
        self.events.extend(asked.events);
    }
}
