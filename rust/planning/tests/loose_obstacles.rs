//! What lies loose, as in a heap: it may be touched on the way into a grip and dropped, but nowhere else.
#![allow(clippy::unwrap_used)]

mod common;

use common::*;
use proact_kinematics::ArmKinematics;
use proact_planning::PlannerOptions;
use proact_types::{Obstacle, PlanGoal, PlanReply, PlanRequest, PlanStatus, Point, Pose, Shape};

/// Side of the cubes, metres.
const SIDE: f64 = 0.025;

/// Of their centres above the table: so high that the closed hand has room below, metres.
const HEIGHT: f64 = 0.06;

/// A pick of a cube that eight others stand around, side by side.
fn crowded_pick_request(loose: bool) -> PlanRequest {
    let mut request = pick(&model(), still(), BlockRegion::NM, 1);
    let center = block_center(BlockRegion::NM);
    let at =
        |x: f64, y: f64| Point::new(center.x + x * SIDE, center.y + y * SIDE, scene().table_height + HEIGHT);
    let cube = |name: &str, at: Point| Obstacle {
        name: name.to_owned(),
        shape: Shape::Box { size: [SIDE - 1e-3, SIDE - 1e-3, SIDE] },
        pose: Pose::translation(at.x, at.y, at.z),
        loose,
    };
    request.obstacles.retain(|o| Some(&o.name) != request.picked_object.as_ref());
    request.obstacles.push(cube("picked", at(0.0, 0.0)));
    for (x, y) in [(-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)] {
        request.obstacles.push(cube(&format!("beside {x} {y}"), at(f64::from(x), f64::from(y))));
    }
    request.picked_object = Some("picked".to_owned());
    if let PlanGoal::Pick { center, .. } = &mut request.goal {
        *center = at(0.0, 0.0);
    }
    request
}

/// Arm angles at the end of the plan.
fn end_of(reply: &PlanReply) -> Vec<f64> {
    reply.trajectory.points.last().unwrap().q.to_vec()
}

/// Of the tip, above the origin of `world`, metres.
fn height(request: &PlanRequest, q: &[f64]) -> f64 {
    (request.world_from_base * kinematics(&model()).forward(q).unwrap()).translation.z
}

#[test]
fn a_cube_among_others_is_taken_where_they_lie_loose_and_only_there() {
    let mut planner = planner(PlannerOptions::default());
    let refused = planner.solve(&crowded_pick_request(false));
    assert_eq!(refused.status, PlanStatus::GoalInCollision, "{}", refused.reason);

    let request = crowded_pick_request(true);
    let reply = planner.solve(&request);
    assert_eq!(reply.status, PlanStatus::Ok, "{}", reply.reason);
    let mut touched = 0;
    for point in &reply.trajectory.points {
        let pairs = planner
            .collisions(&point.q, &request.hand, &request.obstacles, None, &request.world_from_base)
            .unwrap();
        for (link, other) in pairs {
            assert!(other.starts_with("beside") || other == "picked", "{link} touches {other}");
            touched += 1;
        }
    }
    assert!(touched > 0, "between cubes that touch each other there is no way without a contact");
    // From above them all nothing is touched: contacts are those of the last way down.
    let half = &reply.trajectory.points[reply.trajectory.points.len() / 4];
    let early =
        planner.collisions(&half.q, &request.hand, &request.obstacles, None, &request.world_from_base);
    assert!(early.unwrap().is_empty());
}

#[test]
fn what_cannot_be_put_down_is_dropped_if_it_lies_loose() {
    let model = model();
    let mut planner = planner(PlannerOptions::default());
    let picked = planner.solve(&pick(&model, still(), BlockRegion::NM, 1));
    // On the table there stands a low box where the block is to go: it would be put into it.
    let mut request = place(&model, still(), BlockRegion::NM, target(BlockRegion::NM), &end_of(&picked), 1);
    let at = target(BlockRegion::NM);
    request.obstacles.push(Obstacle {
        name: "step".to_owned(),
        shape: Shape::Box { size: [0.12, 0.12, 0.04] },
        pose: Pose::translation(at.x, at.y, at.z + 0.02),
        loose: false,
    });
    let stood = planner.solve(&request);
    assert_ne!(stood.status, PlanStatus::Ok);
    if let Some(object) = &mut request.attached {
        object.loose = true;
    }
    let dropped = planner.solve(&request);
    assert_eq!(dropped.status, PlanStatus::Ok, "{}", dropped.reason);
    let above = height(&request, &end_of(&dropped)) - height(&request, &request.start);
    assert!((0.04..0.25).contains(&above), "it is let go of {above} m above where it was gripped");
}
