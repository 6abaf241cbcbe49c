use super::*;
use crate::{
    messages::proact_msgs::{Command as CommandMessage, Frame},
    node::wire::{
        command, read_command,
        tests::{AWKWARD, bits, pose},
    },
};
use proact_testbed::stages::MethodOutput;
use proact_types::{Command, ContactView, Event, EventKind, ObjectId, Pose, Vector};
use rosrust::RosMsg;

const COUNTS: ExpectedCounts = ExpectedCounts { arm: 4, moving: 5, objects: 4 };

/// None of what may be missing.
fn bare() -> MethodStatus {
    MethodStatus {
        method: "A".to_owned(),
        gesture: Command::NoMotion,
        recognized: Command::NoMotion.into(),
        confidence: 1.0,
        effort: 0.0,
        hand: HandView::default(),
        gaze: None,
        stop: None,
        target: TargetView::default(),
        planner: PlannerView::Idle,
        mode: None,
        goal: None,
    }
}

/// All of what may be missing.
fn full() -> MethodStatus {
    MethodStatus {
        method: "outside".to_owned(),
        gesture: Command::WristFlexion,
        recognized: Command::WristFlexion.into(),
        confidence: AWKWARD[0],
        effort: AWKWARD[1],
        hand: HandView { state: HandState::Opening, held_object: Some(ObjectId(3)) },
        gaze: Some(GazeSample {
            origin: Point::new(AWKWARD[0], AWKWARD[1], AWKWARD[2]),
            direction: Vector::new(AWKWARD[3], -3.0, f64::MAX),
            valid: true,
        }),
        stop: Some(Stop {
            source: InputSource::Stage,
            cause: StopCause::TrackingLost,
            since: SimTime(u64::MAX),
            reason: "the eye is lost \"again\"\n".to_owned(),
        }),
        target: TargetView {
            object: Some(ObjectId(0)),
            place: Some(Point::new(AWKWARD[1], AWKWARD[2], AWKWARD[3])),
            locked: true,
            posterior: AWKWARD.to_vec(),
        },
        planner: PlannerView::Executing { progress: AWKWARD[3], intermediate: true },
        mode: Some(mode_view(Some(AWKWARD[2]))),
        goal: Some(proact_types::joints(&AWKWARD)),
    }
}

fn mode_view(next_in_secs: Option<f64>) -> ModeView {
    let directions = ["flexion".to_owned(), "extension".to_owned()];
    ModeView {
        controlled_dof: proact_types::ControlledDof::Rotation(2),
        name: "elbow flexion".to_owned(),
        directions,
        we_sign: -1,
        next_in_secs,
    }
}

fn drawn(method_status: MethodStatus) -> DisplayFrame {
    let kind = EventKind::BaseHeld { distance: AWKWARD[0] };
    DisplayFrame {
        time: SimTime(17),
        method: method_status.method,
        joints: [AWKWARD[3], AWKWARD[0], AWKWARD[1], AWKWARD[2], 0.1].into_iter().collect(),
        world_from_base: pose(),
        world_from_tip: pose() * Pose::translation(0.1, 0.2, 0.3),
        world_from_head: pose(),
        objects: vec![pose(); 4],
        hand: method_status.hand,
        recognized_gesture: method_status.recognized,
        gaze: method_status.gaze,
        target: method_status.target,
        planner: method_status.planner,
        plan_goal: method_status.goal,
        mode: method_status.mode,
        stop: method_status.stop,
        command: method_status.gesture,
        confidence: method_status.confidence,
        effort: method_status.effort,
        emg_source: "synthetic".to_owned(),
        time_left_secs: AWKWARD[0],
        next_object: Some(ObjectId(2)),
        task_goal: None,
        score: 3,
        finished: true,
        events: vec![Event { time: SimTime(9), kind }, Event { time: SimTime(16), kind: EventKind::Rearmed }],
        contacts: vec![ContactView { link: "thumb".to_owned(), force: 1.25 }],
        feedback: vec![],
    }
}

/// The message as it arrives over a connection, and its bytes.
fn sent<M: RosMsg>(message: &M) -> (M, Vec<u8>) {
    let bytes = message.encode_vec().unwrap();
    (M::decode_slice(&bytes).unwrap(), bytes)
}

/// Equality alone would take -0.0 for 0.0: the bytes of what comes back are compared, too.
fn assert_view_comes_back(method_status: &MethodStatus) {
    let message = command(SimTime(9), SimTime(9), &MethodOutput::default(), 0, Some(method_status), &[]);
    let (came, bytes) = sent(&message);
    let back = read_command(&came, COUNTS).unwrap().method_status.unwrap();
    assert_eq!(&back, method_status);
    let again: CommandMessage =
        command(SimTime(9), SimTime(9), &MethodOutput::default(), 0, Some(&back), &[]);
    assert_eq!(sent(&again).1, bytes, "{method_status:?}");
}

#[test]
fn what_there_is_to_see_of_a_method_comes_back_bit_for_bit_with_and_without_its_options() {
    for shown in [bare(), full()] {
        assert_view_comes_back(&shown);
    }
    assert_view_comes_back(&MethodStatus { mode: Some(mode_view(None)), ..bare() });
    let none = command(SimTime(9), SimTime(9), &MethodOutput::default(), 0, None, &[]);
    assert_eq!(read_command(&none, COUNTS).unwrap().method_status, None);
}

#[test]
fn every_state_of_hand_and_planner_and_every_stop_come_back() {
    for state in HandState::ALL {
        assert_view_comes_back(&MethodStatus { hand: HandView { state, held_object: None }, ..bare() });
    }
    let failed = |status| PlannerView::Failed { status, reason: "no way was found".to_owned() };
    let cases = [false, true].into_iter().flat_map(|intermediate| {
        [PlannerView::Executing { progress: 0.3, intermediate }, PlannerView::Arrived { intermediate }]
    });
    let planners = [PlannerView::Idle, PlannerView::Planning].into_iter().chain(cases);
    for planner in planners.chain(PlanStatus::ALL.map(failed)) {
        assert_view_comes_back(&MethodStatus { planner, ..bare() });
    }
    for source in InputSource::ALL {
        for cause in StopCause::ALL {
            let stop = Stop { source, cause, since: SimTime(3), reason: "it died".to_owned() };
            assert_view_comes_back(&MethodStatus { stop: Some(stop), ..bare() });
        }
    }
}

#[test]
fn a_frame_comes_back_bit_for_bit_and_its_quaternions_are_not_made_unit() {
    let plain = DisplayFrame { next_object: None, finished: false, events: vec![], ..drawn(bare()) };
    for shown in [plain, drawn(full())] {
        let (came, bytes) = sent(&frame(&shown));
        let back = read_frame(&came, COUNTS).unwrap();
        assert_eq!(back, shown);
        assert_eq!(sent(&frame(&back)).1, bytes);
        for (back, shown) in [
            (&back.world_from_base, &shown.world_from_base),
            (&back.world_from_tip, &shown.world_from_tip),
            (&back.world_from_head, &shown.world_from_head),
            (&back.objects[3], &shown.objects[3]),
        ] {
            assert_eq!(bits(back), bits(shown));
            assert!((back.rotation.coords.norm() - 1.0).abs() > 1e-13, "the test asks for one that is off");
        }
    }
}

/// The sentence with which a spoilt frame is refused.
fn refusal(spoil: impl FnOnce(&mut Frame)) -> String {
    let mut message = frame(&drawn(full()));
    spoil(&mut message);
    read_frame(&message, COUNTS).unwrap_err()
}

#[test]
fn a_frame_of_another_arm_or_with_a_list_of_another_length_is_refused() {
    let message = frame(&drawn(full()));
    assert_eq!(
        read_frame(&message, ExpectedCounts { moving: 27, ..COUNTS }).unwrap_err(),
        "joints has 5 values, expected 27"
    );
    assert_eq!(
        read_frame(&message, ExpectedCounts { arm: 7, ..COUNTS }).unwrap_err(),
        "goal has 4 values, expected none or 7"
    );
    assert_eq!(refusal(|m| m.objects.truncate(3)), "3 objects, expected 4");
    let posterior = refusal(|m| m.view.target.posterior.truncate(1));
    assert_eq!(posterior, "the target's posterior has 1 values, expected none or 4");
    let twice = refusal(|m| m.view.stop.extend(m.view.stop.clone()));
    assert_eq!(twice, "stop has 2 values, expected none or one");
    for sentence in [
        refusal(|m| m.view.gaze.extend(m.view.gaze.clone())),
        refusal(|m| m.view.mode.extend(m.view.mode.clone())),
        refusal(|m| m.view.mode[0].next_in_secs.push(1.0)),
        refusal(|m| m.view.target.place.extend(m.view.target.place.clone())),
    ] {
        assert!(sentence.ends_with("has 2 values, expected none or one"), "{sentence}");
    }
    let mut twice =
        CommandMessage { view: vec![message.view.clone(), message.view], ..CommandMessage::default() };
    let refused = read_command(&twice, COUNTS).err().unwrap();
    assert_eq!(refused, "view has 2 values, expected none or one");
    twice.view.pop();
    assert!(read_command(&twice, COUNTS).is_ok());
}

/// How a place behind the last one is refused.
fn less_than(what: &str, count: usize) -> String {
    format!("{what} is {count}, expected less than {count}")
}

#[test]
fn a_frame_with_a_place_out_of_range_is_refused() {
    let [gestures, hands, sources] = [Command::ALL.len(), HandState::ALL.len(), InputSource::ALL.len()];
    let [causes, statuses] = [StopCause::ALL.len(), PlanStatus::ALL.len()];
    for (sentence, expected) in [
        (refusal(|m| m.view.gesture = gestures as u8), less_than("gesture", gestures)),
        (refusal(|m| m.view.hand = hands as u8), less_than("hand", hands)),
        (refusal(|m| m.view.holds = 4), less_than("the object in the hand", 4)),
        (refusal(|m| m.view.target.object = 4), less_than("the target's object", 4)),
        (refusal(|m| m.next = 4), less_than("next", 4)),
        (refusal(|m| m.view.stop[0].source = sources as u8), less_than("the stop's source", sources)),
        (refusal(|m| m.view.stop[0].cause = causes as u8), less_than("the stop's cause", causes)),
        (refusal(|m| m.view.planner.state = 5), "the planner's state is 5, expected 0 to 4".to_owned()),
        (
            refusal(|m| (m.view.planner.state, m.view.planner.status) = (Planner::FAILED, statuses as u8)),
            less_than("the planner's status", statuses),
        ),
    ] {
        assert_eq!(sentence, expected);
    }
    assert!(refusal(|m| m.events.push("{}".to_owned())).starts_with("an event: "));
}

#[test]
fn a_frame_with_a_number_that_is_not_finite_is_refused_and_a_gaze_may_hold_anything() {
    for (sentence, what) in [
        (refusal(|m| m.view.confidence = f64::NAN), "the confidence"),
        (refusal(|m| m.view.effort = f64::NAN), "the effort"),
        (refusal(|m| m.view.goal[0] = f64::NAN), "goal"),
        (refusal(|m| m.view.target.place[0].z = f64::NAN), "the target's place"),
        (refusal(|m| m.view.target.posterior[2] = f64::NAN), "the target's posterior"),
        (refusal(|m| m.view.planner.progress = f64::NAN), "the planner's progress"),
        (refusal(|m| m.view.mode[0].next_in_secs[0] = f64::NAN), "the mode's next_in_secs"),
        (refusal(|m| m.joints[4] = f64::NAN), "joints"),
        (refusal(|m| m.time_left_secs = f64::NAN), "time_left_secs"),
        (refusal(|m| m.base.position.x = f64::NAN), "a pose"),
        (refusal(|m| m.tip.orientation.w = f64::NAN), "a pose"),
        (refusal(|m| m.head.position.y = f64::NAN), "a pose"),
        (refusal(|m| m.objects[1].position.z = f64::NAN), "a pose"),
    ] {
        assert_eq!(sentence, format!("{what} holds NaN, expected finite numbers"));
    }
    let mut blind = drawn(full());
    blind.gaze =
        Some(GazeSample { origin: Point::origin(), direction: Vector::z() * f64::NAN, valid: false });
    let back = read_frame(&frame(&blind), COUNTS).unwrap();
    assert!(back.gaze.unwrap().direction.z.is_nan());
}
