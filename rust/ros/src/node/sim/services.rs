//! The services of Gazebo and of the controller manager; those about models and links are in `models`.

use super::{SimNode, models};
use crate::{
    messages::{
        controller_manager_msgs::{
            ControllerState, HardwareInterfaceResources, ListControllers, ListControllersRes, LoadController,
            LoadControllerRes, SwitchController, SwitchControllerReq, SwitchControllerRes, UnloadController,
            UnloadControllerRes,
        },
        gazebo_msgs::{SetLinkState, SetLinkStateRes},
        std_srvs::{Empty, EmptyRes},
    },
    node::{NodeError, RosGraph, graph::Jobs},
};
use proact_messages::original::{ARM_MODEL, relative};
use rosrust::Service;

const STRICT: i32 = 2;

pub(super) fn advertise_services(graph: &RosGraph, jobs: &Jobs<SimNode>) -> Result<Vec<Service>, NodeError> {
    let manager = |name: &str| format!("{ARM_MODEL}/controller_manager/{name}");
    let mut all = models::advertise_services(graph, jobs)?;
    all.extend([
        graph.advertise_service::<Empty, _>("gazebo/pause_physics", jobs, |node: &mut SimNode, _| {
            node.paused = true;
            Ok(EmptyRes {})
        })?,
        graph.advertise_service::<Empty, _>("gazebo/unpause_physics", jobs, |node: &mut SimNode, _| {
            node.paused = false;
            node.heartbeats.clear();
            node.inputs.clear();
            Ok(EmptyRes {})
        })?,
        graph.advertise_service::<Empty, _>("gazebo/reset_world", jobs, |node: &mut SimNode, _| {
            node.reset()?;
            Ok(EmptyRes {})
        })?,
        graph.advertise_service::<SetLinkState, _>(
            relative::SET_LINK_STATE,
            jobs,
            |node: &mut SimNode, request| {
                let done = node.set_link(&request.link_state);
                Ok(SetLinkStateRes { success: done.is_ok(), status_message: done.err().unwrap_or_default() })
            },
        )?,
        graph.advertise_service::<LoadController, _>(
            &manager("load_controller"),
            jobs,
            |node: &mut SimNode, request| {
                Ok(LoadControllerRes { ok: node.actions.controllers.load(&request.name) })
            },
        )?,
        graph.advertise_service::<UnloadController, _>(
            &manager("unload_controller"),
            jobs,
            |node: &mut SimNode, request| {
                Ok(UnloadControllerRes { ok: node.actions.controllers.unload(&request.name) })
            },
        )?,
        graph.advertise_service::<SwitchController, _>(
            &manager("switch_controller"),
            jobs,
            |node: &mut SimNode, request| Ok(SwitchControllerRes { ok: node.switch(&request) }),
        )?,
        graph.advertise_service::<ListControllers, _>(
            &manager("list_controllers"),
            jobs,
            |node: &mut SimNode, _| Ok(ListControllersRes { controller: node.list() }),
        )?,
    ]);
    Ok(all)
}

impl SimNode {
    fn reset(&mut self) -> Result<(), String> {
        self.robot.reset().map_err(|e| e.to_string())?;
        self.task_publisher.reset();
        self.actions.reset(self.robot.model(), &self.robot.last_actuation.command.position);
        Ok(())
    }

    fn switch(&mut self, request: &SwitchControllerReq) -> bool {
        let strict = request.strictness == STRICT;
        // The original's scripts name controllers with or without their namespace's slash.
        let plain = |names: &[String]| -> Vec<String> {
            names.iter().map(|n| n.trim_start_matches('/').to_owned()).collect()
        };
        let (start, stop) = (plain(&request.start_controllers), plain(&request.stop_controllers));
        match self.actions.controllers.switch(&start, &stop, strict) {
            Ok((stopped, left_out)) => {
                if let Some(error) = left_out {
                    self.node_diagnostics.record_refusal("switch_controller", &error.to_string());
                }
                self.actions.abort_stopped_controllers(&stopped);
                true
            }
            Err(error) => {
                self.node_diagnostics.record_refusal("switch_controller", &error.to_string());
                false
            }
        }
    }

    fn list(&mut self) -> Vec<ControllerState> {
        let claimed = |names: &[String]| {
            vec![HardwareInterfaceResources {
                hardware_interface: "hardware_interface::PositionJointInterface".to_owned(),
                resources: names.to_vec(),
            }]
        };
        let controllers = &self.actions.controllers;
        let mut list = vec![ControllerState {
            name: "joint_state_controller".to_owned(),
            state: "running".to_owned(),
            type_: "joint_state_controller/JointStateController".to_owned(),
            claimed_resources: vec![],
        }];
        for controller in controllers.list() {
            if let Some(state) = controllers.state(controller.name()) {
                list.push(ControllerState {
                    name: controller.name().to_owned(),
                    state: state.to_owned(),
                    type_: "position_controllers/JointTrajectoryController".to_owned(),
                    claimed_resources: claimed(controller.joint_names()),
                });
            }
        }
        list
    }
}
