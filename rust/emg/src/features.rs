mod autoregression;
mod descriptors;
mod entropy;
mod phasors;
mod spectral;
mod sums;
mod wavelets;

use crate::feature::{AR_ORDER, Shape, wavelet_bands};
use crate::lanes::{LANES, Lanes, each, mean, mean_absolute};
use crate::{EmgConfig, EmgError, Feature, FeatureLayout, WindowView};
use autoregression::{burg, cepstrum};
use descriptors::Descriptors;
use entropy::{fuzzy_entropy, sample_entropy};
use phasors::{Radii, phasors};
use spectral::{FOURIER_BANDS, Frequencies, Spectral};
use sums::{
    central_moments, hudgins, l_score, largest, lengths, mean_cube, mean_logarithm, mean_square_root,
    slope_of_means, squares, steps_beyond,
};
use wavelets::{Band, Wavelets};

/// Features of one window in the order of its [`FeatureLayout`].
pub type FeatureVector = Vec<f64>;

/// Computes the features of windows of one length. Buffers are allocated at construction only.
///
/// Agrees with LibEMG 2.0.3 to 1e-9 (HTD to 1e-12, counts exactly) wherever LibEMG gives a finite number.
#[derive(Clone, Debug)]
pub struct FeatureExtractor {
    layout: FeatureLayout,
    length: usize,
    /// Of the newest window.
    vector: FeatureVector,
    /// Four channels each.
    blocks: Vec<Block>,
    /// For sorting, standardising, logarithms and Burg's forward errors.
    scratch: Vec<Lanes>,
    /// Burg's backward errors.
    backward: Vec<Lanes>,
    spectral: Spectral,
    wavelets: Wavelets,
    /// Strength of each channel.
    radii: Vec<Radii>,
    needs: Needs,
}

/// Which quantities the set is made of; nothing else is computed.
#[derive(Clone, Copy, Debug)]
struct Needs {
    hudgins: bool,
    squares: bool,
    lengths: bool,
    descriptors: bool,
    central: bool,
    ar: bool,
    frequencies: bool,
    fourier: bool,
    wavelets: bool,
}

/// Quantities of four channels that several features share.
#[derive(Clone, Debug, Default)]
struct Block {
    /// MAV, ZC, SSC, WL.
    hudgins: [Lanes; 4],
    /// Sums of the squares of the signal and its first and second differences.
    squares: [Lanes; 3],
    /// Sums of the magnitudes of the first and second differences.
    lengths: [Lanes; 2],
    descriptors: Descriptors,
    /// Second, third and fourth central moment.
    central: [Lanes; 3],
    /// Lanes whose spread is rounding only.
    constant: Lanes,
    ar: [Lanes; AR_ORDER],
    frequencies: Frequencies,
    fourier: [Lanes; FOURIER_BANDS],
    wavelets: Vec<Band>,
}

/// What COMP needs of the other channels.
struct AllChannels {
    /// Sum of the squares of the second differences.
    bends: f64,
}

/// Settings of the stream that features depend on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FeatureParameters {
    pub(crate) ssc_threshold: f64,
    pub(crate) wamp_threshold: f64,
}

/// Samples beyond this may overflow when raised to the fourth power and summed.
const LARGEST_SAMPLE: f64 = 1e70;

impl FeatureExtractor {
    /// For the features and windows of `config`.
    ///
    /// # Errors
    /// Settings that cannot work.
    pub fn new(config: &EmgConfig) -> Result<Self, EmgError> {
        use Feature::*;
        config.check()?;
        let (set, length) = (config.features, config.window_samples()?);
        let any = |features: &[Feature]| features.iter().any(|f| set.contains(*f));
        let needs = Needs {
            hudgins: any(&[Mav, Zc, Ssc, Wl]),
            descriptors: any(&[M0, M2, M4, Sparsi, Irf, Wlf]),
            squares: any(&[Rms, Dasdv, Act, Mob, Comp, Compc, Rmsphasor, Pap, Mzp, Isd, Cor, Mdiff]),
            lengths: any(&[Mfl, Mavfd, Wlphasor]),
            central: any(&[Var, Skew, Kurt]),
            ar: any(&[Ar4, Cc]),
            frequencies: any(&[Mdf, Mnf, Mnp, Sm]),
            fourier: any(&[Dftr]),
            wavelets: any(&[Weng, Wv, Wwl, Went]),
        };
        let block =
            Block { wavelets: vec![Band::default(); wavelet_bands(config.rate_hz)], ..Block::default() };
        let layout = config.layout();
        Ok(FeatureExtractor {
            layout,
            length,
            vector: vec![0.0; layout.count()],
            blocks: vec![block; config.channels.div_ceil(LANES)],
            scratch: vec![Lanes::ZERO; length],
            backward: vec![Lanes::ZERO; length],
            spectral: Spectral::new(length, config.rate_hz),
            wavelets: Wavelets::new(length),
            radii: vec![Radii::default(); config.channels],
            needs,
        })
    }

    /// The features of one window. Does not allocate. A value is not finite only if the samples are so large that
    /// sums overflow.
    ///
    /// # Panics
    /// If the window is of another length or number of channels than the settings said.
    pub fn compute(&mut self, window: &WindowView<'_>) -> &[f64] {
        let channels = window.channels();
        assert_eq!(
            (window.length(), channels),
            (self.length, self.radii.len()),
            "samples and channels of the window"
        );
        for (k, x) in window.blocks().enumerate() {
            self.measure(k, x, window.parameters());
        }
        // LibEMG's COMP sums over the channels.
        let bends = self.blocks.iter().flat_map(|block| block.squares[2].to_array());
        let all = AllChannels { bends: bends.take(channels).sum() };
        let overflows = |channel: usize| window.channel(channel).any(|v| v.abs() > LARGEST_SAMPLE);
        for (feature, shape, range) in self.layout.parts() {
            let out = &mut self.vector[range];
            let (values, a_channel, a_value) = match shape {
                Shape::Channels { values } => (values, values, 1),
                Shape::Bands { bands } => (bands, 1, channels),
                Shape::Pairs => {
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
            for ((k, block), x) in self.blocks.iter().enumerate().zip(window.blocks()) {
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
        let imu = self.layout.emg_count();
        for (out, mean) in self.vector[imu..].iter_mut().zip(window.imu_means()) {
            *out = mean;
        }
        &self.vector
    }

    /// Fills block `k` from its samples.
    fn measure(&mut self, k: usize, x: &[Lanes], parameters: &FeatureParameters) {
        let (needs, block) = (self.needs, &mut self.blocks[k]);
        if needs.hudgins {
            block.hudgins = hudgins(x, parameters.ssc_threshold);
        }
        if needs.squares {
            block.squares = squares(x);
        }
        if needs.lengths {
            block.lengths = lengths(x);
        }
        if needs.descriptors {
            block.descriptors = Descriptors::of(x, &mut self.scratch);
        }
        if needs.central {
            (block.central, block.constant) = central_moments(x);
        }
        if needs.ar {
            block.ar = burg(x, &mut self.scratch, &mut self.backward);
        }
        if needs.frequencies {
            block.frequencies = self.spectral.frequencies(x);
        }
        if needs.fourier {
            block.fourier = self.spectral.bands(x);
        }
        if needs.wavelets {
            self.wavelets.decompose(x, &mut block.wavelets);
        }
    }
}

impl Block {
    /// Value number `which` of a feature of the channels whose samples are `x`. `scratch` is as long as they are.
    fn value(
        &self,
        feature: Feature,
        which: usize,
        x: &[Lanes],
        all: &AllChannels,
        parameters: &FeatureParameters,
        scratch: &mut [Lanes],
    ) -> Lanes {
        let count = x.len() as f64;
        let [mav, crossings, turns, length] = self.hudgins;
        let [square, square_1, square_2] = self.squares;
        let [second, third, fourth] = self.central;
        match feature {
            Feature::Mav => mav,
            Feature::Zc => crossings,
            Feature::Ssc => turns,
            Feature::Wl => length,
            Feature::Ls => {
                scratch.copy_from_slice(x);
                l_score(scratch)
            }
            Feature::Mfl => each(self.lengths[0], f64::log10),
            Feature::Msr => mean_square_root(x),
            Feature::Wamp => steps_beyond(x, parameters.wamp_threshold),
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
            Feature::Skew => (third / each(second, |v| v.powf(1.5))) & !self.constant,
            Feature::Kurt => (fourth / (second * second)) & !self.constant,
            Feature::Act => square / count,
            Feature::Mob => (square_1 / square).sqrt(),
            Feature::Comp => (Lanes::splat(all.bends) / square_1).sqrt(),
            Feature::Compc => (square_2 * square).sqrt() / square_1,
            Feature::Ld => each(mean_logarithm(x), f64::exp),
            Feature::Mavfd => self.lengths[0] / (count - 1.0),
            Feature::Mavslp => slope_of_means(x),
            Feature::Mpk => largest(x),
            Feature::Tm => mean_cube(x),
            Feature::Mean => mean(x),
            Feature::Pap => square.sqrt() / (square_2.sqrt() / square_1.sqrt()),
            Feature::Mzp => (square_1 / count).sqrt(),
            Feature::Sampen => sample_entropy(x, scratch),
            Feature::Fuzzyen => fuzzy_entropy(x),
            Feature::Dftr => self.fourier[which],
            Feature::Isd => square,
            Feature::Cor => square_1 / count / (square_2 / count * square),
            Feature::Mdiff => square_1 / count,
            Feature::Mlk => each(mean_absolute(x) * count + f64::EPSILON, f64::ln) / count,
            Feature::Weng => self.wavelets[which].energy,
            Feature::Wv => self.wavelets[which].variance,
            Feature::Wwl => self.wavelets[which].length,
            Feature::Went => self.wavelets[which].entropy,
            // Of pairs of channels, not of one.
            Feature::Rmsphasor | Feature::Wlphasor => Lanes::ZERO,
        }
    }

    /// Strengths of the channels for a feature of pairs.
    fn radii(&self, feature: Feature, length: usize) -> [Radii; LANES] {
        let count = length as f64;
        let [whole, difference] = match feature {
            Feature::Wlphasor => self.lengths,
            _ => [self.squares[0] / count, self.squares[1] / (count - 1.0)].map(Lanes::sqrt),
        };
        let (whole, difference) = (whole.to_array(), difference.to_array());
        std::array::from_fn(|lane| [whole[lane], difference[lane]])
    }
}
