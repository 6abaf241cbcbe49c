use crate::{ObjectResult, Outcome, Task, TaskInput, TaskResult, TaskState, task_file::ExpectedObject};
use proact_types::{
    BodyState, Briefing, EventKind, ObjectId, ObjectSet, Order, Pose, Scene, SimTime, Target, TaskContext,
};
use serde_json::{Map, json};

/// Slower than this an object may be at rest, m/s.
const REST_SPEED: f64 = 0.01;
/// An object at rest for this long has settled, ms.
const REST_MILLIS: u64 = 300;
/// Moved by less than this, an object stands where it stood, metres.
const MOVED_DISTANCE_M: f64 = 0.01;

#[derive(Clone, Copy, Debug, Default)]
struct ObjectProgress {
    held_once: bool,
    first_contact: Option<SimTime>,
    last_contact: Option<SimTime>,
    pick_began: SimTime,
    released: Option<SimTime>,
    slow_since: Option<SimTime>,
    settled: Option<Outcome>,
    /// When it settled on its target.
    on_target_at: Option<SimTime>,
}

/// Each object to its own target across the partition: what counts is what comes to rest there.
///
/// An object that rests across the partition or on the floor is settled; one on the start side stays in play. The trial
/// ends when all are settled, or at the limit. Deterministic: state follows from the calls alone.
#[derive(Clone, Debug)]
pub struct TargetPlacement {
    briefing: Briefing,
    scene: Scene,
    order: Vec<ObjectId>,
    expected_object: ExpectedObject,
    limit: SimTime,
    /// 1 where the targets are at y > 0, -1 where they are at y < 0.
    target_side: f64,
    progress: Vec<ObjectProgress>,
    held: Option<ObjectId>,
    released: Option<ObjectId>,
    last_release: SimTime,
    finished_at: Option<SimTime>,
    state: TaskState,
}

impl TargetPlacement {
    /// The task before its start. `scene` has a target for each object, `order` all of them.
    pub(crate) fn new(briefing: Briefing, scene: Scene, order: Vec<ObjectId>, due: ExpectedObject) -> Self {
        let count = scene.objects.len();
        let mut task = Self {
            limit: SimTime::from_secs(briefing.limit_secs),
            target_side: if scene.place_region.center(0.0).y < 0.0 { -1.0 } else { 1.0 },
            progress: vec![ObjectProgress::default(); count],
            held: None,
            released: None,
            last_release: SimTime(0),
            finished_at: None,
            state: TaskState::default(),
            briefing,
            scene,
            order,
            expected_object: due,
        };
        task.update_state();
        task
    }

    /// What is due where the object `last` was taken or released last.
    fn expected_context(&self, last: Option<ObjectId>) -> TaskContext {
        let objects = &self.scene.objects;
        match self.expected_object {
            ExpectedObject::Any => {
                TaskContext { expected_objects: ObjectSet::first(objects.len()), selection_number: 0 }
            }
            ExpectedObject::Next => {
                let number = self.state.next_object.map_or(0, |next| u32::from(next.0) + 1);
                TaskContext {
                    expected_objects: self.state.next_object.into_iter().collect(),
                    selection_number: number,
                }
            }
            ExpectedObject::OtherColor => {
                let color = |id: ObjectId| objects[id.index()].color;
                let is_due = |id: &ObjectId| match last {
                    Some(last) => color(*id) != color(last),
                    None => color(*id) == color(self.order[0]),
                };
                // Colours are numbered as the first object of each stands in the scene.
                let first = |last| self.scene.ids().position(|id| color(id) == color(last));
                let number = last.and_then(first).map_or(0, |first| first as u32 + 1);
                TaskContext {
                    expected_objects: self.scene.ids().filter(is_due).collect(),
                    selection_number: number,
                }
            }
        }
    }

    fn update_state(&mut self) {
        let settled = |id: &ObjectId| self.progress[id.index()].settled.is_some();
        self.state.candidates = self.scene.ids().filter(|id| !settled(id)).collect();
        let next = self.order.iter().copied().find(|id| !settled(id));
        self.state.next_object = next.filter(|_| self.briefing.order == Order::Prescribed);
        self.state.score =
            self.progress.iter().filter(|p| p.settled == Some(Outcome::OnTarget)).count() as u32;
        self.state.context = self.expected_context(self.released);
        self.state.context_at_grasp = self.expected_context(self.held.or(self.released));
    }

    fn update_hand(&mut self, now: SimTime, held: Option<ObjectId>, events: &mut Vec<EventKind>) {
        if held == self.held {
            return;
        }
        if let Some(object) = self.held {
            self.progress[object.index()].released = Some(now);
            self.last_release = now;
            self.released = Some(object);
            events.push(EventKind::ObjectReleased { object });
        }
        if let Some(object) = held {
            let progress = &mut self.progress[object.index()];
            progress.held_once = true;
            progress.settled = None;
            progress.on_target_at = None;
            if progress.first_contact.is_none() {
                progress.first_contact = Some(now);
                progress.pick_began = self.last_release;
            }
            progress.last_contact = Some(now);
            progress.released = None;
            events.push(EventKind::ObjectAttached { object });
        }
        self.held = held;
    }

    fn update_object(&mut self, now: SimTime, id: ObjectId, body: &BodyState, events: &mut Vec<EventKind>) {
        let at_rest = self.held != Some(id) && body.linear_velocity.norm() < REST_SPEED;
        let distance = self.distance(id, body);
        let outcome = self.outcome_at_rest(id, body, distance);
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
        progress.on_target_at = (outcome == Some(Outcome::OnTarget)).then_some(now);
        match outcome {
            Some(Outcome::OnTarget) => events.push(EventKind::ObjectOnTarget { object: id, distance }),
            Some(_) => events.push(EventKind::ObjectOffTarget { object: id }),
            None => {}
        }
    }

    fn outcome_at_rest(&self, id: ObjectId, body: &BodyState, distance: f64) -> Option<Outcome> {
        let center = body.pose.translation.vector;
        if center.z < self.scene.table_height {
            Some(Outcome::DroppedFloor)
        } else if self.target_side * center.y <= 0.0 {
            None
        } else if self.scene.target(id).is_some_and(|target| distance <= target.radius) {
            Some(Outcome::OnTarget)
        } else {
            Some(Outcome::CrossedOffTarget)
        }
    }

    fn distance(&self, id: ObjectId, body: &BodyState) -> f64 {
        let from = |target: &Target| (body.pose.translation.vector - target.center.coords).xy().norm();
        self.scene.target(id).map_or(f64::NAN, from)
    }

    /// One line per object, in the prescribed order, for objects as they are now.
    pub fn results(&self, objects: &[BodyState]) -> Vec<ObjectResult> {
        let line = |id: &ObjectId| {
            let (body, progress) = (&objects[id.index()], &self.progress[id.index()]);
            let start = self.scene.objects[id.index()].pose.translation.vector;
            let moved = (body.pose.translation.vector - start).norm() > MOVED_DISTANCE_M;
            let outcome = progress.settled.unwrap_or(if progress.held_once {
                // Still in the hand when time ran out counts as not brought across.
                Outcome::DroppedTableSide
            } else if moved {
                Outcome::MovedNotCrossed
            } else {
                Outcome::NotAttempted
            });
            let seconds = |from: SimTime, to: SimTime| to.millis_since(from) as f64 * 1e-3;
            ObjectResult {
                block: self.scene.name(*id),
                outcome,
                pick_s: progress.first_contact.map(|t| seconds(progress.pick_began, t)),
                place_s: progress.last_contact.zip(progress.released).map(|(a, b)| seconds(a, b)),
                distance_m: self.distance(*id, body),
            }
        };
        self.order.iter().map(line).collect()
    }
}

/// A heading and a line for each object.
fn outcome_lines(outcomes: &[ObjectResult]) -> Vec<String> {
    let seconds = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |s| format!("{s:.1} s"));
    let mut lines =
        vec![format!("{:<10}{:<20}{:>9}{:>9}{:>12}", "block", "outcome", "pick", "place", "from target")];
    lines.extend(outcomes.iter().map(|line| {
        let from = format!("{:.1} cm", line.distance_m * 100.0);
        let (pick, place) = (seconds(line.pick_s), seconds(line.place_s));
        format!("{:<10}{:<20}{pick:>9}{place:>9}{from:>12}", line.block, line.outcome.as_str())
    }));
    lines
}

impl Task for TargetPlacement {
    fn scene(&self) -> &Scene {
        &self.scene
    }

    fn briefing(&self) -> &Briefing {
        &self.briefing
    }

    fn state(&self) -> &TaskState {
        &self.state
    }

    fn step(&mut self, now: SimTime, seen: &TaskInput<'_>) -> Vec<EventKind> {
        let mut events = Vec::new();
        if self.state.finished {
            return events;
        }
        self.update_hand(now, seen.held, &mut events);
        for (id, body) in self.scene.ids().zip(seen.objects) {
            self.update_object(now, id, body, &mut events);
        }
        self.update_state();
        let open = self.order.iter().any(|id| self.progress[id.index()].settled.is_none());
        if !open || now >= self.limit {
            self.state.finished = true;
            self.finished_at = Some(now);
            events.push(EventKind::TrialFinished);
        }
        events
    }

    fn set_start(&mut self, object: ObjectId, start: Pose) {
        self.scene.objects[object.index()].pose = start;
    }

    fn result(&self, objects: &[BodyState]) -> TaskResult {
        let outcomes = self.results(objects);
        let ended = |p: &ObjectProgress| p.on_target_at.map(|at| at.millis_since(SimTime(0)) as f64 * 1e-3);
        let all_on = self.state.score as usize == self.order.len();
        let last = self.progress.iter().filter_map(ended).fold(0.0, f64::max);
        let mut result = Map::new();
        result.insert("on_target".to_owned(), json!(self.state.score));
        result.insert("objects".to_owned(), json!(self.order.len()));
        // The time of a timed test: until the last object lies on its target; none where one does not.
        result.insert("seconds".to_owned(), json!(all_on.then_some(last)));
        result.insert("outcomes".to_owned(), json!(outcomes));
        TaskResult {
            score: f64::from(self.state.score),
            result,
            legacy_fields: Map::new(),
            lines: outcome_lines(&outcomes),
        }
    }
}
