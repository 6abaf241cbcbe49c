use crate::feature::{FOURIER_BANDS_FROM_HZ, fourier_bands};
use crate::lanes::Lanes;
use crate::spectrum::PowerSpectrum;
use std::ops::Range;

/// Fourier transform of windows of one length. Buffers are allocated once.
#[derive(Clone, Debug)]
pub(crate) struct Spectral {
    transform: PowerSpectrum<Lanes>,
    length: f64,
    bin_hz: f64,
    /// Bins of each band of [`crate::Feature::Dftr`].
    bands: Vec<Range<usize>>,
}

/// What the powers of a window tell.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Frequencies {
    pub(crate) median: Lanes,
    pub(crate) mean: Lanes,
    pub(crate) mean_power: Lanes,
    pub(crate) second_moment: Lanes,
}

/// Most bands of [`crate::Feature::Dftr`].
pub(crate) const FOURIER_BANDS: usize = 6;

impl Spectral {
    pub(crate) fn new(length: usize, rate_hz: f64) -> Spectral {
        let transform = PowerSpectrum::new(length);
        let bin_hz = rate_hz / transform.size() as f64;
        let first = |inside: &dyn Fn(f64) -> bool| {
            let bins = transform.size() / 2;
            (0..bins).find(|k| inside(*k as f64 * bin_hz)).unwrap_or(bins)
        };
        let mut from = FOURIER_BANDS_FROM_HZ;
        let bands = fourier_bands(rate_hz).map(|to| {
            let band = first(&|hz| hz > from)..first(&|hz| hz >= to);
            from = to;
            band
        });
        let bands = bands.collect();
        Spectral { transform, length: length as f64, bin_hz, bands }
    }

    pub(crate) fn frequencies(&mut self, x: &[Lanes]) -> Frequencies {
        let powers = self.transform.powers(x);
        let total: Lanes = powers.iter().sum();
        let half = total * 0.5;
        let (mut below, mut weighted, mut squared) = (Lanes::ZERO, Lanes::ZERO, Lanes::ZERO);
        // No power, no median.
        let (mut median, mut found) = (Lanes::splat(f64::NAN), Lanes::ZERO);
        for (k, power) in powers.iter().enumerate() {
            below += *power;
            weighted += *power * k as f64;
            squared += *power * (k as f64 * self.bin_hz).powi(2);
            let beyond = below.simd_gt(half);
            median = (beyond & !found).select(Lanes::splat(k as f64 * self.bin_hz), median);
            found |= beyond;
        }
        let scale = self.length.powi(2);
        Frequencies {
            median,
            mean: weighted / total * self.bin_hz,
            mean_power: total / scale / powers.len() as f64,
            second_moment: squared / scale,
        }
    }

    /// Mean amplitudes of the bands to the power of two thirds.
    pub(crate) fn bands(&mut self, x: &[Lanes]) -> [Lanes; FOURIER_BANDS] {
        let powers = self.transform.powers(x);
        let mut means = [Lanes::ZERO; FOURIER_BANDS];
        for (mean, band) in means.iter_mut().zip(&self.bands) {
            let sum: Lanes = powers[band.clone()].iter().map(|power| power.sqrt()).sum();
            let root = (sum / self.length / band.len() as f64).cbrt();
            *mean = root * root;
        }
        means
    }
}
