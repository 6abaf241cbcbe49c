//! Which picks and places can be planned in the box scene, and how long that takes.
//!
//!     cargo run --release -p proact-planning --example reach_table -- still
//!     cargo run --release -p proact-planning --example reach_table -- seated

#![allow(clippy::disallowed_methods)] // a program that measures

#[path = "../tests/common/mod.rs"]
mod common;

use common::{model, pick, place, planner, seated, still, target};
use proact_planning::PlannerOptions;
use proact_types::{PlanReply, Pose, Region, TrunkPosture};
use std::time::Instant;

fn main() {
    let mode = std::env::args().nth(1).unwrap_or_else(|| "still".to_owned());
    let model = model();
    let mut planner = planner(PlannerOptions::default());
    let mut solve = |request: &proact_types::PlanRequest| -> (PlanReply, f64) {
        let begin = Instant::now();
        let reply = planner.solve(request);
        (reply, begin.elapsed().as_secs_f64() * 1e3)
    };
    let bases: Vec<(String, Pose)> = if mode == "still" {
        vec![("still".to_owned(), still())]
    } else {
        leans().into_iter().map(|p| (format!("{:?}", degrees(&p)), seated(p))).collect()
    };
    for region in Region::ALL {
        for (name, base) in &bases {
            let mut times = Vec::new();
            for seed in 1..=(if mode == "still" { 20 } else { 1 }) {
                let request = pick(&model, *base, region, seed);
                let (picked, pick_ms) = solve(&request);
                let mut line = format!(
                    "{name} pick {region:?} seed {seed} {:?} {pick_ms:.1} ms {:.2} s {}",
                    picked.status,
                    picked.trajectory.duration_secs(),
                    picked.reason
                );
                if picked.status == proact_types::PlanStatus::Ok {
                    let end = &picked.trajectory.points[picked.trajectory.points.len() - 1].q;
                    for to in Region::ALL {
                        let request = place(&model, *base, region, target(to), end, seed);
                        let (placed, place_ms) = solve(&request);
                        line += &format!(
                            "\n    place {to:?} {:?} {place_ms:.1} ms {:.2} s {}",
                            placed.status,
                            placed.trajectory.duration_secs(),
                            placed.reason
                        );
                        times.push(place_ms);
                    }
                }
                times.push(pick_ms);
                println!("{line}");
            }
            times.sort_by(f64::total_cmp);
            println!(
                "== {name} {region:?}: median {:.1} ms, max {:.1} ms",
                times[times.len() / 2],
                times[times.len() - 1]
            );
        }
    }
}

fn leans() -> Vec<TrunkPosture> {
    let mut all = Vec::new();
    for forward in [0.0, 12.0, 24.0, 34.0] {
        for lateral in [-24.0, -12.0, 0.0, 12.0, 24.0] {
            for axial in [-20.0, 0.0, 20.0, 38.0] {
                all.push(TrunkPosture {
                    forward: f64::to_radians(forward),
                    lateral: f64::to_radians(lateral),
                    axial: f64::to_radians(axial),
                });
            }
        }
    }
    all
}

fn degrees(p: &TrunkPosture) -> [i32; 3] {
    [p.forward, p.lateral, p.axial].map(|a| a.to_degrees().round() as i32)
}
