use crate::ports::ArmKinematics;
use crate::{ControlInput, ControlMethod, ControlOutput, MotionCommand};
use proact_types::SimTime;

/// Mixes the speeds that a person asks for with those of an assistant.
///
/// The assistant has a say only while the person moves the arm: where the person's method stops, holds or goes
/// elsewhere than by speed, that is what happens. Hand, plans, mode and marker are the person's.
#[derive(Clone, Debug)]
pub struct Blend<U, A> {
    user: U,
    assistant: A,
    assistance_share: f64,
}

impl<U: ControlMethod, A: ControlMethod> Blend<U, A> {
    /// The assistant has `share` of the speed, from 0 to 1; values outside are taken to the nearer end.
    pub fn new(user: U, assistant: A, share: f64) -> Self {
        Self {
            user,
            assistant,
            assistance_share: if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 },
        }
    }
}

impl<U: ControlMethod, A: ControlMethod> ControlMethod for Blend<U, A> {
    fn step(
        &mut self,
        now: SimTime,
        input: &ControlInput<'_>,
        kinematics: &mut dyn ArmKinematics,
    ) -> ControlOutput {
        let mut output = self.user.step(now, input, kinematics);
        // The assistant sees every step, so that it is up to date when its turn comes.
        let help = self.assistant.step(now, input, kinematics).motion;
        if let (Some(MotionCommand::Velocity(user)), Some(MotionCommand::Velocity(help))) =
            (&mut output.motion, help)
        {
            let usable = help.len() == user.len() && help.iter().all(|speed| speed.is_finite());
            for (user, help) in user.iter_mut().zip(&help).filter(|_| usable) {
                *user += self.assistance_share * (help - *user);
            }
        }
        output
    }
}
