use crate::lanes::{Lanes, each};

/// Low-pass filter of the decomposition by symlets of order 8 (Daubechies, Ten Lectures on Wavelets, 1992), as
/// PyWavelets tabulates it. The high-pass filter is this one backwards, with alternating signs.
const LOW_PASS: [f64; 16] = [
    -0.0033824159510061256,
    -0.0005421323317911481,
    0.03169508781149298,
    0.007607487324917605,
    -0.1432942383508097,
    -0.061273359067658524,
    0.4813596512583722,
    0.7771857517005235,
    0.3644418948353314,
    -0.05194583810770904,
    -0.027219029917056003,
    0.049137179673607506,
    0.003808752013890615,
    -0.01495225833704823,
    -0.0003029205147213668,
    0.0018899503327594609,
];

/// Added before each logarithm.
const FLOOR: f64 = 1e-10;

/// What the wavelet features tell of one band.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Band {
    pub(crate) energy: Lanes,
    pub(crate) variance: Lanes,
    pub(crate) length: Lanes,
    pub(crate) entropy: Lanes,
}

/// Multi-level discrete wavelet transform of windows of one length. Buffers are allocated once.
#[derive(Clone, Debug)]
pub(crate) struct Wavelets {
    /// The approximation so far, mirrored beyond its ends.
    mirrored: Vec<Lanes>,
    approximation: Vec<Lanes>,
    detail: Vec<Lanes>,
}

impl Wavelets {
    pub(crate) fn new(length: usize) -> Wavelets {
        // A level of a signal shorter than the filter has up to that many values.
        let room = |more: usize| Vec::with_capacity(length.max(LOW_PASS.len()) + more);
        Wavelets { mirrored: room(2 * BEYOND), approximation: room(0), detail: room(0) }
    }

    /// The bands of a window, from the lowest: the approximation, then the details. Fills `bands`.
    pub(crate) fn decompose(&mut self, x: &[Lanes], bands: &mut [Band]) {
        self.approximation.clear();
        self.approximation.extend_from_slice(x);
        for level in (1..bands.len()).rev() {
            self.transform();
            bands[level] = Band::of(&mut self.detail);
        }
        bands[0] = Band::of(&mut self.approximation);
    }

    /// One level: filters and takes every second value; beyond its ends the signal is mirrored, the sample at the edge included.
    fn transform(&mut self) {
        let x = &self.approximation;
        let at = |k: isize| {
            let period = 2 * x.len() as isize;
            let within = k.rem_euclid(period);
            x[if within < x.len() as isize { within } else { period - 1 - within } as usize]
        };
        let (length, beyond) = (x.len() as isize, BEYOND as isize);
        self.mirrored.clear();
        self.mirrored.extend((-beyond..0).map(at));
        self.mirrored.extend_from_slice(x);
        self.mirrored.extend((length..length + beyond).map(at));
        self.approximation.clear();
        self.detail.clear();
        // The oldest of the samples under the filter is the one before the first by all but one of the taps.
        for under in self.mirrored[1..].windows(LOW_PASS.len()).step_by(2) {
            let (mut smooth, mut rough) = (Lanes::ZERO, Lanes::ZERO);
            for (value, taps) in under.iter().zip(&TAPS) {
                smooth += *value * taps[0];
                rough += *value * taps[1];
            }
            self.approximation.push(smooth);
            self.detail.push(rough);
        }
    }
}

/// Samples beyond either end that the filter sees.
const BEYOND: usize = LOW_PASS.len() - 1;

/// Both filters for the samples from the oldest: the high-pass filter is the low-pass one backwards, its even taps negated.
const TAPS: [[f64; 2]; LOW_PASS.len()] = {
    let mut taps = [[0.0; 2]; LOW_PASS.len()];
    let mut oldest = 0;
    while oldest < LOW_PASS.len() {
        let newest = LOW_PASS.len() - 1 - oldest;
        let sign = if newest.is_multiple_of(2) { -1.0 } else { 1.0 };
        taps[oldest] = [LOW_PASS[newest], sign * LOW_PASS[oldest]];
        oldest += 1;
    }
    taps
};

impl Band {
    /// Squares the coefficients in place.
    fn of(coefficients: &mut [Lanes]) -> Band {
        coefficients.iter_mut().for_each(|c| *c *= *c);
        let squares = &*coefficients;
        let count = squares.len() as f64;
        let energy: Lanes = squares.iter().sum();
        let mean = energy / count;
        let variance = squares.iter().map(|s| (*s - mean) * (*s - mean)).sum::<Lanes>() / count;
        let length: Lanes = squares.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum();
        let entropy = squares.iter().map(|s| *s / energy).map(|share| -share * share.ln()).sum();
        let logarithm = |value: Lanes| each(value + FLOOR, f64::ln);
        Band { energy: logarithm(energy), variance: logarithm(variance), length: logarithm(length), entropy }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feature::wavelet_bands;

    #[test]
    fn the_filter_is_orthonormal() {
        for shift in 0..LOW_PASS.len() / 2 {
            let product: f64 = LOW_PASS.iter().zip(&LOW_PASS[2 * shift..]).map(|(a, b)| a * b).sum();
            let expected = if shift == 0 { 1.0 } else { 0.0 };
            assert!((product - expected).abs() < 1e-11, "shift {shift}: {product}");
        }
        assert!((LOW_PASS.iter().sum::<f64>() - f64::sqrt(2.0)).abs() < 1e-11);
    }

    #[test]
    fn a_slow_wave_lies_in_a_low_band_and_a_fast_one_in_the_highest() {
        let wave = |hz: f64| -> Vec<Lanes> {
            (0..4000).map(|k| Lanes::splat((f64::from(k) * 0.00628 * hz).sin())).collect()
        };
        let mut wavelets = Wavelets::new(4000);
        let mut strongest = |hz: f64| {
            let mut bands = vec![Band::default(); wavelet_bands(1000.0)];
            wavelets.decompose(&wave(hz), &mut bands);
            let energies = bands.iter().map(|b| b.energy.to_array()[0]).enumerate();
            energies.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(band, _)| band)
        };
        assert_eq!(strongest(400.0), Some(7));
        assert_eq!(strongest(180.0), Some(6));
        assert_eq!(strongest(45.0), Some(4));
    }
}
