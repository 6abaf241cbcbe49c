//! The box scene, the two set-ups and requests in them, for tests and examples.
#![allow(dead_code)]

use nalgebra::UnitQuaternion;
use proact_arm::ArmModel;
use proact_kinematics::Kinematics;
use proact_planning::{ArmPlanner, PersonGeometry, PlannerOptions, person_obstacles};
use proact_tasks::{Arrangement, TaskSpec};
use proact_types::{
    AttachedObject, JointVector, ObjectId, Obstacle, PlanGoal, PlanRequest, Point, Pose, Scene, Shape,
    TrunkPosture, Vector, joints,
};
use std::sync::{Arc, OnceLock};

/// Places on the start side of the box, with a block each: far or near, lateral or medial.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlockRegion {
    FL,
    FM,
    NL,
    NM,
}

impl BlockRegion {
    /// In the order of the blocks that stand there.
    pub const ALL: [BlockRegion; 4] = [BlockRegion::FL, BlockRegion::FM, BlockRegion::NL, BlockRegion::NM];
}

/// The box and its blocks, block `k` in `BlockRegion::ALL[k]`.
pub fn scene() -> &'static Scene {
    static SCENE: OnceLock<Scene> = OnceLock::new();
    SCENE.get_or_init(|| {
        let arrangement = Some(Arrangement::numbered(1).expect("1 to 24"));
        let choice = TaskSpec { arrangement, ..TaskSpec::named("modified_bbt", 1).expect("it ships") };
        choice.build(false).expect("a sound task").scene().clone()
    })
}

pub const BLOCK: Shape = Shape::Cylinder { radius: 0.025, length: 0.05 };

pub fn model() -> Arc<ArmModel> {
    static MODEL: OnceLock<Arc<ArmModel>> = OnceLock::new();
    MODEL.get_or_init(|| Arc::new(proact_description::mpl_right_arm())).clone()
}

pub fn kinematics(model: &ArmModel) -> Kinematics {
    Kinematics::new(model).expect("the arm has kinematics")
}

pub fn planner(options: PlannerOptions) -> ArmPlanner {
    let model = model();
    let kinematics = Box::new(kinematics(&model));
    ArmPlanner::new(model, kinematics, options).expect("the arm can be planned for")
}

/// `world_from_base` of the set-up `still`.
pub fn still() -> Pose {
    Pose::translation(-0.39, 0.12, 1.5)
}

/// `world_from_base` of the set-up `seated`: forward, lateral and axial lean in degrees about a hip pivot on the
/// midline, 0.45 m below the shoulder.
pub fn seated(posture: TrunkPosture) -> Pose {
    let hip = Point::new(-0.6, 0.0, 0.995);
    let shoulder = Point::new(-0.6, -0.18, 1.445);
    let turn = UnitQuaternion::from_axis_angle(&Vector::z_axis(), posture.axial)
        * UnitQuaternion::from_axis_angle(&Vector::y_axis(), posture.forward)
        * UnitQuaternion::from_axis_angle(&Vector::x_axis(), posture.lateral);
    Pose::from_parts((hip + turn * (shoulder - hip)).coords.into(), turn)
}

/// Adds the person whose shoulder `base` is to a request's obstacles.
pub fn with_person(mut request: PlanRequest, person: &PersonGeometry) -> PlanRequest {
    request.obstacles.extend(person_obstacles(&request.world_from_base, person));
    request
}

/// Box, table, floor and the four blocks, in their regions or where `at` says.
pub fn obstacles() -> Vec<Obstacle> {
    let scene = scene();
    let fixed = scene.fixed.iter().map(|o| Obstacle {
        name: o.name.clone(),
        shape: o.shape,
        pose: o.pose,
        loose: false,
    });
    let blocks = scene.objects.iter().map(|o| Obstacle {
        name: o.name.clone(),
        shape: o.shape,
        pose: o.pose,
        loose: false,
    });
    fixed.chain(blocks).collect()
}

/// The name of the block in `region`.
pub fn block_name(region: BlockRegion) -> String {
    scene().objects[region as usize].name.clone()
}

/// Where the block in `region` stands at the start: its centre.
pub fn block_center(region: BlockRegion) -> Point {
    scene().objects[region as usize].pose.translation.vector.into()
}

/// The mirrored place on the table top.
pub fn target(region: BlockRegion) -> Point {
    let start = block_center(region);
    Point::new(start.x, -start.y, scene().table_height)
}

pub fn pose_of(model: &ArmModel, group: &str, name: &str) -> JointVector {
    joints(model.pose(group, name).expect("a named pose of the arm"))
}

/// A pick of the block in `region` from the arm's start pose.
pub fn pick(model: &ArmModel, world_from_base: Pose, region: BlockRegion, seed: u64) -> PlanRequest {
    PlanRequest {
        id: 1,
        world_from_base,
        start: pose_of(model, "arm", "start"),
        hand: pose_of(model, "hand", "open"),
        goal: PlanGoal::Pick { object: ObjectId::new(region as usize), center: block_center(region) },
        picked_object: Some(block_name(region)),
        obstacles: obstacles(),
        held_joints: Vec::new(),
        attached: None,
        seed,
    }
}

/// The place that follows a pick which ended at `q`, with the block in the hand as it was gripped.
pub fn place(
    model: &ArmModel,
    world_from_base: Pose,
    region: BlockRegion,
    place_point: Point,
    q: &[f64],
    seed: u64,
) -> PlanRequest {
    use proact_kinematics::ArmKinematics;
    let block = block_name(region);
    let tip = world_from_base * kinematics(model).forward(q).expect("angles of a plan");
    let block_pose =
        Pose::translation(block_center(region).x, block_center(region).y, block_center(region).z);
    PlanRequest {
        id: 2,
        world_from_base,
        start: joints(q),
        hand: pose_of(model, "hand", "closed"),
        goal: PlanGoal::Place { point: place_point },
        picked_object: None,
        held_joints: Vec::new(),
        obstacles: obstacles().into_iter().filter(|o| o.name != block).collect(),
        attached: Some(AttachedObject {
            name: block,
            shape: BLOCK,
            tip_from_object: tip.inverse() * block_pose,
            loose: false,
        }),
        seed,
    }
}
