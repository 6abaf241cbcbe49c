//! Our plant against pure C++ programs, bit for bit: see `tests/side_by_side/dynamics`.

#![allow(missing_docs)]
#![allow(clippy::unwrap_used)]
#![allow(clippy::disallowed_methods)] // compiles and runs programs

mod common;

use common::{START, bare_table, box_scene, grasp_base, move_hand, plant_at, positions, standing};
use nalgebra::{Quaternion, UnitQuaternion};
use proact_arm::{ArmModel, Inertial, Joint, JointKind, JointLimits, Link};
use proact_dynamics::{DynamicsOptions, PhysicsEngine, RigidBodyPlant};
use proact_testbed::ports::Plant;
use proact_types::{
    Object, ObjectId, PlantCommand, PlantState, Pose, Scene, SceneObject, Shape, Vector, zeros,
};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

const TICKS: usize = 1000;

/// FNV-1a over the bits of numbers, the same as in `digest.hpp`.
struct Digest(u64);

impl Digest {
    fn new() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }

    fn add(&mut self, values: &[f64]) {
        for value in values {
            self.0 = (self.0 ^ value.to_bits()).wrapping_mul(0x100_0000_01b3);
        }
    }

    fn add_blocks(&mut self, state: &PlantState) {
        for block in &state.objects {
            self.add(block.pose.translation.vector.as_slice());
            self.add(block.pose.rotation.coords.as_slice());
            self.add(block.linear_velocity.as_slice());
            self.add(block.angular_velocity.as_slice());
        }
    }
}

/// Compiles `name` of this comparison together with `core`, the sources of the C++ core that it needs.
fn compile(name: &str, core: &[PathBuf]) -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let program = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let output = Command::new("g++")
        .args(["-std=c++17", "-O2", "-ffp-contract=off", "-I"])
        .arg(root.join("cpp/dynamics/include"))
        .arg("-I")
        .arg(root.join("cpp/dynamics/src"))
        .arg("-I")
        .arg(root.join("cpp/common/include"))
        .arg(root.join("tests/side_by_side/dynamics").join(name).with_extension("cpp"))
        .args(core)
        .args(["-lode", "-o"])
        .arg(&program)
        .output()
        .expect("g++ is there: the crate was built with it");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    program
}

/// The lines that `program` prints for `input`.
fn run(program: &Path, input: &str) -> Vec<String> {
    let mut child = Command::new(program)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("it was just built");
    let mut stdin = child.stdin.take().expect("piped");
    // The program prints while it reads: feeding it from here alone would fill both pipes.
    let input = input.to_owned();
    let feeder = std::thread::spawn(move || stdin.write_all(input.as_bytes()));
    let output = child.wait_with_output().unwrap();
    feeder.join().unwrap().unwrap();
    assert!(output.status.success(), "{} failed", program.display());
    String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect()
}

fn compare(ours: &[String], theirs: &[String]) {
    assert_eq!(ours.len(), theirs.len());
    if let Some(tick) = (0..ours.len()).find(|&tick| ours[tick] != theirs[tick]) {
        panic!("tick {tick} differs first: {} here, {} in C++", ours[tick], theirs[tick]);
    }
}

/// Seven links of 0.125 m along x that turn freely about y; see `raw_ode.cpp` for the numbers.
fn chain() -> ArmModel {
    let bare = |name: String, inertial| Link { name, inertial, collisions: vec![], visuals: vec![] };
    let inertial = Inertial {
        mass: 0.125,
        pose: Pose::translation(0.0625, 0.0, 0.0),
        inertia: [0.0009765625, 0.0, 0.0, 0.0009765625, 0.0, 0.0009765625],
    };
    let mut links = vec![bare("base".to_owned(), None)];
    links.extend((0..7).map(|k| bare(format!("link{k}"), Some(inertial))));
    let joint = |k: usize| Joint {
        name: format!("joint{k}"),
        kind: JointKind::Revolute,
        parent: k,
        child: k + 1,
        origin: Pose::translation(if k == 0 { 0.0 } else { 0.125 }, 0.0, 0.0),
        axis: Vector::y(),
        // No effort: the position control cannot touch the joint.
        limits: JointLimits { lower: -3.1, upper: 3.1, velocity: 1.0, effort: 0.0 },
        damping: 0.05,
        friction: 0.0,
    };
    ArmModel {
        name: "chain".to_owned(),
        links,
        joints: (0..7).map(joint).collect(),
        arm: (0..7).collect(),
        hand: vec![],
        tip: 7,
        poses: vec![],
        allowed_collisions: vec![],
        ..Default::default()
    }
}

#[test]
fn a_chain_and_a_falling_block_match_raw_ode_bit_for_bit() {
    let slope = UnitQuaternion::new_unchecked(Quaternion::new(0.995, 0.09987492177719089, 0.0, 0.0));
    let tilted = UnitQuaternion::new_unchecked(Quaternion::new(0.5, 0.5, 0.5, 0.5));
    let scene = Scene {
        fixed: vec![SceneObject {
            name: "table".to_owned(),
            shape: Shape::Box { size: [8.0, 8.0, 0.125] },
            pose: Pose::from_parts([0.0, 0.0, -0.0625].into(), slope),
            friction: 0.4,
        }],
        objects: vec![Object::with_default_friction(
            "red1",
            Shape::Box { size: [0.0625, 0.0625, 0.125] },
            0.125,
            Pose::from_parts([3.0, 0.0, 0.25].into(), tilted),
        )],
        ..bare_table(vec![])
    };
    let base = Pose::translation(0.0, 0.0, 2.0);
    let options = DynamicsOptions { engine: PhysicsEngine::Ode, sleep: false, ..DynamicsOptions::default() };
    let mut plant = RigidBodyPlant::new(&chain(), &scene, &[0.0; 7], &base, options).unwrap();
    let command = PlantCommand { position: zeros(7), velocity: zeros(7), world_from_base: base };
    let mut digest = Digest::new();
    let mut lines = Vec::new();
    for _ in 0..TICKS {
        plant.step(&command).unwrap();
        digest.add(&plant.state().position);
        digest.add(&plant.state().velocity);
        digest.add_blocks(plant.state());
        lines.push(format!("{:016x}", digest.0));
    }
    let state = plant.state();
    assert!(state.position[0].abs() > 0.5, "the chain swings");
    assert!(state.position.iter().all(|angle| angle.abs() < 3.0), "and meets no stop: {:?}", state.position);
    assert!(state.objects[0].pose.translation.z < 0.2, "the block has fallen");
    compare(&lines, &run(&compile("raw_ode", &[]), ""));
}

/// What `full_scene.cpp` reads: numbers in the shortest form that gives back every bit.
struct Text(String);

impl Text {
    fn word(&mut self, word: &str) {
        let _ = write!(self.0, "{} ", word.replace(' ', "_"));
    }

    fn numbers(&mut self, values: &[f64]) {
        for value in values {
            let _ = write!(self.0, "{value:e} ");
        }
    }

    fn count(&mut self, value: usize) {
        let _ = write!(self.0, "{value} ");
    }

    fn pose(&mut self, pose: &Pose) {
        self.numbers(pose.translation.vector.as_slice());
        self.numbers(pose.rotation.coords.as_slice());
    }

    fn shape(&mut self, shape: &Shape) {
        let (kind, size) = match *shape {
            Shape::Box { size } => (0, size),
            Shape::Sphere { radius } => (1, [radius, 0.0, 0.0]),
            Shape::Cylinder { radius, length } => (2, [radius, length, 0.0]),
            Shape::Capsule { radius, length } => (3, [radius, length, 0.0]),
        };
        self.count(kind);
        self.numbers(&size);
    }

    fn model(&mut self, model: &ArmModel, scene: &Scene, start: &[f64], base: &Pose) {
        self.pose(base);
        self.count(model.links.len());
        for link in &model.links {
            self.word(&link.name);
            let inertial =
                link.inertial.unwrap_or(Inertial { mass: 0.0, pose: Pose::identity(), inertia: [0.0; 6] });
            self.numbers(&[inertial.mass]);
            self.pose(&inertial.pose);
            self.numbers(&inertial.inertia);
            self.count(link.collisions.len());
            for collision in &link.collisions {
                self.pose(&collision.pose);
                self.shape(&collision.shape);
            }
        }
        self.count(model.joints.len());
        for joint in &model.joints {
            self.word(&joint.name);
            self.count(usize::from(joint.kind == JointKind::Fixed));
            self.count(joint.parent);
            self.pose(&joint.origin);
            self.numbers(joint.axis.as_slice());
            let limits = &joint.limits;
            self.numbers(&[limits.lower, limits.upper, limits.velocity, limits.effort]);
            self.numbers(&[joint.damping, joint.friction]);
        }
        self.count(model.arm_count());
        self.count(model.moving_count());
        for (joint, angle) in model.moving().zip(start) {
            self.count(joint);
            self.numbers(&[*angle]);
        }
        self.count(scene.fixed.len());
        for object in &scene.fixed {
            self.word(&object.name);
            self.shape(&object.shape);
            self.pose(&object.pose);
            self.numbers(&[object.friction]);
        }
        self.count(scene.objects.len());
        for block in &scene.objects {
            self.word(&block.name);
            self.shape(&block.shape);
            self.numbers(&[block.mass, block.friction, block.finger_friction]);
            self.pose(&block.pose);
        }
    }

    fn command(&mut self, action: &str, command: &PlantCommand) {
        // Written apart from `word`, which replaces blanks.
        let _ = write!(self.0, "{action} ");
        self.numbers(&command.position);
        self.numbers(&command.velocity);
        self.pose(&command.world_from_base);
    }
}

#[test]
fn the_full_scene_matches_the_core_without_rust_bit_for_bit() {
    let model = proact_description::mpl_right_arm();
    let open = positions(&model, &START, "open");
    let closed = positions(&model, &START, "closed");
    let mut base = grasp_base(&model, &open);
    // The whole box, low enough for the hand to stand on a table of its own with a block at the origin.
    let mut scene = box_scene();
    for object in &mut scene.fixed {
        object.pose.translation.x += 0.5;
    }
    scene.fixed.push(bare_table(vec![]).fixed.swap_remove(0));
    scene.fixed.retain(|object| object.name != "slab" || object.pose.translation.x == 0.0);
    for (k, (x, y)) in [(0.0, 0.0), (0.3, 0.1), (0.3, 0.2), (0.2, -0.3)].into_iter().enumerate() {
        scene.objects[k] = standing(ObjectId::new(k), x, y);
    }
    scene.objects[2].pose.translation.z += 0.1;

    let mut plant = plant_at(&model, &scene, &open, &base).unwrap();
    let mut text = Text(String::new());
    text.model(&model, &scene, &open, &base);
    text.count(TICKS);
    let mut commands = move_hand(&open, &closed, base, 600);
    commands.extend(move_hand(&closed, &open, base, TICKS - 600));
    let mut digest = Digest::new();
    let mut lines = Vec::new();
    let mut touched = 0;
    for (tick, command) in commands.iter_mut().enumerate() {
        let action = match tick {
            350 => format!("attach 0 {}", model.tip),
            650 => "release".to_owned(),
            _ => "-".to_owned(),
        };
        if tick == 350 {
            plant.attach(0, model.tip).unwrap();
        }
        if tick == 650 {
            plant.release();
        }
        if (400..600).contains(&tick) {
            base.translation.z += 2e-4;
        }
        command.world_from_base = base;
        text.command(&action, command);
        plant.step(command).unwrap();
        let state = plant.state();
        touched += usize::from(!state.contacts.is_empty());
        digest.add(&state.position);
        digest.add(&state.velocity);
        digest.add(&state.effort);
        digest.add_blocks(state);
        for contact in &state.contacts {
            digest.add(contact.point.coords.as_slice());
            digest.add(contact.normal.as_slice());
            digest.add(&[contact.force]);
        }
        lines.push(format!("{:016x}", digest.0));
    }
    assert!(touched > 100, "fingers touched the block in {touched} ticks");

    let core = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cpp/dynamics/src");
    let sources: Vec<PathBuf> = [core.clone(), core.join("engines/reduced"), core.join("engines/ode")]
        .iter()
        .flat_map(|folder| std::fs::read_dir(folder).unwrap())
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "cpp"))
        .collect();
    compare(&lines, &run(&compile("full_scene", &sources), &text.0));
}
