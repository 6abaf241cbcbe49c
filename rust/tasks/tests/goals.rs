//! Moves from place to place, reaches, and postures: what counts, and when a task is over.

use proact_tasks::{Task, TaskFile, TaskInput, TaskSpec};
use proact_types::{BodyState, EventKind, ObjectId, Point, Pose, SimTime, TaskGoal, Vector};
use serde_json::{Value, json};

/// Lowest and highest angle of seven joints.
const LIMITS: [[f64; 2]; 7] = [[-1.0, 1.0]; 7];

struct Trial {
    task: Box<dyn Task>,
    objects: Vec<BodyState>,
    joints: [f64; 7],
    hand: Point,
    now: u64,
}

impl Trial {
    fn named(name: &str) -> Self {
        let mut task = TaskSpec::named(name, 1).expect("it ships").build(false).expect("a good task");
        task.check_arm(&LIMITS).expect("an arm that can");
        let resting =
            |pose| BodyState { pose, linear_velocity: Vector::zeros(), angular_velocity: Vector::zeros() };
        let objects = task.scene().objects.iter().map(|object| resting(object.pose)).collect();
        Self { task, objects, joints: [0.0; 7], hand: Point::origin(), now: 0 }
    }

    /// Ticks for so many milliseconds.
    fn run(&mut self, millis: u64, held: Option<ObjectId>) -> Vec<EventKind> {
        let mut events = Vec::new();
        for _ in 0..millis {
            self.now += 1;
            let seen = TaskInput {
                objects: &self.objects,
                held,
                fingertips: &[],
                joints: &self.joints,
                hand: self.hand,
            };
            events.extend(self.task.step(SimTime(self.now), &seen));
        }
        events
    }

    /// Where the next object is asked for.
    fn disc(&self) -> Point {
        let Some(TaskGoal::Disc { center, .. }) = self.task.state().goal else {
            panic!("no place is asked for")
        };
        center
    }

    fn ball(&self) -> (Point, f64) {
        let Some(TaskGoal::Ball { center, radius }) = self.task.state().goal else { panic!("no ball") };
        (center, radius)
    }

    fn lay(&mut self, object: ObjectId, at: Point) {
        let half = self.task.scene().objects[object.index()].shape.half_height();
        self.objects[object.index()].pose = Pose::translation(at.x, at.y, at.z + half);
    }

    fn result(&self) -> Value {
        Value::Object(self.task.result(&self.objects).result)
    }
}

#[test]
fn a_box_goes_from_shelf_to_shelf_and_back_and_each_transfer_has_its_times() {
    let mut trial = Trial::named("pasta_box");
    let pasta = ObjectId(0);
    let heights: Vec<f64> = (0..3)
        .map(|_| {
            let disc = trial.disc();
            assert_eq!(trial.run(1000, None), [], "what nobody took is not moved, wherever it rests");
            assert_eq!(trial.run(1000, Some(pasta)), [EventKind::ObjectAttached { object: pasta }]);
            trial.lay(pasta, disc + Vector::new(0.02, 0.0, 0.0));
            let events = trial.run(301, None);
            assert_eq!(events[0], EventKind::ObjectReleased { object: pasta });
            let EventKind::ObjectOnTarget { object: ObjectId(0), distance } = events[1] else {
                panic!("{events:?}")
            };
            assert!((distance - 0.02).abs() < 1e-9);
            disc.z
        })
        .collect();
    assert!(heights[0] < heights[1] && heights[2] < heights[0], "{heights:?}");
    assert!(trial.task.state().finished);
    let result = trial.result();
    assert_eq!((&result["moved"], &result["of_moves"], &result["fell"]), (&json!(3), &json!(3), &json!(0)));
    // Taken in the first tick after the wait, let go in the first tick after the hold; a move begins with the end of the one before.
    let [first, second] = [&result["moves"][0], &result["moves"][1]];
    assert_eq!((&first["pick_s"], &first["place_s"]), (&json!(1.001), &json!(1.0)));
    assert_eq!((&second["pick_s"], &second["seconds"]), (&json!(1.001), &json!(2.301)));
    assert_eq!(result["seconds"], json!(6.903));
}

#[test]
fn what_is_put_down_elsewhere_or_lower_stays_in_play_and_what_falls_is_lost() {
    let mut trial = Trial::named("pasta_box");
    let pasta = ObjectId(0);
    let disc = trial.disc();
    trial.run(10, Some(pasta));
    // Under the shelf, on the table.
    trial.lay(pasta, disc - Vector::new(0.0, 0.0, 0.08));
    let events = trial.run(1000, None);
    assert_eq!(events[1..], [EventKind::ObjectOffTarget { object: pasta }], "said once");
    assert_eq!((trial.task.state().next_object, trial.task.state().score), (Some(pasta), 0));
    trial.lay(pasta, Point::new(0.5, 0.0, 0.0));
    trial.run(10, None);
    assert!(trial.task.state().finished, "every move is of this box");
    let result = trial.result();
    assert_eq!((&result["fell"], &result["seconds"]), (&json!(3), &Value::Null));
}

#[test]
fn cups_are_asked_for_in_their_order_and_a_wrong_one_changes_nothing() {
    let mut trial = Trial::named("cup_transfer");
    let (one, two) = (ObjectId(0), ObjectId(1));
    trial.run(100, Some(two));
    trial.lay(two, trial.disc());
    trial.run(400, None);
    assert_eq!((trial.task.state().next_object, trial.task.state().score), (Some(one), 0));
    let mut next_objects = Vec::new();
    while let Some(next) = trial.task.state().next_object {
        next_objects.push(next);
        trial.run(100, Some(next));
        trial.lay(next, trial.disc());
        trial.run(400, None);
    }
    assert_eq!(next_objects, [one, two, two, one]);
    assert_eq!(trial.result()["moved"], json!(4));
}

#[test]
fn a_posture_counts_once_it_is_kept_and_leaving_it_is_an_overshoot() {
    let mut trial = Trial::named("target_achievement");
    let joints = |trial: &Trial| {
        let Some(TaskGoal::Posture { joints }) = trial.task.state().goal.clone() else {
            panic!("no posture")
        };
        joints
    };
    let first = joints(&trial);
    assert_eq!(first.len(), 1);
    // 0.7 of the range from -1 to 1, the fourth joint.
    assert!(first[0].joint == 3 && (first[0].angle - 0.4).abs() < 1e-12, "{first:?}");
    trial.run(1000, None);
    trial.joints[3] = first[0].angle + 0.9 * first[0].tolerance;
    trial.run(1500, None);
    trial.joints[3] = first[0].angle + 1.1 * first[0].tolerance;
    trial.run(500, None);
    trial.joints[3] = first[0].angle;
    assert_eq!(trial.run(2001, None), [EventKind::GoalReached { number: 1 }]);
    // The second one is not reached.
    assert_eq!(trial.run(45_001, None), [EventKind::GoalMissed { number: 2 }]);
    let result = trial.result();
    let goal = &result["goals"][0];
    // From when it is shown, with the first tick, until the last entry.
    assert_eq!(
        (&goal["reached"], &goal["seconds"], &goal["overshoots"]),
        (&json!(true), &json!(3.0), &json!(1))
    );
    let efficiency = goal["path_efficiency"].as_f64().expect("a number");
    // Out to 1.1 tolerances beyond it, and back.
    let (path_length, straight) = (first[0].angle + 2.2 * first[0].tolerance, first[0].angle);
    assert!((efficiency - straight / path_length).abs() < 1e-6, "{efficiency}");
    assert_eq!((&result["completion_rate"], &result["completion_s"]), (&json!(0.5), &json!(3.0)));
    assert_eq!(trial.task.state().score, 1);
}

#[test]
fn reaches_have_both_throughputs_and_the_first_of_each_ring_does_not_count() {
    let mut trial = Trial::named("reaching");
    let mut step = 0_u32;
    while !trial.task.state().finished {
        let (center, radius) = trial.ball();
        // A second on the way, then near the middle, a little further each time.
        trial.run(1000, None);
        step += 1;
        trial.hand = center + Vector::new(0.0, 0.1 * radius * f64::from(step % 3), 0.0);
        trial.run(1001, None);
    }
    let result = trial.result();
    assert_eq!(
        (&result["asked"], &result["reached"], &result["completion_rate"]),
        (&json!(14), &json!(14), &json!(1.0))
    );
    assert_eq!(result["goals"].as_array().map(Vec::len), Some(16));
    let goals = result["goals"].as_array().expect("a list");
    let counts = |goal: &Value| goal["counts"] == json!(true);
    let number = |goal: &Value, key: &str| goal[key].as_f64().expect("a number");
    for condition in [1, 2] {
        let of: Vec<&Value> = goals.iter().filter(|g| g["condition"] == json!(condition)).collect();
        assert!(!counts(of[0]) && of[1..].iter().all(|goal| counts(goal)));
        // From ball to ball across a ring of 20 cm with seven balls.
        assert!(of[1..].iter().all(|goal| (number(goal, "distance_m") - 0.195).abs() < 1e-3));
    }
    let rate = |condition: i64| {
        let of: Vec<&Value> =
            goals.iter().filter(|g| counts(g) && g["condition"] == json!(condition)).collect();
        let sum = |key: &str| of.iter().map(|goal| number(goal, key)).sum::<f64>();
        sum("difficulty_bits") / sum("seconds")
    };
    let expected = (rate(1) + rate(2)) / 2.0;
    assert!((number(&result, "throughput_bits_per_s") - expected).abs() < 1e-12);
    let effective = number(&result, "effective_throughput_bits_per_s");
    assert!(
        effective > expected,
        "who ends nearer to the middle than the ball asks for has more: {effective}"
    );
}

#[test]
fn files_that_cannot_be_are_refused_with_what_was_expected() {
    let text = |name: &str| {
        toml::to_string(&TaskSpec::named(name, 1).and_then(|choice| choice.task_file()).expect("it ships"))
            .expect("writes")
    };
    let refused = |name: &str, old: &str, new: &str| {
        let text = text(name);
        assert!(text.contains(old), "{old} is not in {text}");
        TaskFile::read(&text.replacen(old, new, 1))
            .and_then(|file| file.build(false))
            .err()
            .unwrap_or_else(|| panic!("{new} is not refused"))
            .to_string()
    };
    for (name, old, new, why) in [
        (
            "pasta_box",
            "object = \"pasta_box\"",
            "object = \"soup\"",
            "\"soup\" is no object; expected pasta_box",
        ),
        ("pasta_box", "0.02, 1.095]", "0.02, 1.3]", "is on nothing; expected the top of a fixed body"),
        ("pasta_box", "destination = \"shown\"", "destination = \"across\"", "expected \"shown\""),
        ("pasta_box", "order = \"prescribed\"", "order = \"any\"", "order of their own"),
        ("pasta_box", "rules = \"moves\"", "rules = \"postures\"", "the rules are not \"moves\""),
        ("reaching", "targets = 7", "targets = 8", "an odd number from 3 to 99"),
        ("reaching", "dwell_secs = 1.0", "dwell_secs = 20.0", "dwell_secs is 20, expected 0.01 to 15"),
        ("target_achievement", "joint = 4", "joint = 0", "joint is 0, expected 1 to 100"),
        ("target_achievement", "share = 0.7", "share = 1.5", "share is 1.5, expected 0 to 1"),
    ] {
        let error = refused(name, old, new);
        assert!(error.contains(why), "{error}, expected {why}");
    }
}

#[test]
fn an_arm_that_lacks_a_joint_or_its_range_is_told() {
    let task =
        || TaskSpec::named("target_achievement", 1).expect("it ships").build(false).expect("a good task");
    let error = task().check_arm(&LIMITS[..5]).expect_err("five joints").to_string();
    assert!(error.contains("joint 7, the arm has joints 1 to 5"), "{error}");
    let narrow = [[0.0, 0.1]; 7];
    let error = task().check_arm(&narrow).expect_err("narrow").to_string();
    assert!(error.contains("nearer to its limit than the tolerance, 5.0"), "{error}");
}
