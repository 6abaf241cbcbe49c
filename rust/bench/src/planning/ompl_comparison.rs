//! What the plans are compared with: a plain program on OMPL and FCL, and planning for seconds instead of
//! milliseconds.

use super::{BenchRun, path_length_rad};
use crate::{BenchFigure, quantile};
use proact_app::trial;
use proact_devices::EmgOrigin;
use proact_planning::{PlanWorker, PlannerName, PlannerOptions, SearchLimits};
use proact_testbed::{Setup, TrialConfig, ports::PlanService};
use proact_types::{PlanRequest, PlanStatus, Trajectory, TrajectoryPoint, joints};
use std::{
    error::Error,
    time::{Duration, Instant},
};

/// Processor time of one of the plain program's attempts, seconds: as long as the original's took on the clock.
const ATTEMPT_CPU_SECS: f64 = 0.5;
/// Stack of the thread in which it searches, bytes; memory that is never touched costs nothing.
const SEARCH_STACK_BYTES: usize = 1 << 30;
/// Speed at which a plain path is walked for the check, rad/s.
const PATH_SPEED_RAD_PER_S: f64 = 0.5;
/// Plans that are cancelled, and the problems that they are for.
const CANCEL_COUNT: usize = 200;
const CANCELLED_PROBLEMS: usize = 10;
/// How long the best of many plans is looked for, seconds.
const LONG_SEARCH_SECS: f64 = 5.0;

/// One problem beside the plain program.
pub(super) struct SearchComparison {
    /// Processor time of the whole plan, ms.
    ours_ms: f64,
    plain_ompl: [PlainOmplSearch; PEERS.len()],
}

#[derive(Clone, Copy)]
struct PlainOmplSearch {
    /// Processor time of all attempts, ms, and of their searches alone, without simplification.
    time_ms: f64,
    search_ms: f64,
    attempts: u32,
    found: bool,
    /// The path touches something, unpadded, at fine steps.
    in_contact: bool,
}

/// The plain program's planners, the original's and the one that is the default here, and the shares of the joint
/// space's extent in whose steps they look at motions: the original's, and one at which paths keep clear of things.
const PEERS: [(PlannerName, f64); 4] = [
    (PlannerName::LbKpiece1, 0.005),
    (PlannerName::RrtConnect, 0.005),
    (PlannerName::LbKpiece1, 0.0005),
    (PlannerName::RrtConnect, 0.0005),
];

impl BenchRun {
    /// Searches by the plain program between the two ends of the part of a plan that keeps clear by the padding.
    /// It is handed the arm angles of the goal, which our time includes the search for.
    pub(super) fn compare_with_plain_ompl(
        &mut self,
        request: &PlanRequest,
        trajectory: &Trajectory,
        ours_ms: f64,
    ) -> Result<(), Box<dyn Error>> {
        let scene = &mut self.scene;
        scene.set_base(&request.world_from_base)?;
        scene.set_hand(&request.hand)?;
        scene.set_obstacles(&request.obstacles)?;
        scene.set_attached(request.attached.as_ref())?;
        scene.set_padding(PlannerOptions::default().padding_m)?;
        let mut clear = Vec::new();
        for point in &trajectory.points {
            if scene.is_free(&point.q)? {
                clear.push(point.q.to_vec());
            }
        }
        let [from, .., to] = clear.as_slice() else { return Ok(()) };
        let none =
            PlainOmplSearch { time_ms: 0.0, search_ms: 0.0, attempts: 0, found: false, in_contact: false };
        let mut all = [none; PEERS.len()];
        for (plain, (planner, steps)) in all.iter_mut().zip(PEERS) {
            let goals = std::slice::from_ref(to);
            // LBKPIECE1 frees failed branches by recursion, as deep as they are long.
            let outcome = std::thread::scope(|scope| {
                let search =
                    || scene.search_baseline(from, goals, planner, ATTEMPT_CPU_SECS, steps, request.seed);
                let thread =
                    std::thread::Builder::new().stack_size(SEARCH_STACK_BYTES).spawn_scoped(scope, search)?;
                thread.join().map_err(|_| "the plain search panicked")?.map_err(Box::<dyn Error>::from)
            })?;
            *plain = PlainOmplSearch {
                attempts: outcome.attempts,
                time_ms: outcome.cpu_secs * 1e3,
                search_ms: outcome.search_secs * 1e3,
                found: !outcome.path.is_empty(),
                in_contact: self
                    .checker
                    .first_contact(request, &constant_speed_trajectory(&outcome.path))?
                    .is_some(),
            };
        }
        self.searches.push(SearchComparison { ours_ms, plain_ompl: all });
        Ok(())
    }

    pub(super) fn search_figures(&self) -> Vec<BenchFigure> {
        let all = &self.searches;
        if all.is_empty() {
            return Vec::new();
        }
        let mut figures = Vec::new();
        for (k, (planner, steps)) in PEERS.into_iter().enumerate() {
            let title = format!("beside plain {planner} in steps of {steps}");
            let mut add = |name: &str, unit: &str, value: f64, peer_value: f64, note: &str| {
                figures.push(BenchFigure {
                    peer: Some("a plain program on OMPL and FCL".to_owned()),
                    peer_value: Some(peer_value),
                    ..BenchFigure::without_peer(&format!("{title}: {name}"), value, unit, note)
                });
            };
            let share = |of: fn(&PlainOmplSearch) -> bool| {
                all.iter().filter(|s| of(&s.plain_ompl[k])).count() as f64 / all.len() as f64
            };
            add("found in one attempt", "1", 1.0, share(|p| p.found && p.attempts == 1), "");
            add("found", "1", 1.0, share(|p| p.found), "");
            let honest = share(|p| p.found && !p.in_contact);
            add("solved", "1", 1.0, honest, "without a contact by Parry, every 1 mm and 0.5 degrees");
            let both: Vec<&SearchComparison> =
                all.iter().filter(|s| s.plain_ompl[k].found && !s.plain_ompl[k].in_contact).collect();
            for (of, those) in [("", all.iter().collect()), (", solved by both", both)] {
                if those.is_empty() {
                    continue;
                }
                let at = |quantity: fn(&SearchComparison, usize) -> f64, share: f64| {
                    quantile(&those.iter().map(|s| quantity(s, k)).collect::<Vec<f64>>(), share)
                };
                let [median, high] =
                    [0.5, 0.99].map(|q| (at(|s, _| s.ours_ms, q), at(|s, k| s.plain_ompl[k].time_ms, q)));
                let (search, rest) = (
                    at(|s, k| s.plain_ompl[k].search_ms, 0.5),
                    at(|s, k| s.plain_ompl[k].time_ms - s.plain_ompl[k].search_ms, 0.5),
                );
                let note = format!(
                    "{} problems, processor time; ours from request to timed path; the peer's from arm angles to arm angles, up to eight attempts of {ATTEMPT_CPU_SECS} s: search {search:.1} ms, simplification {rest:.1} ms at the median",
                    those.len()
                );
                add(&format!("median{of}"), "ms", median.0, median.1, &note);
                add(&format!("99 %{of}"), "ms", high.0, high.1, "");
                add(
                    &format!("times faster at the median{of}"),
                    "1",
                    median.1 / median.0,
                    1.0,
                    "goal: at least 5",
                );
            }
        }
        figures
    }

    /// Length and duration beside what five seconds of planning give: by OMPL's anytime shortening for those goals that
    /// one request finds, and, harder, the best of all plans by other seeds, which find other goals.
    pub(super) fn compare_with_long_searches(&mut self) -> Result<Vec<BenchFigure>, Box<dyn Error>> {
        let search = SearchLimits {
            max_iterations: u32::MAX,
            max_secs: Some(LONG_SEARCH_SECS),
            ..SearchLimits::default()
        };
        let anytime =
            PlannerOptions { name: PlannerName::AnytimePathShortening, search, ..PlannerOptions::default() };
        let mut anytime = super::planner(&self.model, anytime)?;
        // By [anytime, other seeds], [length, duration].
        let mut ratios: [[Vec<f64>; 2]; 2] = Default::default();
        for (request, length_once, duration_once) in std::mem::take(&mut self.long_search_requests) {
            let once = [length_once, duration_once];
            let long = anytime.solve(&request);
            if long.status == PlanStatus::Ok {
                let long = [path_length_rad(&long.trajectory), long.trajectory.duration_secs()];
                (0..2).for_each(|k| ratios[0][k].push(once[k] / long[k]));
            }
            let mut best = once;
            let (mut seed, mut spent) = (request.seed, 0.0);
            while spent < LONG_SEARCH_SECS {
                seed = seed.wrapping_add(1);
                let reply = self.planner.solve(&PlanRequest { seed, ..request.clone() });
                spent += self.planner.stats().cpu_secs;
                if reply.status == PlanStatus::Ok {
                    best[0] = best[0].min(path_length_rad(&reply.trajectory));
                    best[1] = best[1].min(reply.trajectory.duration_secs());
                }
            }
            (0..2).for_each(|k| ratios[1][k].push(once[k] / best[k]));
        }
        let peers = ["AnytimePathShortening for 5 s", "the best plan of 5 s of other seeds"];
        let mut figures = Vec::new();
        for (of_peer, peer) in ratios.iter().zip(peers) {
            for (ratios, name) in of_peer.iter().zip(["path length", "duration"]) {
                if ratios.is_empty() {
                    continue;
                }
                figures.push(BenchFigure {
                    peer: Some(peer.to_owned()),
                    peer_value: Some(1.0),
                    ..BenchFigure::without_peer(
                        &format!("box: {name} over that of {peer}, median"),
                        quantile(ratios, 0.5),
                        "1",
                        &format!("{} problems; goal: at most 1.05", ratios.len()),
                    )
                });
            }
        }
        Ok(figures)
    }
}

impl BenchRun {
    /// How long a running plan goes on after a cancel: at moments spread over plans of the problems.
    pub(super) fn cancel_latency(&mut self) -> Result<Vec<BenchFigure>, Box<dyn Error>> {
        let mut worker = PlanWorker::new(super::planner(&self.model, PlannerOptions::default())?);
        let (mut late_ms, mut busy_ms) = (Vec::new(), Vec::new());
        let mut requests = Vec::new();
        for number in 0..CANCELLED_PROBLEMS {
            requests.push(self.problem_generator.problem(number, number % 2 == 0)?.request);
        }
        for (number, request) in requests.iter().cycle().take(CANCEL_COUNT).enumerate() {
            let id = number as u64 + 1;
            worker.submit(PlanRequest { id, ..request.clone() });
            std::thread::sleep(Duration::from_micros(137 * (id % 100)));
            let (begin, busy) = (Instant::now(), worker.cpu_secs());
            worker.cancel();
            if worker.wait(id).status == PlanStatus::Cancelled {
                late_ms.push(begin.elapsed().as_secs_f64() * 1e3);
                busy_ms.push((worker.cpu_secs() - busy) * 1e3);
            }
        }
        let mut figures = Vec::new();
        let of = [("from cancel to reply", &late_ms), ("processor time from cancel to reply", &busy_ms)];
        for (name, times) in of.into_iter().filter(|(_, times)| !times.is_empty()) {
            let [median, high, worst] = [0.5, 0.99, 1.0].map(|q| quantile(times, q));
            let note = format!(
                "{} cancelled plans, median {median:.3}, worst {worst:.3} ms; goal: under 5",
                times.len()
            );
            figures.push(BenchFigure::without_peer(&format!("{name}, 99 %"), high, "ms", &note));
        }
        Ok(figures)
    }
}

/// The share of a trial's wall time in which the planner works: method D, seated, as fast as it goes.
pub(super) fn planner_time_proportion() -> Result<BenchFigure, Box<dyn Error>> {
    let config = TrialConfig::new("D", 1, Setup::named("seated")?);
    let trial::Assembly { mut trial, plans, .. } = trial::simulated_trial(config, &EmgOrigin::Synthetic)?;
    let begin = Instant::now();
    while !trial.step(false)?.output.finished {}
    let wall_secs = begin.elapsed().as_secs_f64();
    let note = format!("{} plans of a trial of {wall_secs:.1} s; goal: at most 0.2", plans.entries().len());
    Ok(BenchFigure::without_peer("share of a trial's wall time", plans.busy_secs() / wall_secs, "1", &note))
}

/// A path of straight joint motions as a trajectory at an even pace.
fn constant_speed_trajectory(path: &[Vec<f64>]) -> Trajectory {
    let mut points: Vec<TrajectoryPoint> = Vec::new();
    for pair in path.windows(2) {
        let span = pair[0].iter().zip(&pair[1]).map(|(a, b)| (b - a).abs()).fold(1e-9, f64::max)
            / PATH_SPEED_RAD_PER_S;
        let begin = points.last().map_or(0.0, |p| p.time_secs);
        // A cubic with equal slopes at both ends that match the chord is straight; so each motion has its own two
        // points, a nanosecond apart from its neighbour's.
        let slope: Vec<f64> = pair[0].iter().zip(&pair[1]).map(|(a, b)| (b - a) / span).collect();
        for (at, q) in [(begin + 1e-9, &pair[0]), (begin + 1e-9 + span, &pair[1])] {
            points.push(TrajectoryPoint { time_secs: at, q: joints(q), qd: joints(&slope) });
        }
    }
    Trajectory { points }
}
