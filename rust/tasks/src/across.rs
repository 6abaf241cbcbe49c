use crate::{Task, TaskInput, TaskResult, TaskState};
use proact_types::{BodyState, Briefing, EventKind, ObjectId, ObjectSet, Scene, SimTime, TaskContext};
use serde_json::{Map, json};

/// The box-and-blocks test's rule: an object counts when the fingertips cross the partition with it, also if it then
/// falls on the floor. It counts once; two carried at once count one, because the one that the hand holds is counted.
///
/// Nothing counts during practice, and what is brought across then stays where it is put. (In a clinic the cubes are put
/// back; here nobody does.) Deterministic: state follows from the calls alone.
#[derive(Clone, Debug)]
pub struct Across {
    briefing: Briefing,
    scene: Scene,
    practice: SimTime,
    limit: SimTime,
    /// 1 where objects go to y > 0, -1 where they go to y < 0.
    side: f64,
    held: Option<ObjectId>,
    crossed: ObjectSet,
    /// When each crossing was, in order.
    times: Vec<(ObjectId, SimTime)>,
    grasps: u32,
    state: TaskState,
}

impl Across {
    /// The task before its start.
    pub(crate) fn new(briefing: Briefing, scene: Scene) -> Self {
        let all = ObjectSet::first(scene.objects.len());
        let context = TaskContext { due: all, number: 0 };
        Self {
            practice: SimTime::from_secs(briefing.practice_secs),
            limit: SimTime::from_secs(briefing.limit_secs),
            side: if scene.put_down.centre(0.0).y < 0.0 { -1.0 } else { 1.0 },
            held: None,
            crossed: ObjectSet::default(),
            times: Vec::new(),
            grasps: 0,
            state: TaskState { candidates: all, context, context_at_grasp: context, ..TaskState::default() },
            briefing,
            scene,
        }
    }

    fn note_hand(&mut self, held: Option<ObjectId>, events: &mut Vec<EventKind>) {
        if held == self.held {
            return;
        }
        if let Some(object) = self.held {
            events.push(EventKind::ObjectReleased { object });
        }
        if let Some(object) = held {
            self.grasps += 1;
            events.push(EventKind::ObjectAttached { object });
        }
        self.held = held;
    }

    /// An object on the table of the start side may still be taken.
    fn is_candidate(&self, id: ObjectId, body: &BodyState) -> bool {
        let centre = body.pose.translation.vector;
        let in_play = centre.z > self.scene.table_height && self.side * centre.y <= 0.0;
        in_play && !self.crossed.contains(id)
    }
}

impl Task for Across {
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
        self.note_hand(seen.held, &mut events);
        if now == self.practice {
            events.push(EventKind::PracticeFinished);
        }
        let across = !seen.fingertips.is_empty() && seen.fingertips.iter().all(|tip| self.side * tip.y > 0.0);
        if let Some(object) = seen.held.filter(|object| across && !self.crossed.contains(*object)) {
            self.crossed.insert(object);
            if now > self.practice {
                self.times.push((object, now));
                events.push(EventKind::ObjectCrossed { object });
            }
        }
        let bodies = self.scene.ids().zip(seen.objects);
        self.state.candidates =
            bodies.filter(|(id, body)| self.is_candidate(*id, body)).map(|(id, _)| id).collect();
        self.state.score = self.times.len() as u32;
        // A hand that still holds the last one may yet bring it across.
        let none_left = self.state.candidates.is_empty() && self.held.is_none();
        if none_left || now >= self.limit {
            self.state.finished = true;
            events.push(EventKind::TrialFinished);
        }
        events
    }

    fn result(&self, objects: &[BodyState]) -> TaskResult {
        let on_floor = |body: &&BodyState| body.pose.translation.vector.z < self.scene.table_height;
        // Divided, so that 1001 ms are written as 1.001.
        let since_practice = |at: &SimTime| at.millis_since(self.practice) as f64 / 1e3;
        let crossing = |(id, at): &(ObjectId, SimTime)| json!({"object": self.scene.name(*id), "seconds": since_practice(at)});
        let mut result = Map::new();
        result.insert("crossed".to_owned(), json!(self.times.len()));
        result.insert("objects".to_owned(), json!(self.scene.objects.len()));
        result.insert("grasps".to_owned(), json!(self.grasps));
        result.insert("on_floor".to_owned(), json!(objects.iter().filter(on_floor).count()));
        result.insert("crossings".to_owned(), self.times.iter().map(crossing).collect());
        let line = |(id, at): &(ObjectId, SimTime)| {
            format!("{:<12}crossed after {:.1} s", self.scene.name(*id), since_practice(at))
        };
        TaskResult {
            score: f64::from(self.state.score),
            result,
            beside: Map::new(),
            lines: self.times.iter().map(line).collect(),
        }
    }

    fn minds_fingertips(&self) -> bool {
        true
    }
}
