use proact_tasks::{BlockResult, BoxAndBlocks, TaskState};
use proact_types::{BlockId, BodyState, EventKind, SimTime};

/// The task: judges what happens to the blocks.
pub struct TaskStage {
    task: BoxAndBlocks,
}

/// What enters the task in one tick.
#[derive(Clone, Copy, Debug)]
pub struct TaskInput<'a> {
    /// Blocks in `BlockId::ALL` order.
    pub blocks: &'a [BodyState],
    /// The block in the hand.
    pub held: Option<BlockId>,
}

/// What the task says in one tick.
#[derive(Clone, Debug, PartialEq)]
pub struct TaskOutput {
    /// The task as it stands.
    pub state: TaskState,
    /// What happened.
    pub events: Vec<EventKind>,
}

impl TaskStage {
    /// The stage of a trial with `task`.
    pub fn new(task: BoxAndBlocks) -> Self {
        Self { task }
    }

    /// The task.
    pub fn task(&self) -> &BoxAndBlocks {
        &self.task
    }

    /// One tick.
    pub fn step(&mut self, now: SimTime, input: TaskInput<'_>) -> TaskOutput {
        let events = self.task.step(now, input.blocks, input.held).events;
        TaskOutput { state: self.task.state().clone(), events }
    }

    /// One line per block, in the prescribed order, for blocks as they are now.
    pub fn results(&self, blocks: &[BodyState]) -> Vec<BlockResult> {
        self.task.results(blocks)
    }
}
