//! The problems: each depends on the seed and its number alone, not on how an earlier one was solved.
//!
//! Every problem has a witness: arm angles at the goal, found by KDL from several postures, at which nothing touches
//! anything, and the same a few centimetres above. Whether a way leads there is another question.

use super::{BLOCK, BLOCK_HEIGHT_M, CLUTTER_BLOCKS};
use nalgebra::{Translation3, UnitQuaternion};
use proact_arm::{ArmModel, upright_axis};
use proact_kinematics::{ArmKinematics, IkOutcome, Kinematics};
use proact_planning::{CollisionScene, PlannerOptions};
use proact_tasks::{DEFAULT_TASK, TaskSpec};
use proact_testbed::Setup;
use proact_types::{
    AttachedObject, JointVector, ObjectId, Obstacle, PlaceRegion, PlanGoal, PlanRequest, Point, Pose, Scene,
    TrunkPosture, Vector, joints,
};
use std::{error::Error, sync::Arc};

/// Goals that are drawn until the arm can be at one.
const MAX_GOAL_SAMPLES: usize = 8;
/// Grips that are drawn until one can be left straight upwards.
const MAX_GRASP_SAMPLES: usize = 40;
/// Random postures from which KDL seeks the arm angles of a hand pose.
const IK_SEEDS: usize = 8;
/// Least distance of further blocks from the first one, which is gripped, metres.
const GRASP_CLEARANCE_M: f64 = 0.075;
/// Names of the first blocks.
const BLOCK_NAMES: [&str; 4] = ["red1", "red2", "blue1", "blue2"];
/// Heights above a grip at which the arm must still be free, metres.
const LIFT_HEIGHTS_M: [f64; 4] = [0.02, 0.04, 0.06, 0.08];
/// Largest change of a joint between two of these, rad.
const MAX_LIFT_JOINT_STEP_RAD: f64 = 0.5;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum ProblemKind {
    Reach,
    Carry,
    Place,
}

impl ProblemKind {
    pub(super) const ALL: [ProblemKind; 3] = [ProblemKind::Reach, ProblemKind::Carry, ProblemKind::Place];

    pub(super) fn name(self) -> &'static str {
        ["reach", "carry", "place"][self as usize]
    }
}

/// One problem.
pub(super) struct BenchProblem {
    /// Its number under the seed.
    pub number: usize,
    pub kind: ProblemKind,
    pub cluttered: bool,
    pub request: PlanRequest,
    /// Arm angles over the start and over the goal, clear of what is gripped or put down there: the goal is within
    /// reach if a way leads from one to the other.
    pub reachable_postures: [JointVector; 2],
}

/// SplitMix64 (Steele, Lea and Flood, OOPSLA 2014): enough to scatter problems.
pub(super) struct ProblemRng(pub u64);

impl ProblemRng {
    pub(super) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub(super) fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * ((self.next() >> 11) as f64 / (1_u64 << 53) as f64)
    }
}

/// What a draw gives, if it gives anything.
type SampleResult<T> = Result<Option<T>, Box<dyn Error>>;

/// A way to hold the first block.
struct SampledGrasp {
    tip: Pose,
    attached: AttachedObject,
    /// Arm angles at the block and straight above it.
    at_block: JointVector,
    above_block: JointVector,
}

/// Draws problems.
pub(super) struct ProblemGenerator {
    pub model: Arc<ArmModel>,
    kinematics: Kinematics,
    scene: CollisionScene,
    setups: [Setup; 2],
    box_scene: Scene,
    seed: u64,
    random: ProblemRng,
}

impl ProblemGenerator {
    pub(super) fn new(seed: u64) -> Result<Self, Box<dyn Error>> {
        let model = Arc::new(proact_description::mpl_right_arm());
        Ok(Self {
            kinematics: Kinematics::new(&model)?,
            scene: CollisionScene::new(&model)?,
            setups: [Setup::named("still")?, Setup::named("seated")?],
            random: ProblemRng(seed),
            seed,
            box_scene: box_scene(),
            model,
        })
    }

    /// Problem `number`: a block is reached for, or a gripped one is carried over a drawn point or put down at one.
    pub(super) fn problem(&mut self, number: usize, cluttered: bool) -> Result<BenchProblem, Box<dyn Error>> {
        self.problem_among(number, if cluttered { CLUTTER_BLOCKS } else { BLOCK_NAMES.len() })
    }

    /// The same among so many blocks.
    pub(super) fn problem_among(
        &mut self,
        number: usize,
        blocks: usize,
    ) -> Result<BenchProblem, Box<dyn Error>> {
        let cluttered = blocks > BLOCK_NAMES.len();
        let mut mix = ProblemRng(self.seed ^ (number as u64).wrapping_mul(0xd134_2543_de82_ef95));
        self.random = ProblemRng(mix.next());
        let kind = ProblemKind::ALL[number % 3];
        // A draw in which the hand finds no room at the start is no problem; the next one is taken.
        loop {
            if let Some((request, witness)) = self.sample_problem(kind, blocks)? {
                return Ok(BenchProblem { number, kind, cluttered, request, reachable_postures: witness });
            }
        }
    }

    fn sample_problem(
        &mut self,
        kind: ProblemKind,
        blocks: usize,
    ) -> SampleResult<(PlanRequest, [JointVector; 2])> {
        let blocks = self.sample_blocks(blocks);
        let mut request = PlanRequest {
            id: 1,
            world_from_base: self.sample_base(),
            start: JointVector::new(),
            hand: joints(self.model.pose("hand", "open")?),
            goal: PlanGoal::Pick { object: ObjectId(0), center: blocks[0] },
            picked_object: Some(BLOCK_NAMES[0].to_owned()),
            obstacles: obstacles(&blocks),
            held_joints: Vec::new(),
            attached: None,
            seed: self.random.next(),
        };
        if kind == ProblemKind::Reach {
            let Some(start) = self.sample_start(&request)? else { return Ok(None) };
            request.start = start.clone();
            let Some(grip) = self.sample_grasp(&request, &blocks[0])? else { return Ok(None) };
            return Ok(Some((request, [start, grip.above_block])));
        }
        let Some(grip) = self.sample_grasp(&request, &blocks[0])? else { return Ok(None) };
        request.obstacles.retain(|o| o.name != BLOCK_NAMES[0]);
        request.hand = joints(self.model.pose("hand", "closed")?);
        (request.start, request.attached) = (grip.at_block, Some(grip.attached));
        for _ in 0..MAX_GOAL_SAMPLES {
            let end = match kind {
                ProblemKind::Place => self.sample_place_goal(&mut request, &blocks, &grip.tip)?,
                _ => self.sample_carry_goal(&mut request, &blocks, &grip.tip)?,
            };
            if let Some(end) = end {
                return Ok(Some((request, [grip.above_block, end])));
            }
        }
        Ok(None)
    }

    /// Puts a scene up as it is while the hand is at `hand` and carries `attached`, unpadded. What is carried may
    /// stand on the table.
    fn set_up_scene(
        &mut self,
        request: &PlanRequest,
        hand: &str,
        attached: Option<&AttachedObject>,
    ) -> Result<(), Box<dyn Error>> {
        let carried = |o: &&Obstacle| attached.is_none_or(|a| a.name != o.name);
        let obstacles: Vec<Obstacle> = request.obstacles.iter().filter(carried).cloned().collect();
        self.scene.set_base(&request.world_from_base)?;
        self.scene.set_hand(self.model.pose("hand", hand)?)?;
        self.scene.set_obstacles(&obstacles)?;
        self.scene.set_attached(attached)?;
        self.scene.clear_allowed_contacts()?;
        if let Some(attached) = attached {
            self.scene.allow_contact(&attached.name, "table")?;
        }
        Ok(())
    }

    /// Free arm angles at the hand pose `tip`, and at each of the heights above it, the last of them returned with
    /// the first; none if KDL finds none from a few postures.
    fn solve_with_lifts(
        &mut self,
        request: &PlanRequest,
        tip: &Pose,
        heights: &[f64],
    ) -> SampleResult<(JointVector, JointVector)> {
        let base_from_world = request.world_from_base.inverse();
        let found = self.kinematics.inverse_all(&(base_from_world * tip), IK_SEEDS, self.random.next())?;
        'found: for at in found {
            if !self.scene.is_free(&at)? {
                continue;
            }
            let mut over = at.clone();
            for height in heights {
                let raised = base_from_world * (Translation3::new(0.0, 0.0, *height) * tip);
                let IkOutcome::Solved(next) = self.kinematics.inverse(&raised, &over)? else {
                    continue 'found;
                };
                let near = next.iter().zip(&over).all(|(a, b)| (a - b).abs() < MAX_LIFT_JOINT_STEP_RAD);
                if !near || !self.scene.is_free(&next)? {
                    continue 'found;
                }
                over = next;
            }
            return Ok(Some((at, over)));
        }
        Ok(None)
    }

    /// A drawn grip of the first block, at `center`, from above: the hand can come down straight around the block,
    /// close, and lift it.
    fn sample_grasp(&mut self, request: &PlanRequest, center: &Point) -> SampleResult<SampledGrasp> {
        let grasp = self.model.grasp_for(BLOCK.grip_width()).clone();
        for _ in 0..MAX_GRASP_SAMPLES {
            let roll = self.random.uniform(grasp.roll_range_rad[0], grasp.roll_range_rad[1]);
            let lean = self.random.uniform(-grasp.max_lean_rad, grasp.max_lean_rad);
            let yaw = self.random.uniform(-std::f64::consts::PI, std::f64::consts::PI);
            let axis = upright_axis(roll, lean).normalize();
            let upright = UnitQuaternion::rotation_between(&axis, &Vector::z()).unwrap_or_default();
            let turn = UnitQuaternion::from_axis_angle(&Vector::z_axis(), yaw) * upright;
            let at = center - turn * grasp.center;
            let tip = Pose::from_parts(at.coords.into(), turn);
            let object = Pose::translation(center.x, center.y, center.z);
            let attached = AttachedObject {
                name: BLOCK_NAMES[0].to_owned(),
                shape: BLOCK,
                tip_from_object: tip.inverse() * object,
                loose: false,
            };
            self.set_up_scene(request, &grasp.closed_pose, Some(&attached))?;
            let Some((at, over)) = self.solve_with_lifts(request, &tip, &LIFT_HEIGHTS_M)? else { continue };
            // The open hand goes the same way.
            self.set_up_scene(request, "open", None)?;
            if self.scene.is_free(&at)? && self.scene.is_free(&over)? {
                return Ok(Some(SampledGrasp { tip, attached, at_block: at, above_block: over }));
            }
        }
        Ok(None)
    }

    /// Sets the goal of `request`: the hand as it grips, turned a little about the vertical, over another part of the
    /// box. Arm angles there, if there are any.
    fn sample_carry_goal(
        &mut self,
        request: &mut PlanRequest,
        blocks: &[Point],
        tip: &Pose,
    ) -> SampleResult<JointVector> {
        let over = self.sample_target(blocks) + Vector::z() * self.random.uniform(0.16, 0.24);
        let yaw = UnitQuaternion::from_axis_angle(&Vector::z_axis(), self.random.uniform(-0.5, 0.5));
        let pose = Pose::from_parts(Translation3::from(over.coords), yaw) * block_from_tip(blocks, tip);
        request.goal = PlanGoal::TipPose { pose };
        let attached = request.attached.clone();
        self.set_up_scene(request, "closed", attached.as_ref())?;
        Ok(self.solve_with_lifts(request, &pose, &[])?.map(|(at, _)| at))
    }

    /// Sets the goal of `request`: a place for the block. Arm angles over it, if there are any, for one of several
    /// ways to turn it.
    fn sample_place_goal(
        &mut self,
        request: &mut PlanRequest,
        blocks: &[Point],
        tip: &Pose,
    ) -> SampleResult<JointVector> {
        let point = self.sample_target(blocks);
        request.goal = PlanGoal::Place { point };
        let attached = request.attached.clone();
        self.set_up_scene(request, "closed", attached.as_ref())?;
        let center = point + Vector::z() * (BLOCK_HEIGHT_M / 2.0 + PlannerOptions::default().place_gap_m);
        for _ in 0..MAX_GOAL_SAMPLES {
            let yaw = self.random.uniform(-std::f64::consts::PI, std::f64::consts::PI);
            let turn = UnitQuaternion::from_axis_angle(&Vector::z_axis(), yaw);
            let pose =
                Pose::from_parts(Translation3::from(center.coords), turn) * block_from_tip(blocks, tip);
            if let Some((_, over)) = self.solve_with_lifts(request, &pose, &LIFT_HEIGHTS_M)? {
                return Ok(Some(over));
            }
        }
        Ok(None)
    }

    /// The still shoulder, or the leaning person, both moved about a little.
    fn sample_base(&mut self) -> Pose {
        let setup = &self.setups[(self.random.next() % 2) as usize].body;
        let mut lean = || self.random.uniform(-2.0, 2.0);
        let seated = setup.forward_max_deg > 0.0;
        let [forward, lateral, axial] = setup.reaching_posture_deg.map(|degrees| {
            let about = lean();
            if seated { (degrees + about).to_radians() } else { 0.0 }
        });
        let shift = Translation3::new(lean() * 0.005, lean() * 0.005, lean() * 0.005);
        shift * setup.shoulder_pose(&TrunkPosture { forward, lateral, axial })
    }

    /// Centres of standing blocks: four on the starting half, further ones anywhere in the box.
    pub(super) fn sample_blocks(&mut self, count: usize) -> Vec<Point> {
        let mut centers: Vec<Point> = Vec::new();
        for attempt in 0.. {
            // Room for fingers around the first four, as in the task; the rest stand closer.
            let (min_spacing, y_max) = if centers.len() < 4 { (0.1, -0.045) } else { (0.06, 0.265) };
            let x = self.random.uniform(-0.115, 0.115);
            let y = self.random.uniform(-0.26, y_max);
            let center = Point::new(x, y, self.box_scene.table_height + BLOCK_HEIGHT_M / 2.0);
            let clear = y.abs() > 0.035
                && centers.iter().all(|c| (c - center).norm() > min_spacing)
                && centers.first().is_none_or(|c| (c - center).norm() > GRASP_CLEARANCE_M);
            if clear {
                centers.push(center);
            }
            if centers.len() == count {
                break;
            }
            // A few blocks can stand so that no further one fits.
            if attempt % 2000 == 1999 {
                centers.clear();
            }
        }
        centers
    }

    /// A place on the table with room for a block, on the side of the targets.
    fn sample_target(&mut self, blocks: &[Point]) -> Point {
        let (PlaceRegion { min, max }, table) = (self.box_scene.place_region, self.box_scene.table_height);
        let mut best = (f64::NEG_INFINITY, Point::origin());
        for _ in 0..200 {
            let point =
                Point::new(self.random.uniform(min[0], max[0]), self.random.uniform(min[1], max[1]), table);
            let clearance_m = blocks.iter().map(|b| (b - point).xy().norm()).fold(f64::INFINITY, f64::min);
            if clearance_m > 0.1 {
                return point;
            }
            if clearance_m > best.0 {
                best = (clearance_m, point);
            }
        }
        best.1
    }

    /// Free arm angles around those at which a trial begins.
    fn sample_start(&mut self, request: &PlanRequest) -> Result<Option<JointVector>, Box<dyn Error>> {
        let usual = self.model.pose("arm", "start")?.to_vec();
        self.set_up_scene(request, "open", None)?;
        for _ in 0..50 {
            let near = |(k, angle): (usize, &f64)| {
                let limits = &self.model.joints[self.model.arm[k]].limits;
                (angle + self.random.uniform(-0.3, 0.3)).clamp(limits.lower, limits.upper)
            };
            let q: Vec<f64> = usual.iter().enumerate().map(near).collect();
            if self.scene.is_free(&q)? {
                return Ok(Some(joints(&q)));
            }
        }
        Ok(None)
    }
}

/// `block_from_tip` of a hand at `tip` that grips the first block.
fn block_from_tip(blocks: &[Point], tip: &Pose) -> Pose {
    Pose::translation(blocks[0].x, blocks[0].y, blocks[0].z).inverse() * tip
}

/// The box of the task that the figures are for.
fn box_scene() -> Scene {
    let task = TaskSpec::named(DEFAULT_TASK, 0).and_then(|task| task.build(false));
    task.expect("the default task ships with the program and is tested there").scene().clone()
}

/// The fixed objects, and blocks at `centers`; the first four have the task's names.
pub(super) fn obstacles(centers: &[Point]) -> Vec<Obstacle> {
    let fixed = box_scene().fixed.into_iter().map(|o| Obstacle {
        name: o.name,
        shape: o.shape,
        pose: o.pose,
        loose: false,
    });
    let blocks = centers.iter().enumerate().map(|(k, c)| Obstacle {
        name: BLOCK_NAMES.get(k).map_or_else(|| format!("block_{k}"), |name| (*name).to_owned()),
        shape: BLOCK,
        pose: Pose::translation(c.x, c.y, c.z),
        loose: false,
    });
    fixed.chain(blocks).collect()
}
