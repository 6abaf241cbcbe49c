use crate::{HeapFile, Task, TaskInput, TaskResult, TaskState};
use proact_types::{
    BodyState, Briefing, EventKind, ObjectId, ObjectSet, Pose, Scene, SimTime, TaskContext, Vector,
};
use serde_json::{Map, json};

/// Objects that found no room where they were sent back to are sent again after this time.
const RESEND_AFTER_MS: u64 = 1000;

/// The box-and-blocks test's rule: an object counts when the fingertips cross the partition with it, also if it then
/// falls on the floor. It counts once; two carried at once count one, because the one that the hand holds is counted.
///
/// Nothing counts during practice, and what is brought across then stays where it is put. (In a clinic the cubes are put
/// back; here nobody does.) Where a task refills, objects that are across fall back to the start side when few are left there, and count
/// again. Deterministic: state follows from the calls alone.
#[derive(Clone, Debug)]
pub struct PartitionCrossing {
    briefing: Briefing,
    scene: Scene,
    practice: SimTime,
    limit: SimTime,
    /// 1 where objects go to y > 0, -1 where they go to y < 0.
    target_side: f64,
    held: Option<ObjectId>,
    crossed: ObjectSet,
    /// When each crossing was, in order.
    times: Vec<(ObjectId, SimTime)>,
    grasps: u32,
    refill: Option<HeapRefill>,
    state: TaskState,
}

/// Objects that fall back to where they began.
#[derive(Clone, Debug)]
pub(crate) struct HeapRefill {
    min_objects: usize,
    heap: HeapFile,
    /// Those that were sent back and have not been seen there.
    returning: ObjectSet,
    /// When any were sent back last.
    last_sent: Option<SimTime>,
    /// Of the newest step.
    placements: Vec<(ObjectId, BodyState)>,
}

impl HeapRefill {
    /// When fewer than `below` are left, into the area of `heap`, which is as in the text: for the right hand.
    pub(crate) fn new(below: usize, heap: HeapFile) -> Self {
        Self {
            min_objects: below,
            heap,
            returning: ObjectSet::default(),
            last_sent: None,
            placements: Vec::new(),
        }
    }

    /// Sends `back` to places above all of `objects` that lie in the area; `side`: as [`PartitionCrossing::target_side`].
    fn send_back(&mut self, back: Vec<ObjectId>, objects: &[BodyState], table: f64, side: f64) {
        let height = |body: &BodyState| body.pose.translation.vector.z;
        let there = objects.iter().filter(|body| side * body.pose.translation.vector.y <= 0.0);
        let top = there.map(height).fold(table, f64::max);
        // The height of the topmost middle, and room for that one however it is turned.
        let cells = self.heap.cells(top + self.heap.cell_size(), back.len());
        let fall = |[x, y, z]: [f64; 3]| BodyState {
            pose: Pose::translation(x, side * y, z),
            linear_velocity: Vector::zeros(),
            angular_velocity: Vector::zeros(),
        };
        self.returning = back.iter().copied().collect();
        self.placements = back.into_iter().zip(cells.into_iter().map(fall)).collect();
    }
}

impl PartitionCrossing {
    /// The task before its start.
    pub(crate) fn new(briefing: Briefing, scene: Scene, refill: Option<HeapRefill>) -> Self {
        let all = ObjectSet::first(scene.objects.len());
        let context = TaskContext { expected_objects: all, selection_number: 0 };
        Self {
            practice: SimTime::from_secs(briefing.practice_secs),
            limit: SimTime::from_secs(briefing.limit_secs),
            target_side: if scene.place_region.center(0.0).y < 0.0 { -1.0 } else { 1.0 },
            held: None,
            crossed: ObjectSet::default(),
            times: Vec::new(),
            grasps: 0,
            refill,
            state: TaskState { candidates: all, context, context_at_grasp: context, ..TaskState::default() },
            briefing,
            scene,
        }
    }

    fn update_hand(&mut self, held: Option<ObjectId>, events: &mut Vec<EventKind>) {
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

    /// Those that were sent back and are there can be taken, and count, again.
    fn restore_returned(&mut self, objects: &[BodyState]) {
        let Some(refill) = &mut self.refill else { return };
        refill.placements.clear();
        for (id, body) in self.scene.ids().zip(objects) {
            if refill.returning.contains(id) && self.target_side * body.pose.translation.vector.y <= 0.0 {
                refill.returning.remove(id);
                self.crossed.remove(id);
            }
        }
    }

    /// Sends back what is not on the start side if too few are left there.
    fn refill_if_needed(&mut self, now: SimTime, objects: &[BodyState]) -> Option<EventKind> {
        let refill = self.refill.as_mut()?;
        // What found no room, because the hand was there, is sent again after a while.
        let lately = refill.last_sent.is_some_and(|sent| now.millis_since(sent) < RESEND_AFTER_MS);
        if self.state.candidates.len() >= refill.min_objects || lately {
            return None;
        }
        let away = |id: &ObjectId| !self.state.candidates.contains(*id) && self.held != Some(*id);
        let back: Vec<ObjectId> = self.scene.ids().filter(away).collect();
        let count = u32::try_from(back.len()).ok().filter(|count| *count > 0)?;
        refill.last_sent = Some(now);
        refill.send_back(back, objects, self.scene.table_height, self.target_side);
        Some(EventKind::ObjectsRefilled { count })
    }

    /// An object on the table of the start side may still be taken.
    fn is_candidate(&self, id: ObjectId, body: &BodyState) -> bool {
        let center = body.pose.translation.vector;
        let in_play = center.z > self.scene.table_height && self.target_side * center.y <= 0.0;
        in_play && !self.crossed.contains(id)
    }
}

impl Task for PartitionCrossing {
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
        self.update_hand(seen.held, &mut events);
        if now == self.practice {
            events.push(EventKind::PracticeFinished);
        }
        let across =
            !seen.fingertips.is_empty() && seen.fingertips.iter().all(|tip| self.target_side * tip.y > 0.0);
        if let Some(object) = seen.held.filter(|object| across && !self.crossed.contains(*object)) {
            self.crossed.insert(object);
            if now > self.practice {
                self.times.push((object, now));
                events.push(EventKind::ObjectCrossed { object });
            }
        }
        self.restore_returned(seen.objects);
        let bodies = self.scene.ids().zip(seen.objects);
        self.state.candidates =
            bodies.filter(|(id, body)| self.is_candidate(*id, body)).map(|(id, _)| id).collect();
        self.state.score = self.times.len() as u32;
        events.extend(self.refill_if_needed(now, seen.objects));
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
            legacy_fields: Map::new(),
            lines: self.times.iter().map(line).collect(),
        }
    }

    fn placements(&self) -> &[(ObjectId, BodyState)] {
        self.refill.as_ref().map_or(&[], |refill| &refill.placements)
    }

    fn needs_fingertips(&self) -> bool {
        true
    }
}
