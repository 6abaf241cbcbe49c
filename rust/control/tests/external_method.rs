//! A method as an outside process, with the process played by a script in memory.
mod common;

use common::{Rig, model};
use proact_control::{
    ExternalMethod, FingerCommand, HandCommand, MethodEntry, MethodFault, MethodProgram, MethodRequest,
    MethodResponse, MotionCommand, Profile, ports::MethodProcess,
};
use proact_types::{
    Command, InputSource, MethodAnswer, MethodInfo, PlannerView, SimTime, Stop, StopCause, joints,
};
use std::sync::{Arc, Mutex};

/// Says the same at every step, and keeps the last line that it was asked.
#[derive(Clone, Default)]
struct Script {
    answer: Option<MethodAnswer>,
    asked: Arc<Mutex<String>>,
}

impl MethodProcess for Script {
    fn ask(&mut self, now: SimTime, line: &str) -> MethodAnswer {
        *self.asked.lock().expect("one thread") = line.to_owned();
        match self.answer.clone().expect("the script has an answer") {
            MethodAnswer::Line(line) => MethodAnswer::Line(line.replace("NOW", &now.0.to_string())),
            other => other,
        }
    }
}

fn rig(answer: Result<&str, &str>) -> (Rig, Script) {
    let answer = answer.map(str::to_owned).map_err(str::to_owned);
    let script = Script { answer: Some(answer.into()), ..Script::default() };
    (Rig::with(Box::new(ExternalMethod::new(script.clone()))), script)
}

#[test]
fn an_answer_is_carried_out_and_the_process_sees_the_step() {
    let answer = MethodResponse {
        time: SimTime(10),
        motion: Some(MotionCommand::Velocity(joints(&[0.1; 7]))),
        hand: Some(HandCommand::Close),
        fingers: Some(FingerCommand::Hold),
        plan: None,
        events: Vec::new(),
        mode: None,
        target: None,
        planner: Some(PlannerView::Planning),
    };
    let (mut rig, script) = rig(Ok(&serde_json::to_string(&answer).expect("it has numbers and names only")));
    rig.gesture = Command::WristExtension;
    let outputs = rig.run(10);
    assert_eq!((&outputs[0].motion, outputs[0].hand), (&answer.motion, answer.hand));
    assert_eq!(outputs[0].fingers, answer.fingers);
    assert_eq!(rig.shown.planner, PlannerView::Planning);
    let line: MethodRequest =
        serde_json::from_str(&script.asked.lock().expect("one thread")).expect("an object");
    assert_eq!((line.time, line.command), (SimTime(10), Command::WristExtension));
    assert_eq!(line.measured.as_slice(), common::START_RAD);
    assert_eq!(line.jacobian.expect("finite angles").len(), 6);
}

#[test]
fn without_an_answer_that_is_a_command_the_arm_holds_and_the_reason_is_shown() {
    for (answer, expected) in [
        (Err("the process has ended"), "the process has ended"),
        (Ok("rubbish"), "rubbish"),
        (Ok("{\"time\":NOW,\"speed\":1}"), "unknown field `speed`"),
        (Ok("{\"time\":NOW,\"motion\":{\"velocity\":[0.1]}}"), "got 1 values, the arm has 7 joints"),
        (Ok("{\"time\":NOW,\"motion\":{\"velocity\":[null,0,0,0,0,0,0]}}"), "null"),
        (
            Ok("{\"time\":NOW,\"target\":{\"locked\":false,\"posterior\":[0.5,0.5]}}"),
            "posterior: got 2 values, expected none or 4",
        ),
        (
            Ok("{\"time\":NOW,\"plan\":{\"request\":{\"goal\":\"pick\",\"object\":4,\"centre\":[0,0,1]}}}"),
            "plan: got object 4, there are 4, counted from 0",
        ),
        (
            Ok("{\"time\":NOW,\"target\":{\"object\":7,\"locked\":false,\"posterior\":[]}}"),
            "target: got object 7, there are 4, counted from 0",
        ),
        (
            Ok("{\"time\":NOW,\"events\":[{\"event\":\"trial_finished\"}]}"),
            "unknown variant `trial_finished`",
        ),
        (
            Ok("{\"time\":NOW,\"events\":[{\"event\":\"note\",\"text\":\"\\u0007\"}]}"),
            "without control characters",
        ),
        (
            Ok(
                "{\"time\":NOW,\"mode\":{\"moves\":{\"joint\":8},\"name\":\"tail\",\"directions\":[\"up\",\"down\"]}}",
            ),
            "mode: got joint 8, expected 0 to 7",
        ),
        (
            Ok(
                "{\"time\":NOW,\"mode\":{\"moves\":{\"rotation\":3},\"name\":\"w\",\"directions\":[\"up\",\"down\"]}}",
            ),
            "mode: got axis 3",
        ),
        (
            Ok("{\"time\":NOW,\"planner\":{\"state\":\"executing\",\"progress\":7,\"intermediate\":false}}"),
            "planner.progress is 7, expected 0 to 1",
        ),
        (Ok("{\"time\":99}"), "answered the step of 99 ms, expected 10 ms"),
        (Ok("\u{fffd}"), "expected value"),
    ] {
        let (mut rig, _) = rig(answer);
        let output = rig.run(10).remove(0);
        assert_eq!(output.motion, Some(MotionCommand::Hold), "{answer:?}");
        assert!(matches!(output.fault, Some(MethodFault::Failed(_))), "{answer:?}: {:?}", output.fault);
        assert!(rig.refusal().contains(expected), "{answer:?} gave {}", rig.refusal());
    }
}

#[test]
fn the_safeguards_of_the_profile_are_around_an_outside_method_too() {
    let fast = "{\"time\":NOW,\"motion\":{\"velocity\":[9,9,9,9,9,9,9]}}".to_owned();
    let script = Script { answer: Some(MethodAnswer::Line(fast)), ..Script::default() };
    let profile = Profile::named("default").expect("ships");
    let outside = MethodEntry::external(MethodInfo::default(), MethodProgram::new(vec!["script".to_owned()]));
    let mut rig = Rig::with(outside.build(&profile, &model(), script).expect("the profile fits"));
    let Some(MotionCommand::Velocity(speeds)) = rig.run(10)[0].motion.clone() else { panic!("it moves") };
    assert!(speeds.iter().all(|speed| *speed < 0.1), "ramped up: {speeds:?}");
    let (source, cause, since) = (InputSource::Armband, StopCause::Silent, SimTime(0));
    rig.stop = Some(Stop { source, cause, since, reason: "the armband is silent".to_owned() });
    assert_eq!(rig.run(10)[0].motion, Some(MotionCommand::Hold));
    assert!(rig.refusal().contains("armband"), "{}", rig.refusal());
}
