use crate::{Arrangement, BlockResult, Outcome, PlaceRegion, TABLE_TOP, TARGET_RADIUS, geometry};
use proact_types::{BlockColour, BlockId, BodyState, EventKind, Region, Scene, SimTime};
use serde::Serialize;

/// Slower than this a block may be at rest, m/s.
const REST_SPEED: f64 = 0.01;
/// A block at rest for this long has settled, ms.
const REST_MILLIS: u64 = 300;
/// Moved by less than this, a block stands where it stood, metres.
const MOVED: f64 = 0.01;

/// The task as the control method and the display see it.
#[derive(Clone, Debug, PartialEq)]
pub struct TaskState {
    /// Colour of the block last released; none before the first.
    pub last_released: Option<BlockColour>,
    /// Blocks that can still be picked, in `BlockId::ALL` order: not yet across, not on the floor.
    pub pickable: [bool; 4],
    /// The block that the prescribed order asks for next.
    pub next: Option<BlockId>,
    /// Blocks that rest on their targets.
    pub on_target: u32,
    /// All blocks are settled, or time is up.
    pub finished: bool,
}

/// What one step of the task tells.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TaskStep {
    /// What happened in this tick.
    pub events: Vec<EventKind>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Progress {
    held_once: bool,
    first_contact: Option<SimTime>,
    last_contact: Option<SimTime>,
    pick_began: SimTime,
    released: Option<SimTime>,
    slow_since: Option<SimTime>,
    settled: Option<Outcome>,
}

/// The modified box-and-blocks task: four numbered blocks, in order, over the partition, in five minutes.
///
/// Deterministic: state follows from the calls alone.
#[derive(Clone, Debug)]
pub struct BoxAndBlocks {
    scene: Scene,
    limit: SimTime,
    progress: [Progress; 4],
    held: Option<BlockId>,
    last_release: SimTime,
    state: TaskState,
}

impl BoxAndBlocks {
    /// Time limit of a trial, seconds (paper, "Modifications to format").
    pub const LIMIT_SECS: f64 = 300.0;

    /// What the task is called in configurations.
    pub const NAME: &str = "box_and_blocks";

    /// All that the task is made of, whatever the arrangement: what a record is compared with.
    pub fn content() -> impl Serialize {
        (
            (geometry::fixed_objects(), geometry::blocks(Region::ALL), geometry::targets()),
            BlockId::PRESCRIBED_ORDER,
            (PlaceRegion::DEFAULT, TARGET_RADIUS),
            (REST_SPEED, REST_MILLIS, MOVED),
        )
    }

    /// The task with its blocks in `arrangement`.
    pub fn new(arrangement: Arrangement) -> Self {
        let scene = Scene {
            fixed: geometry::fixed_objects(),
            blocks: geometry::blocks(arrangement.regions()),
            targets: geometry::targets(),
            table_height: TABLE_TOP,
        };
        Self {
            scene,
            limit: SimTime::from_secs(Self::LIMIT_SECS),
            progress: Default::default(),
            held: None,
            last_release: SimTime(0),
            state: TaskState {
                last_released: None,
                pickable: [true; 4],
                next: Some(BlockId::PRESCRIBED_ORDER[0]),
                on_target: 0,
                finished: false,
            },
        }
    }

    /// Ends the trial at `limit` instead of after five minutes.
    pub fn with_limit(mut self, limit: SimTime) -> Self {
        self.limit = limit;
        self
    }

    /// What stands where at the start.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// When the trial ends at the latest.
    pub fn limit(&self) -> SimTime {
        self.limit
    }

    /// The task as it stands.
    pub fn state(&self) -> &TaskState {
        &self.state
    }

    /// Advances to `now`: `blocks` in `BlockId::ALL` order, `held` the block in the hand.
    pub fn step(&mut self, now: SimTime, blocks: &[BodyState], held: Option<BlockId>) -> TaskStep {
        let mut step = TaskStep::default();
        if self.state.finished {
            return step;
        }
        self.note_hand(now, held, &mut step.events);
        for id in BlockId::ALL {
            self.note_block(now, id, &blocks[id.index()], &mut step.events);
        }

        let settled = |id: BlockId| self.progress[id.index()].settled.is_some();
        self.state.pickable = BlockId::ALL.map(|id| !settled(id));
        self.state.next = BlockId::PRESCRIBED_ORDER.into_iter().find(|&id| !settled(id));
        self.state.on_target =
            self.progress.iter().filter(|p| p.settled == Some(Outcome::OnTarget)).count() as u32;
        if self.state.next.is_none() || now >= self.limit {
            self.state.finished = true;
            step.events.push(EventKind::TrialFinished);
        }
        step
    }

    fn note_hand(&mut self, now: SimTime, held: Option<BlockId>, events: &mut Vec<EventKind>) {
        if held == self.held {
            return;
        }
        if let Some(block) = self.held {
            self.progress[block.index()].released = Some(now);
            self.last_release = now;
            self.state.last_released = Some(block.colour());
            events.push(EventKind::BlockReleased { block });
        }
        if let Some(block) = held {
            let progress = &mut self.progress[block.index()];
            progress.held_once = true;
            progress.settled = None;
            if progress.first_contact.is_none() {
                progress.first_contact = Some(now);
                progress.pick_began = self.last_release;
            }
            progress.last_contact = Some(now);
            progress.released = None;
            events.push(EventKind::BlockAttached { block });
        }
        self.held = held;
    }

    /// A block that came to rest across the partition or on the floor is settled; one on the start side stays
    /// in play.
    fn note_block(&mut self, now: SimTime, id: BlockId, body: &BodyState, events: &mut Vec<EventKind>) {
        let at_rest = self.held != Some(id) && body.linear.norm() < REST_SPEED;
        let distance = self.distance(id, body);
        let outcome = self.place_of(body, distance);
        let progress = &mut self.progress[id.index()];
        if !at_rest {
            progress.slow_since = None;
            return;
        }
        let since = *progress.slow_since.get_or_insert(now);
        if now.millis_since(since) < REST_MILLIS || outcome == progress.settled {
            return;
        }
        progress.settled = outcome;
        match outcome {
            Some(Outcome::OnTarget) => events.push(EventKind::BlockOnTarget { block: id, distance }),
            Some(_) => events.push(EventKind::BlockOffTarget { block: id }),
            None => {}
        }
    }

    fn place_of(&self, body: &BodyState, distance: f64) -> Option<Outcome> {
        let centre = body.pose.translation.vector;
        if centre.z < TABLE_TOP {
            Some(Outcome::DroppedFloor)
        } else if centre.y <= 0.0 {
            None
        } else if distance <= TARGET_RADIUS {
            Some(Outcome::OnTarget)
        } else {
            Some(Outcome::CrossedOffTarget)
        }
    }

    fn distance(&self, id: BlockId, body: &BodyState) -> f64 {
        let offset = body.pose.translation.vector - self.scene.targets[id.index()].centre.coords;
        offset.xy().norm()
    }

    /// One line per block, in the prescribed order, for the blocks as they are now.
    pub fn results(&self, blocks: &[BodyState]) -> Vec<BlockResult> {
        BlockId::PRESCRIBED_ORDER
            .into_iter()
            .map(|block| {
                let body = &blocks[block.index()];
                let progress = &self.progress[block.index()];
                let distance_m = self.distance(block, body);
                let start = self.scene.blocks[block.index()].pose.translation.vector;
                let moved = (body.pose.translation.vector - start).norm() > MOVED;
                let outcome = progress.settled.unwrap_or(if progress.held_once {
                    // Still in the hand when time ran out counts as not brought across.
                    Outcome::DroppedTableSide
                } else if moved {
                    Outcome::MovedNotCrossed
                } else {
                    Outcome::NotAttempted
                });
                let seconds = |from: SimTime, to: SimTime| to.millis_since(from) as f64 * 1e-3;
                BlockResult {
                    block,
                    outcome,
                    pick_s: progress.first_contact.map(|t| seconds(progress.pick_began, t)),
                    place_s: progress.last_contact.zip(progress.released).map(|(a, b)| seconds(a, b)),
                    distance_m,
                }
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::{Point, Pose, Vector};

    fn at(point: Point) -> BodyState {
        BodyState {
            pose: Pose::translation(point.x, point.y, point.z + geometry::BLOCK_HEIGHT / 2.0),
            linear: Vector::zeros(),
            angular: Vector::zeros(),
        }
    }

    fn task() -> (BoxAndBlocks, Vec<BodyState>) {
        let task = BoxAndBlocks::new(Arrangement::numbered(1).expect("1 to 24"));
        let blocks = task
            .scene()
            .blocks
            .iter()
            .map(|b| BodyState { pose: b.pose, linear: Vector::zeros(), angular: Vector::zeros() })
            .collect();
        (task, blocks)
    }

    fn run(
        task: &mut BoxAndBlocks,
        from: u64,
        to: u64,
        blocks: &[BodyState],
        held: Option<BlockId>,
    ) -> Vec<EventKind> {
        (from..to).flat_map(|t| task.step(SimTime(t), blocks, held).events).collect()
    }

    #[test]
    fn blocks_that_stand_still_at_the_start_are_not_attempted_and_nothing_happens() {
        let (mut task, blocks) = task();
        assert!(run(&mut task, 1, 2000, &blocks, None).is_empty());
        assert!(task.results(&blocks).iter().all(|r| r.outcome == Outcome::NotAttempted));
        assert_eq!(task.state().next, Some(BlockId::Red1));
    }

    #[test]
    fn a_block_carried_to_its_target_counts_after_it_rests_and_the_next_colour_is_asked_for() {
        let (mut task, mut blocks) = task();
        run(&mut task, 1, 1000, &blocks, None);
        run(&mut task, 1000, 4000, &blocks, Some(BlockId::Red1));
        let target = task.scene().targets[0].centre;
        blocks[0] = at(target + Vector::new(0.03, 0.0, 0.0));
        let events = run(&mut task, 4000, 5000, &blocks, None);
        assert_eq!(events[0], EventKind::BlockReleased { block: BlockId::Red1 });
        assert!(
            matches!(events[1], EventKind::BlockOnTarget { block: BlockId::Red1, distance } if (distance - 0.03).abs() < 1e-12)
        );
        assert_eq!(task.state().next, Some(BlockId::Blue1));
        assert_eq!(task.state().last_released, Some(BlockColour::Red));
        let result = &task.results(&blocks)[0];
        assert_eq!((result.pick_s, result.place_s), (Some(1.0), Some(3.0)));
    }

    #[test]
    fn each_outcome_is_told_apart() {
        let (mut task, mut blocks) = task();
        run(&mut task, 1, 500, &blocks, Some(BlockId::Red1));
        blocks[BlockId::Red2.index()] = at(Point::new(0.0, 0.15, TABLE_TOP));
        blocks[BlockId::Blue1.index()] = at(Point::new(0.3, 0.0, 0.0));
        let pushed = blocks[BlockId::Blue2.index()].pose.translation.vector;
        blocks[BlockId::Blue2.index()] = at(Point::new(pushed.x + 0.02, pushed.y, TABLE_TOP));
        run(&mut task, 500, 1500, &blocks, None);
        let outcomes: Vec<Outcome> = task.results(&blocks).iter().map(|r| r.outcome).collect();
        use Outcome::*;
        assert_eq!(outcomes, [DroppedTableSide, DroppedFloor, CrossedOffTarget, MovedNotCrossed]);
    }

    #[test]
    fn the_trial_ends_when_all_blocks_are_settled_or_at_the_limit() {
        let (mut task, mut blocks) = task();
        for (k, target) in task.scene().targets.clone().iter().enumerate() {
            blocks[k] = at(target.centre);
        }
        let events = run(&mut task, 1, 1000, &blocks, None);
        assert_eq!(events.last(), Some(&EventKind::TrialFinished));
        assert_eq!(task.state().on_target, 4);

        let (task2, blocks) = self::task();
        let mut task2 = task2.with_limit(SimTime(50));
        assert_eq!(run(&mut task2, 1, 60, &blocks, None), [EventKind::TrialFinished]);
    }
}
