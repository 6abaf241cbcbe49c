//! A hand that closes in one direction, turned so that it grips a box by two of its faces.

use crate::axis_ik::{self, IkGoal};
use crate::context::PlanningContext;
use crate::problem::PlanProblem;
use nalgebra::{Unit, UnitQuaternion};
use proact_types::{PlanGoal, Shape, Vector};

/// An axis of a box that is further than this from level is none to grip along: the sine of 30 degrees.
const MAX_AXIS_TILT_SINE: f64 = 0.5;
/// A closing direction this near to a face's normal is along it, rad.
const ALIGNED_TOLERANCE_RAD: f64 = 0.02;

/// Arm angles of a pick, and how far its closing direction is from the nearest face's normal, rad.
pub(crate) type AlignedPosture = (Vec<f64>, f64);

/// `end`, which does what `reach` asks, with the hand turned about the vertical onto the faces of the box that is
/// picked: the nearest turn that the arm can do first, and `end` itself last. `end` alone if the grasp closes in no single
/// direction or what is picked is no box.
pub(crate) fn align_to_faces(
    context: &PlanningContext,
    problem: &PlanProblem,
    reach: &IkGoal,
    end: &[f64],
) -> Vec<AlignedPosture> {
    let as_it_is = |off: f64| vec![(end.to_vec(), off)];
    let normals = face_normals(problem);
    let (Some(closing), false) = (problem.grasp.closing_direction, normals.is_empty()) else {
        return as_it_is(0.0);
    };
    let rotation = context.chain.forward(end).rotation;
    let up = Unit::new_normalize(problem.up);
    let level = |v: Vector| v - *up * up.dot(&v);
    let closing = level(rotation * closing);
    let mut turns: Vec<f64> = normals
        .iter()
        .flat_map(|normal| [*normal, -normal])
        .map(|normal| closing.cross(&normal).dot(&up).atan2(closing.dot(&normal)))
        .collect();
    turns.sort_by(|a, b| a.abs().total_cmp(&b.abs()));
    let min_turn = turns.first().map_or(0.0, |turn| turn.abs());
    if min_turn < ALIGNED_TOLERANCE_RAD {
        return as_it_is(0.0);
    }
    let turned = turns.iter().find_map(|turn| {
        let orientation = Some(UnitQuaternion::from_axis_angle(&up, *turn) * rotation);
        axis_ik::solve_ik(&context.chain, &context.limits, &IkGoal { orientation, ..*reach }, end)
    });
    turned.map(|q| (q, 0.0)).into_iter().chain(as_it_is(min_turn)).collect()
}

/// True if the hand has to be turned onto faces of what is picked.
pub(crate) fn needs_face_alignment(problem: &PlanProblem) -> bool {
    problem.grasp.closing_direction.is_some() && !face_normals(problem).is_empty()
}

/// Level directions, base frame, along which the box that is picked is as wide as the grasp is for.
fn face_normals(problem: &PlanProblem) -> Vec<Vector> {
    let request = problem.request;
    let (PlanGoal::Pick { .. }, Some(picked)) = (&request.goal, &request.picked_object) else {
        return Vec::new();
    };
    let Some(obstacle) = request.obstacles.iter().find(|o| o.name == *picked) else { return Vec::new() };
    let Shape::Box { size } = obstacle.shape else { return Vec::new() };
    let rotation = problem.base_from_world.rotation * obstacle.pose.rotation;
    let axes = [Vector::x(), Vector::y(), Vector::z()].into_iter().zip(size);
    axes.filter(|(_, size)| problem.grasp.fits_width(*size))
        .map(|(axis, _)| rotation * axis)
        .filter(|axis| axis.dot(&problem.up).abs() < MAX_AXIS_TILT_SINE)
        .collect()
}
