//! Where samples come from, for every command that takes a live stream.

use super::lab_streaming;
use clap::Args;
use proact_devices::{
    EmgSource, KeyboardSource, Pacing, PersonSource, PlaybackSource, Recordings, SampleSource, SourceInfo,
    gforce::{GForce, GForceOptions, TcpConnector},
    read_recorded,
};
use proact_emg::{EmgModel, StreamFormat};
use std::{
    error::Error,
    io::{IsTerminal, stdin},
    path::{Path, PathBuf},
    process::{Command, Stdio},
    str::FromStr,
    time::Duration,
};

/// How long a simulated person takes from the prompt to the muscle.
pub(super) const REACTION: Duration = Duration::from_millis(250);

/// Options of a source.
#[derive(Debug, Args)]
pub struct SourceArgs {
    /// gforce-sim://HOST:PORT, ble or ble:NAME, lsl or lsl:NAME, file:FOLDER, file:FILE.csv|.edf, synthetic, person:FOLDER, keys, libemg-udp:PORT.
    ///
    /// `synthetic` and `person:FOLDER` are simulated people who make what is prompted, with generated EMG or that of
    /// recordings. `keys`: W, S, A and D in the terminal are gestures, space relaxes.
    #[arg(long)]
    pub(super) source: SourceName,
    /// Repetition that file:FOLDER plays and person:FOLDER makes.
    #[arg(long, default_value_t = 2)]
    pub(super) rep: u32,
    /// Play files and simulated people as fast as they can be read.
    #[arg(long)]
    pub(super) flat_out: bool,
    /// The code of zero volts. Default: that of the model if it was trained on raw codes; else what the maker says,
    /// 128 at 8 bit, 2048 at 12 bit; 0 for files. Training: the median at rest.
    #[arg(long)]
    pub(super) zero: Option<f64>,
    /// Bits of the armband's converter: 8 up to 1000 Hz, 12 up to 500 Hz.
    #[arg(long, default_value_t = 8)]
    bits: u8,
    /// Bytes of a packet: 128 waits 16 ms at 1000 Hz, 32 waits 4 ms.
    #[arg(long, default_value_t = 128)]
    packet: u8,
    /// Seed of simulated people and of the order of prompts.
    #[arg(long, default_value_t = 0)]
    pub(super) seed: u64,
}

/// Where samples come from.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum SourceName {
    Simulator(String),
    Ble(String),
    /// Name of a stream; empty for the only one of type EMG.
    Lsl(String),
    File(PathBuf),
    Synthetic,
    Person(PathBuf),
    Keys,
    LibEmgUdp(u16),
}

impl FromStr for SourceName {
    type Err = String;

    fn from_str(text: &str) -> Result<SourceName, String> {
        let unknown = || {
            format!(
                "source {text:?} is unknown; expected gforce-sim://HOST:PORT, ble, ble:NAME, lsl, lsl:NAME, file:PATH, \
                 synthetic, person:FOLDER, keys or libemg-udp:PORT"
            )
        };
        if let Some(address) = text.strip_prefix("gforce-sim://") {
            return Ok(SourceName::Simulator(address.to_owned()));
        }
        match text.split_once(':').unwrap_or((text, "")) {
            ("ble", name) => Ok(SourceName::Ble(name.to_owned())),
            ("lsl", name) => Ok(SourceName::Lsl(name.to_owned())),
            ("file", path) if !path.is_empty() => Ok(SourceName::File(path.into())),
            ("person", path) if !path.is_empty() => Ok(SourceName::Person(path.into())),
            ("synthetic", "") => Ok(SourceName::Synthetic),
            ("keys", "") => Ok(SourceName::Keys),
            ("libemg-udp", port) => port.parse().map(SourceName::LibEmgUdp).map_err(|_| unknown()),
            _ => Err(unknown()),
        }
    }
}

/// Opens the source; `rate` as asked for.
///
/// # Errors
/// A source that cannot be opened, or options that do not fit it.
pub(super) fn open(args: &SourceArgs, rate: Option<f64>) -> Result<Box<dyn SampleSource>, Box<dyn Error>> {
    let rate_hz = match rate {
        Some(rate) if (1.0..=1000.0).contains(&rate) && rate.fract() == 0.0 => Some(rate as u16),
        Some(rate) => return Err(format!("--emg-rate is {rate}, expected a whole number up to 1000").into()),
        None => None,
    };
    let options =
        GForceOptions { rate_hz, bits: args.bits, packet_bytes: args.packet, ..GForceOptions::default() };
    let pacing = if args.flat_out { Pacing::FlatOut } else { Pacing::RealTime };
    let person = |source: &EmgSource| PersonSource::new(source, pacing, REACTION, args.seed);
    Ok(match &args.source {
        SourceName::Simulator(address) => {
            Box::new(GForce::open(Box::new(TcpConnector::new(address)), options)?)
        }
        SourceName::Ble(name) => open_ble(name, options)?,
        SourceName::Lsl(name) => lab_streaming::open(name)?,
        SourceName::File(path) if path.is_file() => {
            let recorded = read_recorded(path)?;
            let (name, rate) = (path.display().to_string(), recorded.rate_hz);
            Box::new(PlaybackSource::new(&name, recorded.samples, rate, packet_of(rate), pacing)?)
        }
        SourceName::File(path) => {
            let recordings = Recordings::open(path, rate)?;
            let (gestures, packet) = (recordings.gestures(), packet_of(recordings.rate_hz));
            Box::new(PlaybackSource::of_recordings(&recordings, args.rep, &gestures, packet, pacing)?)
        }
        SourceName::Synthetic => Box::new(person(&EmgSource::Synthetic)?),
        SourceName::Person(dir) => {
            let recordings = Recordings::open(dir, rate)?;
            Box::new(person(&EmgSource::Recording {
                dir: dir.clone(),
                rate_hz: recordings.rate_hz,
                // The classifier that comes with it is not used; any repetition will do.
                train_reps: vec![args.rep],
                feed_reps: vec![args.rep],
                fill: true,
            })?)
        }
        SourceName::Keys => {
            eprintln!("keys: W wrist extension, S wrist flexion, A hand close, D hand open, space relaxes");
            Box::new(KeyboardSource::new(RawKeys::new(), args.seed)?)
        }
        SourceName::LibEmgUdp(_) => return Err("LibEMG sends classes, not samples".into()),
    })
}

/// [`open`] with default options, in real time.
///
/// # Errors
/// A source that cannot be opened.
pub(super) fn open_named(source: &SourceName) -> Result<Box<dyn SampleSource>, Box<dyn Error>> {
    let (bits, packet) = (GForceOptions::default().bits, GForceOptions::default().packet_bytes);
    let source = source.clone();
    open(&SourceArgs { source, rep: 2, flat_out: false, zero: None, bits, packet, seed: 0 }, None)
}

/// Files are played in packets as long as the armband's.
fn packet_of(rate_hz: f64) -> usize {
    ((rate_hz * 0.016).round() as usize).max(1)
}

#[cfg(feature = "ble")]
fn open_ble(name: &str, options: GForceOptions) -> Result<Box<dyn SampleSource>, Box<dyn Error>> {
    let connector = proact_devices::gforce::BleConnector::new(name)?;
    Ok(Box::new(GForce::open(Box::new(connector), options)?))
}

#[cfg(not(feature = "ble"))]
fn open_ble(_name: &str, _options: GForceOptions) -> Result<Box<dyn SampleSource>, Box<dyn Error>> {
    Err("this proact was built without Bluetooth; set PROACT_FEATURES=ble for ./proact, or install libdbus-1-dev and \
         build with --features ble"
        .into())
}

/// Standard input, key by key where it is a terminal; the terminal is put right again in the end.
struct RawKeys {
    terminal: bool,
}

impl RawKeys {
    fn new() -> RawKeys {
        let terminal = stdin().is_terminal() && stty(&["-icanon", "-echo"]);
        RawKeys { terminal }
    }
}

/// Without it a key needs Enter after it, which is no reason to stop.
fn stty(words: &[&str]) -> bool {
    let command = Command::new("stty").args(words).stdin(Stdio::inherit()).status();
    command.is_ok_and(|status| status.success())
}

impl std::io::Read for RawKeys {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        stdin().read(buffer)
    }
}

impl Drop for RawKeys {
    fn drop(&mut self) {
        if self.terminal {
            stty(&["icanon", "echo"]);
        }
    }
}

/// Reads a model file and checks that it fits the stream.
///
/// # Errors
/// A file that cannot be read, is no model, or was trained on another stream.
pub(super) fn read_model(path: &Path, info: &SourceInfo) -> Result<EmgModel, Box<dyn Error>> {
    let model = read_model_file(path)?;
    let stream = StreamFormat { rate_hz: info.rate_hz, channels: info.channels, rest_medians: None };
    model.check_fits(&stream).map_err(|e| format!("{}: {e}", path.display()))?;
    Ok(model)
}

/// Reads a model file.
///
/// # Errors
/// A file that cannot be read, or is no model.
pub(crate) fn read_model_file(path: &Path) -> Result<EmgModel, Box<dyn Error>> {
    let json = std::fs::read_to_string(path)
        .map_err(|e| format!("cannot read {}: {e}; proact emg train writes such a file", path.display()))?;
    Ok(EmgModel::from_json(&json).map_err(|e| format!("{}: {e}", path.display()))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_are_told_by_their_names() {
        let source = |text: &str| text.parse::<SourceName>();
        assert_eq!(
            source("gforce-sim://127.0.0.1:7410"),
            Ok(SourceName::Simulator("127.0.0.1:7410".to_owned()))
        );
        assert_eq!(source("ble"), Ok(SourceName::Ble(String::new())));
        assert_eq!(source("ble:gForce"), Ok(SourceName::Ble("gForce".to_owned())));
        assert_eq!(source("lsl"), Ok(SourceName::Lsl(String::new())));
        assert_eq!(source("lsl:my band"), Ok(SourceName::Lsl("my band".to_owned())));
        assert_eq!(source("file:/a:b"), Ok(SourceName::File("/a:b".into())));
        assert_eq!(source("person:recordings"), Ok(SourceName::Person("recordings".into())));
        assert_eq!(source("synthetic"), Ok(SourceName::Synthetic));
        assert_eq!(source("keys"), Ok(SourceName::Keys));
        assert_eq!(source("libemg-udp:12346"), Ok(SourceName::LibEmgUdp(12346)));
        for wrong in ["", "file:", "person:", "keys:x", "libemg-udp:", "libemg-udp:70000", "usb"] {
            assert!(source(wrong).unwrap_err().contains("expected gforce-sim://"), "{wrong:?}");
        }
    }
}
