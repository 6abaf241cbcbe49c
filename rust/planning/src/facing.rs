//! A hand that closes in one direction, turned so that it grips a box by two of its faces.

use crate::context::PlanningContext;
use crate::problem::Problem;
use crate::reach::{self, Reach};
use nalgebra::{Unit, UnitQuaternion};
use proact_types::{PlanGoal, Shape, Vector};

/// An axis of a box that is further than this from level is none to grip along: the sine of 30 degrees.
const LEVEL: f64 = 0.5;
/// A closing direction this near to a face's normal is along it, rad.
const ALONG: f64 = 0.02;

/// Arm angles of a pick, and how far its closing direction is from the nearest face's normal, rad.
pub(crate) type Faced = (Vec<f64>, f64);

/// `end`, which does what `reach` asks, with the hand turned about the vertical onto the faces of the box that is
/// picked: the nearest turn that the arm can do first, and `end` itself last. `end` alone if the grasp closes in no single
/// direction or what is picked is no box.
pub(crate) fn faced(context: &PlanningContext, problem: &Problem, reach: &Reach, end: &[f64]) -> Vec<Faced> {
    let as_it_is = |off: f64| vec![(end.to_vec(), off)];
    let normals = normals(problem);
    let (Some(closing), false) = (problem.grasp.closing, normals.is_empty()) else { return as_it_is(0.0) };
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
    let least = turns.first().map_or(0.0, |turn| turn.abs());
    if least < ALONG {
        return as_it_is(0.0);
    }
    let turned = turns.iter().find_map(|turn| {
        let orientation = Some(UnitQuaternion::from_axis_angle(&up, *turn) * rotation);
        reach::solve(&context.chain, &context.limits, &Reach { orientation, ..*reach }, end)
    });
    turned.map(|q| (q, 0.0)).into_iter().chain(as_it_is(least)).collect()
}

/// True if the hand has to be turned onto faces of what is picked.
pub(crate) fn has_faces(problem: &Problem) -> bool {
    problem.grasp.closing.is_some() && !normals(problem).is_empty()
}

/// Level directions, base frame, along which the box that is picked is as wide as the grasp is for.
fn normals(problem: &Problem) -> Vec<Vector> {
    let request = problem.request;
    let (PlanGoal::Pick { .. }, Some(picked)) = (&request.goal, &request.picked) else { return Vec::new() };
    let Some(obstacle) = request.obstacles.iter().find(|o| o.name == *picked) else { return Vec::new() };
    let Shape::Box { size } = obstacle.shape else { return Vec::new() };
    let rotation = problem.base_from_world.rotation * obstacle.pose.rotation;
    let axes = [Vector::x(), Vector::y(), Vector::z()].into_iter().zip(size);
    axes.filter(|(_, size)| problem.grasp.holds(*size))
        .map(|(axis, _)| rotation * axis)
        .filter(|axis| axis.dot(&problem.up).abs() < LEVEL)
        .collect()
}
