use crate::{Task, TaskInput, TaskResult, TaskState};
use proact_types::{
    BodyState, Briefing, EventKind, ObjectId, ObjectSet, Point, Scene, SimTime, TaskContext, TaskGoal,
};
use serde_json::{Map, Value, json};

/// Slower than this an object may be at rest, m/s.
const REST_SPEED: f64 = 0.01;
/// An object at rest for this long has come to rest, ms.
const REST_MILLIS: u64 = 300;
/// Its underside is then at most this far from the surface that it belongs on, metres: it may have tipped over.
const HEIGHT_TOLERANCE_M: f64 = 0.03;
/// With its middle this far below the lowest surface an object lies on the floor, metres.
const FLOOR_DROP_M: f64 = 0.02;

/// One object to one place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ObjectMove {
    pub(crate) object: ObjectId,
    /// On the surface, `world`.
    pub(crate) to: Point,
    pub(crate) radius: f64,
}

/// How a move went.
#[derive(Clone, Copy, Debug, Default)]
struct MoveProgress {
    /// When the move before was over.
    began: SimTime,
    first_contact: Option<SimTime>,
    last_contact: Option<SimTime>,
    released: Option<SimTime>,
    grasps: u32,
    /// When the object came to rest at its place.
    done: Option<SimTime>,
    /// The object fell on the floor.
    fell: bool,
    /// From the middle of the place, when it came to rest there, metres.
    distance: Option<f64>,
}

/// Moves in a prescribed order: each counts when its object has come to rest at its place, out of the hand.
///
/// What is put down elsewhere stays in play. A move whose object fell on the floor has failed, and the next one is asked
/// for. The trial ends after the last move, or at the limit. Deterministic: state follows from the calls alone.
#[derive(Clone, Debug)]
pub struct ObjectMoves {
    briefing: Briefing,
    scene: Scene,
    moves: Vec<ObjectMove>,
    limit: SimTime,
    /// Lowest surface on which something belongs.
    lowest_surface_m: f64,
    progress: Vec<MoveProgress>,
    current: usize,
    held: Option<ObjectId>,
    slow_since: Option<SimTime>,
    /// It was said that the object rests elsewhere.
    reported_off_target: bool,
    state: TaskState,
}

impl ObjectMoves {
    /// The task before its start.
    pub(crate) fn new(briefing: Briefing, scene: Scene, moves: Vec<ObjectMove>) -> Self {
        let target_heights = moves.iter().map(|planned| planned.to.z);
        let mut task = Self {
            limit: SimTime::from_secs(briefing.limit_secs),
            lowest_surface_m: target_heights.fold(scene.table_height, f64::min),
            progress: vec![MoveProgress::default(); moves.len()],
            current: 0,
            held: None,
            slow_since: None,
            reported_off_target: false,
            state: TaskState::default(),
            briefing,
            scene,
            moves,
        };
        task.update_state();
        task
    }

    fn update_state(&mut self) {
        let open = self.moves.get(self.current..).unwrap_or_default();
        let next_move = open.first();
        self.state.candidates = open.iter().map(|planned| planned.object).collect();
        self.state.next_object = next_move.map(|planned| planned.object);
        self.state.goal =
            next_move.map(|ObjectMove { to, radius, .. }| TaskGoal::Disc { center: *to, radius: *radius });
        let due: ObjectSet = self.state.next_object.into_iter().collect();
        self.state.context = TaskContext { expected_objects: due, selection_number: self.current as u32 };
        self.state.context_at_grasp = self.state.context;
        self.state.score = self.progress.iter().filter(|p| p.done.is_some()).count() as u32;
    }

    fn update_hand(&mut self, now: SimTime, held: Option<ObjectId>, events: &mut Vec<EventKind>) {
        if held == self.held {
            return;
        }
        let next_object = self.state.next_object;
        let progress = self.progress.get_mut(self.current);
        if let Some(object) = self.held {
            events.push(EventKind::ObjectReleased { object });
        }
        if let Some(object) = held {
            events.push(EventKind::ObjectAttached { object });
        }
        if let Some(progress) = progress {
            if self.held == next_object {
                progress.released = Some(now);
            }
            if held == next_object {
                progress.first_contact.get_or_insert(now);
                progress.last_contact = Some(now);
                progress.released = None;
                progress.grasps += 1;
                self.reported_off_target = false;
            }
        }
        self.held = held;
        self.slow_since = None;
    }

    /// The move that is asked for is over.
    fn next(&mut self, now: SimTime) {
        self.current += 1;
        self.slow_since = None;
        self.reported_off_target = false;
        if let Some(progress) = self.progress.get_mut(self.current) {
            progress.began = now;
        }
    }

    fn check_move(&mut self, now: SimTime, objects: &[BodyState], events: &mut Vec<EventKind>) {
        let Some(ObjectMove { object, to, radius }) = self.moves.get(self.current).copied() else { return };
        let (body, progress) = (&objects[object.index()], &mut self.progress[self.current]);
        let at = body.pose.translation.vector;
        if at.z < self.lowest_surface_m - FLOOR_DROP_M {
            progress.fell = true;
            events.push(EventKind::ObjectOffTarget { object });
            self.next(now);
            return;
        }
        // One that nobody has taken rests where it was, even if that is the place: it is to be brought there.
        let carried = progress.last_contact.is_some();
        if !carried || self.held == Some(object) || body.linear_velocity.norm() >= REST_SPEED {
            self.slow_since = None;
            return;
        }
        if now.millis_since(*self.slow_since.get_or_insert(now)) < REST_MILLIS {
            return;
        }
        let distance = (at - to.coords).xy().norm();
        // Half of the diagonal is the most that a body that lies another way is high.
        let half = self.scene.objects[object.index()].shape.half_height();
        let there = distance <= radius && (at.z - half - to.z).abs() <= HEIGHT_TOLERANCE_M.max(half);
        if there {
            (progress.done, progress.distance) = (Some(now), Some(distance));
            events.push(EventKind::ObjectOnTarget { object, distance });
            self.next(now);
        } else if !self.reported_off_target {
            self.reported_off_target = true;
            events.push(EventKind::ObjectOffTarget { object });
        }
    }
}

fn seconds(from: SimTime, to: SimTime) -> f64 {
    to.millis_since(from) as f64 / 1e3
}

impl Task for ObjectMoves {
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
        self.check_move(now, seen.objects, &mut events);
        self.update_state();
        if self.current == self.moves.len() || now >= self.limit {
            self.state.finished = true;
            events.push(EventKind::TrialFinished);
        }
        events
    }

    fn result(&self, _objects: &[BodyState]) -> TaskResult {
        let line = |(number, (planned, p)): (usize, (&ObjectMove, &MoveProgress))| {
            json!({
                "number": number + 1,
                "object": self.scene.name(planned.object),
                "done": p.done.is_some(),
                "fell": p.fell,
                "grasps": p.grasps,
                "pick_s": p.first_contact.map(|at| seconds(p.began, at)),
                "place_s": p.last_contact.zip(p.released).map(|(from, to)| seconds(from, to)),
                "seconds": p.done.map(|at| seconds(p.began, at)),
                "distance_m": p.distance,
            })
        };
        let lines: Vec<Value> = self.moves.iter().zip(&self.progress).enumerate().map(line).collect();
        let all = self.progress.iter().all(|p| p.done.is_some());
        let last = self.progress.last().and_then(|p| p.done).filter(|_| all);
        let fell = self.progress.iter().filter(|p| p.fell).count();
        let mut result = Map::new();
        result.insert("moved".to_owned(), json!(self.state.score));
        result.insert("of_moves".to_owned(), json!(self.moves.len()));
        // The time of a timed test: until the last move is done; none where one is not.
        result.insert("seconds".to_owned(), json!(last.map(|at| seconds(SimTime(0), at))));
        result.insert("fell".to_owned(), json!(fell));
        result.insert("moves".to_owned(), Value::Array(lines));
        let describe = |(planned, p): (&ObjectMove, &MoveProgress)| {
            let name = self.scene.name(planned.object);
            match (p.done, p.fell) {
                (Some(at), _) => format!("{name:<16}moved in {:.1} s", seconds(p.began, at)),
                (None, true) => format!("{name:<16}fell on the floor"),
                (None, false) => format!("{name:<16}not moved"),
            }
        };
        let lines = self.moves.iter().zip(&self.progress).map(describe).collect();
        TaskResult { score: f64::from(self.state.score), result, legacy_fields: Map::new(), lines }
    }
}
