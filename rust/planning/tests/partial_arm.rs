//! Plans for part of an arm, and picks of small cubes by a hand that closes in one direction.

#![allow(missing_docs)]
#![allow(clippy::unwrap_used)]

use proact_arm::{ArmModel, Chain};
use proact_kinematics::Kinematics;
use proact_planning::{ArmPlanner, PlannerOptions};
use proact_types::{
    JointVector, ObjectId, Obstacle, PlanGoal, PlanReply, PlanRequest, PlanStatus, Point, Pose, Shape,
    Vector, joints,
};
use std::sync::Arc;

const TABLE: f64 = 1.015;
/// Joints of the limb that is left above and below the elbow.
const HELD_ABOVE_ELBOW: [usize; 3] = [0, 1, 2];
const HELD_BELOW_ELBOW: [usize; 4] = [0, 1, 2, 3];

fn model() -> Arc<ArmModel> {
    Arc::new(proact_description::mpl_right_arm())
}

fn planner(model: &Arc<ArmModel>) -> ArmPlanner {
    let kinematics = Box::new(Kinematics::new(model).unwrap());
    ArmPlanner::new(model.clone(), kinematics, PlannerOptions::default()).unwrap()
}

/// A pick of `shape`, which stands on a bare table, turned by `yaw`.
fn pick(model: &ArmModel, shape: Shape, yaw: f64, start: JointVector) -> PlanRequest {
    let at = Vector::new(-0.058, -0.092, TABLE + shape.half_height());
    let table = Pose::translation(0.0, 0.0, TABLE - 0.015);
    let pose = Pose::translation(at.x, at.y, at.z) * Pose::rotation(Vector::z() * yaw);
    let obstacle = |name: &str, shape, pose| Obstacle { name: name.to_owned(), shape, pose, loose: false };
    let open = model.pose("hand", &model.grasp_for(shape.grip_width()).open_pose).unwrap();
    PlanRequest {
        id: 1,
        world_from_base: Pose::translation(-0.39, 0.12, 1.5),
        start,
        hand: joints(open),
        goal: PlanGoal::Pick { object: ObjectId(0), center: Point::from(at) },
        picked_object: Some("thing".to_owned()),
        obstacles: vec![
            obstacle("table", Shape::Box { size: [0.31, 0.61, 0.03] }, table),
            obstacle("thing", shape, pose),
        ],
        attached: None,
        held_joints: Vec::new(),
        seed: 7,
    }
}

const BLOCK: Shape = Shape::Cylinder { radius: 0.025, length: 0.05 };

fn start(model: &ArmModel) -> JointVector {
    joints(model.pose("arm", "start").unwrap())
}

fn end(reply: &PlanReply) -> JointVector {
    reply.trajectory.points.last().unwrap().q.clone()
}

fn tip(model: &ArmModel, request: &PlanRequest, q: &[f64]) -> Pose {
    request.world_from_base * Chain::new(model).forward(q)
}

/// A pick of the block for the part of the arm that is left with `held`: the limb is where it is when a whole arm has
/// gripped, and the joint after it is bent by so much that the hand is higher.
fn pick_with_held_joints(model: &Arc<ArmModel>, held: &[usize], bend: f64, seed: u64) -> PlanRequest {
    // Another start makes another posture at the block.
    let mut start = start(model);
    start[2] += 0.2 * (seed as f64 - 2.5);
    start[4] -= 0.25 * seed as f64;
    let whole = PlanRequest { seed, ..pick(model, BLOCK, 0.0, start) };
    let reply = planner(model).solve(&whole);
    assert_eq!(reply.status, PlanStatus::Ok, "{}", reply.reason);
    let bent = |by: f64| {
        let mut q = end(&reply);
        q[held.len()] += by;
        q
    };
    let height = |q: &JointVector| tip(model, &whole, q).translation.z;
    let [up, down] = [bent(bend), bent(-bend)];
    let start = if height(&up) > height(&down) { up } else { down };
    PlanRequest { start, held_joints: held.to_vec(), ..whole }
}

#[test]
fn the_joints_of_the_limb_stay_and_the_others_bring_the_hand_to_the_block() {
    let model = model();
    // By the limb's posture: that of a whole arm that has gripped.
    let mut short = 0;
    for (held, bend, seed) in
        (0..6).flat_map(|seed| [(&HELD_ABOVE_ELBOW[..], 0.12, seed), (&HELD_BELOW_ELBOW[..], 0.08, seed)])
    {
        let request = pick_with_held_joints(&model, held, bend, seed);
        let reply = planner(&model).solve(&request);
        // With three joints the hand may come no nearer than the table lets it, or not down at all, which is then said.
        let whole = reply.status == PlanStatus::Ok;
        let is_blocked = reply.status == PlanStatus::GoalInCollision && reply.reason.contains("touch");
        short += u32::from(reply.status == PlanStatus::Intermediate);
        assert!(
            whole || (held == HELD_BELOW_ELBOW && (reply.status == PlanStatus::Intermediate || is_blocked)),
            "{held:?}: {}",
            reply.reason
        );
        assert_eq!(whole, reply.reason.is_empty());
        if is_blocked {
            continue;
        }
        for point in &reply.trajectory.points {
            for &joint in held {
                assert_eq!((point.q[joint], point.qd[joint]), (request.start[joint], 0.0));
            }
        }
        let PlanGoal::Pick { center, .. } = request.goal else { unreachable!() };
        let tip = tip(&model, &request, &end(&reply));
        let off = (tip * Point::from(model.grasp_for_request(&request).center) - center).norm();
        assert!(!whole || off < 0.0121, "the grasp centre is {off} m off, {held:?}");
        assert_eq!(planner(&model).solve(&request), reply, "the same request, the same plan");
    }
    assert!(short >= 2, "three joints go part of the way in {short} of six postures");
}

#[test]
fn what_part_of_an_arm_does_not_reach_is_said_and_so_are_joints_that_there_are_not() {
    let model = model();
    let far =
        PlanRequest { held_joints: HELD_BELOW_ELBOW.to_vec(), ..pick(&model, BLOCK, 0.0, start(&model)) };
    let reply = planner(&model).solve(&far);
    assert!(!matches!(reply.status, PlanStatus::Ok | PlanStatus::Invalid), "{reply:?}");
    assert!(!reply.reason.is_empty());
    for (held, words) in [(vec![9], "[9] of 7 angles"), ((0..7).collect(), "nothing to plan")] {
        let reply = planner(&model).solve(&PlanRequest { held_joints: held, ..far.clone() });
        assert_eq!(reply.status, PlanStatus::Invalid);
        assert!(reply.reason.contains(words), "{}", reply.reason);
    }
}

#[test]
fn a_cube_is_gripped_by_two_faces_however_it_stands() {
    let model = model();
    let cube = Shape::Box { size: [0.025; 3] };
    for yaw in [0.0, 0.4, 0.8, 1.2] {
        let request = pick(&model, cube, yaw, start(&model));
        let reply = planner(&model).solve(&request);
        assert_eq!((reply.status, reply.reason.as_str()), (PlanStatus::Ok, ""), "turned by {yaw}");
        let grasp = model.grasp_for_request(&request);
        let tip = tip(&model, &request, &end(&reply));
        let PlanGoal::Pick { center, .. } = request.goal else { unreachable!() };
        assert!((tip * Point::from(grasp.center) - center).norm() < 1e-4);
        let closing = tip.rotation * grasp.closing_direction.unwrap();
        let off = (closing.y.atan2(closing.x) - yaw).rem_euclid(std::f64::consts::FRAC_PI_2);
        let off = off.min(std::f64::consts::FRAC_PI_2 - off);
        assert!(off < 0.03, "the digits close {off} rad off a face, the cube turned by {yaw}");
    }
}
