//! How long plans take beside what many tries find.

mod common;

use common::*;
use proact_planning::{ArmPlanner, PlannerOptions};
use proact_types::{PlanRequest, PlanStatus, Trajectory};

/// Tries of other seeds, each with other goals and other paths.
const TRIES: u64 = 25;

/// Length in joint space, rad (L2), and duration, s.
fn measures(trajectory: &Trajectory) -> [f64; 2] {
    let motion = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    let length = trajectory.points.windows(2).map(|pair| motion(&pair[0].q, &pair[1].q)).sum();
    [length, trajectory.duration_secs()]
}

fn plan(planner: &mut ArmPlanner, request: &PlanRequest) -> Trajectory {
    let reply = planner.solve(request);
    assert_eq!(reply.status, PlanStatus::Ok, "{}", reply.reason);
    reply.trajectory
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[test]
fn a_plan_is_nearly_as_short_and_as_quick_as_the_best_of_many() {
    let model = model();
    let mut planner = planner(PlannerOptions::default());
    let mut requests = Vec::new();
    for from in BlockRegion::ALL {
        let reach = pick(&model, still(), from, 1);
        let gripped = plan(&mut planner, &reach).points.last().expect("a plan has an end").q.clone();
        requests.push(reach);
        requests.extend(BlockRegion::ALL.map(|to| place(&model, still(), from, target(to), &gripped, 1)));
    }
    let mut ratios = [Vec::new(), Vec::new()];
    for request in requests {
        let once = measures(&plan(&mut planner, &request));
        let mut best = once;
        for seed in 2..2 + TRIES {
            let other = measures(&plan(&mut planner, &PlanRequest { seed, ..request.clone() }));
            best = [best[0].min(other[0]), best[1].min(other[1])];
        }
        (0..2).for_each(|k| ratios[k].push(once[k] / best[k]));
    }
    let [length, duration] = ratios.map(median);
    assert!(length < 1.05 && duration < 1.05, "length {length}, duration {duration} times the best");
}
