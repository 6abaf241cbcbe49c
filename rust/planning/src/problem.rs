//! A request in the planner's own terms.

use crate::PlanningError;
use crate::context::PlanningContext;
use crate::error::check_vector;
use crate::failure::PlanFailure;
use proact_arm::Grasp;
use proact_types::{Obstacle, PlanGoal, PlanRequest, PlanStatus, Point, Pose, Vector};

/// A request in the planner's own terms.
pub(crate) struct PlanProblem<'a> {
    pub request: &'a PlanRequest,
    pub base_from_world: Pose,
    /// The start, inside the joint limits.
    pub start: Vec<f64>,
    /// Straight up, base frame.
    pub up: Vector,
    /// How the hand grips what is picked or carried.
    pub grasp: Grasp,
    /// Names of the obstacles near the hand, at its start or at what it picks, that it may push aside.
    pub loose_obstacles: Vec<String>,
}

/// How far from a grip a hand can touch something on its straight way there, metres: half a hand and half an object.
const GRIP_NEIGHBORHOOD_M: f64 = 0.15;

/// Largest overshoot of a joint limit at the start that is taken for noise of the measurement, rad.
pub(crate) const LIMIT_TOLERANCE_RAD: f64 = 0.05;

impl<'a> PlanProblem<'a> {
    /// Checks the request and puts its scene up.
    pub fn from_request(
        context: &mut PlanningContext,
        request: &'a PlanRequest,
    ) -> Result<Self, PlanFailure> {
        let joints = context.model.arm.len();
        check_vector("start", &request.start, joints)?;
        match &request.goal {
            PlanGoal::Pick { center, .. } => check_vector("block centre", center.coords.as_slice(), 3)?,
            PlanGoal::Place { point } => {
                check_vector("place", point.coords.as_slice(), 3)?;
                if request.attached.is_none() {
                    return Err(PlanFailure::new(
                        PlanStatus::Invalid,
                        "There is nothing in the hand to place.",
                    ));
                }
            }
            PlanGoal::Joints { q } => check_vector("goal", q, joints)?,
            PlanGoal::TipPose { pose } => {
                let p = pose.translation.vector;
                let r = pose.rotation.coords;
                check_vector("goal pose", &[p.x, p.y, p.z, r.x, r.y, r.z, r.w], 7)?;
            }
        }
        context.set_scene(
            &request.hand,
            &request.obstacles,
            request.attached.as_ref(),
            &request.world_from_base,
        )?;
        if let Some(carried) = &request.attached
            && request.obstacles.iter().any(|o| o.name == carried.name)
        {
            let reason = format!("{} is both in the hand and in the way.", carried.name);
            return Err(PlanFailure::new(PlanStatus::Invalid, reason));
        }
        if !context.limits.contains(&request.start, LIMIT_TOLERANCE_RAD) {
            return Err(PlanFailure::new(PlanStatus::Invalid, "The start is outside the joint limits."));
        }
        let base_from_world = request.world_from_base.inverse();
        let up = base_from_world.rotation * Vector::z();
        let grasp = context.model.grasp_for_request(request).clone();
        let start = context.limits.clamp(&request.start);
        let world_from_tip =
            request.world_from_base * context.kinematics.forward(&start).map_err(PlanningError::from)?;
        let mut grips = vec![world_from_tip * Point::from(grasp.center)];
        if let PlanGoal::Pick { center, .. } = &request.goal {
            grips.push(*center);
        }
        let is_near = |o: &&Obstacle| {
            grips.iter().any(|grip| (o.pose.translation.vector - grip.coords).norm() < GRIP_NEIGHBORHOOD_M)
        };
        let loose =
            request.obstacles.iter().filter(|o| o.loose && request.picked_object.as_ref() != Some(&o.name));
        let loose = loose.filter(is_near).map(|o| o.name.clone()).collect();
        Ok(Self { request, base_from_world, start, up, grasp, loose_obstacles: loose })
    }
}
