mod autoregression;
mod entropy;
mod phasors;
mod wavelets;

use crate::feature::{AR_ORDER, FOURIER_BANDS_FROM_HZ, Shape, fourier_bands};
use crate::spectrum::PowerSpectrum;
use crate::{EmgConfig, EmgError, Feature, FeatureLayout, WindowView};
use autoregression::{burg, cepstrum};
use entropy::{fuzzy_entropy, sample_entropy};
use phasors::{Radii, phasors};
use wavelets::Wavelets;

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
    /// For sorting, standardising, and Burg's forward errors.
    scratch: Vec<f64>,
    /// Burg's backward errors.
    backward: Vec<f64>,
    spectrum: Option<PowerSpectrum>,
    wavelets: Option<Wavelets>,
    /// Root mean square and waveform length of each channel.
    radii: [Vec<Radii>; 2],
    needs: Needs,
}

/// Which quantities the set is made of, so that HTD alone stays one pass.
#[derive(Clone, Copy, Debug)]
struct Needs {
    hudgins: bool,
    differences: bool,
    descriptors: bool,
    central: bool,
    ls: bool,
    ar: bool,
    comp: bool,
    wamp: bool,
    samplewise: bool,
    sampen: bool,
    fuzzyen: bool,
}

/// Quantities of one channel.
#[derive(Default)]
struct Channel {
    hudgins: [f64; 4],
    raw: Differences,
    log: Differences,
    /// Second, third and fourth central moment.
    central: [f64; 3],
    constant: bool,
    ls: f64,
    ar: [f64; AR_ORDER],
    spectral: Spectral,
    wamp: f64,
    samplewise: Samplewise,
    sampen: f64,
    fuzzyen: f64,
}

/// What the spectrum tells of a channel.
#[derive(Clone, Copy, Default)]
struct Spectral {
    mdf: f64,
    mnf: f64,
    mnp: f64,
    sm: f64,
    dftr: [f64; 6],
}

/// Means over samples and the largest one.
#[derive(Clone, Copy, Default)]
struct Samplewise {
    mean: f64,
    most: f64,
    cubes: f64,
    logarithm: f64,
    halves: [f64; 2],
}

/// Settings of the stream that features depend on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FeatureParameters {
    pub(crate) rate_hz: f64,
    pub(crate) ssc_threshold: f64,
    pub(crate) wamp_threshold: f64,
}

/// Sums over a signal and its first and second difference.
#[derive(Clone, Copy, Default)]
struct Differences {
    length: f64,
    square: f64,
    square_1: f64,
    square_2: f64,
    absolute_1: f64,
    absolute_2: f64,
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
            hudgins: any(&[Mav, Zc, Ssc, Wl, Mfl, Iav, Mlk, Wlphasor]),
            descriptors: any(&[M0, M2, M4, Sparsi, Irf, Wlf]),
            differences: any(&[
                M0, M2, M4, Sparsi, Irf, Wlf, Rms, Dasdv, Act, Mob, Comp, Compc, Mavfd, Rmsphasor, Wlphasor,
                Pap, Mzp, Isd, Cor, Mdiff,
            ]),
            central: any(&[Var, Skew, Kurt]),
            ls: set.contains(Ls),
            ar: any(&[Ar4, Cc]),
            comp: set.contains(Comp),
            wamp: set.contains(Wamp),
            samplewise: any(&[Mean, Mpk, Tm, Ld, Mavslp]),
            sampen: set.contains(Sampen),
            fuzzyen: set.contains(Fuzzyen),
        };
        let scratch = needs.ls || needs.ar || needs.sampen;
        let layout = config.layout();
        Ok(FeatureExtractor {
            layout,
            length,
            vector: vec![0.0; layout.count()],
            scratch: if scratch { vec![0.0; length] } else { Vec::new() },
            backward: if needs.ar { vec![0.0; length] } else { Vec::new() },
            spectrum: any(&[Mdf, Mnf, Mnp, Sm, Dftr]).then(|| PowerSpectrum::new(length)),
            wavelets: any(&[Weng, Wv, Wwl, Went]).then(|| Wavelets::new(length, config.rate_hz)),
            radii: [Vec::with_capacity(config.channels), Vec::with_capacity(config.channels)],
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
        self.radii.iter_mut().for_each(Vec::clear);
        // LibEMG's COMP sums over the channels.
        let all_square_2 = if self.needs.comp {
            (0..channels).map(|c| Differences::of(window.channel(c).iter().copied()).square_2).sum()
        } else {
            0.0
        };
        let mut any_overflow = false;
        for channel in 0..channels {
            let x = window.channel(channel);
            assert_eq!(x.len(), self.length, "length of the window");
            let overflow = x.iter().any(|v| v.abs() > LARGEST_SAMPLE);
            any_overflow |= overflow;
            let values = self.measure(x, window.parameters());
            let count = x.len() as f64;
            let roots = [values.raw.square, values.raw.square_1 * count / (count - 1.0)];
            self.radii[0].push(roots.map(|sum| (sum / count).sqrt()));
            self.radii[1].push([values.hudgins[3], values.raw.absolute_2]);
            let bands = self.wavelets.as_ref().map_or(&[][..], Wavelets::bands);
            for (feature, shape, range) in self.layout.parts() {
                let out = &mut self.vector[range];
                let mut put = |place: usize, value: f64| {
                    // Zero where the definition has no value.
                    out[place] = if value.is_finite() || overflow { value } else { 0.0 };
                };
                match shape {
                    Shape::Channels { values: 1 } => put(channel, value(feature, x, &values, all_square_2)),
                    Shape::Channels { values: width } => {
                        let coefficients =
                            if feature == Feature::Cc { cepstrum(&values.ar) } else { values.ar };
                        (0..width).for_each(|k| put(channel * width + k, coefficients[k]));
                    }
                    Shape::Bands { bands: width } => (0..width).for_each(|k| {
                        let value = match feature {
                            Feature::Dftr => values.spectral.dftr[k],
                            Feature::Weng => bands[k].energy,
                            Feature::Wv => bands[k].variance,
                            Feature::Wwl => bands[k].length,
                            _ => bands[k].entropy,
                        };
                        put(k * channels + channel, value);
                    }),
                    Shape::Pairs => {}
                }
            }
        }
        for (feature, shape, range) in self.layout.parts() {
            if shape == Shape::Pairs {
                let out = &mut self.vector[range];
                phasors(&self.radii[usize::from(feature == Feature::Wlphasor)], out);
                out.iter_mut().filter(|v| !v.is_finite() && !any_overflow).for_each(|v| *v = 0.0);
            }
        }
        let imu = self.layout.emg_count();
        for (out, mean) in self.vector[imu..].iter_mut().zip(window.imu_means()) {
            *out = mean;
        }
        &self.vector
    }

    fn measure(&mut self, x: &[f64], parameters: &FeatureParameters) -> Channel {
        let needs = self.needs;
        let mut values = Channel::default();
        if needs.hudgins {
            values.hudgins = hudgins(x, parameters.ssc_threshold);
        }
        if needs.differences {
            values.raw = Differences::of(x.iter().copied());
        }
        if needs.descriptors {
            values.log = Differences::of(x.iter().map(|v| (v * v + f64::EPSILON).ln()));
        }
        if needs.central {
            let count = x.len() as f64;
            let mean = x.iter().sum::<f64>() / count;
            let moment = |power: i32| x.iter().map(|v| (v - mean).powi(power)).sum::<f64>() / count;
            values.central = [moment(2), moment(3), moment(4)];
            // The limit of SciPy, below which the spread is rounding only.
            values.constant = values.central[0] <= (f64::EPSILON * mean).powi(2);
        }
        if needs.ls {
            self.scratch.copy_from_slice(x);
            values.ls = l_score(&mut self.scratch);
        }
        if needs.ar {
            values.ar = burg(x, &mut self.scratch, &mut self.backward);
        }
        if let Some(spectrum) = &mut self.spectrum {
            values.spectral = Spectral::of(spectrum, x, parameters.rate_hz);
        }
        if let Some(wavelets) = &mut self.wavelets {
            wavelets.decompose(x);
        }
        if needs.samplewise {
            values.samplewise = Samplewise::of(x);
        }
        if needs.sampen {
            values.sampen = sample_entropy(x, &mut self.scratch);
        }
        if needs.fuzzyen {
            values.fuzzyen = fuzzy_entropy(x);
        }
        if needs.wamp {
            let beyond = |pair: &&[f64]| (pair[1] - pair[0]).abs() > parameters.wamp_threshold;
            values.wamp = x.windows(2).filter(beyond).count() as f64;
        }
        values
    }
}

impl Spectral {
    fn of(spectrum: &mut PowerSpectrum, x: &[f64], rate_hz: f64) -> Spectral {
        let bin_hz = rate_hz / spectrum.size() as f64;
        let bins = (spectrum.size() / 2) as f64;
        let scale = (x.len() as f64).powi(2);
        let powers = spectrum.powers(x);
        let total: f64 = powers.clone().sum();
        let (mut below, mut weighted, mut squared, mut median) = (0.0, 0.0, 0.0, None);
        for (k, power) in powers.clone().enumerate() {
            below += power;
            weighted += k as f64 * power;
            squared += (k as f64 * bin_hz).powi(2) * power;
            if median.is_none() && below > total / 2.0 {
                median = Some(k as f64 * bin_hz);
            }
        }
        let mut dftr = [0.0; 6];
        let mut from = FOURIER_BANDS_FROM_HZ;
        for (value, to) in dftr.iter_mut().zip(fourier_bands(rate_hz)) {
            let inside = powers.clone().enumerate().filter(|(k, _)| {
                let hz = *k as f64 * bin_hz;
                hz > from && hz < to
            });
            let (sum, count) = inside.fold((0.0, 0.0), |(sum, n), (_, power)| (sum + power.sqrt(), n + 1.0));
            *value = (sum / (x.len() as f64) / count).powf(2.0 / 3.0);
            from = to;
        }
        Spectral {
            // No power, no median.
            mdf: median.unwrap_or(f64::NAN),
            mnf: weighted / total * bin_hz,
            mnp: total / scale / bins,
            sm: squared / scale,
            dftr,
        }
    }
}

impl Samplewise {
    fn of(x: &[f64]) -> Samplewise {
        let count = x.len() as f64;
        let mean = |of: fn(&f64) -> f64| x.iter().map(of).sum::<f64>() / count;
        // The middle of an odd length is rounded to the even number, as Python rounds.
        let half = (count / 2.0).round_ties_even() as usize;
        let part = |x: &[f64]| x.iter().map(|v| v.abs()).sum::<f64>() / x.len() as f64;
        Samplewise {
            mean: mean(|v| *v),
            most: x.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            cubes: mean(|v| v.powi(3).abs()),
            logarithm: x.chunks(LOGARITHMS).map(logarithms).sum::<f64>() / count,
            halves: [part(&x[..half]), part(&x[half..x.len().min(2 * half)])],
        }
    }
}

/// Samples whose logarithms are taken together.
const LOGARITHMS: usize = 8;

/// Sum of the logarithms of the samples' magnitudes and one: that of their product, unless it is too large a number.
fn logarithms(x: &[f64]) -> f64 {
    let product: f64 = x.iter().map(|v| v.abs() + 1.0).product();
    if product.is_finite() { product.ln() } else { x.iter().map(|v| (v.abs() + 1.0).ln()).sum() }
}

/// The value of a feature that has one a channel.
fn value(feature: Feature, x: &[f64], v: &Channel, all_square_2: f64) -> f64 {
    let count = x.len() as f64;
    let descriptor = |of: fn(&Differences) -> f64| {
        let (a, b) = (of(&v.raw), of(&v.log));
        -2.0 * a * b / (a * a + b * b)
    };
    let [second, third, fourth] = v.central;
    match feature {
        Feature::Mav => v.hudgins[0],
        Feature::Zc => v.hudgins[1],
        Feature::Ssc => v.hudgins[2],
        Feature::Wl => v.hudgins[3],
        Feature::Ls => v.ls,
        Feature::Mfl => v.hudgins[3].log10(),
        Feature::Msr => {
            let (mut real, mut imaginary) = (0.0, 0.0);
            for value in x {
                *(if *value < 0.0 { &mut imaginary } else { &mut real }) += value.abs().sqrt();
            }
            f64::hypot(real, imaginary) / count
        }
        Feature::Wamp => v.wamp,
        Feature::Rms => (v.raw.square / count).sqrt(),
        Feature::Iav => v.hudgins[0] * count,
        Feature::Dasdv => (v.raw.square_1 / (count - 1.0)).sqrt(),
        Feature::Var => second,
        Feature::M0 => descriptor(|d| d.m0().abs().ln()),
        Feature::M2 => descriptor(|d| (d.m0() - d.m2()).abs().ln()),
        Feature::M4 => descriptor(|d| (d.m0() - d.m4()).abs().ln()),
        Feature::Sparsi => descriptor(|d| {
            let (m0, m2, m4) = (d.m0(), d.m2(), d.m4());
            (((m0 - m2) * (m0 - m4)).abs().sqrt() / m0).ln()
        }),
        Feature::Irf => descriptor(|d| (d.m2() / (d.m0() * d.m4()).sqrt()).ln()),
        Feature::Wlf => descriptor(|d| (d.absolute_1 / d.absolute_2).sqrt().ln()),
        Feature::Mdf => v.spectral.mdf,
        Feature::Mnf => v.spectral.mnf,
        Feature::Mnp => v.spectral.mnp,
        Feature::Sm => v.spectral.sm,
        Feature::Skew | Feature::Kurt if v.constant => 0.0,
        Feature::Skew => third / second.powf(1.5),
        Feature::Kurt => fourth / second.powi(2),
        Feature::Act => v.raw.square / count,
        Feature::Mob => (v.raw.square_1 / v.raw.square).sqrt(),
        Feature::Comp => (all_square_2 / v.raw.square_1).sqrt(),
        Feature::Ld => v.samplewise.logarithm.exp(),
        Feature::Mavfd => v.raw.absolute_1 / (count - 1.0),
        Feature::Mavslp => v.samplewise.halves[1] - v.samplewise.halves[0],
        Feature::Mpk => v.samplewise.most,
        Feature::Tm => v.samplewise.cubes,
        Feature::Mean => v.samplewise.mean,
        Feature::Pap => v.raw.square.sqrt() / (v.raw.square_2.sqrt() / v.raw.square_1.sqrt()),
        Feature::Mzp => (v.raw.square_1 / count).sqrt(),
        Feature::Sampen => v.sampen,
        Feature::Fuzzyen => v.fuzzyen,
        Feature::Isd => v.raw.square,
        Feature::Cor => v.raw.square_1 / count / (v.raw.square_2 / count * v.raw.square),
        Feature::Mdiff => v.raw.square_1 / count,
        Feature::Mlk => (v.hudgins[0] * count + f64::EPSILON).ln() / count,
        // These have several values a channel or none of a channel alone.
        Feature::Ar4
        | Feature::Cc
        | Feature::Dftr
        | Feature::Weng
        | Feature::Wv
        | Feature::Wwl
        | Feature::Went
        | Feature::Rmsphasor
        | Feature::Wlphasor => 0.0,
        Feature::Compc => (v.raw.square_2 * v.raw.square).sqrt() / v.raw.square_1,
    }
}

/// MAV, ZC, SSC and WL in one pass each. A function of its own, so that its sums stay in registers; so is the next.
#[inline(never)]
fn hudgins(x: &[f64], ssc_threshold: f64) -> [f64; 4] {
    let mean_absolute_value = x.iter().map(|v| v.abs()).sum::<f64>() / x.len() as f64;
    let (mut crossings, mut turns, mut length) = (0_u32, 0_u32, 0.0);
    for pair in x.windows(2) {
        crossings += u32::from((pair[0] > 0.0 && pair[1] < 0.0) || (pair[0] < 0.0 && pair[1] > 0.0));
        length += (pair[1] - pair[0]).abs();
    }
    for triple in x.windows(3) {
        turns += u32::from((triple[1] - triple[0]) * (triple[1] - triple[2]) >= ssc_threshold);
    }
    [mean_absolute_value, f64::from(crossings), f64::from(turns), length]
}

impl Differences {
    #[inline(never)]
    fn of(signal: impl Iterator<Item = f64>) -> Differences {
        let mut sums = Differences::default();
        let (mut last, mut last_1) = (None, None);
        for value in signal {
            sums.length += 1.0;
            sums.square += value * value;
            let first = last.map(|last| value - last);
            if let Some(first) = first {
                sums.square_1 += first * first;
                sums.absolute_1 += f64::abs(first);
                if let Some(second) = last_1.map(|last_1: f64| first - last_1) {
                    sums.square_2 += second * second;
                    sums.absolute_2 += f64::abs(second);
                }
            }
            (last, last_1) = (Some(value), first);
        }
        sums
    }

    // The power of a tenth, divided by a tenth, is the normalisation of TDPSD.
    fn m0(&self) -> f64 {
        (self.square.sqrt() / (self.length - 1.0)).powf(0.1) / 0.1
    }

    fn m2(&self) -> f64 {
        (self.square_1 / (self.length - 1.0)).sqrt().powf(0.1) / 0.1
    }

    fn m4(&self) -> f64 {
        (self.square_2 / (self.length - 1.0)).sqrt().powf(0.1) / 0.1
    }
}

/// Second L-moment: 2 b1 - b0 with Hosking's unbiased weights (1990). Sorts `x`.
fn l_score(x: &mut [f64]) -> f64 {
    x.sort_unstable_by(f64::total_cmp);
    let last = x.len() as f64 - 1.0;
    let sum: f64 = x.iter().enumerate().map(|(k, v)| (2.0 * k as f64 / last - 1.0) * v).sum();
    sum / x.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_zero_between_two_signs_hides_the_crossing() {
        assert_eq!(hudgins(&[1.0, 0.0, -1.0], 0.0)[1], 0.0);
        assert_eq!(hudgins(&[1.0, -1.0, 1.0], 0.0)[1], 2.0);
    }

    #[test]
    fn a_dead_channel_shows_the_largest_number_of_slope_sign_changes() {
        assert_eq!(hudgins(&[5.0; 10], 0.0), [5.0, 0.0, 8.0, 0.0]);
        assert_eq!(hudgins(&[5.0; 10], 1e-9)[2], 0.0);
    }

    #[test]
    fn logarithms_taken_together_are_those_taken_one_by_one() {
        let one_by_one = |x: &[f64]| x.iter().map(|v| (v.abs() + 1.0).ln()).sum::<f64>();
        for x in [[0.0, -1.0, 20.0, 0.3], [1e90, -1e90, 1e90, 3.0], [f64::MAX, 1.0, f64::MAX, 1.0]] {
            let (together, apart) = (logarithms(&x), one_by_one(&x));
            assert!((together - apart).abs() <= 1e-14 * apart, "{x:?}: {together}, {apart}");
        }
        assert!(logarithms(&[f64::NAN]).is_nan());
    }

    #[test]
    fn the_l_score_is_half_the_mean_distance_of_two_samples() {
        assert!((l_score(&mut [4.0, 1.0, 2.0]) - 0.5 * (3.0 + 2.0 + 1.0) / 3.0).abs() < 1e-15);
    }
}
