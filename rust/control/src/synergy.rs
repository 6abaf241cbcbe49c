use crate::ports::ArmKinematics;
use crate::{
    ControlError, ControlInput, ControlMethod, ControlOutput, JointJog, JointSubset, MethodEntry,
    MotionCommand, Profile, STEP_SECS,
};
use proact_arm::{ArmModel, JointLimits, matches_short_name};
use proact_types::{
    Command, JointVector, MethodHelp, MethodInfo, MethodNeeds, MethodStyle, PlannerView, SimTime, Vector,
    zeros,
};
use serde::{Deserialize, Serialize};

/// A limb of which nothing new came for this long stands still, ms.
const LEADER_STATIONARY_MS: u64 = 100;
/// Time constant of the leader's speed, seconds. [assumed]: tracked angles are noisy.
const LEADER_SPEED_FILTER_SECS: f64 = 0.05;
/// The follower must move the hand off the line by this much for each radian, or the line says nothing of its speed, m/rad.
const MIN_LEVER_M_PER_RAD: f64 = 0.02;

/// A joint of the prosthesis that follows a joint of the person's own limb.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SynergyProfile {
    /// The arm joint of the own limb that leads; its first from the base where it is left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub leader: Option<String>,
    /// The driven joint that follows; the first from the base where it is left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub follower: Option<String>,
    /// How.
    pub rule: SynergyRule,
    /// The follower's highest speed, rad/s.
    pub speed_rad_per_s: f64,
}

/// How the follower's speed comes of the leader's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum SynergyRule {
    /// In proportion.
    Linear {
        /// Speed of the follower for each of the leader, without a unit; its sign is that of the joints' axes.
        gain: f64,
    },
    /// So that the hand stays on the straight line from the shoulder on which it was when the gesture began.
    Jacobian,
}

impl Default for SynergyProfile {
    /// The first joint of the prosthesis after the first of the limb, along a straight line, at most at 2 rad/s [assumed].
    fn default() -> Self {
        Self { leader: None, follower: None, rule: SynergyRule::Jacobian, speed_rad_per_s: 2.0 }
    }
}

/// Method A for all joints of the prosthesis but one: that moves with a joint of the person's own limb for as long as WE or WF is held
/// in its mode (synergies of R. Garcia-Rosas et al., VRProEP: linear, and by the Jacobian). VRProEP's rule is that of two links in a
/// plane; here the arm's Jacobian takes the place of the two lengths, which is the same in a plane and works out of it.
///
/// The follower stands still while no new angles of the limb come, at its limits, and where it does not move the hand off the line.
#[derive(Clone, Debug)]
pub struct Synergy {
    joint_jog: JointJog,
    rule: SynergyRule,
    leader: usize,
    follower: usize,
    limits: JointLimits,
    /// The newest angle of the leader, and when it came.
    leader_sample: Option<(SimTime, f64)>,
    /// Of the leader, rad/s.
    leader_speed_rad_per_s: f64,
    /// Direction of the hand from the shoulder when the gesture began, in the base's axes.
    reach_direction: Option<Vector>,
}

impl Synergy {
    /// For the joints of `model` that `subset` drives.
    ///
    /// # Errors
    /// A leader that the own limb does not have, a follower that is not driven, numbers out of range.
    pub fn new(profile: &Profile, model: &ArmModel, subset: &JointSubset) -> Result<Self, ControlError> {
        if profile.jog.simultaneous().is_some() {
            return Err(ControlError::Unsupported {
                method: "synergy".to_owned(),
                reason: "moves a joint while a gesture is held: leave profile.jog.simultaneous out, or use method A or B",
            });
        }
        let settings = profile.synergy.clone().unwrap_or_default();
        let name = |joint: usize| &*model.joints[model.arm[joint]].name;
        let own: Vec<usize> = (0..model.arm_count()).filter(|&joint| !subset.contains(joint)).collect();
        let is_leader = |joint: usize| {
            settings.leader.as_ref().is_none_or(|leader| matches_short_name(name(joint), leader))
        };
        let leader =
            own.iter().copied().find(|&joint| is_leader(joint)).ok_or_else(|| ControlError::Name {
                kind: "leading joint of the own limb",
                got: settings.leader.clone().unwrap_or_default(),
                known: own.iter().map(|&joint| name(joint)).collect::<Vec<_>>().join(", "),
            })?;
        let first = || subset.driven().first().map(|&joint| name(joint).to_owned()).unwrap_or_default();
        let follower = subset.find(model, &settings.follower.clone().unwrap_or_else(first))?;
        let speed = settings.speed_rad_per_s;
        let refused = |key, got, expected| Err(ControlError::Value { key, got, expected });
        if !(0.001..=10.0).contains(&speed) {
            return refused("synergy.speed_rad_per_s", speed, "0.001 to 10");
        }
        if let SynergyRule::Linear { gain } = settings.rule
            && !(0.001..=10.0).contains(&gain.abs())
        {
            return refused("synergy.rule.linear.gain", gain, "-10 to -0.001 or 0.001 to 10");
        }
        let limits = model.joints[model.arm[follower]].limits;
        Ok(Self {
            joint_jog: JointJog::new(profile, model, subset)?,
            rule: settings.rule,
            leader,
            follower,
            limits: JointLimits { velocity: limits.velocity.min(speed), ..limits },
            leader_sample: None,
            leader_speed_rad_per_s: 0.0,
            reach_direction: None,
        })
    }

    /// The method as an entry of a registry.
    pub fn entry() -> MethodEntry {
        let info = MethodInfo {
            name: "synergy".to_owned(),
            title: "Joint synergy".to_owned(),
            needs: MethodNeeds { limb: true, ..MethodNeeds::default() },
            style: MethodStyle::Jogging,
            help: MethodHelp {
                summary: "The elbow follows your shoulder while you hold; other joints one after the other."
                    .to_owned(),
                hand_close: "close / open".to_owned(),
                hand_open: "next joint".to_owned(),
                wrist_extension: "follow / move +".to_owned(),
                wrist_flexion: "follow / move \u{2212}".to_owned(),
            },
        };
        MethodEntry::new(info, |profile, model, subset| Ok(Box::new(Self::new(profile, model, subset)?)))
    }

    /// Follows the leader's angle.
    fn observe_leader(&mut self, now: SimTime, limb: Option<&[f64]>) {
        let angle = limb.and_then(|limb| limb.get(self.leader)).copied().filter(|angle| angle.is_finite());
        let Some(angle) = angle else {
            (self.leader_sample, self.leader_speed_rad_per_s) = (None, 0.0);
            return;
        };
        match self.leader_sample {
            Some((at, before)) if angle == before => {
                if now.millis_since(at) > LEADER_STATIONARY_MS {
                    self.leader_speed_rad_per_s = 0.0;
                }
            }
            Some((at, before)) => {
                let secs = (now.millis_since(at) as f64 * 1e-3).max(1e-3);
                let share = secs / (secs + LEADER_SPEED_FILTER_SECS);
                // After a pause it did not move all the while at the mean speed.
                let fresh = now.millis_since(at) <= LEADER_STATIONARY_MS;
                let speed = if fresh { (angle - before) / secs } else { 0.0 };
                self.leader_speed_rad_per_s += share * (speed - self.leader_speed_rad_per_s);
                self.leader_sample = Some((now, angle));
            }
            None => self.leader_sample = Some((now, angle)),
        }
    }

    /// The follower's speed, rad/s, or why there is none.
    fn follower_speed(
        &mut self,
        input: &ControlInput<'_>,
        kinematics: &mut dyn ArmKinematics,
    ) -> Result<f64, String> {
        let speed = match self.rule {
            SynergyRule::Linear { gain } => gain * self.leader_speed_rad_per_s,
            SynergyRule::Jacobian => {
                let q = input.measured;
                let to_hand = kinematics.forward(q).map_err(|e| e.to_string())?.translation.vector;
                let line = match self.reach_direction {
                    Some(line) => line,
                    None => to_hand.try_normalize(1e-6).ok_or("the hand is at the shoulder")?,
                };
                self.reach_direction = Some(line);
                let jacobian = kinematics.jacobian(q).map_err(|e| e.to_string())?;
                let moves = |joint: usize| {
                    Vector::new(jacobian[(0, joint)], jacobian[(1, joint)], jacobian[(2, joint)])
                };
                let (leader_moves, follows) = (moves(self.leader), moves(self.follower));
                // Off the line, in the plane in which the follower moves the hand.
                let off = follows - line * line.dot(&follows);
                let lever = off.norm();
                if lever < MIN_LEVER_M_PER_RAD {
                    return Err("along this line the elbow cannot follow".to_owned());
                }
                let normal = off / lever;
                -normal.dot(&leader_moves) / normal.dot(&follows) * self.leader_speed_rad_per_s
            }
        };
        let angle = *input.commanded.get(self.follower).ok_or("the arm has no such joint")?;
        let JointLimits { lower, upper, velocity, .. } = self.limits;
        let speed_limits = ((lower - angle) / STEP_SECS, (upper - angle) / STEP_SECS);
        Ok(speed.clamp(-velocity, velocity).clamp(speed_limits.0.min(0.0), speed_limits.1.max(0.0)))
    }
}

impl ControlMethod for Synergy {
    fn step(
        &mut self,
        now: SimTime,
        input: &ControlInput<'_>,
        kinematics: &mut dyn ArmKinematics,
    ) -> ControlOutput {
        self.observe_leader(now, input.limb.filter(|_| input.stop.is_none()));
        let mut output = self.joint_jog.step(now, input, kinematics);
        if self.joint_jog.selected() != self.follower {
            self.reach_direction = None;
            return output;
        }
        if let Some(mode) = &mut output.display.mode {
            mode.directions = ["follows".to_owned(), "follows".to_owned()];
        }
        if !matches!(input.command, Command::WristExtension | Command::WristFlexion) {
            self.reach_direction = None;
            return output;
        }
        match self.follower_speed(input, kinematics) {
            Ok(speed) => {
                let mut speeds: JointVector = zeros(input.commanded.len());
                speeds[self.follower] = speed;
                output.motion = Some(MotionCommand::Velocity(speeds));
                output.display.planner = PlannerView::Idle;
            }
            Err(reason) => {
                output.motion = Some(MotionCommand::Hold);
                output.display.planner = crate::method::refusal_view(&reason);
            }
        }
        output
    }
}
