use crate::inverse::NOT_FOLLOWING;
use crate::jog::{BlockedMotion, DoubleConfirmation, Jog, JogMotion};
use crate::ports::ArmKinematics;
use crate::simultaneous::{ProportionalDrives, ProportionalMotion};
use crate::{
    ControlError, ControlInput, ControlMethod, ControlOutput, HandCommand, JogProfile, JointSubset,
    MotionCommand, Profile, STEP_SECS,
};
use proact_arm::{ArmModel, JointLimits, matches_short_name};
use proact_types::{Command, ControlledDof, HandState, JointVector, ModeView, SimTime, joints, zeros};

/// Method A: HO cycles through the joints, WE and WF move the selected one, HC toggles the hand (ProACT,
/// arXiv:2407.05025, "Direct joint control").
///
/// With the pace `time` the joint moves at a speed while the gesture is held, and stops at its limit and when the
/// gesture ends. With the pace `message` each message adds a step to the joint's goal, as in the original: from
/// the measured angle after another message, from the last goal after the same one; goals run over the limits.
///
/// The word `hand` in `joint_jog.cycle` makes the hand one of the modes: there WE opens it and WF closes it, for who has no
/// gesture for HC.
///
/// With `jog.simultaneous` a regressor's drives move their joints all at the same time, and gestures nothing.
#[derive(Clone, Debug)]
pub struct JointJog {
    jog: Jog,
    /// None where gestures move one joint after the other.
    proportional_drives: Option<ProportionalDrives>,
    modes: Vec<JointMode>,
    limits: Vec<JointLimits>,
    speed_rad_per_s: f64,
    step_rad: f64,
    tracking_error_limit_rad: f64,
    /// The hand has yet to be closed at the start.
    close_first: bool,
    /// With a block in hand, opening it by its mode is asked for twice.
    confirm: DoubleConfirmation,
    /// What the hand was asked for by its mode, while that lasts.
    active_hand_command: Option<HandCommand>,
    /// The last goal of each joint.
    joint_goals: Option<JointVector>,
    blocked_motion: BlockedMotion,
    refusal: Option<String>,
}

/// What stands for the hand in the cycle.
const HAND: &str = "hand";

/// A joint that is cycled through, or the hand.
#[derive(Clone, Debug)]
struct JointMode {
    /// Position among the arm joints; behind the last is the hand.
    joint: usize,
    we_sign: f64,
    name: String,
}

impl JointJog {
    /// For the joints of `model` that `profile` names and `subset` drives.
    ///
    /// # Errors
    /// [`ControlError::Name`] for a joint in `joint_jog.cycle` that is not driven.
    pub fn new(profile: &Profile, model: &ArmModel, subset: &JointSubset) -> Result<Self, ControlError> {
        let (settings, own) = (&profile.joint_jog, &model.settings);
        let hand = model.arm_count();
        let cycle = Self::cycle(profile, model, subset)?;
        let mut modes = Vec::new();
        let mut views = Vec::new();
        for joint in cycle {
            let full = model.arm.get(joint).map_or(HAND, |&joint| &model.joints[joint].name);
            let mut entries = settings.joints.iter().chain(&own.joints);
            let entry = entries.find(|entry| matches_short_name(full, &entry.joint));
            let (name, we, wf, sign) = match entry {
                Some(entry) => (&*entry.name, &*entry.we, &*entry.wf, entry.we_sign),
                None if joint == hand => (HAND, "open", "close", 1),
                None => (full, "+", "-", 1),
            };
            views.push(ModeView {
                controlled_dof: ControlledDof::Joint(joint as u8),
                name: name.to_owned(),
                directions: [we.to_owned(), wf.to_owned()],
                we_sign: sign,
                next_in_secs: None,
            });
            modes.push(JointMode { joint, we_sign: f64::from(sign), name: name.to_owned() });
        }
        Ok(Self {
            jog: Jog::new(views, &profile.jog, false),
            proportional_drives: profile.jog.proportional_drives(),
            modes,
            limits: model.arm.iter().map(|&j| model.joints[j].limits).collect(),
            speed_rad_per_s: settings.speed_rad_per_s,
            step_rad: settings.step_rad,
            tracking_error_limit_rad: settings.tracking_error_limit_rad,
            close_first: settings.starts_closed,
            confirm: DoubleConfirmation::new(match profile.jog {
                JogProfile::Time { confirm_open_ms, .. } => confirm_open_ms,
                JogProfile::Message { .. } => 0,
            }),
            active_hand_command: None,
            joint_goals: None,
            blocked_motion: BlockedMotion::default(),
            refusal: None,
        })
    }

    /// What is cycled through, or with `jog.simultaneous` moved at once: positions among the joints of the arm `model`, and behind the
    /// last the hand.
    ///
    /// # Errors
    /// [`ControlError::Name`] for a joint in `joint_jog.cycle` that `subset` does not drive.
    pub fn cycle(
        profile: &Profile,
        model: &ArmModel,
        subset: &JointSubset,
    ) -> Result<Vec<usize>, ControlError> {
        let hand = model.arm_count();
        let find = |name: &String| if name == HAND { Ok(hand) } else { subset.find(model, name) };
        if let Some(drives) = profile.jog.simultaneous() {
            return drives.driven_names().map(find).collect();
        }
        match (profile.joint_jog.cycle.as_slice(), model.settings.joint_cycle.as_slice()) {
            ([], []) => Ok(subset.driven().to_vec()),
            // The arm's own order, of those joints that the prosthesis has.
            ([], names) => Ok(names.iter().filter_map(|name| find(name).ok()).collect()),
            (names, _) => names.iter().map(find).collect(),
        }
    }

    /// The selected joint, by its position among the arm joints.
    pub(crate) fn selected(&self) -> usize {
        self.modes[self.jog.selected()].joint
    }

    /// The selected joint at its speed, no further than its limit and no further ahead of the arm than allowed.
    fn velocity(&mut self, sign: f64, input: &ControlInput<'_>) -> MotionCommand {
        let selected = self.jog.selected();
        match self.speed_of(selected, sign, input) {
            Ok(speed) => {
                self.blocked_motion = BlockedMotion::default();
                let mut speeds = zeros(input.commanded.len());
                speeds[self.modes[selected].joint] = speed;
                MotionCommand::Velocity(speeds)
            }
            Err(refusal) => {
                self.refusal = refusal;
                self.blocked_motion.command(self.refusal.as_deref(), input.commanded.len())
            }
        }
    }

    /// All joints at their shares of the speed. One that cannot move stands, the others go on.
    fn velocities(&mut self, shares: &[f64], input: &ControlInput<'_>) -> MotionCommand {
        let mut speeds = zeros(input.commanded.len());
        for (drive_index, share) in shares.iter().enumerate().filter(|(_, share)| **share != 0.0) {
            match self.speed_of(drive_index, *share, input) {
                Ok(speed) => speeds[self.modes[drive_index].joint] = speed,
                Err(refusal) => self.refusal = refusal.or(self.refusal.take()),
            }
        }
        MotionCommand::Velocity(speeds)
    }

    /// Speed of the joint of a mode, rad/s, or why it cannot move, if that is worth telling.
    fn speed_of(
        &self,
        drive_index: usize,
        sign: f64,
        input: &ControlInput<'_>,
    ) -> Result<f64, Option<String>> {
        let mode = &self.modes[drive_index];
        let (Some(&angle), Some(limits)) = (input.commanded.get(mode.joint), self.limits.get(mode.joint))
        else {
            return Err(None);
        };
        let speed = (sign * mode.we_sign * self.speed_rad_per_s).clamp(-limits.velocity, limits.velocity);
        let speed_limits = ((limits.lower - angle) / STEP_SECS, (limits.upper - angle) / STEP_SECS);
        let speed = speed.clamp(speed_limits.0.min(0.0), speed_limits.1.max(0.0));
        if speed == 0.0 {
            return Err(Some(format!("{}: the joint is at its limit", mode.name)));
        }
        let drift = input.measured.get(mode.joint).map_or(0.0, |measured| angle - measured);
        if drift.abs() > self.tracking_error_limit_rad && drift * speed > 0.0 {
            return Err(Some(NOT_FOLLOWING.to_owned()));
        }
        Ok(speed)
    }

    /// The hand by its mode, once for each time that it is asked for.
    fn hand_mode_command(
        &mut self,
        now: SimTime,
        sign: f64,
        input: &ControlInput<'_>,
    ) -> Option<HandCommand> {
        let opens = sign * self.modes[self.jog.selected()].we_sign > 0.0;
        let command = if opens { HandCommand::Open } else { HandCommand::Close };
        if self.active_hand_command.replace(command) == Some(command) {
            return None;
        }
        let closed = matches!(input.hand.state, HandState::Closed | HandState::Closing);
        let holds = opens && closed && input.hand.held_object.is_some();
        (!holds || self.confirm.is_confirmed(now)).then_some(command)
    }

    /// One step of a regressor's drives.
    fn proportional_step(
        &mut self,
        now: SimTime,
        driven: &mut ProportionalDrives,
        input: &ControlInput<'_>,
    ) -> ControlOutput {
        let (motion, hand) = driven.step(now, input);
        self.refusal = None;
        let first = std::mem::take(&mut self.close_first).then_some(HandCommand::Close);
        let motion = match motion {
            ProportionalMotion::None => None,
            ProportionalMotion::Stop => Some(MotionCommand::Hold),
            ProportionalMotion::Shares(shares) => Some(self.velocities(&shares, input)),
        };
        let display = self.jog.display_all(self.refusal.as_deref(), driven.remaining_secs(now));
        ControlOutput { motion, hand: hand.or(first), display, ..ControlOutput::default() }
    }

    /// One step on from where the joint is, or from where it was last sent.
    fn step_goal(&mut self, sign: f64, repeated: bool, input: &ControlInput<'_>) -> Option<MotionCommand> {
        let mode = &self.modes[self.jog.selected()];
        let goals = self.joint_goals.get_or_insert_with(|| joints(input.commanded));
        let from = if repeated { *goals.get(mode.joint)? } else { *input.measured.get(mode.joint)? };
        let goal = from + sign * mode.we_sign * self.step_rad;
        if !goal.is_finite() {
            return None;
        }
        *goals.get_mut(mode.joint)? = goal;
        Some(MotionCommand::Goto(goals.clone()))
    }
}

impl ControlMethod for JointJog {
    fn step(
        &mut self,
        now: SimTime,
        input: &ControlInput<'_>,
        _kinematics: &mut dyn ArmKinematics,
    ) -> ControlOutput {
        if let Some(mut driven) = self.proportional_drives.take() {
            let output = self.proportional_step(now, &mut driven, input);
            self.proportional_drives = Some(driven);
            return output;
        }
        let (motion, hand) = self.jog.step(now, input);
        // What was refused stays on display between the messages of a gesture that goes on.
        let moves = matches!(input.command, Command::WristExtension | Command::WristFlexion);
        if motion != JogMotion::None || !moves {
            self.refusal = None;
        }
        let first = std::mem::take(&mut self.close_first).then_some(HandCommand::Close);
        let on_hand = self.modes.get(self.jog.selected()).is_some_and(|mode| mode.joint == self.limits.len());
        if let (true, JogMotion::Speed(sign) | JogMotion::Step { sign, .. }) = (on_hand, motion) {
            let hand = self.hand_mode_command(now, sign, input).or(hand).or(first);
            return ControlOutput { hand, display: self.jog.display(None), ..ControlOutput::default() };
        }
        if input.command != Command::WristExtension && input.command != Command::WristFlexion {
            self.active_hand_command = None;
        }
        let motion = match motion {
            JogMotion::None => None,
            JogMotion::Stop => Some(MotionCommand::Hold),
            JogMotion::Speed(sign) => Some(self.velocity(sign, input)),
            JogMotion::Step { sign, repeated } => self.step_goal(sign, repeated, input),
        };
        let display = self.jog.display(self.refusal.as_deref());
        ControlOutput { motion, hand: hand.or(first), display, ..ControlOutput::default() }
    }
}
