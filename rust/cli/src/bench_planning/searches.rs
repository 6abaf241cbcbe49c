//! What the plans are compared with: a plain program on OMPL and FCL, and planning for seconds instead of
//! milliseconds.

use super::{Bench, length};
use crate::bench::{BenchFigure, quantile};
use crate::trial;
use proact_devices::EmgSource;
use proact_planning::{PlanWorker, PlannerName, PlannerOptions};
use proact_testbed::{Setup, TrialConfig, ports::PlanService};
use proact_types::{PlanRequest, PlanStatus, Trajectory, TrajectoryPoint, joints};
use std::{
    error::Error,
    time::{Duration, Instant},
};

/// Processor time of one of the plain program's attempts, seconds: as long as the original's took on the clock.
const PLAIN_SECS: f64 = 0.5;
/// Stack of the thread in which it searches, bytes; memory that is never touched costs nothing.
const PLAIN_STACK_BYTES: usize = 1 << 30;
/// Speed at which a plain path is walked for the check, rad/s.
const WALK: f64 = 0.5;
/// Plans that are cancelled, and the problems that they are for.
const CANCELS: usize = 200;
const CANCELLED_PROBLEMS: usize = 10;
/// How long the best of many plans is looked for, seconds.
const LONG_SECS: f64 = 5.0;

/// One problem beside the plain program.
pub(super) struct Search {
    /// Processor time of the whole plan, ms.
    ours_ms: f64,
    plain: [Plain; PEERS.len()],
}

#[derive(Clone, Copy)]
struct Plain {
    /// Processor time of all attempts, ms.
    time_ms: f64,
    attempts: u32,
    found: bool,
    /// The path touches something, unpadded, at fine steps.
    touches: bool,
}

/// The plain program's planners: the original's, and the one that is the default here.
const PEERS: [PlannerName; 2] = [PlannerName::LbKpiece1, PlannerName::RrtConnect];

impl Bench {
    /// Searches by the plain program between the two ends of the part of a plan that keeps clear by the padding.
    /// It is handed the arm angles of the goal, which our time includes the search for.
    pub(super) fn search_beside_plain_ompl(
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
        scene.set_padding(PlannerOptions::default().padding)?;
        let mut clear = Vec::new();
        for point in &trajectory.points {
            if scene.is_free(&point.q)? {
                clear.push(point.q.to_vec());
            }
        }
        let [from, .., to] = clear.as_slice() else { return Ok(()) };
        let mut all = [Plain { time_ms: 0.0, attempts: 0, found: false, touches: false }; PEERS.len()];
        for (plain, planner) in all.iter_mut().zip(PEERS) {
            let goals = std::slice::from_ref(to);
            // LBKPIECE1 frees failed branches by recursion, as deep as they are long.
            let outcome = std::thread::scope(|scope| {
                let search = || scene.search_plainly(from, goals, planner, PLAIN_SECS, request.seed);
                let thread =
                    std::thread::Builder::new().stack_size(PLAIN_STACK_BYTES).spawn_scoped(scope, search)?;
                thread.join().map_err(|_| "the plain search panicked")?.map_err(Box::<dyn Error>::from)
            })?;
            *plain = Plain {
                attempts: outcome.attempts,
                time_ms: outcome.cpu_secs * 1e3,
                found: !outcome.path.is_empty(),
                touches: self.judge.contact(request, &walked(&outcome.path))?.is_some(),
            };
        }
        self.searches.push(Search { ours_ms, plain: all });
        Ok(())
    }

    pub(super) fn search_figures(&self) -> Vec<BenchFigure> {
        let all = &self.searches;
        if all.is_empty() {
            return Vec::new();
        }
        let ours: Vec<f64> = all.iter().map(|s| s.ours_ms).collect();
        let note = format!(
            "{} solved problems, processor time; ours from request to timed path; the peer from arm angles to arm angles, in up to eight attempts of {PLAIN_SECS} s, each counted",
            all.len()
        );
        let mut figures = Vec::new();
        for (k, planner) in PEERS.into_iter().enumerate() {
            let times: Vec<f64> = all.iter().map(|s| s.plain[k].time_ms).collect();
            let share = |of: fn(&Plain) -> bool| {
                all.iter().filter(|s| of(&s.plain[k])).count() as f64 / all.len() as f64
            };
            let mut add = |name: &str, unit: &str, value: f64, peer_value: f64, note: &str| {
                figures.push(BenchFigure {
                    peer: Some("a plain program on OMPL and FCL".to_owned()),
                    peer_value: Some(peer_value),
                    ..BenchFigure::alone(&format!("beside plain {planner}: {name}"), value, unit, note)
                });
            };
            let [median, high] = [0.5, 0.99].map(|q| (quantile(&ours, q), quantile(&times, q)));
            add("median", "ms", median.0, median.1, &note);
            add("99 %", "ms", high.0, high.1, "");
            add("times faster at the median", "1", median.1 / median.0, 1.0, "goal: at least 5");
            add("found in one attempt", "1", 1.0, share(|p| p.found && p.attempts == 1), "");
            add("found", "1", 1.0, share(|p| p.found), "");
            let honest = share(|p| p.found && !p.touches);
            add("found without a contact", "1", 1.0, honest, "by Parry, every 1 mm and 0.5 degrees");
        }
        figures
    }

    /// Length and duration beside the best of the plans that five seconds of other seeds give.
    pub(super) fn beside_long_searches(&mut self) -> Vec<BenchFigure> {
        let (mut lengths, mut durations) = (Vec::new(), Vec::new());
        for (request, length_once, duration_once) in std::mem::take(&mut self.kept) {
            let (mut shortest, mut quickest) = (length_once, duration_once);
            let begin = Instant::now();
            let mut seed = request.seed;
            while begin.elapsed().as_secs_f64() < LONG_SECS {
                seed = seed.wrapping_add(1);
                let reply = self.planner.solve(&PlanRequest { seed, ..request.clone() });
                if reply.status == PlanStatus::Ok {
                    shortest = shortest.min(length(&reply.trajectory));
                    quickest = quickest.min(reply.trajectory.duration_secs());
                }
            }
            lengths.push(length_once / shortest);
            durations.push(duration_once / quickest);
        }
        if lengths.is_empty() {
            return Vec::new();
        }
        let note = format!("{} problems, best of 5 s of other seeds; goal: at most 1.1", lengths.len());
        [("path length, ratio to the best", lengths), ("duration, ratio to the best", durations)]
            .map(|(name, ratios)| BenchFigure {
                peer: Some("the same planner for 5 s".to_owned()),
                peer_value: Some(1.0),
                ..BenchFigure::alone(&format!("box: {name}, median"), quantile(&ratios, 0.5), "1", &note)
            })
            .into()
    }
}

impl Bench {
    /// How long a running plan goes on after a cancel: at moments spread over plans of the problems.
    pub(super) fn cancels(&mut self) -> Result<BenchFigure, Box<dyn Error>> {
        let mut worker = PlanWorker::new(super::planner(&self.model, PlannerOptions::default())?);
        let mut late_ms = Vec::new();
        let mut requests = Vec::new();
        for number in 0..CANCELLED_PROBLEMS {
            requests.push(self.drawer.problem(number, number % 2 == 0)?.request);
        }
        for (number, request) in requests.iter().cycle().take(CANCELS).enumerate() {
            let id = number as u64 + 1;
            worker.submit(PlanRequest { id, ..request.clone() });
            std::thread::sleep(Duration::from_micros(137 * (id % 100)));
            let begin = Instant::now();
            worker.cancel();
            if worker.wait(id).status == PlanStatus::Cancelled {
                late_ms.push(begin.elapsed().as_secs_f64() * 1e3);
            }
        }
        let high = if late_ms.is_empty() { f64::NAN } else { quantile(&late_ms, 0.99) };
        let middle = if late_ms.is_empty() { f64::NAN } else { quantile(&late_ms, 0.5) };
        let note = format!("{} cancelled plans, median {middle:.3} ms; goal: under 5", late_ms.len());
        Ok(BenchFigure::alone("from cancel to reply, 99 %", high, "ms", &note))
    }
}

/// The share of a trial's wall time in which the planner works: method D, seated, as fast as it goes.
pub(super) fn share_of_a_trial() -> Result<BenchFigure, Box<dyn Error>> {
    let config = TrialConfig::new("D".parse()?, 1, Setup::named("seated")?);
    let trial::Assembly { mut session, plans, .. } = trial::simulated(config, &EmgSource::Synthetic)?;
    let begin = Instant::now();
    while !session.step(false)?.output.finished {}
    let wall_secs = begin.elapsed().as_secs_f64();
    let note = format!("{} plans of a trial of {wall_secs:.1} s; goal: at most 0.2", plans.entries().len());
    Ok(BenchFigure::alone("share of a trial's wall time", plans.busy_secs() / wall_secs, "1", &note))
}

/// A path of straight joint motions as a trajectory at an even pace.
fn walked(path: &[Vec<f64>]) -> Trajectory {
    let mut points: Vec<TrajectoryPoint> = Vec::new();
    for pair in path.windows(2) {
        let span = pair[0].iter().zip(&pair[1]).map(|(a, b)| (b - a).abs()).fold(1e-9, f64::max) / WALK;
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
