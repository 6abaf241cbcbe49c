//! What a control node needs to know beside the world's topics: the target of the moment on `/proact/target`, and the
//! parameters `/proact/task`, `/proact/objects`, `/proact/hand` and `/robot_description`. `docs/ros_method.md` lists them.
//! All types are ROS's own, so that a client needs no message of ours.

use super::{NodeError, RosGraph, convert};
use crate::{
    frames::{Frame, GRASP_CENTER, WORLD},
    messages::geometry_msgs::TransformStamped,
    publishing::Publisher,
};
use proact_arm::{ArmModel, Grasp};
use proact_messages::original;
use proact_tasks::{Task, TaskState};
use proact_testbed::TestbedError;
use proact_types::{ObjectId, PlaceRegion, Point, Pose, Scene, Shape, SimTime, TaskGoal, Vector};
use rosrust::error::Result as Sent;
use serde::Serialize;

/// The arm's URDF. roslaunch sets it before any node starts; the nodes set it where nobody has.
const ROBOT_DESCRIPTION: &str = "robot_description";

/// `/proact/task`.
#[derive(Serialize)]
struct TaskParameter<'a> {
    name: &'a str,
    title: &'a str,
    limit_secs: f64,
    table_height: f64,
    put_down: PlaceRegion,
}

/// One entry of `/proact/objects`.
#[derive(Serialize)]
struct ObjectParameter<'a> {
    name: &'a str,
    frame: &'a str,
    pose_topic: String,
    shape: &'static str,
    size: [f64; 3],
    mass: f64,
    /// Index into the grasps of `/proact/hand`.
    grasp: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    target: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    target_radius: Option<f64>,
}

/// `/proact/hand`.
#[derive(Serialize)]
struct HandParameter<'a> {
    tip_link: &'a str,
    joints: Vec<&'a str>,
    grasps: Vec<GraspParameter<'a>>,
}

/// How the hand grips objects of a range of widths: the keys are those of `<grasp>` in the SRDF file.
#[derive(Serialize)]
struct GraspParameter<'a> {
    widths: [f64; 2],
    #[serde(rename = "centre")]
    center: [f64; 3],
    open: &'a [f64],
    closed: &'a [f64],
    #[serde(skip_serializing_if = "Option::is_none")]
    closing: Option<[f64; 3]>,
    roll: f64,
    roll_range: [f64; 2],
    lean: f64,
    opening: f64,
    withdrawal: [f64; 3],
}

/// The topic with the target, and the parameters.
pub(super) struct ControlInterface {
    scene: Scene,
    publisher: Publisher<TransformStamped>,
    last_target: Option<PublishedTarget>,
}

/// Which frame is to be brought where, in `world`.
type PublishedTarget = (String, Point);

impl ControlInterface {
    /// Sets the parameters of `task`, of the hand of `model` and of its description `urdf`, and publishes the first target.
    pub(super) fn new(
        graph: &RosGraph,
        model: &ArmModel,
        urdf: &str,
        task_name: &str,
        task: &dyn Task,
    ) -> Result<Self, NodeError> {
        let (scene, state) = (task.scene(), task.state());
        let briefing = task.briefing();
        let of_task = TaskParameter {
            name: task_name,
            title: &briefing.title,
            limit_secs: briefing.limit_secs,
            table_height: scene.table_height,
            put_down: scene.place_region,
        };
        set_parameter("proact/task", &of_task)?;
        set_parameter("proact/objects", &objects_parameter(model, scene))?;
        set_parameter("proact/hand", &hand_parameter(model)?)?;
        let is_set = rosrust::param(ROBOT_DESCRIPTION).is_some_and(|own| own.exists().unwrap_or(true));
        if !is_set {
            set_parameter(ROBOT_DESCRIPTION, &urdf)?;
        }
        let publisher = graph.advertise("proact/target", 1, true)?;
        let interface = Self { scene: scene.clone(), publisher, last_target: current_target(scene, state) };
        interface.send(SimTime(0)).map_err(super::graph::setup_error("proact/target"))?;
        Ok(interface)
    }

    /// Publishes the target where it changed.
    pub(super) fn publish(&mut self, now: SimTime, state: &TaskState) -> Sent<()> {
        let goal = current_target(&self.scene, state);
        if goal == self.last_target {
            return Ok(());
        }
        self.last_target = goal;
        self.send(now)
    }

    fn send(&self, now: SimTime) -> Sent<()> {
        let (child, at) = self.last_target.clone().unwrap_or_default();
        let pose = Pose::translation(at.x, at.y, at.z);
        self.publisher.send(convert::transform(now, &Frame { parent: WORLD.to_owned(), child, pose }))
    }
}

/// Sets a parameter.
fn set_parameter(name: &str, value: &impl Serialize) -> Result<(), NodeError> {
    let refused = |reason: String| NodeError::Setup { what: format!("parameter {name}"), reason };
    let parameter = rosrust::param(name).ok_or_else(|| refused("no name of a parameter".to_owned()))?;
    parameter.set(value).map_err(|error| refused(format!("{error:?}")))
}

/// None where the task asks for no object or place in particular, and when it is over.
fn current_target(scene: &Scene, state: &TaskState) -> Option<PublishedTarget> {
    if state.finished {
        return None;
    }
    let center = match &state.goal {
        Some(TaskGoal::Ball { center, .. }) => return Some((GRASP_CENTER.to_owned(), *center)),
        Some(TaskGoal::Posture { .. }) => return None,
        Some(TaskGoal::Disc { center, .. }) => *center,
        None => scene.target(state.next_object?)?.center,
    };
    let object = scene.objects.get(state.next_object?.index())?;
    // An object's frame is in its middle, the disc on the surface below it.
    Some((object.ros_name.clone(), center + Vector::z() * object.shape.half_height()))
}

fn objects_parameter<'a>(model: &ArmModel, scene: &'a Scene) -> Vec<ObjectParameter<'a>> {
    let of_object = |id: ObjectId| {
        let object = &scene.objects[id.index()];
        let (shape, size) = bounding_box(&object.shape);
        let grasp = model.grasp_for(object.shape.grip_width());
        let target = scene.target(id);
        ObjectParameter {
            name: &object.name,
            frame: &object.ros_name,
            pose_topic: original::object_pose_topic(&object.ros_name),
            shape,
            size,
            mass: object.mass,
            grasp: model.grasps.iter().position(|own| own == grasp).unwrap_or(0),
            target: target.map(|target| target.center.into()),
            target_radius: target.map(|target| target.radius),
        }
    };
    scene.ids().map(of_object).collect()
}

fn hand_parameter(model: &ArmModel) -> Result<HandParameter<'_>, TestbedError> {
    Ok(HandParameter {
        tip_link: &model.links[model.tip].name,
        joints: model.hand.iter().map(|joint| model.joints[*joint].name.as_str()).collect(),
        grasps: model.grasps.iter().map(|grasp| grasp_parameter(model, grasp)).collect::<Result<_, _>>()?,
    })
}

fn grasp_parameter<'a>(model: &'a ArmModel, grasp: &Grasp) -> Result<GraspParameter<'a>, TestbedError> {
    Ok(GraspParameter {
        widths: grasp.width_range_m,
        center: grasp.center.into(),
        open: model.pose("hand", &grasp.open_pose)?,
        closed: model.pose("hand", &grasp.closed_pose)?,
        closing: grasp.closing_direction.map(Into::into),
        roll: grasp.roll_rad,
        roll_range: grasp.roll_range_rad,
        lean: grasp.max_lean_rad,
        opening: grasp.capture_radius_m,
        withdrawal: grasp.withdrawal_direction.into(),
    })
}

/// The name of a shape, and the sides of the box around it where it stands upright, metres.
fn bounding_box(shape: &Shape) -> (&'static str, [f64; 3]) {
    let round = |name, radius: f64| (name, [2.0 * radius, 2.0 * radius, 2.0 * shape.half_height()]);
    match *shape {
        Shape::Box { size } => ("box", size),
        Shape::Sphere { radius } => round("sphere", radius),
        Shape::Cylinder { radius, .. } => round("cylinder", radius),
        Shape::Capsule { radius, .. } => round("capsule", radius),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::{Object, Target};

    fn scene() -> Scene {
        let shape = Shape::Cylinder { radius: 0.025, length: 0.05 };
        let object = Object {
            ros_name: "redcylinder1".to_owned(),
            ..Object::with_default_friction("red1", shape, 0.1, Pose::identity())
        };
        let target = Target { object: ObjectId(0), center: Point::new(0.05, 0.2, 1.0), radius: 0.05 };
        Scene { objects: vec![object], targets: vec![target], ..Scene::default() }
    }

    #[test]
    fn the_target_is_where_the_middle_of_the_object_belongs_and_none_when_the_task_is_over() {
        let scene = scene();
        let mut state = TaskState { next_object: Some(ObjectId(0)), ..TaskState::default() };
        assert_eq!(
            current_target(&scene, &state),
            Some(("redcylinder1".to_owned(), Point::new(0.05, 0.2, 1.025)))
        );
        state.goal = Some(TaskGoal::Disc { center: Point::new(0.1, 0.1, 1.3), radius: 0.05 });
        assert_eq!(
            current_target(&scene, &state),
            Some(("redcylinder1".to_owned(), Point::new(0.1, 0.1, 1.325)))
        );
        state.goal = Some(TaskGoal::Ball { center: Point::new(0.1, 0.1, 1.3), radius: 0.05 });
        assert_eq!(
            current_target(&scene, &state),
            Some((GRASP_CENTER.to_owned(), Point::new(0.1, 0.1, 1.3)))
        );
        state.finished = true;
        assert_eq!(current_target(&scene, &state), None);
        let any = TaskState::default();
        assert_eq!(current_target(&scene, &any), None, "any order");
    }
}
