use crate::HandCommand;
use proact_types::HandState;

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
    command: HandCommand,
    state: HandState,
}

impl HandStateEstimator {
    /// A hand commanded to `open`, the angles of the pose of that name, rad.
    pub fn new(open: &[f64]) -> Self {
        Self { open: open.to_vec(), command: HandCommand::Open, state: HandState::Open }
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
        let off = position.iter().zip(&self.open).fold(0.0_f64, |m, (q, open)| m.max((q - open).abs()));
        let moving = commanded || velocity.iter().any(|v| v.abs() > HAND_STOPPED_RAD_PER_S);
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
        let mut hand = HandStateEstimator::new(&[0.0, 0.0]);
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
