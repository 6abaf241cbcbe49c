use crate::inverse::{DampedInverse, NEAR_SINGULAR, NOT_FINITE, moore_penrose};
use crate::jog::{BlockedMotion, Jog, JogMotion};
use crate::ports::ArmKinematics;
use crate::simultaneous::{ProportionalDrives, ProportionalMotion};
use crate::{
    Axis, AxisEntry, AxisMotion, ControlError, ControlInput, ControlMethod, ControlOutput,
    EndEffectorJogProfile, InverseProfile, JointSubset, MotionCommand, Profile, STEP_SECS,
};
use nalgebra::Vector6;
use proact_arm::{ArmModel, JointLimits};
use proact_types::{Command, ControlledDof, JointVector, ModeView, SimTime, joints, zeros};

/// Method B: HO cycles through the axes of the arm's base, WE and WF move the hand along or turn it about the
/// selected one, HC toggles the hand (ProACT, arXiv:2407.05025, "Direct end-effector control").
///
/// With the inverse `damped` the joint limits hold, motion into a singularity slows down and ends, motion out of it
/// is free, and the commanded angles never run far ahead of the measured ones. With `moore_penrose` the method is
/// the original's, but for one thing: over the condition limit the original sends its last goal again, which is all
/// zeros before the first one and would throw the arm straight down; here the last goal is where the arm stands.
///
/// With `jog.simultaneous` a regressor's drives move the hand along and about their axes all at the same time, and gestures
/// nothing.
#[derive(Clone, Debug)]
pub struct EndEffectorJog {
    jog: Jog,
    /// None where gestures move along one axis after the other.
    proportional_drives: Option<ProportionalDrives>,
    profile: EndEffectorJogProfile,
    limits: Vec<JointLimits>,
    subset: JointSubset,
    goals: Option<JointVector>,
    blocked_motion: BlockedMotion,
    refusal: Option<String>,
}

impl EndEffectorJog {
    /// For the arm joints of `model` that `subset` drives.
    ///
    /// # Errors
    /// [`ControlError::Name`] for an axis in `jog.simultaneous.drives` that `end_effector_jog.axes` does not have.
    pub fn new(profile: &Profile, model: &ArmModel, subset: &JointSubset) -> Result<Self, ControlError> {
        let mut settings = profile.end_effector_jog.clone();
        if let Some(at_once) = profile.jog.simultaneous() {
            settings.axes = at_once
                .driven_names()
                .map(|name| find_axis(&settings.axes, name))
                .collect::<Result<_, _>>()?;
        }
        let views = settings.axes.iter().map(|entry| {
            let axis = entry.axis as u8;
            ModeView {
                controlled_dof: match entry.motion {
                    AxisMotion::Translate => ControlledDof::Translation(axis),
                    AxisMotion::Rotate => ControlledDof::Rotation(axis),
                },
                name: entry.name.clone(),
                directions: [entry.we.clone(), entry.wf.clone()],
                we_sign: entry.we_sign,
                next_in_secs: None,
            }
        });
        Ok(Self {
            jog: Jog::new(views.collect(), &profile.jog, settings.ignores_open_after_close),
            proportional_drives: profile.jog.proportional_drives(),
            profile: settings,
            limits: model.arm.iter().map(|&j| model.joints[j].limits).collect(),
            subset: subset.clone(),
            goals: None,
            blocked_motion: BlockedMotion::default(),
            refusal: None,
        })
    }

    /// Twist along the selected axis, `linear` metres or `angular` radians long.
    fn twist(&self, sign: f64, linear: f64, angular: f64) -> Vector6<f64> {
        Self::axis_twist(&self.profile.axes[self.jog.selected()], sign, linear, angular)
    }

    /// Twist along, or about, an axis.
    fn axis_twist(entry: &AxisEntry, sign: f64, linear: f64, angular: f64) -> Vector6<f64> {
        let (first, size) = match entry.motion {
            AxisMotion::Translate => (0, linear),
            AxisMotion::Rotate => (3, angular),
        };
        let row = first
            + match entry.axis {
                Axis::X => 0,
                Axis::Y => 1,
                Axis::Z => 2,
            };
        let mut twist = Vector6::zeros();
        twist[row] = sign * f64::from(entry.we_sign) * size;
        twist
    }

    /// Joint displacement for `twist`; none where a rule forbids it.
    fn solve(
        &self,
        twist: &Vector6<f64>,
        horizon: f64,
        input: &ControlInput<'_>,
        kinematics: &mut dyn ArmKinematics,
    ) -> Result<Option<JointVector>, String> {
        let mut jacobian_at = |q: &[f64]| kinematics.jacobian(q).map_err(|e| e.to_string());
        match &self.profile.inverse {
            InverseProfile::Damped(profile) => {
                let count = self.limits.len();
                if input.commanded.len() != count || input.measured.len() != count {
                    let got = (input.commanded.len(), input.measured.len());
                    return Err(format!("got {got:?} joint angles, the arm has {count}"));
                }
                let damped = DampedInverse { profile, limits: &self.limits, subset: &self.subset };
                damped.solve(twist, input.commanded, input.measured, horizon, &mut jacobian_at).map(Some)
            }
            InverseProfile::MoorePenrose(profile) => {
                let jacobian = jacobian_at(input.measured)?;
                // Left out, not zeroed: zero columns would add singular values of zero.
                let driven = jacobian.select_columns(self.subset.driven());
                let step = moore_penrose(profile, &driven, self.subset.driven(), twist)?;
                Ok(step.map(|step| {
                    let mut full = zeros(jacobian.ncols());
                    self.subset.driven().iter().zip(&step).for_each(|(&joint, dq)| full[joint] = *dq);
                    full
                }))
            }
        }
    }
}

/// The entry of the axis called `x` to `z` or `rx` to `rz`.
fn find_axis(axes: &[AxisEntry], name: &str) -> Result<AxisEntry, ControlError> {
    let called = |entry: &AxisEntry| {
        let axis = ["x", "y", "z"][entry.axis as usize];
        if entry.motion == AxisMotion::Rotate { format!("r{axis}") } else { axis.to_owned() }
    };
    axes.iter().find(|entry| called(entry) == name).cloned().ok_or_else(|| ControlError::Name {
        kind: "axis",
        got: name.to_owned(),
        known: axes.iter().map(called).chain(["hand".to_owned()]).collect::<Vec<_>>().join(", "),
    })
}

impl ControlMethod for EndEffectorJog {
    fn step(
        &mut self,
        now: SimTime,
        input: &ControlInput<'_>,
        kinematics: &mut dyn ArmKinematics,
    ) -> ControlOutput {
        if let Some(mut driven) = self.proportional_drives.take() {
            let output = self.drive(now, &mut driven, input, kinematics);
            self.proportional_drives = Some(driven);
            return output;
        }
        let (motion, hand) = self.jog.step(now, input);
        // What was refused stays on display between the messages of a gesture that goes on.
        let moves = matches!(input.command, Command::WristExtension | Command::WristFlexion);
        if motion != JogMotion::None || !moves {
            self.refusal = None;
        }
        let motion = match motion {
            JogMotion::None => None,
            JogMotion::Stop => Some(MotionCommand::Hold),
            JogMotion::Speed(sign) => {
                let twist = self.twist(sign, self.profile.speed_m_per_s, self.profile.speed_rad_per_s);
                Some(self.axis_velocity(&twist, input, kinematics))
            }
            JogMotion::Step { sign, repeated } => {
                let twist = self.twist(sign, self.profile.step_m, self.profile.step_rad);
                let from = match &self.goals {
                    Some(goals) if repeated => goals.clone(),
                    _ => joints(input.measured),
                };
                Some(match self.solve(&twist, 1.0, input, kinematics) {
                    Ok(Some(step)) if step.len() == from.len() => {
                        let goals: JointVector = from.iter().zip(&step).map(|(q, dq)| q + dq).collect();
                        self.send_goals(goals)
                    }
                    // The original sends its last goal again.
                    Ok(None) => {
                        let last = self.goals.clone().unwrap_or_else(|| joints(input.commanded));
                        self.refusal = Some(NEAR_SINGULAR.to_owned());
                        self.send_goals(last)
                    }
                    Ok(Some(_)) => self.refuse_motion(NOT_FINITE.to_owned()),
                    Err(reason) => self.refuse_motion(reason),
                })
            }
        };
        let display = self.jog.display(self.refusal.as_deref());
        ControlOutput { motion, hand, display, ..ControlOutput::default() }
    }
}

impl EndEffectorJog {
    /// One step of a regressor's drives.
    fn drive(
        &mut self,
        now: SimTime,
        driven: &mut ProportionalDrives,
        input: &ControlInput<'_>,
        kinematics: &mut dyn ArmKinematics,
    ) -> ControlOutput {
        let (motion, hand) = driven.step(now, input);
        self.refusal = None;
        let motion = match motion {
            ProportionalMotion::None => None,
            ProportionalMotion::Stop => Some(MotionCommand::Hold),
            ProportionalMotion::Shares(shares) => {
                let (linear, angular) = (self.profile.speed_m_per_s, self.profile.speed_rad_per_s);
                let axes = self.profile.axes.iter().zip(&shares);
                let twist = axes.map(|(entry, share)| Self::axis_twist(entry, *share, linear, angular)).sum();
                Some(self.axis_velocity(&twist, input, kinematics))
            }
        };
        let display = self.jog.display_all(self.refusal.as_deref(), driven.remaining_secs(now));
        ControlOutput { motion, hand, display, ..ControlOutput::default() }
    }

    fn axis_velocity(
        &mut self,
        twist: &Vector6<f64>,
        input: &ControlInput<'_>,
        kinematics: &mut dyn ArmKinematics,
    ) -> MotionCommand {
        let refusal = match self.solve(twist, STEP_SECS, input, kinematics) {
            Ok(Some(speeds)) => {
                self.blocked_motion = BlockedMotion::default();
                return MotionCommand::Velocity(speeds);
            }
            Ok(None) => NEAR_SINGULAR.to_owned(),
            Err(reason) => reason,
        };
        self.refusal = Some(refusal);
        self.blocked_motion.command(self.refusal.as_deref(), input.commanded.len())
    }

    fn refuse_motion(&mut self, reason: String) -> MotionCommand {
        self.refusal = Some(reason);
        MotionCommand::Hold
    }

    fn send_goals(&mut self, goals: JointVector) -> MotionCommand {
        self.goals = Some(goals.clone());
        MotionCommand::Goto(goals)
    }
}
