//! The judge of every path: link poses by the arm's own model and contacts by Parry, so that neither FCL nor KDL has a
//! say in whether what they led to is free.

use parry3d_f64::bounding_volume::{Aabb, BoundingVolume};
use parry3d_f64::math::{Pose as ParryPose, Rotation, Vector as ParryVector};
use parry3d_f64::query::{distance, intersection_test};
use parry3d_f64::shape::{Ball, Capsule, Cuboid, Cylinder, Shape as ParryShape};
use proact_arm::ArmModel;
use proact_types::{JointVector, Obstacle, PlanGoal, PlanRequest, Pose, Shape, Trajectory};
use std::error::Error;
use std::sync::Arc;

/// Between two states that are looked at no shape moves farther than this, metres, nor turns by more, rad.
const STEP_M: f64 = 0.001;
const STEP_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// Time between the states of which the next to look at is chosen, seconds: at 0.5 rad/s in every joint a
/// fingertip moves a third of a millimetre.
const CANDIDATE_STEP_SECS: f64 = 0.0002;
/// Time between the states at which the clearance is measured, seconds: a fingertip moves by less than 2 mm.
const CLEARANCE_STEP_SECS: f64 = 0.005;
/// Clearances from this on are not told apart, metres.
const MAX_CLEARANCE_M: f64 = 0.02;

/// Two things that touch on the way.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct PathContact {
    pub time_secs: f64,
    pub a: String,
    pub b: String,
}

/// A shape of a link, or of the carried object.
struct RobotShape {
    link: usize,
    name: String,
    /// 0 for what stands still with the base, k for what moves with arm joint k - 1.
    body: usize,
    link_from_shape: Pose,
    shape: Box<dyn ParryShape>,
    /// Farthest point from the shape's origin, metres.
    radius_m: f64,
    carried: bool,
}

/// An obstacle, ready.
struct ObstacleShape {
    name: String,
    shape: Box<dyn ParryShape>,
    pose: ParryPose,
    aabb: Aabb,
}

/// Checks trajectories of one arm.
pub(super) struct IndependentChecker {
    model: Arc<ArmModel>,
    body_of_link: Vec<usize>,
}

impl IndependentChecker {
    pub(super) fn new(model: Arc<ArmModel>) -> Self {
        let mut body_of_link = vec![0; model.links.len()];
        for joint in &model.joints {
            let opens = model.arm.iter().position(|&j| model.joints[j].child == joint.child);
            body_of_link[joint.child] = opens.map_or(body_of_link[joint.parent], |k| k + 1);
        }
        Self { model, body_of_link }
    }

    /// The first contact on the way. None if nothing touches, but for what belongs to
    /// the purpose: the hand at the block that it grips, and a gripped block that still stands on the table.
    pub(super) fn first_contact(
        &self,
        request: &PlanRequest,
        trajectory: &Trajectory,
    ) -> Result<Option<PathContact>, Box<dyn Error>> {
        let parts = self.robot_shapes(request);
        let gripped = match &request.goal {
            PlanGoal::Pick { .. } => request.picked_object.as_deref(),
            _ => None,
        };
        let things = obstacle_shapes(request, gripped);
        let mut checked_poses: Option<Vec<Pose>> = None;
        let mut world_from_link = Vec::new();
        let count = (trajectory.duration_secs() / CANDIDATE_STEP_SECS).ceil() as usize;
        for k in 0..=count {
            let time = k as f64 * CANDIDATE_STEP_SECS;
            let Some((q, _)) = trajectory.sample(time) else { break };
            let angles: JointVector = q.iter().chain(&request.hand).copied().collect();
            self.model.link_poses_into(&request.world_from_base, &angles, &mut world_from_link);
            let far =
                checked_poses.as_ref().is_none_or(|before| moves_a_step(&parts, before, &world_from_link));
            if !far && k != count {
                continue;
            }
            if let Some((a, b)) = self.find_contact(&parts, &things, &world_from_link)? {
                return Ok(Some(PathContact { time_secs: time, a, b }));
            }
            checked_poses = Some(world_from_link.clone());
        }
        Ok(None)
    }

    /// The smallest distance, metres, of the arm and what it carries from the obstacles, over the states that are more than
    /// `ends` metres of the tip's path away from both ends; [`MAX_CLEARANCE_M`] at most. None if there is no such state.
    pub(super) fn min_clearance_m(
        &self,
        request: &PlanRequest,
        trajectory: &Trajectory,
        ends: f64,
    ) -> Result<Option<f64>, Box<dyn Error>> {
        let parts = self.robot_shapes(request);
        let things = obstacle_shapes(request, None);
        let count = (trajectory.duration_secs() / CLEARANCE_STEP_SECS).ceil() as usize;
        let mut states = Vec::with_capacity(count + 1);
        let mut tip_path = 0.0;
        for k in 0..=count {
            let Some((q, _)) = trajectory.sample(k as f64 * CLEARANCE_STEP_SECS) else { break };
            let angles: JointVector = q.iter().chain(&request.hand).copied().collect();
            let mut world_from_link = Vec::new();
            self.model.link_poses_into(&request.world_from_base, &angles, &mut world_from_link);
            let tip = world_from_link[self.model.tip].translation.vector;
            if let Some((_, before)) = states.last() {
                let before: &Vec<Pose> = before;
                tip_path += (tip - before[self.model.tip].translation.vector).norm();
            }
            states.push((tip_path, world_from_link));
        }
        let away = |at: f64| at > ends && tip_path - at > ends;
        let mut min_clearance = None;
        for (_, world_from_link) in states.iter().filter(|(at, _)| away(*at)) {
            let here = min_distance_m(&parts, &things, world_from_link)?;
            min_clearance = Some(min_clearance.map_or(here, |min: f64| min.min(here)));
        }
        Ok(min_clearance)
    }

    fn robot_shapes(&self, request: &PlanRequest) -> Vec<RobotShape> {
        let mut parts = Vec::new();
        for (link, entry) in self.model.links.iter().enumerate() {
            for collision in &entry.collisions {
                parts.push(self.robot_shape(link, &entry.name, &collision.shape, &collision.pose, false));
            }
        }
        if let Some(object) = &request.attached {
            let tip = self.model.tip;
            parts.push(self.robot_shape(tip, &object.name, &object.shape, &object.tip_from_object, true));
        }
        parts
    }

    fn robot_shape(&self, link: usize, name: &str, shape: &Shape, pose: &Pose, carried: bool) -> RobotShape {
        let (parry, turn) = parry_shape(shape);
        let radius = parry.compute_local_aabb().half_extents().length();
        let (name, body) = (name.to_owned(), self.body_of_link[link]);
        RobotShape { link, name, body, link_from_shape: pose * turn, shape: parry, radius_m: radius, carried }
    }

    fn find_contact(
        &self,
        parts: &[RobotShape],
        things: &[ObstacleShape],
        world_from_link: &[Pose],
    ) -> Result<Option<(String, String)>, Box<dyn Error>> {
        let placed: Vec<(ParryPose, Aabb)> = parts
            .iter()
            .map(|part| {
                let pose = parry_pose(&(world_from_link[part.link] * part.link_from_shape));
                (pose, part.shape.compute_aabb(&pose))
            })
            .collect();
        for (part, (pose, aabb)) in parts.iter().zip(&placed) {
            for thing in things {
                let stands = part.carried && thing.name == "table";
                if part.body > 0
                    && !stands
                    && aabb.intersects(&thing.aabb)
                    && shapes_intersect(pose, &*part.shape, &thing.pose, &*thing.shape)?
                {
                    return Ok(Some((part.name.clone(), thing.name.clone())));
                }
            }
        }
        for (a, (a_pose, a_box)) in parts.iter().zip(&placed) {
            for (b, (b_pose, b_box)) in parts.iter().zip(&placed) {
                let pair = (a.link.min(b.link), a.link.max(b.link));
                let may = || !a.carried && !b.carried && self.model.allowed_collisions.contains(&pair);
                if a.body < b.body
                    && a_box.intersects(b_box)
                    && !may()
                    && shapes_intersect(a_pose, &*a.shape, b_pose, &*b.shape)?
                {
                    return Ok(Some((a.name.clone(), b.name.clone())));
                }
            }
        }
        Ok(None)
    }
}

/// The obstacles of `request`, but for the one called `gripped`.
fn obstacle_shapes(request: &PlanRequest, gripped: Option<&str>) -> Vec<ObstacleShape> {
    let thing = |o: &Obstacle| {
        let (shape, turn) = parry_shape(&o.shape);
        let pose = parry_pose(&(o.pose * turn));
        ObstacleShape { name: o.name.clone(), aabb: shape.compute_aabb(&pose), shape, pose }
    };
    request.obstacles.iter().filter(|o| Some(o.name.as_str()) != gripped).map(thing).collect()
}

/// The smallest distance of a moving part from a thing, metres, [`MAX_CLEARANCE_M`] at most.
fn min_distance_m(
    parts: &[RobotShape],
    things: &[ObstacleShape],
    world_from_link: &[Pose],
) -> Result<f64, Box<dyn Error>> {
    let mut min_clearance = MAX_CLEARANCE_M;
    for part in parts.iter().filter(|part| part.body > 0) {
        let pose = parry_pose(&(world_from_link[part.link] * part.link_from_shape));
        let aabb = part.shape.compute_aabb(&pose).loosened(MAX_CLEARANCE_M);
        for thing in things.iter().filter(|thing| aabb.intersects(&thing.aabb)) {
            let separation = distance(&pose, &*part.shape, &thing.pose, &*thing.shape)
                .map_err(|error| format!("Parry measures no such shapes: {error:?}"))?;
            min_clearance = min_clearance.min(separation.distance);
        }
    }
    Ok(min_clearance)
}

/// True if a shape is about to move by a whole step between the two states.
fn moves_a_step(parts: &[RobotShape], before: &[Pose], now: &[Pose]) -> bool {
    // What one more state could add is left out of the step.
    const SHARE: f64 = 0.6;
    parts.iter().any(|part| {
        let (a, b) = (before[part.link] * part.link_from_shape, now[part.link] * part.link_from_shape);
        let turned = a.rotation.angle_to(&b.rotation);
        let shifted = (a.translation.vector - b.translation.vector).norm();
        turned > SHARE * STEP_RAD || shifted + turned * part.radius_m > SHARE * STEP_M
    })
}

/// A shape, and the turn from its axis along z to Parry's along y.
fn parry_shape(shape: &Shape) -> (Box<dyn ParryShape>, Pose) {
    let turn = Pose::rotation(nalgebra::Vector3::x() * std::f64::consts::FRAC_PI_2);
    match *shape {
        Shape::Box { size: [x, y, z] } => {
            (Box::new(Cuboid::new(ParryVector::new(x / 2.0, y / 2.0, z / 2.0))), Pose::identity())
        }
        Shape::Sphere { radius } => (Box::new(Ball::new(radius)), Pose::identity()),
        Shape::Cylinder { radius, length } => (Box::new(Cylinder::new(length / 2.0, radius)), turn),
        Shape::Capsule { radius, length } => (Box::new(Capsule::new_y(length / 2.0, radius)), turn),
    }
}

fn parry_pose(pose: &Pose) -> ParryPose {
    let (p, r) = (pose.translation.vector, pose.rotation.coords);
    ParryPose::from_parts(ParryVector::new(p.x, p.y, p.z), Rotation::from_xyzw(r.x, r.y, r.z, r.w))
}

fn shapes_intersect(
    a_pose: &ParryPose,
    a: &dyn ParryShape,
    b_pose: &ParryPose,
    b: &dyn ParryShape,
) -> Result<bool, Box<dyn Error>> {
    match intersection_test(a_pose, a, b_pose, b) {
        Ok(answer) => Ok(answer.intersecting),
        Err(error) => Err(format!("Parry compares no such shapes: {error:?}").into()),
    }
}
