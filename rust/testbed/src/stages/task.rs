use proact_arm::ArmModel;
use proact_tasks::{Task, TaskInput, TaskResult, TaskState};
use proact_types::{BodyState, EventKind, ObjectId, PlantState, Point, SimTime};
use std::sync::Arc;

/// The task: judges what happens to the objects.
pub struct TaskStage {
    model: Arc<ArmModel>,
    task: Box<dyn Task>,
}

/// What enters the task in one tick.
#[derive(Clone, Copy, Debug)]
pub struct TaskStageInput<'a> {
    /// The world after this tick's physics.
    pub world: &'a PlantState,
    /// The object in the hand.
    pub held: Option<ObjectId>,
}

/// What the task says in one tick.
#[derive(Clone, Debug, PartialEq)]
pub struct TaskOutput {
    /// The task as it stands.
    pub state: TaskState,
    /// What happened.
    pub events: Vec<EventKind>,
    /// Objects that the rules put somewhere: for [`WorldStage::rearrange`](crate::WorldStage::rearrange).
    pub placements: Vec<(ObjectId, BodyState)>,
}

impl TaskStage {
    /// The stage of a trial with `task`, for the arm `model`.
    pub fn new(task: Box<dyn Task>, model: Arc<ArmModel>) -> Self {
        Self { model, task }
    }

    /// The task.
    pub fn task(&self) -> &dyn Task {
        self.task.as_ref()
    }

    /// One tick.
    pub fn step(&mut self, now: SimTime, input: TaskStageInput<'_>) -> TaskOutput {
        let TaskStageInput { world, held } = input;
        let is_needed = self.task.needs_fingertips() && held.is_some();
        let fingertips = if is_needed { fingertips(&self.model, world) } else { Vec::new() };
        let joints = &world.position[..self.model.arm_count()];
        let hand = if self.task.needs_hand() { self.hand(world) } else { Point::origin() };
        let seen = TaskInput { objects: &world.objects, held, fingertips: &fingertips, joints, hand };
        let events = self.task.step(now, &seen);
        TaskOutput { state: self.task.state().clone(), events, placements: self.task.placements().to_vec() }
    }

    /// Centre of the hand's widest grasp, `world`.
    fn hand(&self, world: &PlantState) -> Point {
        let mut poses = Vec::new();
        self.model.link_poses_into(&world.world_from_base, &world.position, &mut poses);
        poses[self.model.tip] * Point::from(self.model.widest_grasp().center)
    }

    /// The result for objects as they are now.
    pub fn result(&self, objects: &[BodyState]) -> TaskResult {
        self.task.result(objects)
    }
}

/// Where the last joint of each digit is, in `world`: the nearest to its tip that a description says for certain.
fn fingertips(model: &ArmModel, world: &PlantState) -> Vec<Point> {
    let mut poses = Vec::new();
    model.link_poses_into(&world.world_from_base, &world.position, &mut poses);
    let digits = model.digits();
    let is_last = |link: usize| !model.joints.iter().any(|joint| joint.parent == link);
    let tips = (0..model.links.len()).filter(|link| digits[*link].is_some() && is_last(*link));
    tips.map(|link| Point::from(poses[link].translation.vector)).collect()
}
