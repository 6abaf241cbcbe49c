//! Joints that turn for ever: the planner goes the shorter way round and keeps counting turns.
#![allow(clippy::unwrap_used)]

mod common;

use proact_arm::{ArmModel, JointKind, JointLimits};
use proact_description::ArmFolder;
use proact_planning::{ArmPlanner, PlannerOptions};
use proact_types::{PlanGoal, PlanStatus, joints};
use std::{f64::consts::TAU, sync::Arc};

fn continuous_palm_model() -> Arc<ArmModel> {
    let mut model = ArmFolder::shipped("wam").unwrap().model().unwrap();
    let palm = &mut model.joints[*model.arm.last().unwrap()];
    palm.kind = JointKind::Continuous;
    (palm.limits.lower, palm.limits.upper) =
        (-JointLimits::CONTINUOUS_RANGE_RAD, JointLimits::CONTINUOUS_RANGE_RAD);
    Arc::new(model)
}

#[test]
fn a_goal_two_turns_away_is_as_near_as_the_same_angle_and_the_turns_stay_counted() {
    let model = continuous_palm_model();
    let kinematics = Box::new(common::kinematics(&model));
    let mut planner = ArmPlanner::new(model.clone(), kinematics, PlannerOptions::default()).unwrap();
    let stand = model.settings.fixed_base.unwrap().xyz;
    let mut request = common::pick(
        &model,
        proact_types::Pose::translation(stand.x, stand.y, stand.z),
        common::BlockRegion::NM,
        1,
    );
    request.obstacles.clear();
    request.start[6] = 3.0 * TAU + 0.2;
    let mut goal = request.start.to_vec();
    goal[6] = TAU + 0.7;
    request.goal = PlanGoal::Joints { q: joints(&goal) };
    let reply = planner.solve(&request);
    assert_eq!(reply.status, PlanStatus::Ok, "{}", reply.reason);
    let path: Vec<f64> = reply.trajectory.points.iter().map(|point| point.q[6]).collect();
    assert!((path[0] - request.start[6]).abs() < 1e-9, "{path:?}");
    assert!((path[path.len() - 1] - (3.0 * TAU + 0.7)).abs() < 1e-9, "{path:?}");
    assert!(path.iter().all(|angle| (angle - request.start[6]).abs() < 1.0), "the shorter way: {path:?}");
}
