//! How a stream is cut into windows, on the command line of every command that takes windows.

use super::decoder_args::DecoderArgs;
use clap::{Args, ValueEnum};
use proact_app::print_status;
use proact_devices::{DeviceError, MYO_RATE_HZ, Recordings};
use proact_emg::{EmgConfig, EmgError, EmgFilter, FeatureSet, ImuChannel, ImuConfig, WindowLength};
use std::{error::Error, path::Path};

/// How a stream is cut into windows, and what is computed from them.
#[derive(Debug, Args)]
pub struct WindowArgs {
    /// Length of a window.
    #[arg(long, default_value_t = 100.0)]
    window: f64,
    /// Step from one window to the next.
    #[arg(long, default_value_t = 50.0)]
    increment: f64,
    /// Unit of window and increment.
    #[arg(long, value_enum, default_value_t = WindowUnit::Ms)]
    unit: WindowUnit,
    /// Samples per second, if neither the device nor a file beside the recordings says so.
    #[arg(long = "emg-rate")]
    pub(super) rate_hz: Option<f64>,
    /// Features or groups by LibEMG's names, as `HTD` or `MAV,RMS,AR4`.
    #[arg(long, value_parser = parse_features, default_value_t = FeatureSet::HTD)]
    pub(super) features: FeatureSet,
    /// Filter the stream first, as bandpass:20-450, bandstop:45-55, highpass:20, lowpass:450 (`:2` after it is another order than 4) or
    /// notch:50 (`:5` another width than 3 Hz); several in their order.
    #[arg(long = "filter", value_name = "FILTER")]
    filters: Vec<EmgFilter>,
    /// The inertial measurement unit of the source or the recordings too: `record` keeps what it says beside the EMG; `all`, or names of
    /// its channels or sensors as `acceleration,orientation_w`, make their means features as well, for limbs in several positions.
    #[arg(long, value_delimiter = ',', value_name = "CHANNELS")]
    imu: Vec<String>,
    #[command(flatten)]
    pub(super) decoder: DecoderArgs,
}

/// Names in capitals or not.
pub(super) fn parse_features(text: &str) -> Result<FeatureSet, proact_emg::EmgError> {
    text.parse().or_else(|_| text.to_uppercase().parse())
}

/// Units of window lengths.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum WindowUnit {
    /// Samples of the stream.
    Samples,
    /// Milliseconds, made samples by the rate.
    Ms,
}

impl WindowArgs {
    /// [`WindowArgs::config`] for a live stream: unlike recordings it can fall silent.
    pub(super) fn live_config(
        &self,
        rate_hz: f64,
        channels: usize,
        imu: &[ImuChannel],
    ) -> Result<EmgConfig, Box<dyn Error>> {
        let config = EmgConfig {
            stale_timeout_ms: EmgConfig::default().stale_timeout_ms,
            ..self.config(rate_hz, channels, imu)?
        };
        config.check()?;
        Ok(config)
    }

    /// The recordings in `dir`.
    ///
    /// # Errors
    /// As [`Recordings::open_shoulder`], though a rate that nobody says is none where nothing depends on it.
    pub(super) fn open(&self, dir: &Path) -> Result<Recordings, DeviceError> {
        let open = if self.wants_imu() { Recordings::open_with_imu } else { Recordings::open };
        let recordings = match open(dir, self.rate_hz) {
            Err(DeviceError::UnknownRate { .. }) if !self.depends_on_rate() => open(dir, Some(MYO_RATE_HZ)),
            opened => opened,
        }?;
        recordings.notes.iter().for_each(print_status);
        Ok(recordings)
    }

    /// `rate`, or any where it is unknown and nothing depends on it.
    pub(super) fn rate_or_default(&self, rate: Result<f64, DeviceError>) -> Result<f64, DeviceError> {
        match rate {
            Err(DeviceError::UnknownRate { .. }) if !self.depends_on_rate() => Ok(MYO_RATE_HZ),
            rate => rate,
        }
    }

    /// Whether windows or their features would be others at another rate.
    pub(super) fn depends_on_rate(&self) -> bool {
        self.unit == WindowUnit::Ms || self.features.depends_on_rate()
    }

    /// The inertial measurement unit is asked for.
    pub(super) fn wants_imu(&self) -> bool {
        !self.imu.is_empty()
    }

    /// What is made of the channels `imu` of a stream; nothing if nobody asks for them.
    pub(super) fn imu_config(&self, imu: &[ImuChannel]) -> Result<ImuConfig, EmgError> {
        let recorded = ImuConfig::record_only(if self.wants_imu() { imu.to_vec() } else { Vec::new() });
        match &self.imu[..] {
            [] => Ok(recorded),
            [word] if word == "record" => Ok(recorded),
            words => recorded.with_features(words),
        }
    }

    pub(super) fn config(
        &self,
        rate_hz: f64,
        channels: usize,
        imu: &[ImuChannel],
    ) -> Result<EmgConfig, Box<dyn Error>> {
        let length = |name: &str, value: f64| match self.unit {
            WindowUnit::Ms => Ok(WindowLength::Millis(value)),
            WindowUnit::Samples if value.fract() == 0.0 && (1.0..=f64::from(u32::MAX)).contains(&value) => {
                Ok(WindowLength::Samples(value as u32))
            }
            WindowUnit::Samples => {
                Err(format!("{name} is {value} samples, expected a whole number above zero"))
            }
        };
        let config = self.decoder.apply_to(EmgConfig {
            rate_hz,
            channels,
            window: length("window", self.window)?,
            increment: length("increment", self.increment)?,
            filters: self.filters.clone(),
            features: self.features,
            imu: self.imu_config(imu)?,
            // Recordings have no silences: any increment will do.
            stale_timeout_ms: u64::MAX,
            ..EmgConfig::default()
        });
        config.check()?;
        Ok(config)
    }
}
