//! What the methods do, as data: the numbers and the choices between rules.

use crate::{ControlError, JogProfile, SynergyProfile};
use proact_arm::JointEntry;
use proact_types::{
    Command, Gesture,
    renamed_keys::{ConfigFile, rename_keys_in_toml},
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Everything by which the methods differ from one study to another. Read from TOML; unknown keys are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Profile {
    /// Written to the record.
    pub name: String,
    /// Which level of limb loss is in force: one of `levels`, or of the arm's.
    pub level: String,
    /// Joints that a method drives, by level of limb loss, in the place of the arm's own list of that level; an empty list
    /// is every arm joint.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub levels: BTreeMap<String, Vec<String>>,
    /// What the gestures of the EMG model are to the methods. A gesture without an entry is the command of its own name,
    /// or nothing.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub gestures: BTreeMap<Gesture, Command>,
    /// Methods A and B: from gestures to steps.
    pub jog: JogProfile,
    /// Method A.
    pub joint_jog: JointJogProfile,
    /// Method B.
    pub end_effector_jog: EndEffectorJogProfile,
    /// The method `synergy`; its default where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub synergy: Option<SynergyProfile>,
    /// Methods C and D.
    pub gaze_assisted: GazeAssistedProfile,
    /// Bounds on the commands; none in the original.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limiter: Option<LimiterProfile>,
    /// An assistant that shares the speeds of methods A and B; none in the original.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub blend: Option<BlendProfile>,
    /// Stop on stale input; none in the original.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dead_man: Option<DeadManProfile>,
}

/// Method A.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointJogProfile {
    /// Joints cycled through, in this order, in the place of the arm's own; empty is the arm's.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cycle: Vec<String>,
    /// Speed of the selected joint, rad/s, where the pace is `time`.
    pub speed_rad_per_s: f64,
    /// Step for each message, rad, where the pace is `message`.
    pub step_rad: f64,
    /// Asked for further from the measured angle than this, the joint goes no further away from it, rad, where the
    /// pace is `time`.
    pub tracking_error_limit_rad: f64,
    /// The hand closes at the start while the method believes it open (the original).
    pub starts_closed: bool,
    /// How joints are shown and which way they go, in the place of the arm's own entries for them. Joints with neither
    /// go by their own name.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub joints: Vec<JointEntry>,
}

/// Method B.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EndEffectorJogProfile {
    /// Speed of a translation, m/s, where the pace is `time`.
    pub speed_m_per_s: f64,
    /// Speed of a rotation, rad/s, where the pace is `time`.
    pub speed_rad_per_s: f64,
    /// Translation for each message, m, where the pace is `message`.
    pub step_m: f64,
    /// Rotation for each message, rad, where the pace is `message`.
    pub step_rad: f64,
    /// A message HO straight after HC counts as NM, where the pace is `message` (the original).
    pub ignores_open_after_close: bool,
    /// From the motion of the hand to that of the joints.
    pub inverse: InverseProfile,
    /// Axes cycled through.
    pub axes: Vec<AxisEntry>,
}

/// How the motion of the hand becomes that of the joints.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum InverseProfile {
    /// Damped least squares within the joint limits.
    Damped(DampedProfile),
    /// Pseudo-inverse with the original's rule for the elbow.
    MoorePenrose(MoorePenroseProfile),
}

/// Damped least squares, limit-aware.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DampedProfile {
    /// Linear rows are divided by this length, m, so that the condition number has no unit.
    pub characteristic_length_m: f64,
    /// Condition number from which motion that makes it worse slows down.
    pub condition_slowdown: f64,
    /// Condition number at which motion that makes it worse ends.
    pub condition_limit: f64,
    /// Greatest damping factor.
    pub max_damping: f64,
    /// Smallest singular value under which damping sets in.
    pub singular_value_threshold: f64,
    /// Most that a commanded angle may run ahead of the measured one, rad.
    pub tracking_error_limit_rad: f64,
    /// Least cosine between the motion asked for and the one that joint limits leave.
    pub min_alignment_cosine: f64,
}

/// The pseudo-inverse without damping.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MoorePenroseProfile {
    /// Condition number, metres and radians mixed, over which the elbow may not extend.
    pub condition_limit: f64,
    /// Position, in the chain, of the joint that may not turn backwards then.
    pub elbow_index: usize,
}

/// Whether an axis is moved along or turned about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AxisMotion {
    /// Along.
    Translate,
    /// About.
    Rotate,
}

/// An axis of the arm's base.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Axis {
    /// Ahead.
    X,
    /// Left.
    Y,
    /// Up.
    Z,
}

/// One degree of freedom of the hand.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisEntry {
    /// Along or about.
    pub motion: AxisMotion,
    /// Which axis.
    pub axis: Axis,
    /// As shown.
    pub name: String,
    /// What WE does, as shown.
    pub we: String,
    /// What WF does, as shown.
    pub wf: String,
    /// Sign of the motion for WE: 1 or -1.
    pub we_sign: i8,
}

/// Methods C and D.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "rules", rename_all = "snake_case")]
pub enum GazeAssistedProfile {
    /// One WF locks, anything but WE stops, WE acts on what is highlighted or locked.
    LockOnce(LockOnceProfile),
    /// The original: WF toggles, NM alone stops, WE acts on what was locked last.
    ToggleLocks(ToggleLocksProfile),
}

/// Numbers of [`crate::GazeAssisted`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LockOnceProfile {
    /// A base that moved further than this since a plan was asked for makes the plan void, metres.
    pub replan_distance_m: f64,
    /// The same for its turning, rad.
    pub replan_angle_rad: f64,
    /// As many intermediate goals may follow each other before the arm waits for another base or another WE: it
    /// would wander for ever where no posture reaches the goal.
    pub max_intermediate_goals: u32,
    /// The place jumps to a free target this near, metres; 0 is never.
    pub snap_radius_m: f64,
    /// With a block in hand, opening is asked for twice within this time; 0 is off.
    pub confirm_open_ms: u64,
}

impl Default for LockOnceProfile {
    fn default() -> Self {
        Self {
            replan_distance_m: 5e-3,
            replan_angle_rad: std::f64::consts::PI / 180.0,
            max_intermediate_goals: 2,
            snap_radius_m: 0.0,
            confirm_open_ms: 0,
        }
    }
}

/// Numbers of [`crate::GazeToggled`], all of the original's `pick_place.cpp`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ToggleLocksProfile {
    /// Upper arm of the two-link arm by which the hand's heading is chosen, metres.
    pub upper_arm_length_m: f64,
    /// Its forearm, metres.
    pub forearm_length_m: f64,
    /// Its elbow hangs this much lower than the shoulder, metres.
    pub elbow_drop_m: f64,
    /// Orientation of the hand in `world`, w, x, y, z, before its heading is replaced.
    pub grasp_orientation_wxyz: [f64; 4],
    /// The wrist stays this far from the block, across the heading, metres.
    pub standoff_m: f64,
    /// The wrist over the block's centre, metres.
    pub pick_height_m: f64,
    /// The block's centre over the place, metres.
    pub place_height_m: f64,
}

/// Bounds on the commands of any method.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LimiterProfile {
    /// Greatest acceleration of a joint, rad/s^2. Stopping is not limited.
    pub acceleration_rad_per_s2: f64,
}

/// The assistant of [`crate::Blend`]: it heads for what the gaze selects, and shares the person's speeds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BlendProfile {
    /// Its share of the speeds, 0 to 1.
    pub assistance_share: f64,
    /// Its speed, m/s.
    pub speed_m_per_s: f64,
    /// It heads for the point this far above the block, or above the place while a block is held, metres.
    pub height_above_target_m: f64,
}

impl Default for BlendProfile {
    /// Half of B's speed, clear of the fingers: assumed, for want of a source.
    fn default() -> Self {
        Self { assistance_share: 0.3, speed_m_per_s: 0.08, height_above_target_m: 0.12 }
    }
}

/// Ages over which input stops the arm, milliseconds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeadManProfile {
    /// Of the last decision on the EMG.
    pub emg_timeout_ms: u64,
    /// Of the last word of the page or topic that commands gestures.
    #[serde(default = "DeadManProfile::default_command_timeout_ms")]
    pub command_timeout_ms: u64,
    /// Of what a page says when it arrives: the round trip of its line.
    #[serde(default = "DeadManProfile::default_max_delay_ms")]
    pub max_delay_ms: u64,
    /// Of the last gaze that differed from the one before; methods C and D only.
    pub gaze_timeout_ms: u64,
    /// Of the last pose of a shoulder, or posture of a limb, that differed from the one before.
    pub tracking_timeout_ms: u64,
}

impl DeadManProfile {
    /// With the last sign of life 50 ms before the first that is missing, and the arm's own stop, within 250 ms.
    fn default_command_timeout_ms() -> u64 {
        200
    }

    /// As long as the arm may go on after a source falls silent. A local network takes less than 50 ms.
    fn default_max_delay_ms() -> u64 {
        250
    }
}

impl Profile {
    /// The profile called `name`: `default` or `original`.
    ///
    /// # Errors
    /// [`ControlError::Profile`] for any other name.
    pub fn named(name: &str) -> Result<Self, ControlError> {
        match name {
            "default" => Self::from_toml(include_str!("../data/profiles/default.toml")),
            "original" => Self::from_toml(include_str!("../data/profiles/original.toml")),
            _ => Err(ControlError::Profile { got: name.to_owned() }),
        }
    }

    /// Reads a profile and checks its numbers. Keys may have the names that they had before.
    ///
    /// # Errors
    /// [`ControlError::Text`] with the line, [`ControlError::Value`] for numbers out of range.
    pub fn from_toml(text: &str) -> Result<Self, ControlError> {
        let (text, _) = rename_keys_in_toml(text, ConfigFile::Trial, "profile")
            .map_err(|e| ControlError::Text(e.to_string()))?;
        let profile: Self = toml::from_str(&text).map_err(|e| ControlError::Text(e.to_string()))?;
        profile.check()?;
        Ok(profile)
    }

    /// The profile as TOML.
    ///
    /// # Errors
    /// [`ControlError::Text`] if it cannot be written down.
    pub fn to_toml(&self) -> Result<String, ControlError> {
        toml::to_string(self).map_err(|e| ControlError::Text(e.to_string()))
    }

    /// Checks every number.
    ///
    /// # Errors
    /// As [`Profile::from_toml`].
    pub fn check(&self) -> Result<(), ControlError> {
        let (joint, hand) = (&self.joint_jog, &self.end_effector_jog);
        let mut positive = vec![
            ("joint_jog.speed_rad_per_s", joint.speed_rad_per_s),
            ("joint_jog.step_rad", joint.step_rad),
            ("joint_jog.tracking_error_limit_rad", joint.tracking_error_limit_rad),
            ("end_effector_jog.speed_m_per_s", hand.speed_m_per_s),
            ("end_effector_jog.speed_rad_per_s", hand.speed_rad_per_s),
            ("end_effector_jog.step_m", hand.step_m),
            ("end_effector_jog.step_rad", hand.step_rad),
        ];
        self.jog.check()?;
        match hand.inverse {
            InverseProfile::Damped(damped) => positive.extend([
                ("end_effector_jog.inverse.characteristic_length_m", damped.characteristic_length_m),
                ("end_effector_jog.inverse.condition_slowdown", damped.condition_slowdown),
                ("end_effector_jog.inverse.condition_limit - condition_slowdown", {
                    damped.condition_limit - damped.condition_slowdown
                }),
                ("end_effector_jog.inverse.max_damping", damped.max_damping),
                ("end_effector_jog.inverse.singular_value_threshold", damped.singular_value_threshold),
                ("end_effector_jog.inverse.tracking_error_limit_rad", damped.tracking_error_limit_rad),
                ("end_effector_jog.inverse.min_alignment_cosine", damped.min_alignment_cosine),
            ]),
            InverseProfile::MoorePenrose(plain) => {
                positive.push(("end_effector_jog.inverse.condition_limit", plain.condition_limit));
            }
        }
        match self.gaze_assisted {
            GazeAssistedProfile::LockOnce(rules) => {
                let radius = rules.snap_radius_m;
                if !(0.0..=10.0).contains(&radius) {
                    let (key, expected) = ("gaze_assisted.snap_radius_m", "0 to 10, where 0 switches it off");
                    return Err(ControlError::Value { key, got: radius, expected });
                }
                positive.extend([
                    ("gaze_assisted.replan_distance_m", rules.replan_distance_m),
                    ("gaze_assisted.replan_angle_rad", rules.replan_angle_rad),
                ]);
            }
            GazeAssistedProfile::ToggleLocks(rules) => positive.extend([
                ("gaze_assisted.upper_arm_length_m", rules.upper_arm_length_m),
                ("gaze_assisted.forearm_length_m", rules.forearm_length_m),
                (
                    "norm of gaze_assisted.grasp_orientation_wxyz",
                    rules.grasp_orientation_wxyz.iter().map(|v| v * v).sum(),
                ),
            ]),
        }
        if let Some(blend) = self.blend {
            positive.push(("blend.speed_m_per_s", blend.speed_m_per_s));
            for (key, got) in [
                ("blend.assistance_share", blend.assistance_share),
                ("blend.height_above_target_m", blend.height_above_target_m),
            ] {
                if !(0.0..=1.0).contains(&got) {
                    return Err(ControlError::Value { key, got, expected: "0 to 1" });
                }
            }
        }
        if let Some(limiter) = self.limiter {
            positive.push(("limiter.acceleration_rad_per_s2", limiter.acceleration_rad_per_s2));
        }
        if let Some(ages) = self.dead_man {
            for (key, got) in [
                ("dead_man.emg_timeout_ms", ages.emg_timeout_ms),
                ("dead_man.command_timeout_ms", ages.command_timeout_ms),
                ("dead_man.max_delay_ms", ages.max_delay_ms),
                ("dead_man.gaze_timeout_ms", ages.gaze_timeout_ms),
                ("dead_man.tracking_timeout_ms", ages.tracking_timeout_ms),
            ] {
                if !(20..=60_000).contains(&got) {
                    let expected = "20 to 60000; leave dead_man out for no limits";
                    return Err(ControlError::Value { key, got: got as f64, expected });
                }
            }
        }
        // Wide enough for any use, and such that no quotient of two of them overflows.
        if let Some(&(key, got)) = positive.iter().find(|(_, value)| !(1e-6..=1e6).contains(value)) {
            return Err(ControlError::Value { key, got, expected: "0.000001 to 1000000" });
        }
        let signs = joint.joints.iter().map(|j| j.we_sign).chain(hand.axes.iter().map(|a| a.we_sign));
        if let Some(sign) = signs.into_iter().find(|sign| sign.abs() != 1) {
            return Err(ControlError::Value { key: "we_sign", got: sign.into(), expected: "1 or -1" });
        }
        if hand.axes.is_empty() {
            return Err(ControlError::Value {
                key: "number of end_effector_jog.axes",
                got: 0.0,
                expected: "at least 1",
            });
        }
        Ok(())
    }
}
