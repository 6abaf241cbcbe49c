use serde::{Deserialize, Serialize};

/// The physics' part of a trial's configuration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhysicsConfig {
    /// Who moves the arm and what it touches. Left out of the text where it is the default, so that records from before
    /// there was a choice replay with the digests that they have.
    #[serde(default, skip_serializing_if = "Engine::is_default")]
    pub engine: Engine,
    /// How heavy the arm is.
    #[serde(default)]
    pub mass_set: MassSet,
    /// What drives the joints.
    #[serde(default)]
    pub joint_control: JointControl,
    /// When the hand takes a block and lets it go.
    #[serde(default)]
    pub grasp_rule: GraspRuleName,
}

impl PhysicsConfig {
    /// What the published code has: Gazebo moved its arm by ODE.
    pub const ORIGINAL: Self = Self {
        engine: Engine::Ode,
        mass_set: MassSet::Description,
        joint_control: JointControl::OriginalGains,
        grasp_rule: GraspRuleName::Original,
    };
}

/// Who moves the arm and what it touches: `"reduced"` or `"ode"`. Blocks that do not hang together with the arm by
/// contacts are ODE's in both, and so is the search for contacts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Engine {
    /// Ours, in joint angles, solved together with the blocks that the arm touches. Joints cannot come apart, energy is
    /// kept to second order, and free fingers cost little.
    #[default]
    Reduced,
    /// ODE's: a body for each link, held together by hinges, as in Gazebo. Loses energy when nothing drives it.
    Ode,
}

impl Engine {
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
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
