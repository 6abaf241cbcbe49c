//! What action goals ask for, and how they end.

use crate::{
    action::GoalId,
    controllers::{GoalTolerances, Tolerance},
    messages::{
        actionlib_msgs::GoalStatus,
        control_msgs::{
            FollowJointTrajectoryActionResult, FollowJointTrajectoryGoal, FollowJointTrajectoryResult,
            JointTolerance,
        },
        mpl_control::graspActionResult,
        std_msgs::Header,
    },
    node::convert,
};
use proact_types::SimTime;

/// A client may leave the name of its goal empty; the server then gives one.
pub(super) fn with_default_id(mut id: GoalId, now: SimTime) -> GoalId {
    if id.id.is_empty() {
        id.id = format!("{}-{}", rosrust::name(), now.0);
    }
    id
}

pub(super) fn follow_result(
    code: i32,
    text: &str,
) -> impl Fn(Header, GoalStatus) -> FollowJointTrajectoryActionResult + use<> {
    let result = FollowJointTrajectoryResult { error_code: code, error_string: text.to_owned() };
    move |header, status| FollowJointTrajectoryActionResult { header, status, result: result.clone() }
}

pub(super) fn grasp_result(done: i32) -> impl Fn(Header, GoalStatus) -> graspActionResult {
    move |header, status| {
        let mut message = graspActionResult { header, status, ..Default::default() };
        message.result.done = done;
        message
    }
}

/// A goal's tolerances: what it leaves at 0 is the controller's own, -1 (or less) means none.
pub(super) fn tolerances(
    names: &[String],
    goal: &FollowJointTrajectoryGoal,
) -> Result<GoalTolerances, String> {
    let mut all = GoalTolerances::defaults(names.len());
    let set = |into: &mut [Tolerance], given: &[JointTolerance]| -> Result<(), String> {
        for tolerance in given {
            let k = names.iter().position(|n| *n == tolerance.name).ok_or_else(|| {
                format!("a tolerance names joint {:?}, which the controller does not have", tolerance.name)
            })?;
            for (value, into) in [
                (tolerance.position, &mut into[k].position),
                (tolerance.velocity, &mut into[k].velocity),
                (tolerance.acceleration, &mut into[k].acceleration),
            ] {
                if !value.is_finite() {
                    return Err(format!("a tolerance of {} is {value}", tolerance.name));
                }
                if value != 0.0 {
                    *into = value.max(0.0);
                }
            }
        }
        Ok(())
    };
    set(&mut all.path, &goal.path_tolerance)?;
    set(&mut all.goal, &goal.goal_tolerance)?;
    let time = convert::seconds(&goal.goal_time_tolerance);
    if time > 0.0 {
        all.goal_time_secs = time;
    }
    Ok(all)
}
