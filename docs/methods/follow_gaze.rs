//! An example method: WE carries the hand towards the block that you look at, WF back up, HC and HO work the hand.
//!
//! It is one type that implements `ControlMethod`. It keeps no clock and reads no files: the time, the gesture and
//! the world come in, commands go out. Wrap it in `Limited` to keep it within the arm's limits whatever it asks.

use nalgebra::Vector6;
use proact_control::ports::ArmKinematics;
use proact_control::{ControlInput, ControlMethod, ControlOutput, HandCommand, MethodDisplay, MotionCommand};
use proact_types::{Command, JointVector, SimTime, TargetView, Vector};

/// Speed of the hand, m/s.
const SPEED: f64 = 0.1;
/// The hand stops this far above the block's centre, metres.
const ABOVE: f64 = 0.15;

/// Moves straight towards the block in view, without a plan.
#[derive(Clone, Debug, Default)]
pub struct FollowGaze {
    last: Command,
}

impl ControlMethod for FollowGaze {
    fn step(
        &mut self,
        _now: SimTime,
        input: &ControlInput<'_>,
        arm: &mut dyn ArmKinematics,
    ) -> ControlOutput {
        let target = TargetView { object: input.highlight, ..TargetView::default() };
        let changed = std::mem::replace(&mut self.last, input.command) != input.command;
        let mut output = ControlOutput {
            display: MethodDisplay { target, ..MethodDisplay::default() },
            ..ControlOutput::default()
        };
        match input.command {
            Command::HandClose if changed => output.hand = Some(HandCommand::Close),
            Command::HandOpen if changed => output.hand = Some(HandCommand::Open),
            _ => {}
        }
        // A method that moves says so at every step; whatever is no motion is a stop.
        let speeds = match input.command {
            Command::WristExtension => toward_block(input, arm),
            Command::WristFlexion => joint_speeds(Vector::z() * SPEED, input, arm),
            _ => None,
        };
        output.motion = Some(speeds.map_or(MotionCommand::Hold, MotionCommand::Velocity));
        output
    }
}

/// Joint speeds towards the point over the block that is looked at, slower near it.
fn toward_block(input: &ControlInput<'_>, arm: &mut dyn ArmKinematics) -> Option<JointVector> {
    let goal = input.objects[input.highlight?.index()] + Vector::z() * ABOVE;
    let base_from_tip = arm.forward(input.measured).ok()?;
    let away = input.world_from_base.inverse_transform_point(&goal).coords - base_from_tip.translation.vector;
    joint_speeds(away.cap_magnitude(SPEED), input, arm)
}

/// Damped least squares: joint speeds whose tip velocity is `linear`, m/s in base axes, without turning.
fn joint_speeds(
    linear: Vector,
    input: &ControlInput<'_>,
    arm: &mut dyn ArmKinematics,
) -> Option<JointVector> {
    let jacobian = arm.jacobian(input.commanded).ok()?;
    let twist = Vector6::new(linear.x, linear.y, linear.z, 0.0, 0.0, 0.0);
    let damped = &jacobian * jacobian.transpose() + nalgebra::Matrix6::identity() * 1e-4;
    let speeds = jacobian.transpose() * (damped.cholesky()?.solve(&twist));
    Some(speeds.iter().copied().collect())
}
