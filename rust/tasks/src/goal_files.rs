//! What the display asks for, as a task's file has it.

use crate::{TaskError, goals::TaskGoals, moves::ObjectMove, scene::is_supported};
use proact_types::{PlaceRegion, Point, Scene, Target};
use serde::{Deserialize, Serialize};

/// Two places of one height nearer than this are one place in the scene, metres.
const SAME_PLACE_M: f64 = 1e-6;
/// Most moves or goals of a trial.
const MAX_GOALS: usize = 200;

fn rule_error<T>(key: &'static str, reason: String) -> Result<T, TaskError> {
    Err(TaskError::Rule { key, reason })
}

fn check_range(key: &'static str, what: &str, got: f64, low: f64, high: f64) -> Result<(), TaskError> {
    if (low..=high).contains(&got) {
        return Ok(());
    }
    rule_error(key, format!("{what} is {got}, expected {low} to {high}"))
}

/// An object to a place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MoveFile {
    /// Name of the object.
    pub object: String,
    /// The place on the surface: x, y, z.
    #[serde(rename = "to")]
    pub position_m: [f64; 3],
    /// Within this the object's middle counts, metres.
    #[serde(rename = "radius")]
    pub radius_m: f64,
}

impl MoveFile {
    /// The moves of a scene, which then has their places as targets.
    pub(crate) fn to_moves(
        files: &[Self],
        mut scene: Scene,
        left: bool,
    ) -> Result<(Scene, Vec<ObjectMove>), TaskError> {
        const KEY: &str = "moves";
        if files.len() > MAX_GOALS {
            return rule_error(KEY, format!("{} moves, expected at most {MAX_GOALS}", files.len()));
        }
        let side = if left { -1.0 } else { 1.0 };
        let mut moves: Vec<ObjectMove> = Vec::new();
        for Self { object, position_m: [x, y, z], radius_m: radius } in files {
            let Some(id) = scene.find_object(object) else {
                let known: Vec<&str> = scene.objects.iter().map(|object| &*object.name).collect();
                return rule_error(KEY, format!("{object:?} is no object; expected {}", known.join(", ")));
            };
            check_range(KEY, "radius", *radius, 1e-3, 1.0)?;
            let to = Point::new(*x, side * y, *z);
            if !to.iter().all(|v| v.is_finite()) || !is_supported(&scene, &to) {
                let position = [*x, *y, *z];
                return rule_error(
                    KEY,
                    format!("{position:?} is on nothing; expected the top of a fixed body"),
                );
            }
            let PlaceRegion { min, max } = scene.place_region;
            let on_table = (to.z - scene.table_height).abs() < SAME_PLACE_M;
            if on_table && (0..2).any(|k| to[k] < min[k] || to[k] > max[k]) {
                return rule_error(KEY, format!("{:?} is on the table outside put_down", [*x, *y, *z]));
            }
            moves.push(ObjectMove { object: id, to, radius: *radius });
        }
        for ObjectMove { object, to, radius } in &moves {
            let known =
                |target: &Target| target.object == *object && (target.center - to).norm() < SAME_PLACE_M;
            if !scene.targets.iter().any(known) {
                scene.targets.push(Target { object: *object, center: *to, radius: *radius });
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
    #[serde(rename = "middle")]
    pub center_m: [f64; 3],
    /// Of each condition the diameter of the ring and that of its balls, metres.
    #[serde(rename = "rings")]
    pub ring_and_target_diameters_m: Vec<[f64; 2]>,
    /// Balls on a ring, an odd number.
    #[serde(rename = "targets")]
    pub targets_per_ring: usize,
    /// Time in a ball that completes a reach, seconds.
    pub dwell_secs: f64,
    /// Time after which a reach is given up, seconds.
    pub limit_secs: f64,
}

impl ReachesFile {
    pub(crate) fn goals(&self, left: bool) -> Result<TaskGoals, TaskError> {
        const KEY: &str = "reaches";
        let Self { center_m: middle, ring_and_target_diameters_m: rings, targets_per_ring: targets, .. } =
            self;
        if !(3..=99).contains(targets) || targets.is_multiple_of(2) {
            return rule_error(KEY, format!("targets is {targets}, expected an odd number from 3 to 99"));
        }
        if rings.is_empty() || rings.len() * (targets + 1) > MAX_GOALS {
            let (got, expected) = (rings.len(), MAX_GOALS / (targets + 1));
            return rule_error(KEY, format!("{got} rings, expected 1 to {expected}"));
        }
        middle.iter().try_for_each(|at| check_range(KEY, "middle", *at, -20.0, 20.0))?;
        check_times(KEY, self.dwell_secs, self.limit_secs)?;
        let side = if left { -1.0 } else { 1.0 };
        let mut balls = Vec::new();
        for (condition, [ring, ball]) in rings.iter().enumerate() {
            check_range(KEY, "the diameter of a ring", *ring, 0.01, 2.0)?;
            check_range(KEY, "the diameter of a ball", *ball, 0.005, 1.0)?;
            // From where the last one lies back to the first, so that each of them is reached from across.
            for number in 0..=*targets {
                let target_index = number * (targets / 2) % targets;
                let angle = std::f64::consts::TAU * target_index as f64 / *targets as f64;
                let (aside, up) = (0.5 * ring * angle.cos(), 0.5 * ring * angle.sin());
                let at = Point::new(middle[0], side * (middle[1] + aside), middle[2] + up);
                balls.push((condition, at, ball / 2.0));
            }
        }
        Ok(TaskGoals::Balls(balls))
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
    #[serde(rename = "share")]
    pub range_share: f64,
}

impl PosturesFile {
    pub(crate) fn goals(&self) -> Result<TaskGoals, TaskError> {
        const KEY: &str = "postures";
        if self.targets.is_empty() || self.targets.len() > MAX_GOALS {
            return rule_error(KEY, format!("{} targets, expected 1 to {MAX_GOALS}", self.targets.len()));
        }
        check_range(KEY, "tolerance_deg", self.tolerance_deg, 0.1, 90.0)?;
        check_times(KEY, self.dwell_secs, self.limit_secs)?;
        let mut postures = Vec::new();
        for target in &self.targets {
            let mut joints: Vec<(u8, f64)> = Vec::new();
            for PostureJoint { joint, range_share: share } in target {
                check_range(KEY, "joint", f64::from(*joint), 1.0, 100.0)?;
                check_range(KEY, "share", *share, 0.0, 1.0)?;
                if joints.iter().any(|(other, _)| other + 1 == *joint) {
                    return rule_error(KEY, format!("joint {joint} stands twice in a posture"));
                }
                joints.push((joint - 1, *share));
            }
            if joints.is_empty() {
                return rule_error(KEY, "a posture without a joint, expected at least one".to_owned());
            }
            postures.push(joints);
        }
        Ok(TaskGoals::Postures(postures, self.tolerance_deg.to_radians()))
    }
}

fn check_times(key: &'static str, dwell: f64, limit: f64) -> Result<(), TaskError> {
    check_range(key, "limit_secs", limit, 0.1, 3600.0)?;
    check_range(key, "dwell_secs", dwell, 0.01, limit)
}
