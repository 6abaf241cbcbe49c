//! What is published of the world, once per instant and all with one stamp.

use super::{NodeError, RosGraph, convert, graph::parameter};
use crate::{
    compat::{CompatOption, CompatOptions, UnknownCompatOption},
    frames::{self, Frame, HEADSET_WORLD, WORLD},
    messages::{
        gazebo_grasp_plugin_ros::GazeboGraspEvent,
        gazebo_msgs::{LinkStates, ModelStates},
        geometry_msgs::{PoseStamped, Twist},
        rosgraph_msgs::Clock,
        sensor_msgs::JointState,
        std_msgs::{Bool, ColorRGBA},
        tf2_msgs::TFMessage,
        visualization_msgs::{Marker, MarkerArray},
    },
    publishing::Publisher,
};
use nalgebra::UnitQuaternion;
use proact_arm::ArmModel;
use proact_messages::original;
use proact_messages::original::{ARM_MODEL, relative};
use proact_types::{
    Event, EventKind, GazeSample, ObjectId, PlanReply, PlantState, Point, Pose, Scene, Shape, SimTime, Vector,
};
use rosrust::error::Result;
use std::{collections::BTreeSet, sync::Arc};

/// Length of the drawn gaze ray, m.
const GAZE_LENGTH_M: f64 = 1.2;
/// Ticks between poses and between constant transforms that the original has ten times a second.
const SLOW_PERIOD_TICKS: u64 = 100;
/// Frames that the original's command-line tools kept sending.
const REPEATED_FRAMES: [&str; 2] = [WORLD, HEADSET_WORLD];

/// What the node's parameters say of its frames and topics.
#[derive(Clone)]
pub(super) struct WorldPublisherOptions {
    /// Whether this node publishes the arm's frames itself; false where robot_state_publisher does.
    publish_links: bool,
    /// Frames that somebody else publishes.
    excluded_frames: BTreeSet<String>,
    /// Quirks of the original that are on.
    pub compat: CompatOptions,
}

impl WorldPublisherOptions {
    /// Reads `~publish_links`, `~exclude_frames` and `~compat`.
    ///
    /// # Errors
    /// [`NodeError::Setup`] for a word that there is not, [`NodeError::Parameter`] for a value of another type.
    pub(super) fn from_parameters(model: &ArmModel, scene: &Scene) -> std::result::Result<Self, NodeError> {
        let expected = "names with commas between them";
        let text: String = parameter("~exclude_frames", String::new(), expected)?;
        let known = frames::names(model, scene);
        let left_out: BTreeSet<String> =
            text.split(',').map(str::trim).filter(|name| !name.is_empty()).map(str::to_owned).collect();
        if let Some(name) = left_out.difference(&known).next() {
            let known: Vec<&str> = known.iter().map(String::as_str).collect();
            let reason = format!("there is no frame {name:?}, expected some of {}", known.join(", "));
            return Err(NodeError::Setup { what: "parameter ~exclude_frames".to_owned(), reason });
        }
        let text: String = parameter("~compat", String::new(), expected)?;
        let compat = text.parse().map_err(|error: UnknownCompatOption| NodeError::Setup {
            what: "parameter ~compat".to_owned(),
            reason: error.to_string(),
        })?;
        Ok(Self {
            publish_links: parameter("~publish_links", true, "true or false")?,
            excluded_frames: left_out,
            compat,
        })
    }

    fn publishes(&self, frame: &Frame) -> bool {
        !self.excluded_frames.contains(&frame.child)
    }
}

/// Publishers of the world.
pub(super) struct WorldPublishers {
    model: Arc<ArmModel>,
    scene: Scene,
    options: WorldPublisherOptions,
    alphabetical: Vec<usize>,
    joint_names: Vec<String>,
    clock: Publisher<Clock>,
    joint_states: [Publisher<JointState>; 2],
    tf: Publisher<TFMessage>,
    tf_static: Publisher<TFMessage>,
    model_states: Publisher<ModelStates>,
    link_states: Publisher<LinkStates>,
    base_pose: Publisher<PoseStamped>,
    object_poses: Vec<Publisher<PoseStamped>>,
    grasp_events: Publisher<GazeboGraspEvent>,
    grasp_status: Publisher<Bool>,
    markers: Publisher<MarkerArray>,
    box_markers: Publisher<MarkerArray>,
}

impl WorldPublishers {
    /// Sets the publishers up.
    pub(super) fn new(
        graph: &RosGraph,
        model: &Arc<ArmModel>,
        scene: &Scene,
        choices: WorldPublisherOptions,
    ) -> std::result::Result<Self, NodeError> {
        let joint_names: Vec<String> = model.moving().map(|j| model.joints[j].name.clone()).collect();
        let mut alphabetical: Vec<usize> = (0..joint_names.len()).collect();
        alphabetical.sort_by(|a, b| joint_names[*a].cmp(&joint_names[*b]));
        let publishers = Self {
            model: model.clone(),
            scene: scene.clone(),
            options: choices,
            alphabetical,
            joint_names,
            clock: graph.advertise("/clock", 10, false)?,
            joint_states: [
                graph.advertise(relative::JOINT_STATES, 10, false)?,
                graph.advertise(relative::WRAPPED_JOINT_STATES, 10, false)?,
            ],
            tf: graph.advertise("/tf", 100, false)?,
            tf_static: graph.advertise("/tf_static", 10, true)?,
            model_states: graph.advertise(relative::MODEL_STATES, 10, false)?,
            link_states: graph.advertise(relative::LINK_STATES, 10, false)?,
            base_pose: graph.advertise(relative::BASE_POSE, 1, false)?,
            object_poses: scene
                .objects
                .iter()
                .map(|object| original::object_pose_topic(&object.ros_name))
                .map(|topic| graph.advertise(topic.trim_start_matches('/'), 1, false))
                .collect::<std::result::Result<_, _>>()?,
            grasp_events: graph.advertise(relative::GRASP_EVENTS, 1, false)?,
            grasp_status: graph.advertise(relative::GRASP_STATUS, 10, true)?,
            markers: graph.advertise("proact/markers", 10, false)?,
            box_markers: graph.advertise("proact/box", 1, true)?,
        };
        publishers.publish_static().map_err(|error| NodeError::Setup {
            what: "the first messages".to_owned(),
            reason: error.to_string(),
        })?;
        Ok(publishers)
    }

    /// What never changes, latched.
    fn publish_static(&self) -> Result<()> {
        let start = SimTime(0);
        let mut fixed = self.fixed_frames();
        fixed.retain(|frame| !self.is_repeated(frame));
        self.tf_static
            .send(TFMessage { transforms: fixed.iter().map(|f| convert::transform(start, f)).collect() })?;
        let wood = color(0.45, 0.33, 0.24, 0.6);
        // The floor would hide the grid.
        let objects = self.scene.fixed.iter().enumerate().filter(|(_, o)| o.name != "floor");
        let markers = objects.map(|(k, o)| shape_marker("box", k, &o.shape, &o.pose, wood.clone())).collect();
        self.box_markers.send(MarkerArray { markers })?;
        self.grasp_status.send(Bool { data: false })
    }

    fn fixed_frames(&self) -> Vec<Frame> {
        let mut fixed = frames::fixed(&self.model, &self.scene, self.options.publish_links);
        fixed.retain(|frame| self.options.publishes(frame));
        fixed
    }

    fn is_repeated(&self, frame: &Frame) -> bool {
        self.options.compat.has(CompatOption::ResentConstants)
            && REPEATED_FRAMES.contains(&frame.child.as_str())
    }

    pub(super) fn publish_clock(&self, time: SimTime) -> Result<()> {
        self.clock.send(Clock { clock: convert::time(time) })
    }

    /// Joints, frames, models and links of one instant.
    pub(super) fn publish_state(&self, time: SimTime, state: &PlantState, head: Option<&Pose>) -> Result<()> {
        let ordered = |value: &dyn Fn(usize) -> f64| -> Vec<f64> {
            self.alphabetical.iter().map(|k| value(*k)).collect()
        };
        let plain = JointState {
            header: convert::header(time, ""),
            name: self.alphabetical.iter().map(|k| self.joint_names[*k].clone()).collect(),
            position: ordered(&|k| state.position[k]),
            velocity: ordered(&|k| state.velocity[k]),
            effort: ordered(&|k| state.effort[k]),
        };
        let wrapped =
            JointState { position: ordered(&|k| frames::wrap_angle(state.position[k])), ..plain.clone() };
        self.joint_states[0].send(plain)?;
        self.joint_states[1].send(wrapped)?;

        let mut moving = frames::moving(&self.model, &self.scene, state, head, self.options.publish_links);
        moving.retain(|frame| self.options.publishes(frame));
        let (resent, moving): (Vec<_>, Vec<_>) = moving.into_iter().partition(|f| self.is_repeated(f));
        self.tf
            .send(TFMessage { transforms: moving.iter().map(|f| convert::transform(time, f)).collect() })?;
        let tenth = time.0.is_multiple_of(SLOW_PERIOD_TICKS);
        if self.options.compat.has(CompatOption::ResentConstants) && tenth {
            let fixed = self.fixed_frames().into_iter().filter(|f| self.is_repeated(f));
            let ahead = time.plus_millis(SLOW_PERIOD_TICKS);
            let constants = resent.into_iter().chain(fixed);
            let transforms = constants.map(|frame| convert::transform(ahead, &frame)).collect();
            self.tf.send(TFMessage { transforms })?;
        }
        if self.model_states.subscriber_count() > 0 {
            self.model_states.send(self.model_states(state))?;
        }
        if self.link_states.subscriber_count() > 0 {
            self.link_states.send(self.link_states(state))?;
        }
        if self.options.compat.has(CompatOption::SlowPoses) && !tenth {
            return Ok(());
        }
        let frame = if self.options.compat.has(CompatOption::BarePoses) { "" } else { WORLD };
        self.base_pose.send(convert::pose_stamped(time, frame, &state.world_from_base))?;
        for (publisher, body) in self.object_poses.iter().zip(&state.objects) {
            publisher.send(convert::pose_stamped(time, frame, &body.pose))?;
        }
        Ok(())
    }

    pub(super) fn model_states(&self, state: &PlantState) -> ModelStates {
        let mut models = ModelStates {
            name: vec![ARM_MODEL.to_owned()],
            pose: vec![convert::pose(&state.world_from_base)],
            twist: vec![Twist::default()],
        };
        for (object, body) in self.scene.objects.iter().zip(&state.objects) {
            models.name.push(object.ros_name.clone());
            models.pose.push(convert::pose(&body.pose));
            models.twist.push(Twist {
                linear: convert::vector(&body.linear_velocity),
                angular: convert::vector(&body.angular_velocity),
            });
        }
        models
    }

    /// Links carry no twist: the physics does not say one for each.
    fn link_states(&self, state: &PlantState) -> LinkStates {
        let models = self.model_states(state);
        let mut links = LinkStates::default();
        for (link, pose) in self.model.links.iter().zip(self.model.link_poses(&state.position)) {
            links.name.push(format!("{ARM_MODEL}::{}", link.name));
            links.pose.push(convert::pose(&(state.world_from_base * pose)));
            links.twist.push(Twist::default());
        }
        for k in 1..models.name.len() {
            links.name.push(format!("{}::link", models.name[k]));
            links.pose.push(models.pose[k].clone());
            links.twist.push(models.twist[k].clone());
        }
        links
    }

    pub(super) fn publish_grasp(&self, event: &Event) -> Result<()> {
        let (block, attached) = match event.kind {
            EventKind::ObjectAttached { object: block } => (block, true),
            EventKind::ObjectReleased { object: block } => (block, false),
            _ => return Ok(()),
        };
        let name = self.scene.objects.get(block.index()).map_or("", |object| &object.ros_name);
        self.grasp_events.send(GazeboGraspEvent {
            arm: ARM_MODEL.to_owned(),
            object: original::collision_name(name),
            attached,
        })?;
        self.grasp_status.send(Bool { data: attached })
    }

    /// Blocks, and where known place marker, gaze, posterior and the planned way, for rviz.
    pub(super) fn publish_markers(
        &self,
        time: SimTime,
        state: &PlantState,
        view: &MarkerData<'_>,
    ) -> Result<()> {
        if self.markers.subscriber_count() == 0 {
            return Ok(());
        }
        let mut markers = Vec::new();
        for (k, block) in self.scene.objects.iter().enumerate() {
            let pose = state.objects[k].pose;
            let [red, green, blue] = block.color.map(|part| part as f32);
            let tint = color(red, green, blue, 1.0);
            markers.push(shape_marker("blocks", k, &block.shape, &pose, tint));
            let share = view.posterior.get(k).copied().unwrap_or(0.0);
            let above = Pose::translation(pose.translation.x, pose.translation.y, pose.translation.z + 0.06);
            let mut label =
                marker("posterior", k, Marker::TEXT_VIEW_FACING, &above, color(1.0, 1.0, 1.0, 1.0));
            label.scale.z = 0.025;
            label.text = format!("{}  {:.0} %", block.name, 100.0 * share);
            if view.posterior.is_empty() {
                label.text = block.name.clone();
            }
            markers.push(label);
            let mut ring = shape_marker("marked", k, &block.shape, &pose, color(1.0, 0.85, 0.1, 0.45));
            // A little larger than the object itself.
            (ring.scale.x, ring.scale.y, ring.scale.z) =
                (ring.scale.x + 0.01, ring.scale.y + 0.01, ring.scale.z + 0.004);
            ring.action = if view.highlighted == Some(ObjectId::new(k)) {
                Marker::ADD as i32
            } else {
                Marker::DELETE as i32
            };
            markers.push(ring);
        }
        if let Some(place_point) = view.place {
            let pose = Pose::translation(place_point.x, place_point.y, place_point.z + 0.002);
            let disc = Shape::Cylinder { radius: 0.03, length: 0.002 };
            markers.push(shape_marker("goal", 0, &disc, &pose, color(1.0, 0.85, 0.1, 0.9)));
        }
        if let Some(gaze) = view.gaze.filter(|g| g.valid) {
            let end = gaze.origin + gaze.direction.normalize() * GAZE_LENGTH_M;
            markers.push(line("gaze", &[gaze.origin, end], color(0.2, 0.8, 0.9, 0.8), 0.004));
        }
        if let Some(plan) = view.plan {
            markers.extend(self.path_markers(plan, state));
        }
        for marker in &mut markers {
            marker.header = convert::header(time, WORLD);
        }
        self.markers.send(MarkerArray { markers })
    }

    /// The tip's way along a plan, and the pose where it ends.
    fn path_markers(&self, plan: &PlanReply, state: &PlantState) -> Vec<Marker> {
        let arm = self.model.arm_count();
        let tip = |q: &[f64]| {
            let mut position = state.position.clone();
            position[..arm].copy_from_slice(q);
            state.world_from_base * self.model.link_poses(&position)[self.model.tip]
        };
        let poses: Vec<Pose> = plan.trajectory.points.iter().map(|p| tip(&p.q)).collect();
        let Some(end) = poses.last() else { return vec![] };
        let points: Vec<Point> = poses.iter().map(|p| Point::from(p.translation.vector)).collect();
        let mut arrow = marker("goal", 1, Marker::ARROW, end, color(0.3, 0.85, 0.3, 0.9));
        // The hand points along -y of its link; an arrow along its own x.
        let along = UnitQuaternion::rotation_between(&Vector::x(), &-Vector::y()).unwrap_or_default();
        arrow.pose = convert::pose(&Pose::from_parts(end.translation, end.rotation * along));
        (arrow.scale.x, arrow.scale.y, arrow.scale.z) = (0.08, 0.012, 0.012);
        vec![line("plan", &points, color(0.3, 0.85, 0.3, 0.9), 0.006), arrow]
    }
}

/// What there is to draw beside the world itself.
#[derive(Default)]
pub(super) struct MarkerData<'a> {
    pub posterior: &'a [f64],
    pub highlighted: Option<ObjectId>,
    pub place: Option<Point>,
    pub gaze: Option<GazeSample>,
    pub plan: Option<&'a PlanReply>,
}

fn color(r: f32, g: f32, b: f32, a: f32) -> ColorRGBA {
    ColorRGBA { r, g, b, a }
}

fn marker(space: &str, id: usize, kind: impl Into<i64>, pose: &Pose, tint: ColorRGBA) -> Marker {
    Marker {
        header: convert::header(SimTime(0), WORLD),
        ns: space.to_owned(),
        id: id as i32,
        type_: kind.into() as i32,
        pose: convert::pose(pose),
        color: tint,
        ..Marker::default()
    }
}

fn shape_marker(space: &str, id: usize, shape: &Shape, pose: &Pose, tint: ColorRGBA) -> Marker {
    let (kind, [x, y, z]) = match *shape {
        Shape::Box { size } => (Marker::CUBE, size),
        Shape::Sphere { radius } => (Marker::SPHERE, [2.0 * radius; 3]),
        Shape::Cylinder { radius, length } => (Marker::CYLINDER, [2.0 * radius, 2.0 * radius, length]),
        // rviz has no capsule; a cylinder of full length is nearest.
        Shape::Capsule { radius, length } => {
            (Marker::CYLINDER, [2.0 * radius, 2.0 * radius, length + 2.0 * radius])
        }
    };
    let mut drawn = marker(space, id, kind, pose, tint);
    (drawn.scale.x, drawn.scale.y, drawn.scale.z) = (x, y, z);
    drawn
}

fn line(space: &str, points: &[Point], tint: ColorRGBA, width: f64) -> Marker {
    let mut drawn = marker(space, 0, Marker::LINE_STRIP, &Pose::identity(), tint);
    drawn.scale.x = width;
    drawn.points = points.iter().map(convert::point).collect();
    drawn
}
