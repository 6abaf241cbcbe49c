use crate::feature::{FOURIER_BANDS_FROM_HZ, fourier_bands};
use crate::lanes::{Lanes, Mask, cbrt, sum};
use crate::spectrum::PowerSpectrum;
use fearless_simd::prelude::*;
use std::ops::Range;

/// Fourier transform of windows of one length. Buffers are allocated once.
#[derive(Clone, Debug)]
pub(crate) struct SpectralFeatures<S: Simd> {
    simd: S,
    transform: PowerSpectrum<Lanes<S>>,
    length: f64,
    bin_hz: f64,
    /// Bins of each band of [`crate::Feature::Dftr`].
    bands: Vec<Range<usize>>,
}

/// What the powers of a window tell.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SpectralMoments<S: Simd> {
    pub(crate) median: Lanes<S>,
    pub(crate) mean: Lanes<S>,
    pub(crate) mean_power: Lanes<S>,
    pub(crate) second_moment: Lanes<S>,
}

/// Most bands of [`crate::Feature::Dftr`].
pub(crate) const FOURIER_BANDS: usize = 6;

impl<S: Simd> SpectralMoments<S> {
    pub(crate) fn new(simd: S) -> Self {
        let zero = Lanes::splat(simd, 0.0);
        SpectralMoments { median: zero, mean: zero, mean_power: zero, second_moment: zero }
    }
}

impl<S: Simd> SpectralFeatures<S> {
    pub(crate) fn new(simd: S, length: usize, rate_hz: f64) -> Self {
        let transform = PowerSpectrum::new(length, Lanes::splat(simd, 0.0));
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
        SpectralFeatures { simd, transform, length: length as f64, bin_hz, bands }
    }

    /// Transforms a window for the two others.
    #[inline(always)]
    pub(crate) fn transform(&mut self, x: &[Lanes<S>]) {
        self.transform.transform(x);
    }

    #[inline(always)]
    pub(crate) fn frequencies(&self) -> SpectralMoments<S> {
        let simd = self.simd;
        let zero = Lanes::splat(simd, 0.0);
        let powers = self.transform.powers();
        let total = sum!(self.simd, power in powers => *power);
        let half = total * 0.5;
        let (mut below, mut weighted, mut squared) = (zero, zero, zero);
        // No power, no median.
        let (mut median, mut found) = (Lanes::splat(simd, f64::NAN), Mask::splat(simd, false));
        for (k, power) in powers.iter().enumerate() {
            below += *power;
            weighted += *power * k as f64;
            squared += *power * (k as f64 * self.bin_hz).powi(2);
            let beyond = below.simd_gt(half);
            median = (beyond & !found).select(Lanes::splat(simd, k as f64 * self.bin_hz), median);
            found |= beyond;
        }
        let scale = self.length.powi(2);
        SpectralMoments {
            median,
            mean: weighted / total * self.bin_hz,
            mean_power: total / scale / powers.len() as f64,
            second_moment: squared / scale,
        }
    }

    /// Mean amplitudes of the bands to the power of two thirds.
    #[inline(always)]
    pub(crate) fn bands(&self) -> [Lanes<S>; FOURIER_BANDS] {
        let powers = self.transform.powers();
        let mut means = [Lanes::splat(self.simd, 0.0); FOURIER_BANDS];
        for (mean, band) in means.iter_mut().zip(&self.bands) {
            let amplitudes = sum!(self.simd, power in &powers[band.clone()] => power.sqrt());
            *mean = amplitudes / self.length / band.len() as f64;
        }
        // Apart, so that they do not wait for each other.
        for mean in &mut means {
            let root = cbrt(*mean);
            *mean = root * root;
        }
        means
    }
}
