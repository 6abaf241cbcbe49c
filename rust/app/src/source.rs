//! Where samples come from, for every command that takes a live stream.

use crate::{lab_streaming, tell};
use proact_devices::{
    EmgOrigin, KeyboardSource, Pacing, PersonSource, PlaybackSource, Recordings, SampleSource, SourceInfo,
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
pub const REACTION: Duration = Duration::from_millis(250);

/// How a source is opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SourceOptions {
    /// Repetition that a folder of recordings plays and a simulated person makes.
    pub rep: u32,
    /// Files and simulated people as fast as they can be read.
    pub flat_out: bool,
    /// Bits of the armband's converter: 8 up to 1000 Hz, 12 up to 500 Hz.
    pub bits: u8,
    /// Bytes of the armband's packets.
    pub packet_bytes: u8,
    /// Seed of simulated people.
    pub seed: u64,
}

impl Default for SourceOptions {
    fn default() -> Self {
        let GForceOptions { bits, packet_bytes, .. } = GForceOptions::default();
        Self { rep: 2, flat_out: false, bits, packet_bytes, seed: 0 }
    }
}

/// Where samples come from.
#[derive(Clone, Debug, PartialEq)]
pub enum SourceName {
    /// The armband's simulator, `HOST:PORT`.
    Simulator(String),
    /// An armband over Bluetooth; empty for the first one that is found.
    Ble(String),
    /// Name of a stream; empty for the only one of type EMG.
    Lsl(String),
    /// A file, or a folder of recordings.
    File(PathBuf),
    /// A simulated person with generated EMG.
    Synthetic,
    /// A simulated person with the EMG of a folder of recordings.
    Person(PathBuf),
    /// Keys of the terminal.
    Keys,
    /// LibEMG's classes on this UDP port.
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

/// Opens a source; `rate` in hertz if one is asked for.
///
/// # Errors
/// A source that cannot be opened, or options that do not fit it.
pub fn open(
    source: &SourceName,
    options: &SourceOptions,
    rate: Option<f64>,
) -> Result<Box<dyn SampleSource>, Box<dyn Error>> {
    let rate_hz = match rate {
        Some(rate) if (1.0..=1000.0).contains(&rate) && rate.fract() == 0.0 => Some(rate as u16),
        Some(rate) => return Err(format!("--emg-rate is {rate}, expected a whole number up to 1000").into()),
        None => None,
    };
    let &SourceOptions { bits, packet_bytes, rep, seed, .. } = options;
    let armband = GForceOptions { rate_hz, bits, packet_bytes, ..GForceOptions::default() };
    let pacing = if options.flat_out { Pacing::FlatOut } else { Pacing::RealTime };
    let person = |source: &EmgOrigin| PersonSource::new(source, pacing, REACTION, seed);
    Ok(match source {
        SourceName::Simulator(address) => {
            Box::new(GForce::open(Box::new(TcpConnector::new(address)), armband)?)
        }
        SourceName::Ble(name) => open_ble(name, armband)?,
        SourceName::Lsl(name) => lab_streaming::open(name)?,
        SourceName::File(path) if path.is_file() => {
            let recorded = read_recorded(path)?;
            let (name, rate) = (path.display().to_string(), recorded.rate_hz);
            Box::new(PlaybackSource::new(&name, recorded.samples, rate, packet_of(rate), pacing)?)
        }
        SourceName::File(path) => {
            let recordings = Recordings::open(path, rate)?;
            let (gestures, packet) = (recordings.gestures(), packet_of(recordings.rate_hz));
            Box::new(PlaybackSource::of_recordings(&recordings, rep, &gestures, packet, pacing)?)
        }
        SourceName::Synthetic => Box::new(person(&EmgOrigin::Synthetic)?),
        SourceName::Person(dir) => {
            let recordings = Recordings::open(dir, rate)?;
            Box::new(person(&EmgOrigin::Recording {
                dir: dir.clone(),
                rate_hz: recordings.rate_hz,
                // The classifier that comes with it is not used; any repetition will do.
                train_reps: vec![rep],
                feed_reps: vec![rep],
                fill: true,
            })?)
        }
        SourceName::Keys => {
            tell("keys: W wrist extension, S wrist flexion, A hand close, D hand open, space relaxes");
            Box::new(KeyboardSource::new(RawKeys::new(), seed)?)
        }
        SourceName::LibEmgUdp(_) => return Err("LibEMG sends classes, not samples".into()),
    })
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
pub fn read_model(path: &Path, info: &SourceInfo) -> Result<EmgModel, Box<dyn Error>> {
    let model = read_model_file(path)?;
    let stream = StreamFormat { rate_hz: info.rate_hz, channels: info.channels, rest_medians: None };
    model.check_fits(&stream).map_err(|e| format!("{}: {e}", path.display()))?;
    Ok(model)
}

/// Reads a model file.
///
/// # Errors
/// A file that cannot be read, or is no model.
pub fn read_model_file(path: &Path) -> Result<EmgModel, Box<dyn Error>> {
    let json = std::fs::File::open(path)
        .and_then(|file| proact_types::read_text(file, proact_types::MOST_TEXT_BYTES))
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
