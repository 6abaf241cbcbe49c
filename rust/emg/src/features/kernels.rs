use super::FeatureParameters;
use super::autoregression::{burg, cepstrum};
use super::descriptors::Descriptors;
use super::entropy::{fuzzy_entropy, sample_entropy};
use super::phasors::{Radii, phasors};
use super::spectral::{FOURIER_BANDS, SpectralFeatures, SpectralMoments};
use super::sums::{
    central_moments, l_score, largest, lengths, magnitude_and_crossings, mav_slope, mean_cube,
    mean_logarithm, mean_square_root, slope_sign_changes_and_waveform_length, squares, willison_amplitude,
};
use super::wavelets::{WaveletBand, Wavelets};
use crate::feature::{AR_ORDER, FeatureShape, wavelet_bands};
use crate::lanes::{LANES, Lanes, Mask, exp, ln, mean, mean_absolute, select_or_zero};
use crate::{EmgConfig, Feature, FeatureLayout, WindowView};
use fearless_simd::prelude::*;
use std::fmt::Debug;

/// The arithmetic of [`super::FeatureExtractor`], compiled for one kind of processor.
pub(super) trait Kernels: Debug + Send + Sync {
    /// Fills `out`, up to the means of an inertial measurement unit, with the features of a window of the right size.
    fn compute(&mut self, window: &WindowView<'_>, layout: &FeatureLayout, out: &mut [f64]);

    fn boxed_clone(&self) -> Box<dyn Kernels>;
}

/// [`Kernels`] with the vectors of `S`.
#[derive(Clone, Debug)]
pub(super) struct SimdKernels<S: Simd> {
    simd: S,
    length: usize,
    /// The window's samples, eight channels after the other: `[channels / 8, rounded up][length]`.
    samples: Vec<Lanes<S>>,
    /// Eight channels each.
    blocks: Vec<Block<S>>,
    /// For sorting, standardising, logarithms and Burg's forward errors.
    scratch: Vec<Lanes<S>>,
    /// Burg's backward errors.
    backward: Vec<Lanes<S>>,
    /// None if no feature is of the spectrum.
    spectral: Option<SpectralFeatures<S>>,
    wavelets: Wavelets<S>,
    /// Strength of each channel.
    radii: Vec<Radii>,
    needs: RequiredQuantities,
}

/// Which quantities the set is made of; nothing else is computed.
#[derive(Clone, Copy, Debug)]
struct RequiredQuantities {
    magnitudes: bool,
    slopes: bool,
    squares: bool,
    lengths: bool,
    descriptors: bool,
    central: bool,
    ar: bool,
    frequencies: bool,
    fourier: bool,
    wavelets: bool,
}

/// Quantities of eight channels that several features share.
#[derive(Clone, Debug)]
struct Block<S: Simd> {
    /// MAV and ZC.
    magnitudes: [Lanes<S>; 2],
    /// SSC and WL.
    slopes: [Lanes<S>; 2],
    /// Sums of the squares of the signal and its first and second differences.
    squares: [Lanes<S>; 3],
    /// Sums of the magnitudes of the first and second differences.
    lengths: [Lanes<S>; 2],
    descriptors: Descriptors<S>,
    /// Second, third and fourth central moment.
    central: [Lanes<S>; 3],
    /// Lanes whose spread is rounding only.
    constant: Mask<S>,
    ar: [Lanes<S>; AR_ORDER],
    frequencies: SpectralMoments<S>,
    fourier: [Lanes<S>; FOURIER_BANDS],
    wavelets: Vec<WaveletBand<S>>,
}

/// What COMP needs of the other channels.
struct AllChannels {
    /// Sum of the squares of the second differences.
    second_difference_energy: f64,
}

/// `apart!(simd, value)`: the value by a function of its own, compiled for the processor's vectors, so that what it sums up
/// stays in registers.
macro_rules! outlined {
    ($simd:expr, $value:expr) => {
        $simd.vectorize(
            #[inline(always)]
            || $value,
        )
    };
}

/// Samples beyond this may overflow when raised to the fourth power and summed.
const MAX_SAMPLE: f64 = 1e70;

impl<S: Simd> SimdKernels<S> {
    pub(super) fn new(simd: S, config: &EmgConfig, length: usize) -> Self {
        use Feature::*;
        let set = config.features;
        let any = |features: &[Feature]| features.iter().any(|f| set.contains(*f));
        let needs = RequiredQuantities {
            magnitudes: any(&[Mav, Zc]),
            slopes: any(&[Ssc, Wl]),
            descriptors: any(&[M0, M2, M4, Sparsi, Irf, Wlf]),
            squares: any(&[Rms, Dasdv, Act, Mob, Comp, Compc, Rmsphasor, Pap, Mzp, Isd, Cor, Mdiff]),
            lengths: any(&[Mfl, Mavfd, Wlphasor]),
            central: any(&[Var, Skew, Kurt]),
            ar: any(&[Ar4, Cc]),
            frequencies: any(&[Mdf, Mnf, Mnp, Sm]),
            fourier: any(&[Dftr]),
            wavelets: any(&[Weng, Wv, Wwl, Went]),
        };
        let blocks = config.channels.div_ceil(LANES);
        let zeros = |count: usize| vec![Lanes::splat(simd, 0.0); count];
        SimdKernels {
            simd,
            length,
            samples: zeros(blocks * length),
            blocks: vec![Block::new(simd, wavelet_bands(config.rate_hz)); blocks],
            scratch: zeros(length),
            backward: zeros(length),
            spectral: (needs.frequencies || needs.fourier)
                .then(|| SpectralFeatures::new(simd, length, config.rate_hz)),
            wavelets: Wavelets::new(length),
            radii: vec![Radii::default(); config.channels],
            needs,
        }
    }

    /// Fills the blocks from the samples.
    #[inline(always)]
    fn measure(&mut self, parameters: &FeatureParameters) {
        let (simd, needs) = (self.simd, self.needs);
        for (block, x) in self.blocks.iter_mut().zip(self.samples.chunks_exact(self.length)) {
            if needs.magnitudes {
                block.magnitudes = outlined!(simd, magnitude_and_crossings(x));
            }
            if needs.slopes {
                block.slopes =
                    outlined!(simd, slope_sign_changes_and_waveform_length(x, parameters.ssc_threshold));
            }
            if needs.squares {
                block.squares = outlined!(simd, squares(x));
            }
            if needs.lengths {
                block.lengths = outlined!(simd, lengths(x));
            }
            if needs.descriptors {
                block.descriptors = outlined!(simd, Descriptors::of(x, &mut self.scratch));
            }
            if needs.central {
                (block.central, block.constant) = outlined!(simd, central_moments(x));
            }
            if needs.ar {
                block.ar = outlined!(simd, burg(x, &mut self.scratch, &mut self.backward));
            }
            if let Some(spectral) = &mut self.spectral {
                outlined!(simd, spectral.transform(x));
                if needs.frequencies {
                    block.frequencies = outlined!(simd, spectral.frequencies());
                }
                if needs.fourier {
                    block.fourier = outlined!(simd, spectral.bands());
                }
            }
            if needs.wavelets {
                outlined!(simd, self.wavelets.decompose(x, &mut block.wavelets));
            }
        }
    }

    #[inline(always)]
    fn features(&mut self, window: &WindowView<'_>, layout: &FeatureLayout, out: &mut [f64]) {
        for (to, from) in self.samples.chunks_exact_mut(self.length).zip(window.blocks()) {
            for (to, from) in to.iter_mut().zip(from) {
                *to = from.0.simd_into(self.simd);
            }
        }
        self.measure(window.parameters());
        let channels = window.channels();
        // LibEMG's COMP sums over the channels.
        let bends = self.blocks.iter().flat_map(|block| block.squares[2].to_array());
        let all = AllChannels { second_difference_energy: bends.take(channels).sum() };
        let overflows = |channel: usize| window.channel(channel).any(|v| v.abs() > MAX_SAMPLE);
        for (feature, shape, range) in layout.feature_ranges() {
            let out = &mut out[range];
            let (values, a_channel, a_value) = match shape {
                FeatureShape::Channels { values } => (values, values, 1),
                FeatureShape::Bands { bands } => (bands, 1, channels),
                FeatureShape::Pairs => {
                    let strengths = self.blocks.iter().flat_map(|block| block.radii(feature, self.length));
                    self.radii.clear();
                    self.radii.extend(strengths.take(channels));
                    phasors(&self.radii, out);
                    if !out.iter().all(|v| v.is_finite()) && !(0..channels).any(overflows) {
                        out.iter_mut().filter(|v| !v.is_finite()).for_each(|v| *v = 0.0);
                    }
                    continue;
                }
            };
            for ((k, block), x) in self.blocks.iter().enumerate().zip(self.samples.chunks_exact(self.length))
            {
                for which in 0..values {
                    let lanes = block.value(feature, which, x, &all, window.parameters(), &mut self.scratch);
                    let first = LANES * k;
                    for (channel, value) in (first..channels).zip(lanes.to_array()) {
                        // Zero where the definition has no value.
                        let defined = value.is_finite() || overflows(channel);
                        out[channel * a_channel + which * a_value] = if defined { value } else { 0.0 };
                    }
                }
            }
        }
    }
}

impl<S: Simd> Kernels for SimdKernels<S> {
    fn compute(&mut self, window: &WindowView<'_>, layout: &FeatureLayout, out: &mut [f64]) {
        outlined!(self.simd, self.features(window, layout, out));
    }

    fn boxed_clone(&self) -> Box<dyn Kernels> {
        Box::new(self.clone())
    }
}

impl<S: Simd> Block<S> {
    fn new(simd: S, bands: usize) -> Self {
        let zero = Lanes::splat(simd, 0.0);
        Block {
            magnitudes: [zero; 2],
            slopes: [zero; 2],
            squares: [zero; 3],
            lengths: [zero; 2],
            descriptors: Descriptors::new(simd),
            central: [zero; 3],
            constant: Mask::splat(simd, false),
            ar: [zero; AR_ORDER],
            frequencies: SpectralMoments::new(simd),
            fourier: [zero; FOURIER_BANDS],
            wavelets: vec![WaveletBand::new(simd); bands],
        }
    }

    /// Value number `which` of a feature of the channels whose samples are `x`. `scratch` is as long as they are.
    #[inline(always)]
    fn value(
        &self,
        feature: Feature,
        which: usize,
        x: &[Lanes<S>],
        all: &AllChannels,
        parameters: &FeatureParameters,
        scratch: &mut [Lanes<S>],
    ) -> Lanes<S> {
        let (simd, count) = (x[0].simd, x.len() as f64);
        let ([mav, crossings], [turns, length]) = (self.magnitudes, self.slopes);
        let [square, square_1, square_2] = self.squares;
        let [second, third, fourth] = self.central;
        match feature {
            Feature::Mav => mav,
            Feature::Zc => crossings,
            Feature::Ssc => turns,
            Feature::Wl => length,
            Feature::Ls => outlined!(simd, {
                scratch.copy_from_slice(x);
                l_score(scratch)
            }),
            Feature::Mfl => ln(self.lengths[0]) * std::f64::consts::LOG10_E,
            Feature::Msr => mean_square_root(x),
            Feature::Wamp => willison_amplitude(x, parameters.wamp_threshold),
            Feature::Rms => (square / count).sqrt(),
            Feature::Iav => mean_absolute(x) * count,
            Feature::Dasdv => (square_1 / (count - 1.0)).sqrt(),
            Feature::Var => second,
            Feature::M0 => self.descriptors.m0,
            Feature::M2 => self.descriptors.m2,
            Feature::M4 => self.descriptors.m4,
            Feature::Sparsi => self.descriptors.sparsi,
            Feature::Irf => self.descriptors.irf,
            Feature::Wlf => self.descriptors.wlf,
            Feature::Ar4 => self.ar[which],
            Feature::Cc => cepstrum(&self.ar)[which],
            Feature::Mdf => self.frequencies.median,
            Feature::Mnf => self.frequencies.mean,
            Feature::Mnp => self.frequencies.mean_power,
            Feature::Sm => self.frequencies.second_moment,
            Feature::Skew => select_or_zero(!self.constant, third / (second * second.sqrt())),
            Feature::Kurt => select_or_zero(!self.constant, fourth / (second * second)),
            Feature::Act => square / count,
            Feature::Mob => (square_1 / square).sqrt(),
            Feature::Comp => (Lanes::splat(simd, all.second_difference_energy) / square_1).sqrt(),
            Feature::Compc => (square_2 * square).sqrt() / square_1,
            Feature::Ld => exp(mean_logarithm(x)),
            Feature::Mavfd => self.lengths[0] / (count - 1.0),
            Feature::Mavslp => mav_slope(x),
            Feature::Mpk => largest(x),
            Feature::Tm => mean_cube(x),
            Feature::Mean => mean(x),
            Feature::Pap => square.sqrt() / (square_2.sqrt() / square_1.sqrt()),
            Feature::Mzp => (square_1 / count).sqrt(),
            Feature::Sampen => outlined!(simd, sample_entropy(x, scratch)),
            Feature::Fuzzyen => outlined!(simd, fuzzy_entropy(x)),
            Feature::Dftr => self.fourier[which],
            Feature::Isd => square,
            Feature::Cor => square_1 / count / (square_2 / count * square),
            Feature::Mdiff => square_1 / count,
            Feature::Mlk => ln(mean_absolute(x) * count + f64::EPSILON) / count,
            Feature::Weng => self.wavelets[which].energy,
            Feature::Wv => self.wavelets[which].variance,
            Feature::Wwl => self.wavelets[which].length,
            Feature::Went => self.wavelets[which].entropy,
            // Of pairs of channels, not of one.
            Feature::Rmsphasor | Feature::Wlphasor => Lanes::splat(simd, 0.0),
        }
    }

    /// Strengths of the channels for a feature of pairs.
    #[inline(always)]
    fn radii(&self, feature: Feature, length: usize) -> [Radii; LANES] {
        let count = length as f64;
        let [whole, difference] = match feature {
            Feature::Wlphasor => self.lengths,
            _ => [self.squares[0] / count, self.squares[1] / (count - 1.0)].map(Lanes::sqrt),
        };
        std::array::from_fn(|lane| [whole[lane], difference[lane]])
    }
}
