//! What an arm's folder says of the arm beyond its URDF and SRDF.

use proact_types::Point;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// How an arm is shown and driven where the method's profile does not say otherwise: the file `arm.toml` of its folder.
///
/// Joints and links are named in full, or by what follows the last `__` of their names ([`matches_short_name`]).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(default)]
pub struct ArmSettings {
    /// As shown to people; empty is the robot's name.
    pub title: String,
    /// Arm joints that method A cycles through, in this order; empty is every driven joint, base to tip.
    #[serde(rename = "cycle")]
    pub joint_cycle: Vec<String>,
    /// Arm joints that the prosthesis has, by level of limb loss; an empty list is every arm joint.
    pub levels: BTreeMap<String, Vec<String>>,
    /// How joints are shown, and which way they go. Joints without an entry go by their own names.
    pub joints: Vec<JointEntry>,
    /// Gains of the control `original_gains`, by joint.
    pub controllers: BTreeMap<String, JointGains>,
    /// Links whose forces on an object the grasp rule `original` counts.
    #[serde(rename = "gripper")]
    pub grasp_contact_links: Vec<String>,
    /// Where the base stands if nobody wears the arm.
    #[serde(rename = "stand")]
    pub fixed_base: Option<FixedBase>,
}

/// How a joint is shown.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(deny_unknown_fields)]
pub struct JointEntry {
    /// The joint's name in the model, or what follows its last `__`.
    pub joint: String,
    /// As shown.
    pub name: String,
    /// What WE does, as shown.
    pub we: String,
    /// What WF does, as shown.
    pub wf: String,
    /// Sign of the joint's motion for WE: 1 or -1.
    pub we_sign: i8,
}

/// Gains of a joint's position controller without feed-forward.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(deny_unknown_fields)]
pub struct JointGains {
    /// Proportional, N m/rad.
    pub p: f64,
    /// Derivative, N m s/rad.
    pub d: f64,
}

/// An arm that stands on something and does not move with a person's trunk.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(deny_unknown_fields)]
pub struct FixedBase {
    /// Where the base's origin is, `world`, metres. Its axes are those of `world`.
    #[cfg_attr(feature = "ts", ts(as = "[f64; 3]"))]
    pub xyz: Point,
}

/// True if `name` is the full name or what follows its last `__`: `my_arm__knee` is `knee`.
pub fn matches_short_name(full: &str, name: &str) -> bool {
    full == name || full.rsplit("__").next() == Some(name)
}

impl ArmSettings {
    /// The gains of the joint of this full name.
    pub fn gains(&self, full: &str) -> Option<JointGains> {
        let short = full.rsplit("__").next()?;
        self.controllers.get(full).or_else(|| self.controllers.get(short)).copied()
    }
}
