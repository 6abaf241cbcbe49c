use crate::method::refused;
use crate::ports::ArmKinematics;
use crate::{ControlInput, ControlMethod, ControlOutput, DeadManProfile, MotionCommand};
use proact_types::{Gesture, ModeView, PlannerView, SimTime, TargetView};

/// Stops the arm while input that it depends on is stale: the method sees NM, and the arm holds whatever it says.
#[derive(Clone, Debug)]
pub struct DeadMan<M> {
    method: M,
    limits: DeadManProfile,
    needs_gaze: bool,
    refusal: Option<String>,
}

impl<M: ControlMethod> DeadMan<M> {
    /// Around `method`; a method that does not use gaze moves on without it.
    pub fn new(method: M, profile: &DeadManProfile, needs_gaze: bool) -> Self {
        Self { method, limits: *profile, needs_gaze, refusal: None }
    }

    fn stale(&self, input: &ControlInput<'_>) -> Option<String> {
        let gaze = if self.needs_gaze { input.gaze_age_ms } else { None };
        [
            ("EMG", input.emg_age_ms, self.limits.emg_ms),
            ("gaze", gaze, self.limits.gaze_ms),
            ("tracking", input.tracking_age_ms, self.limits.tracking_ms),
        ]
        .into_iter()
        .find_map(|(what, age, limit)| {
            let age = age.filter(|age| *age > limit)?;
            // Rounded, so that the text does not change at every step.
            Some(format!(
                "the {what} is silent for {:.1} s, at most {limit} ms are allowed",
                age as f64 * 1e-3
            ))
        })
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
        let before = self.refusal.take();
        self.refusal = self.stale(input);
        if self.refusal.is_none() {
            return self.method.step(now, input, kinematics);
        }
        let relaxed = ControlInput { gesture: Gesture::NoMotion, message: None, ..input.clone() };
        let mut output = self.method.step(now, &relaxed, kinematics);
        // Said once: a goal that an earlier message set would otherwise still be approached.
        let moves = output.motion.take().is_some() || before.is_none();
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
