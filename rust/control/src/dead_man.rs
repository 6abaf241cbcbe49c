use crate::method::refusal_view;
use crate::ports::ArmKinematics;
use crate::{ControlInput, ControlMethod, ControlOutput, FingerCommand, MotionCommand};
use proact_types::{Command, SimTime};

/// Stops the arm while [`ControlInput::stop`] says so: the method sees NM and no drives, and the arm holds whatever it says.
#[derive(Clone, Debug)]
pub struct DeadManSwitch<M> {
    method: M,
    /// In the step before.
    was_stopped: bool,
    /// The method commands single fingers, which stop too.
    commands_fingers: bool,
}

impl<M: ControlMethod> DeadManSwitch<M> {
    /// Around `method`.
    pub fn new(method: M) -> Self {
        Self { method, was_stopped: false, commands_fingers: false }
    }
}

impl<M: ControlMethod> ControlMethod for DeadManSwitch<M> {
    fn step(
        &mut self,
        now: SimTime,
        input: &ControlInput<'_>,
        kinematics: &mut dyn ArmKinematics,
    ) -> ControlOutput {
        let held = std::mem::replace(&mut self.was_stopped, input.stop.is_some());
        let Some(stop) = input.stop else {
            let output = self.method.step(now, input, kinematics);
            self.commands_fingers |= output.fingers.is_some();
            return output;
        };
        let relaxed = ControlInput {
            command: Command::NoMotion,
            published_command: None,
            drives: &[],
            ..input.clone()
        };
        let mut output = self.method.step(now, &relaxed, kinematics);
        // Said once: a goal that an earlier message set would otherwise still be approached.
        let moves = output.motion.take().is_some() || !held;
        output.motion = moves.then_some(MotionCommand::Hold);
        output.fingers =
            (self.commands_fingers && !held || output.fingers.is_some()).then_some(FingerCommand::Hold);
        output.display.planner = refusal_view(&stop.reason);
        output
    }
}
