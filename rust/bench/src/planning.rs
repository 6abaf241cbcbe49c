//! `proact bench planning`: reach, carry and place problems drawn from a seed, in the box and among 20 blocks.

mod by_name;
mod independent;
mod problems;
mod searches;
mod vamp;

use crate::{BenchFigure, BenchReport, quantile};
use independent::{Contact, Independent};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use proact_app::tell;
use proact_arm::ArmModel;
use proact_kinematics::Kinematics;
use proact_planning::{ArmPlanner, CancelFlag, CollisionScene, PlannerOptions, SearchLimits, SearchOutcome};
use proact_testbed::Setup;
use proact_types::{JointVector, PlanRequest, PlanStatus, Shape, Trajectory, TrunkPosture};
use problems::{Drawer, Kind, Problem, Random, obstacles};
use std::{collections::BTreeSet, error::Error, io::IsTerminal, sync::Arc, time::Instant};

/// The problems of the report. Nothing was tuned on this seed: tests and trials of settings use others.
const HELD_OUT: u64 = 20_261_121;
/// One problem in so many stands in the cluttered scene.
const CLUTTERED_EVERY: usize = 5;
/// Blocks of the cluttered scene.
const CLUTTER: usize = 20;
/// One problem in so many is planned again and again for as long as `LONG_SECS`.
const LONG_EVERY: usize = 16;
/// One problem in so many is also searched as a plain program on OMPL and FCL does it.
const SEARCH_EVERY: usize = 48;
/// The task's block, metres.
const BLOCK_RADIUS: f64 = 0.025;
const BLOCK_HEIGHT: f64 = 0.05;
const BLOCK: Shape = Shape::Cylinder { radius: BLOCK_RADIUS, length: BLOCK_HEIGHT };
/// So far from either end a path should keep the padding, metres of the tip's path.
const AWAY: f64 = 0.05;
/// The padding, and what may be missing between the states at which the planner looks.
const PADDING_MM: f64 = 5.0;
const ROUNDING_MM: f64 = 0.2;
/// Farthest that the arm moves between two checked states where it is found out whether a goal is within reach, metres.
const SETTLE_STEP: f64 = 0.001;

/// Numbers of the problems of [`HELD_OUT`] that are known to be out of reach; what is not solved and not among them is
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
    pub settle: Option<f64>,
}

impl PlanningBench {
    /// `problems` of `seed`, or of the held-out one.
    pub fn new(seed: Option<u64>, problems: usize, settle: Option<f64>) -> Self {
        Self { seed: seed.unwrap_or(HELD_OUT), problems, settle }
    }
}

/// What one problem gave.
struct Answer {
    number: usize,
    kind: Kind,
    cluttered: bool,
    /// Wall time of the plan, and processor time, ms.
    time_ms: f64,
    cpu_ms: f64,
    /// It leads to the goal and touches nothing at fine steps.
    solved: bool,
    /// It leads to the goal, but the independent check finds a contact.
    contact: Option<Contact>,
    /// Free space away from its ends by the independent check, metres; none if it has no middle.
    clearance: Option<f64>,
    /// What the reply said otherwise.
    said: String,
    reachable: bool,
    /// Length of the path in joint space, rad (L2), and its duration, s; of solved ones.
    length: f64,
    duration: f64,
}

/// Everything a problem is drawn from and judged by.
struct Bench {
    model: Arc<ArmModel>,
    drawer: Drawer,
    planner: ArmPlanner,
    judge: Independent,
    /// Where joint searches run side by side, and where checks are counted.
    scene: CollisionScene,
    setup: Setup,
    seed: u64,
    answers: Vec<Answer>,
    /// Requests kept for the long search, with length and duration of their plan.
    kept: Vec<(PlanRequest, f64, f64)>,
    searches: Vec<searches::Search>,
}

/// Plans drawn problems and reports times, success, contacts, lengths.
///
/// A quarter of an hour for 1,000, most of it the search for what a few seconds of planning would give and the fine
/// check of every path. The problems depend on the seed alone; the times on the machine.
///
/// # Errors
/// A model that the planner refuses; no set-up of the known names.
pub(crate) fn planning(what: PlanningBench) -> Result<BenchReport, Box<dyn Error>> {
    let bar = bar(what.problems);
    let mut bench = answered(&what, &bar)?;
    if let Some(max_secs) = what.settle {
        bar.set_message("what was not solved, for half a minute each");
        bench.settle(max_secs)?;
    }
    let mut figures = bench.figures();
    figures.extend(bench.search_figures());
    bar.set_message("some problems for five seconds, twice each");
    figures.extend(bench.beside_long_searches()?);
    figures.extend(bench.vamp()?);
    figures.extend(bench.checks_per_second()?);
    figures.extend(bench.by_name(what.problems / 8)?);
    figures.extend(bench.cancels()?);
    figures.push(searches::share_of_a_trial()?);
    bar.finish_and_clear();
    Ok(BenchReport::new("planning", figures))
}

/// Processor time of each of `plans` among so many blocks, milliseconds.
pub(crate) fn among_blocks(blocks: usize, plans: usize) -> Result<Vec<f64>, Box<dyn Error>> {
    let mut bench = Bench::new(HELD_OUT)?;
    let mut times = Vec::with_capacity(plans);
    for number in 0..plans {
        let problem = bench.drawer.problem_among(number, blocks)?;
        bench.planner.solve(&problem.request);
        times.push(1e3 * bench.planner.effort().cpu_secs);
    }
    Ok(times)
}

/// Every problem once.
fn answered(what: &PlanningBench, bar: &ProgressBar) -> Result<Bench, Box<dyn Error>> {
    let mut bench = Bench::new(what.seed)?;
    let beyond = out_of_reach(what.seed);
    for number in 0..what.problems {
        let cluttered = number.is_multiple_of(CLUTTERED_EVERY);
        let problem = bench.drawer.problem(number, cluttered)?;
        bench.answer(&problem, &beyond)?;
        bar.inc(1);
    }
    Ok(bench)
}

/// Numbers of the problems that are known to be out of reach; of the held-out seed alone.
fn out_of_reach(seed: u64) -> BTreeSet<usize> {
    if seed != HELD_OUT {
        return BTreeSet::new();
    }
    let lines = OUT_OF_REACH.lines().filter(|line| !line.starts_with('#'));
    lines.flat_map(|line| line.split_whitespace().filter_map(|word| word.parse().ok())).collect()
}

fn bar(problems: usize) -> ProgressBar {
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

impl Bench {
    fn new(seed: u64) -> Result<Self, Box<dyn Error>> {
        let drawer = Drawer::new(seed)?;
        let model = drawer.model.clone();
        Ok(Self {
            planner: planner(&model, PlannerOptions::default())?,
            judge: Independent::new(model.clone()),
            scene: CollisionScene::new(&model)?,
            setup: Setup::named("still")?,
            seed,
            answers: Vec::new(),
            kept: Vec::new(),
            searches: Vec::new(),
            drawer,
            model,
        })
    }

    /// Plans, and notes the outcome.
    fn answer(&mut self, problem: &Problem, beyond: &BTreeSet<usize>) -> Result<(), Box<dyn Error>> {
        let Problem { number, kind, cluttered, request, .. } = problem;
        let (number, kind, cluttered) = (*number, *kind, *cluttered);
        let begin = Instant::now();
        let reply = self.planner.solve(request);
        let time_ms = begin.elapsed().as_secs_f64() * 1e3;
        let cpu_ms = self.planner.effort().cpu_secs * 1e3;
        let ok = reply.status == PlanStatus::Ok;
        let contact = if ok { self.judge.contact(request, &reply.trajectory)? } else { None };
        let solved = ok && contact.is_none();
        let clearance = if solved { self.judge.clearance(request, &reply.trajectory, AWAY)? } else { None };
        let (length, duration) = (length(&reply.trajectory), reply.trajectory.duration_secs());
        if solved && number % SEARCH_EVERY == SEARCH_EVERY - 1 {
            self.search_beside_plain_ompl(request, &reply.trajectory, cpu_ms)?;
        }
        if solved && !cluttered && number.is_multiple_of(LONG_EVERY) {
            self.kept.push((request.clone(), length, duration));
        }
        let reachable = solved || !beyond.contains(&number);
        let said = reply.reason;
        self.answers.push(Answer {
            number,
            kind,
            cluttered,
            time_ms,
            cpu_ms,
            solved,
            contact,
            clearance,
            said,
            reachable,
            length,
            duration,
        });
        Ok(())
    }

    /// Finds out which of the problems that were not solved are out of reach: RRTConnect finds no way between free arm
    /// angles over the start and over the goal within that time. Says so on standard error, number by number, for the
    /// stored list.
    fn settle(&mut self, max_secs: f64) -> Result<(), Box<dyn Error>> {
        let limits = SearchLimits {
            max_iterations: u32::MAX,
            max_secs: Some(max_secs),
            step_metres: SETTLE_STEP,
            ..SearchLimits::default()
        };
        for answer in self.answers.iter_mut().filter(|a| a.reachable && !a.solved) {
            let Problem { request, witness: [from, to], .. } =
                self.drawer.problem(answer.number, answer.cluttered)?;
            self.scene.set_base(&request.world_from_base)?;
            self.scene.set_hand(&request.hand)?;
            self.scene.set_obstacles(&request.obstacles)?;
            self.scene.set_attached(request.attached.as_ref())?;
            self.scene.set_padding(0.0)?;
            let goals = [to.to_vec()];
            let outcome = self.scene.search(&from, &goals, request.seed, &limits, &CancelFlag::new())?;
            answer.reachable = matches!(outcome, SearchOutcome::Solved { .. });
            let verdict = if answer.reachable { "within reach" } else { "out of reach" };
            let (number, kind, said) = (answer.number, answer.kind.name(), &answer.said);
            tell(format_args!("{number} {verdict} ({kind}, cluttered: {}): {said}", answer.cluttered));
        }
        Ok(())
    }

    /// Processor time of the plans of both scenes, of what is within reach.
    fn together(&self) -> Vec<BenchFigure> {
        let cpu: Vec<f64> = self.answers.iter().filter(|a| a.reachable).map(|a| a.cpu_ms).collect();
        if cpu.is_empty() {
            return Vec::new();
        }
        let figure = |name: &str, part: f64, note: &str| {
            let name = format!("both scenes: plan on the processor, {name}");
            BenchFigure::alone(&name, quantile(&cpu, part), "ms", note)
        };
        vec![
            figure("median", 0.5, "goal: at most 3"),
            figure("99 %", 0.99, "goal: at most 15"),
            figure("worst", 1.0, ""),
        ]
    }

    fn figures(&self) -> Vec<BenchFigure> {
        let mut figures = self.together();
        for (scene, cluttered) in [("box", false), ("20 blocks", true)] {
            let here: Vec<&Answer> = self.answers.iter().filter(|a| a.cluttered == cluttered).collect();
            let reachable: Vec<&Answer> = here.iter().copied().filter(|a| a.reachable).collect();
            let beyond: Vec<f64> = here.iter().filter(|a| !a.reachable).map(|a| a.time_ms).collect();
            if reachable.is_empty() {
                continue;
            }
            let mut add = |name: &str, value: f64, unit: &str, note: &str| {
                figures.push(BenchFigure::alone(&format!("{scene}: {name}"), value, unit, note));
            };
            let tuned = if self.seed == HELD_OUT { ", which nothing was tuned on" } else { "" };
            add("problems", here.len() as f64, "1", &format!("drawn from seed {}{tuned}", self.seed));
            let times: Vec<f64> = reachable.iter().map(|a| a.time_ms).collect();
            add("plan, median", quantile(&times, 0.5), "ms", "");
            add("plan, 99 %", quantile(&times, 0.99), "ms", "");
            add("plan, worst", quantile(&times, 1.0), "ms", "");
            let cpu: Vec<f64> = reachable.iter().map(|a| a.cpu_ms).collect();
            let note = "of processor time: what other processes on the machine add is left out";
            add("plan on the processor, median", quantile(&cpu, 0.5), "ms", note);
            add("plan on the processor, 99 %", quantile(&cpu, 0.99), "ms", "");
            for kind in Kind::ALL {
                let of_kind: Vec<f64> =
                    reachable.iter().filter(|a| a.kind == kind).map(|a| a.time_ms).collect();
                if !of_kind.is_empty() {
                    add(&format!("{}, median", kind.name()), quantile(&of_kind, 0.5), "ms", "");
                }
            }
            let solved: Vec<&Answer> = reachable.iter().copied().filter(|a| a.solved).collect();
            let share = solved.len() as f64 / reachable.len() as f64;
            let missed: Vec<String> =
                reachable.iter().filter(|a| !a.solved).map(|a| a.number.to_string()).collect();
            let note = format!("goal: at least 0.995; not solved: {}", missed.join(" "));
            add("reachable goals solved", share, "1", &note);
            let touching: Vec<&Answer> = here.iter().copied().filter(|a| a.contact.is_some()).collect();
            let first = touching.first().and_then(|a| Some((a.number, a.contact.as_ref()?)));
            let which = first.map_or_else(String::new, |(number, Contact { time_secs, a, b })| {
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
            let rooms: Vec<f64> = solved.iter().filter_map(|a| a.clearance).map(|c| c * 1e3).collect();
            if !rooms.is_empty() {
                let kept = rooms.iter().filter(|room| **room >= PADDING_MM - ROUNDING_MM).count();
                let note =
                    "by Parry, every 5 ms, more than 5 cm of the tip's path away from both ends; goal: 1";
                add("paths that keep 5 mm", kept as f64 / rooms.len() as f64, "1", note);
                add("clearance there, least", quantile(&rooms, 0.0), "mm", "by Parry");
            }
            if !solved.is_empty() {
                let lengths: Vec<f64> = solved.iter().map(|a| a.length).collect();
                let durations: Vec<f64> = solved.iter().map(|a| a.duration).collect();
                add("path length, median", quantile(&lengths, 0.5), "rad", "joint space, L2");
                add("duration, median", quantile(&durations, 0.5), "s", "");
            }
        }
        figures
    }

    /// How many states a second are looked at, over the whole of the joint ranges.
    fn checks_per_second(&mut self) -> Result<Vec<BenchFigure>, Box<dyn Error>> {
        const CHECKS: usize = 20_000;
        let mut random = Random(HELD_OUT);
        self.scene.set_base(&self.setup.body.shoulder_pose(&TrunkPosture::default()))?;
        self.scene.set_obstacles(&obstacles(&[]))?;
        self.scene.set_attached(None)?;
        self.scene.set_padding(0.0)?;
        let states: Vec<Vec<f64>> = (0..CHECKS)
            .map(|_| {
                let limits = self.model.arm.iter().map(|&joint| self.model.joints[joint].limits);
                limits.map(|l| random.between(l.lower, l.upper)).collect()
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
            ..BenchFigure::alone(name, value, "1/s", note)
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
fn length(trajectory: &Trajectory) -> f64 {
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
        let what = PlanningBench { seed, problems: PROBLEMS, settle: None };
        let bench = answered(&what, &ProgressBar::hidden()).expect("the arm can be planned for");
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
        let mut drawer = Drawer::new(3).expect("the arm can be planned for");
        let alone = drawer.problem(7, false).expect("it can be drawn").request;
        drawer.problem(8, true).expect("it can be drawn");
        assert_eq!(drawer.problem(7, false).expect("it can be drawn").request, alone);
    }

    #[test]
    fn the_independent_check_finds_a_hand_that_goes_through_the_partition() {
        let mut bench = Bench::new(3).expect("the arm can be planned for");
        let mut request = bench.drawer.problem(0, false).expect("it can be drawn").request;
        let reply = bench.planner.solve(&request);
        assert_eq!(reply.status, PlanStatus::Ok);
        let contact = bench.judge.contact(&request, &reply.trajectory).expect("the shapes are known");
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
        let contact = bench.judge.contact(&request, &reply.trajectory).expect("the shapes are known");
        assert_eq!(contact.map(|contact| contact.b).as_deref(), Some("ball"));
    }

    #[test]
    fn blocks_stand_apart_and_inside_the_box() {
        let mut drawer = Drawer::new(3).expect("the arm can be planned for");
        let blocks = drawer.blocks(CLUTTER);
        assert_eq!(blocks.len(), CLUTTER);
        for (k, a) in blocks.iter().enumerate() {
            assert!(a.x.abs() < 0.125 && a.y.abs() < 0.275 && a.y.abs() > 0.03, "{a}");
            assert!(blocks[..k].iter().all(|b| (a - b).norm() > 2.0 * BLOCK_RADIUS), "{a}");
        }
    }
}
