use crate::gforce::GForceError;
use proact_emg::{EmgError, RecordingFault};
use proact_types::{Command, CommandMapError, Gesture};
use std::path::PathBuf;

/// Why a source could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DeviceError {
    /// The folder or a file in it cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// Which one.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// There is a file where a folder is expected.
    #[error("{} is a file, expected a folder with EMG recordings", path.display())]
    NotAFolder {
        /// As given.
        path: PathBuf,
    },
    /// No file of a known layout.
    #[error(
        "{} has no EMG recordings; expected R_<rep>_C_<class>.csv (LibEMG) or 0.txt, 1.txt, 2.txt, 7.txt \
         (myo_readings)", path.display()
    )]
    NoRecordings {
        /// The folder.
        path: PathBuf,
    },
    /// A folder of folders: which person and session is meant is for the user to say.
    #[error(
        "{} holds several sessions, expected one; name one of them: {}",
        path.display(), sessions.join(", ")
    )]
    ManySessions {
        /// The folder.
        path: PathBuf,
        /// Names of the folders in it that hold recordings.
        sessions: Vec<String>,
    },
    /// A class number without a gesture.
    #[error(
        "{}: class {class} has no name; known are {known}; metadata.json beside the recordings names all classes, as \
         {{\"class_map\": {{\"0\": \"fist\", \"1\": \"relax\"}}, \"rest\": \"relax\"}}", path.display()
    )]
    UnknownClass {
        /// The file.
        path: PathBuf,
        /// The number in its name.
        class: u32,
        /// Numbers and names that there are.
        known: String,
    },
    /// A recording of a gesture that its folder does not list.
    #[error("{} is not for recordings of {gesture}", path.display())]
    GestureNotListed {
        /// The folder.
        path: PathBuf,
        /// The gesture.
        gesture: Gesture,
    },
    /// Gestures without any recording that nothing else can make.
    #[error(
        "{} has no recording of {}, and synthetic EMG has figures for {} only: record it",
        path.display(), join_names(missing), join_names(&Command::ALL.map(Gesture::from))
    )]
    NotSynthesizable {
        /// The folder.
        path: PathBuf,
        /// Which are lacking.
        missing: Vec<Gesture>,
    },
    /// A file about the recordings that cannot be used.
    #[error("{}: {reason}", path.display())]
    Metadata {
        /// The file.
        path: PathBuf,
        /// What stands there and what was expected.
        reason: String,
    },
    /// Settings for another stream than the source's.
    #[error(
        "emg.rate_hz and emg.channels are {} and {}, the stream has {} and {}: it says itself what it has",
        asked.0, asked.1, stream.0, stream.1
    )]
    StreamMismatch {
        /// Rate in hertz and channels of the settings.
        asked: (f64, usize),
        /// Those of the stream.
        stream: (f64, usize),
    },
    /// Nobody says how fast the recordings are.
    #[error(
        "{} does not say its rate, and its samples are not a Myo's (eight signed bytes, 200 Hz): give it with --emg-rate \
         HZ, or write metadata.json beside the recordings, as {{\"rate_hz\": 1000}}", path.display()
    )]
    UnknownRate {
        /// The folder.
        path: PathBuf,
    },
    /// The folder says another rate than was asked for.
    #[error("{} was recorded at {recorded_hz} Hz by its metadata, asked for was {asked_hz} Hz; leave the rate out", path.display())]
    RateDisagrees {
        /// The folder.
        path: PathBuf,
        /// By its metadata.
        recorded_hz: f64,
        /// As asked for.
        asked_hz: f64,
    },
    /// Two files for the same repetition of the same gesture.
    #[error("{} repeats repetition {repetition} of {gesture}", path.display())]
    Duplicate {
        /// The second file.
        path: PathBuf,
        /// Which repetition.
        repetition: u32,
        /// Which gesture.
        gesture: Gesture,
    },
    /// A row with another number of columns.
    #[error("{}, row {row}: {got} columns, expected {expected}", path.display())]
    Columns {
        /// The file.
        path: PathBuf,
        /// Counted from 1.
        row: usize,
        /// Columns in this row.
        got: usize,
        /// Such as `8 as in the files before`.
        expected: String,
    },
    /// Something that is no finite number.
    #[error("{}, row {row}, column {column}: {text:?}, expected a finite number", path.display())]
    NotANumber {
        /// The file.
        path: PathBuf,
        /// Counted from 1.
        row: usize,
        /// Counted from 1.
        column: usize,
        /// What stands there.
        text: String,
    },
    /// A label that does not belong into a file of this name.
    #[error("{}, row {row}: label {label}, expected 0 or {expected}", path.display())]
    Label {
        /// The file.
        path: PathBuf,
        /// Counted from 1.
        row: usize,
        /// What stands there.
        label: f64,
        /// The file's own label.
        expected: u32,
    },
    /// A file without samples.
    #[error("{} has no samples", path.display())]
    EmptyFile {
        /// The file.
        path: PathBuf,
    },
    /// Gestures without any recording.
    #[error(
        "{} has no recording of {}; record it, or complete the set with --fill-missing synthetic",
        path.display(), join_names(missing)
    )]
    MissingGestures {
        /// The folder.
        path: PathBuf,
        /// Which are lacking.
        missing: Vec<Gesture>,
    },
    /// A repetition that was asked for is not there.
    #[error("no repetition {repetition} of {gesture}; there are {}", join_numbers(available))]
    MissingRepetition {
        /// As asked for.
        repetition: u32,
        /// Of this gesture.
        gesture: Gesture,
        /// Those that exist.
        available: Vec<u32>,
    },
    /// No repetitions were asked for.
    #[error("no repetitions to {purpose} were named, expected at least one, such as 0")]
    NoRepetitions {
        /// `train on`, `test on` or `feed`.
        purpose: &'static str,
    },
    /// What is tested was trained on.
    #[error(
        "repetition {} is both trained and tested on, which measures nothing: name different ones",
        join_numbers(repetitions)
    )]
    TrainTestOverlap {
        /// Which repetitions.
        repetitions: Vec<u32>,
    },
    /// Recordings with findings that make an accuracy wrong.
    #[error(
        "the recordings in {} are not fit to train on or to test with:{}\ncorrect the files, record again or leave repetitions out, \
         or use them all the same with --accept-faults; --json, a model file and a trial's configuration record it",
        path.display(), lines(findings)
    )]
    FaultyRecordings {
        /// The folder or file.
        path: PathBuf,
        /// All findings, worst first.
        findings: Vec<RecordingFault>,
    },
    /// A recording that does not fill one window.
    #[error("{} has {samples} samples, expected at least {window}, one window", path.display())]
    TooShort {
        /// The file.
        path: PathBuf,
        /// Samples in it.
        samples: usize,
        /// Samples of a window.
        window: usize,
    },
    /// The synthetic generator has fewer channels than the stream.
    #[error(
        "synthetic EMG has at most {most} channels, the recordings have {channels}; they cannot be mixed"
    )]
    SyntheticChannels {
        /// Channels of the stream.
        channels: usize,
        /// Channels of the fitted figures.
        most: usize,
    },
    /// Fitted figures that are no covariance.
    #[error("the figures of synthetic {gesture} are unusable: {reason}")]
    SyntheticModel {
        /// Which gesture.
        gesture: Command,
        /// One sentence.
        reason: String,
    },
    /// A parameter that is no usable number.
    #[error("{name} is {value}, expected {expected}")]
    Parameter {
        /// Such as `EMG rate`.
        name: &'static str,
        /// As given.
        value: f64,
        /// What is usable.
        expected: &'static str,
    },
    /// Samples to be played whose counter does not rise.
    #[error("{name}: counter {got} after {before}, expected a higher one")]
    CounterNotRising {
        /// Which recording.
        name: String,
        /// The counter before.
        before: u64,
        /// The one that follows.
        got: u64,
    },
    /// The file of a program that decodes EMG cannot be used.
    #[error("{}: {reason}; docs/emg.md has an example", path.display())]
    DecoderFile {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A program that decodes EMG does not begin.
    #[error(
        "the program that decodes EMG does not start ({command}): {reason}; docs/emg.md says what it reads and writes"
    )]
    DecoderStart {
        /// The program and its arguments.
        command: String,
        /// Why.
        reason: String,
    },
    /// A program that decodes EMG gives no answer that can be used.
    #[error("the program that decodes EMG: {reason}")]
    Decoder {
        /// Why.
        reason: String,
    },
    /// A file cannot be written.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// Which one.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// A recording of a format that is not known.
    #[error("{}: unknown format, expected a name that ends in .csv or .edf", path.display())]
    RecordFormat {
        /// As given.
        path: PathBuf,
    },
    /// A recording that cannot be read back.
    #[error("{}: {reason}", path.display())]
    InvalidRecording {
        /// The file.
        path: PathBuf,
        /// What stands where, and what was expected.
        reason: String,
    },
    /// A datagram that is none of LibEMG's messages.
    #[error(
        "got the message {text:?}, expected \"class\" or \"class velocity\", class -1 to {most}, velocity 0 to 1, or a \
         probability for each class from 0 to {most}"
    )]
    LibEmgMessage {
        /// The highest class that is known.
        most: usize,
        /// What came, at most 40 bytes.
        text: String,
    },
    /// A datagram that is no gaze sample.
    #[error(
        "not a gaze sample: {reason}; expected {{\"origin\": [x, y, z], \"direction\": [x, y, z]}} or 56 bytes \
         that begin with PGZ1"
    )]
    GazeMessage {
        /// What is wrong with it.
        reason: String,
    },
    /// A packet is none of a virtual modular prosthetic limb.
    #[error("vMPL packet: {reason}")]
    VmplPacket {
        /// What is wrong with it.
        reason: String,
    },
    /// A socket for datagrams cannot be used.
    #[error("UDP {address}: {source}")]
    Udp {
        /// Which one.
        address: String,
        /// What the system says.
        source: std::io::Error,
    },
    /// A connection cannot be used.
    #[error("TCP {address}: {source}")]
    Tcp {
        /// To whom.
        address: String,
        /// What the system says.
        source: std::io::Error,
    },
    /// A stream of the lab streaming layer cannot be used.
    #[error("lab streaming layer, {stream:?}: {reason}")]
    Lsl {
        /// Name or type asked for.
        stream: String,
        /// What is wrong with it.
        reason: String,
    },
    /// No such kind of source.
    #[error("source {got:?} is unknown; expected one of {known}")]
    UnknownSource {
        /// What was asked for.
        got: String,
        /// What there is.
        known: String,
    },
    /// A source of samples cannot be used.
    #[error("source {name}: {reason}")]
    Source {
        /// Which one.
        name: String,
        /// Why not.
        reason: String,
    },
    /// A motion capture system cannot be used.
    #[error("motion capture {name}: {reason}")]
    Capture {
        /// Which one.
        name: String,
        /// Why not.
        reason: String,
    },
    /// What makes cues heard or felt cannot be used.
    #[error("feedback {sink}: {reason}")]
    Sink {
        /// Which one.
        sink: String,
        /// Why not.
        reason: String,
    },
    /// An armband cannot be used.
    #[error(transparent)]
    GForce(#[from] GForceError),
    /// Gestures and commands that do not go together.
    #[error(transparent)]
    Gestures(#[from] CommandMapError),
    /// The classifier cannot be trained on these recordings, or the settings cannot work.
    #[error("EMG: {0}")]
    Emg(#[from] EmgError),
}

fn join_names(gestures: &[Gesture]) -> String {
    gestures.iter().map(Gesture::as_str).collect::<Vec<_>>().join(", ")
}

fn join_numbers(values: &[u32]) -> String {
    match values {
        [] => "none".to_owned(),
        _ => values.iter().map(u32::to_string).collect::<Vec<_>>().join(", "),
    }
}

/// What makes an accuracy wrong, one finding a line.
fn lines(findings: &[RecordingFault]) -> String {
    crate::accepted_fault_texts(findings).iter().map(|finding| format!("\n  - {finding}")).collect()
}
