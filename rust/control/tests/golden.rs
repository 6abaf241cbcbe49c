//! Golden traces: scripted gestures, gaze and plans in, every command out, one file for each method and profile.
//!
//! A trace changes only when behaviour is meant to change: `UPDATE_EXPECTED=1 cargo test -p proact-control --test
//! golden` writes the files anew, and the difference belongs into the change's description.
#![allow(clippy::disallowed_methods)] // The traces are files, and blessing them is asked for by the environment.
mod common;

use common::{BLOCKS, Rig, reply};
use proact_control::{ControlOutput, MotionCommand, PlanCommand};
use proact_types::{Command, HandState, HandView, ObjectId, PlanStatus, Pose};
use serde_json::{Value, json};
use std::path::Path;

/// Numbers agree to this, relative to those above one: sine, cosine and the decompositions differ in their last
/// digits from one platform to another.
const TOLERANCE: f64 = 1e-12;

/// Runs `ms` of a gesture and notes what changed.
fn play(rig: &mut Rig, command: Command, ms: u64, trace: &mut Vec<Value>) {
    rig.gesture = command;
    trace.push(json!({ "t": rig.now, "gesture": command.ros_name() }));
    let mut shown = Value::Null;
    for _ in 0..ms {
        for output in rig.run(1) {
            note(rig, &output, &mut shown, trace);
        }
    }
}

/// A line for each step with a command, and for each change of what is shown.
fn note(rig: &Rig, output: &ControlOutput, shown: &mut Value, trace: &mut Vec<Value>) {
    if (ControlOutput { display: Default::default(), ..output.clone() }) != ControlOutput::default() {
        let mut line = json!({ "t": rig.now });
        let mut put = |key: &str, value: Value| {
            if !value.is_null() && value != json!([]) {
                line[key] = value;
            }
        };
        let motion = match &output.motion {
            // The path is the script's own; its end tells which it was.
            Some(MotionCommand::Follow(path)) => {
                json!({ "follow": { "secs": path.duration_secs(), "points": path.points.len() } })
            }
            other => serde_json::to_value(other).expect("plain data"),
        };
        put("motion", motion);
        put("hand", serde_json::to_value(output.hand).expect("plain data"));
        put("plan", serde_json::to_value(&output.plan).expect("plain data"));
        put("events", serde_json::to_value(&output.events).expect("plain data"));
        trace.push(line);
    }
    let mode = rig.shown.mode.clone().map(|mode| (common::number(mode.controlled_dof), mode.name));
    let target = rig.shown.target.clone();
    let planner = match rig.shown.planner.clone() {
        proact_types::PlannerView::Executing { intermediate, .. } => json!({ "executing": intermediate }),
        other => serde_json::to_value(other).expect("plain data"),
    };
    let now = json!({ "mode": mode, "object": target.object, "place": target.place, "locked": target.locked,
        "planner": planner });
    if now != *shown {
        trace.push(json!({ "t": rig.now, "shown": now }));
        *shown = now;
    }
}

/// Modes, motion both ways, the hand, spurious gestures, a limit, a slow and a missing classifier.
fn jog(rig: &mut Rig, trace: &mut Vec<Value>) {
    use Command::{HandClose, HandOpen, NoMotion, WristExtension, WristFlexion};
    rig.lag = [0.004, -0.002, 0.001, 0.003, 0.0, 0.002, -0.001];
    play(rig, NoMotion, 200, trace);
    for _ in 0..7 {
        play(rig, WristExtension, 150, trace);
        play(rig, WristFlexion, 150, trace);
        play(rig, NoMotion, 50, trace);
        play(rig, HandOpen, 100, trace);
    }
    play(rig, HandClose, 150, trace);
    play(rig, HandOpen, 200, trace);
    play(rig, NoMotion, 100, trace);
    play(rig, HandClose, 100, trace);
    play(rig, WristExtension, 2500, trace);
    rig.message_ms = Some(200);
    play(rig, WristFlexion, 600, trace);
    play(rig, HandOpen, 1200, trace);
    rig.message_ms = None;
    play(rig, WristExtension, 300, trace);
    play(rig, NoMotion, 50, trace);
}

/// Selection, locks, plans of all kinds, a transfer, a moved base, and stops by every gesture.
fn gaze(rig: &mut Rig, trace: &mut Vec<Value>) {
    use Command::{HandClose, HandOpen, NoMotion, WristExtension, WristFlexion};
    play(rig, NoMotion, 50, trace);
    play(rig, WristFlexion, 50, trace);
    rig.highlight = Some(ObjectId(3));
    play(rig, NoMotion, 50, trace);
    // A pick by way of an intermediate goal.
    play(rig, WristExtension, 40, trace);
    rig.plan = Some(reply(PlanStatus::Intermediate, 0.3));
    play(rig, WristExtension, 1200, trace);
    rig.plan = Some(reply(PlanStatus::Ok, 0.4));
    play(rig, WristExtension, 1200, trace);
    play(rig, HandClose, 100, trace);
    rig.hand = HandView { state: HandState::Closed, held_object: Some(ObjectId(0)) };
    // Placing: the lock, a plan that is stopped, one whose base moves, one that fails.
    play(rig, NoMotion, 50, trace);
    play(rig, WristFlexion, 50, trace);
    rig.place.x -= 0.1;
    play(rig, NoMotion, 50, trace);
    play(rig, WristFlexion, 50, trace);
    for stop in [NoMotion, HandClose, WristFlexion] {
        play(rig, WristExtension, 40, trace);
        rig.plan = Some(reply(PlanStatus::Ok, 0.4));
        play(rig, WristExtension, 200, trace);
        play(rig, stop, 50, trace);
    }
    play(rig, NoMotion, 50, trace);
    play(rig, WristExtension, 40, trace);
    rig.plan = Some(reply(PlanStatus::Ok, 0.4));
    play(rig, WristExtension, 100, trace);
    rig.base = Pose::translation(0.02, 0.0, 0.0) * rig.base;
    play(rig, WristExtension, 100, trace);
    rig.plan = Some(reply(PlanStatus::Unreachable, 0.0));
    play(rig, WristExtension, 100, trace);
    // A plan that comes after its request was given up.
    play(rig, NoMotion, 50, trace);
    play(rig, WristExtension, 30, trace);
    play(rig, NoMotion, 30, trace);
    rig.plan = Some(reply(PlanStatus::Ok, 0.4));
    play(rig, NoMotion, 50, trace);
    // Release, and a block that is out of every reach.
    play(rig, HandOpen, 50, trace);
    rig.hand.held_object = None;
    play(rig, HandOpen, 100, trace);
    rig.base = Pose::translation(-3.0, 0.0, 0.0) * rig.base;
    play(rig, NoMotion, 50, trace);
    play(rig, WristExtension, 50, trace);
    rig.highlight = None;
    play(rig, NoMotion, 50, trace);
    play(rig, WristFlexion, 50, trace);
    play(rig, WristExtension, 50, trace);
}

fn trace(method: &str, profile: &str) -> Vec<Value> {
    let mut rig = Rig::new(method, profile);
    let mut trace = Vec::new();
    if matches!(method, "A" | "B") {
        jog(&mut rig, &mut trace)
    } else {
        gaze(&mut rig, &mut trace)
    }
    trace
}

/// Where and how two values differ.
fn difference(path: &str, got: &Value, expected: &Value) -> Option<String> {
    match (got, expected) {
        (Value::Number(a), Value::Number(b)) => {
            let (a, b) = (a.as_f64()?, b.as_f64()?);
            let near = (a - b).abs() <= TOLERANCE * b.abs().max(1.0);
            (!near).then(|| format!("{path}: got {a}, expected {b}"))
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            a.iter().zip(b).enumerate().find_map(|(k, (a, b))| difference(&format!("{path}[{k}]"), a, b))
        }
        (Value::Object(a), Value::Object(b)) if a.keys().eq(b.keys()) => {
            a.iter().find_map(|(key, a)| difference(&format!("{path}.{key}"), a, &b[key]))
        }
        _ => (got != expected).then(|| format!("{path}: got {got}, expected {expected}")),
    }
}

fn golden(method: &str, profile: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/golden/{method}_{profile}.jsonl"));
    let got = trace(method, profile);
    if std::env::var_os("UPDATE_EXPECTED").is_some() {
        let text: String = got.iter().map(|line| format!("{line}\n")).collect();
        std::fs::write(&path, text).expect("the folder of golden traces can be written");
        return;
    }
    let text = std::fs::read_to_string(&path).expect("a golden trace; UPDATE_EXPECTED=1 writes it");
    let expected: Vec<Value> =
        text.lines().map(|line| serde_json::from_str(line).expect("a line of JSON")).collect();
    for (k, (got, expected)) in got.iter().zip(&expected).enumerate() {
        if let Some(difference) = difference("", got, expected) {
            panic!("{}, line {}: {difference}", path.display(), k + 1);
        }
    }
    assert_eq!(got.len(), expected.len(), "lines of {}", path.display());
}

#[test]
fn method_a_commands_what_it_did_in_both_profiles() {
    golden("A", "default");
    golden("A", "original");
}

#[test]
fn method_b_commands_what_it_did_in_both_profiles() {
    golden("B", "default");
    golden("B", "original");
}

#[test]
fn method_c_commands_what_it_did_in_both_profiles() {
    golden("C", "default");
    golden("C", "original");
}

#[test]
fn method_d_commands_what_it_did_in_both_profiles() {
    golden("D", "default");
    golden("D", "original");
}

/// A comparison that finds no difference anywhere proves nothing.
#[test]
fn the_comparison_finds_a_changed_number_a_changed_name_and_a_missing_line() {
    let line = json!({ "motion": { "velocity": [0.1, 0.2] }, "hand": "open" });
    let mut other = line.clone();
    other["motion"]["velocity"][1] = json!(0.2 + 1e-9);
    assert!(difference("", &line, &other).is_some_and(|text| text.starts_with(".motion.velocity[1]")));
    other = json!({ "motion": { "velocity": [0.1, 0.2] }, "hand": "close" });
    assert!(difference("", &line, &other).is_some());
    assert_eq!(difference("", &line, &line.clone()), None);
    assert_ne!(trace("A", "default"), trace("A", "original"));
    assert_ne!(trace("D", "default"), trace("D", "original"));
}

/// The original's pick pose by hand: shoulder, block and two-link formula in plain arithmetic.
#[test]
fn the_original_picks_where_its_formulas_say() {
    let mut rig = Rig::new("C", "original");
    let outputs = rig.make(Command::WristExtension, 10);
    let Some(PlanCommand::Request(proact_types::PlanGoal::TipPose { pose })) = &outputs[0].plan else {
        panic!("a pose of the wrist was expected: {:?}", rig.shown.planner.clone())
    };
    // Origin of the second joint: the base's, then 0.12058 m along the first axis, which is -y of the base, and
    // 1.64 mm turned with the shoulder.
    let shoulder = [-0.39 + 0.00164 * 1.029_f64.cos(), 0.12 - 0.12058, 1.5 + 0.00164 * 1.029_f64.sin()];
    let block = BLOCKS[0];
    let (x0, y0, z0) = (-(block.y - shoulder[1]), block.x - shoulder[0], -(block.z - shoulder[2]));
    let l = (x0 * x0 + y0 * y0).sqrt();
    let beta = (0.202_f64 / 0.5).asin();
    let gamma = ((z0 - 0.5 * beta.sin()) / 0.45).asin();
    let (m1, m2) = (0.5 * beta.cos(), 0.45 * gamma.cos());
    let phi = ((l * l + m2 * m2 - m1 * m1) / (2.0 * l * m2)).acos();
    let half = std::f64::consts::FRAC_PI_2;
    let yaw = phi + y0.atan2(x0) - half;
    let expected =
        [block.x - 0.03 * (yaw - half).cos(), block.y - 0.03 * (yaw - half).sin(), block.z + 0.130];
    for (got, expected) in pose.translation.vector.iter().zip(expected) {
        // The first joint's origin is 10 um off its axis, which the arithmetic above leaves out.
        assert!((got - expected).abs() < 1e-4, "{:?}, expected {expected:?}", pose.translation.vector);
    }
    let (roll, pitch, heading) = pose.rotation.euler_angles();
    // ZYX Euler angles of the constant quaternion are 114.7, -1.0 and 25.6 degrees; the first is replaced.
    assert!((roll.to_degrees() - 25.6).abs() < 0.1 && (pitch.to_degrees() + 1.0).abs() < 0.1);
    assert!((heading - yaw).abs() < 1e-3, "{heading} rad, expected {yaw}");
}
