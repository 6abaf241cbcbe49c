use crate::lanes::{Lanes, ln};
use fearless_simd::prelude::*;

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
#[derive(Clone, Copy, Debug)]
pub(crate) struct WaveletBand<S: Simd> {
    pub(crate) energy: Lanes<S>,
    pub(crate) variance: Lanes<S>,
    pub(crate) length: Lanes<S>,
    pub(crate) entropy: Lanes<S>,
}

/// Multi-level discrete wavelet transform of windows of one length. Buffers are allocated once.
#[derive(Clone, Debug)]
pub(crate) struct Wavelets<S: Simd> {
    /// The approximation so far, mirrored beyond its ends.
    mirrored: Vec<Lanes<S>>,
    approximation: Vec<Lanes<S>>,
    detail: Vec<Lanes<S>>,
}

impl<S: Simd> Wavelets<S> {
    pub(crate) fn new(length: usize) -> Self {
        // A level of a signal shorter than the filter has up to that many values.
        let buffer = |more: usize| Vec::with_capacity(length.max(LOW_PASS.len()) + more);
        Wavelets { mirrored: buffer(2 * EDGE_SAMPLES), approximation: buffer(0), detail: buffer(0) }
    }

    /// The bands of a window, from the lowest: the approximation, then the details. Fills `bands`.
    #[inline(always)]
    pub(crate) fn decompose(&mut self, x: &[Lanes<S>], bands: &mut [WaveletBand<S>]) {
        self.approximation.clear();
        self.approximation.extend_from_slice(x);
        for level in (1..bands.len()).rev() {
            self.transform();
            bands[level] = WaveletBand::of(&mut self.detail);
        }
        bands[0] = WaveletBand::of(&mut self.approximation);
    }

    /// One level: filters and takes every second value; beyond its ends the signal is mirrored, the sample at the edge included.
    #[inline(always)]
    fn transform(&mut self) {
        let x = &self.approximation;
        let (length, beyond) = (x.len() as isize, EDGE_SAMPLES as isize);
        self.mirrored.clear();
        for k in -beyond..0 {
            self.mirrored.push(x[mirrored_index(k, length)]);
        }
        self.mirrored.extend_from_slice(x);
        for k in length..length + beyond {
            self.mirrored.push(x[mirrored_index(k, length)]);
        }
        self.approximation.clear();
        self.detail.clear();
        // The oldest of the samples under the filter is the one before the first by all but one of the taps.
        let mut under = &self.mirrored[1..];
        while under.len() >= TAPS.len() {
            let many = under.len() >= 2 * (PARALLEL_OUTPUTS - 1) + TAPS.len();
            let sums: &[_] = if many {
                &filter_and_downsample::<_, PARALLEL_OUTPUTS>(under)
            } else {
                &filter_and_downsample::<_, 1>(under)
            };
            for [smooth, rough] in sums {
                self.approximation.push(*smooth);
                self.detail.push(*rough);
            }
            under = &under[2 * sums.len()..];
        }
    }
}

/// Places where the filters are summed up side by side: a sum alone waits for each of its additions.
const PARALLEL_OUTPUTS: usize = 4;

/// Both filters at each second of the samples, from the first on.
#[inline(always)]
fn filter_and_downsample<S: Simd, const PLACES: usize>(x: &[Lanes<S>]) -> [[Lanes<S>; 2]; PLACES] {
    let x = &x[..2 * (PLACES - 1) + TAPS.len()];
    let mut sums = [[Lanes::splat(x[0].simd, 0.0); 2]; PLACES];
    for (k, taps) in TAPS.iter().enumerate() {
        for (index, sum) in sums.iter_mut().enumerate() {
            sum[0] += x[2 * index + k] * taps[0];
            sum[1] += x[2 * index + k] * taps[1];
        }
    }
    sums
}

/// Where sample `k` of a signal mirrored at its ends, again and again, lies in it.
fn mirrored_index(mut k: isize, length: isize) -> usize {
    while !(0..length).contains(&k) {
        k = if k < 0 { -1 - k } else { 2 * length - 1 - k };
    }
    k as usize
}

/// Samples beyond either end that the filter sees.
const EDGE_SAMPLES: usize = LOW_PASS.len() - 1;

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

impl<S: Simd> WaveletBand<S> {
    pub(crate) fn new(simd: S) -> Self {
        let zero = Lanes::splat(simd, 0.0);
        WaveletBand { energy: zero, variance: zero, length: zero, entropy: zero }
    }

    /// Squares the coefficients in place.
    #[inline(always)]
    fn of(coefficients: &mut [Lanes<S>]) -> Self {
        let zero = Lanes::splat(coefficients[0].simd, 0.0);
        let mut energy = zero;
        for coefficient in &mut *coefficients {
            *coefficient *= *coefficient;
            energy += *coefficient;
        }
        let (squares, count) = (&*coefficients, coefficients.len() as f64);
        let (mean, mut last) = (energy / count, squares[0]);
        let one_over_energy = Lanes::splat(zero.simd, 1.0) / energy;
        let (mut variance, mut length, mut entropy) = (zero, zero, zero);
        for square in squares {
            let (from_mean, share) = (*square - mean, *square * one_over_energy);
            variance += from_mean * from_mean;
            length += (*square - last).abs();
            entropy -= share * ln(share);
            last = *square;
        }
        WaveletBand {
            energy: ln(energy + FLOOR),
            variance: ln(variance / count + FLOOR),
            length: ln(length + FLOOR),
            entropy,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feature::wavelet_bands;
    use fearless_simd::{Level, dispatch};

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
        let wave = |hz: f64| (0..4000).map(move |k| (f64::from(k) * 0.00628 * hz).sin());
        let strongest = |hz: f64| {
            let energies: Vec<f64> = dispatch!(Level::new(), simd => {
                let mut bands = vec![WaveletBand::new(simd); wavelet_bands(1000.0)];
                let x: Vec<_> = wave(hz).map(|value| Lanes::splat(simd, value)).collect();
                Wavelets::new(4000).decompose(&x, &mut bands);
                bands.iter().map(|band| band.energy[0]).collect()
            });
            energies.into_iter().enumerate().max_by(|a, b| a.1.total_cmp(&b.1)).map(|(band, _)| band)
        };
        assert_eq!(strongest(400.0), Some(7));
        assert_eq!(strongest(180.0), Some(6));
        assert_eq!(strongest(45.0), Some(4));
    }
}
