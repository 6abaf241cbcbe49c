//! The world as a Gazebo of the original's tells it: joints, base, blocks, the block in the hand.

use proact_arm::ArmModel;
use proact_messages::original;
use proact_types::{BodyState, ObjectId, PlantState, Point, Pose, Scene, Vector, zeros};
use std::{collections::BTreeMap, sync::Arc};

/// Why a message is not taken; the world is then as it was.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum WorldError {
    /// Lists of one message that belong together differ in length.
    #[error("{got} {what} for {expected} names")]
    Length {
        /// Such as `positions`.
        what: &'static str,
        /// Values there.
        got: usize,
        /// Names there.
        expected: usize,
    },
    /// A joint that the arm does not have.
    #[error("joint {name:?} is none of the arm's")]
    Joint {
        /// As named in the message.
        name: String,
    },
    /// A value is NaN or infinite.
    #[error("{what} of {name} is {value}, expected a finite number")]
    NotFinite {
        /// Such as `position`.
        what: &'static str,
        /// Of which joint.
        name: String,
        /// Its value.
        value: f64,
    },
}

/// The world as messages tell it.
#[derive(Clone, Debug)]
pub struct GazeboWorld {
    model: Arc<ArmModel>,
    joints: BTreeMap<String, usize>,
    /// Names of the objects' models, in the order of the scene.
    objects: Vec<String>,
    state: PlantState,
    joints_seen: bool,
    bodies_seen: bool,
}

impl GazeboWorld {
    /// Before the first message: the blocks where `scene` has them.
    pub fn new(model: Arc<ArmModel>, scene: &Scene, world_from_base: Pose) -> Self {
        let joints =
            model.moving().enumerate().map(|(k, joint)| (model.joints[joint].name.clone(), k)).collect();
        let still =
            |pose| BodyState { pose, linear_velocity: Vector::zeros(), angular_velocity: Vector::zeros() };
        let count = model.moving_count();
        let state = PlantState {
            position: zeros(count),
            velocity: zeros(count),
            effort: zeros(count),
            limit_effort: zeros(count),
            world_from_base,
            objects: scene.objects.iter().map(|object| still(object.pose)).collect(),
            attached: None,
            contacts: Default::default(),
            base_held: false,
        };
        let objects = scene.objects.iter().map(|object| object.ros_name.clone()).collect();
        Self { model, joints, objects, state, joints_seen: false, bodies_seen: false }
    }

    /// Joints and bodies have both been seen.
    pub fn is_complete(&self) -> bool {
        self.joints_seen && self.bodies_seen
    }

    /// The world as last told; effort and contacts are not known.
    pub fn state(&self) -> &PlantState {
        &self.state
    }

    /// The arm.
    pub fn model(&self) -> &Arc<ArmModel> {
        &self.model
    }

    /// The block in the hand.
    pub fn held_object(&self) -> Option<ObjectId> {
        self.state.attached.map(|(object, _)| ObjectId::new(object))
    }

    fn world_from_tip(&self) -> Pose {
        self.state.world_from_base * self.model.link_poses(&self.state.position)[self.model.tip]
    }

    fn grasp_center(&self) -> Point {
        self.world_from_tip() * Point::from(self.model.widest_grasp().center)
    }

    /// Angles (rad) and speeds (rad/s; may be empty) by joint name. Joints that are not named keep theirs.
    ///
    /// # Errors
    /// [`WorldError`].
    pub fn update_joints(
        &mut self,
        names: &[String],
        position: &[f64],
        velocity: &[f64],
    ) -> Result<(), WorldError> {
        let expected = names.len();
        if position.len() != expected {
            return Err(WorldError::Length { what: "positions", got: position.len(), expected });
        }
        if !velocity.is_empty() && velocity.len() != expected {
            return Err(WorldError::Length { what: "velocities", got: velocity.len(), expected });
        }
        for (what, values) in [("position", position), ("velocity", velocity)] {
            if let Some((name, value)) = names.iter().zip(values).find(|(_, v)| !v.is_finite()) {
                return Err(WorldError::NotFinite { what, name: name.clone(), value: *value });
            }
        }
        let indices: Vec<usize> = names
            .iter()
            .map(|name| self.joints.get(name).copied().ok_or(WorldError::Joint { name: name.clone() }))
            .collect::<Result<_, _>>()?;
        for (k, index) in indices.into_iter().enumerate() {
            self.state.position[index] = position[k];
            self.state.velocity[index] = velocity.get(k).copied().unwrap_or(0.0);
        }
        self.joints_seen = true;
        Ok(())
    }

    /// The base, `world_from_base`.
    pub fn update_base(&mut self, world_from_base: Pose) {
        self.state.world_from_base = world_from_base;
    }

    /// A body by its name in Gazebo. Names of other models are passed over: a lab has more than our blocks.
    pub fn update_body(&mut self, name: &str, body: BodyState) {
        if let Some(k) = self.objects.iter().position(|object| object == name) {
            self.state.objects[k] = body;
            self.bodies_seen = true;
        }
    }

    /// The object of a grasp event's collision name.
    pub fn object_of_collision(&self, collision: &str) -> Option<ObjectId> {
        let model = original::model_from_collision(collision);
        self.objects.iter().position(|object| object == model).map(ObjectId::new)
    }

    /// The hand took or let go `block`.
    pub fn update_grasp(&mut self, block: ObjectId, attached: bool) {
        let pose = self.world_from_tip().inv_mul(&self.state.objects[block.index()].pose);
        self.state.attached = attached.then_some((block.index(), pose));
    }

    /// Only whether something is held: then it is the block nearest to the hand. For a node that was not there when
    /// the hand took it.
    pub fn update_grasp_status(&mut self, attached: bool) {
        if !attached {
            self.state.attached = None;
        } else if self.state.attached.is_none() && self.is_complete() {
            let hand = self.grasp_center().coords;
            let far = |id: &ObjectId| (self.state.objects[id.index()].pose.translation.vector - hand).norm();
            let all = (0..self.objects.len()).map(ObjectId::new);
            if let Some(nearest) = all.min_by(|a, b| far(a).total_cmp(&far(b))) {
                self.update_grasp(nearest, true);
            }
        }
    }

    /// The block in the hand is where it is seen now.
    pub fn follow_attached(&mut self) {
        if let Some(block) = self.held_object() {
            self.update_grasp(block, true);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_tasks::TaskSpec;

    fn world() -> GazeboWorld {
        let model = Arc::new(proact_arm::ArmModel {
            name: "arm".into(),
            links: vec![proact_arm::Link {
                name: "base_link".into(),
                inertial: None,
                collisions: vec![],
                visuals: vec![],
            }],
            joints: vec![],
            arm: vec![],
            hand: vec![],
            tip: 0,
            poses: vec![],
            allowed_collisions: vec![],
            ..Default::default()
        });
        let task = TaskSpec::named("modified_bbt", 1).and_then(|task| task.build(false)).expect("ships");
        GazeboWorld::new(model, task.scene(), Pose::translation(-0.39, 0.12, 1.5))
    }

    #[test]
    fn unknown_joints_wrong_lengths_and_numbers_that_are_none_are_refused() {
        let mut world = world();
        let names = vec!["nose".to_owned()];
        let mut refused = |position: &[f64], velocity: &[f64]| {
            world.update_joints(&names, position, velocity).expect_err("refused").to_string()
        };
        assert_eq!(refused(&[0.0], &[]), "joint \"nose\" is none of the arm's");
        assert_eq!(refused(&[], &[]), "0 positions for 1 names");
        assert_eq!(refused(&[0.0], &[1.0, 2.0]), "2 velocities for 1 names");
        assert!(refused(&[f64::NAN], &[]).contains("position of nose is NaN"));
        assert!(!world.is_complete());
    }

    #[test]
    fn a_node_that_comes_late_takes_the_nearest_block_for_the_one_in_the_hand() {
        let mut world = world();
        world.update_joints(&[], &[], &[]).expect("no joints, no fault");
        let at = BodyState {
            pose: Pose::translation(-0.39, 0.12, 1.45),
            linear_velocity: Vector::zeros(),
            angular_velocity: Vector::zeros(),
        };
        world.update_body("bluecylinder1", at);
        world.update_body("teapot", at);
        world.update_grasp_status(true);
        assert_eq!(world.held_object(), Some(ObjectId(2)));
        world.update_grasp_status(false);
        assert_eq!(world.held_object(), None);
    }

    #[test]
    fn collision_names_lead_to_objects() {
        let world = world();
        assert_eq!(world.object_of_collision("redcylinder2::link::collision"), Some(ObjectId(1)));
        assert_eq!(world.object_of_collision("table::link::collision"), None);
    }
}
