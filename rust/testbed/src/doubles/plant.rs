use crate::ports::{Plant, PlantError};
use arrayvec::ArrayVec;
use proact_arm::ArmModel;
use proact_types::{
    BodyState, Contact, PlantCommand, PlantState, Point, Pose, Scene, Shape, TICK_SECS, Vector, joints, zeros,
};
use std::sync::Arc;

/// A base that is told to move faster than this stands still instead, m/s, as the simulated one does.
const BASE_SPEED: f64 = 5.0;
/// Fingers touch what is within this of the grasp centre, metres: half a block and what an approach may be off.
const GRASP_RADIUS: f64 = 0.03;
/// And they do when they have gone this share of their way from `open` to `closed`.
const CLOSED_SHARE: f64 = 0.5;
/// Force of a finger on a block, N.
const FINGER_FORCE: f64 = 1.0;

/// An arm that follows its commands at once, and blocks that stand until they are taken.
///
/// Nothing collides. Two fingers that have closed halfway around a block press it from opposite sides, so that the
/// grasp rule attaches it; it then moves with its link. A block that is let go stands at once, upright and at rest, on
/// the highest box of the scene below its centre: table, wall or floor. Deterministic.
#[derive(Clone, Debug)]
pub struct KinematicPlant {
    model: Arc<ArmModel>,
    scene: Scene,
    /// The link that holds the attached block.
    attached_link: Option<usize>,
    state: PlantState,
}

impl KinematicPlant {
    /// The arm at its pose `start` with an open hand, its base at `world_from_base`, before `scene`.
    ///
    /// # Panics
    /// If the arm has no such poses.
    pub fn new(model: Arc<ArmModel>, scene: Scene, world_from_base: Pose) -> Self {
        let pose = |group, name| model.pose(group, name).expect("an arm for trials has poses");
        let initial: Vec<f64> = [pose("arm", "start"), pose("hand", "open")].concat();
        let stands =
            |pose| BodyState { pose, linear_velocity: Vector::zeros(), angular_velocity: Vector::zeros() };
        let state = PlantState {
            position: joints(&initial),
            velocity: zeros(initial.len()),
            effort: zeros(initial.len()),
            limit_effort: zeros(initial.len()),
            world_from_base,
            base_held: false,
            objects: scene.objects.iter().map(|block| stands(block.pose)).collect(),
            attached: None,
            contacts: ArrayVec::new(),
        };
        Self { model, scene, attached_link: None, state }
    }

    /// `world_from_link` of all links.
    fn links(&self) -> Vec<Pose> {
        let mut poses = Vec::new();
        self.model.link_poses_into(&self.state.world_from_base, &self.state.position, &mut poses);
        poses
    }

    /// How far the hand has gone from `open` to `closed`, 0 to 1: the joint that is least far.
    fn closed_share(&self) -> f64 {
        let pose = |name| self.model.pose("hand", name).expect("an arm for trials has poses");
        let fingers = &self.state.position[self.model.arm_count()..];
        let ranges = pose("open").iter().zip(pose("closed"));
        fingers.iter().zip(ranges).fold(1.0, |min, (q, (open, closed))| min.min((q - open) / (closed - open)))
    }

    /// The fingers on the blocks: those that hang from the tip, each from its own side.
    fn update_contacts(&mut self) {
        self.state.contacts.clear();
        if self.closed_share() < CLOSED_SHARE {
            return;
        }
        let tip = self.links()[self.model.tip];
        let center = tip * Point::from(self.model.widest_grasp().center);
        let fingers: Vec<usize> = self
            .model
            .joints
            .iter()
            .filter(|joint| joint.parent == self.model.tip)
            .map(|j| j.child)
            .collect();
        for (block, body) in self.state.objects.iter().enumerate() {
            let position = Point::from(body.pose.translation.vector);
            if (position - center).norm() > GRASP_RADIUS {
                continue;
            }
            for (k, &link) in fingers.iter().enumerate() {
                let side = if k % 2 == 0 { 1.0 } else { -1.0 };
                let normal = tip.rotation * Vector::x() * side;
                let _ = self.state.contacts.try_push(Contact {
                    object: block,
                    link,
                    point: position,
                    normal,
                    force: FINGER_FORCE,
                });
            }
        }
    }

    /// Where a block that is let go at `pose` comes to stand.
    fn resting_pose(&self, block: usize, pose: &Pose) -> Pose {
        let position = pose.translation.vector;
        let half = match self.scene.objects[block].shape {
            Shape::Box { size } => size[2] / 2.0,
            Shape::Sphere { radius } => radius,
            Shape::Cylinder { length, .. } => length / 2.0,
            Shape::Capsule { radius, length } => length / 2.0 + radius,
        };
        let under = self.scene.fixed.iter().filter_map(|object| {
            let Shape::Box { size } = object.shape else { return None };
            let center = object.pose.translation.vector;
            let top = center.z + size[2] / 2.0;
            let over = (0..2).all(|k| (position[k] - center[k]).abs() <= size[k] / 2.0);
            (over && top <= position.z).then_some(top)
        });
        let ground = under.fold(0.0, f64::max);
        Pose::translation(position.x, position.y, ground + half)
    }
}

impl Plant for KinematicPlant {
    fn step(&mut self, command: &PlantCommand) -> Result<(), PlantError> {
        for (what, values) in [("position", &command.position), ("velocity", &command.velocity)] {
            let (got, expected) = (values.len(), self.model.moving_count());
            if got != expected {
                return Err(PlantError::WrongLength { what, got, expected });
            }
            if let Some(index) = values.iter().position(|value| !value.is_finite()) {
                return Err(PlantError::NotFinite { what, index, value: values[index] });
            }
        }
        let state = &mut self.state;
        let offset = command.world_from_base.translation.vector - state.world_from_base.translation.vector;
        // Written so that a pose that is no number counts as a jump.
        let follows = offset.norm() <= BASE_SPEED * TICK_SECS;
        state.base_held = !follows;
        if follows {
            state.world_from_base = command.world_from_base;
        }
        state.position = command.position.clone();
        state.velocity = command.velocity.clone();
        if let (Some(link), Some((block, link_from_block))) = (self.attached_link, self.state.attached) {
            self.state.objects[block].pose = self.links()[link] * link_from_block;
        }
        self.update_contacts();
        Ok(())
    }

    fn state(&self) -> &PlantState {
        &self.state
    }

    fn attach(&mut self, block: usize, link: usize) -> Result<(), PlantError> {
        let refuse = |what: String| Err(PlantError::Model(what));
        if let Some((held, _)) = self.state.attached {
            return refuse(format!("block {held} is attached already"));
        }
        let Some(body) = self.state.objects.get(block) else {
            return refuse(format!("there is no block {block}"));
        };
        let Some(world_from_link) = self.links().get(link).copied() else {
            return refuse(format!("there is no link {link}"));
        };
        self.state.attached = Some((block, world_from_link.inv_mul(&body.pose)));
        self.attached_link = Some(link);
        Ok(())
    }

    fn release(&mut self) {
        self.attached_link = None;
        if let Some((block, _)) = self.state.attached.take() {
            self.state.objects[block].pose = self.resting_pose(block, &self.state.objects[block].pose);
        }
    }

    fn place(&mut self, block: usize, body: &BodyState) -> Result<(), PlantError> {
        if self.state.attached.is_some_and(|(held, _)| held == block) {
            return Err(PlantError::Model(format!("block {block} is attached")));
        }
        let here = self
            .state
            .objects
            .get_mut(block)
            .ok_or(PlantError::Model(format!("there is no block {block}")))?;
        *here = *body;
        Ok(())
    }
}
