use crate::spectrum::PowerSpectrum;
use std::f64::consts::TAU;

/// Length of a segment, seconds: a line every 2 to 4 Hz tells mains hum from muscle.
const SEGMENT_SECS: f64 = 0.5;
/// Shortest segment, samples.
const MIN_SEGMENT_SAMPLES: f64 = 32.0;

/// The power spectrum of a short piece of one channel.
#[derive(Clone, Debug, PartialEq)]
pub struct WelchSpectrum {
    /// From line to line, hertz; the first is at zero.
    pub bin_width_hz: f64,
    /// Power a hertz, the signal's unit squared; without the mean.
    pub density: Vec<f64>,
}

/// Welch's estimate (IEEE Trans. Audio Electroacoust. 15(2), 1967, 70-73): segments of at most half a second, a power of two
/// long, under a Hann window, which overlap by half; the last ends with the newest value. None of too few values, or of values that
/// are no numbers.
pub fn welch(values: &[f64], rate_hz: f64) -> Option<WelchSpectrum> {
    let max_samples = (SEGMENT_SECS * rate_hz).max(MIN_SEGMENT_SAMPLES) as usize;
    let size = max_samples.checked_ilog2().map(|bits| 1_usize << bits)?;
    if values.len() < size || !values.iter().all(|value| value.is_finite()) {
        return None;
    }
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let window: Vec<f64> = (0..size).map(|k| 0.5 - 0.5 * (TAU * k as f64 / size as f64).cos()).collect();
    let power: f64 = window.iter().map(|weight| weight * weight).sum();
    let mut transform = PowerSpectrum::new(size, 0.0);
    let mut density = vec![0.0; size / 2];
    let mut segments = 0.0;
    for end in (size..=values.len()).rev().step_by(size / 2) {
        let segment = window.iter().zip(&values[end - size..end]);
        let weighted: Vec<f64> = segment.map(|(weight, value)| weight * (value - mean)).collect();
        transform.transform(&weighted);
        // Twice: the half with negative frequencies is not kept.
        for (sum, bin) in density.iter_mut().zip(transform.powers()).skip(1) {
            *sum += 2.0 * bin / (power * rate_hz);
        }
        segments += 1.0;
    }
    density.iter_mut().for_each(|sum| *sum /= segments);
    Some(WelchSpectrum { bin_width_hz: rate_hz / size as f64, density })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sine_has_half_its_squared_amplitude_at_its_frequency() {
        // On line 40 of 1024 at 4 kHz, about an offset.
        let value = |k: usize| 7.0 + 3.0 * (TAU * 40.0 * k as f64 / 1024.0).sin();
        let spectrum = welch(&(0..4096).map(value).collect::<Vec<_>>(), 4000.0).expect("long enough");
        assert_eq!((spectrum.bin_width_hz, spectrum.density.len()), (4000.0 / 1024.0, 512));
        let power = |lines: &[f64]| lines.iter().sum::<f64>() * spectrum.bin_width_hz;
        assert!((power(&spectrum.density) - 4.5).abs() < 1e-9);
        // The window spreads it over three lines.
        assert!((power(&spectrum.density[39..42]) - 4.5).abs() < 1e-9);
    }

    #[test]
    fn too_short_and_unusable_signals_have_none() {
        assert_eq!(welch(&[1.0; 511], 2000.0), None);
        assert!(
            welch(&[1.0; 512], 2000.0).is_some_and(|flat| flat.density.iter().all(|power| *power == 0.0))
        );
        assert_eq!(welch(&[f64::NAN; 2000], 2000.0), None);
    }
}
