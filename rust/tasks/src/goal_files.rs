//! What the display asks for, as a task's file has it.

use crate::{TaskError, goals::Goals, moves::Move, scene::is_on_top};
use proact_types::{PlaceRegion, Point, Scene, Target};
use serde::{Deserialize, Serialize};

/// Two places of one height nearer than this are one place in the scene, metres.
const SAME: f64 = 1e-6;
/// Most moves or goals of a trial.
const MOST: usize = 200;

fn wrong<T>(key: &'static str, reason: String) -> Result<T, TaskError> {
    Err(TaskError::Rule { key, reason })
}

fn within(key: &'static str, what: &str, got: f64, low: f64, high: f64) -> Result<(), TaskError> {
    if (low..=high).contains(&got) {
        return Ok(());
    }
    wrong(key, format!("{what} is {got}, expected {low} to {high}"))
}

/// An object to a place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MoveFile {
    /// Name of the object.
    pub object: String,
    /// The place on the surface: x, y, z.
    pub to: [f64; 3],
    /// Within this the object's middle counts, metres.
    pub radius: f64,
}

impl MoveFile {
    /// The moves of a scene, which then has their places as targets.
    pub(crate) fn placed(
        files: &[Self],
        mut scene: Scene,
        left: bool,
    ) -> Result<(Scene, Vec<Move>), TaskError> {
        const KEY: &str = "moves";
        if files.len() > MOST {
            return wrong(KEY, format!("{} moves, expected at most {MOST}", files.len()));
        }
        let side = if left { -1.0 } else { 1.0 };
        let mut moves: Vec<Move> = Vec::new();
        for Self { object, to: [x, y, z], radius } in files {
            let Some(id) = scene.named(object) else {
                let known: Vec<&str> = scene.objects.iter().map(|object| &*object.name).collect();
                return wrong(KEY, format!("{object:?} is no object; expected {}", known.join(", ")));
            };
            within(KEY, "radius", *radius, 1e-3, 1.0)?;
            let to = Point::new(*x, side * y, *z);
            if !to.iter().all(|v| v.is_finite()) || !is_on_top(&scene, &to) {
                let place = [*x, *y, *z];
                return wrong(KEY, format!("{place:?} is on nothing; expected the top of a fixed body"));
            }
            let PlaceRegion { min, max } = scene.put_down;
            let on_table = (to.z - scene.table_height).abs() < SAME;
            if on_table && (0..2).any(|k| to[k] < min[k] || to[k] > max[k]) {
                return wrong(KEY, format!("{:?} is on the table outside put_down", [*x, *y, *z]));
            }
            moves.push(Move { object: id, to, radius: *radius });
        }
        for Move { object, to, radius } in &moves {
            let known = |target: &Target| target.object == *object && (target.centre - to).norm() < SAME;
            if !scene.targets.iter().any(known) {
                scene.targets.push(Target { object: *object, centre: *to, radius: *radius });
            }
        }
        Ok((scene, moves))
    }
}

/// Balls on rings in the frontal plane, one after the other across the ring (ISO/TS 9241-411:2012, multi-directional
/// tapping, taken into space).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReachesFile {
    /// Middle of the rings: x, y, z.
    pub middle: [f64; 3],
    /// Of each condition the diameter of the ring and that of its balls, metres.
    pub rings: Vec<[f64; 2]>,
    /// Balls on a ring, an odd number.
    pub targets: usize,
    /// Time in a ball that completes a reach, seconds.
    pub dwell_secs: f64,
    /// Time after which a reach is given up, seconds.
    pub limit_secs: f64,
}

impl ReachesFile {
    pub(crate) fn goals(&self, left: bool) -> Result<Goals, TaskError> {
        const KEY: &str = "reaches";
        let Self { middle, rings, targets, .. } = self;
        if !(3..=99).contains(targets) || targets.is_multiple_of(2) {
            return wrong(KEY, format!("targets is {targets}, expected an odd number from 3 to 99"));
        }
        if rings.is_empty() || rings.len() * (targets + 1) > MOST {
            let (got, expected) = (rings.len(), MOST / (targets + 1));
            return wrong(KEY, format!("{got} rings, expected 1 to {expected}"));
        }
        middle.iter().try_for_each(|at| within(KEY, "middle", *at, -20.0, 20.0))?;
        check_times(KEY, self.dwell_secs, self.limit_secs)?;
        let side = if left { -1.0 } else { 1.0 };
        let mut balls = Vec::new();
        for (condition, [ring, ball]) in rings.iter().enumerate() {
            within(KEY, "the diameter of a ring", *ring, 0.01, 2.0)?;
            within(KEY, "the diameter of a ball", *ball, 0.005, 1.0)?;
            // From where the last one lies back to the first, so that each of them is reached from across.
            for number in 0..=*targets {
                let place = number * (targets / 2) % targets;
                let angle = std::f64::consts::TAU * place as f64 / *targets as f64;
                let (aside, up) = (0.5 * ring * angle.cos(), 0.5 * ring * angle.sin());
                let at = Point::new(middle[0], side * (middle[1] + aside), middle[2] + up);
                balls.push((condition, at, ball / 2.0));
            }
        }
        Ok(Goals::Balls(balls))
    }
}

/// Postures of the arm one after the other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PosturesFile {
    /// A joint may be off by this much, degrees.
    pub tolerance_deg: f64,
    /// Time in the posture that completes it, seconds.
    pub dwell_secs: f64,
    /// Time after which a posture is given up, seconds.
    pub limit_secs: f64,
    /// Of each posture its joints, counted from 1 at the base, and where each is to be, as a share of its range.
    pub targets: Vec<Vec<PostureJoint>>,
}

/// Where a joint is to be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PostureJoint {
    /// Counted from 1 at the base.
    pub joint: u8,
    /// 0 at its lowest angle, 1 at its highest.
    pub share: f64,
}

impl PosturesFile {
    pub(crate) fn goals(&self) -> Result<Goals, TaskError> {
        const KEY: &str = "postures";
        if self.targets.is_empty() || self.targets.len() > MOST {
            return wrong(KEY, format!("{} targets, expected 1 to {MOST}", self.targets.len()));
        }
        within(KEY, "tolerance_deg", self.tolerance_deg, 0.1, 90.0)?;
        check_times(KEY, self.dwell_secs, self.limit_secs)?;
        let mut postures = Vec::new();
        for target in &self.targets {
            let mut joints: Vec<(u8, f64)> = Vec::new();
            for PostureJoint { joint, share } in target {
                within(KEY, "joint", f64::from(*joint), 1.0, 100.0)?;
                within(KEY, "share", *share, 0.0, 1.0)?;
                if joints.iter().any(|(other, _)| other + 1 == *joint) {
                    return wrong(KEY, format!("joint {joint} stands twice in a posture"));
                }
                joints.push((joint - 1, *share));
            }
            if joints.is_empty() {
                return wrong(KEY, "a posture without a joint, expected at least one".to_owned());
            }
            postures.push(joints);
        }
        Ok(Goals::Postures(postures, self.tolerance_deg.to_radians()))
    }
}

fn check_times(key: &'static str, dwell: f64, limit: f64) -> Result<(), TaskError> {
    within(key, "limit_secs", limit, 0.1, 3600.0)?;
    within(key, "dwell_secs", dwell, 0.01, limit)
}
