use crate::method::refused;
use crate::ports::ArmKinematics;
use crate::{ControlInput, ControlMethod, ControlOutput, MotionCommand};
use proact_types::{Gesture, ModeView, PlannerView, SimTime, TargetView};

/// Stops the arm while [`ControlInput::stop`] says so: the method sees NM, and the arm holds whatever it says.
#[derive(Clone, Debug)]
pub struct DeadMan<M> {
    method: M,
    refusal: Option<String>,
}

impl<M: ControlMethod> DeadMan<M> {
    /// Around `method`.
    pub fn new(method: M) -> Self {
        Self { method, refusal: None }
    }
}

impl<M: ControlMethod> ControlMethod for DeadMan<M> {
    fn name(&self) -> &str {
        self.method.name()
    }

    fn step(
        &mut self,
        now: SimTime,
        input: &ControlInput<'_>,
        kinematics: &mut dyn ArmKinematics,
    ) -> ControlOutput {
        let held = self.refusal.take().is_some();
        let Some(stop) = input.stop else { return self.method.step(now, input, kinematics) };
        self.refusal = Some(stop.reason.clone());
        let relaxed = ControlInput { gesture: Gesture::NoMotion, message: None, ..input.clone() };
        let mut output = self.method.step(now, &relaxed, kinematics);
        // Said once: a goal that an earlier message set would otherwise still be approached.
        let moves = output.motion.take().is_some() || !held;
        output.motion = moves.then_some(MotionCommand::Hold);
        output
    }

    fn mode(&self) -> Option<ModeView> {
        self.method.mode()
    }

    fn target(&self) -> TargetView {
        self.method.target()
    }

    fn planner(&self) -> PlannerView {
        match &self.refusal {
            Some(reason) => refused(reason),
            None => self.method.planner(),
        }
    }
}
