//! `proact bench planning`: reach, carry and place problems drawn from a seed, in the box and among 20 blocks.

mod independent_checker;
mod ompl_comparison;
mod planner_comparison;
mod problems;
mod vamp;

use crate::{BenchFigure, BenchReport, quantile};
use independent_checker::{IndependentChecker, PathContact};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use proact_app::print_status;
use proact_arm::ArmModel;
use proact_kinematics::Kinematics;
use proact_planning::{ArmPlanner, CancelFlag, CollisionScene, PlannerOptions, SearchLimits, SearchOutcome};
use proact_testbed::Setup;
use proact_types::{JointVector, PlanRequest, PlanStatus, Shape, Trajectory, TrunkPosture};
use problems::{BenchProblem, ProblemGenerator, ProblemKind, ProblemRng, obstacles};
use std::{collections::BTreeSet, error::Error, io::IsTerminal, sync::Arc, time::Instant};

/// The problems of the report. Nothing was tuned on this seed: tests and trials of settings use others.
const HELD_OUT_SEED: u64 = 20_261_121;
/// One problem in so many stands in the cluttered scene.
const CLUTTERED_EVERY: usize = 5;
/// Blocks of the cluttered scene.
const CLUTTER_BLOCKS: usize = 20;
/// One problem in so many is planned again and again for as long as `LONG_SECS`.
const LONG_EVERY: usize = 16;
/// One problem in so many is also searched as a plain program on OMPL and FCL does it.
const SEARCH_EVERY: usize = 48;
/// The task's block, metres.
const BLOCK_RADIUS_M: f64 = 0.025;
const BLOCK_HEIGHT_M: f64 = 0.05;
const BLOCK: Shape = Shape::Cylinder { radius: BLOCK_RADIUS_M, length: BLOCK_HEIGHT_M };
/// So far from either end a path should keep the padding, metres of the tip's path.
const END_DISTANCE_M: f64 = 0.05;
/// The padding, and what may be missing between the states at which the planner looks.
const PADDING_MM: f64 = 5.0;
const ROUNDING_MM: f64 = 0.2;
/// Farthest that the arm moves between two checked states where it is found out whether a goal is within reach, metres.
const REACHABILITY_STEP_M: f64 = 0.001;

/// Numbers of the problems of [`HELD_OUT_SEED`] that are known to be out of reach; what is not solved and not among them is
/// searched for at length in each run.
const OUT_OF_REACH: &str = include_str!("planning/out_of_reach.txt");

/// How the bench is run.
#[derive(Clone, Copy, Debug)]
pub struct PlanningBench {
    /// From which the problems are drawn.
    pub seed: u64,
    /// How many.
    pub problems: usize,
    /// For how many seconds RRTConnect may look for a way before what was not solved and is not listed counts as out of
    /// reach; without it all of that counts as within reach.
    pub reachability_timeout_secs: Option<f64>,
}

impl PlanningBench {
    /// `problems` of `seed`, or of the held-out one.
    pub fn new(seed: Option<u64>, problems: usize, settle: Option<f64>) -> Self {
        Self { seed: seed.unwrap_or(HELD_OUT_SEED), problems, reachability_timeout_secs: settle }
    }
}

/// What one problem gave.
struct ProblemResult {
    number: usize,
    kind: ProblemKind,
    cluttered: bool,
    /// Wall time of the plan, and processor time, ms.
    time_ms: f64,
    cpu_ms: f64,
    /// It leads to the goal and touches nothing at fine steps.
    solved: bool,
    /// It leads to the goal, but the independent check finds a contact.
    contact: Option<PathContact>,
    /// Free space away from its ends by the independent check, metres; none if it has no middle.
    clearance_m: Option<f64>,
    /// What the reply said otherwise.
    reply_text: String,
    reachable: bool,
    /// Length of the path in joint space, rad (L2), and its duration, s; of solved ones.
    path_length_rad: f64,
    duration_secs: f64,
}

/// Everything a problem is drawn from and judged by.
struct BenchRun {
    model: Arc<ArmModel>,
    problem_generator: ProblemGenerator,
    planner: ArmPlanner,
    checker: IndependentChecker,
    /// Where joint searches run side by side, and where checks are counted.
    scene: CollisionScene,
    setup: Setup,
    seed: u64,
    results: Vec<ProblemResult>,
    /// Requests kept for the long search, with length and duration of their plan.
    long_search_requests: Vec<(PlanRequest, f64, f64)>,
    searches: Vec<ompl_comparison::SearchComparison>,
}

/// Plans drawn problems and reports times, success, contacts, lengths.
///
/// A quarter of an hour for 1,000, most of it the search for what a few seconds of planning would give and the fine
/// check of every path. The problems depend on the seed alone; the times on the machine.
///
/// # Errors
/// A model that the planner refuses; no set-up of the known names.
pub(crate) fn planning(what: PlanningBench) -> Result<BenchReport, Box<dyn Error>> {
    let bar = progress_bar(what.problems);
    let mut bench = solve_all(&what, &bar)?;
    if let Some(max_secs) = what.reachability_timeout_secs {
        bar.set_message("what was not solved, for half a minute each");
        bench.classify_unreachable(max_secs)?;
    }
    let mut figures = bench.figures();
    figures.extend(bench.search_figures());
    bar.set_message("some problems for five seconds, twice each");
    figures.extend(bench.compare_with_long_searches()?);
    figures.extend(bench.vamp()?);
    figures.extend(bench.checks_per_second()?);
    figures.extend(bench.compare_planners(what.problems / 8)?);
    figures.extend(bench.cancel_latency()?);
    figures.push(ompl_comparison::planner_time_proportion()?);
    bar.finish_and_clear();
    Ok(BenchReport::new("planning", figures))
}

/// Processor time of each of `plans` among so many blocks, milliseconds.
pub(crate) fn plan_among_blocks(blocks: usize, plans: usize) -> Result<Vec<f64>, Box<dyn Error>> {
    let mut bench = BenchRun::new(HELD_OUT_SEED)?;
    let mut times = Vec::with_capacity(plans);
    for number in 0..plans {
        let problem = bench.problem_generator.problem_among(number, blocks)?;
        bench.planner.solve(&problem.request);
        times.push(1e3 * bench.planner.stats().cpu_secs);
    }
    Ok(times)
}

/// Every problem once.
fn solve_all(what: &PlanningBench, bar: &ProgressBar) -> Result<BenchRun, Box<dyn Error>> {
    let mut bench = BenchRun::new(what.seed)?;
    let beyond = out_of_reach(what.seed);
    for number in 0..what.problems {
        let cluttered = number.is_multiple_of(CLUTTERED_EVERY);
        let problem = bench.problem_generator.problem(number, cluttered)?;
        bench.solve(&problem, &beyond)?;
        bar.inc(1);
    }
    Ok(bench)
}

/// Numbers of the problems that are known to be out of reach; of the held-out seed alone.
fn out_of_reach(seed: u64) -> BTreeSet<usize> {
    if seed != HELD_OUT_SEED {
        return BTreeSet::new();
    }
    let lines = OUT_OF_REACH.lines().filter(|line| !line.starts_with('#'));
    lines.flat_map(|line| line.split_whitespace().filter_map(|word| word.parse().ok())).collect()
}

fn progress_bar(problems: usize) -> ProgressBar {
    let target = if std::io::stderr().is_terminal() {
        ProgressDrawTarget::stderr()
    } else {
        ProgressDrawTarget::hidden()
    };
    let bar = ProgressBar::with_draw_target(Some(problems as u64), target);
    if let Ok(style) = ProgressStyle::with_template("{elapsed} {bar:40} {pos} of {len} problems  {msg}") {
        bar.set_style(style);
    }
    bar
}

impl BenchRun {
    fn new(seed: u64) -> Result<Self, Box<dyn Error>> {
        let drawer = ProblemGenerator::new(seed)?;
        let model = drawer.model.clone();
        Ok(Self {
            planner: planner(&model, PlannerOptions::default())?,
            checker: IndependentChecker::new(model.clone()),
            scene: CollisionScene::new(&model)?,
            setup: Setup::named("still")?,
            seed,
            results: Vec::new(),
            long_search_requests: Vec::new(),
            searches: Vec::new(),
            problem_generator: drawer,
            model,
        })
    }

    /// Plans, and notes the outcome.
    fn solve(&mut self, problem: &BenchProblem, beyond: &BTreeSet<usize>) -> Result<(), Box<dyn Error>> {
        let BenchProblem { number, kind, cluttered, request, .. } = problem;
        let (number, kind, cluttered) = (*number, *kind, *cluttered);
        let begin = Instant::now();
        let reply = self.planner.solve(request);
        let time_ms = begin.elapsed().as_secs_f64() * 1e3;
        let cpu_ms = self.planner.stats().cpu_secs * 1e3;
        let ok = reply.status == PlanStatus::Ok;
        let contact = if ok { self.checker.first_contact(request, &reply.trajectory)? } else { None };
        let solved = ok && contact.is_none();
        let clearance = if solved {
            self.checker.min_clearance_m(request, &reply.trajectory, END_DISTANCE_M)?
        } else {
            None
        };
        let (length, duration) = (path_length_rad(&reply.trajectory), reply.trajectory.duration_secs());
        if solved && number % SEARCH_EVERY == SEARCH_EVERY - 1 {
            self.compare_with_plain_ompl(request, &reply.trajectory, cpu_ms)?;
        }
        if solved && !cluttered && number.is_multiple_of(LONG_EVERY) {
            self.long_search_requests.push((request.clone(), length, duration));
        }
        let reachable = solved || !beyond.contains(&number);
        let status_reason = reply.reason;
        self.results.push(ProblemResult {
            number,
            kind,
            cluttered,
            time_ms,
            cpu_ms,
            solved,
            contact,
            clearance_m: clearance,
            reply_text: status_reason,
            reachable,
            path_length_rad: length,
            duration_secs: duration,
        });
        Ok(())
    }

    /// Finds out which of the problems that were not solved are out of reach: RRTConnect finds no way between free arm
    /// angles over the start and over the goal within that time. Says so on standard error, number by number, for the
    /// stored list.
    fn classify_unreachable(&mut self, max_secs: f64) -> Result<(), Box<dyn Error>> {
        let limits = SearchLimits {
            max_iterations: u32::MAX,
            max_secs: Some(max_secs),
            step_m: REACHABILITY_STEP_M,
            ..SearchLimits::default()
        };
        for answer in self.results.iter_mut().filter(|a| a.reachable && !a.solved) {
            let BenchProblem { request, reachable_postures: [from, to], .. } =
                self.problem_generator.problem(answer.number, answer.cluttered)?;
            self.scene.set_base(&request.world_from_base)?;
            self.scene.set_hand(&request.hand)?;
            self.scene.set_obstacles(&request.obstacles)?;
            self.scene.set_attached(request.attached.as_ref())?;
            self.scene.set_padding(0.0)?;
            let goals = [to.to_vec()];
            let outcome = self.scene.search(&from, &goals, request.seed, &limits, &CancelFlag::new())?;
            answer.reachable = matches!(outcome, SearchOutcome::Solved { .. });
            let verdict = if answer.reachable { "within reach" } else { "out of reach" };
            let (number, kind, reply_text) = (answer.number, answer.kind.name(), &answer.reply_text);
            print_status(format_args!(
                "{number} {verdict} ({kind}, cluttered: {}): {reply_text}",
                answer.cluttered
            ));
        }
        Ok(())
    }

    /// Processor time of the plans of both scenes, of what is within reach.
    fn overall_figures(&self) -> Vec<BenchFigure> {
        let cpu: Vec<f64> = self.results.iter().filter(|a| a.reachable).map(|a| a.cpu_ms).collect();
        if cpu.is_empty() {
            return Vec::new();
        }
        let figure = |name: &str, part: f64, note: &str| {
            let name = format!("both scenes: plan on the processor, {name}");
            BenchFigure::without_peer(&name, quantile(&cpu, part), "ms", note)
        };
        vec![
            figure("median", 0.5, "goal: at most 3"),
            figure("99 %", 0.99, "goal: at most 15"),
            figure("worst", 1.0, ""),
        ]
    }

    fn figures(&self) -> Vec<BenchFigure> {
        let mut figures = self.overall_figures();
        for (scene, cluttered) in [("box", false), ("20 blocks", true)] {
            let here: Vec<&ProblemResult> =
                self.results.iter().filter(|a| a.cluttered == cluttered).collect();
            let reachable: Vec<&ProblemResult> = here.iter().copied().filter(|a| a.reachable).collect();
            let beyond: Vec<f64> = here.iter().filter(|a| !a.reachable).map(|a| a.time_ms).collect();
            if reachable.is_empty() {
                continue;
            }
            let mut add = |name: &str, value: f64, unit: &str, note: &str| {
                figures.push(BenchFigure::without_peer(&format!("{scene}: {name}"), value, unit, note));
            };
            let tuned = if self.seed == HELD_OUT_SEED { ", which nothing was tuned on" } else { "" };
            add("problems", here.len() as f64, "1", &format!("drawn from seed {}{tuned}", self.seed));
            let times: Vec<f64> = reachable.iter().map(|a| a.time_ms).collect();
            add("plan, median", quantile(&times, 0.5), "ms", "");
            add("plan, 99 %", quantile(&times, 0.99), "ms", "");
            add("plan, worst", quantile(&times, 1.0), "ms", "");
            let cpu: Vec<f64> = reachable.iter().map(|a| a.cpu_ms).collect();
            let note = "of processor time: what other processes on the machine add is left out";
            add("plan on the processor, median", quantile(&cpu, 0.5), "ms", note);
            add("plan on the processor, 99 %", quantile(&cpu, 0.99), "ms", "");
            for kind in ProblemKind::ALL {
                let of_kind: Vec<f64> =
                    reachable.iter().filter(|a| a.kind == kind).map(|a| a.time_ms).collect();
                if !of_kind.is_empty() {
                    add(&format!("{}, median", kind.name()), quantile(&of_kind, 0.5), "ms", "");
                }
            }
            let solved: Vec<&ProblemResult> = reachable.iter().copied().filter(|a| a.solved).collect();
            let share = solved.len() as f64 / reachable.len() as f64;
            let missed: Vec<String> =
                reachable.iter().filter(|a| !a.solved).map(|a| a.number.to_string()).collect();
            let note = format!("goal: at least 0.995; not solved: {}", missed.join(" "));
            add("reachable goals solved", share, "1", &note);
            let touching: Vec<&ProblemResult> =
                here.iter().copied().filter(|a| a.contact.is_some()).collect();
            let first = touching.first().and_then(|a| Some((a.number, a.contact.as_ref()?)));
            let which = first.map_or_else(String::new, |(number, PathContact { time_secs, a, b })| {
                format!("; the first: problem {number}, {a} and {b} at {time_secs:.3} s")
            });
            add(
                "paths with a contact",
                touching.len() as f64,
                "1",
                &format!(
                    "by Parry, unpadded, every 1 mm and 0.5 degrees; they do not count as solved{which}"
                ),
            );
            add(
                "out of reach",
                beyond.len() as f64,
                "1",
                "no way between free arm angles in 30 s of RRTConnect",
            );
            if !beyond.is_empty() {
                add(
                    "refusal, median",
                    quantile(&beyond, 0.5),
                    "ms",
                    "time until told that it is out of reach",
                );
            }
            let clearances_mm: Vec<f64> =
                solved.iter().filter_map(|a| a.clearance_m).map(|c| c * 1e3).collect();
            if !clearances_mm.is_empty() {
                let kept =
                    clearances_mm.iter().filter(|clearance| **clearance >= PADDING_MM - ROUNDING_MM).count();
                let note =
                    "by Parry, every 5 ms, more than 5 cm of the tip's path away from both ends; goal: 1";
                add("paths that keep 5 mm", kept as f64 / clearances_mm.len() as f64, "1", note);
                add("clearance there, least", quantile(&clearances_mm, 0.0), "mm", "by Parry");
            }
            if !solved.is_empty() {
                let lengths: Vec<f64> = solved.iter().map(|a| a.path_length_rad).collect();
                let durations: Vec<f64> = solved.iter().map(|a| a.duration_secs).collect();
                add("path length, median", quantile(&lengths, 0.5), "rad", "joint space, L2");
                add("duration, median", quantile(&durations, 0.5), "s", "");
            }
        }
        figures
    }

    /// How many states a second are looked at, over the whole of the joint ranges.
    fn checks_per_second(&mut self) -> Result<Vec<BenchFigure>, Box<dyn Error>> {
        const CHECKS: usize = 20_000;
        let mut random = ProblemRng(HELD_OUT_SEED);
        self.scene.set_base(&self.setup.body.shoulder_pose(&TrunkPosture::default()))?;
        self.scene.set_obstacles(&obstacles(&[]))?;
        self.scene.set_attached(None)?;
        self.scene.set_padding(0.0)?;
        let states: Vec<Vec<f64>> = (0..CHECKS)
            .map(|_| {
                let limits = self.model.arm.iter().map(|&joint| self.model.joints[joint].limits);
                limits.map(|l| random.uniform(l.lower, l.upper)).collect()
            })
            .collect();
        let flat: Vec<f64> = states.iter().flatten().copied().collect();
        let rate = |begin: Instant| CHECKS as f64 / begin.elapsed().as_secs_f64();
        let begin = Instant::now();
        self.scene.count_free(&flat)?;
        let inside = rate(begin);
        let begin = Instant::now();
        for q in &states {
            self.scene.is_free(q)?;
        }
        let through = rate(begin);
        let mut other = CollisionScene::new(&self.model)?;
        other.set_base(&self.setup.body.shoulder_pose(&TrunkPosture::default()))?;
        other.set_obstacles(&obstacles(&[]))?;
        let begin = Instant::now();
        self.scene.count_accepted(&flat, &mut |q| other.is_free(q).unwrap_or(false))?;
        let back = rate(begin);
        let figure = |name: &str, value: f64, note: &str| BenchFigure {
            peer: Some("a loop in C++".to_owned()),
            peer_value: Some(inside),
            ..BenchFigure::without_peer(name, value, "1/s", note)
        };
        Ok(vec![
            figure("state checks through Rust", through, "random states in the box scene"),
            figure("state checks, called back from C++", back, "a closure in Rust that asks the scene again"),
        ])
    }
}

fn planner(model: &Arc<ArmModel>, options: PlannerOptions) -> Result<ArmPlanner, Box<dyn Error>> {
    let kinematics = Box::new(Kinematics::new(model)?);
    Ok(ArmPlanner::new(model.clone(), kinematics, options)?)
}

/// Length of a path in joint space, rad (L2).
fn path_length_rad(trajectory: &Trajectory) -> f64 {
    let between = |a: &JointVector, b: &JointVector| {
        a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum::<f64>().sqrt()
    };
    trajectory.points.windows(2).map(|pair| between(&pair[0].q, &pair[1].q)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    const PROBLEMS: usize = 12;

    fn run(seed: u64) -> BenchReport {
        let what = PlanningBench { seed, problems: PROBLEMS, reachability_timeout_secs: None };
        let bench = solve_all(&what, &ProgressBar::hidden()).expect("the arm can be planned for");
        BenchReport::new("planning", bench.figures())
    }

    /// Figures belong to the bench; what is out of reach counts as missed here. What is tested is that the problems are
    /// what they claim and add up.
    #[test]
    fn drawn_problems_are_mostly_solved_without_a_contact_and_depend_on_the_seed() {
        let value = |report: &BenchReport, name: &str| {
            report.figures.iter().find(|f| f.name == name).map(|f| f.value).expect("the figure is there")
        };
        let one = run(1);
        assert_eq!(value(&one, "box: problems") + value(&one, "20 blocks: problems"), PROBLEMS as f64);
        assert!(value(&one, "box: reachable goals solved") > 0.8, "{one}");
        assert_eq!(value(&one, "box: paths with a contact"), 0.0, "{one}");
        assert!(one.figures.iter().all(|f| f.value.is_finite()));
        let length = "box: path length, median";
        assert_eq!(value(&one, length), value(&run(1), length), "the problems come from the seed alone");
        assert_ne!(value(&one, length), value(&run(2), length));
    }

    #[test]
    fn a_problem_is_the_same_whatever_was_drawn_before() {
        let mut drawer = ProblemGenerator::new(3).expect("the arm can be planned for");
        let alone = drawer.problem(7, false).expect("it can be drawn").request;
        drawer.problem(8, true).expect("it can be drawn");
        assert_eq!(drawer.problem(7, false).expect("it can be drawn").request, alone);
    }

    #[test]
    fn the_independent_check_finds_a_hand_that_goes_through_the_partition() {
        let mut bench = BenchRun::new(3).expect("the arm can be planned for");
        let mut request = bench.problem_generator.problem(0, false).expect("it can be drawn").request;
        let reply = bench.planner.solve(&request);
        assert_eq!(reply.status, PlanStatus::Ok);
        let contact = bench.checker.first_contact(&request, &reply.trajectory).expect("the shapes are known");
        assert_eq!(contact, None);
        // The same way, with a ball where the wrist is in its middle.
        let middle = reply.trajectory.sample(0.5 * reply.trajectory.duration_secs()).expect("not empty").0;
        let mut kinematics = Kinematics::new(&bench.model).expect("the arm has kinematics");
        let tip = proact_kinematics::ArmKinematics::forward(&mut kinematics, &middle).expect("finite");
        request.obstacles.push(proact_types::Obstacle {
            name: "ball".to_owned(),
            shape: Shape::Sphere { radius: 0.01 },
            pose: request.world_from_base * tip,
            loose: false,
        });
        let contact = bench.checker.first_contact(&request, &reply.trajectory).expect("the shapes are known");
        assert_eq!(contact.map(|contact| contact.b).as_deref(), Some("ball"));
    }

    #[test]
    fn blocks_stand_apart_and_inside_the_box() {
        let mut drawer = ProblemGenerator::new(3).expect("the arm can be planned for");
        let blocks = drawer.sample_blocks(CLUTTER_BLOCKS);
        assert_eq!(blocks.len(), CLUTTER_BLOCKS);
        for (k, a) in blocks.iter().enumerate() {
            assert!(a.x.abs() < 0.125 && a.y.abs() < 0.275 && a.y.abs() > 0.03, "{a}");
            assert!(blocks[..k].iter().all(|b| (a - b).norm() > 2.0 * BLOCK_RADIUS_M), "{a}");
        }
    }
}
