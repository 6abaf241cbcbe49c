use crate::feature_set::{AR_ORDER, INLINE_FEATURES};
use crate::spectrum::PowerSpectrum;
use crate::{EmgConfig, EmgError, Feature, FeatureSet, WindowView};
use smallvec::SmallVec;

/// Features of one window in the order of its [`FeatureSet`].
pub type FeatureVector = SmallVec<[f64; INLINE_FEATURES]>;

/// Computes the features of windows of one length. Buffers are allocated at construction only.
///
/// Agrees with LibEMG 2.0.3 to 1e-9 (HTD to 1e-12, counts exactly) wherever LibEMG gives a finite number.
#[derive(Clone, Debug)]
pub struct FeatureExtractor {
    set: FeatureSet,
    length: usize,
    /// For sorting, and Burg's forward errors.
    scratch: Vec<f64>,
    /// Burg's backward errors.
    backward: Vec<f64>,
    spectrum: Option<PowerSpectrum>,
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
    spectrum: bool,
    comp: bool,
    wamp: bool,
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
    mdf: f64,
    mnf: f64,
    wamp: f64,
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
        config.check()?;
        Ok(Self::sized(config.features, config.window_samples()?))
    }

    fn sized(set: FeatureSet, length: usize) -> Self {
        use Feature::*;
        let any = |features: &[Feature]| features.iter().any(|f| set.contains(*f));
        let needs = Needs {
            hudgins: any(&[Mav, Zc, Ssc, Wl, Mfl, Iav]),
            descriptors: any(&[M0, M2, M4, Sparsi, Irf, Wlf]),
            differences: any(&[M0, M2, M4, Sparsi, Irf, Wlf, Rms, Dasdv, Act, Mob, Comp, Compc]),
            central: any(&[Var, Skew, Kurt]),
            ls: set.contains(Ls),
            ar: set.contains(Ar4),
            spectrum: any(&[Mdf, Mnf]),
            comp: set.contains(Comp),
            wamp: set.contains(Wamp),
        };
        FeatureExtractor {
            set,
            length,
            scratch: if needs.ls || needs.ar { vec![0.0; length] } else { Vec::new() },
            backward: if needs.ar { vec![0.0; length] } else { Vec::new() },
            spectrum: needs.spectrum.then(|| PowerSpectrum::new(length)),
            needs,
        }
    }

    /// The features of one window. Does not allocate. A value is not finite only if the samples are so large that
    /// sums overflow.
    ///
    /// # Panics
    /// If the window is of another length than the settings said.
    pub fn compute(&mut self, window: &WindowView<'_>) -> FeatureVector {
        let channels = window.channels();
        let mut vector: FeatureVector = std::iter::repeat_n(0.0, self.set.count(channels)).collect();
        let set = self.set;
        // LibEMG's COMP sums over the channels.
        let all_square_2 = if self.needs.comp {
            (0..channels).map(|c| Differences::of(window.channel(c).iter().copied()).square_2).sum()
        } else {
            0.0
        };
        for channel in 0..channels {
            let x = window.channel(channel);
            assert_eq!(x.len(), self.length, "length of the window");
            let overflow = x.iter().any(|v| v.abs() > LARGEST_SAMPLE);
            let values = self.measure(x, window.parameters());
            let mut start = 0;
            for feature in set.features() {
                let width = feature.per_channel();
                for part in 0..width {
                    let value = value(*feature, part, x, &values, all_square_2);
                    // Zero where the definition has no value.
                    let defined = value.is_finite() || overflow;
                    vector[start + channel * width + part] = if defined { value } else { 0.0 };
                }
                start += channels * width;
            }
        }
        vector
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
            let bin_hz = parameters.rate_hz / spectrum.size() as f64;
            let powers = spectrum.powers(x);
            let total: f64 = powers.clone().sum();
            let (mut below, mut weighted, mut median) = (0.0, 0.0, None);
            for (k, power) in powers.enumerate() {
                below += power;
                weighted += k as f64 * power;
                if median.is_none() && below > total / 2.0 {
                    median = Some(k as f64 * bin_hz);
                }
            }
            // No power, no median.
            values.mdf = median.unwrap_or(f64::NAN);
            values.mnf = weighted / total * bin_hz;
        }
        if needs.wamp {
            let beyond = |pair: &&[f64]| (pair[1] - pair[0]).abs() > parameters.wamp_threshold;
            values.wamp = x.windows(2).filter(beyond).count() as f64;
        }
        values
    }
}

/// One value of a feature of a channel.
fn value(feature: Feature, part: usize, x: &[f64], v: &Channel, all_square_2: f64) -> f64 {
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
        Feature::Ar4 => v.ar[part],
        Feature::Mdf => v.mdf,
        Feature::Mnf => v.mnf,
        Feature::Skew | Feature::Kurt if v.constant => 0.0,
        Feature::Skew => third / second.powf(1.5),
        Feature::Kurt => fourth / second.powi(2),
        Feature::Act => v.raw.square / count,
        Feature::Mob => (v.raw.square_1 / v.raw.square).sqrt(),
        Feature::Comp => (all_square_2 / v.raw.square_1).sqrt(),
        Feature::Compc => (v.raw.square_2 * v.raw.square).sqrt() / v.raw.square_1,
    }
}

impl FeatureSet {
    /// The features of one window. Allocates if the set needs buffers; a stream keeps a [`FeatureExtractor`].
    pub fn compute(&self, window: &WindowView<'_>) -> FeatureVector {
        FeatureExtractor::sized(*self, window.length()).compute(window)
    }
}

/// MAV, ZC, SSC and WL in one pass each.
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

/// Autoregressive coefficients by Burg's method, without the leading one.
///
/// The running denominator is Andersen's recursion (1978), as librosa has it. A zero channel gives zeros.
fn burg(x: &[f64], forward: &mut [f64], backward: &mut [f64]) -> [f64; AR_ORDER] {
    let mut count = x.len() - 1;
    forward[..count].copy_from_slice(&x[1..]);
    backward[..count].copy_from_slice(&x[..count]);
    let square = |v: f64| v * v;
    let both = forward[..count].iter().zip(&backward[..count]);
    let mut denominator: f64 = both.map(|(f, b)| square(*f) + square(*b)).sum();
    let mut coefficients = [0.0; AR_ORDER];
    // The errors shrink by one sample at each order: the forward ones at their start, the backward ones at their
    // end. `skip` is that start.
    for order in 0..AR_ORDER.min(count) {
        let skip = order;
        let pairs = || forward[skip..skip + count].iter().zip(&backward[..count]);
        let reflection = -2.0 * pairs().map(|(f, b)| f * b).sum::<f64>() / (denominator + f64::MIN_POSITIVE);
        let before = coefficients;
        for j in 0..order {
            coefficients[j] = before[j] + reflection * before[order - 1 - j];
        }
        coefficients[order] = reflection;
        for (f, b) in forward[skip..skip + count].iter_mut().zip(&mut backward[..count]) {
            (*f, *b) = (*f + reflection * *b, *b + reflection * *f);
        }
        denominator =
            (1.0 - square(reflection)) * denominator - square(backward[count - 1]) - square(forward[skip]);
        count -= 1;
    }
    coefficients
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
    fn the_l_score_is_half_the_mean_distance_of_two_samples() {
        assert!((l_score(&mut [4.0, 1.0, 2.0]) - 0.5 * (3.0 + 2.0 + 1.0) / 3.0).abs() < 1e-15);
    }
}
