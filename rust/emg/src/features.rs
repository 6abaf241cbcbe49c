use crate::WindowView;
use arrayvec::ArrayVec;
use proact_types::MAX_EMG_CHANNELS;

/// Most features of a window.
pub const MAX_FEATURES: usize = 8 * MAX_EMG_CHANNELS;

/// Features of one window, feature-major: all channels of the first feature, then all of the second.
pub type FeatureVector = ArrayVec<f64, MAX_FEATURES>;

/// Hudgins' time-domain features of a window of L samples x_0 .. x_{L-1} per channel: blocks of MAV, ZC, SSC, WL,
/// as LibEMG 2.0.3 computes its group `HTD` with default parameters.
///
/// - Mean absolute value, `sum |x_i| / L`, in the stream's unit.
/// - Zero crossings: neighbours of opposite sign. No dead zone; a sample that is exactly zero hides a crossing.
/// - Slope sign changes: `(x_i - x_{i-1}) (x_i - x_{i+1}) >= 0`. Because equality counts, each point of a plateau
///   counts, and a dead channel shows the largest value possible, L - 2. Textbooks use `>`.
/// - Waveform length, `sum |x_{i+1} - x_i|`, in the stream's unit.
pub fn hudgins(window: &WindowView<'_>) -> FeatureVector {
    let channels = window.channels();
    let mut features: FeatureVector = std::iter::repeat_n(0.0, 4 * channels).collect();
    for channel in 0..channels {
        let values = hudgins_of_channel(window.channel(channel));
        for (block, value) in values.into_iter().enumerate() {
            features[block * channels + channel] = value;
        }
    }
    features
}

fn hudgins_of_channel(x: &[f64]) -> [f64; 4] {
    let mean_absolute_value = x.iter().map(|v| v.abs()).sum::<f64>() / x.len() as f64;
    let (mut crossings, mut turns, mut length) = (0_u32, 0_u32, 0.0);
    for pair in x.windows(2) {
        crossings += u32::from((pair[0] > 0.0 && pair[1] < 0.0) || (pair[0] < 0.0 && pair[1] > 0.0));
        length += (pair[1] - pair[0]).abs();
    }
    for triple in x.windows(3) {
        turns += u32::from((triple[1] - triple[0]) * (triple[1] - triple[2]) >= 0.0);
    }
    [mean_absolute_value, f64::from(crossings), f64::from(turns), length]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_zero_between_two_signs_hides_the_crossing() {
        assert_eq!(hudgins_of_channel(&[1.0, 0.0, -1.0])[1], 0.0);
        assert_eq!(hudgins_of_channel(&[1.0, -1.0, 1.0])[1], 2.0);
    }

    #[test]
    fn a_dead_channel_shows_the_largest_number_of_slope_sign_changes() {
        assert_eq!(hudgins_of_channel(&[5.0; 10]), [5.0, 0.0, 8.0, 0.0]);
    }
}
