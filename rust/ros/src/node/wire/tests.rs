use super::*;
use proact_types::{StopCause, zeros};

/// Arm and scene of these tests.
const COUNTS: ExpectedCounts = ExpectedCounts { arm: 4, moving: 4, objects: 4 };

pub(super) const AWKWARD: [f64; 4] = [0.1 + 0.2, -0.0, 5e-324, 1.0 / 3.0];

/// Not of unit length in the last bits, as integration leaves it.
pub(super) fn pose() -> Pose {
    let rotation = UnitQuaternion::new_unchecked(Quaternion::new(0.5, 0.5, 0.5, 0.5 + 1e-12));
    Pose::from_parts(nalgebra::Translation3::new(AWKWARD[0], AWKWARD[1], AWKWARD[2]), rotation)
}

pub(super) fn bits(pose: &Pose) -> Vec<u64> {
    let values = pose.translation.vector.iter().chain(pose.rotation.coords.iter());
    values.map(|value| value.to_bits()).collect()
}

fn set(objects: &[u16]) -> ObjectSet {
    objects.iter().map(|object| ObjectId(*object)).collect()
}

fn instant() -> (PlantState, ActuationOutput, TaskState) {
    let body = BodyState {
        pose: pose(),
        linear_velocity: Vector::new(0.1, 0.2, 0.3),
        angular_velocity: Vector::z(),
    };
    let world = PlantState {
        position: proact_types::joints(&AWKWARD),
        velocity: zeros(4),
        effort: zeros(4),
        limit_effort: zeros(4),
        world_from_base: pose(),
        base_held: true,
        objects: [body; 4].into_iter().collect(),
        attached: Some((2, pose())),
        contacts: Default::default(),
    };
    let command = PlantCommand {
        position: proact_types::joints(&AWKWARD),
        velocity: zeros(4),
        world_from_base: pose(),
    };
    let actuation = ActuationOutput {
        command,
        motion: MotionState::Following(1.0 / 7.0),
        goal: Some(proact_types::joints(&AWKWARD[..2])),
        hand_moving: true,
        paused: true,
        events: vec![],
    };
    let task = TaskState {
        candidates: set(&[0, 2]),
        context: TaskContext { expected_objects: set(&[2, 3]), selection_number: 1 },
        context_at_grasp: TaskContext { expected_objects: set(&[0, 1]), selection_number: 3 },
        next_object: Some(ObjectId(3)),
        goal: None,
        score: 2,
        finished: false,
    };
    (world, actuation, task)
}

#[test]
fn a_state_comes_back_bit_for_bit_and_one_of_another_arm_or_not_finite_is_refused() {
    let (world, actuation, task) = instant();
    let hand = HandView { state: HandState::Closing, held_object: Some(ObjectId(2)) };
    let message = state(SimTime(7), SimTime(7), &world, hand, &actuation, &task);
    let back = read_state(&message, COUNTS).unwrap();
    assert_eq!((&back.world, &back.actuation, &back.task, back.hand), (&world, &actuation, &task, hand));
    assert_eq!(bits(&back.world.world_from_base), bits(&pose()));
    assert_eq!(bits(&back.world.objects[1].pose), bits(&pose()));
    assert!(
        read_state(&message, ExpectedCounts { moving: 5, ..COUNTS })
            .err()
            .unwrap()
            .contains("4 values, expected 5")
    );
    let mut bad = message.clone();
    bad.twists[0].linear.x = f64::NAN;
    assert!(read_state(&bad, COUNTS).err().unwrap().contains("NaN"));
    bad = message.clone();
    bad.objects.pop();
    assert!(read_state(&bad, COUNTS).err().unwrap().contains("3 objects"));
}

#[test]
fn what_a_person_gives_comes_back_and_ragged_samples_are_refused() {
    let sample = |counter| EmgSample { counter, channels: AWKWARD.into_iter().collect() };
    let heartbeat = Heartbeat { source: InputSource::LimbTracker, kind: HeartbeatKind::Repeated };
    let input = TickInput {
        emg: [sample(1), sample(3)].into_iter().collect(),
        command: Some(Command::HandOpen),
        gaze: Some(GazeSample { origin: Point::origin(), direction: Vector::x() * 3.0, valid: false }),
        shoulder: Some(pose()),
        limb: Some(proact_types::joints(&AWKWARD)),
        heartbeats: [heartbeat].into_iter().collect(),
        ..TickInput::default()
    };
    let mut message = person(SimTime(3), SimTime(3), &input, &pose());
    let (back, head) = read_person(&message).unwrap();
    assert_eq!((back, bits(&head)), (input, bits(&pose())));
    message.shoulder.extend(message.shoulder.clone());
    assert!(read_person(&message).err().unwrap().contains("the shoulder has 2 values"));
    message.shoulder.pop();
    message.samples.pop();
    assert!(read_person(&message).err().unwrap().contains("7 values for 2 EMG samples"));
    message.counters.clear();
    assert!(read_person(&message).is_err(), "values without samples");
}

#[test]
fn decisions_intents_and_commands_come_back() {
    let decided = EmgOutput {
        gesture: "wave out".parse().unwrap(),
        class_index: 3,
        published: true,
        window_class: Command::HandClose.into(),
        posterior: [0.1, 0.2, 0.3, 0.4, 0.0, 0.0].into_iter().collect(),
        confidence: 0.4,
        class: None,
        effort: 1.0 / 3.0,
        drives: [0.1, -1.0].into_iter().collect(),
        stale: false,
    };
    let emg_output = EmgStageOutput {
        command: Command::WristFlexion,
        recognized_gesture: "wave out".parse().unwrap(),
        decision: Some(Box::new(decided)),
        published_command: Some(Command::WristFlexion),
        decided_at: Some(SimTime(9)),
        confidence: 0.4,
        effort: 0.5,
        drives: [-1.0, 1.0 / 3.0].into_iter().collect(),
        fault: Some((StopCause::Flat, "channel 2 stands still".to_owned())),
        armed: false,
        overridden: false,
        events: vec![EventKind::EmgGap { gaps: 1, unusable_samples: 0, rejected_windows: 2 }],
        answers: vec![],
    };
    let mut message = decision(SimTime(9), SimTime(9), &emg_output);
    assert_eq!(read_decision(&message).unwrap(), emg_output);
    message.decided_place = 6;
    assert!(read_decision(&message).unwrap_err().contains("6 values, expected more than 6"));
    message.drives[0] = f64::NAN;
    assert!(read_decision(&message).is_err(), "a drive that is no number");
    message.drives.clear();
    message.recognised.clear();
    assert!(read_decision(&message).unwrap_err().contains("name of a gesture"));

    let intent_output = IntentOutput {
        gaze_freshness: Some(GazeFreshness::Repeated),
        posterior: vec![0.7, 0.1, 0.1, 0.1],
        highlight: Some(ObjectId(1)),
        place_point: Point::new(0.1, 0.2, 0.3),
        gaze: None,
        eye_seen_at: None,
        answer: None,
        fault: Some("the intent model gives nothing: it has ended".to_owned()),
        events: vec![EventKind::GazeUnusable],
    };
    let message = intent(SimTime(9), SimTime(9), &intent_output);
    assert_eq!(read_intent(&message, 4).unwrap(), intent_output);
    let another_scene = read_intent(&message, 3).unwrap_err();
    assert_eq!(another_scene, "posterior has 4 values, expected 3");
    let beyond = Intent { highlight: 4, ..message };
    assert_eq!(read_intent(&beyond, 4).unwrap_err(), "highlight is 4, expected less than 4");
    let none = IntentOutput { posterior: vec![], highlight: None, ..intent_output };
    assert_eq!(
        read_intent(&intent(SimTime(9), SimTime(9), &none), 4).unwrap(),
        none,
        "before the first gaze"
    );

    let point = |time_secs| TrajectoryPoint { time_secs, q: proact_types::joints(&AWKWARD), qd: zeros(4) };
    let path = Trajectory { points: vec![point(0.0), point(0.1 + 0.2)] };
    for motion in [
        MotionCommand::Hold,
        MotionCommand::Follow(path),
        MotionCommand::Velocity(zeros(4)),
        MotionCommand::Goto(proact_types::joints(&AWKWARD)),
    ] {
        let hand = Some(HandCommand::Close);
        let output = MethodOutput { motion: Some(motion.clone()), hand, ..MethodOutput::default() };
        let message = command(SimTime(9), SimTime(9), &output, 12, None, &[]);
        let method_command = read_command(&message, COUNTS).unwrap();
        assert_eq!(
            (method_command.motion, method_command.command_number, method_command.hand),
            (Some(motion.clone()), 12, hand)
        );
        let another_arm = read_command(&message, ExpectedCounts { arm: 3, ..COUNTS }).is_err();
        assert_eq!(another_arm, motion != MotionCommand::Hold);
    }
}
