//! Heaps that physics lets fall before a trial begins.

use crate::trial::build_plant;
use proact_arm::ArmModel;
use proact_devices::random_stream;
use proact_testbed::{PhysicsConfig, TrialConfig, ports::Plant};
use proact_types::{BodyState, PlaceRegion, PlantCommand, Pose, Scene, SceneObject, Shape, joints, zeros};
use rand::RngExt;
use std::error::Error;

/// A heap that does not lie still by then is taken as it is if it nearly does.
const MAX_SETTLE_MS: u32 = 10_000;
/// Slower than this it nearly lies still, m/s; a corner of a cube may turn as fast.
const REST_SPEED_M_PER_S: f64 = 0.02;
/// From speeds of turning to those of corners of what lies in heaps, metres.
const CORNER_RADIUS_M: f64 = 0.02;
/// So often what fell out of the box is put back on the heap.
const MAX_REPLACEMENTS: usize = 20;
/// Far from the box: the arm has no part in how a heap lies.
const ARM_BASE_HEIGHT_M: f64 = 4.0;
/// Walls around the area while the objects fall, metres.
const WALL_HEIGHT_M: f64 = 1.0;
const WALL_THICKNESS_M: f64 = 0.02;

/// Lets the heap of the trial's task fall, if it has one that does not lie yet: each object turned by chance, within walls as high as
/// needed in the place of the box's, and once more in the box; what then falls out is put back on top. How it lies then stands in the configuration, so that nobody who has that needs physics for it.
///
/// Deterministic: task and seed decide it; the arm is far away, and the physics are those of the default settings.
///
/// # Errors
/// A task that cannot be; physics that fails; objects that do not come to rest.
pub fn settle_heap(config: &mut TrialConfig, model: &ArmModel) -> Result<(), Box<dyn Error>> {
    let Some(heap) = config.task.unsettled_heap()? else { return Ok(()) };
    let mut scene = config.task.build(false)?.scene().clone();
    let first = scene.objects.len() - heap.count;
    let mut rng = random_stream(config.seed, "task/heap");
    let mut at_random = || rng.random::<f64>();
    for object in &mut scene.objects[first..] {
        object.pose.rotation = uniform_rotation([at_random(), at_random(), at_random()]);
    }
    // Two walls in one place would ask for the same force twice.
    let mut high = scene.clone();
    high.fixed.retain(|body| body.pose.translation.z < scene.table_height);
    high.fixed.extend(wall_objects(&heap.area, scene.table_height));
    let inside = drop_objects(&high, model)?;
    set_object_poses(&mut scene, &inside);
    let mut bodies = drop_objects(&scene, model)?;
    for _ in 0..MAX_REPLACEMENTS {
        let out: Vec<usize> =
            (first..bodies.len()).filter(|k| !heap.contains(&bodies[*k].pose, scene.table_height)).collect();
        if out.is_empty() {
            break;
        }
        let lying = bodies.iter().enumerate().filter(|(k, _)| !out.contains(k));
        let top = lying.map(|(_, body)| body.pose.translation.z).fold(scene.table_height, f64::max);
        for (k, [x, y, z]) in out.into_iter().zip(heap.positions_on_top(top)) {
            bodies[k].pose = Pose::translation(x, y, z);
        }
        set_object_poses(&mut scene, &bodies);
        bodies = drop_objects(&scene, model)?;
    }
    let lies = |body: &BodyState| {
        let (at, turn) = (&body.pose.translation, &body.pose.rotation);
        [at.x, at.y, at.z, turn.i, turn.j, turn.k, turn.w]
    };
    config.task.heap.get_or_insert_default().resting_poses = bodies[first..].iter().map(lies).collect();
    Ok(())
}

/// A turn, all alike probable, of three numbers from 0 to 1 (K. Shoemake, Uniform random rotations, Graphics Gems III, 1992).
fn uniform_rotation([a, b, c]: [f64; 3]) -> nalgebra::UnitQuaternion<f64> {
    let (first, second) = (std::f64::consts::TAU * b, std::f64::consts::TAU * c);
    let (low, high) = ((1.0 - a).sqrt(), a.sqrt());
    let turn = nalgebra::Quaternion::new(
        high * second.cos(),
        low * first.sin(),
        low * first.cos(),
        high * second.sin(),
    );
    nalgebra::UnitQuaternion::from_quaternion(turn)
}

/// Four walls around `area`.
fn wall_objects(area: &PlaceRegion, table: f64) -> Vec<SceneObject> {
    let PlaceRegion { min, max } = *area;
    let wall = |axis: usize, at: f64, side: f64| {
        let other = 1 - axis;
        let (mut size, mut middle) = ([WALL_HEIGHT_M; 3], [0.0; 3]);
        size[axis] = WALL_THICKNESS_M;
        size[other] = max[other] - min[other] + 2.0 * WALL_THICKNESS_M;
        middle[axis] = at + side * WALL_THICKNESS_M / 2.0;
        middle[other] = (min[other] + max[other]) / 2.0;
        middle[2] = table + WALL_HEIGHT_M / 2.0;
        SceneObject {
            name: format!("while falling {axis} {side}"),
            shape: Shape::Box { size },
            pose: Pose::translation(middle[0], middle[1], middle[2]),
            friction: 0.4,
        }
    };
    let along = |axis: usize| [wall(axis, min[axis], -1.0), wall(axis, max[axis], 1.0)];
    [along(0), along(1)].into_iter().flatten().collect()
}

/// Where the objects of `scene` come to rest.
fn drop_objects(scene: &Scene, model: &ArmModel) -> Result<Vec<BodyState>, Box<dyn Error>> {
    let base = Pose::translation(0.0, 0.0, ARM_BASE_HEIGHT_M);
    let mut plant = build_plant(model, scene, &base, &PhysicsConfig::default())?;
    let stay = PlantCommand {
        position: joints(&plant.state().position),
        velocity: zeros(model.moving_count()),
        world_from_base: base,
    };
    let fastest = |plant: &dyn Plant| {
        let bodies = plant.state().objects.iter();
        bodies
            .map(|body| body.linear_velocity.norm().max(CORNER_RADIUS_M * body.angular_velocity.norm()))
            .fold(0.0, f64::max)
    };
    for _ in 0..MAX_SETTLE_MS {
        plant.step(&stay)?;
        if fastest(plant.as_ref()) == 0.0 {
            break;
        }
    }
    match fastest(plant.as_ref()) {
        speed if speed < REST_SPEED_M_PER_S => Ok(plant.state().objects.to_vec()),
        speed => Err(format!(
            "after {} s something in the heap still moves at {speed:.3} m/s; expected less than {REST_SPEED_M_PER_S}: another seed, \
             or fewer objects (task.heap.count)",
            MAX_SETTLE_MS / 1000
        )
        .into()),
    }
}

fn set_object_poses(scene: &mut Scene, bodies: &[BodyState]) {
    for (object, body) in scene.objects.iter_mut().zip(bodies) {
        object.pose = body.pose;
    }
}
