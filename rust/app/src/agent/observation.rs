//! What a program observes: what is displayed to a person, or that and the state behind it.

use super::reward::grasp_center;
use proact_testbed::{ConfigError, RunningTrial};
use proact_types::{
    Command, ControlledDof, DisplayFrame, HandState, ObjectId, PlannerView, Point, Pose, TaskGoal, Vector,
};
use std::str::FromStr;

/// What is observed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ObservationKind {
    /// The newest instant that was displayed, at 60 Hz: what a person in the trial could see.
    Display,
    /// The same, and the state of the physics at the end of the step: speeds, torques, forces, what the hand grips.
    Privileged,
}

impl FromStr for ObservationKind {
    type Err = ConfigError;

    fn from_str(name: &str) -> Result<Self, ConfigError> {
        match name {
            "display" => Ok(Self::Display),
            "privileged" => Ok(Self::Privileged),
            _ => {
                let (key, got) = ("observation", format!("{name:?}"));
                Err(ConfigError::Value { key, got, expected: "display or privileged" })
            }
        }
    }
}

/// Writes observations: always the same numbers in the same order.
pub(super) struct ObservationWriter {
    kind: ObservationKind,
    joints: Vec<String>,
    objects: Vec<String>,
    names: Vec<String>,
}

impl ObservationWriter {
    pub(super) fn new(kind: ObservationKind, trial: &RunningTrial, frame: &DisplayFrame) -> Self {
        let testbed = trial.testbed();
        let model = testbed.model();
        let scene = testbed.task().scene();
        let joints = model.moving().map(|joint| model.joints[joint].name.clone()).collect();
        let objects = scene.ids().map(|object| scene.name(object)).collect();
        let mut observer = Self { kind, joints, objects, names: Vec::new() };
        let mut names = NameCollector(Vec::new());
        observer.visit_values(trial, frame, &mut names);
        observer.names = names.0;
        observer
    }

    pub(super) fn names(&self) -> &[String] {
        &self.names
    }

    pub(super) fn write(&self, trial: &RunningTrial, frame: &DisplayFrame, out: &mut [f64]) {
        assert_eq!(out.len(), self.names.len(), "one number for each name");
        let mut values = ValueWriter { out, next: 0 };
        self.visit_values(trial, frame, &mut values);
    }

    /// Puts name and value of each number, in their order. The one list of what is observed.
    fn visit_values(&self, trial: &RunningTrial, frame: &DisplayFrame, to: &mut impl ValueVisitor) {
        let model = trial.testbed().model();
        let arm = model.arm_count();
        to.put(&["time_left_secs"], frame.time_left_secs);
        to.put(&["score"], f64::from(frame.score));
        for (name, angle) in self.joints.iter().zip(&frame.joints) {
            to.put(&["joint_angle", name], *angle);
        }
        to.pose("base", &frame.world_from_base);
        to.pose("tip", &frame.world_from_tip);
        to.point("grasp_centre", &(frame.world_from_tip * Point::from(model.widest_grasp().center)));
        for (name, state) in HAND_STATES {
            to.flag(&["hand", name], frame.hand.state == state);
        }
        let is =
            |object: Option<ObjectId>, index: usize| object.is_some_and(|object| object.index() == index);
        for (index, (name, pose)) in self.objects.iter().zip(&frame.objects).enumerate() {
            to.pose(name, pose);
            to.flag(&[name, "held"], is(frame.hand.held_object, index));
            to.flag(&[name, "next"], is(frame.next_object, index));
            to.flag(&[name, "highlighted"], is(frame.target.object, index));
        }
        let task_goal = frame.task_goal.as_ref();
        let (center, radius) = match task_goal {
            Some(TaskGoal::Disc { center, radius } | TaskGoal::Ball { center, radius }) => (*center, *radius),
            Some(TaskGoal::Posture { .. }) | None => (Point::origin(), 0.0),
        };
        to.point("asked", &center);
        to.put(&["asked", "radius"], radius);
        for (index, name) in self.joints[..arm].iter().enumerate() {
            let goal = match task_goal {
                Some(TaskGoal::Posture { joints }) => {
                    joints.iter().find(|goal| usize::from(goal.joint) == index)
                }
                _ => None,
            };
            to.flag(&["asked", name, "counts"], goal.is_some());
            to.put(&["asked", name, "angle"], goal.map_or(0.0, |goal| goal.angle));
        }
        to.flag(&["place", "shown"], frame.target.place.is_some());
        to.point("place", &frame.target.place.unwrap_or_else(Point::origin));
        to.flag(&["locked"], frame.target.locked);
        for command in Command::ALL {
            to.flag(&["gesture", command.ros_name()], frame.command == command);
        }
        let moves = frame.mode.as_ref().map(|mode| mode.controlled_dof);
        let joint = |joint: usize| u8::try_from(joint).map(ControlledDof::Joint).ok();
        for (index, name) in self.joints[..arm].iter().map(String::as_str).chain(["hand"]).enumerate() {
            to.flag(&["moves", name], moves.is_some() && moves == joint(index));
        }
        for (axis, name) in (0..).zip(["x", "y", "z"]) {
            to.flag(&["moves", "linear", name], moves == Some(ControlledDof::Translation(axis)));
            to.flag(&["moves", "angular", name], moves == Some(ControlledDof::Rotation(axis)));
        }
        to.flag(&["planner", "planning"], matches!(frame.planner, PlannerView::Planning));
        to.flag(&["planner", "executing"], matches!(frame.planner, PlannerView::Executing { .. }));
        to.flag(&["planner", "arrived"], matches!(frame.planner, PlannerView::Arrived { .. }));
        to.flag(&["planner", "failed"], matches!(frame.planner, PlannerView::Failed { .. }));
        to.flag(&["stopped"], frame.stop.is_some());
        if self.kind == ObservationKind::Privileged {
            self.visit_state(trial, to);
        }
    }

    fn visit_state(&self, trial: &RunningTrial, to: &mut impl ValueVisitor) {
        let testbed = trial.testbed();
        let (model, world) = (testbed.model(), testbed.plant().state());
        for (index, name) in self.joints.iter().enumerate() {
            to.put(&["state", "position", name], world.position[index]);
            to.put(&["state", "velocity", name], world.velocity[index]);
            to.put(&["state", "effort", name], world.effort[index]);
            to.put(&["state", "target", name], testbed.targets()[index]);
        }
        to.point("state.grasp_centre", &grasp_center(trial, model));
        for (index, (name, body)) in self.objects.iter().zip(&world.objects).enumerate() {
            to.vector(&["state", name, "position"], &body.pose.translation.vector);
            to.vector(&["state", name, "linear"], &body.linear_velocity);
            to.vector(&["state", name, "angular"], &body.angular_velocity);
            to.flag(&["state", name, "attached"], world.attached.is_some_and(|(held, _)| held == index));
            let force =
                world.contacts.iter().filter(|contact| contact.object == index).map(|contact| contact.force);
            to.put(&["state", name, "force"], force.sum());
        }
    }
}

const HAND_STATES: [(&str, HandState); 4] = [
    ("open", HandState::Open),
    ("closing", HandState::Closing),
    ("closed", HandState::Closed),
    ("opening", HandState::Opening),
];

/// Takes the numbers one after the other. Names are in parts, so that values alone need no memory.
trait ValueVisitor {
    fn put(&mut self, name: &[&str], value: f64);

    fn flag(&mut self, name: &[&str], is: bool) {
        self.put(name, f64::from(u8::from(is)));
    }

    fn vector(&mut self, name: &[&str], vector: &Vector) {
        let mut parts = [""; 4];
        parts[..name.len()].copy_from_slice(name);
        for (axis, value) in ["x", "y", "z"].into_iter().zip(vector.iter()) {
            parts[name.len()] = axis;
            self.put(&parts[..=name.len()], *value);
        }
    }

    fn point(&mut self, name: &str, point: &Point) {
        self.vector(&[name], &point.coords);
    }

    fn pose(&mut self, name: &str, pose: &Pose) {
        self.vector(&[name], &pose.translation.vector);
        for (part, value) in ["qx", "qy", "qz", "qw"].into_iter().zip(pose.rotation.coords.iter()) {
            self.put(&[name, part], *value);
        }
    }
}

struct NameCollector(Vec<String>);

impl ValueVisitor for NameCollector {
    fn put(&mut self, name: &[&str], _value: f64) {
        self.0.push(name.join("."));
    }
}

struct ValueWriter<'a> {
    out: &'a mut [f64],
    next: usize,
}

impl ValueVisitor for ValueWriter<'_> {
    fn put(&mut self, _name: &[&str], value: f64) {
        self.out[self.next] = value;
        self.next += 1;
    }
}
