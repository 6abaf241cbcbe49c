//! What a stage knows of the world from messages: joints, base, blocks, the block in the hand, the task.

use proact_tasks::BoxAndBlocks;
use proact_types::{
    ArmModel, BlockId, BodyState, EventKind, PlantState, Point, Pose, SimTime, Vector, zeros,
};
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

/// The world as messages tell it. Each stage has its own; none looks into the simulator.
#[derive(Clone, Debug)]
pub struct World {
    model: Arc<ArmModel>,
    joints: BTreeMap<String, usize>,
    state: PlantState,
    task: BoxAndBlocks,
    joints_seen: bool,
    bodies_seen: bool,
}

impl World {
    /// Before the first message: the blocks where `task` has them.
    pub fn new(model: Arc<ArmModel>, task: BoxAndBlocks, world_from_base: Pose) -> Self {
        let joints =
            model.moving().enumerate().map(|(k, joint)| (model.joints[joint].name.clone(), k)).collect();
        let still = |pose| BodyState { pose, linear: Vector::zeros(), angular: Vector::zeros() };
        let count = model.moving_count();
        let state = PlantState {
            position: zeros(count),
            velocity: zeros(count),
            effort: zeros(count),
            world_from_base,
            blocks: task.scene().blocks.iter().map(|block| still(block.pose)).collect(),
            attached: None,
            contacts: Default::default(),
            base_held: false,
        };
        Self { model, joints, state, task, joints_seen: false, bodies_seen: false }
    }

    /// Joints and bodies have both been seen.
    pub fn is_complete(&self) -> bool {
        self.joints_seen && self.bodies_seen
    }

    /// The world as last told; effort and contacts are not known.
    pub fn state(&self) -> &PlantState {
        &self.state
    }

    /// The task, judged from what is seen of the blocks.
    pub fn task(&self) -> &BoxAndBlocks {
        &self.task
    }

    /// The arm.
    pub fn model(&self) -> &Arc<ArmModel> {
        &self.model
    }

    /// The block in the hand.
    pub fn held(&self) -> Option<BlockId> {
        self.state.attached.and_then(|(block, _)| BlockId::ALL.get(block).copied())
    }

    /// Centres of the blocks in `world`, `BlockId::ALL` order.
    pub fn block_centres(&self) -> [Point; 4] {
        std::array::from_fn(|k| Point::from(self.state.blocks[k].pose.translation.vector))
    }

    /// `world_from_tip`.
    pub fn world_from_tip(&self) -> Pose {
        self.state.world_from_base * self.model.link_poses(&self.state.position)[self.model.tip]
    }

    /// Where the hand takes a block, in `world`.
    pub fn grasp_centre(&self) -> Point {
        self.world_from_tip() * Point::from(self.model.grasp_centre)
    }

    /// Angles (rad) and speeds (rad/s; may be empty) by joint name. Joints that are not named keep theirs.
    ///
    /// # Errors
    /// [`WorldError`].
    pub fn take_joints(
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
        let places: Vec<usize> = names
            .iter()
            .map(|name| self.joints.get(name).copied().ok_or(WorldError::Joint { name: name.clone() }))
            .collect::<Result<_, _>>()?;
        for (k, place) in places.into_iter().enumerate() {
            self.state.position[place] = position[k];
            self.state.velocity[place] = velocity.get(k).copied().unwrap_or(0.0);
        }
        self.joints_seen = true;
        Ok(())
    }

    /// The base, `world_from_base`.
    pub fn take_base(&mut self, world_from_base: Pose) {
        self.state.world_from_base = world_from_base;
    }

    /// A body by its name in Gazebo. Names of other models are passed over: a lab has more than our blocks.
    pub fn take_body(&mut self, name: &str, body: BodyState) {
        if let Some(k) = BlockId::ALL.iter().position(|id| id.ros_name() == name) {
            self.state.blocks[k] = body;
            self.bodies_seen = true;
        }
    }

    /// The hand took or let go `block`.
    pub fn take_grasp(&mut self, block: BlockId, attached: bool) {
        let pose = self.world_from_tip().inv_mul(&self.state.blocks[block.index()].pose);
        self.state.attached = attached.then_some((block.index(), pose));
    }

    /// Only whether something is held: then it is the block nearest to the hand. For a node that was not there when
    /// the hand took it.
    pub fn take_grasp_status(&mut self, attached: bool) {
        if !attached {
            self.state.attached = None;
        } else if self.state.attached.is_none() && self.is_complete() {
            let (hand, centres) = (self.grasp_centre(), self.block_centres());
            let far = |id: &BlockId| (centres[id.index()] - hand).norm();
            if let Some(nearest) = BlockId::ALL.into_iter().min_by(|a, b| far(a).total_cmp(&far(b))) {
                self.take_grasp(nearest, true);
            }
        }
    }

    /// Advances the task to `now`; answers what it noticed.
    pub fn step(&mut self, now: SimTime) -> Vec<EventKind> {
        if !self.is_complete() {
            return vec![];
        }
        if let Some((block, _)) = self.state.attached {
            let pose = self.world_from_tip().inv_mul(&self.state.blocks[block].pose);
            self.state.attached = Some((block, pose));
        }
        let held = self.held();
        self.task.step(now, &self.state.blocks, held).events
    }
}

/// The block of a grasp event's collision name, `model::link::collision`.
pub fn block_of_collision(object: &str) -> Option<BlockId> {
    let model = object.split("::").next().unwrap_or_default();
    BlockId::ALL.into_iter().find(|id| id.ros_name() == model)
}

/// Ticks as `/clock` brings them. A clock that goes back (a simulator that was started again) does not take the
/// stage's own time back: it goes on from where it was.
#[derive(Clone, Copy, Debug, Default)]
pub struct StageClock {
    graph: Option<SimTime>,
    now: SimTime,
}

/// Longest step of the clock that is taken as time, ms; further on it is a jump.
const LONGEST_STEP: u64 = 2000;

impl StageClock {
    /// The stage's own time.
    pub fn now(&self) -> SimTime {
        self.now
    }

    /// The graph's time, for stamps; none before the first message.
    pub fn graph(&self) -> Option<SimTime> {
        self.graph
    }

    /// A message came: the stage's ticks since the one before, oldest first.
    ///
    /// # Errors
    /// The clock went back or jumped; no tick has passed then.
    pub fn take(&mut self, graph: SimTime) -> Result<std::ops::RangeInclusive<u64>, String> {
        let Some(before) = self.graph.replace(graph) else {
            self.now = graph;
            // Empty: no tick has passed yet.
            return Ok(graph.0 + 1..=graph.0);
        };
        if graph < before {
            return Err(format!(
                "/clock goes back from {:.3} s to {:.3} s",
                before.as_secs(),
                graph.as_secs()
            ));
        }
        let passed = graph.0 - before.0;
        if passed > LONGEST_STEP {
            return Err(format!("/clock jumps by {:.3} s", passed as f64 * 1e-3));
        }
        let first = self.now.0 + 1;
        self.now = self.now.plus_millis(passed);
        Ok(first..=self.now.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_tasks::Arrangement;

    fn world() -> World {
        let model = Arc::new(proact_types::ArmModel {
            name: "arm".into(),
            links: vec![proact_types::Link {
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
            grasp_centre: Vector::zeros(),
        });
        let task = BoxAndBlocks::new(Arrangement::numbered(1).expect("there are 24"));
        World::new(model, task, Pose::translation(-0.39, 0.12, 1.5))
    }

    #[test]
    fn unknown_joints_wrong_lengths_and_numbers_that_are_none_are_refused() {
        let mut world = world();
        let names = vec!["nose".to_owned()];
        let mut refused = |position: &[f64], velocity: &[f64]| {
            world.take_joints(&names, position, velocity).expect_err("refused").to_string()
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
        world.take_joints(&[], &[], &[]).expect("no joints, no fault");
        let at = BodyState {
            pose: Pose::translation(-0.39, 0.12, 1.45),
            linear: Vector::zeros(),
            angular: Vector::zeros(),
        };
        world.take_body("bluecylinder1", at);
        world.take_body("teapot", at);
        world.take_grasp_status(true);
        assert_eq!(world.held().map(BlockId::ros_name), Some("bluecylinder1"));
        world.take_grasp_status(false);
        assert_eq!(world.held(), None);
    }

    #[test]
    fn collision_names_lead_to_blocks() {
        assert_eq!(
            block_of_collision("redcylinder2::link::collision").map(BlockId::ros_name),
            Some("redcylinder2")
        );
        assert_eq!(block_of_collision(""), None);
    }

    #[test]
    fn time_that_goes_back_is_told_and_the_stages_own_time_goes_on() {
        let mut clock = StageClock::default();
        assert_eq!(clock.take(SimTime(500)).map(Iterator::count), Ok(0));
        assert_eq!(clock.take(SimTime(510)), Ok(501..=510));
        assert!(clock.take(SimTime(3)).expect_err("it went back").contains("goes back"));
        assert_eq!((clock.now(), clock.graph()), (SimTime(510), Some(SimTime(3))));
        assert_eq!(clock.take(SimTime(5)), Ok(511..=512));
        assert!(clock.take(SimTime(900_000)).is_err());
        assert_eq!(clock.now(), SimTime(512));
    }
}
