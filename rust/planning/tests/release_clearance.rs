//! Where a block is let go, the fingers have room to open.
#![allow(clippy::unwrap_used)]

mod common;

use common::*;
use proact_planning::PlannerOptions;
use proact_types::{PlanStatus, Pose, TrunkPosture};

/// Hands on the way from closed to open that are looked at.
const HANDS: usize = 20;

/// Set-ups from which every target is in reach: still, and leaning as a seated person does.
fn bases() -> [Pose; 2] {
    let lean = TrunkPosture {
        forward: 24_f64.to_radians(),
        lateral: -12_f64.to_radians(),
        axial: 38_f64.to_radians(),
    };
    [still(), seated(lean)]
}

#[test]
fn the_fingers_touch_nothing_while_they_let_a_block_go() {
    let model = model();
    let open = pose_of(&model, "hand", "open");
    let (mut checker, mut planner) = (planner(PlannerOptions::default()), planner(PlannerOptions::default()));
    let (mut place_count, mut cramped) = (0, Vec::new());
    for (base, seed) in bases().into_iter().flat_map(|base| (1..=3).map(move |seed| (base, seed))) {
        for from in BlockRegion::ALL {
            let picked = planner.solve(&pick(&model, base, from, seed));
            assert_eq!(picked.status, PlanStatus::Ok, "{}", picked.reason);
            let grip = &picked.trajectory.points.last().unwrap().q;
            for to in BlockRegion::ALL {
                let request = place(&model, base, from, target(to), grip, seed);
                let reply = planner.solve(&request);
                assert_eq!(reply.status, PlanStatus::Ok, "{from:?} to {to:?}: {}", reply.reason);
                let end = &reply.trajectory.points.last().unwrap().q;
                place_count += 1;
                for step in 1..=HANDS {
                    let share = step as f64 / HANDS as f64;
                    let mix = |(from, to): (&f64, &f64)| from + share * (to - from);
                    let hand: Vec<f64> = request.hand.iter().zip(&open).map(mix).collect();
                    let touching = checker.collisions(end, &hand, &request.obstacles, None, &base).unwrap();
                    if let Some((a, b)) = touching.first() {
                        cramped.push(format!("seed {seed}, {from:?} to {to:?}: {a} and {b}, {share} open"));
                        break;
                    }
                }
            }
        }
    }
    assert!(cramped.is_empty(), "{} of {place_count} places:\n{}", cramped.len(), cramped.join("\n"));
}
