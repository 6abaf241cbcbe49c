//! The problems: each depends on the seed and its number alone, not on how an earlier one was solved.

use super::{BLOCK, BLOCK_HEIGHT, CLUTTER};
use nalgebra::{Translation3, UnitQuaternion};
use proact_kinematics::{ArmKinematics, IkOutcome, Kinematics};
use proact_planning::{CollisionScene, PlannerOptions};
use proact_tasks::{PlaceRegion, TABLE_TOP, fixed_objects};
use proact_testbed::Setup;
use proact_types::{
    ArmModel, AttachedObject, BlockId, JointVector, Obstacle, PlanGoal, PlanRequest, Point, Pose,
    TrunkPosture, Vector, joints,
};
use std::{error::Error, sync::Arc};

/// Poses over the box that are drawn until the arm alone could take one.
const DRAWS: usize = 12;
/// Grips that are drawn until one can be left straight upwards.
const GRIPS: usize = 80;
/// Heights above a grip at which the arm must still be free, metres.
const LIFTS: [f64; 4] = [0.02, 0.04, 0.06, 0.08];
/// Largest change of a joint between two of these, rad.
const LIFT_JUMP: f64 = 0.5;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Kind {
    Reach,
    Carry,
    Place,
}

impl Kind {
    pub(super) const ALL: [Kind; 3] = [Kind::Reach, Kind::Carry, Kind::Place];

    pub(super) fn name(self) -> &'static str {
        ["reach", "carry", "place"][self as usize]
    }
}

/// One problem.
pub(super) struct Problem {
    /// Its number under the seed.
    pub number: usize,
    pub kind: Kind,
    pub cluttered: bool,
    pub request: PlanRequest,
}

/// SplitMix64 (Steele, Lea and Flood, OOPSLA 2014): enough to scatter problems.
pub(super) struct Random(pub u64);

impl Random {
    pub(super) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * ((self.next() >> 11) as f64 / (1_u64 << 53) as f64)
    }
}

/// Draws problems.
pub(super) struct Drawer {
    pub model: Arc<ArmModel>,
    kinematics: Kinematics,
    scene: CollisionScene,
    setups: [Setup; 2],
    seed: u64,
    random: Random,
}

impl Drawer {
    pub(super) fn new(seed: u64) -> Result<Self, Box<dyn Error>> {
        let model = Arc::new(proact_description::mpl_right_arm());
        Ok(Self {
            kinematics: Kinematics::new(&model)?,
            scene: CollisionScene::new(&model)?,
            setups: [Setup::named("still")?, Setup::named("seated")?],
            random: Random(seed),
            seed,
            model,
        })
    }

    /// Problem `number`: a block is reached for, or a gripped one is carried over a drawn point or put down at one.
    pub(super) fn problem(&mut self, number: usize, cluttered: bool) -> Result<Problem, Box<dyn Error>> {
        let mut mix = Random(self.seed ^ (number as u64).wrapping_mul(0xd134_2543_de82_ef95));
        self.random = Random(mix.next());
        let kind = Kind::ALL[number % 3];
        // A draw in which the hand finds no room at the start is no problem; the next one is taken.
        loop {
            if let Some(request) = self.draw(kind, cluttered)? {
                return Ok(Problem { number, kind, cluttered, request });
            }
        }
    }

    fn draw(&mut self, kind: Kind, cluttered: bool) -> Result<Option<PlanRequest>, Box<dyn Error>> {
        let world_from_base = self.base();
        let blocks = self.blocks(if cluttered { CLUTTER } else { BlockId::ALL.len() });
        let mut request = PlanRequest {
            id: 1,
            world_from_base,
            start: JointVector::new(),
            hand: joints(self.model.pose("hand", "open")?),
            goal: PlanGoal::Pick { block: BlockId::Red1, centre: blocks[0] },
            obstacles: obstacles(&blocks),
            attached: None,
            seed: self.random.next(),
        };
        if kind == Kind::Reach {
            let Some(start) = self.start(&request)? else { return Ok(None) };
            request.start = start;
            return Ok(Some(request));
        }
        request.obstacles.retain(|o| o.name != BlockId::Red1.name());
        request.hand = joints(self.model.pose("hand", "closed")?);
        let Some(tip) = self.grip(&mut request, &blocks[0])? else { return Ok(None) };
        request.goal = match kind {
            Kind::Place => PlanGoal::Place { point: self.place(&blocks) },
            _ => self.carry(&request, &blocks, &tip)?,
        };
        Ok(Some(request))
    }

    /// Closes the hand around the block at `centre` in a drawn way, from above, that the arm can leave straight
    /// upwards: start and carried block of `request`. Returns the tip's pose.
    fn grip(&mut self, request: &mut PlanRequest, centre: &Point) -> Result<Option<Pose>, Box<dyn Error>> {
        let options = PlannerOptions::default();
        let base_from_world = request.world_from_base.inverse();
        let usual = self.model.pose("arm", "start")?.to_vec();
        self.scene.set_base(&request.world_from_base)?;
        self.scene.set_hand(&request.hand)?;
        self.scene.set_obstacles(&request.obstacles)?;
        for _ in 0..GRIPS {
            let tilt = self.random.between(options.tilt_range[0], options.tilt_range[1]);
            let lean = self.random.between(-options.lateral, options.lateral);
            let yaw = self.random.between(-std::f64::consts::PI, std::f64::consts::PI);
            let axis = Vector::new(-lean.sin(), lean.cos() * tilt.sin(), lean.cos() * tilt.cos()).normalize();
            let upright = UnitQuaternion::rotation_between(&axis, &Vector::z()).unwrap_or_default();
            let turn = UnitQuaternion::from_axis_angle(&Vector::z_axis(), yaw) * upright;
            let at = centre - turn * self.model.grasp_centre;
            let tip = Pose::from_parts(at.coords.into(), turn);
            let object = Pose::translation(centre.x, centre.y, centre.z);
            let attached = AttachedObject {
                name: BlockId::Red1.name().to_owned(),
                shape: BLOCK,
                tip_from_object: tip.inverse() * object,
            };
            self.scene.set_attached(Some(&attached))?;
            self.scene.forget_allowed_contacts()?;
            self.scene.allow_contact(&attached.name, "table")?;
            let mut q = usual.clone();
            let mut begin = None;
            let mut free = true;
            for lift in std::iter::once(0.0).chain(LIFTS) {
                let raised = base_from_world * (Translation3::new(0.0, 0.0, lift) * tip);
                let IkOutcome::Solved(next) = self.kinematics.inverse(&raised, &q)? else {
                    free = false;
                    break;
                };
                let near = lift == 0.0 || next.iter().zip(&q).all(|(a, b)| (a - b).abs() < LIFT_JUMP);
                if !near || !self.scene.is_free(&next)? {
                    free = false;
                    break;
                }
                q = next.to_vec();
                begin.get_or_insert(next);
            }
            if let (true, Some(start)) = (free, begin) {
                (request.start, request.attached) = (start, Some(attached));
                return Ok(Some(tip));
            }
        }
        Ok(None)
    }

    /// The hand as it grips, turned a little about the vertical, over another part of the box.
    fn carry(
        &mut self,
        request: &PlanRequest,
        blocks: &[Point],
        tip: &Pose,
    ) -> Result<PlanGoal, Box<dyn Error>> {
        let object = Pose::translation(blocks[0].x, blocks[0].y, blocks[0].z);
        let mut pose = *tip;
        for _ in 0..DRAWS {
            let over = self.place(blocks) + Vector::z() * self.random.between(0.16, 0.24);
            let yaw = UnitQuaternion::from_axis_angle(&Vector::z_axis(), self.random.between(-0.5, 0.5));
            let turned = Pose::from_parts(Translation3::from(over.coords), yaw * object.rotation);
            pose = turned * object.inverse() * tip;
            let base_from_tip = request.world_from_base.inverse() * pose;
            if let IkOutcome::Solved(_) = self.kinematics.inverse(&base_from_tip, &request.start)? {
                break;
            }
        }
        Ok(PlanGoal::TipPose { pose })
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
    pub(super) fn blocks(&mut self, count: usize) -> Vec<Point> {
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
    fn start(&mut self, request: &PlanRequest) -> Result<Option<JointVector>, Box<dyn Error>> {
        let usual = self.model.pose("arm", "start")?.to_vec();
        self.scene.set_base(&request.world_from_base)?;
        self.scene.set_hand(&request.hand)?;
        self.scene.set_obstacles(&request.obstacles)?;
        self.scene.set_attached(None)?;
        for _ in 0..50 {
            let near = |(k, angle): (usize, &f64)| {
                let limits = &self.model.joints[self.model.arm[k]].limits;
                (angle + self.random.between(-0.3, 0.3)).clamp(limits.lower, limits.upper)
            };
            let q: Vec<f64> = usual.iter().enumerate().map(near).collect();
            if self.scene.is_free(&q)? {
                return Ok(Some(joints(&q)));
            }
        }
        Ok(None)
    }
}

/// The fixed objects, and blocks at `centres`; the first four have the task's names.
pub(super) fn obstacles(centres: &[Point]) -> Vec<Obstacle> {
    let fixed = fixed_objects().into_iter().map(|o| Obstacle { name: o.name, shape: o.shape, pose: o.pose });
    let blocks = centres.iter().enumerate().map(|(k, c)| Obstacle {
        name: BlockId::ALL.get(k).map_or_else(|| format!("block_{k}"), |id| id.name().to_owned()),
        shape: BLOCK,
        pose: Pose::translation(c.x, c.y, c.z),
    });
    fixed.chain(blocks).collect()
}
