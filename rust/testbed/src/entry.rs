//! What enters a tick: checked, and bound into the digest.

use crate::{Field, Testbed, TestbedError};
use proact_types::TickInput;

impl Testbed {
    pub(crate) fn check_input(&self, input: &TickInput) -> Result<(), TestbedError> {
        let refuse = |what, value: String| Err(TestbedError::Input { time: self.now, what, value });
        if let Some(gaze) = &input.gaze {
            let finite = gaze.origin.coords.iter().chain(gaze.direction.iter()).all(|v| v.is_finite());
            if !finite || (gaze.valid && gaze.direction.norm() < 1e-9) {
                return refuse(
                    "gaze",
                    format!("{:?}, {:?}", gaze.origin.coords.as_slice(), gaze.direction.as_slice()),
                );
            }
        }
        if let Some(pose) = &input.shoulder
            && !pose.translation.vector.iter().chain(pose.rotation.coords.iter()).all(|v| v.is_finite())
        {
            return refuse("tracked shoulder pose", format!("{pose}"));
        }
        Ok(())
    }

    pub(crate) fn digest_input(&mut self, input: &TickInput) {
        for sample in &input.emg {
            self.digest.field(Field::InputEmg).word(sample.counter).numbers(&sample.channels);
        }
        if let Some(gesture) = input.gesture {
            self.digest.field(Field::InputGesture).word(gesture.index() as u64);
        }
        if let Some(gaze) = &input.gaze {
            let field = &mut self.digest.field(Field::InputGaze);
            field.vector(&gaze.origin.coords).vector(&gaze.direction).word(u64::from(gaze.valid));
        }
        if let Some(pose) = &input.shoulder {
            self.digest.field(Field::InputShoulder).pose(pose);
        }
    }
}
