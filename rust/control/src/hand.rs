use crate::HandCommand;
use proact_arm::{ArmModel, ArmModelError, OPEN_POSE};
use proact_types::{HandState, JointVector};

/// Closer than this to a pose, over all hand joints, the hand is there, rad: a finger that rubs against a block may
/// stay a few degrees short.
const POSE_REACHED_RAD: f64 = 0.12;
/// Slower than this over all hand joints, the hand has stopped, rad/s.
const HAND_STOPPED_RAD_PER_S: f64 = 0.05;

/// Tells the state of the hand from its joints: the command says where it goes, the joints say whether it is
/// there. (The original keeps toggle flags in three nodes, which disagree with each other and with the hand.)
#[derive(Clone, Debug)]
pub struct HandStateEstimator {
    open: Vec<f64>,
    /// [`ArmModel::hand_per_radian`].
    per_radian: JointVector,
    command: HandCommand,
    state: HandState,
}

impl HandStateEstimator {
    /// The hand of `model`, commanded to its pose `open`.
    ///
    /// # Errors
    /// An arm without that pose.
    pub fn new(model: &ArmModel) -> Result<Self, ArmModelError> {
        Ok(Self::at(model.pose("hand", OPEN_POSE)?, model.hand_per_radian()))
    }

    fn at(open: &[f64], per_radian: JointVector) -> Self {
        Self { open: open.to_vec(), per_radian, command: HandCommand::Open, state: HandState::Open }
    }

    /// Where the hand was last told to go.
    pub fn command(&self) -> HandCommand {
        self.command
    }

    /// The state after the last [`HandStateEstimator::step_rad`].
    pub fn state(&self) -> HandState {
        self.state
    }

    /// Notes a command.
    pub fn set_command(&mut self, command: HandCommand) {
        self.command = command;
    }

    /// Updates from angles and speeds of the hand joints; `commanded` is true while their targets still move.
    pub fn step(&mut self, position: &[f64], velocity: &[f64], commanded: bool) -> HandState {
        let ways = position.iter().zip(&self.open).zip(&self.per_radian);
        let off = ways.into_iter().fold(0.0_f64, |m, ((q, open), unit)| m.max((q - open).abs() / unit));
        let mut speeds = velocity.iter().zip(&self.per_radian);
        let moving = commanded || speeds.any(|(v, unit)| v.abs() > HAND_STOPPED_RAD_PER_S * unit);
        self.state = match self.command {
            HandCommand::Open if off < POSE_REACHED_RAD => HandState::Open,
            // Fingers that something stops short of a pose have got as far as they will.
            _ if moving => match self.command {
                HandCommand::Open => HandState::Opening,
                HandCommand::Close => HandState::Closing,
            },
            HandCommand::Open => HandState::Open,
            HandCommand::Close => HandState::Closed,
        };
        self.state
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hand_that_a_block_stops_short_is_closed_and_one_that_still_moves_is_not() {
        let mut hand = HandStateEstimator::at(&[0.0, 0.0], [1.0, 1.0].into_iter().collect());
        assert_eq!(hand.step(&[0.01, 0.0], &[0.0, 0.0], false), HandState::Open);
        hand.set_command(HandCommand::Close);
        assert_eq!(hand.step(&[0.2, 0.0], &[1.0, 0.0], true), HandState::Closing);
        assert_eq!(hand.step(&[0.4, 0.1], &[0.0, 0.0], false), HandState::Closed);
        hand.set_command(HandCommand::Open);
        assert_eq!(hand.step(&[0.4, 0.1], &[-1.0, 0.0], true), HandState::Opening);
        assert_eq!(hand.step(&[0.3, 0.1], &[0.0, 0.0], false), HandState::Open, "a wall may stop a finger");
        assert_eq!(hand.step(&[0.1, 0.0], &[0.0, 0.0], false), HandState::Open);
    }
}
