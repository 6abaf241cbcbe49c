//! Gazebo's services about models and links: where they are, and blocks put elsewhere.

use super::{SimNode, convert};
use crate::{
    messages::{
        gazebo_msgs::{
            GetLinkState, GetLinkStateReq, GetLinkStateRes, GetModelState, GetModelStateReq,
            GetModelStateRes, LinkState, ModelState, SetModelState, SetModelStateRes, SpawnModel,
            SpawnModelRes,
        },
        geometry_msgs,
    },
    node::{NodeError, RosGraph, graph::Jobs},
};
use proact_messages::original::ARM_MODEL;
use proact_types::{BodyState, Pose, Vector};
use rosrust::Service;

pub(super) fn advertise_services(graph: &RosGraph, jobs: &Jobs<SimNode>) -> Result<Vec<Service>, NodeError> {
    let spawn = |name: &str| {
        graph.advertise_service::<SpawnModel, _>(name, jobs, |node: &mut SimNode, request| {
            let still = geometry_msgs::Twist::default();
            let (model, frame) = (&request.model_name, &request.reference_frame);
            Ok(match node.set_model_state(model, &request.initial_pose, &still, frame) {
                Ok(()) => SpawnModelRes {
                    success: true,
                    status_message: format!(
                        "SpawnModel: {model} is of the task and was put there; the description sent is not read"
                    ),
                },
                Err(reason) => {
                    SpawnModelRes { success: false, status_message: format!("SpawnModel: {reason}") }
                }
            })
        })
    };
    Ok(vec![
        graph.advertise_service::<GetModelState, _>(
            "gazebo/get_model_state",
            jobs,
            |node: &mut SimNode, request| Ok(node.model_state(&request)),
        )?,
        graph.advertise_service::<GetLinkState, _>(
            "gazebo/get_link_state",
            jobs,
            |node: &mut SimNode, request| Ok(node.link_state(request)),
        )?,
        graph.advertise_service::<SetModelState, _>(
            "gazebo/set_model_state",
            jobs,
            |node: &mut SimNode, request| {
                let ModelState { model_name, pose, twist, reference_frame } = &request.model_state;
                let done = node.set_model_state(model_name, pose, twist, reference_frame);
                Ok(SetModelStateRes {
                    success: done.is_ok(),
                    status_message: match done {
                        Ok(()) => "SetModelState: set model state done".to_owned(),
                        Err(reason) => format!("SetModelState: {reason}"),
                    },
                })
            },
        )?,
        spawn("gazebo/spawn_urdf_model")?,
        spawn("gazebo/spawn_sdf_model")?,
    ])
}

/// `a_from_world` applied to a body.
fn relative_state(world_from_a: &Pose, body: &BodyState) -> (geometry_msgs::Pose, geometry_msgs::Twist) {
    let turn = world_from_a.rotation.inverse();
    let twist = geometry_msgs::Twist {
        linear: convert::vector(&(turn * body.linear_velocity)),
        angular: convert::vector(&(turn * body.angular_velocity)),
    };
    (convert::pose(&world_from_a.inv_mul(&body.pose)), twist)
}

fn body_at_rest(pose: Pose) -> BodyState {
    BodyState { pose, linear_velocity: Vector::zeros(), angular_velocity: Vector::zeros() }
}

impl SimNode {
    fn model_state(&self, request: &GetModelStateReq) -> GetModelStateRes {
        let header = convert::header(self.now, &request.relative_entity_name);
        let found = self.model(&request.model_name).and_then(|body| {
            let reference = self.reference_pose(&request.relative_entity_name)?;
            Ok(relative_state(&reference, &body))
        });
        match found {
            Ok((pose, twist)) => GetModelStateRes {
                header,
                pose,
                twist,
                success: true,
                status_message: "GetModelState: got properties".to_owned(),
            },
            Err(reason) => GetModelStateRes {
                header,
                status_message: format!("GetModelState: {reason}"),
                ..GetModelStateRes::default()
            },
        }
    }

    fn link_state(&self, request: GetLinkStateReq) -> GetLinkStateRes {
        let found = self.link(&request.link_name).and_then(|body| {
            let reference = self.reference_pose(&request.reference_frame)?;
            Ok(relative_state(&reference, &body))
        });
        match found {
            Ok((pose, twist)) => GetLinkStateRes {
                link_state: LinkState {
                    link_name: request.link_name,
                    pose,
                    twist,
                    reference_frame: request.reference_frame,
                },
                success: true,
                status_message: "GetLinkState: got state".to_owned(),
            },
            Err(reason) => GetLinkStateRes {
                status_message: format!("GetLinkState: {reason}"),
                ..GetLinkStateRes::default()
            },
        }
    }

    /// Puts an object where a message says.
    fn set_model_state(
        &mut self,
        model: &str,
        pose: &geometry_msgs::Pose,
        twist: &geometry_msgs::Twist,
        frame: &str,
    ) -> Result<(), String> {
        let Some(block) = self.object_index(model) else {
            let objects = &self.task_publisher.task().scene().objects;
            let known: Vec<&str> = objects.iter().map(|object| object.ros_name.as_str()).collect();
            return Err(format!("model {model:?} cannot be put anywhere, only {}", known.join(", ")));
        };
        let world_from_frame = self.reference_pose(frame)?;
        let vector = |v: &geometry_msgs::Vector3| world_from_frame.rotation * Vector::new(v.x, v.y, v.z);
        let body = BodyState {
            pose: world_from_frame * convert::read_pose(pose)?,
            linear_velocity: vector(&twist.linear),
            angular_velocity: vector(&twist.angular),
        };
        self.robot.place(block, &body).map_err(|error| error.to_string())
    }

    fn object_index(&self, model: &str) -> Option<usize> {
        self.task_publisher.task().scene().objects.iter().position(|object| object.ros_name == model)
    }

    fn model(&self, name: &str) -> Result<BodyState, String> {
        let state = self.robot.state();
        if name == ARM_MODEL {
            return Ok(body_at_rest(state.world_from_base));
        }
        let block = self.object_index(name).ok_or_else(|| format!("there is no model {name:?}"))?;
        Ok(state.objects[block])
    }

    /// A link by `model::link`, or one of the arm's by its own name. The arm's are told without their speed, which the
    /// physics does not say of each.
    fn link(&self, name: &str) -> Result<BodyState, String> {
        let (model, link) = name.split_once("::").unwrap_or((ARM_MODEL, name));
        if model != ARM_MODEL {
            return self.model(model);
        }
        let (arm, state) = (self.robot.model(), self.robot.state());
        let found = arm.links.iter().position(|candidate| candidate.name == link);
        let index = found.ok_or_else(|| format!("there is no link {name:?}"))?;
        Ok(body_at_rest(state.world_from_base * arm.link_poses(&state.position)[index]))
    }

    /// `world_from_frame` of a model or a link; no name means the world.
    fn reference_pose(&self, name: &str) -> Result<Pose, String> {
        if matches!(name, "" | "world" | "ground_plane" | "ground_plane::link") {
            return Ok(Pose::identity());
        }
        let body = if name.contains("::") { self.link(name) } else { self.model(name) };
        body.map(|body| body.pose).map_err(|_| format!("there is no reference {name:?}"))
    }
}
