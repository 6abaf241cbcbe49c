use crate::simultaneous::ProportionalDrives;
use crate::{ControlError, Simultaneous};
use serde::{Deserialize, Serialize};

/// How methods A and B follow the gestures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "pace", rename_all = "snake_case", deny_unknown_fields)]
pub enum JogProfile {
    /// At a speed, for as long as a gesture is held.
    Time {
        /// HO held this long goes back by one from where it began, once in each such span; 0 is never.
        reverse_cycle_after_ms: u64,
        /// HO that follows HC directly counts once it has lasted this long.
        open_after_close_ms: u64,
        /// With a block in hand, opening is asked for twice within this time; 0 is off.
        confirm_open_ms: u64,
        /// A slow and a fast step; without them there is one speed.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        speed_steps: Option<JogSteps>,
        /// Speed by how hard the gesture is made; without it there is one speed. Keys are at full effort.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        proportional: Option<ProportionalSpeed>,
        /// Speed that grows while a gesture lasts, and that a wrong decision cannot make great.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        ramp: Option<VelocityRamp>,
        /// What the degrees of freedom of a regressor move, all at the same time; without it gestures move one thing after the
        /// other.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        simultaneous: Option<Simultaneous>,
    },
    /// By a step for each message of the classifier (the original).
    Message {
        /// Spacing of the messages assumed while none has come: gestures from keys make none.
        nominal_period_ms: u64,
        /// Messages after a change of mode are dropped until the next joint state, one in each such span.
        joint_state_period_ms: u64,
    },
}

impl JogProfile {
    /// What the degrees of freedom of a regressor move; none where gestures move one thing after the other.
    pub fn simultaneous(&self) -> Option<&Simultaneous> {
        if let JogProfile::Time { simultaneous, .. } = self { simultaneous.as_ref() } else { None }
    }

    /// From drives to motion, where a regressor drives.
    pub(crate) fn proportional_drives(&self) -> Option<ProportionalDrives> {
        let JogProfile::Time { simultaneous: Some(simultaneous), confirm_open_ms, .. } = self else {
            return None;
        };
        Some(ProportionalDrives::new(simultaneous, *confirm_open_ms))
    }

    pub(crate) fn check(&self) -> Result<(), ControlError> {
        let JogProfile::Time { speed_steps: steps, proportional, ramp, simultaneous, .. } = self else {
            return Ok(());
        };
        simultaneous.as_ref().map_or(Ok(()), Simultaneous::check)?;
        steps.as_ref().map_or(Ok(()), JogSteps::check)?;
        proportional.as_ref().map_or(Ok(()), ProportionalSpeed::check)?;
        ramp.as_ref().map_or(Ok(()), VelocityRamp::check)
    }
}

/// Proportional control: the share of the speed by effort, [`ControlInput::effort`](crate::ControlInput::effort).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProportionalSpeed {
    /// Efforts up to here stand still, 0 to 1.
    pub rest_effort: f64,
    /// From this effort on the speed is whole, at least 0.001 above `rest` and at most 1.
    pub full_effort: f64,
}

impl ProportionalSpeed {
    fn check(&self) -> Result<(), ControlError> {
        let Self { rest_effort: rest, full_effort: full } = *self;
        let refused = |key, got, expected| Err(ControlError::Value { key, got, expected });
        if !(0.0..1.0).contains(&rest) {
            return refused("jog.proportional.rest_effort", rest, "0 and below 1");
        }
        if !(full >= rest + 0.001 && full <= 1.0) {
            let expected = "at least 0.001 above jog.proportional.rest_effort and at most 1";
            return refused("jog.proportional.full_effort", full, expected);
        }
        Ok(())
    }

    /// The share of the speed at this effort.
    pub fn speed_factor(&self, effort: f64) -> f64 {
        ((effort - self.rest_effort) / (self.full_effort - self.rest_effort)).clamp(0.0, 1.0)
    }
}

/// A velocity ramp (A. M. Simon et al., IEEE Transactions on Biomedical Engineering 58(8), 2011, 2360-2368): each direction has a
/// counter that grows while it is decided for and falls faster while it is not; the speed is its share of the full count. There it
/// counts decisions, here the time that they stand.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VelocityRamp {
    /// From rest to the whole speed, ms.
    pub rise_ms: u64,
    /// How many times as fast it falls, 1 to 100; 2 in the publication.
    pub fall_rate_factor: f64,
}

impl VelocityRamp {
    fn check(&self) -> Result<(), ControlError> {
        let refused = |key, got, expected| Err(ControlError::Value { key, got, expected });
        if !(1..=10_000).contains(&self.rise_ms) {
            return refused("jog.ramp.rise_ms", self.rise_ms as f64, "1 to 10000");
        }
        if !(1.0..=100.0).contains(&self.fall_rate_factor) {
            return refused("jog.ramp.fall_rate_factor", self.fall_rate_factor, "1 to 100");
        }
        Ok(())
    }

    /// The counter of a direction, 0 to 1, after `millis` in which it was decided for or not.
    pub fn next_counter(&self, before: f64, millis: u64, decided: bool) -> f64 {
        let change = millis as f64 / self.rise_ms as f64;
        (before + if decided { change } else { -self.fall_rate_factor * change }).clamp(0.0, 1.0)
    }
}

/// How fast methods A and B move while a gesture is held, as shares of the method's speed: slow at first, so that a tap is a
/// small step, and fast later.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JogSteps {
    /// Slow for so long.
    pub slow_ms: u64,
    /// Share of the speed until then, 0.001 to 1.
    pub slow_factor: f64,
    /// Fast from here on.
    pub fast_after_ms: u64,
    /// Share of the speed from then on, 1 to 4.
    pub fast_factor: f64,
}

impl JogSteps {
    /// For keys, which have no effort. [assumed]: with method B a tap of 0.15 s goes 5 mm, and 0.3 m take 2.4 s instead of
    /// 3.75 s.
    pub const KEYS: Self = Self { slow_ms: 250, slow_factor: 0.4, fast_after_ms: 900, fast_factor: 2.0 };

    fn check(&self) -> Result<(), ControlError> {
        let JogSteps { slow_ms, slow_factor: slow, fast_after_ms, fast_factor: fast } = *self;
        let refused = |key, got, expected| Err(ControlError::Value { key, got, expected });
        if !(0.001..=1.0).contains(&slow) {
            return refused("jog.speed_steps.slow_factor", slow, "0.001 to 1");
        }
        if !(1.0..=4.0).contains(&fast) {
            return refused("jog.speed_steps.fast_factor", fast, "1 to 4");
        }
        if fast_after_ms < slow_ms {
            return refused(
                "jog.speed_steps.fast_after_ms",
                fast_after_ms as f64,
                "at least jog.speed_steps.slow_ms",
            );
        }
        Ok(())
    }

    /// The share of the speed once a gesture has been held for `held_ms`.
    pub fn speed_factor(&self, held_ms: u64) -> f64 {
        match held_ms {
            held if held >= self.fast_after_ms => self.fast_factor,
            held if held < self.slow_ms => self.slow_factor,
            _ => 1.0,
        }
    }
}
