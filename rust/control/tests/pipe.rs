//! A method as an outside process, with the process played by a script in memory.
mod common;

use common::Rig;
use proact_control::{ControlMethod, InputLine, MotionCommand, OutputLine, PipeMethod};
use proact_types::{Gesture, PlannerView, SimTime, joints};
use std::collections::VecDeque;
use std::io::{self, BufRead, Read, Write};
use std::sync::{Arc, Mutex};

/// What the process says, piece by piece; an empty piece is "nothing yet", the end of the pieces is its end.
struct Script(VecDeque<Vec<u8>>);

impl Script {
    fn new(pieces: &[&str]) -> Self {
        Self(pieces.iter().map(|piece| piece.as_bytes().to_vec()).collect())
    }
}

impl Read for Script {
    fn read(&mut self, _buffer: &mut [u8]) -> io::Result<usize> {
        unreachable!("lines are read through BufRead")
    }
}

impl BufRead for Script {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.0.front().is_some_and(Vec::is_empty) {
            self.0.pop_front();
            return Err(io::ErrorKind::WouldBlock.into());
        }
        Ok(self.0.front().map_or(&[], |piece| piece))
    }

    fn consume(&mut self, amount: usize) {
        if let Some(front) = self.0.front_mut() {
            front.drain(..amount);
            if front.is_empty() && amount > 0 {
                self.0.pop_front();
            }
        }
    }
}

/// Keeps what the method wrote.
#[derive(Clone, Default)]
struct Written(Arc<Mutex<Vec<u8>>>);

impl Write for Written {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().expect("one thread").extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn rig(pieces: &[&str]) -> (Rig, Written) {
    let written = Written::default();
    let method = PipeMethod::new("outside", Script::new(pieces), written.clone());
    (Rig::with(Box::new(method)), written)
}

fn reason(method: &dyn ControlMethod) -> String {
    match method.planner() {
        PlannerView::Failed { reason, .. } => reason,
        other => panic!("a refusal was expected, not {other:?}"),
    }
}

#[test]
fn an_answer_in_time_is_carried_out_and_the_process_sees_the_step() {
    let answer = OutputLine {
        time: SimTime(10),
        motion: Some(MotionCommand::Velocity(joints(&[0.1; 7]))),
        hand: None,
        plan: None,
        events: Vec::new(),
        mode: None,
        target: None,
        planner: Some(PlannerView::Planning),
    };
    let text = serde_json::to_string(&answer).expect("it has numbers and names only") + "\n";
    let (mut rig, written) = rig(&[&text]);
    rig.gesture = Gesture::WristExtension;
    let outputs = rig.run(10);
    assert_eq!(outputs[0].motion, answer.motion);
    assert_eq!(rig.method.planner(), PlannerView::Planning);
    let written = written.0.lock().expect("one thread");
    let line: InputLine = serde_json::from_slice(&written).expect("one line of JSON");
    assert_eq!((line.time, line.gesture), (SimTime(10), Gesture::WristExtension));
    assert_eq!(line.measured.as_slice(), common::START);
    assert_eq!(line.jacobian.expect("finite angles").len(), 6);
    assert!(written.ends_with(b"\n"));
}

#[test]
fn an_answer_that_is_late_holds_the_arm_and_is_dropped_when_it_comes() {
    let late = "1,1,1,1]}}\n{\"time\":30,\"motion\":\"hold\",\"hand\":\"close\"}\n";
    let (mut rig, _) = rig(&["", r#"{"time":10,"motion":{"velocity":[1,1,1,"#, "", late]);
    assert_eq!(rig.run(10)[0].motion, Some(MotionCommand::Hold), "nothing has come");
    assert!(reason(&*rig.method).contains("not answered in time"));
    assert_eq!(rig.run(10)[0].motion, Some(MotionCommand::Hold), "half a line has come");
    let output = &rig.run(10)[0];
    assert_eq!(output.hand, Some(proact_control::HandCommand::Close), "the answer to this step");
    assert_eq!(output.motion, Some(MotionCommand::Hold));
    assert_eq!(rig.method.planner(), PlannerView::Idle);
    assert_eq!(rig.run(10)[0].motion, Some(MotionCommand::Hold));
    assert!(reason(&*rig.method).contains("has ended"));
}

#[test]
fn answers_that_are_no_commands_hold_the_arm_and_say_what_was_wrong() {
    for (answer, expected) in [
        ("rubbish\n", "rubbish"),
        ("{\"time\":10,\"speed\":1}\n", "unknown field `speed`"),
        ("{\"time\":10,\"motion\":{\"velocity\":[0.1]}}\n", "got 1 values, the arm has 7 joints"),
        ("{\"time\":10,\"motion\":{\"velocity\":[null,0,0,0,0,0,0]}}\n", "null"),
        ("{\"time\":99}\n", "99"),
        ("\u{fffd}\n", "expected value"),
    ] {
        let (mut rig, _) = rig(&[answer]);
        assert_eq!(rig.run(10)[0].motion, Some(MotionCommand::Hold), "{answer}");
        let reason = reason(&*rig.method);
        assert!(reason.contains(expected), "{answer} gave {reason}");
    }
}
