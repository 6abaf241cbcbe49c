//! Which picks and places can be planned in the box scene, and how long that takes.
//!
//!     cargo run --release -p proact-planning --example reach_table -- still
//!     cargo run --release -p proact-planning --example reach_table -- seated
//!     cargo run --release -p proact-planning --example reach_table -- seated 24 -18 28
//!     cargo run --release -p proact-planning --example reach_table -- wam
//!
//! The last is any arm that stands by itself, where it stands or at the x, y, z that follow.
//!
//! Without a lean (forward, lateral, axial, degrees) a grid of leans is tried with one seed each, otherwise
//! twenty seeds.

#![allow(clippy::disallowed_methods)] // a program that measures

#[path = "../tests/common/mod.rs"]
mod common;

use common::{BlockRegion, model, pick, place, seated, still, target, with_person};
use proact_planning::{ArmPlanner, PersonGeometry, PlannerOptions};
use proact_types::{PlanReply, Pose, TrunkPosture};
use std::time::Instant;

fn main() {
    let mode = std::env::args().nth(1).unwrap_or_else(|| "still".to_owned());
    let (model, kinematics) = match proact_description::ArmFolder::shipped(&mode) {
        Some(folder) => {
            let model = std::sync::Arc::new(folder.model().expect("what ships can be read"));
            let kinematics = common::kinematics(&model);
            (model, kinematics)
        }
        None => (model(), common::kinematics(&model())),
    };
    let options = PlannerOptions::default();
    let mut planner =
        ArmPlanner::new(model.clone(), Box::new(kinematics), options).expect("the arm can be planned for");
    // With PERSON set, the one who wears the arm stands or sits in the way.
    let person = std::env::var_os("PERSON")
        .map(|_| if mode == "still" { PersonGeometry::STANDING } else { PersonGeometry::SEATED });
    let mut solve = |request: &proact_types::PlanRequest| -> (PlanReply, f64) {
        let request = match &person {
            Some(person) => &with_person(request.clone(), person),
            None => request,
        };
        let begin = Instant::now();
        let reply = planner.solve(request);
        (reply, begin.elapsed().as_secs_f64() * 1e3)
    };
    let mut coordinates: Vec<f64> = std::env::args().skip(2).filter_map(|text| text.parse().ok()).collect();
    if let (Some(stand), []) = (model.settings.fixed_base, coordinates.as_slice()) {
        coordinates.extend(stand.xyz.iter());
    }
    let bases: Vec<(String, Pose)> = match (mode.as_str(), coordinates.as_slice()) {
        ("still", _) => vec![("still".to_owned(), still())],
        (_, &[x, y, z]) if model.settings.fixed_base.is_some() => {
            vec![(format!("{x} {y} {z}"), Pose::translation(x, y, z))]
        }
        (_, &[forward, lateral, axial]) => vec![named(lean(forward, lateral, axial))],
        _ => leans().into_iter().map(named).collect(),
    };
    let seeds = if bases.len() == 1 { 20 } else { 1 };
    for region in BlockRegion::ALL {
        for (name, base) in &bases {
            let mut times = Vec::new();
            for seed in 1..=seeds {
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
                    for to in BlockRegion::ALL {
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
                all.push(lean(forward, lateral, axial));
            }
        }
    }
    all
}

/// From degrees.
fn lean(forward: f64, lateral: f64, axial: f64) -> TrunkPosture {
    TrunkPosture { forward: forward.to_radians(), lateral: lateral.to_radians(), axial: axial.to_radians() }
}

fn named(posture: TrunkPosture) -> (String, Pose) {
    let degrees = [posture.forward, posture.lateral, posture.axial].map(|a| a.to_degrees().round() as i32);
    (format!("{degrees:?}"), seated(posture))
}
