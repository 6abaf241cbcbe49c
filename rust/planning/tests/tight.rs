//! Goals with hardly any clearance, and corners that are rounded.
#![allow(clippy::unwrap_used)]

mod common;

use common::*;
use proact_planning::{PlannerOptions, SearchLimits};
use proact_types::{Obstacle, PlanGoal, PlanRequest, PlanStatus, Pose, Shape, joints};

/// A ball that comes this close to the hand along a line, metres.
const HAIR: f64 = 2e-4;

/// The request with a ball beside the hand at the goal, and the angles of that goal.
fn beside_a_ball() -> PlanRequest {
    let model = model();
    let mut request = pick(&model, still(), Region::NM, 1);
    let mut goal = request.start.to_vec();
    goal[0] -= 0.3;
    goal[3] -= 0.2;
    request.goal = PlanGoal::Joints { q: joints(&goal) };
    let mut planner = planner(PlannerOptions::default());
    let base_from_tip = proact_kinematics::ArmKinematics::forward(&mut kinematics(&model), &goal).unwrap();
    let tip = request.world_from_base * base_from_tip;
    let ball = |away: f64| Obstacle {
        name: "ball".to_owned(),
        shape: Shape::Sphere { radius: 0.03 },
        pose: Pose::translation(tip.translation.x, tip.translation.y, tip.translation.z + away),
    };
    let mut touches = |away: f64| {
        let hit = planner.collisions(&goal, &request.hand, &[ball(away)], None, &request.world_from_base);
        !hit.unwrap().is_empty()
    };
    let (mut near, mut far) = (0.0, 0.5);
    assert!(touches(near) && !touches(far), "the ball is in the hand, then above it");
    while far - near > 1e-6 {
        let middle = 0.5 * (near + far);
        if touches(middle) { near = middle } else { far = middle }
    }
    request.obstacles.push(ball(far + HAIR));
    request
}

#[test]
fn a_goal_a_hair_from_something_is_reached_without_a_touch() {
    let request = beside_a_ball();
    let mut planner = planner(PlannerOptions::default());
    let reply = planner.solve(&request);
    assert_eq!(reply.status, PlanStatus::Ok, "{}", reply.reason);
    for point in &reply.trajectory.points {
        let hit =
            planner.collisions(&point.q, &request.hand, &request.obstacles, None, &request.world_from_base);
        assert_eq!(hit.unwrap(), [], "at {} s", point.time_secs);
    }
}

#[test]
fn further_searches_make_plans_no_slower_on_the_whole() {
    let model = model();
    let secs = |more_searches: u32| -> f64 {
        let search = SearchLimits { more_searches, ..SearchLimits::default() };
        let mut planner = planner(PlannerOptions { search, ..PlannerOptions::default() });
        let plan = |(region, seed)| {
            let reply = planner.solve(&pick(&model, still(), region, seed));
            assert_eq!(reply.status, PlanStatus::Ok, "{}", reply.reason);
            reply.trajectory.duration_secs()
        };
        Region::ALL.into_iter().flat_map(|region| [(region, 1), (region, 2)]).map(plan).sum()
    };
    let (once, often) = (secs(0), secs(4));
    assert!(often <= once, "{often} s of motion after further searches, {once} s without");
}
