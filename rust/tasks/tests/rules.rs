//! What counts, and when a task is over.

use proact_tasks::{Arrangement, Task, TaskInput, TaskSpec};
use proact_types::{BodyState, EventKind, ObjectId, ObjectSet, Point, Pose, SimTime, TaskContext, Vector};
use serde_json::{Value, json};

const RED_1: ObjectId = ObjectId(0);
const RED_2: ObjectId = ObjectId(1);
const BLUE_1: ObjectId = ObjectId(2);
const BLUE_2: ObjectId = ObjectId(3);

/// A task, its objects as they lie, and the time.
struct Trial {
    task: Box<dyn Task>,
    objects: Vec<BodyState>,
    now: u64,
}

fn resting(pose: Pose) -> BodyState {
    BodyState { pose, linear_velocity: Vector::zeros(), angular_velocity: Vector::zeros() }
}

impl Trial {
    fn new(task: Box<dyn Task>) -> Self {
        let objects = task.scene().objects.iter().map(|o| resting(o.pose)).collect();
        Self { task, objects, now: 0 }
    }

    fn named(name: &str) -> Self {
        Self::new(TaskSpec::named(name, 1).expect("it ships").build(false).expect("a good task"))
    }

    fn modified(limit_secs: Option<f64>) -> Self {
        let arrangement = Some(Arrangement::numbered(1).expect("1 to 24"));
        let choice = TaskSpec { arrangement, ..TaskSpec::named("modified_bbt", 1).expect("it ships") };
        Self::new(choice.build_with_limit(false, limit_secs).expect("a good task"))
    }

    /// Lays `object` to rest with its bottom at `position`.
    fn lay(&mut self, object: ObjectId, position: Point) {
        let half = self.task.scene().objects[object.index()].shape.half_height();
        self.objects[object.index()] = resting(Pose::translation(position.x, position.y, position.z + half));
    }

    /// Ticks until `end`, that tick included.
    fn until(&mut self, end: u64, held: Option<ObjectId>) -> Vec<EventKind> {
        self.tips_until(end, held, &[])
    }

    fn tips_until(&mut self, end: u64, held: Option<ObjectId>, tips: &[[f64; 3]]) -> Vec<EventKind> {
        let fingertips: Vec<Point> = tips.iter().map(|tip| Point::from(*tip)).collect();
        let mut events = Vec::new();
        while self.now < end {
            self.now += 1;
            let seen = TaskInput {
                objects: &self.objects,
                held,
                fingertips: &fingertips,
                joints: &[],
                hand: Point::origin(),
            };
            events.extend(self.task.step(SimTime(self.now), &seen));
        }
        events
    }

    fn result(&self) -> Value {
        Value::Object(self.task.result(&self.objects).result)
    }

    fn outcomes(&self) -> Vec<(String, String)> {
        let text = |value: &Value| value.as_str().expect("a text").to_owned();
        let result = self.result();
        let lines = result["outcomes"].as_array().expect("a list");
        lines.iter().map(|line| (text(&line["block"]), text(&line["outcome"]))).collect()
    }

    fn due(&self) -> Vec<usize> {
        self.task.state().context.expected_objects.iter().map(ObjectId::index).collect()
    }
}

#[test]
fn blocks_that_stand_still_at_the_start_are_not_attempted_and_nothing_happens() {
    let mut trial = Trial::modified(None);
    assert!(trial.until(2000, None).is_empty());
    let names: Vec<_> = trial.outcomes();
    let expected =
        ["red1", "blue1", "red2", "blue2"].map(|name| (name.to_owned(), "not_attempted".to_owned()));
    assert_eq!(names, expected);
    let state = trial.task.state();
    assert_eq!((state.next_object, state.score, state.finished), (Some(RED_1), 0, false));
    assert_eq!(state.candidates, ObjectSet::first(4));
}

#[test]
fn a_block_carried_to_its_target_counts_after_it_rests_and_the_next_colour_is_asked_for() {
    let mut trial = Trial::modified(None);
    assert_eq!(
        (trial.due(), trial.task.state().context.selection_number),
        (vec![0, 1], 0),
        "red comes first"
    );
    trial.until(999, None);
    assert_eq!(trial.until(3999, Some(RED_1)), [EventKind::ObjectAttached { object: RED_1 }]);
    // The original changes the colour that is due when a block is taken, the paper when it is released.
    assert_eq!(trial.due(), [0, 1]);
    let at_grasp: Vec<_> = trial.task.state().context_at_grasp.expected_objects.iter().collect();
    assert_eq!(at_grasp, [BLUE_1, BLUE_2]);

    let target = trial.task.scene().targets[0].center;
    trial.lay(RED_1, target + Vector::new(0.03, 0.0, 0.0));
    assert_eq!(
        trial.until(4299, None),
        [EventKind::ObjectReleased { object: RED_1 }],
        "it has just been let go"
    );
    let events = trial.until(5000, None);
    let [EventKind::ObjectOnTarget { object: RED_1, distance }] = events[..] else { panic!("{events:?}") };
    assert!((distance - 0.03).abs() < 1e-12, "{distance}");
    let state = trial.task.state();
    assert_eq!((state.next_object, state.score, state.context.selection_number), (Some(BLUE_1), 1, 1));
    assert_eq!(state.candidates.iter().collect::<Vec<_>>(), [RED_2, BLUE_1, BLUE_2]);
    assert_eq!(trial.due(), [2, 3]);

    let result = trial.task.result(&trial.objects);
    let first = &result.result["outcomes"][0];
    assert_eq!(
        (&first["block"], &first["pick_s"], &first["place_s"]),
        (&json!("red1"), &json!(1.0), &json!(3.0))
    );
    assert_eq!(result.score, 1.0);
    // Keys of records from before there were other tasks.
    assert_eq!(result.legacy_fields["arrangement"], json!(["FL", "FM", "NL", "NM"]));
    assert_eq!(result.legacy_fields["on_target"], json!(1));
    assert_eq!(result.legacy_fields["outcomes"], result.result["outcomes"]);
    assert_eq!(result.result["seconds"], Value::Null, "not all are on their targets");
}

#[test]
fn the_colour_that_is_due_changes_at_the_release_and_where_the_original_is_kept_at_the_grasp_already() {
    let mut trial = Trial::modified(None);
    let due = |context: TaskContext| context.expected_objects.iter().map(ObjectId::index).collect::<Vec<_>>();
    trial.until(100, Some(ObjectId(0)));
    let held = trial.task.state().clone();
    assert_eq!((due(held.context), due(held.context_at_grasp)), (vec![0, 1], vec![2, 3]));
    trial.until(200, None);
    let released = trial.task.state().clone();
    assert_eq!((due(released.context), due(released.context_at_grasp)), (vec![2, 3], vec![2, 3]));
    assert_ne!(held.context.selection_number, released.context.selection_number, "another selection begins");
}

#[test]
fn each_outcome_is_told_apart() {
    let mut trial = Trial::modified(None);
    trial.until(499, Some(RED_1));
    trial.lay(RED_2, Point::new(0.0, 0.15, 1.015));
    trial.lay(BLUE_1, Point::new(0.3, 0.0, 0.0));
    let pushed = trial.objects[BLUE_2.index()].pose.translation;
    trial.lay(BLUE_2, Point::new(pushed.x + 0.02, pushed.y, 1.015));
    let events = trial.until(1500, None);
    assert!(events.contains(&EventKind::ObjectOffTarget { object: RED_2 }), "{events:?}");
    assert!(events.contains(&EventKind::ObjectOffTarget { object: BLUE_1 }), "{events:?}");
    let outcomes: Vec<String> = trial.outcomes().into_iter().map(|(_, outcome)| outcome).collect();
    assert_eq!(outcomes, ["dropped_table_side", "dropped_floor", "crossed_off_target", "moved_not_crossed"]);
}

#[test]
fn a_block_taken_again_from_its_target_counts_no_longer() {
    let mut trial = Trial::modified(None);
    trial.lay(RED_1, trial.task.scene().targets[0].center);
    trial.until(1000, None);
    assert_eq!(trial.task.state().score, 1);
    trial.until(1001, Some(RED_1));
    assert_eq!((trial.task.state().score, trial.task.state().next_object), (0, Some(RED_1)));
}

#[test]
fn the_trial_ends_when_all_blocks_are_settled_or_at_the_limit() {
    let mut trial = Trial::modified(None);
    for target in trial.task.scene().targets.clone() {
        trial.lay(target.object, target.center);
    }
    let events = trial.until(1000, None);
    assert_eq!(events.last(), Some(&EventKind::TrialFinished));
    let state = trial.task.state();
    assert_eq!((state.score, state.finished, state.next_object), (4, true, None));
    assert_eq!(trial.result()["seconds"], json!(0.301), "the last one had rested for 300 ms");
    assert!(trial.until(1100, Some(RED_1)).is_empty(), "nothing happens after the end");

    let mut trial = Trial::modified(Some(0.05));
    assert!(trial.until(49, None).is_empty());
    assert_eq!(trial.until(60, None), [EventKind::TrialFinished]);
}

#[test]
fn the_modified_task_lasts_five_minutes_and_asks_in_the_order_of_the_paper() {
    let mut trial = Trial::modified(None);
    trial.now = 299_998;
    assert!(trial.until(299_999, None).is_empty());
    assert_eq!(trial.until(300_000, None).last(), Some(&EventKind::TrialFinished));

    let mut trial = Trial::modified(None);
    for expected in [RED_1, BLUE_1, RED_2, BLUE_2] {
        assert_eq!(trial.task.state().next_object, Some(expected));
        let target = *trial.task.scene().target(expected).expect("each has one");
        trial.lay(expected, target.center);
        trial.until(trial.now + 400, None);
    }
    assert_eq!(trial.task.state().next_object, None);
}

#[test]
fn the_targeted_task_asks_for_its_cubes_by_number_and_only_the_next_is_due() {
    let mut trial = Trial::named("targeted_bbt");
    let mut numbers = Vec::new();
    for k in 0..16 {
        let id = ObjectId::new(k);
        let state = trial.task.state();
        assert_eq!((state.next_object, state.score, state.finished), (Some(id), k as u32, false));
        assert_eq!(trial.due(), [k]);
        assert_eq!(state.candidates.len(), 16 - k);
        numbers.push(state.context.selection_number);
        let target = trial.task.scene().target(id).expect("each has one").center;
        trial.until(trial.now + 600, Some(id));
        assert_eq!(trial.due(), [k], "it is due until it lies there");
        trial.lay(id, target + Vector::new(0.027, 0.0, 0.0));
        trial.until(trial.now + 400, None);
    }
    numbers.dedup();
    assert_eq!(numbers.len(), 16, "each cube is a selection of its own: {numbers:?}");
    let state = trial.task.state();
    assert_eq!(
        (state.score, state.finished, state.next_object, state.context.expected_objects.len()),
        (16, true, None, 0)
    );
    let result = trial.result();
    assert_eq!((&result["on_target"], &result["objects"]), (&json!(16), &json!(16)));
    // Each takes a second; the last one counts after it has rested for 300 ms.
    assert_eq!(result["seconds"], json!(15.901));
}

#[test]
fn a_cube_outside_the_radius_of_its_target_is_off_target_and_there_is_no_time() {
    let mut trial = Trial::named("targeted_bbt");
    for target in trial.task.scene().targets.clone() {
        let aside = if target.object == ObjectId(3) { 0.028 } else { 0.0 };
        trial.lay(target.object, target.center + Vector::new(aside, 0.0, 0.0));
    }
    trial.until(1000, None);
    assert_eq!((trial.task.state().score, trial.task.state().finished), (15, true));
    assert_eq!(trial.outcomes()[3], ("cube4".to_owned(), "crossed_off_target".to_owned()));
    assert_eq!(trial.result()["seconds"], Value::Null);
}

/// All digits across the partition, and one of them still above the start side.
const ACROSS: [[f64; 3]; 3] = [[0.0, 0.02, 1.2], [0.01, 0.001, 1.2], [-0.01, 0.03, 1.2]];
const NOT_ALL: [[f64; 3]; 3] = [[0.0, 0.02, 1.2], [0.01, -0.001, 1.2], [-0.01, 0.03, 1.2]];
const CUBE: ObjectId = ObjectId(7);

/// The test after its practice.
fn counting() -> Trial {
    let mut trial = Trial::named("bbt");
    assert_eq!(trial.until(15_000, None), [EventKind::PracticeFinished]);
    trial
}

#[test]
fn a_cube_counts_when_all_fingertips_are_across_with_it() {
    let mut trial = counting();
    assert_eq!(trial.tips_until(16_000, Some(CUBE), &NOT_ALL), [EventKind::ObjectAttached { object: CUBE }]);
    assert_eq!(trial.task.state().score, 0);
    assert_eq!(trial.tips_until(17_000, Some(CUBE), &ACROSS), [EventKind::ObjectCrossed { object: CUBE }]);
    let state = trial.task.state();
    assert_eq!((state.score, state.candidates.contains(CUBE), state.next_object), (1, false, None));
    let result = trial.result();
    assert_eq!(
        (&result["crossed"], &result["objects"], &result["grasps"]),
        (&json!(1), &json!(20), &json!(1))
    );
    assert_eq!(
        result["crossings"],
        json!([{"object": "cube8", "seconds": 1.001}]),
        "since the end of practice"
    );
}

#[test]
fn a_hand_of_which_no_fingertip_is_known_and_an_empty_hand_count_nothing() {
    let mut trial = counting();
    trial.tips_until(16_000, Some(CUBE), &[]);
    trial.tips_until(17_000, None, &ACROSS);
    assert_eq!(trial.task.state().score, 0);
}

#[test]
fn a_cube_that_crossed_counts_also_if_it_falls_on_the_floor_after() {
    let mut trial = counting();
    trial.tips_until(16_000, Some(CUBE), &ACROSS);
    trial.lay(CUBE, Point::new(0.5, 0.2, 0.0));
    assert_eq!(trial.until(20_000, None), [EventKind::ObjectReleased { object: CUBE }]);
    assert_eq!(trial.task.state().score, 1);
    assert_eq!((trial.result()["crossed"].clone(), trial.result()["on_floor"].clone()), (json!(1), json!(1)));
}

#[test]
fn a_cube_that_falls_before_it_crossed_counts_nothing_and_is_out_of_play() {
    let mut trial = counting();
    trial.tips_until(16_000, Some(CUBE), &NOT_ALL);
    trial.lay(CUBE, Point::new(0.5, -0.2, 0.0));
    trial.until(20_000, None);
    assert_eq!((trial.task.state().score, trial.task.state().candidates.contains(CUBE)), (0, false));
    // One that was thrown across without the hand does not count either.
    let thrown = ObjectId(3);
    trial.lay(thrown, Point::new(0.0, 0.1, 1.015));
    trial.until(21_000, None);
    assert_eq!((trial.task.state().score, trial.task.state().candidates.contains(thrown)), (0, false));
}

#[test]
fn a_cube_counts_once_and_two_at_once_count_one() {
    let mut trial = counting();
    // The second one lies on the hand: it goes across without being held.
    let second = ObjectId(8);
    trial.lay(second, Point::new(0.0, 0.01, 1.2));
    trial.tips_until(16_000, Some(CUBE), &ACROSS);
    assert_eq!(trial.task.state().score, 1);
    // Back, and across again.
    trial.tips_until(17_000, Some(CUBE), &NOT_ALL);
    trial.until(17_100, None);
    let events = trial.tips_until(18_000, Some(CUBE), &ACROSS);
    assert_eq!(events, [EventKind::ObjectAttached { object: CUBE }]);
    assert_eq!(trial.task.state().score, 1);
}

#[test]
fn nothing_counts_in_practice_and_the_test_ends_a_minute_after_it() {
    let mut trial = Trial::named("bbt");
    let events = trial.tips_until(14_000, Some(CUBE), &ACROSS);
    assert_eq!(events, [EventKind::ObjectAttached { object: CUBE }]);
    // It lies across since practice: holding on to it when practice ends does not make it count.
    let events = trial.tips_until(16_000, Some(CUBE), &ACROSS);
    assert_eq!(events, [EventKind::PracticeFinished]);
    assert_eq!(trial.task.state().score, 0);
    assert!(trial.until(74_999, Some(CUBE)).is_empty());
    assert!(!trial.task.state().finished);
    assert_eq!(trial.until(80_000, Some(CUBE)), [EventKind::TrialFinished]);
    assert_eq!((trial.task.state().finished, trial.task.result(&trial.objects).score), (true, 0.0));
}

#[test]
fn the_test_ends_early_only_when_no_cube_is_left_and_the_hand_is_empty() {
    let mut trial = counting();
    for k in 0..20 {
        let id = ObjectId::new(k);
        trial.tips_until(trial.now + 100, Some(id), &ACROSS);
        trial.lay(id, Point::new(0.0, 0.1, 1.015));
        assert!(!trial.task.state().finished, "cube {k} is in the hand");
        if k < 19 {
            trial.until(trial.now + 100, None);
        }
    }
    let events = trial.until(trial.now + 100, None);
    assert_eq!(events, [EventKind::ObjectReleased { object: ObjectId(19) }, EventKind::TrialFinished]);
    assert_eq!(trial.task.state().score, 20);
}

#[test]
fn for_the_left_hand_across_is_the_other_way() {
    let task = TaskSpec::named("bbt", 1).expect("it ships").build(true).expect("a good task");
    let mut trial = Trial::new(task);
    trial.until(15_000, None);
    assert_eq!(trial.task.state().candidates.len(), 20);
    trial.tips_until(16_000, Some(CUBE), &ACROSS);
    assert_eq!(trial.task.state().score, 0, "that is the side where they start");
    trial.tips_until(17_000, Some(CUBE), &ACROSS.map(|[x, y, z]| [x, -y, z]));
    assert_eq!(trial.task.state().score, 1);

    let task = TaskSpec::named("targeted_bbt", 1).expect("it ships").build(true).expect("a good task");
    let mut trial = Trial::new(task);
    let target = trial.task.scene().targets[0].center;
    assert!(target.y < 0.0);
    trial.lay(ObjectId(0), target);
    trial.until(1000, None);
    assert_eq!(trial.task.state().score, 1);
}

#[test]
fn only_tasks_whose_rule_needs_them_ask_for_fingertips() {
    for (name, checks_arm) in [("modified_bbt", false), ("targeted_bbt", false), ("bbt", true)] {
        assert_eq!(Trial::named(name).task.needs_fingertips(), checks_arm, "{name}");
    }
}

/// Six cubes in a heap of which the missing fall back when fewer than four are left.
fn refilled() -> Trial {
    let text = include_str!("../data/bbt_heap.toml")
        .replace("name = \"bbt_heap\"\n", "name = \"six\"\nrefill_below = 4\n")
        .replace("practice_secs = 15.0", "practice_secs = 0.0")
        .replace("count = 150", "count = 6");
    Trial::new(TaskSpec::from_text(text).and_then(|task| task.build(false)).expect("a good task"))
}

#[test]
fn when_few_are_left_those_that_are_across_fall_back_and_count_again() {
    let mut trial = refilled();
    let carry = |trial: &mut Trial, cube: u16, end: u64| {
        let events = trial.tips_until(end, Some(ObjectId(cube)), &ACROSS);
        trial.lay(ObjectId(cube), Point::new(0.0, 0.1, 1.015));
        [events, trial.until(end + 100, None)].concat()
    };
    let refills = |events: &[EventKind]| {
        events.iter().filter(|event| matches!(event, EventKind::ObjectsRefilled { .. })).count()
    };
    assert_eq!(refills(&carry(&mut trial, 0, 1000)) + refills(&carry(&mut trial, 1, 2000)), 0);
    trial.lay(ObjectId(5), Point::new(1.0, 0.1, 0.0));
    let events = trial.until(2101, None);
    assert_eq!(events, [EventKind::ObjectsRefilled { count: 3 }], "two across, and one on the floor");
    let placed = trial.task.placements().to_vec();
    assert_eq!(placed.iter().map(|(id, _)| id.0).collect::<Vec<_>>(), [0, 1, 5]);
    let above = trial.objects[2].pose.translation.z;
    for (k, (_, body)) in placed.iter().enumerate() {
        let at = body.pose.translation.vector;
        assert!(at.y < -0.005 && at.y > -0.2585 && at.x.abs() < 0.117 && at.z > above + 0.02, "{at}");
        assert!(placed[..k].iter().all(|(_, other)| (other.pose.translation.vector - at).norm() > 0.0433));
    }
    // Nothing is asked for twice, and what has not got there does not count again.
    assert!(trial.until(2500, None).is_empty() && trial.task.placements().is_empty());
    // Where the hand was in the way all the while it is asked for again.
    assert_eq!(trial.until(3101, None), [EventKind::ObjectsRefilled { count: 3 }]);
    assert_eq!(trial.task.placements().len(), 3);
    assert_eq!((trial.task.state().candidates.len(), trial.task.state().finished), (3, false));
    for (id, body) in &placed[..2] {
        trial.objects[id.index()] = *body;
    }
    trial.until(3110, None);
    assert_eq!(trial.task.state().candidates.len(), 5);
    carry(&mut trial, 0, 4000);
    assert_eq!((trial.task.state().score, &trial.result()["crossed"]), (3, &json!(3)));
}

#[test]
fn how_a_heap_lies_is_the_trials_and_what_cannot_be_is_refused() {
    let mut choice = TaskSpec::named("bbt_heap", 1).expect("it ships");
    let falling = choice.unsettled_heap().expect("a good task").expect("nobody has let it fall");
    assert_eq!(falling.count, 150);
    let turned = [0.02, -0.1, 1.05, 0.5, 0.5, -0.5, 0.5];
    let set = |choice: &mut TaskSpec, lies: Vec<[f64; 7]>| {
        choice.heap = Some(proact_tasks::HeapSpec { count: Some(2), resting_poses: lies });
    };
    set(&mut choice, vec![[0.0, -0.05, 1.0275, 0.0, 0.0, 0.0, 1.0], turned]);
    assert_eq!(choice.unsettled_heap().expect("a good task"), None);
    let pose = |left: bool| choice.build(left).expect("a good task").scene().objects[1].pose;
    assert_eq!(pose(false).translation.vector, Vector::new(0.02, -0.1, 1.05));
    // The mirror image turns the other way about the axes in the mirror's plane.
    let (right, left) = (pose(false), pose(true));
    let mirror = |v: Vector| Vector::new(v.x, -v.y, v.z);
    for corner in [Vector::new(1.0, 2.0, 3.0), Vector::new(-1.0, 0.5, 2.0)] {
        let (there, here) = (left * Point::from(mirror(corner)), right * Point::from(corner));
        assert!((there.coords - mirror(here.coords)).norm() < 1e-12);
    }
    for (lies, reason) in [
        (vec![turned], "1 poses"),
        (vec![turned, [f64::NAN; 7]], "NaN"),
        (vec![turned, [0.0, 0.1, 1.05, 0.0, 0.0, 0.0, 1.0]], "expected x and y within"),
        (vec![turned, [0.0, -0.1, 1.05, 0.0, 0.0, 0.0, 0.0]], "unit quaternion"),
    ] {
        set(&mut choice, lies);
        let error = choice.build(false).err().expect("it must be refused").to_string();
        assert!(error.contains(reason), "{error}");
    }
    let mut other = TaskSpec::named("bbt", 1).expect("it ships");
    other.heap = choice.heap.clone();
    assert!(other.build(false).err().expect("it has none").to_string().contains("no heap"));
}
