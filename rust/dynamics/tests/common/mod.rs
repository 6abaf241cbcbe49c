//! The arm, the box and the blocks that the tests of this crate share.

#![allow(dead_code)] // each test program uses a part

use nalgebra::UnitQuaternion;
use proact_arm::ArmModel;
use proact_dynamics::{DynamicsOptions, RigidBodyPlant};
use proact_kinematics::Kinematics;
use proact_testbed::{
    LoggedPlans, Testbed, TestbedParts, TrialConfig,
    ports::{Plant, PlantError},
};
use proact_types::{
    Contact, JointVector, Object, ObjectId, PlantCommand, Point, Pose, Scene, SceneObject, Shape, TICK_SECS,
    Target, Vector, joints, zeros,
};
use std::sync::Arc;

/// Height of the table top, metres.
pub const TABLE: f64 = 1.015;
/// Radius of a block, metres.
pub const RADIUS: f64 = 0.025;
/// Height of a block, metres.
pub const HEIGHT: f64 = 0.05;

/// Names of the blocks, in the order of their numbers.
pub const NAMES: [&str; 4] = ["red1", "red2", "blue1", "blue2"];

/// A block that stands on the table at x, y.
pub fn standing(id: ObjectId, x: f64, y: f64) -> Object {
    block(id, Pose::translation(x, y, TABLE + 0.5 * HEIGHT))
}

/// A block with its centre at `pose`.
pub fn block(id: ObjectId, pose: Pose) -> Object {
    Object::with_default_friction(
        NAMES[id.index()],
        Shape::Cylinder { radius: RADIUS, length: HEIGHT },
        0.1,
        pose,
    )
}

fn box_at(name: &str, size: [f64; 3], center: [f64; 3]) -> SceneObject {
    SceneObject {
        name: name.to_owned(),
        shape: Shape::Box { size },
        pose: Pose::translation(center[0], center[1], center[2]),
        friction: 0.4,
    }
}

/// A table without walls, and a floor.
pub fn bare_table(objects: Vec<Object>) -> Scene {
    Scene {
        fixed: vec![
            box_at("slab", [1.0, 1.0, 0.03], [0.0, 0.0, 1.0]),
            box_at("floor", [10.0, 10.0, 0.2], [0.0, 0.0, -0.1]),
        ],
        objects,
        table_height: TABLE,
        ..Scene::default()
    }
}

/// The modified box-and-blocks box with four blocks.
pub fn box_scene() -> Scene {
    let mut fixed = vec![
        box_at("slab", [0.31, 0.61, 0.03], [0.0, 0.0, 1.0]),
        box_at("partition", [0.30, 0.005, 0.152], [0.0, 0.0, 1.091]),
        box_at("left wall", [0.31, 0.005, 0.085], [0.0, 0.3025, 1.0575]),
        box_at("right wall", [0.31, 0.005, 0.085], [0.0, -0.3025, 1.0575]),
        box_at("far wall", [0.005, 0.60, 0.085], [0.1525, 0.0, 1.0575]),
        box_at("near wall", [0.005, 0.60, 0.085], [-0.1525, 0.0, 1.0575]),
        box_at("floor", [10.0, 10.0, 0.2], [0.0, 0.0, -0.1]),
    ];
    for (index, (x, y)) in [(0.13, 0.28), (0.13, -0.28), (-0.13, 0.28), (-0.13, -0.28)].iter().enumerate() {
        fixed.push(SceneObject {
            name: format!("leg {index}"),
            shape: Shape::Cylinder { radius: 0.02, length: 0.985 },
            pose: Pose::translation(*x, *y, 0.4925),
            friction: 0.4,
        });
    }
    let positions = [(0.058, -0.2083), (-0.058, -0.092), (-0.058, -0.2083), (0.058, -0.092)];
    let ids = (0..4).map(ObjectId::new);
    let objects = ids.clone().zip(positions).map(|(id, (x, y))| standing(id, x, y)).collect();
    let target = |(object, (x, y)): (ObjectId, (f64, f64))| Target {
        object,
        center: Point::new(x, -y, TABLE),
        radius: 0.05,
    };
    let targets = ids.zip(positions).map(target).collect();
    Scene { fixed, objects, targets, table_height: TABLE, ..Scene::default() }
}

/// The arm's pose at the start of a trial, rad.
pub const START: [f64; 7] = [1.029, -0.161, 0.1291, 1.029, 1.57, 0.0174, 0.1006];

/// All moving joints: `arm`, and the hand in the pose called `hand`.
pub fn positions(model: &ArmModel, arm: &[f64], hand: &str) -> Vec<f64> {
    let mut all = arm.to_vec();
    all.extend_from_slice(model.pose("hand", hand).expect("the model has the hand poses"));
    all
}

/// The shoulder of the `still` set-up.
pub fn still() -> Pose {
    Pose::translation(-0.39, 0.12, 1.5)
}

/// A shoulder far above everything, so that only blocks and table matter.
pub fn far_base() -> Pose {
    Pose::translation(-0.39, 0.12, 5.0)
}

/// A plant with the arm in its start pose and the hand open.
pub fn plant(scene: &Scene, base: &Pose) -> RigidBodyPlant {
    plant_with(scene, base, DynamicsOptions::default())
}

/// The same with other settings.
pub fn plant_with(scene: &Scene, base: &Pose, options: DynamicsOptions) -> RigidBodyPlant {
    let model = proact_description::mpl_right_arm();
    let start = positions(&model, &START, "open");
    RigidBodyPlant::new(&model, scene, &start, base, options).expect("a sound scene")
}

/// A command to stay at `positions`.
pub fn hold_command(positions: &[f64], base: Pose) -> PlantCommand {
    PlantCommand { position: joints(positions), velocity: zeros(positions.len()), world_from_base: base }
}

/// Steps `ticks` times under one command.
pub fn run(plant: &mut RigidBodyPlant, command: &PlantCommand, ticks: usize) {
    for tick in 0..ticks {
        plant.step(command).unwrap_or_else(|error| panic!("tick {tick}: {error}"));
    }
}

/// A plant with the arm at `positions`.
pub fn plant_at(
    model: &ArmModel,
    scene: &Scene,
    positions: &[f64],
    base: &Pose,
) -> Result<RigidBodyPlant, PlantError> {
    RigidBodyPlant::new(model, scene, positions, base, DynamicsOptions::default())
}

/// The base at which the tip of the arm, in `positions`, is at `world_from_tip`.
pub fn base_that_puts_tip_at(model: &ArmModel, positions: &[f64], world_from_tip: &Pose) -> Pose {
    let nothing = Scene { fixed: Vec::new(), ..bare_table(Vec::new()) };
    let probe = plant_at(model, &nothing, positions, &Pose::identity()).expect("a sound arm");
    world_from_tip * probe.link_pose(model.tip).expect("the tip").inverse()
}

/// The base at which the hand, in `positions`, grasps a block that stands on the table at the origin: fingers ahead
/// and rolled as it grips, grasp centre in the block's centre.
pub fn grasp_base(model: &ArmModel, positions: &[f64]) -> Pose {
    let rotation =
        UnitQuaternion::from_euler_angles(model.widest_grasp().roll_rad, -1.0_f64.to_radians(), 0.0);
    let block = Vector::new(0.0, 0.0, TABLE + 0.5 * HEIGHT);
    let world_from_tip = Pose::from_parts((block - rotation * model.widest_grasp().center).into(), rotation);
    base_that_puts_tip_at(model, positions, &world_from_tip)
}

/// Two opposing contacts on a block that have lasted.
#[derive(Debug)]
pub struct OpposedGrip {
    /// Tick from the start of closing.
    pub tick: usize,
    /// Between the two normals.
    pub degrees: f64,
    /// Who touches.
    pub links: (String, String),
    /// N.
    pub forces: (f64, f64),
}

/// Closes the hand at 2 rad/s until thumb3 and the last link of index, middle or ring have pressed a block from
/// opposite sides (normals over 100 degrees apart) in 40 ticks.
pub fn close_until_held(
    plant: &mut RigidBodyPlant,
    model: &ArmModel,
    base: &Pose,
    ticks: usize,
) -> Result<Option<OpposedGrip>, PlantError> {
    let start = plant.state().position.to_vec();
    let closed = positions(model, &start[..model.arm_count()], "closed");
    let is = |contact: &Contact, parts: &[&str]| {
        contact.force > 1e-4 && parts.iter().any(|part| model.links[contact.link].name.contains(part))
    };
    let mut lasted = 0;
    for (tick, command) in move_hand(&start, &closed, *base, ticks).iter().enumerate() {
        plant.step(command)?;
        let contacts = &plant.state().contacts;
        let fingers = ["index3", "middle3", "ring3"];
        let opposing = contacts
            .iter()
            .filter(|contact| is(contact, &["thumb3"]))
            .flat_map(|thumb| contacts.iter().filter(|c| is(c, &fingers)).map(move |finger| (thumb, finger)))
            .map(|(thumb, finger)| (thumb.normal.angle(&finger.normal).to_degrees(), thumb, finger))
            .filter(|(degrees, thumb, finger)| *degrees > 100.0 && thumb.object == finger.object)
            .max_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((degrees, thumb, finger)) = opposing {
            lasted += 1;
            if lasted == 40 {
                let name = |contact: &Contact| model.links[contact.link].name.clone();
                let (links, forces) = ((name(thumb), name(finger)), (thumb.force, finger.force));
                return Ok(Some(OpposedGrip { tick, degrees, links, forces }));
            }
        }
    }
    Ok(None)
}

/// Commands that take all joints from `from` to `to` at 2 rad/s and stay there.
pub fn move_hand(from: &[f64], to: &[f64], base: Pose, ticks: usize) -> Vec<PlantCommand> {
    let mut at = joints(from);
    let step = |at: &mut JointVector| {
        let mut velocity = zeros(at.len());
        for (k, angle) in at.iter_mut().enumerate() {
            let increment = (to[k] - *angle).clamp(-2e-3, 2e-3);
            *angle += increment;
            velocity[k] = increment / TICK_SECS;
        }
        PlantCommand { position: at.clone(), velocity, world_from_base: base }
    };
    (0..ticks).map(|_| step(&mut at)).collect()
}

/// A trial on the real physics, whose arm stands at `base`, or at the shoulder of the set-up.
///
/// # Panics
/// A configuration that cannot be built.
pub fn testbed(config: TrialConfig, base: Option<Pose>) -> Testbed {
    let model = Arc::new(proact_description::mpl_right_arm());
    let start = [
        model.pose("arm", "start").expect("an arm for trials has poses"),
        model.pose("hand", "open").expect("an arm for trials has poses"),
    ]
    .concat();
    let base = base.unwrap_or_else(|| config.setup.body.shoulder_pose(&Default::default()));
    let options = DynamicsOptions::from_config(&config.physics);
    let task = config.build_task(&model).expect("a task that ships");
    let plant =
        RigidBodyPlant::new(&model, task.scene(), &start, &base, options).expect("a plant of this arm");
    let parts = TestbedParts {
        arm: config.arm.clone(),
        kinematics: Box::new(Kinematics::new(&model).expect("the arm is usable")),
        plant: Box::new(plant),
        methods: proact_control::MethodRegistry::standard(),
        plans: Box::new(LoggedPlans),
        classifier: None,
        model,
        process: None,
    };
    Testbed::new(config, parts).expect("a trial of these parts")
}
