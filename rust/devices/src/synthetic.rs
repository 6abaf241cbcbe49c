use crate::{DeviceError, Recordings};
use nalgebra::DMatrix;
use proact_types::{ChannelValues, Command, Gesture};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

/// What was fitted to the recordings of one gesture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FittedGesture {
    /// Which gesture.
    pub gesture: Command,
    /// Covariance of the channels, `[channels][channels]`, counts squared.
    pub covariance: Vec<Vec<f64>>,
    /// Standard deviation of the logarithm of the amplitude from one half second to the next, beyond what noise
    /// of constant amplitude would show.
    pub amplitude_log_sd: f64,
}

/// The figures from which synthetic EMG is made, fitted to real recordings by the example `fit_synthetic`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SyntheticModel {
    /// Which recordings, made by whom, under which licence.
    pub origin: String,
    /// Unit of the values.
    pub unit: String,
    /// Every gesture in [`Command::ALL`] order.
    pub gestures: Vec<FittedGesture>,
}

/// Corner frequencies of the shaping filter whose power spectrum is
/// `f^2 / ((f^2 + f_l^2) (f^2 + f_h^2)^2)`: Shwedyk, Balasubramanian and Scott 1977, with the corners that
/// Stulen and De Luca 1981 use. Assumed: not fitted, since recordings at 200 Hz do not show the spectrum.
const LOW_CORNER_HZ: f64 = 60.0;
const HIGH_CORNER_HZ: f64 = 120.0;
/// The filter runs at least at this rate; slower streams take every n-th of its samples, unfiltered, so that
/// they alias as a 200 Hz armband does.
const SHAPING_RATE_HZ: f64 = 1000.0;
/// Time in which the amplitudes go from those of one gesture to those of the next. Assumed.
const ONSET_SECS: f64 = 0.1;
/// Time over which the amplitude fluctuates, and length of the blocks over which that is fitted. Assumed.
const FLUCTUATION_SECS: f64 = 0.5;

impl SyntheticModel {
    /// The figures shipped with this crate.
    ///
    /// # Errors
    /// Never for the file as shipped; a test proves it.
    pub fn shipped() -> Result<SyntheticModel, DeviceError> {
        serde_json::from_str(include_str!("../data/synthetic_emg.json")).map_err(|error| {
            DeviceError::SyntheticModel { gesture: Command::NoMotion, reason: error.to_string() }
        })
    }

    /// Fits the figures to repetitions `reps` of those of the five gestures that are in `recordings`. The covariance is that of all
    /// samples about their mean, to two decimals; the fluctuation to three.
    ///
    /// # Errors
    /// A repetition that does not exist, or less than two seconds of a gesture.
    pub fn fit(recordings: &Recordings, reps: &[u32], origin: &str) -> Result<SyntheticModel, DeviceError> {
        let mut gestures = Vec::new();
        for gesture in recordings.gestures().into_iter().filter_map(Gesture::same_named_command) {
            let mut samples: Vec<ChannelValues> = Vec::new();
            for &rep in reps {
                samples.extend(recordings.find(gesture, rep)?.samples.iter().cloned());
            }
            let block = (FLUCTUATION_SECS * recordings.rate_hz).round() as usize;
            if samples.len() < 4 * block {
                let reason = format!("{} samples to fit, expected at least {}", samples.len(), 4 * block);
                return Err(DeviceError::SyntheticModel { gesture, reason });
            }
            gestures.push(fit_gesture(gesture, &samples, block));
        }
        let unit = "counts of a Myo armband, signed 8 bit".to_owned();
        Ok(SyntheticModel { origin: origin.to_owned(), unit, gestures })
    }

    /// Number of channels.
    pub fn channels(&self) -> usize {
        self.gestures.first().map_or(0, |g| g.covariance.len())
    }

    /// Root mean square over all channels of `gesture`; zero for a gesture that was not fitted.
    pub fn rms(&self, gesture: Command) -> f64 {
        let trace = |g: &FittedGesture| (0..g.covariance.len()).map(|k| g.covariance[k][k]).sum::<f64>();
        self.gestures
            .iter()
            .find(|g| g.gesture == gesture)
            .map_or(0.0, |g| (trace(g) / g.covariance.len().max(1) as f64).sqrt())
    }
}

/// Fits one gesture; the amplitude is that of blocks of `block` samples.
fn fit_gesture(gesture: Command, samples: &[ChannelValues], block: usize) -> FittedGesture {
    let (count, channels) = (samples.len() as f64, samples[0].len());
    let mean = |c: usize| samples.iter().map(|s| s[c]).sum::<f64>() / count;
    let means: Vec<f64> = (0..channels).map(mean).collect();
    let covariance = DMatrix::from_fn(channels, channels, |i, j| {
        samples.iter().map(|s| (s[i] - means[i]) * (s[j] - means[j])).sum::<f64>() / count
    });

    let log_rms = |samples: &[ChannelValues]| {
        let square: f64 = samples.iter().flatten().map(|v| v * v).sum();
        0.5 * (square / (samples.len() * channels) as f64).ln()
    };
    let logs: Vec<f64> = samples.chunks_exact(block).map(log_rms).collect();
    let center = logs.iter().sum::<f64>() / logs.len() as f64;
    let variance = logs.iter().map(|v| (v - center).powi(2)).sum::<f64>() / (logs.len() - 1) as f64;
    // The mean square of n independent Gaussian vectors of covariance C has the relative variance
    // 2 tr(C C) / tr(C)^2 / n, and half its logarithm a quarter of that: what constant amplitude would show.
    let by_noise = 0.5 * covariance.norm_squared() / covariance.trace().powi(2) / block as f64;

    let rounded = |value: f64, steps: f64| (value * steps).round() / steps;
    FittedGesture {
        gesture,
        covariance: covariance
            .row_iter()
            .map(|row| row.iter().map(|v| rounded(*v, 100.0)).collect())
            .collect(),
        amplitude_log_sd: rounded((variance - by_noise).max(0.0).sqrt(), 1000.0),
    }
}

/// A stream of synthetic EMG: Gaussian noise with a muscle's spectrum, mixed so that the channels have the fitted
/// covariance of the gesture, with a slowly fluctuating amplitude.
///
/// There are figures for the five gestures of the paper only: what other gestures look like is not made up.
///
/// Known weaknesses: one person and one position of the band; no fatigue, no motion artefacts, no mains hum; the
/// transition from gesture to gesture is a ramp of the mixing matrix, not a movement.
#[derive(Clone, Debug)]
pub struct SyntheticEmg {
    rng: ChaCha8Rng,
    channels: usize,
    oversampling: u32,
    shaping: Vec<ShapingFilter>,
    /// Makes the shaped noise unit variance.
    gain: f64,
    /// Lower triangular factors of the covariances, in [`Command::ALL`] order, scaled to the stream's unit.
    factors: Vec<DMatrix<f64>>,
    log_sds: Vec<f64>,
    /// Fluctuation: a first-order process of unit variance.
    fluctuation: f64,
    persistence: f64,
    current_gesture: Option<Command>,
    /// The mixing matrix now and its step per sample during an onset.
    mixing_matrix: DMatrix<f64>,
    onset_samples_left: u32,
    onset_samples: u32,
}

impl SyntheticEmg {
    /// A generator of `channels` channels, at most those of the model (the first ones), at `rate_hz`, with all
    /// amplitudes multiplied by `scale`. Every draw comes from `rng`.
    ///
    /// # Errors
    /// Too many channels, a rate or scale that is not above zero, or figures that are no covariance.
    pub fn new(
        model: &SyntheticModel,
        rate_hz: f64,
        channels: usize,
        scale: f64,
        mut rng: ChaCha8Rng,
    ) -> Result<SyntheticEmg, DeviceError> {
        for (name, value) in [("EMG rate", rate_hz), ("amplitude scale", scale)] {
            if !(1e-6..=1e6).contains(&value) {
                return Err(DeviceError::Parameter { name, value, expected: "0.000001 to 1000000" });
            }
        }
        let max_channels = model.channels();
        if !(1..=max_channels).contains(&channels) {
            return Err(DeviceError::SyntheticChannels { channels, most: max_channels });
        }
        let mut factors = Vec::new();
        let mut log_sds = Vec::new();
        for gesture in Command::ALL {
            let unusable = |reason: &str| DeviceError::SyntheticModel { gesture, reason: reason.to_owned() };
            let fitted =
                model.gestures.iter().find(|g| g.gesture == gesture).ok_or_else(|| unusable("not fitted"))?;
            if fitted.covariance.len() != max_channels
                || fitted.covariance.iter().any(|row| row.len() != max_channels)
            {
                return Err(unusable("the covariance is not square, or of another size than the others"));
            }
            if !(fitted.amplitude_log_sd.is_finite() && fitted.amplitude_log_sd >= 0.0) {
                return Err(unusable("amplitude_log_sd is not a number of zero or more"));
            }
            let covariance =
                DMatrix::from_fn(channels, channels, |i, j| fitted.covariance[i][j] * scale * scale);
            let factor = covariance.cholesky().ok_or_else(|| unusable("the covariance is not positive"))?;
            factors.push(factor.unpack());
            log_sds.push(fitted.amplitude_log_sd);
        }
        let oversampling = (SHAPING_RATE_HZ / rate_hz).ceil().max(1.0);
        let shaping = ShapingFilter::new(rate_hz * oversampling);
        let fluctuation = StandardNormal.sample(&mut rng);
        let mut emg = SyntheticEmg {
            rng,
            channels,
            oversampling: oversampling as u32,
            gain: shaping.gain(),
            shaping: vec![shaping; channels],
            mixing_matrix: DMatrix::zeros(channels, channels),
            factors,
            log_sds,
            fluctuation,
            persistence: (-1.0 / (FLUCTUATION_SECS * rate_hz)).exp(),
            current_gesture: None,
            onset_samples_left: 0,
            onset_samples: (ONSET_SECS * rate_hz).round().max(1.0) as u32,
        };
        // The filters start empty: run them in.
        for _ in 0..emg.onset_samples {
            emg.noise();
        }
        Ok(emg)
    }

    /// The same of a person who makes a co-contraction where `switch` is meant: the muscles of both gestures of `pair` at once, each as
    /// strong as alone. They are independent sources, so their covariances add up.
    ///
    /// # Errors
    /// Figures whose sum is no covariance.
    pub fn with_cocontraction(
        mut self,
        switch: Command,
        pair: [Command; 2],
    ) -> Result<SyntheticEmg, DeviceError> {
        let [a, b] = pair.map(|gesture| &self.factors[gesture.index()]);
        let both = a * a.transpose() + b * b.transpose();
        let reason = "the covariance of both muscles is not positive".to_owned();
        let factor = both.cholesky().ok_or(DeviceError::SyntheticModel { gesture: switch, reason })?;
        self.factors[switch.index()] = factor.unpack();
        let [a, b] = pair.map(|gesture| self.log_sds[gesture.index()]);
        self.log_sds[switch.index()] = a.max(b);
        Ok(self)
    }

    /// The next sample while the person makes `gesture`. Does not allocate.
    pub fn next(&mut self, gesture: Command) -> ChannelValues {
        if self.current_gesture != Some(gesture) {
            // The stream begins in its first gesture; later ones build up.
            self.onset_samples_left = if self.current_gesture.is_none() { 1 } else { self.onset_samples };
            self.current_gesture = Some(gesture);
        }
        let target = &self.factors[gesture.index()];
        if self.onset_samples_left > 0 {
            let share = 1.0 / f64::from(self.onset_samples_left);
            self.mixing_matrix.zip_apply(target, |now, then| *now += (then - *now) * share);
            self.onset_samples_left -= 1;
        }
        let draw: f64 = StandardNormal.sample(&mut self.rng);
        self.fluctuation =
            self.persistence * self.fluctuation + (1.0 - self.persistence * self.persistence).sqrt() * draw;
        // The mean square stays that of the covariance: E exp(2 s z) = exp(2 s^2).
        let sd = self.log_sds[gesture.index()];
        let amplitude = (sd * self.fluctuation - sd * sd).exp();
        let noise = self.noise();
        (0..self.channels)
            .map(|row| amplitude * (0..=row).map(|k| self.mixing_matrix[(row, k)] * noise[k]).sum::<f64>())
            .collect()
    }

    /// Independent shaped noise of unit variance.
    fn noise(&mut self) -> ChannelValues {
        let mut out: ChannelValues = std::iter::repeat_n(0.0, self.channels).collect();
        for _ in 0..self.oversampling {
            for (value, shaping) in out.iter_mut().zip(&mut self.shaping) {
                let white: f64 = StandardNormal.sample(&mut self.rng);
                *value = self.gain * shaping.step(white);
            }
        }
        out
    }
}

/// The shaping filter as three one-pole sections by the bilinear transform, corners kept in place.
#[derive(Clone, Debug)]
struct ShapingFilter {
    low: f64,
    high: f64,
    /// Last input and output of each section.
    state: [(f64, f64); 3],
}

impl ShapingFilter {
    fn new(rate_hz: f64) -> ShapingFilter {
        let warp = |corner: f64| (std::f64::consts::PI * corner / rate_hz).tan();
        ShapingFilter { low: warp(LOW_CORNER_HZ), high: warp(HIGH_CORNER_HZ), state: [(0.0, 0.0); 3] }
    }

    fn step(&mut self, input: f64) -> f64 {
        let (low, high) = (self.low, self.high);
        let mut value = input;
        for (section, (x1, y1)) in self.state.iter_mut().enumerate() {
            let k = if section == 0 { low } else { high };
            let fed = if section == 0 { value - *x1 } else { k * (value + *x1) };
            let out = (fed + (1.0 - k) * *y1) / (1.0 + k);
            (*x1, *y1) = (value, out);
            value = out;
        }
        value
    }

    /// What makes the output's variance one for white input of variance one.
    fn gain(&self) -> f64 {
        let mut fresh = ShapingFilter { state: [(0.0, 0.0); 3], ..*self };
        // Long enough for the slowest pole to die away at any rate up to 20 kHz.
        const RESPONSE: usize = 20_000;
        let energy: f64 = (0..RESPONSE).map(|k| fresh.step(if k == 0 { 1.0 } else { 0.0 }).powi(2)).sum();
        1.0 / energy.sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random_stream;

    /// Seconds over which figures of noise are taken, and how far they may be off: several standard errors.
    const SECS: usize = 120;
    const TOLERANCE: f64 = 0.1;

    fn samples(rate_hz: f64, gesture: Command) -> Vec<ChannelValues> {
        let model = SyntheticModel::shipped().unwrap();
        let mut emg = SyntheticEmg::new(&model, rate_hz, 8, 1.0, random_stream(5, "test")).unwrap();
        (0..SECS * rate_hz as usize).map(|_| emg.next(gesture)).collect()
    }

    #[test]
    fn the_channels_have_the_fitted_covariance_at_any_rate() {
        let model = SyntheticModel::shipped().unwrap();
        for rate_hz in [200.0, 1000.0] {
            for fitted in &model.gestures {
                let samples = samples(rate_hz, fitted.gesture);
                for i in 0..8 {
                    for j in 0..8 {
                        let got = samples.iter().map(|s| s[i] * s[j]).sum::<f64>() / samples.len() as f64;
                        let scale = (fitted.covariance[i][i] * fitted.covariance[j][j]).sqrt();
                        let off = (got - fitted.covariance[i][j]) / scale;
                        assert!(off.abs() < TOLERANCE, "{} {i} {j} at {rate_hz} Hz: {off}", fitted.gesture);
                    }
                }
            }
        }
    }

    #[test]
    fn the_spectrum_is_that_of_the_shaping_filter() {
        // Power at a frequency by its Fourier sums over blocks of one second, against the formula.
        let signal: Vec<f64> = samples(1000.0, Command::WristFlexion).iter().map(|s| s[0]).collect();
        let power = |f: f64| {
            let blocks = signal.chunks_exact(1000).map(|block| {
                let sum = |turn: fn(f64) -> f64| {
                    block
                        .iter()
                        .zip(0..)
                        .map(|(v, k)| v * turn(std::f64::consts::TAU * f * f64::from(k) / 1000.0))
                        .sum::<f64>()
                };
                sum(f64::cos).powi(2) + sum(f64::sin).powi(2)
            });
            blocks.sum::<f64>()
        };
        let band = |center: i32| (center - 5..=center + 5).map(|f| power(f64::from(f))).sum::<f64>();
        let formula = |f: f64| {
            let (l, h) = (LOW_CORNER_HZ * LOW_CORNER_HZ, HIGH_CORNER_HZ * HIGH_CORNER_HZ);
            f * f / ((f * f + l) * (f * f + h).powi(2))
        };
        for (f, other) in [(20, 60), (60, 120), (120, 200)] {
            let got = band(f) / band(other);
            let expected = formula(f64::from(f)) / formula(f64::from(other));
            // The bilinear transform bends the frequency axis, by some per cent up to 200 Hz.
            assert!((got / expected - 1.0).abs() < 0.25, "{f} to {other} Hz: {got}, formula {expected}");
        }
    }

    #[test]
    fn a_co_contraction_has_the_variances_of_both_muscles() {
        let model = SyntheticModel::shipped().unwrap();
        let pair = [Command::WristExtension, Command::WristFlexion];
        let emg = SyntheticEmg::new(&model, 200.0, 8, 1.0, random_stream(5, "test")).unwrap();
        let mut emg = emg.with_cocontraction(Command::HandOpen, pair).unwrap();
        let samples: Vec<ChannelValues> = (0..SECS * 200).map(|_| emg.next(Command::HandOpen)).collect();
        let of = |gesture: Command| &model.gestures[gesture.index()].covariance;
        for channel in 0..8 {
            let got = samples.iter().map(|s| s[channel] * s[channel]).sum::<f64>() / samples.len() as f64;
            let expected: f64 = pair.iter().map(|gesture| of(*gesture)[channel][channel]).sum();
            assert!((got / expected - 1.0).abs() < TOLERANCE, "{channel}: {got}, expected {expected}");
        }
    }

    #[test]
    fn a_new_gesture_builds_up_and_does_not_jump() {
        let model = SyntheticModel::shipped().unwrap();
        let mut emg = SyntheticEmg::new(&model, 1000.0, 8, 1.0, random_stream(1, "test")).unwrap();
        let mut rms = |gesture, count| {
            let sum: f64 = (0..count).map(|_| emg.next(gesture).iter().map(|v| v * v).sum::<f64>()).sum();
            (sum / f64::from(count) / 8.0).sqrt()
        };
        let rest = rms(Command::NoMotion, 500);
        let begins = rms(Command::WristExtension, 20);
        rms(Command::WristExtension, 80);
        let full = rms(Command::WristExtension, 500);
        assert!(rest < 3.0 && begins < 0.4 * full && full > 10.0, "{rest} {begins} {full}");
    }

    #[test]
    fn impossible_figures_channels_rates_and_scales_are_refused() {
        let model = SyntheticModel::shipped().unwrap();
        let error = |model: &SyntheticModel, rate, channels, scale| {
            SyntheticEmg::new(model, rate, channels, scale, random_stream(1, "test")).unwrap_err().to_string()
        };
        assert!(error(&model, f64::NAN, 8, 1.0).contains("EMG rate is NaN"));
        assert!(error(&model, 200.0, 9, 1.0).contains("at most 8 channels, the recordings have 9"));
        assert!(error(&model, 200.0, 0, 1.0).contains("have 0"));
        assert!(error(&model, 200.0, 8, 0.0).contains("amplitude scale is 0"));
        let mut singular = model.clone();
        singular.gestures[1].covariance = vec![vec![1.0; 8]; 8];
        assert!(
            error(&singular, 200.0, 8, 1.0)
                .contains("hand_open are unusable: the covariance is not positive")
        );
        let mut ragged = model.clone();
        ragged.gestures[1].covariance[3].pop();
        assert!(error(&ragged, 200.0, 8, 1.0).contains("not square"));
        let mut incomplete = model;
        incomplete.gestures.truncate(3);
        assert!(error(&incomplete, 200.0, 8, 1.0).contains("wrist_extension are unusable: not fitted"));
    }
}
