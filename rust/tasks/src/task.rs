use crate::TaskError;
use proact_types::{
    BodyState, Briefing, EventKind, ObjectId, ObjectSet, Point, Pose, Scene, SimTime, TaskContext, TaskGoal,
};
use serde_json::{Map, Value};

/// A task: its scene, what a person is told, its rules, and what comes of it.
///
/// Deterministic: the calls of [`step`](Task::step) since it was made decide all that it says.
pub trait Task: Send {
    /// What stands where at the start, and where things may be put down.
    fn scene(&self) -> &Scene;

    /// What a person is told.
    fn briefing(&self) -> &Briefing;

    /// The task as it stands.
    fn state(&self) -> &TaskState;

    /// Advances to `now`, a tick after the call before; what happened.
    fn step(&mut self, now: SimTime, seen: &TaskInput<'_>) -> Vec<EventKind>;

    /// The result for objects as they are now.
    fn result(&self, objects: &[BodyState]) -> TaskResult;

    /// Sets where an object really stood at the start, `world_from_object`. A bag without the record of its trial says it in
    /// its first messages. Tasks whose result does not depend on it ignore it.
    fn set_start(&mut self, _object: ObjectId, _start: Pose) {}

    /// Objects that the rules put somewhere after the newest step, and how they are there. Where there is no room an object stays where
    /// it was.
    fn placements(&self) -> &[(ObjectId, BodyState)] {
        &[]
    }

    /// True if [`TaskInput::fingertips`] is asked for.
    fn needs_fingertips(&self) -> bool {
        false
    }

    /// True if [`TaskInput::hand`] is asked for.
    fn needs_hand(&self) -> bool {
        false
    }

    /// Told before the first step which arm is used: lowest and highest angle of each of its joints from the base, rad.
    ///
    /// # Errors
    /// [`TaskError`]: the arm cannot do what the task asks for.
    fn check_arm(&mut self, _limits: &[[f64; 2]]) -> Result<(), TaskError> {
        Ok(())
    }
}

/// What a task sees in one tick.
#[derive(Clone, Copy, Debug)]
pub struct TaskInput<'a> {
    /// Objects in the order of the scene.
    pub objects: &'a [BodyState],
    /// The object in the hand.
    pub held: Option<ObjectId>,
    /// Tips of the digits, in `world`; empty where the task does not mind them.
    pub fingertips: &'a [Point],
    /// Angles of the arm's joints from the base, rad.
    pub joints: &'a [f64],
    /// Centre of the grasp for the widest objects, in `world`; the origin where the task does not mind it.
    pub hand: Point,
}

/// The task as control, intent and display see it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TaskState {
    /// Objects that a person may still take.
    pub candidates: ObjectSet,
    /// What the task asks for, where it changes when an object is let go.
    pub context: TaskContext,
    /// The same where it changes when an object is taken already.
    pub context_at_grasp: TaskContext,
    /// The object that a prescribed order asks for next.
    pub next_object: Option<ObjectId>,
    /// Where that goes, or what hand or joints are asked for, in tasks where it changes.
    pub goal: Option<TaskGoal>,
    /// What counts, so far.
    pub score: u32,
    /// All is done, or time is up.
    pub finished: bool,
}

/// What came of a trial.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TaskResult {
    /// What counts.
    pub score: f64,
    /// What the task counts, by name.
    pub result: Map<String, Value>,
    /// Keys that stand beside `result`, for tasks that had them before.
    pub legacy_fields: Map<String, Value>,
    /// The same for a reader: a heading and a line for each object, if there are few.
    pub lines: Vec<String>,
}
