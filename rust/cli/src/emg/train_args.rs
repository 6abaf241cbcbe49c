//! What `proact emg train` is told, and the settings that follow.

use super::{WindowArgs, recording_checks::FaultArgs, source_args::SourceArgs};
use crate::access_args::AccessArgs;
use clap::Args;
use proact_devices::SourceInfo;
use proact_emg::{CalibrationConfig, DcOffsetSource, EmgConfig, EmgError, QualityConfig};
use proact_types::Gesture;
use std::{
    error::Error,
    net::IpAddr,
    path::{Path, PathBuf},
};

/// Options of `proact emg train`.
#[derive(Debug, Args)]
pub struct TrainArgs {
    #[command(flatten)]
    pub(super) source: SourceArgs,
    /// Where the model goes. An existing file is replaced only with --replace.
    #[arg(long, default_value = "emg_model.json")]
    pub(super) out: PathBuf,
    /// Replace the model file if there is one.
    #[arg(long)]
    pub(super) replace: bool,
    /// Folder for the recordings, in LibEMG's layout; a new or empty one. Without it they are kept beside the model until it
    /// is good enough.
    #[arg(long, value_name = "DIR")]
    pub(super) save: Option<PathBuf>,
    /// Go on with a calibration that was stopped: the folder in which its recordings are.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["save", "band_check"])]
    pub(super) resume: Option<PathBuf>,
    /// Gestures to train, by any names; a folder of recordings says itself which it has. Default: the five of the paper.
    #[arg(long, value_delimiter = ',', value_name = "NAMES")]
    pub(super) gestures: Vec<Gesture>,
    /// Which of them is the relaxed hand, that stops the arm. Default: no_motion, or what the folder says.
    #[arg(long, value_name = "NAME")]
    pub(super) rest: Option<Gesture>,
    /// Repetitions of file:FOLDER to use. Default: all.
    #[arg(long, value_name = "REPS", value_delimiter = ',')]
    pub(super) repetitions: Vec<u32>,
    #[command(flatten)]
    pub(super) faults: FaultArgs,
    /// Most rounds; training stops earlier when it is good enough.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u8).range(2..=100))]
    pub(super) max_rounds: u8,
    /// Rounds before it can be good enough.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u8).range(2..=100))]
    pub(super) min_rounds: u8,
    /// Share of windows to be recognised, leaving one repetition out, that is good enough.
    #[arg(long, value_name = "P", default_value_t = 0.9)]
    pub(super) target_accuracy: f64,
    /// With linear and ridge, in the place of --target-accuracy: R2 of each degree of freedom, leaving one repetition out.
    #[arg(long, default_value_t = 0.6)]
    pub(super) target_r2: f64,
    /// Positions of the limb in which rounds are recorded, one after the other, as hanging,forward,overhead. Each is asked for twice
    /// at least. Default: none is asked for.
    #[arg(long, value_delimiter = ',', value_name = "NAMES")]
    pub(super) positions: Vec<String>,
    /// Length of a repetition, seconds.
    #[arg(long, value_name = "S", default_value_t = 3.0)]
    pub(super) repetition_seconds: f64,
    /// Seconds from the prompt to the recording.
    #[arg(long, value_name = "S", default_value_t = 2.0)]
    pub(super) prepare_seconds: f64,
    /// Model of an earlier session: two gestures tell first whether the band sits as it did then.
    #[arg(long, value_name = "MODEL")]
    pub(super) band_check: Option<PathBuf>,
    /// If the band check finds the band turned, write the model for the band as it sits, and be done.
    #[arg(long, requires = "band_check")]
    pub(super) accept_rotation: bool,
    /// Give up when nothing could be recorded for so many seconds.
    #[arg(long, value_name = "S", default_value_t = 60.0)]
    pub(super) timeout: f64,
    #[command(flatten)]
    pub(super) page: CalibrationPageArgs,
    #[command(flatten)]
    pub(super) window: WindowArgs,
}

/// Options of a page.
#[derive(Clone, Debug, Args)]
pub struct CalibrationPageArgs {
    /// Guide on a page in the browser instead of in the terminal.
    #[arg(long)]
    pub(super) page: bool,
    /// Port of the page, or the next free one.
    #[arg(long, default_value_t = 8090, requires = "page")]
    pub(super) port: u16,
    /// Address to listen on; where other machines can connect, everybody needs the token that is printed then.
    #[arg(long, default_value = "127.0.0.1", requires = "page")]
    pub(super) bind: IpAddr,
    /// Print the address of the page, open nothing.
    #[arg(long, requires = "page")]
    pub(super) no_browser: bool,
    #[command(flatten)]
    pub(super) access: AccessArgs,
}

impl TrainArgs {
    /// Where the recordings of a live calibration go.
    pub(super) fn recordings_dir(&self) -> PathBuf {
        let beside = || {
            let mut name = self.out.clone().into_os_string();
            name.push(".recordings");
            PathBuf::from(name)
        };
        self.resume.clone().or_else(|| self.save.clone()).unwrap_or_else(beside)
    }
}

/// How the stream of `info` is calibrated.
///
/// # Errors
/// Settings that cannot work.
pub(super) fn calibration_config(
    args: &TrainArgs,
    info: &SourceInfo,
    gestures: &[Gesture],
    rest: Gesture,
) -> Result<CalibrationConfig, Box<dyn Error>> {
    if !gestures.contains(&rest) {
        return Err(EmgError::NoRest { rest, known: gestures.to_vec() }.into());
    }
    let emg = EmgConfig { rest, ..args.window.live_config(info.rate_hz, info.channels, &info.imu)? }
        .without_process();
    let nominal_zero = args.source.adc_zero.unwrap_or(info.zero_code);
    let rails = info.rails.map(|(low, high)| [low - nominal_zero, high - nominal_zero]);
    let config = CalibrationConfig {
        emg,
        gestures: CalibrationConfig::round(gestures, rest),
        positions: args.positions.clone(),
        repetition_secs: args.repetition_seconds,
        prepare_secs: args.prepare_seconds,
        min_rounds: args.min_rounds.into(),
        max_rounds: args.max_rounds.into(),
        target_accuracy: args.target_accuracy,
        target_r2: args.target_r2,
        dc_offset: args.source.adc_zero.map_or(DcOffsetSource::RestMedian, DcOffsetSource::Fixed),
        nominal_dc_offset: nominal_zero,
        quality: QualityConfig { rails, ..QualityConfig::default() },
        ..CalibrationConfig::default()
    };
    config.check()?;
    Ok(config)
}

/// A folder that recordings may go into.
pub(super) fn check_empty(dir: &Path) -> Result<(), String> {
    match std::fs::read_dir(dir).map(|mut entries| entries.next().is_none()) {
        Ok(true) => Ok(()),
        Ok(false) => Err(format!(
            "{} is not empty; go on with a calibration that was stopped by --resume {}, or name a new folder with --save",
            dir.display(),
            dir.display()
        )),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(()),
        Err(error) => Err(format!("cannot use {}: {error}", dir.display())),
    }
}
