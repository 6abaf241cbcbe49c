use crate::feature::wavelet_bands;

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
    pub(crate) energy: f64,
    pub(crate) variance: f64,
    pub(crate) length: f64,
    pub(crate) entropy: f64,
}

/// Multi-level discrete wavelet transform of windows of one length. Buffers are allocated once.
#[derive(Clone, Debug)]
pub(crate) struct Wavelets {
    approximation: Vec<f64>,
    next: Vec<f64>,
    detail: Vec<f64>,
    /// The approximation, then the details from the lowest.
    bands: Vec<Band>,
}

impl Wavelets {
    pub(crate) fn new(length: usize, rate_hz: f64) -> Wavelets {
        // A level of a signal shorter than the filter has up to that many values.
        let room = || Vec::with_capacity(length.max(LOW_PASS.len()));
        Wavelets {
            approximation: room(),
            next: room(),
            detail: room(),
            bands: vec![Band::default(); wavelet_bands(rate_hz)],
        }
    }

    /// The bands of a window, from the lowest.
    pub(crate) fn decompose(&mut self, x: &[f64]) -> &[Band] {
        self.approximation.clear();
        self.approximation.extend_from_slice(x);
        for level in (1..self.bands.len()).rev() {
            transform(&self.approximation, &mut self.next, &mut self.detail);
            self.bands[level] = Band::of(&mut self.detail);
            std::mem::swap(&mut self.approximation, &mut self.next);
        }
        self.bands[0] = Band::of(&mut self.approximation);
        &self.bands
    }

    /// Of the newest window.
    pub(crate) fn bands(&self) -> &[Band] {
        &self.bands
    }
}

impl Band {
    /// Squares the coefficients in place.
    fn of(coefficients: &mut [f64]) -> Band {
        coefficients.iter_mut().for_each(|c| *c *= *c);
        let squares = &*coefficients;
        let count = squares.len() as f64;
        let energy: f64 = squares.iter().sum();
        let variance = squares.iter().map(|s| (s - energy / count).powi(2)).sum::<f64>() / count;
        let length: f64 = squares.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum();
        let entropy = squares.iter().map(|s| s / energy).map(|share| -share * share.ln()).sum();
        Band {
            energy: (energy + FLOOR).ln(),
            variance: (variance + FLOOR).ln(),
            length: (length + FLOOR).ln(),
            entropy,
        }
    }
}

/// One level: filters and takes every second value; beyond its ends the signal is mirrored, the sample at the edge included.
fn transform(x: &[f64], low: &mut Vec<f64>, high: &mut Vec<f64>) {
    let taps = LOW_PASS.len();
    let at = |k: isize| {
        let period = 2 * x.len() as isize;
        let within = k.rem_euclid(period);
        x[if within < x.len() as isize { within } else { period - 1 - within } as usize]
    };
    low.clear();
    high.clear();
    for k in 0..(x.len() + taps - 1) / 2 {
        let newest = 2 * k as isize + 1;
        let (mut smooth, mut rough) = (0.0, 0.0);
        for (j, tap) in LOW_PASS.iter().enumerate() {
            let value = at(newest - j as isize);
            smooth += tap * value;
            // The high-pass filter is the low-pass one backwards, its even taps negated.
            let mirrored = LOW_PASS[taps - 1 - j];
            rough += if j % 2 == 0 { -mirrored } else { mirrored } * value;
        }
        low.push(smooth);
        high.push(rough);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let wave = |hz: f64| -> Vec<f64> { (0..4000).map(|k| (f64::from(k) * 0.00628 * hz).sin()).collect() };
        let mut wavelets = Wavelets::new(4000, 1000.0);
        let strongest = |bands: &[Band]| {
            let energies = bands.iter().map(|b| b.energy).enumerate();
            energies.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(band, _)| band)
        };
        assert_eq!(strongest(wavelets.decompose(&wave(400.0))), Some(7));
        assert_eq!(strongest(wavelets.decompose(&wave(180.0))), Some(6));
        assert_eq!(strongest(wavelets.decompose(&wave(45.0))), Some(4));
    }
}
