use crate::feature_layout::pairs;

/// Strength of a channel and of its first difference.
pub(crate) type Radii = [f64; 2];

/// Distances between channels as phasors: each channel has its strength as radius and the angle of its electrode, evenly
/// spaced around the arm. Fills `out` with the logarithms of the distances of all pairs, then of their ratios to the
/// distances of the first differences.
pub(crate) fn phasors(radii: &[Radii], out: &mut [f64]) {
    let (half, channels) = (out.len() / 2, radii.len());
    // LibEMG keeps the directions in single precision.
    let direction = |channel: usize| {
        let (sin, cos) = (channel as f64 * 2.0 * std::f64::consts::PI / channels as f64).sin_cos();
        (f64::from(cos as f32), f64::from(sin as f32))
    };
    let distance = |a: usize, b: usize, one: f64, other: f64| {
        let ((ax, ay), (bx, by)) = (direction(a), direction(b));
        f64::hypot(one * ax - other * bx, one * ay - other * by)
    };
    for (k, (a, b)) in pairs(channels).enumerate() {
        let [whole, difference] = [0, 1].map(|part| distance(a, b, radii[a][part], radii[b][part]));
        out[k] = whole.ln();
        out[half + k] = (whole / difference).ln();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opposite_channels_are_the_sum_of_their_strengths_apart() {
        let mut out = [0.0; 2];
        phasors(&[[2.0, 1.0], [3.0, 1.0]], &mut out);
        assert!((out[0] - 5.0_f64.ln()).abs() < 1e-7 && (out[1] - 2.5_f64.ln()).abs() < 1e-7, "{out:?}");
    }
}
