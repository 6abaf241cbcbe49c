//! How long a running plan goes on after a cancel.
//!
//!     cargo run --release -p proact-planning --example cancel_latency

#![allow(clippy::disallowed_methods)] // a program that measures

#[path = "../tests/common/mod.rs"]
mod common;

use common::{BlockRegion, model, pick, planner, still, target};
use proact_planning::{PlanWorker, PlannerOptions};
use proact_testbed::ports::PlanService;
use proact_types::PlanStatus;
use std::time::{Duration, Instant};

fn main() {
    let model = model();
    let mut planner_alone = planner(PlannerOptions::default());
    let picked = planner_alone.solve(&pick(&model, still(), BlockRegion::NM, 1));
    let grip = &picked.trajectory.points[picked.trajectory.points.len() - 1].q;
    let mut worker = PlanWorker::new(planner(PlannerOptions::default()));
    let mut late_ms = Vec::new();
    for id in 1..=500 {
        let mut request = common::place(&model, still(), BlockRegion::NM, target(BlockRegion::FL), grip, id);
        request.id = id;
        worker.submit(request);
        // Cancels at moments spread over the whole of a plan.
        std::thread::sleep(Duration::from_micros(37 * (id % 200)));
        let begin = Instant::now();
        worker.cancel();
        let reply = worker.wait(id);
        if reply.status == PlanStatus::Cancelled {
            late_ms.push(begin.elapsed().as_secs_f64() * 1e3);
        }
    }
    late_ms.sort_by(f64::total_cmp);
    let at = |share: f64| late_ms[((late_ms.len() - 1) as f64 * share) as usize];
    println!(
        "{} cancelled: median {:.2} ms, 99 % {:.2} ms, most {:.2} ms",
        late_ms.len(),
        at(0.5),
        at(0.99),
        at(1.0)
    );
}
