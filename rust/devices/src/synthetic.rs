use crate::{ChannelValues, DeviceError};
use nalgebra::DMatrix;
use proact_types::Gesture;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

/// What was fitted to the recordings of one gesture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FittedGesture {
    /// Which gesture.
    pub gesture: Gesture,
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
    /// Every gesture in [`Gesture::ALL`] order.
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
/// Time over which the amplitude fluctuates: that of the blocks in which the fluctuation was fitted. Assumed.
const FLUCTUATION_SECS: f64 = 0.5;

impl SyntheticModel {
    /// The figures shipped with this crate.
    ///
    /// # Errors
    /// Never for the file as shipped; a test proves it.
    pub fn shipped() -> Result<SyntheticModel, DeviceError> {
        serde_json::from_str(include_str!("../data/synthetic_emg.json")).map_err(|error| {
            DeviceError::SyntheticModel { gesture: Gesture::NoMotion, reason: error.to_string() }
        })
    }

    /// Number of channels.
    pub fn channels(&self) -> usize {
        self.gestures.first().map_or(0, |g| g.covariance.len())
    }

    /// Root mean square over all channels of `gesture`; zero for a gesture that was not fitted.
    pub fn rms(&self, gesture: Gesture) -> f64 {
        let trace = |g: &FittedGesture| (0..g.covariance.len()).map(|k| g.covariance[k][k]).sum::<f64>();
        self.gestures
            .iter()
            .find(|g| g.gesture == gesture)
            .map_or(0.0, |g| (trace(g) / g.covariance.len().max(1) as f64).sqrt())
    }
}

/// A stream of synthetic EMG: Gaussian noise with a muscle's spectrum, mixed so that the channels have the fitted
/// covariance of the gesture, with a slowly fluctuating amplitude.
///
/// Known weaknesses: one person and one position of the band; no fatigue, no motion artefacts, no mains hum; the
/// transition from gesture to gesture is a ramp of the mixing matrix, not a movement.
#[derive(Clone, Debug)]
pub struct SyntheticEmg {
    rng: ChaCha8Rng,
    channels: usize,
    oversampling: u32,
    shaping: Vec<Shaping>,
    /// Makes the shaped noise unit variance.
    gain: f64,
    /// Lower triangular factors of the covariances, in [`Gesture::ALL`] order, scaled to the stream's unit.
    factors: Vec<DMatrix<f64>>,
    log_sds: Vec<f64>,
    /// Fluctuation: a first-order process of unit variance.
    fluctuation: f64,
    persistence: f64,
    gesture: Option<Gesture>,
    /// The mixing matrix now and its step per sample during an onset.
    mix: DMatrix<f64>,
    onset_left: u32,
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
            if !(value.is_finite() && value > 0.0) {
                return Err(DeviceError::Parameter { name, value, expected: "a finite number above zero" });
            }
        }
        let most = model.channels();
        if !(1..=most).contains(&channels) {
            return Err(DeviceError::SyntheticChannels { channels, most });
        }
        let mut factors = Vec::new();
        let mut log_sds = Vec::new();
        for gesture in Gesture::ALL {
            let unusable = |reason: &str| DeviceError::SyntheticModel { gesture, reason: reason.to_owned() };
            let fitted =
                model.gestures.iter().find(|g| g.gesture == gesture).ok_or_else(|| unusable("not fitted"))?;
            if fitted.covariance.len() != most || fitted.covariance.iter().any(|row| row.len() != most) {
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
        let shaping = Shaping::new(rate_hz * oversampling);
        let fluctuation = StandardNormal.sample(&mut rng);
        let mut emg = SyntheticEmg {
            rng,
            channels,
            oversampling: oversampling as u32,
            gain: shaping.gain(),
            shaping: vec![shaping; channels],
            mix: DMatrix::zeros(channels, channels),
            factors,
            log_sds,
            fluctuation,
            persistence: (-1.0 / (FLUCTUATION_SECS * rate_hz)).exp(),
            gesture: None,
            onset_left: 0,
            onset_samples: (ONSET_SECS * rate_hz).round().max(1.0) as u32,
        };
        // The filters start empty: run them in.
        for _ in 0..emg.onset_samples {
            emg.noise();
        }
        Ok(emg)
    }

    /// The next sample while the person makes `gesture`. Does not allocate.
    pub fn next(&mut self, gesture: Gesture) -> ChannelValues {
        if self.gesture != Some(gesture) {
            // The stream begins in its first gesture; later ones build up.
            self.onset_left = if self.gesture.is_none() { 1 } else { self.onset_samples };
            self.gesture = Some(gesture);
        }
        let target = &self.factors[gesture.index()];
        if self.onset_left > 0 {
            let share = 1.0 / f64::from(self.onset_left);
            self.mix.zip_apply(target, |now, then| *now += (then - *now) * share);
            self.onset_left -= 1;
        }
        let draw: f64 = StandardNormal.sample(&mut self.rng);
        self.fluctuation =
            self.persistence * self.fluctuation + (1.0 - self.persistence * self.persistence).sqrt() * draw;
        // The mean square stays that of the covariance: E exp(2 s z) = exp(2 s^2).
        let sd = self.log_sds[gesture.index()];
        let amplitude = (sd * self.fluctuation - sd * sd).exp();
        let noise = self.noise();
        (0..self.channels)
            .map(|row| amplitude * (0..=row).map(|k| self.mix[(row, k)] * noise[k]).sum::<f64>())
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
struct Shaping {
    low: f64,
    high: f64,
    /// Last input and output of each section.
    state: [(f64, f64); 3],
}

impl Shaping {
    fn new(rate_hz: f64) -> Shaping {
        let warp = |corner: f64| (std::f64::consts::PI * corner / rate_hz).tan();
        Shaping { low: warp(LOW_CORNER_HZ), high: warp(HIGH_CORNER_HZ), state: [(0.0, 0.0); 3] }
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
        let mut fresh = Shaping { state: [(0.0, 0.0); 3], ..*self };
        // Long enough for the slowest pole to die away at any rate up to 20 kHz.
        const RESPONSE: usize = 20_000;
        let energy: f64 = (0..RESPONSE).map(|k| fresh.step(if k == 0 { 1.0 } else { 0.0 }).powi(2)).sum();
        1.0 / energy.sqrt()
    }
}
