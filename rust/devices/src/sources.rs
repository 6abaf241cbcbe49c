//! Where samples come from: the kinds of sources by their schemes, in one table.

use crate::{
    DeviceError, EmgOrigin, FaultPolicy, KeyboardSource, Pacing, PlaybackSource, Recordings, SampleSource,
    SimulatedPersonSource,
    gforce::{GForce, GForceOptions, GattConnector, LinkError, TcpConnector},
    myo::{Myo, MyoEmgMode, protocol::RATE_HZ as MYO_HZ},
    raw_keys::RawKeys,
    read_recorded,
};
use std::{
    fmt,
    path::{Path, PathBuf},
    str::FromStr,
    time::Duration,
};

/// How long a simulated person takes from the prompt to the muscle.
pub const REACTION_TIME: Duration = Duration::from_millis(250);

/// Highest rate that may be asked for, Hz. Amplifiers for grids of electrodes have 10 kHz.
const MAX_RATE_HZ: u16 = 20_000;

/// How a source is opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SourceOptions {
    /// Repetition that a folder of recordings plays and a simulated person makes.
    pub repetition: u32,
    /// Files and simulated people as fast as they can be read.
    pub as_fast_as_possible: bool,
    /// Bits of the armband's converter: 8 up to 1000 Hz, 12 up to 500 Hz.
    pub adc_bits: u8,
    /// Bytes of the armband's packets.
    pub packet_bytes: u8,
    /// Seed of simulated people.
    pub seed: u64,
    /// Samples per second, Hz, if one is asked for: a whole number up to 20,000.
    pub rate_hz: Option<u16>,
    /// The inertial measurement unit too. A source that has none is refused then.
    pub imu: bool,
    /// Whether recordings with findings that make an accuracy wrong are played.
    pub faults: FaultPolicy,
}

impl Default for SourceOptions {
    fn default() -> Self {
        let GForceOptions { bits, packet_bytes, .. } = GForceOptions::default();
        let faults = FaultPolicy::default();
        Self {
            repetition: 2,
            as_fast_as_possible: false,
            adc_bits: bits,
            packet_bytes,
            seed: 0,
            rate_hz: None,
            imu: false,
            faults,
        }
    }
}

impl SourceOptions {
    /// The same at `rate`, Hz, if one is asked for.
    ///
    /// # Errors
    /// [`DeviceError::Parameter`] for what is no whole number up to 20,000.
    pub fn at_rate(self, rate: Option<f64>) -> Result<Self, DeviceError> {
        let rate_hz = match rate {
            Some(rate) if (1.0..=f64::from(MAX_RATE_HZ)).contains(&rate) && rate.fract() == 0.0 => {
                Some(rate as u16)
            }
            Some(value) => {
                let expected = "a whole number up to 20000";
                return Err(DeviceError::Parameter { name: "--emg-rate", value, expected });
            }
            None => None,
        };
        Ok(Self { rate_hz, ..self })
    }

    fn gforce_options(&self) -> GForceOptions {
        let &Self { rate_hz, adc_bits: bits, packet_bytes, imu, .. } = self;
        GForceOptions { rate_hz, bits, packet_bytes, imu, ..GForceOptions::default() }
    }

    fn pacing(&self) -> Pacing {
        if self.as_fast_as_possible { Pacing::AsFastAsPossible } else { Pacing::RealTime }
    }

    fn person(&self, origin: &EmgOrigin) -> Result<Box<dyn SampleSource>, DeviceError> {
        let person = SimulatedPersonSource::new(origin, self.pacing(), REACTION_TIME, self.seed)?;
        let person =
            if self.imu && *origin == EmgOrigin::Synthetic { person.with_imu(self.seed) } else { person };
        Ok(Box::new(person))
    }
}

/// A source as it is named: a scheme, and what follows a colon or `://`. Whether there is one of this scheme, its registry
/// knows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SourceName(String);

impl SourceName {
    fn parts(&self) -> (&str, &str) {
        let text = self.0.as_str();
        text.split_once("://").or_else(|| text.split_once(':')).unwrap_or((text, ""))
    }

    /// Such as `file`.
    pub fn scheme(&self) -> &str {
        self.parts().0
    }

    /// What follows the scheme; empty if nothing does.
    pub fn address(&self) -> &str {
        self.parts().1
    }

    /// The file or folder that is played, if the source is one.
    pub fn file(&self) -> Option<&Path> {
        (self.scheme() == "file").then(|| Path::new(self.address()))
    }

    /// From where LibEMG's classes come, if they are the source.
    pub fn libemg_endpoint(&self) -> Option<LibEmgEndpoint> {
        match self.scheme() {
            CLASSES_UDP => self.address().parse().ok().map(LibEmgEndpoint::Udp),
            CLASSES_TCP => Some(LibEmgEndpoint::Tcp(self.address().to_owned())),
            _ => None,
        }
    }
}

impl fmt::Display for SourceName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl FromStr for SourceName {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(Self(text.to_owned()))
    }
}

/// What follows a scheme.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SourceAddress {
    /// Nothing.
    None,
    /// Maybe something, such as `NAME`.
    Optional(&'static str),
    /// Something, such as `HOST:PORT`.
    Required(&'static str),
}

/// Opens a source at an address.
pub type OpenSource = fn(&str, &SourceOptions) -> Result<Box<dyn SampleSource>, DeviceError>;

/// A kind of source.
#[derive(Clone, Copy, Debug)]
pub struct SourceScheme {
    /// What its name begins with, such as `ble`.
    pub scheme: &'static str,
    /// What follows a colon or `://`.
    pub address: SourceAddress,
    /// In a few words.
    pub help: &'static str,
    /// How it is opened.
    pub open: OpenSource,
}

impl SourceScheme {
    /// How it is named, such as `ble, ble:NAME`.
    pub fn syntax(&self) -> String {
        let scheme = self.scheme;
        match self.address {
            SourceAddress::None => scheme.to_owned(),
            SourceAddress::Optional(what) => format!("{scheme}, {scheme}:{what}"),
            SourceAddress::Required(what) if what.contains(':') => format!("{scheme}://{what}"),
            SourceAddress::Required(what) => format!("{scheme}:{what}"),
        }
    }
}

/// LibEMG's classes, which are no samples.
const CLASSES_UDP: &str = "libemg-udp";
const CLASSES_TCP: &str = "libemg-tcp";
const CLASSES_ONLY: &str = "LibEMG sends classes, not samples: only `emg stream` takes them; samples come from \
    gforce-sim://HOST:PORT, ble, myo, lsl, file:PATH, synthetic, person:FOLDER or keys";

/// From where LibEMG sends classes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LibEmgEndpoint {
    /// They come to this UDP port.
    Udp(u16),
    /// LibEMG waits for a connection at this address.
    Tcp(String),
}

/// The kinds of sources that there are: a value, which every command that takes a stream is given.
#[derive(Clone, Debug)]
pub struct SourceRegistry {
    schemes: Vec<SourceScheme>,
}

impl SourceRegistry {
    /// Those that ship with the program. This is the one place to add another.
    pub fn standard() -> Self {
        let scheme = |scheme, address, help, open| SourceScheme { scheme, address, help, open };
        Self {
            schemes: vec![
                scheme(
                    "gforce-sim",
                    SourceAddress::Required("HOST:PORT"),
                    "the gForce armband's simulator",
                    |address, options| {
                        Ok(Box::new(GForce::open(
                            Box::new(TcpConnector::new(address)),
                            options.gforce_options(),
                        )?))
                    },
                ),
                scheme("ble", SourceAddress::Optional("NAME"), "a gForce armband over Bluetooth", open_ble),
                scheme(
                    "myo-sim",
                    SourceAddress::Required("HOST:PORT"),
                    "the Myo armband's simulator",
                    |address, options| open_myo(Ok(TcpConnector::new(address)), options),
                ),
                scheme("myo", SourceAddress::Optional("NAME"), "a Myo armband over Bluetooth", open_myo_ble),
                scheme(
                    "lsl",
                    SourceAddress::Optional("NAME"),
                    "a stream of the lab streaming layer",
                    open_lsl,
                ),
                scheme(
                    "file",
                    SourceAddress::Required("PATH"),
                    "a folder of recordings, or one .csv or .edf file, as if live",
                    open_playback,
                ),
                scheme(
                    "synthetic",
                    SourceAddress::None,
                    "a simulated person who makes what is prompted, with generated EMG",
                    |_, options| options.person(&EmgOrigin::Synthetic),
                ),
                scheme(
                    "person",
                    SourceAddress::Required("FOLDER"),
                    "a simulated person with the EMG of a folder of recordings",
                    open_person,
                ),
                scheme(
                    "keys",
                    SourceAddress::None,
                    "keys of the terminal: W wrist extension, S wrist flexion, A hand close, D hand open, space relaxes",
                    |_, options| Ok(Box::new(KeyboardSource::new(RawKeys::new(), options.seed)?)),
                ),
                scheme(
                    CLASSES_UDP,
                    SourceAddress::Required("PORT"),
                    "LibEMG's classes or probabilities, for emg stream",
                    |port, _| {
                        let reason = match port.parse::<u16>() {
                            Ok(_) => CLASSES_ONLY,
                            Err(_) => "expected a UDP port up to 65535",
                        };
                        Err(source_error(&format!("{CLASSES_UDP}:{port}"), reason))
                    },
                ),
                scheme(
                    CLASSES_TCP,
                    SourceAddress::Required("HOST:PORT"),
                    "the same from a LibEMG with tcp=True",
                    |address, _| Err(source_error(&format!("{CLASSES_TCP}://{address}"), CLASSES_ONLY)),
                ),
            ],
        }
    }

    /// The same with one more.
    ///
    /// # Errors
    /// [`DeviceError::Source`] if there is one of its name.
    pub fn with(mut self, scheme: SourceScheme) -> Result<Self, DeviceError> {
        if self.schemes.iter().any(|known| known.scheme == scheme.scheme) {
            return Err(source_error(scheme.scheme, "there is one of this name: give yours another"));
        }
        self.schemes.push(scheme);
        Ok(self)
    }

    /// All of them, in their order.
    pub fn schemes(&self) -> &[SourceScheme] {
        &self.schemes
    }

    /// How they are named, in one line.
    pub fn all_syntaxes(&self) -> String {
        self.schemes.iter().map(SourceScheme::syntax).collect::<Vec<_>>().join(", ")
    }

    /// The kind of the source called `name`.
    ///
    /// # Errors
    /// [`DeviceError::UnknownSource`] with those that there are; an address where none belongs, or none where one does.
    pub fn find(&self, name: &SourceName) -> Result<&SourceScheme, DeviceError> {
        let fits = |scheme: &&SourceScheme| {
            scheme.scheme == name.scheme()
                && match scheme.address {
                    SourceAddress::None => name.address().is_empty(),
                    SourceAddress::Optional(_) => true,
                    SourceAddress::Required(_) => !name.address().is_empty(),
                }
        };
        let found = self.schemes.iter().find(fits);
        found.ok_or_else(|| DeviceError::UnknownSource { got: name.to_string(), known: self.all_syntaxes() })
    }

    /// Opens the source called `name`.
    ///
    /// # Errors
    /// As [`SourceRegistry::resolve_stream`]; what the source says.
    pub fn open(
        &self,
        name: &SourceName,
        options: &SourceOptions,
    ) -> Result<Box<dyn SampleSource>, DeviceError> {
        let source = (self.find(name)?.open)(name.address(), options)?;
        if options.imu && source.info().imu.is_empty() {
            let reason = "it has no inertial measurement unit, which --imu, or the model, asks for";
            return Err(source_error(&name.to_string(), reason));
        }
        Ok(source)
    }
}

impl Default for SourceRegistry {
    fn default() -> Self {
        Self::standard()
    }
}

fn source_error(name: &str, reason: &str) -> DeviceError {
    DeviceError::Source { name: name.to_owned(), reason: reason.to_owned() }
}

/// Files are played in packets as long as the armband's.
fn packet_samples(rate_hz: f64) -> usize {
    ((rate_hz * 0.016).round() as usize).max(1)
}

fn open_playback(path: &str, options: &SourceOptions) -> Result<Box<dyn SampleSource>, DeviceError> {
    let (path, pacing) = (Path::new(path), options.pacing());
    if path.is_file() {
        let recorded = read_recorded(path)?;
        let (name, rate) = (path.display().to_string(), recorded.rate_hz);
        return Ok(Box::new(PlaybackSource::new(
            &name,
            recorded.samples,
            rate,
            packet_samples(rate),
            pacing,
        )?));
    }
    let rate_hz = options.rate_hz.map(f64::from);
    let recordings =
        if options.imu { Recordings::open_with_imu(path, rate_hz) } else { Recordings::open(path, rate_hz) }?;
    let findings = recordings.check_faults(&[options.repetition], options.faults)?;
    let (gestures, packet) = (recordings.gestures(), packet_samples(recordings.rate_hz));
    let source = PlaybackSource::of_recordings(&recordings, options.repetition, &gestures, packet, pacing)?;
    Ok(Box::new(source.with_findings(findings)))
}

fn open_person(dir: &str, options: &SourceOptions) -> Result<Box<dyn SampleSource>, DeviceError> {
    options.person(&EmgOrigin::Recording {
        dir: PathBuf::from(dir),
        rate_hz: options.rate_hz.map(f64::from),
        // The classifier that comes with it is not used; any repetition will do.
        train_reps: vec![options.repetition],
        feed_reps: vec![options.repetition],
        fill: true,
        faults: options.faults,
    })
}

#[cfg(feature = "ble")]
fn open_ble(name: &str, options: &SourceOptions) -> Result<Box<dyn SampleSource>, DeviceError> {
    let connector = crate::gforce::BleConnector::new(name).map_err(crate::gforce::GForceError::from)?;
    Ok(Box::new(GForce::open(Box::new(connector), options.gforce_options())?))
}

#[cfg(not(feature = "ble"))]
fn open_ble(_name: &str, _options: &SourceOptions) -> Result<Box<dyn SampleSource>, DeviceError> {
    Err(source_error(
        "ble",
        "this proact was built without Bluetooth; set PROACT_FEATURES=ble for ./proact, or install libdbus-1-dev and \
         build with --features ble",
    ))
}

/// A Myo has one rate and one resolution.
fn open_myo<C: GattConnector + 'static>(
    connector: Result<C, LinkError>,
    options: &SourceOptions,
) -> Result<Box<dyn SampleSource>, DeviceError> {
    if let Some(rate_hz) = options.rate_hz.filter(|rate_hz| *rate_hz != MYO_HZ) {
        let expected = "200 Hz, the one rate of a Myo";
        return Err(DeviceError::Parameter { name: "--emg-rate", value: rate_hz.into(), expected });
    }
    let imu = options.imu;
    let open = connector.and_then(|connector| Myo::open(Box::new(connector), MyoEmgMode::default(), imu));
    Ok(Box::new(open.map_err(crate::gforce::GForceError::from)?))
}

#[cfg(feature = "ble")]
fn open_myo_ble(name: &str, options: &SourceOptions) -> Result<Box<dyn SampleSource>, DeviceError> {
    open_myo(crate::gforce::BleConnector::myo(name), options)
}

#[cfg(not(feature = "ble"))]
fn open_myo_ble(name: &str, options: &SourceOptions) -> Result<Box<dyn SampleSource>, DeviceError> {
    open_ble(name, options)
}

#[cfg(feature = "lsl")]
fn open_lsl(name: &str, options: &SourceOptions) -> Result<Box<dyn SampleSource>, DeviceError> {
    Ok(Box::new(crate::LslSource::open(Some(name).filter(|name| !name.is_empty()), options.imu)?))
}

#[cfg(not(feature = "lsl"))]
fn open_lsl(_name: &str, _options: &SourceOptions) -> Result<Box<dyn SampleSource>, DeviceError> {
    Err(source_error("lsl", crate::NO_LSL))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_are_told_by_their_names() {
        let registry = SourceRegistry::standard();
        for (text, scheme, address) in [
            ("gforce-sim://127.0.0.1:7410", "gforce-sim", "127.0.0.1:7410"),
            ("ble", "ble", ""),
            ("ble:gForce", "ble", "gForce"),
            ("myo-sim://127.0.0.1:7411", "myo-sim", "127.0.0.1:7411"),
            ("myo", "myo", ""),
            ("myo:left", "myo", "left"),
            ("lsl", "lsl", ""),
            ("lsl:my band", "lsl", "my band"),
            ("file:/a:b", "file", "/a:b"),
            ("person:recordings", "person", "recordings"),
            ("synthetic", "synthetic", ""),
            ("keys", "keys", ""),
            ("libemg-udp:12346", "libemg-udp", "12346"),
            ("libemg-tcp://127.0.0.1:12346", "libemg-tcp", "127.0.0.1:12346"),
        ] {
            let Ok(name) = text.parse::<SourceName>();
            assert_eq!((registry.find(&name).unwrap().scheme, name.address()), (scheme, address), "{text}");
        }
        for wrong in ["", "file:", "person:", "keys:x", "libemg-udp:", "usb", "gforce-sim"] {
            let Ok(name) = wrong.parse::<SourceName>();
            let error = registry.find(&name).err().unwrap().to_string();
            assert!(
                error.contains("expected one of gforce-sim://HOST:PORT, ble, ble:NAME, "),
                "{wrong:?}: {error}"
            );
        }
        let Ok(name) = "libemg-udp:70000".parse::<SourceName>();
        assert_eq!(name.libemg_endpoint(), None);
        let error = registry.open(&name, &SourceOptions::default()).err().unwrap().to_string();
        assert!(error.contains("up to 65535"), "{error}");
        for classes in ["libemg-udp:12346", "libemg-tcp://127.0.0.1:12346"] {
            let Ok(name) = classes.parse::<SourceName>();
            let error = registry.open(&name, &SourceOptions::default()).err().unwrap().to_string();
            assert!(
                error.contains("classes, not samples") && error.contains("person:FOLDER or keys"),
                "{error}"
            );
        }
    }

    #[test]
    fn a_laboratory_adds_a_kind_of_its_own_and_a_name_is_given_once() {
        fn open(address: &str, options: &SourceOptions) -> Result<Box<dyn SampleSource>, DeviceError> {
            assert_eq!(address, "left");
            options.person(&EmgOrigin::Synthetic)
        }
        let mine =
            SourceScheme { scheme: "myband", address: SourceAddress::Required("ARM"), help: "our own", open };
        let registry = SourceRegistry::standard().with(mine).unwrap();
        let Ok(name) = "myband:left".parse::<SourceName>();
        assert_eq!(registry.open(&name, &SourceOptions::default()).unwrap().info().channels, 8);
        assert!(registry.all_syntaxes().ends_with("myband:ARM"), "{}", registry.all_syntaxes());
        let error = registry.with(mine).err().unwrap().to_string();
        assert!(error.contains("myband") && error.contains("give yours another"), "{error}");
    }
}
