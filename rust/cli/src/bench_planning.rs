//! `proact bench planning`: reach, carry and place problems drawn from a seed, in the box and among 20 blocks.

mod searches;

use crate::bench::{BenchFigure, BenchReport, quantile};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use nalgebra::{Translation3, UnitQuaternion};
use proact_kinematics::{ArmKinematics, IkOutcome, Kinematics};
use proact_planning::{ArmPlanner, CollisionScene, PlannerOptions, SearchLimits};
use proact_tasks::{PlaceRegion, TABLE_TOP, fixed_objects};
use proact_testbed::Setup;
use proact_types::{
    ArmModel, AttachedObject, BlockId, JointVector, Obstacle, PlanGoal, PlanReply, PlanRequest, PlanStatus,
    Point, Pose, Shape, Trajectory, TrunkPosture, Vector, joints,
};
use std::{error::Error, io::IsTerminal, sync::Arc, time::Instant};

/// The problems of the report. Nothing was tuned on this seed: tests and trials of settings use others.
const HELD_OUT: u64 = 0x5eed_0006;
/// Share of the problems that stand in the cluttered scene.
const CLUTTERED: f64 = 0.2;
/// Blocks of the cluttered scene.
const CLUTTER: usize = 20;
/// One problem in so many is planned again and again for as long as `LONG_SECS`.
const LONG_EVERY: usize = 64;
/// One problem in so many is also searched as OMPL does by itself.
const SEARCH_EVERY: usize = 8;
/// Time between checked states of a finished path, seconds: at most 1.5 mrad a joint, about 1 mm at the hand.
const CHECK_SECS: f64 = 0.003;
/// Poses over the box that are drawn until the arm alone could take one.
const DRAWS: usize = 12;
/// The task's block, metres.
const BLOCK_RADIUS: f64 = 0.025;
const BLOCK_HEIGHT: f64 = 0.05;
const BLOCK: Shape = Shape::Cylinder { radius: BLOCK_RADIUS, length: BLOCK_HEIGHT };

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Reach,
    Carry,
    Place,
}

impl Kind {
    const ALL: [Kind; 3] = [Kind::Reach, Kind::Carry, Kind::Place];

    fn name(self) -> &'static str {
        ["reach", "carry", "place"][self as usize]
    }
}

/// What one problem gave.
struct Answer {
    kind: Kind,
    cluttered: bool,
    /// Wall time of the plan, ms.
    time_ms: f64,
    /// It leads to the goal and touches nothing at fine steps.
    solved: bool,
    /// It leads to the goal, but a fine look finds a contact.
    touches: bool,
    /// A much larger search finds a way, or this one did.
    reachable: bool,
    /// Length of the path in joint space, rad (L2), and its duration, s; of solved ones.
    length: f64,
    duration: f64,
}

/// Everything a problem is drawn from and judged by.
struct Bench {
    model: Arc<ArmModel>,
    kinematics: Kinematics,
    planner: ArmPlanner,
    /// Tells what is reachable: far more postures, ways and iterations.
    thorough: ArmPlanner,
    checker: CollisionScene,
    setups: [Setup; 2],
    random: Random,
    answers: Vec<Answer>,
    /// Requests kept for the long search, with length and duration of their plan.
    kept: Vec<(PlanRequest, f64, f64)>,
    /// Searches in joint space alone: ours, and OMPL's own.
    searches: [Vec<searches::Search>; 2],
}

/// SplitMix64 (Steele, Lea and Flood, OOPSLA 2014): enough to scatter problems.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * ((self.next() >> 11) as f64 / (1_u64 << 53) as f64)
    }
}

/// Plans at least `problems` drawn problems and reports times, success, contacts, lengths.
///
/// A few minutes for 1,000, most of it the search for what a few seconds of planning would give and the fine
/// check of every path. The problems depend on a fixed seed alone; the times on the machine.
///
/// # Errors
/// A model that the planner refuses; no set-up of the known names.
pub(crate) fn planning(problems: usize) -> Result<BenchReport, Box<dyn Error>> {
    planning_from(HELD_OUT, problems)
}

fn planning_from(seed: u64, problems: usize) -> Result<BenchReport, Box<dyn Error>> {
    let mut bench = Bench::new(seed)?;
    let bar = bar(problems);
    while bench.answers.len() < problems {
        let cluttered = (bench.answers.len() as f64) < CLUTTERED * problems as f64;
        bench.round(cluttered)?;
        bar.set_position(bench.answers.len().min(problems) as u64);
    }
    let mut figures = bench.figures();
    figures.extend(bench.search_figures());
    bar.set_message("a few problems for five seconds each");
    figures.extend(bench.beside_long_searches());
    figures.push(bench.checks_per_second()?);
    bar.finish_and_clear();
    Ok(BenchReport { stage: "planning".to_owned(), figures })
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
        let model = Arc::new(proact_description::mpl_right_arm());
        let planner = |options| -> Result<ArmPlanner, Box<dyn Error>> {
            let kinematics = Box::new(Kinematics::new(&model)?);
            Ok(ArmPlanner::new(model.clone(), kinematics, options)?)
        };
        let search = SearchLimits { max_iterations: 100_000, ..SearchLimits::default() };
        let thorough = PlannerOptions { postures: 10, goals: 24, search, ..PlannerOptions::default() };
        Ok(Self {
            kinematics: Kinematics::new(&model)?,
            planner: planner(PlannerOptions::default())?,
            thorough: planner(thorough)?,
            checker: CollisionScene::new(&model)?,
            setups: [Setup::named("still")?, Setup::named("seated")?],
            random: Random(seed),
            answers: Vec::new(),
            kept: Vec::new(),
            searches: [Vec::new(), Vec::new()],
            model,
        })
    }

    /// A block is reached for, carried over a drawn point and put down at another; what follows a failure is
    /// left out.
    fn round(&mut self, cluttered: bool) -> Result<(), Box<dyn Error>> {
        let world_from_base = self.base();
        let blocks = self.blocks(if cluttered { CLUTTER } else { BlockId::ALL.len() });
        let obstacles = obstacles(&blocks);
        let open = joints(self.model.pose("hand", "open")?);
        let Some(start) = self.start(&world_from_base, &open, &obstacles)? else { return Ok(()) };
        let mut request = PlanRequest {
            id: 1,
            world_from_base,
            start,
            hand: open,
            goal: PlanGoal::Pick { block: BlockId::Red1, centre: blocks[0] },
            obstacles,
            attached: None,
            seed: self.random.next(),
        };
        let Some(grip) = self.ask(Kind::Reach, cluttered, &request)? else { return Ok(()) };

        let tip = world_from_base * self.kinematics.forward(&grip)?;
        let object = Pose::translation(blocks[0].x, blocks[0].y, blocks[0].z);
        request.obstacles.retain(|o| o.name != BlockId::Red1.name());
        request.hand = joints(self.model.pose("hand", "closed")?);
        request.attached = Some(AttachedObject {
            name: BlockId::Red1.name().to_owned(),
            shape: BLOCK,
            tip_from_object: tip.inverse() * object,
        });
        request.start = grip;
        // The hand as it grips, turned a little about the vertical, over the other half of the box.
        let mut pose = tip;
        for _ in 0..DRAWS {
            let over = self.place(&blocks) + Vector::z() * self.random.between(0.16, 0.24);
            let yaw = UnitQuaternion::from_axis_angle(&Vector::z_axis(), self.random.between(-0.5, 0.5));
            let turned = Pose::from_parts(Translation3::from(over.coords), yaw * object.rotation);
            pose = turned * object.inverse() * tip;
            let base_from_tip = world_from_base.inverse() * pose;
            if let IkOutcome::Solved(_) = self.kinematics.inverse(&base_from_tip, &request.start)? {
                break;
            }
        }
        request.goal = PlanGoal::TipPose { pose };
        request.seed = self.random.next();
        if let Some(there) = self.ask(Kind::Carry, cluttered, &request)? {
            request.start = there;
        }
        request.goal = PlanGoal::Place { point: self.place(&blocks) };
        request.seed = self.random.next();
        self.ask(Kind::Place, cluttered, &request)?;
        Ok(())
    }

    /// The still shoulder, or the leaning person, both moved about a little.
    fn base(&mut self) -> Pose {
        let setup = &self.setups[(self.random.next() % 2) as usize].body;
        let mut lean = || self.random.between(-2.0, 2.0);
        let seated = setup.forward_max_deg > 0.0;
        let [forward, lateral, axial] = setup.reach_deg.map(|degrees| {
            let about = lean();
            if seated { (degrees + about).to_radians() } else { 0.0 }
        });
        let shift = Translation3::new(lean() * 0.005, lean() * 0.005, lean() * 0.005);
        shift * setup.shoulder_pose(&TrunkPosture { forward, lateral, axial })
    }

    /// Centres of standing blocks: four on the starting half, further ones anywhere in the box.
    fn blocks(&mut self, count: usize) -> Vec<Point> {
        let mut centres: Vec<Point> = Vec::new();
        for attempt in 0.. {
            // Room for fingers around the first four, as in the task; the rest stand closer.
            let (apart, y_max) = if centres.len() < 4 { (0.1, -0.045) } else { (0.06, 0.265) };
            let x = self.random.between(-0.115, 0.115);
            let y = self.random.between(-0.26, y_max);
            let centre = Point::new(x, y, TABLE_TOP + BLOCK_HEIGHT / 2.0);
            let clear = y.abs() > 0.035 && centres.iter().all(|c| (c - centre).norm() > apart);
            if clear {
                centres.push(centre);
            }
            if centres.len() == count {
                break;
            }
            // A few blocks can stand so that no further one fits.
            if attempt % 2000 == 1999 {
                centres.clear();
            }
        }
        centres
    }

    /// A place on the table with room for a block, on the side of the targets.
    fn place(&mut self, blocks: &[Point]) -> Point {
        let PlaceRegion { min, max } = PlaceRegion::DEFAULT;
        let mut best = (f64::NEG_INFINITY, Point::origin());
        for _ in 0..200 {
            let point = Point::new(
                self.random.between(min[0], max[0]),
                self.random.between(min[1], max[1]),
                TABLE_TOP,
            );
            let room = blocks.iter().map(|b| (b - point).xy().norm()).fold(f64::INFINITY, f64::min);
            if room > 0.1 {
                return point;
            }
            if room > best.0 {
                best = (room, point);
            }
        }
        best.1
    }

    /// Free arm angles around those at which a trial begins.
    fn start(
        &mut self,
        base: &Pose,
        hand: &JointVector,
        obstacles: &[Obstacle],
    ) -> Result<Option<JointVector>, Box<dyn Error>> {
        let usual = self.model.pose("arm", "start")?.to_vec();
        for _ in 0..50 {
            let near = |(k, angle): (usize, &f64)| {
                let limits = &self.model.joints[self.model.arm[k]].limits;
                (angle + self.random.between(-0.3, 0.3)).clamp(limits.lower, limits.upper)
            };
            let q: Vec<f64> = usual.iter().enumerate().map(near).collect();
            if self.planner.collisions(&q, hand, obstacles, None, base)?.is_empty() {
                return Ok(Some(joints(&q)));
            }
        }
        Ok(None)
    }

    /// Plans, notes the outcome, and returns where the plan ends if it was solved.
    fn ask(
        &mut self,
        kind: Kind,
        cluttered: bool,
        request: &PlanRequest,
    ) -> Result<Option<JointVector>, Box<dyn Error>> {
        let begin = Instant::now();
        let reply = self.planner.solve(request);
        let time_ms = begin.elapsed().as_secs_f64() * 1e3;
        let ok = reply.status == PlanStatus::Ok;
        let touches = ok && self.touches(request, &reply)?;
        let solved = ok && !touches;
        let (length, duration) = (length(&reply.trajectory), reply.trajectory.duration_secs());
        if solved && !cluttered && self.answers.len().is_multiple_of(SEARCH_EVERY) {
            self.search_beside_plain_ompl(request, &reply.trajectory)?;
        }
        // What has not been solved may be out of reach: a far larger search, begun elsewhere, decides.
        let reachable = ok || {
            let seed = request.seed.wrapping_add(1);
            self.thorough.solve(&PlanRequest { seed, ..request.clone() }).status == PlanStatus::Ok
        };
        if solved && !cluttered && self.answers.len().is_multiple_of(LONG_EVERY) {
            self.kept.push((request.clone(), length, duration));
        }
        self.answers.push(Answer { kind, cluttered, time_ms, solved, touches, reachable, length, duration });
        Ok(ok.then(|| reply.trajectory.points[reply.trajectory.points.len() - 1].q.clone()))
    }

    /// True if anything touches anywhere on the way, without padding, but for what belongs to the purpose: the
    /// fingers at the block that they grip, and a gripped block that still stands on the table.
    fn touches(&mut self, request: &PlanRequest, reply: &PlanReply) -> Result<bool, Box<dyn Error>> {
        let scene = &mut self.checker;
        scene.set_base(&request.world_from_base)?;
        scene.set_hand(&request.hand)?;
        let gripped = match &request.goal {
            PlanGoal::Pick { block, .. } => Some(block.name()),
            _ => None,
        };
        let around: Vec<Obstacle> =
            request.obstacles.iter().filter(|o| Some(o.name.as_str()) != gripped).cloned().collect();
        scene.set_obstacles(&around)?;
        scene.set_attached(request.attached.as_ref())?;
        if let Some(object) = &request.attached {
            scene.allow_contact(&object.name, "table")?;
        }
        let count = (reply.trajectory.duration_secs() / CHECK_SECS).ceil() as usize;
        for k in 0..=count {
            let Some((q, _)) = reply.trajectory.sample(k as f64 * CHECK_SECS) else { continue };
            if !scene.is_free(&q)? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    fn figures(&self) -> Vec<BenchFigure> {
        let mut figures = Vec::new();
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
            add("problems", here.len() as f64, "1", "drawn from a seed that nothing was tuned on");
            let times: Vec<f64> = reachable.iter().map(|a| a.time_ms).collect();
            add("plan, median", quantile(&times, 0.5), "ms", "goal: at most 10");
            add("plan, 99 %", quantile(&times, 0.99), "ms", "goal: at most 100");
            add("plan, worst", quantile(&times, 1.0), "ms", "");
            for kind in Kind::ALL {
                let of_kind: Vec<f64> =
                    reachable.iter().filter(|a| a.kind == kind).map(|a| a.time_ms).collect();
                if !of_kind.is_empty() {
                    add(&format!("{}, median", kind.name()), quantile(&of_kind, 0.5), "ms", "");
                }
            }
            let solved: Vec<&Answer> = reachable.iter().copied().filter(|a| a.solved).collect();
            let share = solved.len() as f64 / reachable.len() as f64;
            add("reachable goals solved", share, "1", "goal: at least 0.995; reachable by a larger search");
            let touching = here.iter().filter(|a| a.touches).count() as f64;
            add(
                "paths with a contact",
                touching,
                "1",
                "by FCL, unpadded, every 3 ms; they do not count as solved",
            );
            add("out of reach", beyond.len() as f64, "1", "no way by the larger search either");
            if !beyond.is_empty() {
                add(
                    "refusal, median",
                    quantile(&beyond, 0.5),
                    "ms",
                    "time until told that it is out of reach",
                );
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
    fn checks_per_second(&mut self) -> Result<BenchFigure, Box<dyn Error>> {
        const CHECKS: usize = 20_000;
        self.checker.set_base(&self.setups[0].body.shoulder_pose(&TrunkPosture::default()))?;
        self.checker.set_obstacles(&obstacles(&[]))?;
        self.checker.set_attached(None)?;
        let states: Vec<Vec<f64>> = (0..CHECKS)
            .map(|_| {
                let limits = self.model.arm.iter().map(|&joint| self.model.joints[joint].limits);
                limits.map(|l| self.random.between(l.lower, l.upper)).collect()
            })
            .collect();
        let begin = Instant::now();
        for q in &states {
            self.checker.is_free(q)?;
        }
        let rate = CHECKS as f64 / begin.elapsed().as_secs_f64();
        Ok(BenchFigure::alone(
            "state checks through the bridge",
            rate,
            "1/s",
            "random states in the box scene",
        ))
    }
}

/// The fixed objects, and blocks at `centres`; the first four have the task's names.
fn obstacles(centres: &[Point]) -> Vec<Obstacle> {
    let fixed = fixed_objects().into_iter().map(|o| Obstacle { name: o.name, shape: o.shape, pose: o.pose });
    let blocks = centres.iter().enumerate().map(|(k, c)| Obstacle {
        name: BlockId::ALL.get(k).map_or_else(|| format!("block_{k}"), |id| id.name().to_owned()),
        shape: BLOCK,
        pose: Pose::translation(c.x, c.y, c.z),
    });
    fixed.chain(blocks).collect()
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

    /// Figures belong to the bench; what is tested is that the problems are what they claim and add up.
    #[test]
    fn drawn_problems_are_mostly_solved_without_a_contact_and_depend_on_the_seed() {
        let value = |report: &BenchReport, name: &str| {
            report.figures.iter().find(|f| f.name == name).map(|f| f.value).expect("the figure is there")
        };
        let one = planning_from(1, 20).expect("the arm can be planned for");
        assert!(value(&one, "box: problems") + value(&one, "20 blocks: problems") >= 20.0);
        assert!(value(&one, "box: reachable goals solved") > 0.8, "{one}");
        assert!(one.figures.iter().all(|f| f.value.is_finite()));
        let again = planning_from(1, 20).expect("the arm can be planned for");
        let other = planning_from(2, 20).expect("the arm can be planned for");
        let length = "box: path length, median";
        assert_eq!(value(&one, length), value(&again, length), "the problems come from the seed alone");
        assert_ne!(value(&one, length), value(&other, length));
    }

    #[test]
    fn blocks_stand_apart_and_inside_the_box() {
        let mut bench = Bench::new(3).expect("the arm can be planned for");
        let blocks = bench.blocks(CLUTTER);
        assert_eq!(blocks.len(), CLUTTER);
        for (k, a) in blocks.iter().enumerate() {
            assert!(a.x.abs() < 0.125 && a.y.abs() < 0.275 && a.y.abs() > 0.03, "{a}");
            assert!(blocks[..k].iter().all(|b| (a - b).norm() > 2.0 * BLOCK_RADIUS), "{a}");
        }
    }
}
