//! A request in the planner's own terms.

use crate::PlanningError;
use crate::context::PlanningContext;
use crate::error::check;
use crate::failure::Failure;
use proact_arm::Grasp;
use proact_types::{Obstacle, PlanGoal, PlanRequest, PlanStatus, Point, Pose, Vector};

/// A request in the planner's own terms.
pub(crate) struct Problem<'a> {
    pub request: &'a PlanRequest,
    pub base_from_world: Pose,
    /// The start, inside the joint limits.
    pub start: Vec<f64>,
    /// Straight up, base frame.
    pub up: Vector,
    /// How the hand grips what is picked or carried.
    pub grasp: Grasp,
    /// Names of the obstacles near the hand, at its start or at what it picks, that it may push aside.
    pub loose: Vec<String>,
}

/// How far from a grip a hand can touch something on its straight way there, metres: half a hand and half an object.
const AROUND_GRIP: f64 = 0.15;

/// Largest overshoot of a joint limit at the start that is taken for noise of the measurement, rad.
pub(crate) const LIMIT_SLACK: f64 = 0.05;

impl<'a> Problem<'a> {
    /// Checks the request and puts its scene up.
    pub fn accept(context: &mut PlanningContext, request: &'a PlanRequest) -> Result<Self, Failure> {
        let joints = context.model.arm.len();
        check("start", &request.start, joints)?;
        match &request.goal {
            PlanGoal::Pick { centre, .. } => check("block centre", centre.coords.as_slice(), 3)?,
            PlanGoal::Place { point } => {
                check("place", point.coords.as_slice(), 3)?;
                if request.attached.is_none() {
                    return Err(Failure::new(PlanStatus::Invalid, "There is nothing in the hand to place."));
                }
            }
            PlanGoal::Joints { q } => check("goal", q, joints)?,
            PlanGoal::TipPose { pose } => {
                let p = pose.translation.vector;
                let r = pose.rotation.coords;
                check("goal pose", &[p.x, p.y, p.z, r.x, r.y, r.z, r.w], 7)?;
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
            return Err(Failure::new(PlanStatus::Invalid, reason));
        }
        if !context.limits.contain(&request.start, LIMIT_SLACK) {
            return Err(Failure::new(PlanStatus::Invalid, "The start is outside the joint limits."));
        }
        let base_from_world = request.world_from_base.inverse();
        let up = base_from_world.rotation * Vector::z();
        let grasp = context.model.grasp_of(request).clone();
        let start = context.limits.clamp(&request.start);
        let world_from_tip =
            request.world_from_base * context.kinematics.forward(&start).map_err(PlanningError::from)?;
        let mut grips = vec![world_from_tip * Point::from(grasp.centre)];
        if let PlanGoal::Pick { centre, .. } = &request.goal {
            grips.push(*centre);
        }
        let is_near = |o: &&Obstacle| {
            grips.iter().any(|grip| (o.pose.translation.vector - grip.coords).norm() < AROUND_GRIP)
        };
        let loose = request.obstacles.iter().filter(|o| o.loose && request.picked.as_ref() != Some(&o.name));
        let loose = loose.filter(is_near).map(|o| o.name.clone()).collect();
        Ok(Self { request, base_from_world, start, up, grasp, loose })
    }
}
