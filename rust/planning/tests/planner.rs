//! Picks, places and their failures in the box scene.
#![allow(clippy::unwrap_used)]

mod common;

use common::*;
use proact_kinematics::{ArmKinematics, Kinematics};
use proact_planning::{
    ArmPlanner, CancelFlag, CollisionScene, MeshObstacle, PlannerName, PlannerOptions, PlanningError,
    SearchLimits, SearchOutcome,
};
use proact_types::{
    ObjectId, PlanGoal, PlanReply, PlanRequest, PlanStatus, Point, Pose, Shape, Trajectory, TrunkPosture,
    Vector, joints,
};
use std::cell::RefCell;

/// How deep two shapes may overlap along a plan, metres: the straight paths are checked at steps of 5 mm, and
/// neighbouring states are at most that far apart.
const MIN_CLEARANCE_M: f64 = 0.001;

fn end(reply: &PlanReply) -> Vec<f64> {
    reply.trajectory.points.last().expect("a plan has points").q.to_vec()
}

/// `world_from_tip` at the arm angles `q`.
fn tip(request: &PlanRequest, q: &[f64]) -> Pose {
    thread_local!(static KINEMATICS: RefCell<Kinematics> = RefCell::new(kinematics(&model())));
    KINEMATICS.with_borrow_mut(|kinematics| request.world_from_base * kinematics.forward(q).unwrap())
}

fn samples(trajectory: &Trajectory, every_secs: f64) -> Vec<Vec<f64>> {
    let count = (trajectory.duration_secs() / every_secs).ceil() as usize;
    (0..=count).map(|k| trajectory.sample(k as f64 * every_secs).unwrap().0.to_vec()).collect()
}

/// Contacts along a plan at steps of 10 ms (5 mrad a joint), but for those that already exist at its start.
fn contacts_along(
    checker: &mut ArmPlanner,
    request: &PlanRequest,
    reply: &PlanReply,
) -> Vec<(String, String)> {
    // Shrunk obstacles: what touches them is inside the true ones by more than the close call.
    let shrunk: Vec<_> = request
        .obstacles
        .iter()
        .map(|o| {
            let mut o = o.clone();
            if let Shape::Box { size } = &mut o.shape {
                size.iter_mut().for_each(|s| *s -= 2.0 * MIN_CLEARANCE_M);
            } else if let Shape::Cylinder { radius, length } = &mut o.shape {
                *radius -= MIN_CLEARANCE_M;
                *length -= 2.0 * MIN_CLEARANCE_M;
            }
            o
        })
        .collect();
    let mut at = |q: &[f64]| {
        let attached = request.attached.as_ref();
        checker.collisions(q, &request.hand, &shrunk, attached, &request.world_from_base).unwrap()
    };
    let known = at(&request.start);
    let mut found = Vec::new();
    for q in samples(&reply.trajectory, 0.01) {
        found.extend(at(&q).into_iter().filter(|pair| !known.contains(pair)));
    }
    found.sort();
    found.dedup();
    found
}

/// Where everything can be reached without standing up, as in the set-up `seated`.
fn leaning() -> Pose {
    seated(TrunkPosture {
        forward: 24_f64.to_radians(),
        lateral: -12_f64.to_radians(),
        axial: 38_f64.to_radians(),
    })
}

#[test]
fn every_block_is_gripped_from_above_and_put_down_upright_on_every_target_without_a_contact() {
    let model = model();
    let mut planner = planner(PlannerOptions::default());
    let mut checker = common::planner(PlannerOptions::default());
    for (base, seed) in [(still(), 1), (still(), 2), (leaning(), 3)] {
        for region in BlockRegion::ALL {
            let request = pick(&model, base, region, seed);
            let reply = planner.solve(&request);
            assert_eq!((reply.status, reply.reason.as_str()), (PlanStatus::Ok, ""), "pick {region:?}");
            let q = end(&reply);
            let gripped = tip(&request, &q) * Point::from(model.widest_grasp().center);
            assert!((gripped - block_center(region)).norm() < 1e-4, "the grasp centre is at the block");
            assert_eq!(contacts_along(&mut checker, &request, &reply), [], "pick {region:?}");

            for to in BlockRegion::ALL {
                let request = place(&model, base, region, target(to), &q, seed);
                let reply = planner.solve(&request);
                assert_eq!(
                    (reply.status, reply.reason.as_str()),
                    (PlanStatus::Ok, ""),
                    "{region:?} to {to:?}"
                );
                let object = request.attached.as_ref().unwrap();
                let block = tip(&request, &end(&reply)) * object.tip_from_object;
                let lean = (block.rotation * Vector::z()).angle(&Vector::z());
                let options = planner.options();
                assert!(lean <= options.place_tilt_rad + 1e-3, "it leans by {lean}");
                let bottom = block.translation.z - 0.025 * lean.cos() - 0.025 * lean.sin() - target(to).z;
                assert!((bottom - options.place_gap_m).abs() < 3e-4, "it hangs {bottom} m above the table");
                assert!((block.translation.vector - target(to).coords).xy().norm() < 1e-4);
                let mut contacts = contacts_along(&mut checker, &request, &reply);
                // Picked up in place, the block stands on the table at first; that pair is known.
                contacts.retain(|(_, b)| b != "table");
                assert_eq!(contacts, [], "{region:?} to {to:?}");
            }
        }
    }
}

#[test]
fn after_letting_go_the_open_hand_leaves_a_standing_block_straight_up() {
    let model = model();
    let mut planner = planner(PlannerOptions::default());
    let mut checker = common::planner(PlannerOptions::default());
    for seed in 1..=4 {
        let first = planner.solve(&pick(&model, still(), BlockRegion::NM, seed));
        let there = place(&model, still(), BlockRegion::NM, target(BlockRegion::FM), &end(&first), seed);
        let placed = planner.solve(&there);
        assert_eq!(placed.status, PlanStatus::Ok);
        let object = there.attached.as_ref().unwrap();
        let mut block = tip(&there, &end(&placed)) * object.tip_from_object;
        block.translation.z = target(BlockRegion::FM).z + 0.025;

        let mut request = pick(&model, still(), BlockRegion::FL, seed);
        request.start = joints(&end(&placed));
        let moved = block_name(BlockRegion::NM);
        request.obstacles.iter_mut().find(|o| o.name == moved).unwrap().pose = block;
        let reply = planner.solve(&request);
        assert_eq!((reply.status, reply.reason.as_str()), (PlanStatus::Ok, ""));
        // While the grasp centre is less than 4 cm above the block's, it keeps within a finger's width of the axis.
        let path: Vec<Point> = samples(&reply.trajectory, 0.01)
            .iter()
            .map(|q| tip(&request, q) * Point::from(model.widest_grasp().center))
            .collect();
        let low: Vec<_> = path.iter().take_while(|p| p.z < block.translation.z + 0.04).collect();
        assert!(low.len() > 5 && low.len() < path.len());
        for p in low {
            assert!((p.coords - block.translation.vector).xy().norm() < 0.006, "sideways at {p}");
        }
        assert_eq!(contacts_along(&mut checker, &request, &reply), []);
    }
}

#[test]
fn speed_acceleration_and_jerk_stay_within_the_limits_and_both_ends_are_at_rest() {
    let model = model();
    let mut planner = planner(PlannerOptions::default());
    let first = planner.solve(&pick(&model, still(), BlockRegion::FL, 5));
    let second =
        planner.solve(&place(&model, still(), BlockRegion::FL, target(BlockRegion::NM), &end(&first), 5));
    for trajectory in [&first.trajectory, &second.trajectory] {
        let points = &trajectory.points;
        assert!(points.windows(2).all(|w| w[0].time_secs < w[1].time_secs) && points[0].time_secs == 0.0);
        assert!(points[0].qd.iter().chain(&points[points.len() - 1].qd).all(|v| *v == 0.0));
        let step = 1e-3;
        let count = (trajectory.duration_secs() / step) as usize;
        let (mut fastest, mut hardest, mut jerk) = (0.0_f64, 0.0_f64, 0.0_f64);
        let mut last = trajectory.sample(0.0).unwrap();
        for k in 1..=count {
            let now = trajectory.sample(k as f64 * step).unwrap();
            for j in 0..7 {
                fastest = fastest.max(now.1[j].abs());
                hardest = hardest.max((now.1[j] - last.1[j]).abs() / step);
                assert!((now.0[j] - last.0[j]).abs() < 0.51 * step, "a jump of joint {j}");
            }
            last = now;
        }
        assert!(fastest <= 0.5 && fastest > 0.4, "fastest {fastest} rad/s");
        assert!(hardest <= 1.0 && hardest > 0.6, "hardest {hardest} rad/s^2");
        // Over 20 ms, twice the time between points: the cubics between them have steps of acceleration.
        let over = 0.02;
        let speed = |t: f64, j: usize| trajectory.sample(t).unwrap().1[j];
        for k in 1..(trajectory.duration_secs() / over) as usize {
            for j in 0..7 {
                let t = k as f64 * over;
                let third = speed(t + over, j) - 2.0 * speed(t, j) + speed(t - over, j);
                jerk = jerk.max(third.abs() / (over * over));
            }
        }
        assert!(jerk <= 10.0 && jerk > 2.0, "jerk {jerk} rad/s^3");
    }
}

#[test]
fn the_start_of_a_plan_is_the_start_of_the_request() {
    let model = model();
    let mut planner = planner(PlannerOptions::default());
    let mut request = pick(&model, still(), BlockRegion::NL, 1);
    // A measured angle just outside its limit is brought back inside.
    request.start[4] = model.joints[model.arm[4]].limits.upper + 0.01;
    let reply = planner.solve(&request);
    assert_eq!(reply.status, PlanStatus::Ok);
    assert_eq!(reply.trajectory.points[0].q, request.start);
}

#[test]
fn a_block_out_of_reach_gives_a_way_towards_it_that_stays_above_the_table() {
    let model = model();
    let mut planner = planner(PlannerOptions::default());
    let base = seated(TrunkPosture::default());
    let request = pick(&model, base, BlockRegion::FL, 1);
    let reply = planner.solve(&request);
    assert_eq!(reply.status, PlanStatus::Intermediate);
    assert_eq!(reply.reason, "The block is out of the hand's reach.");
    let distance = |q: &[f64]| {
        (tip(&request, q) * Point::from(model.widest_grasp().center) - block_center(BlockRegion::FL)).norm()
    };
    assert!(distance(&end(&reply)) < distance(&request.start) - 0.03, "it brings the hand closer");
    for q in samples(&reply.trajectory, 0.02) {
        assert!(tip(&request, &q).translation.z > 1.015);
    }

    let mut away = pick(&model, base, BlockRegion::FL, 1);
    away.goal = PlanGoal::Pick { object: ObjectId(0), center: Point::new(0.0, 0.0, -50.0) };
    let reply = planner.solve(&away);
    assert_eq!(reply.status, PlanStatus::Unreachable);
    assert!(reply.trajectory.points.is_empty());
}

#[test]
fn a_tip_pose_is_reached_and_one_out_of_reach_is_approached() {
    let model = model();
    let mut planner = planner(PlannerOptions::default());
    let mut request = pick(&model, still(), BlockRegion::FL, 1);
    let q = planner.solve(&request);
    let above = tip(&request, &end(&q)) * Pose::identity();
    let pose = Pose::translation(0.0, 0.0, 0.12) * above;
    request.goal = PlanGoal::TipPose { pose };
    let reply = planner.solve(&request);
    assert_eq!((reply.status, reply.reason.as_str()), (PlanStatus::Ok, ""));
    let reached = tip(&request, &end(&reply));
    assert!((reached.translation.vector - pose.translation.vector).norm() < 1e-4);
    assert!(reached.rotation.angle_to(&pose.rotation) < 1e-3);

    request.goal = PlanGoal::TipPose { pose: Pose::translation(0.6, 0.0, 0.3) * pose };
    let reply = planner.solve(&request);
    assert!(matches!(reply.status, PlanStatus::Intermediate | PlanStatus::Unreachable), "{:?}", reply.status);
    assert!(!reply.reason.is_empty());
}

#[test]
fn what_is_in_the_way_is_named() {
    let model = model();
    let mut planner = planner(PlannerOptions::default());
    let mut request = pick(&model, still(), BlockRegion::FL, 1);
    let goal = end(&planner.solve(&request));
    // The wrist stands where a ball is put.
    let wrist = tip(&request, &goal).translation;
    request.obstacles.push(proact_types::Obstacle {
        name: "ball".to_owned(),
        shape: Shape::Sphere { radius: 0.02 },
        pose: Pose::from_parts(wrist, Default::default()),
        loose: false,
    });
    request.goal = PlanGoal::Joints { q: joints(&goal) };
    let reply = planner.solve(&request);
    assert_eq!(reply.status, PlanStatus::GoalInCollision);
    assert!(reply.reason.contains("ball"), "{}", reply.reason);
}

#[test]
fn a_block_that_can_be_put_down_nowhere_is_still_lifted_out_of_the_box() {
    let model = model();
    let mut planner = planner(PlannerOptions::default());
    let first = planner.solve(&pick(&model, still(), BlockRegion::NM, 1));
    let on_partition = Point::new(0.0, 0.0, 1.015);
    let request = place(&model, still(), BlockRegion::NM, on_partition, &end(&first), 1);
    let reply = planner.solve(&request);
    assert_eq!(reply.status, PlanStatus::Intermediate);
    assert!(reply.reason.contains("partition"), "{}", reply.reason);
    let rise = tip(&request, &end(&reply)).translation.z - tip(&request, &request.start).translation.z;
    assert!((rise - planner.options().lift_height_m).abs() < 0.006, "it rises by {rise}");
}

#[test]
fn a_graze_at_the_start_is_left_upwards_and_a_deep_contact_is_refused() {
    let model = model();
    let mut planner = planner(PlannerOptions::default());
    let picked = planner.solve(&pick(&model, still(), BlockRegion::NM, 1));
    let mut request = pick(&model, still(), BlockRegion::FL, 1);
    request.start = joints(&end(&picked));
    // A slab that reaches a few millimetres into the fingertips, then one that swallows the hand.
    let slab = |top: f64| proact_types::Obstacle {
        name: "slab".to_owned(),
        shape: Shape::Box { size: [0.1, 0.1, 0.2] },
        pose: Pose::translation(-0.058, -0.092, top - 0.1),
        loose: false,
    };
    let touches = |planner: &mut ArmPlanner, top: f64| {
        let slab = [slab(top)];
        !planner
            .collisions(&request.start, &request.hand, &slab, None, &request.world_from_base)
            .unwrap()
            .is_empty()
    };
    let first_contact =
        (0..200).map(|k| 1.0 + f64::from(k) * 1e-3).find(|top| touches(&mut planner, *top)).unwrap();
    request
        .obstacles
        .retain(|o| o.name != "table" && !o.name.starts_with("blue") && !o.name.starts_with("leg"));
    request.obstacles.push(slab(first_contact + 0.004));
    let reply = planner.solve(&request);
    assert_eq!((reply.status, reply.reason.as_str()), (PlanStatus::Ok, ""));
    let rise = reply.trajectory.sample(0.5).unwrap().0;
    assert!(tip(&request, &rise).translation.z > tip(&request, &request.start).translation.z);

    request.obstacles.pop();
    request.obstacles.push(slab(first_contact + 0.05));
    let reply = planner.solve(&request);
    assert_eq!(reply.status, PlanStatus::StartInCollision);
    assert!(reply.reason.contains("slab"), "{}", reply.reason);
}

#[test]
fn a_malformed_request_is_answered_as_invalid_with_what_was_wrong() {
    let model = model();
    let mut planner = planner(PlannerOptions::default());
    let good = pick(&model, still(), BlockRegion::NM, 1);
    let mut ask = |change: &dyn Fn(&mut PlanRequest)| {
        let mut request = good.clone();
        change(&mut request);
        let reply = planner.solve(&request);
        assert_eq!(reply.status, PlanStatus::Invalid, "{}", reply.reason);
        assert!(reply.trajectory.points.is_empty());
        reply.reason
    };
    assert_eq!(ask(&|r| r.start[3] = f64::NAN), "start 3 is NaN, expected a finite number");
    assert_eq!(ask(&|r| r.start.truncate(6)), "start has 6 values, expected 7");
    assert_eq!(ask(&|r| r.start[3] = 3.0), "The start is outside the joint limits.");
    assert_eq!(ask(&|r| r.hand.truncate(19)), "hand has 19 values, expected 20");
    assert_eq!(ask(&|r| r.hand[0] = f64::INFINITY), "hand 0 is inf, expected a finite number");
    assert!(ask(&|r| r.world_from_base.translation.x = f64::NAN).starts_with("base pose 0 is NaN"));
    assert!(ask(&|r| r.obstacles[0].shape = Shape::Sphere { radius: 0.0 }).contains("\"table\": extent 0"));
    assert!(ask(&|r| r.obstacles[1].pose.translation.y = f64::NAN).contains("\"partition\""));
    assert!(ask(&|r| r.obstacles[1].name = "table".to_owned()).contains("two obstacles"));
    let nowhere = PlanGoal::Pick { object: ObjectId(0), center: Point::new(f64::NAN, 0.0, 0.0) };
    assert!(ask(&|r| r.goal = nowhere.clone()).starts_with("block centre 0 is NaN"));
    assert!(ask(&|r| r.goal = PlanGoal::Place { point: Point::origin() }).contains("nothing in the hand"));
    assert_eq!(ask(&|r| r.goal = PlanGoal::Joints { q: joints(&[0.0; 3]) }), "goal has 3 values, expected 7");
    assert!(ask(&|r| r.goal = PlanGoal::Joints { q: joints(&[3.0; 7]) }).contains("joint limits"));
}

#[test]
fn without_obstacles_the_way_is_straight() {
    let model = model();
    let mut planner = planner(PlannerOptions::default());
    let mut request = pick(&model, still(), BlockRegion::NM, 1);
    request.obstacles.clear();
    let goal: Vec<f64> = request.start.iter().map(|q| 0.5 * q).collect();
    request.goal =
        PlanGoal::Joints { q: joints(&[goal[0], goal[1], goal[2], goal[3], goal[4], goal[5], goal[6]]) };
    let reply = planner.solve(&request);
    assert_eq!(reply.status, PlanStatus::Ok);
    for q in samples(&reply.trajectory, 0.01) {
        let share = (q[0] - request.start[0]) / (goal[0] - request.start[0]);
        for j in 0..7 {
            let straight = request.start[j] + share * (goal[j] - request.start[j]);
            assert!((q[j] - straight).abs() < 1e-9);
        }
    }
    // Being there already is a plan of one point.
    request.goal = PlanGoal::Joints { q: request.start.clone() };
    let reply = planner.solve(&request);
    assert_eq!((reply.status, reply.trajectory.points.len()), (PlanStatus::Ok, 1));
}

#[test]
fn options_that_make_no_sense_are_refused_by_name() {
    let model = model();
    let refused = |options: PlannerOptions| {
        let kinematics = Box::new(kinematics(&model));
        ArmPlanner::new(model.clone(), kinematics, options).err().expect("refused").to_string()
    };
    let text = refused(PlannerOptions { max_velocity_rad_per_s: 0.0, ..Default::default() });
    assert_eq!(text, "planner.max_velocity_rad_per_s = 0, expected 0.01 to 100");
    let text = refused(PlannerOptions { padding_m: f64::NAN, ..Default::default() });
    assert_eq!(text, "planner.padding_m = NaN, expected 0 to 1");
}

#[test]
fn the_scene_refuses_what_the_library_would_take() {
    let model = model();
    let mut scene = proact_planning::CollisionScene::new(&model).unwrap();
    let q = pose_of(&model, "arm", "start");
    assert!(matches!(scene.is_free(&q[..6]), Err(PlanningError::WrongLength { got: 6, expected: 7, .. })));
    assert!(matches!(scene.collisions(&[f64::NAN; 7]), Err(PlanningError::NotFinite { index: 0, .. })));
    assert!(matches!(scene.set_hand(&[]), Err(PlanningError::WrongLength { got: 0, expected: 20, .. })));
    let text = scene.allow_contact("no_such_link", "table").unwrap_err().to_string();
    assert_eq!(text, "planning scene: no link or carried object is called \"no_such_link\"");
    scene.set_obstacles(&[]).unwrap();
    assert!(scene.is_free(&q).unwrap());
    let mut flat = (*model).clone();
    flat.links.iter_mut().find(|l| !l.collisions.is_empty()).unwrap().collisions[0].shape =
        Shape::Cylinder { radius: 0.0, length: 1.0 };
    assert!(proact_planning::CollisionScene::new(&flat).err().unwrap().to_string().contains("extent 0"));
}

#[test]
fn every_planner_picks_a_block_twice_alike_and_without_a_contact() {
    let model = model();
    let mut checker = common::planner(PlannerOptions::default());
    let mut ends = Vec::new();
    for planner in PlannerName::ALL {
        assert_eq!(planner.name().parse::<PlannerName>().unwrap(), planner);
        let mut search = SearchLimits::default();
        if planner == PlannerName::RrtStar {
            // It spends all its iterations.
            search.max_iterations = 300;
        }
        let mut options = PlannerOptions { name: planner, search, ..Default::default() };
        if planner == PlannerName::LbKpiece1 {
            options.parameters = [("border_fraction".to_owned(), "0.8".to_owned())].into();
        }
        let request = pick(&model, still(), BlockRegion::FL, 4);
        let reply = common::planner(options.clone()).solve(&request);
        assert_eq!((reply.status, reply.reason.as_str()), (PlanStatus::Ok, ""), "{planner}");
        assert_eq!(contacts_along(&mut checker, &request, &reply), [], "{planner}");
        assert_eq!(common::planner(options).solve(&request), reply, "{planner}");
        ends.push(end(&reply));
    }
    assert_eq!(ends.len(), PlannerName::ALL.len());
}

#[test]
fn unknown_planners_and_parameters_are_refused_with_those_that_there_are() {
    let text = "RRTConect".parse::<PlannerName>().unwrap_err().to_string();
    let known = "RRTConnect, BiTRRT, LBKPIECE1, RRTstar, PRM, AnytimePathShortening";
    assert_eq!(text, format!("planner is \"RRTConect\", expected one of {known}"));
    let model = model();
    let options = PlannerOptions { parameters: [("rnage".into(), "1".into())].into(), ..Default::default() };
    let error =
        ArmPlanner::new(model.clone(), Box::new(kinematics(&model)), options).err().unwrap().to_string();
    assert!(error.contains("no parameter \"rnage\", expected one of ") && error.contains("range"), "{error}");
}

#[test]
fn a_condition_of_ones_own_is_kept_everywhere_and_a_panic_in_it_is_an_error() {
    let model = model();
    let mut scene = CollisionScene::new(&model).unwrap();
    let start = model.pose("arm", "start").unwrap().to_vec();
    let goal: Vec<f64> = start.iter().map(|q| q * 0.5).collect();
    let (limits, cancel) = (SearchLimits::default(), CancelFlag::new());
    let goals = [goal.clone()];
    // A wall across the straight way, in the space of the first two joints.
    let middle = 0.5 * (start[0] + goal[0]);
    let mut checked_count = 0;
    let mut around = |q: &[f64]| {
        checked_count += 1;
        (q[0] - middle).abs() > 0.02 || q[2] > start[2].max(goal[2]) + 0.2
    };
    let found = scene.search_constrained(&start, &goals, 1, &limits, &cancel, &mut around).unwrap();
    let SearchOutcome::Solved { path, .. } = found else { panic!("{found:?}") };
    assert!(path.len() > 2 && path.iter().all(|q| around(q)), "{path:?}");
    assert!(checked_count > 10);
    let mut fails = |_: &[f64]| -> bool { panic!("no idea") };
    let error = scene.search_constrained(&start, &goals, 1, &limits, &cancel, &mut fails).unwrap_err();
    assert!(error.to_string().contains("no idea"), "{error}");
}

#[test]
fn a_mesh_is_in_the_way_of_every_request_and_what_is_carried_cannot_be() {
    let model = model();
    let mut planner = planner(PlannerOptions::default());
    let request = pick(&model, still(), BlockRegion::FL, 1);
    let free = planner.solve(&request);
    assert_eq!(free.status, PlanStatus::Ok);
    let sheet = MeshObstacle {
        name: "sheet".to_owned(),
        vertices: vec![[-0.02, -0.02, 0.0], [0.02, -0.02, 0.0], [0.0, 0.02, 0.0]],
        triangles: vec![[0, 1, 2]],
        pose: tip(&request, &end(&free)),
    };
    planner.set_meshes(vec![sheet.clone()]).unwrap();
    let goal = PlanGoal::Joints { q: joints(&end(&free)) };
    let reply = planner.solve(&PlanRequest { goal, ..request.clone() });
    assert_eq!(reply.status, PlanStatus::GoalInCollision);
    assert!(reply.reason.contains("sheet"), "{}", reply.reason);
    let bad = MeshObstacle { vertices: vec![[f64::NAN, 0.0, 0.0]], ..sheet };
    assert!(planner.set_meshes(vec![bad]).is_err());
    planner.set_meshes(Vec::new()).unwrap();
    assert_eq!(planner.solve(&request), free);

    let mut twice = request.clone();
    twice.attached = Some(proact_types::AttachedObject {
        name: twice.obstacles[twice.obstacles.len() - 1].name.clone(),
        shape: BLOCK,
        tip_from_object: Pose::identity(),
        loose: false,
    });
    let reply = planner.solve(&twice);
    assert_eq!(reply.status, PlanStatus::Invalid);
    assert!(reply.reason.contains("both"), "{}", reply.reason);
}

#[test]
fn a_bound_on_the_time_ends_a_search_without_end_and_a_plan_says_that_the_clock_did_it() {
    let model = model();
    let mut scene = CollisionScene::new(&model).unwrap();
    let start = model.pose("arm", "start").unwrap().to_vec();
    let goal: Vec<f64> = start.iter().map(|q| q * 0.5).collect();
    let middle = 0.5 * (start[0] + goal[0]);
    // A wall with no way round: only the clock ends this.
    let mut shut = |q: &[f64]| (q[0] - middle).abs() > 0.02;
    let limits = SearchLimits { max_iterations: u32::MAX, max_secs: Some(0.05), ..SearchLimits::default() };
    let outcome =
        scene.search_constrained(&start, &[goal], 1, &limits, &CancelFlag::new(), &mut shut).unwrap();
    assert_eq!(outcome, SearchOutcome::NoPlan);

    // A thousandth of a second is too short for any plan.
    let options = PlannerOptions { deadline_secs: Some(1e-3), ..PlannerOptions::default() };
    let mut planner = planner(options);
    let reply = planner.solve(&pick(&model, still(), BlockRegion::FL, 1));
    assert_eq!(reply.status, PlanStatus::NoPlan, "{}", reply.reason);
    assert!(reply.reason.contains("in time"), "{}", reply.reason);
    assert!(planner.stats().timed_out);
    assert_eq!(planner.stats().status, PlanStatus::NoPlan);
}

/// Some reasons said "something" and named nothing.
#[test]
fn a_start_or_goal_in_collision_names_both_links_or_the_link_and_the_obstacle() {
    let model = model();
    let mut planner = planner(PlannerOptions::default());
    let free = planner.solve(&pick(&model, still(), BlockRegion::FL, 1));
    let there = end(&free);
    let mut seen = std::collections::BTreeMap::new();
    // A ball and a slab at the start and at the goal, from a touch to deep inside, for each kind of goal.
    for (at_start, reach) in
        [true, false].into_iter().flat_map(|at| [-0.05, 0.0, 0.03, 0.08].map(|r| (at, r)))
    {
        for (goal, shape) in
            [PlanGoal::Joints { q: joints(&there) }, pick(&model, still(), BlockRegion::FL, 1).goal]
                .into_iter()
                .flat_map(|goal| {
                    [Shape::Sphere { radius: 0.03 }, Shape::Box { size: [0.2, 0.2, 0.02] }]
                        .map(|s| (goal.clone(), s))
                })
        {
            let mut request = pick(&model, still(), BlockRegion::FL, 1);
            request.goal = goal;
            let near = if at_start { request.start.to_vec() } else { there.clone() };
            let mut pose = tip(&request, &near);
            pose.translation.z += reach;
            let pose = Pose::from_parts(pose.translation, Default::default());
            request.obstacles.push(proact_types::Obstacle {
                name: "thing".to_owned(),
                shape,
                pose,
                loose: false,
            });
            let reply = planner.solve(&request);
            if !matches!(reply.status, PlanStatus::StartInCollision | PlanStatus::GoalInCollision) {
                continue;
            }
            *seen.entry(format!("{:?}", reply.status)).or_insert(0) += 1;
            let names = model.links.iter().map(|link| link.name.as_str());
            let names = names.chain(request.obstacles.iter().map(|o| o.name.as_str()));
            let named: std::collections::BTreeSet<&str> = names
                .filter(|name| reply.reason.split([' ', '.', ':', ',']).any(|word| word == *name))
                .collect();
            assert!(named.len() >= 2, "{:?}: {} names {named:?}", reply.status, reply.reason);
            assert_eq!(planner.stats().reason, reply.reason, "the plans log has the same");
        }
    }
    assert_eq!(seen.len(), 2, "both kinds came up: {seen:?}");
}
