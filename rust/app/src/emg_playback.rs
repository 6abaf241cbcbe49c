//! EMG of a recorded trial, thinned for a picture of the whole of it.

use proact_bridge::{RecordedEmg, RecordedWindow};
use proact_emg::{EmgConfig, EmgOutput};
use proact_types::{EmgSample, Gesture, SimTime};

/// Shortest step, ms: at the usual widths of a window a pixel shows more.
const MIN_STEP_MS: u64 = 10;
/// Most values of a trial, lowest and highest: about a megabyte of text, a third of that over the line.
const MAX_VALUES: u64 = 200_000;
/// Digits of a value that are kept: a plot shows fewer.
const SIGNIFICANT_DIGITS: i32 = 4;

/// What has been seen so far.
pub(crate) struct EmgPlayback<'a> {
    config: &'a EmgConfig,
    recorded_emg: RecordedEmg,
}

impl<'a> EmgPlayback<'a> {
    /// Of a trial of the length `end`, whose model tells `gestures` apart.
    pub(crate) fn new(config: &'a EmgConfig, gestures: &[Gesture], end: SimTime) -> Self {
        let step_ms = (end.0 * 2 * config.channels as u64).div_ceil(MAX_VALUES).max(MIN_STEP_MS);
        let recorded_emg = RecordedEmg {
            rate_hz: config.rate_hz,
            step_ms,
            gestures: gestures.to_vec(),
            ..Default::default()
        };
        Self { config, recorded_emg }
    }

    /// Takes what came in the tick `now`.
    pub(crate) fn push_tick(&mut self, now: SimTime, samples: &[EmgSample], decision: Option<&EmgOutput>) {
        let Self { config, recorded_emg } = self;
        let step = (now.0 / recorded_emg.step_ms) as usize;
        for sample in samples {
            recorded_emg.lowest.resize(step + 1, Vec::new());
            recorded_emg.highest.resize(step + 1, Vec::new());
            let values = config.electrode_sample(sample).channels;
            let (low, high) = (&mut recorded_emg.lowest[step], &mut recorded_emg.highest[step]);
            if low.len() != values.len() {
                (*low, *high) = (values.to_vec(), values.to_vec());
            }
            for ((low, high), value) in low.iter_mut().zip(high).zip(&values) {
                (*low, *high) = (low.min(*value), high.max(*value));
            }
        }
        recorded_emg.windows.extend(decision.map(|window| RecordedWindow {
            time: now,
            posterior: window.posterior.iter().map(|p| round_significant(*p)).collect(),
            in_force: window.gesture,
            effort: round_significant(window.effort),
        }));
    }

    /// The whole of it.
    pub(crate) fn finish(self) -> RecordedEmg {
        let mut recorded_emg = self.recorded_emg;
        for value in recorded_emg.lowest.iter_mut().chain(&mut recorded_emg.highest).flatten() {
            *value = round_significant(*value);
        }
        recorded_emg
    }
}

/// The same to [`SIGNIFICANT_DIGITS`] digits, which take less room.
fn round_significant(value: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return value;
    }
    let scale = 10_f64.powi(SIGNIFICANT_DIGITS - 1 - value.abs().log10().floor() as i32);
    let rounded = (value * scale).round() / scale;
    // What is too small for that scale is nothing.
    if rounded.is_finite() { rounded } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(counter: u64, values: [f64; 2]) -> EmgSample {
        EmgSample { counter, channels: values.into_iter().collect() }
    }

    #[test]
    fn a_peak_of_one_sample_stays_and_a_gap_is_a_gap() {
        let config = EmgConfig { channels: 2, ..EmgConfig::default() };
        let mut playback = EmgPlayback::new(&config, &[], SimTime(1000));
        for tick in (1..40_u64).filter(|tick| !(10..20).contains(tick)) {
            let value = if tick == 25 { 98.765_432 } else { 1.0 };
            playback.push_tick(SimTime(tick), &[sample(tick, [value, -value])], None);
        }
        let playback = playback.finish();
        assert_eq!((playback.step_ms, playback.lowest.len()), (10, 4));
        assert_eq!((&playback.lowest[0], &playback.highest[0]), (&vec![1.0, -1.0], &vec![1.0, -1.0]));
        assert!(playback.lowest[1].is_empty() && playback.highest[1].is_empty(), "nothing came");
        assert_eq!((&playback.lowest[2], &playback.highest[2]), (&vec![1.0, -98.77], &vec![98.77, -1.0]));
    }

    #[test]
    fn a_long_trial_with_a_grid_of_electrodes_has_longer_steps() {
        let config = EmgConfig { channels: 64, ..EmgConfig::default() };
        let playback = EmgPlayback::new(&config, &[], SimTime(300_000));
        assert!(
            300_000 / playback.recorded_emg.step_ms * 128 <= MAX_VALUES,
            "{} ms",
            playback.recorded_emg.step_ms
        );
    }

    #[test]
    fn values_keep_four_digits() {
        for (value, kept) in [(0.0, 0.0), (-1_234.56, -1_235.0), (0.000_123_456, 0.000_123_5), (1e-320, 0.0)]
        {
            assert_eq!(round_significant(value), kept);
        }
    }
}
