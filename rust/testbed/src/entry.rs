//! What enters a tick: checked, and bound into the digest.

use crate::{Field, Testbed, TestbedError, TickOutput};
use proact_types::{
    EventKind, GazeSample, Gesture, InputSign, InputSource, Point, SignKind, TickInput, Vector,
};

/// The tracker's ray is the one before, although it may differ in `world`.
const AGAIN: InputSign = InputSign { source: InputSource::EyeTracker, kind: SignKind::Repeated };

impl Testbed {
    pub(crate) fn check_input(&self, input: &TickInput) -> Result<(), TestbedError> {
        let refuse = |what, value: String| Err(TestbedError::Input { time: self.now, what, value });
        if let Some(pose) = &input.shoulder
            && !pose.translation.vector.iter().chain(pose.rotation.coords.iter()).all(|v| v.is_finite())
        {
            return refuse("tracked shoulder pose", format!("{pose}"));
        }
        if let Some(limb) = &input.limb {
            let count = self.parts.model.arm_count();
            if limb.len() != count || !limb.iter().all(|angle| angle.is_finite()) {
                return refuse("tracked limb", format!("{limb:?}, expected {count} finite angles"));
            }
        }
        Ok(())
    }

    /// The gaze as the stages take it: one that is not finite or has no direction is a blink, and said once.
    pub(crate) fn usable_gaze(&mut self, gaze: &GazeSample, output: &mut TickOutput) -> GazeSample {
        let finite = gaze.origin.coords.iter().chain(gaze.direction.iter()).all(|v| v.is_finite());
        let usable = finite && (!gaze.valid || gaze.direction.norm() > 1e-9);
        if !usable && !self.gaze_unusable {
            self.note(output, EventKind::GazeUnusable);
        }
        self.gaze_unusable = !usable;
        let blink = GazeSample { origin: Point::origin(), direction: Vector::x(), valid: false };
        if usable { *gaze } else { blink }
    }

    /// What a gaze says of its tracker: a ray that repeats to the bit is no new measurement, unless it is that of a
    /// pointing device, which may rest.
    pub(crate) fn hear_gaze(&mut self, gaze: &GazeSample, input: &TickInput) {
        let points = input.signs.iter().any(|sign| sign.kind == SignKind::Points);
        let same = self.gaze.sample().is_some_and(|before| before == *gaze);
        let repeats = !points && (same || input.signs.contains(&AGAIN));
        let (now, source) = (self.now, InputSource::EyeTracker);
        match gaze.valid {
            true if repeats => self.watch.hear(now, source, SignKind::Repeated),
            true => self.watch.hear(now, source, SignKind::Fresh),
            false => self.watch.hear_blank(now),
        }
    }

    /// Whether the sources are alive. True if the arm must stop now, or may go on: the method must know at once.
    pub(crate) fn watch_sources(
        &mut self,
        input: &TickInput,
        gesture: Gesture,
        output: &mut TickOutput,
    ) -> bool {
        for sign in &input.signs {
            self.watch.hear(self.now, sign.source, sign.kind);
        }
        if let Some(emg) = &self.emg {
            let fault = emg.fault().map(|fault| (fault.cause(), fault.to_string()));
            self.watch.armband(fault, !emg.is_disarmed());
        }
        let change = self.watch.step(self.now, gesture);
        let changes = change.is_some();
        if let Some(event) = change {
            self.note(output, event);
        }
        changes
    }

    pub(crate) fn digest_input(&mut self, input: &TickInput) {
        for sample in &input.emg {
            self.digest.field(Field::InputEmg).word(sample.counter).numbers(&sample.channels);
        }
        if let Some(gesture) = input.gesture {
            self.digest.field(Field::InputGesture).word(gesture.index() as u64);
        }
        for sign in &input.signs {
            let field = &mut self.digest.field(Field::InputGesture);
            field.word(sign.source.index() as u64).word(sign.kind as u64);
        }
        if let Some(gaze) = &input.gaze {
            let field = &mut self.digest.field(Field::InputGaze);
            field.vector(&gaze.origin.coords).vector(&gaze.direction).word(u64::from(gaze.valid));
        }
        if let Some(pose) = &input.shoulder {
            self.digest.field(Field::InputShoulder).pose(pose);
        }
        if let Some(limb) = &input.limb {
            self.digest.field(Field::InputLimb).numbers(limb);
        }
    }
}
