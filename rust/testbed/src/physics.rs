use crate::ConfigError;
use proact_types::format_number;
use serde::{Deserialize, Serialize};

/// The physics' part of a trial's configuration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhysicsConfig {
    /// Who moves the arm and what it touches.
    #[serde(default)]
    pub engine: PhysicsEngine,
    /// How heavy the arm is.
    #[serde(default)]
    pub mass_set: MassSet,
    /// What drives the joints.
    #[serde(default)]
    pub joint_control: JointControl,
    /// When the hand takes a block and lets it go.
    #[serde(default)]
    pub grasp_rule: GraspRuleName,
    /// Numbers of the rule `opposing`.
    #[serde(default)]
    pub opposing_grasp: OpposingGrasp,
    /// Numbers of the rule `original`.
    #[serde(default)]
    pub original_grasp: OriginalGrasp,
}

impl PhysicsConfig {
    /// What the published code has: Gazebo moved its arm by ODE.
    pub const ORIGINAL: Self = Self {
        engine: PhysicsEngine::Ode,
        mass_set: MassSet::Description,
        joint_control: JointControl::OriginalGains,
        grasp_rule: GraspRuleName::Original,
        opposing_grasp: OpposingGrasp::DEFAULT,
        original_grasp: OriginalGrasp::DEFAULT,
    };

    /// Checks ranges.
    ///
    /// # Errors
    /// [`ConfigError::Value`] naming the first key that is out of range.
    pub fn check(&self) -> Result<(), ConfigError> {
        let factor = self.mass_set.factor();
        let (ours, original) = (&self.opposing_grasp, &self.original_grasp);
        let within = |key, got: f64, allowed: std::ops::RangeInclusive<f64>, expected| {
            if allowed.contains(&got) {
                return Ok(());
            }
            Err(ConfigError::Value { key, got: format_number(got), expected })
        };
        // Damping, friction and blocks are not scaled: a light arm is too weak for a block, and gains that were chosen for
        // these masses let heavier ones fall.
        match self.joint_control {
            JointControl::FeedForward => {
                within("physics.mass_set.scaled", factor, 0.3..=100.0, "0.3 to 100")?
            }
            JointControl::OriginalGains => within(
                "physics.mass_set.scaled",
                factor,
                0.01..=1.0,
                "0.01 to 1 with original_gains, which cannot bear more",
            )?,
        }
        within("physics.opposing_grasp.min_angle_deg", ours.min_angle_deg, 0.0..=180.0, "0 to 180")?;
        within("physics.opposing_grasp.min_force_n", ours.min_force_n, 0.0..=1e3, "0 to 1000")?;
        within("physics.opposing_grasp.min_force_ratio", ours.min_force_ratio, 0.0..=1.0, "0 to 1")?;
        within("physics.opposing_grasp.hold_ms", ours.hold_ms.into(), 1.0..=1e4, "1 to 10000")?;
        within("physics.opposing_grasp.release_opening_rad", ours.release_opening_rad, 0.0..=3.0, "0 to 3")?;
        within(
            "physics.original_grasp.check_interval_ms",
            original.check_interval_ms.into(),
            1.0..=1e4,
            "1 to 10000",
        )?;
        within(
            "physics.original_grasp.forces_angle_tolerance_deg",
            original.forces_angle_tolerance_deg,
            0.0..=180.0,
            "0 to 180",
        )?;
        within("physics.original_grasp.min_force_n", original.min_force_n, 0.0..=1e3, "0 to 1000")?;
        within("physics.original_grasp.min_force_ratio", original.min_force_ratio, 0.0..=1.0, "0 to 1")?;
        within(
            "physics.original_grasp.grip_count_threshold",
            original.grip_count_threshold.into(),
            0.0..=1e3,
            "0 to 1000",
        )?;
        within(
            "physics.original_grasp.max_grip_count",
            original.max_grip_count.into(),
            1.0..=1e3,
            "1 to 1000",
        )?;
        within(
            "physics.original_grasp.release_tolerance_m",
            original.release_tolerance_m,
            0.0..=1.0,
            "0 to 1",
        )?;
        within(
            "physics.original_grasp.pressing_distance_m",
            original.pressing_distance_m,
            0.0..=1.0,
            "0 to 1",
        )
    }
}

/// When two digits hold a block by the rule `opposing`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OpposingGrasp {
    /// Two contacts hold a block when their normals are further apart than this, degrees (the original: 100).
    pub min_angle_deg: f64,
    /// A contact counts from this force, newtons (the original: 1e-4).
    pub min_force_n: f64,
    /// The weaker of two opposing contacts has at least this share of the stronger one's force (the original: 0.3
    /// of forces averaged over 250 ms; ours are of one tick, and rougher).
    pub min_force_ratio: f64,
    /// Opposing contact for this long attaches, ms of simulated time. (The original: five checks at 4 Hz of wall
    /// time, so more than a second, and longer on a slow machine.)
    pub hold_ms: u32,
    /// A finger joint that has opened by this much since the grasp lets the block go, rad.
    pub release_opening_rad: f64,
}

impl OpposingGrasp {
    /// What trials have unless they say otherwise.
    pub const DEFAULT: Self = Self {
        min_angle_deg: 100.0,
        min_force_n: 1e-4,
        min_force_ratio: 0.05,
        hold_ms: 40,
        release_opening_rad: 0.01,
    };
}

impl Default for OpposingGrasp {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Numbers of the rule `original`: parameters and constants of its `GazeboGraspFix`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OriginalGrasp {
    /// From one check to the next, ms: 4 Hz. (The original's are of wall time.)
    pub check_interval_ms: u32,
    /// Two forces oppose each other when they are further apart than this, degrees.
    pub forces_angle_tolerance_deg: f64,
    /// Least mean force of a link on a block, newtons.
    pub min_force_n: f64,
    /// The smaller of two opposing forces has at least this share of the larger.
    pub min_force_ratio: f64,
    /// A block is taken when its count of checks is above this.
    pub grip_count_threshold: u32,
    /// The count grows no further.
    pub max_grip_count: u32,
    /// A finger that has come away by more than this lets the block go, metres.
    pub release_tolerance_m: f64,
    /// A finger that has come away by less still presses, metres. Assumed: the original goes on measuring the forces on
    /// a block that it has taken; here a carried block touches no link.
    pub pressing_distance_m: f64,
}

impl OriginalGrasp {
    /// The published numbers.
    pub const DEFAULT: Self = Self {
        check_interval_ms: 250,
        forces_angle_tolerance_deg: 100.0,
        min_force_n: 1e-4,
        min_force_ratio: 0.3,
        grip_count_threshold: 4,
        max_grip_count: 8,
        release_tolerance_m: 0.03,
        pressing_distance_m: 0.002,
    };
}

impl Default for OriginalGrasp {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Who moves the arm and what it touches: `"reduced"` or `"ode"`. Blocks that do not hang together with the arm by
/// contacts are ODE's in both, and so is the search for contacts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PhysicsEngine {
    /// Ours, in joint angles, solved together with the blocks that the arm touches. Joints cannot come apart, energy is
    /// kept to second order, and free fingers cost little.
    #[default]
    Reduced,
    /// ODE's: a body for each link, held together by hinges, as in Gazebo. Loses energy when nothing drives it.
    Ode,
}

/// How heavy the arm is: `"description"`, `"real_limb"` or `{ scaled = 2.5 }`. Each factor is on masses, inertias and
/// effort limits alike, so that the arm can bear itself as before; damping, friction and the blocks stay.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MassSet {
    /// The masses of the arm's description. The public MPL model has 0.53 kg in all, about a tenth of the real limb.
    #[default]
    Description,
    /// Ten times the description: the MPL's at about 5.3 kg. That the real limb weighs about ten times the public
    /// model is taken over; how its weight is spread, and that its motors grow with it, is assumed.
    RealLimb,
    /// Another factor, above zero.
    Scaled(f64),
}

impl MassSet {
    /// On masses, inertias and effort limits.
    pub fn factor(self) -> f64 {
        match self {
            Self::Description => 1.0,
            Self::RealLimb => 10.0,
            Self::Scaled(factor) => factor,
        }
    }
}

/// What drives the joints.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JointControl {
    /// Position control with exact feed-forward and effort limits: no sag.
    #[default]
    FeedForward,
    /// The original's gains: proportional and derivative, no feed-forward, no effort limit, commands followed at 0.5 rad/s
    /// at most. The arm sags under its weight and fingers press weakly. Of the MPL arm only.
    OriginalGains,
}

/// When the hand takes a block and lets it go.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GraspRuleName {
    /// Two digits that oppose each other for 40 ms take a block; opening lets it go at once.
    #[default]
    Opposing,
    /// The original's `GazeboGraspFix`: five checks at 4 Hz, and four that fail before it lets go.
    Original,
}
