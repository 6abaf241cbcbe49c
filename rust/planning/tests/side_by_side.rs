//! Our search against a pure C++ program on raw OMPL and FCL: see `tests/side_by_side/planning`.
#![allow(clippy::unwrap_used)]
#![allow(clippy::disallowed_methods)] // compiles and runs a program

mod common;

use common::*;
use proact_arm::{ArmModel, JointKind};
use proact_planning::{CancelFlag, CollisionScene, PlannerOptions, SearchLimits, SearchOutcome};
use proact_types::{Obstacle, Pose, Shape};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Both do the same arithmetic on joint vectors; only the verdicts of collision checks steer them.
const TOLERANCE: f64 = 1e-12;
/// Equal steps of the plain motion check, rad (L2): finer than ours, so that it misses less.
const PLAIN_STEP: f64 = 0.004;

fn compile() -> PathBuf {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/side_by_side/planning/raw_ompl.cpp");
    let program = Path::new(env!("CARGO_TARGET_TMPDIR")).join("raw_ompl");
    let output = Command::new("g++")
        .args(["-std=c++17", "-O2", "-ffp-contract=off"])
        .args(include_flags())
        .arg(source)
        .args(["-lompl", "-lfcl", "-lccd", "-o"])
        .arg(&program)
        .output()
        .expect("g++ is there: the crate was built with it");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    program
}

fn include_flags() -> Vec<String> {
    let output =
        Command::new("pkg-config").args(["--cflags-only-I", "ompl", "fcl", "eigen3"]).output().unwrap();
    let flags = String::from_utf8(output.stdout).unwrap();
    flags.split_whitespace().map(str::to_owned).collect()
}

fn pose(pose: &Pose) -> String {
    let (p, r) = (pose.translation, pose.rotation);
    format!("{} {} {} {} {} {} {}", p.x, p.y, p.z, r.i, r.j, r.k, r.w)
}

fn shape(shape: &Shape) -> String {
    match *shape {
        Shape::Box { size: [x, y, z] } => format!("box {x} {y} {z}"),
        Shape::Sphere { radius } => format!("sphere {radius} 0 0"),
        Shape::Cylinder { radius, length } => format!("cylinder {radius} {length} 0"),
        Shape::Capsule { radius, length } => format!("capsule {radius} {length} 0"),
    }
}

/// Arm and obstacles as `raw_ompl` reads them; Rust prints numbers so that they read back exactly.
fn describe(model: &ArmModel, hand: &[f64], base: &Pose, obstacles: &[Obstacle]) -> String {
    let mut text = format!("{}\n{}\n{}\n", model.links.len(), pose(base), model.joints.len());
    for (j, joint) in model.joints.iter().enumerate() {
        let planned = model.arm.iter().position(|&a| a == j).map_or(-1, |k| k as i64);
        let angle = model.hand.iter().position(|&h| h == j).map_or(0.0, |k| hand[k]);
        let revolute = i32::from(joint.kind == JointKind::Revolute);
        let (axis, limits) = (joint.axis, joint.limits);
        writeln!(
            text,
            "{} {} {revolute} {} {} {} {} {} {} {planned} {angle}",
            joint.parent,
            joint.child,
            pose(&joint.origin),
            axis.x,
            axis.y,
            axis.z,
            limits.lower,
            limits.upper
        )
        .unwrap();
    }
    let shapes: Vec<_> =
        model.links.iter().enumerate().flat_map(|(k, l)| l.collisions.iter().map(move |c| (k, c))).collect();
    writeln!(text, "{}", shapes.len()).unwrap();
    for (link, c) in shapes {
        writeln!(text, "{link} {} {}", shape(&c.shape), pose(&c.pose)).unwrap();
    }
    writeln!(text, "{}", model.allowed_collisions.len()).unwrap();
    for (a, b) in &model.allowed_collisions {
        writeln!(text, "{a} {b}").unwrap();
    }
    writeln!(text, "{}", obstacles.len()).unwrap();
    for o in obstacles {
        writeln!(text, "{} {}", shape(&o.shape), pose(&o.pose)).unwrap();
    }
    text
}

fn run(program: &Path, input: &str) -> Vec<Vec<f64>> {
    let mut child = Command::new(program)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("it was just built");
    child.stdin.take().unwrap().write_all(input.as_bytes()).unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "raw_ompl ended with {}", output.status);
    String::from_utf8(output.stdout)
        .unwrap()
        .lines()
        .map(|line| line.split(' ').map(|number| number.parse().unwrap()).collect())
        .collect()
}

#[test]
fn a_path_over_the_partition_equals_that_of_raw_ompl_and_fcl() {
    let program = compile();
    let model = model();
    let hand = pose_of(&model, "hand", "open");
    let obstacles: Vec<Obstacle> = obstacles()
        .into_iter()
        .filter(|o| !o.name.starts_with("red") && !o.name.starts_with("blue"))
        .collect();
    // From a grip on one side to a place on the other, both low in the box.
    let mut planner = planner(PlannerOptions::default());
    let picked = planner.solve(&pick(&model, still(), BlockRegion::NM, 1));
    let start = picked.trajectory.points.last().unwrap().q.to_vec();
    let placed = planner.solve(&place(&model, still(), BlockRegion::NM, target(BlockRegion::NL), &start, 1));
    let goal = placed.trajectory.points.last().unwrap().q.to_vec();

    let mut scene = CollisionScene::new(&model).unwrap();
    scene.set_base(&still()).unwrap();
    scene.set_hand(&hand).unwrap();
    scene.set_obstacles(&obstacles).unwrap();
    let limits = SearchLimits { more_searches: 0, ..SearchLimits::default() };
    let world = describe(&model, &hand, &still(), &obstacles);
    let numbers = |q: &[f64]| q.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
    for seed in 1..=5 {
        let outcome =
            scene.search(&start, std::slice::from_ref(&goal), seed, &limits, &CancelFlag::new()).unwrap();
        let SearchOutcome::Solved { path, .. } = outcome else { panic!("{outcome:?}") };
        assert!(path.len() > 2, "the straight way is blocked by the partition");
        let query = format!(
            "{}\n{}\n{seed} {} {} {} {PLAIN_STEP}\n",
            numbers(&start),
            numbers(&goal),
            limits.max_iterations,
            limits.range_rad,
            limits.shortcut_attempts
        );
        let raw = run(&program, &(world.clone() + &query));
        assert_eq!(path.len(), raw.len(), "seed {seed}");
        for (ours, theirs) in path.iter().flatten().zip(raw.iter().flatten()) {
            assert!((ours - theirs).abs() <= TOLERANCE, "seed {seed}: {ours} here, {theirs} in C++");
        }
    }
}
