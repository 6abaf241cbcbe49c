use crate::method::refused;
use crate::ports::ArmKinematics;
use crate::{ControlInput, ControlMethod, ControlOutput, FingerCommand, MotionCommand};
use proact_types::{Gesture, SimTime};

/// Stops the arm while [`ControlInput::stop`] says so: the method sees NM and no drives, and the arm holds whatever it says.
#[derive(Clone, Debug)]
pub struct DeadMan<M> {
    method: M,
    /// In the step before.
    stopped: bool,
    /// The method commands single fingers, which stop too.
    fingers: bool,
}

impl<M: ControlMethod> DeadMan<M> {
    /// Around `method`.
    pub fn new(method: M) -> Self {
        Self { method, stopped: false, fingers: false }
    }
}

impl<M: ControlMethod> ControlMethod for DeadMan<M> {
    fn step(
        &mut self,
        now: SimTime,
        input: &ControlInput<'_>,
        kinematics: &mut dyn ArmKinematics,
    ) -> ControlOutput {
        let held = std::mem::replace(&mut self.stopped, input.stop.is_some());
        let Some(stop) = input.stop else {
            let output = self.method.step(now, input, kinematics);
            self.fingers |= output.fingers.is_some();
            return output;
        };
        let relaxed =
            ControlInput { gesture: Gesture::NoMotion, message: None, drives: &[], ..input.clone() };
        let mut output = self.method.step(now, &relaxed, kinematics);
        // Said once: a goal that an earlier message set would otherwise still be approached.
        let moves = output.motion.take().is_some() || !held;
        output.motion = moves.then_some(MotionCommand::Hold);
        output.fingers = (self.fingers && !held || output.fingers.is_some()).then_some(FingerCommand::Hold);
        output.shown.planner = refused(&stop.reason);
        output
    }
}
