//! The person who wears the arm, in the planner's way.
#![allow(clippy::unwrap_used)]

mod common;

use common::*;
use proact_planning::{CollisionScene, PersonGeometry, PlannerOptions, person_obstacles};
use proact_types::{PlanGoal, PlanStatus, Point, Pose, TrunkPosture, joints};

/// From here the set-up `seated` reaches everything.
fn leaning() -> Pose {
    let [forward, lateral, axial] = [24.0_f64, -18.0, 28.0].map(f64::to_radians);
    seated(TrunkPosture { forward, lateral, axial })
}

#[test]
fn every_block_is_still_picked_and_placed_past_the_person() {
    let model = model();
    let mut planner = planner(PlannerOptions::default());
    for (base, person) in [(still(), PersonGeometry::STANDING), (leaning(), PersonGeometry::SEATED)] {
        for region in BlockRegion::ALL {
            let picked = planner.solve(&with_person(pick(&model, base, region, 1), &person));
            assert_eq!((picked.status, picked.reason.as_str()), (PlanStatus::Ok, ""), "pick {region:?}");
            let q = &picked.trajectory.points.last().unwrap().q;
            for to in BlockRegion::ALL {
                let request = with_person(place(&model, base, region, target(to), q, 1), &person);
                let placed = planner.solve(&request);
                assert_eq!(
                    (placed.status, placed.reason.as_str()),
                    (PlanStatus::Ok, ""),
                    "{region:?} {to:?}"
                );
            }
        }
    }
}

#[test]
fn an_arm_across_the_chest_or_at_the_head_is_a_collision() {
    let model = model();
    let mut planner = planner(PlannerOptions::default());
    let mut scene = CollisionScene::new(&model).unwrap();
    let person = person_obstacles(&Pose::identity(), &PersonGeometry::SEATED);
    scene.set_hand(&pose_of(&model, "hand", "open")).unwrap();
    // Of many postures some fold the arm onto every part that it can reach.
    let mut touched: Vec<String> = Vec::new();
    for n in 1..6000 {
        // Multiples of square roots of primes fill the ranges evenly.
        let share = |k: usize| (f64::from(n) * [2.0_f64, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0][k].sqrt()).fract();
        let limits = model.arm.iter().map(|&joint| model.joints[joint].limits);
        let q: Vec<f64> = limits.enumerate().map(|(k, l)| l.lower + share(k) * (l.upper - l.lower)).collect();
        scene.set_obstacles(&person).unwrap();
        for (_, part) in scene.collisions(&q).unwrap() {
            if part.starts_with("person") && !touched.contains(&part) {
                touched.push(part);
                // As a goal such a posture is refused, with the part's name.
                let mut request =
                    with_person(pick(&model, still(), BlockRegion::FL, 1), &PersonGeometry::STANDING);
                request.goal = PlanGoal::Joints { q: joints(&q) };
                let reply = planner.solve(&request);
                assert_ne!(reply.status, PlanStatus::Ok);
            }
        }
    }
    for part in ["person_trunk", "person_head"] {
        assert!(touched.iter().any(|t| t == part), "{part} is never met: {touched:?}");
    }
}

#[test]
fn trunk_and_head_lean_about_the_hip_while_the_legs_keep_still() {
    let upright = person_obstacles(&seated(TrunkPosture::default()), &PersonGeometry::SEATED);
    let leant = person_obstacles(&leaning(), &PersonGeometry::SEATED);
    let moved = |name: &str| {
        let at = |all: &[proact_types::Obstacle]| all.iter().find(|o| o.name == name).unwrap().pose;
        (at(&upright).translation.vector - at(&leant).translation.vector).norm()
    };
    assert!(moved("person_head") > 0.2 && moved("person_trunk") > 0.05);
    for leg in ["person_thigh_left", "person_thigh_right", "person_shank_left", "person_shank_right"] {
        assert!(moved(leg) < 1e-9, "{leg}");
    }
    // The hip pivot of the set-up, 0.45 m below the shoulder on the midline.
    let trunk = upright.iter().find(|o| o.name == "person_trunk").unwrap();
    assert!((trunk.pose.translation.vector - Point::new(-0.6, 0.0, 0.995).coords).xy().norm() < 1e-9);
}
