//! The services of Gazebo and of the controller manager.

use super::{SimNode, convert};
use crate::{
    action::GoalState,
    messages::{
        controller_manager_msgs::{
            ControllerState, HardwareInterfaceResources, ListControllers, ListControllersRes, LoadController,
            LoadControllerRes, SwitchController, SwitchControllerReq, SwitchControllerRes, UnloadController,
            UnloadControllerRes,
        },
        gazebo_msgs::{GetModelState, GetModelStateReq, GetModelStateRes, SetLinkState, SetLinkStateRes},
        geometry_msgs::Twist,
        std_srvs::{Empty, EmptyRes},
    },
    node::{NodeError, RosGraph, graph::Jobs},
};
use proact_messages::original::{ARM_MODEL, relative};
use proact_types::{Pose, Vector};
use rosrust::Service;

const STRICT: i32 = 2;

pub(super) fn serve(graph: &RosGraph, jobs: &Jobs<SimNode>) -> Result<Vec<Service>, NodeError> {
    let manager = |name: &str| format!("{ARM_MODEL}/controller_manager/{name}");
    Ok(vec![
        graph.serve::<Empty, _>("gazebo/pause_physics", jobs, |node: &mut SimNode, _| {
            node.paused = true;
            Ok(EmptyRes {})
        })?,
        graph.serve::<Empty, _>("gazebo/unpause_physics", jobs, |node: &mut SimNode, _| {
            node.paused = false;
            node.heartbeats.clear();
            Ok(EmptyRes {})
        })?,
        graph.serve::<Empty, _>("gazebo/reset_world", jobs, |node: &mut SimNode, _| {
            node.reset()?;
            Ok(EmptyRes {})
        })?,
        graph.serve::<GetModelState, _>("gazebo/get_model_state", jobs, |node: &mut SimNode, request| {
            Ok(node.model_state(&request))
        })?,
        graph.serve::<SetLinkState, _>(relative::SET_LINK_STATE, jobs, |node: &mut SimNode, request| {
            let done = node.set_link(&request.link_state);
            Ok(SetLinkStateRes { success: done.is_ok(), status_message: done.err().unwrap_or_default() })
        })?,
        graph.serve::<LoadController, _>(
            &manager("load_controller"),
            jobs,
            |node: &mut SimNode, request| {
                Ok(LoadControllerRes { ok: node.robot.controllers.load(&request.name) })
            },
        )?,
        graph.serve::<UnloadController, _>(
            &manager("unload_controller"),
            jobs,
            |node: &mut SimNode, request| {
                Ok(UnloadControllerRes { ok: node.robot.controllers.unload(&request.name) })
            },
        )?,
        graph.serve::<SwitchController, _>(
            &manager("switch_controller"),
            jobs,
            |node: &mut SimNode, request| Ok(SwitchControllerRes { ok: node.switch(&request) }),
        )?,
        graph.serve::<ListControllers, _>(&manager("list_controllers"), jobs, |node: &mut SimNode, _| {
            Ok(ListControllersRes { controller: node.list() })
        })?,
    ])
}

impl SimNode {
    fn reset(&mut self) -> Result<(), String> {
        let now = self.now;
        self.robot.reset().map_err(|e| e.to_string())?;
        self.judge.reset();
        let text = "the world was reset";
        for k in 0..self.follow.len() {
            let sent = self.follow[k].end(GoalState::Aborted, text, now, super::follow_result(0, text));
            self.note(sent);
        }
        let sent = self.grasp.end(GoalState::Aborted, text, now, super::grasp_result(0));
        self.note(sent);
        Ok(())
    }

    fn switch(&mut self, request: &SwitchControllerReq) -> bool {
        let now = self.now;
        let strict = request.strictness == STRICT;
        // The original's scripts name controllers with or without their namespace's slash.
        let plain = |names: &[String]| -> Vec<String> {
            names.iter().map(|n| n.trim_start_matches('/').to_owned()).collect()
        };
        let (start, stop) = (plain(&request.start_controllers), plain(&request.stop_controllers));
        match self.robot.controllers.switch(&start, &stop, strict) {
            Ok((stopped, left_out)) => {
                if let Some(error) = left_out {
                    self.faults.refuse("switch_controller", &error.to_string());
                }
                let text = "its controller was stopped";
                for (k, name) in super::WITH_ACTION.into_iter().enumerate() {
                    if stopped.iter().any(|n| n == name) {
                        let result = super::follow_result(0, text);
                        let sent = self.follow[k].end(GoalState::Aborted, text, now, result);
                        self.note(sent);
                    }
                }
                true
            }
            Err(error) => {
                self.faults.refuse("switch_controller", &error.to_string());
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
        let controllers = &self.robot.controllers;
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

    fn model_state(&self, request: &GetModelStateReq) -> GetModelStateRes {
        let header = convert::header(self.now, &request.relative_entity_name);
        let mut answer = GetModelStateRes { header, ..GetModelStateRes::default() };
        match (self.pose_of(&request.model_name), self.pose_of_entity(&request.relative_entity_name)) {
            (Some((pose, linear, angular)), Some(reference)) => {
                let turn = reference.rotation.inverse();
                answer.pose = convert::pose(&(reference.inverse() * pose));
                answer.twist = Twist {
                    linear: convert::vector(&(turn * linear)),
                    angular: convert::vector(&(turn * angular)),
                };
                answer.success = true;
                answer.status_message = "GetModelState: got properties".to_owned();
            }
            (None, _) => {
                answer.status_message = format!("GetModelState: there is no model {:?}", request.model_name);
            }
            (_, None) => {
                let name = &request.relative_entity_name;
                answer.status_message = format!("GetModelState: there is no reference {name:?}");
            }
        }
        answer
    }

    fn pose_of(&self, model: &str) -> Option<(Pose, Vector, Vector)> {
        let state = self.robot.state();
        if model == ARM_MODEL {
            return Some((state.world_from_base, Vector::zeros(), Vector::zeros()));
        }
        let mut objects = self.judge.task().scene().objects.iter();
        let k = objects.position(|object| object.ros_name == model)?;
        let body = &state.objects[k];
        Some((body.pose, body.linear, body.angular))
    }

    fn pose_of_entity(&self, name: &str) -> Option<Pose> {
        match name.split("::").next().unwrap_or_default() {
            "" | "world" | "ground_plane" => Some(Pose::identity()),
            model => self.pose_of(model).map(|(pose, ..)| pose),
        }
    }
}
