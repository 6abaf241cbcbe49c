//! A question to our planner as MoveIt asks it: `/move_group/motion_plan_request`, which the original's bags hold.

use super::convert;
use crate::{
    frames::WORLD,
    messages::{moveit_msgs, sensor_msgs, shape_msgs, std_msgs::Header},
};
use proact_arm::ArmModel;
use proact_types::{PlanGoal, PlanRequest, Point, Pose, Shape, SimTime, Vector};

/// The arm's group, and the floating joint at its base, as the SRDF names them.
const GROUP: &str = "mpl_arm";
const BASE_JOINT: &str = "world_to_base";
/// A point is reached within this ball, m.
const POSITION_TOLERANCE_M: f64 = 1e-3;
/// An angle is reached within this, rad.
const ANGLE_TOLERANCE_RAD: f64 = 1e-3;

// As shape_msgs/SolidPrimitive numbers them.
const BOX: u8 = 1;
const SPHERE: u8 = 2;
const CYLINDER: u8 = 3;

/// The request as a message. The start is complete, with the base and what the hand carries; obstacles are no part of
/// the message. The goal is where the grasp's centre, the carried object or the tip is to be, in `world`, or the arm's
/// angles. What a request does not say (planner, time, scaling) stays empty, which is MoveIt's default.
pub(super) fn message(
    model: &ArmModel,
    request: &PlanRequest,
    stamp: SimTime,
) -> moveit_msgs::MotionPlanRequest {
    moveit_msgs::MotionPlanRequest {
        workspace_parameters: moveit_msgs::WorkspaceParameters {
            header: world_header(stamp),
            ..Default::default()
        },
        start_state: start_state(model, request, stamp),
        goal_constraints: vec![goal_constraints(model, request, stamp)],
        group_name: GROUP.to_owned(),
        num_planning_attempts: 1,
        ..Default::default()
    }
}

fn start_state(model: &ArmModel, request: &PlanRequest, stamp: SimTime) -> moveit_msgs::RobotState {
    let base = &request.world_from_base;
    let tip = &model.links[model.tip].name;
    moveit_msgs::RobotState {
        joint_state: sensor_msgs::JointState {
            header: convert::header(stamp, ""),
            name: model.moving().map(|joint| model.joints[joint].name.clone()).collect(),
            position: request.start.iter().chain(&request.hand).copied().collect(),
            ..Default::default()
        },
        multi_dof_joint_state: sensor_msgs::MultiDOFJointState {
            header: world_header(stamp),
            joint_names: vec![BASE_JOINT.to_owned()],
            transforms: vec![convert::unstamped_transform(base)],
            ..Default::default()
        },
        attached_collision_objects: request
            .attached
            .iter()
            .map(|carried| moveit_msgs::AttachedCollisionObject {
                link_name: tip.clone(),
                object: moveit_msgs::CollisionObject {
                    header: convert::header(stamp, tip),
                    pose: convert::pose(&carried.tip_from_object),
                    id: carried.name.clone(),
                    primitives: vec![solid_primitive(carried.shape)],
                    primitive_poses: vec![convert::pose(&Pose::identity())],
                    operation: moveit_msgs::CollisionObject::ADD,
                    ..Default::default()
                },
                touch_links: finger_links(model),
                ..Default::default()
            })
            .collect(),
        is_diff: false,
    }
}

fn finger_links(model: &ArmModel) -> Vec<String> {
    model.hand.iter().map(|joint| model.links[model.joints[*joint].child].name.clone()).collect()
}

fn goal_constraints(model: &ArmModel, request: &PlanRequest, stamp: SimTime) -> moveit_msgs::Constraints {
    let at = |offset: &Vector, point: &Point| vec![position_constraint(model, stamp, offset, point)];
    let empty = moveit_msgs::Constraints::default();
    match &request.goal {
        PlanGoal::Pick { center, .. } => moveit_msgs::Constraints {
            name: format!("pick {}", request.picked_object.as_deref().unwrap_or("an object")),
            position_constraints: at(&model.grasp_for_request(request).center, center),
            ..empty
        },
        PlanGoal::Place { point } => {
            let (offset, above) = match &request.attached {
                Some(carried) => (carried.tip_from_object.translation.vector, half_height(carried.shape)),
                None => (model.widest_grasp().center, 0.0),
            };
            moveit_msgs::Constraints {
                name: "place".to_owned(),
                position_constraints: at(&offset, &(point + Vector::z() * above)),
                ..empty
            }
        }
        PlanGoal::Joints { q } => moveit_msgs::Constraints {
            name: "joints".to_owned(),
            joint_constraints: model
                .arm
                .iter()
                .zip(q)
                .map(|(joint, angle)| moveit_msgs::JointConstraint {
                    joint_name: model.joints[*joint].name.clone(),
                    position: *angle,
                    tolerance_above: ANGLE_TOLERANCE_RAD,
                    tolerance_below: ANGLE_TOLERANCE_RAD,
                    weight: 1.0,
                })
                .collect(),
            ..empty
        },
        PlanGoal::TipPose { pose } => moveit_msgs::Constraints {
            name: "tip pose".to_owned(),
            position_constraints: at(&Vector::zeros(), &pose.translation.vector.into()),
            orientation_constraints: vec![moveit_msgs::OrientationConstraint {
                header: world_header(stamp),
                orientation: convert::pose(pose).orientation,
                link_name: model.links[model.tip].name.clone(),
                absolute_x_axis_tolerance: ANGLE_TOLERANCE_RAD,
                absolute_y_axis_tolerance: ANGLE_TOLERANCE_RAD,
                absolute_z_axis_tolerance: ANGLE_TOLERANCE_RAD,
                parameterization: moveit_msgs::OrientationConstraint::ROTATION_VECTOR,
                weight: 1.0,
            }],
            ..empty
        },
    }
}

/// The point at `offset` from the tip, in the tip's frame, is to be at `target`.
fn position_constraint(
    model: &ArmModel,
    stamp: SimTime,
    offset: &Vector,
    target: &Point,
) -> moveit_msgs::PositionConstraint {
    moveit_msgs::PositionConstraint {
        header: world_header(stamp),
        link_name: model.links[model.tip].name.clone(),
        target_point_offset: convert::vector(offset),
        constraint_region: moveit_msgs::BoundingVolume {
            primitives: vec![solid_primitive(Shape::Sphere { radius: POSITION_TOLERANCE_M })],
            primitive_poses: vec![convert::pose(&Pose::translation(target.x, target.y, target.z))],
            ..Default::default()
        },
        weight: 1.0,
    }
}

fn world_header(stamp: SimTime) -> Header {
    convert::header(stamp, WORLD)
}

/// shape_msgs has no capsule: its cylinder with the round ends inside.
fn solid_primitive(shape: Shape) -> shape_msgs::SolidPrimitive {
    let (type_, dimensions) = match shape {
        Shape::Box { size } => (BOX, size.to_vec()),
        Shape::Sphere { radius } => (SPHERE, vec![radius]),
        Shape::Cylinder { radius, length } => (CYLINDER, vec![length, radius]),
        Shape::Capsule { radius, length } => (CYLINDER, vec![length + 2.0 * radius, radius]),
    };
    shape_msgs::SolidPrimitive { type_, dimensions }
}

/// Of something that stands upright.
fn half_height(shape: Shape) -> f64 {
    match shape {
        Shape::Box { size } => size[2] / 2.0,
        Shape::Sphere { radius } => radius,
        Shape::Cylinder { length, .. } => length / 2.0,
        Shape::Capsule { radius, length } => length / 2.0 + radius,
    }
}
