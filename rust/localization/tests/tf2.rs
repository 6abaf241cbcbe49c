//! Random trees and times beside Debian's tf2: the same answers, and refusals at the same questions.
#![allow(clippy::disallowed_methods, clippy::unwrap_used)] // The test compiles and runs a program.

use nalgebra::{Quaternion, UnitQuaternion};
use proact_localization::{FrameTree, TransformTime};
use proact_types::{Pose, Vector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::{
    fmt::Write as _,
    io::Write as _,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

const TREES: u64 = 40;
const QUESTIONS: usize = 100;
/// Both go by doubles; tf2's share of the way between two stamps is of seconds, ours of nanoseconds.
const TOLERANCE: f64 = 1e-6;
/// tf2 takes a stamp of zero for "the newest".
const FIRST_NANOS: i64 = 1_000_000_000;
const PERIOD_NANOS: i64 = 37_000_001;
const MOMENTS: i64 = 20;

#[test]
fn random_trees_are_answered_as_tf2_answers_them() {
    let header = Path::new("/usr/include/tf2/buffer_core.h");
    if !header.exists() {
        eprintln!(
            "skipped: there is no tf2 on this machine; apt-get install libtf2-dev libgeometry-msgs-dev"
        );
        return;
    }
    let program = build();
    let (mut answered, mut refused) = (0, 0);
    for seed in 0..TREES {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (mut frames, mut text) = (FrameTree::default(), String::new());
        let count = rng.random_range(3..12_usize);
        // One tree in four has a second root: frames that are not connected.
        let second = (seed % 4 == 0).then_some(count / 2);
        for child in (1..count).filter(|child| Some(*child) != second) {
            let from = second.filter(|root| child > *root).unwrap_or(0);
            let parent = rng.random_range(from..child);
            let (parent, child) = (name(parent), name(child));
            if rng.random_range(0..3) == 0 {
                let pose = random_pose(&mut rng);
                frames.set_static_transform(&parent, &child, pose).unwrap();
                writeln!(text, "fixed {parent} {child} {}", numbers(&pose)).unwrap();
                continue;
            }
            for moment in 0..MOMENTS {
                let (pose, stamp) = (random_pose(&mut rng), FIRST_NANOS + moment * PERIOD_NANOS);
                frames.set_transform(&parent, &child, stamp, pose).unwrap();
                writeln!(text, "moving {parent} {child} {stamp} {}", numbers(&pose)).unwrap();
            }
        }
        // Some questions are before the first moment, after the last, or at one of them.
        let questions: Vec<(String, String, i64)> = (0..QUESTIONS)
            .map(|k| {
                let at = rng.random_range(-2 * PERIOD_NANOS..(MOMENTS + 1) * PERIOD_NANOS);
                let at = if k % 5 == 0 { at / PERIOD_NANOS * PERIOD_NANOS } else { at };
                (name(rng.random_range(0..count)), name(rng.random_range(0..count)), FIRST_NANOS + at)
            })
            .filter(|(target, source, _)| target != source)
            .collect();
        for (target, source, stamp) in &questions {
            writeln!(text, "ask {target} {source} {stamp}").unwrap();
        }
        let answers = ask(&program, &text);
        assert_eq!(answers.lines().count(), questions.len());
        for ((target, source, stamp), theirs) in questions.iter().zip(answers.lines()) {
            let ours = frames.lookup_transform(target, source, TransformTime::Time(*stamp));
            let theirs = parse(theirs);
            match (&ours, theirs) {
                (Ok(ours), Some(theirs)) => {
                    let distance = (ours.translation.vector - theirs.translation.vector).norm();
                    let turn = ours.rotation.angle_to(&theirs.rotation);
                    assert!(
                        distance < TOLERANCE && turn < TOLERANCE,
                        "tree {seed}, {source} in {target} at {stamp}: {distance} m"
                    );
                    answered += 1;
                }
                (Err(_), None) => refused += 1,
                _ => panic!("tree {seed}, {source} in {target} at {stamp}: {ours:?} and {theirs:?}"),
            }
        }
    }
    assert!(answered > 1000 && refused > 100, "{answered} answered, {refused} refused");
}

fn name(frame: usize) -> String {
    format!("frame{frame}")
}

fn random_pose(rng: &mut ChaCha8Rng) -> Pose {
    let mut vector = |range: f64| {
        let mut one = || rng.random_range(-range..range);
        Vector::new(one(), one(), one())
    };
    Pose::from_parts(vector(2.0).into(), UnitQuaternion::from_scaled_axis(vector(1.5)))
}

fn numbers(pose: &Pose) -> String {
    let (t, r) = (pose.translation.vector, pose.rotation.coords);
    format!("{} {} {} {} {} {} {}", t.x, t.y, t.z, r.x, r.y, r.z, r.w)
}

fn parse(line: &str) -> Option<Pose> {
    if line == "none" {
        return None;
    }
    let n: Vec<f64> = line.split(' ').map(|word| word.parse().unwrap()).collect();
    let rotation = UnitQuaternion::new_normalize(Quaternion::new(n[6], n[3], n[4], n[5]));
    Some(Pose::from_parts(Vector::new(n[0], n[1], n[2]).into(), rotation))
}

fn build() -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let source = root.join("tests/side_by_side/localization/tf2_reference.cpp");
    let program = Path::new(env!("CARGO_TARGET_TMPDIR")).join("tf2_reference");
    let mut compile = Command::new("g++");
    compile.args(["-std=c++17", "-O2", "-ffp-contract=off"]).arg(source).arg("-o").arg(&program);
    let built = compile.args(["-ltf2", "-lrostime", "-lcpp_common"]).output().unwrap();
    assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
    program
}

fn ask(program: &Path, text: &str) -> String {
    let mut child = Command::new(program).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    let mut input = child.stdin.take().unwrap();
    let text = text.to_owned();
    // Beside reading: neither pipe holds all of it.
    let writer = std::thread::spawn(move || input.write_all(text.as_bytes()));
    let output = child.wait_with_output().unwrap();
    writer.join().unwrap().unwrap();
    assert!(output.status.success());
    String::from_utf8(output.stdout).unwrap()
}
