use crate::WindowLength;
use crate::feature::known_names;
use proact_types::{DegreeOfFreedom, Gesture, MAX_EMG_CHANNELS, MAX_GESTURES, format_number};

/// What can be wrong with settings, training data or features.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EmgError {
    /// No usable sample rate.
    #[error("EMG rate is {} Hz, expected 1 to 1000000", format_number(*rate_hz))]
    Rate {
        /// As given.
        rate_hz: f64,
    },
    /// Positions of the limb that nobody could tell apart.
    #[error(
        "positions of the limb are {got:?}, expected names of 1 to 64 bytes without control characters, each once"
    )]
    Positions {
        /// As given.
        got: Vec<String>,
    },
    /// Channels of an inertial measurement unit that cannot be, or cannot be learnt from.
    #[error("inertial measurement unit (emg.imu): {reason}")]
    Imu {
        /// What is wrong.
        reason: String,
    },
    /// No usable number of channels.
    #[error("EMG stream has {got} channels, expected 1 to {MAX_EMG_CHANNELS}")]
    ChannelCount {
        /// As given.
        got: usize,
    },
    /// A window or an increment of no usable length.
    #[error(
        "{length:?} is {} samples at {rate_hz} Hz, expected at least 3 for a window, 5 with SAMPEN or FUZZYEN, 6 with AR4 or CC, \
         at least 1 for an increment, and at most 600000 for either",
        format_number(*samples)
    )]
    Length {
        /// As given.
        length: WindowLength,
        /// Rate of the stream.
        rate_hz: f64,
        /// In samples.
        samples: f64,
    },
    /// Windows come too rarely for the allowed age.
    #[error(
        "the stream would count as stale after {stale_timeout_ms} ms, but windows come only every \
         {increment_millis} ms, expected no more than stale_timeout_ms: raise it or shorten the increment"
    )]
    StaleTimeout {
        /// As given.
        stale_timeout_ms: u64,
        /// Time between two windows.
        increment_millis: f64,
    },
    /// A feature that has no value on such a stream.
    #[error("{feature} has no value on a stream of {channels} channels at {rate_hz} Hz: {needs}")]
    EmptyFeature {
        /// LibEMG's name.
        feature: &'static str,
        /// Channels of the stream.
        channels: usize,
        /// Rate of the stream.
        rate_hz: f64,
        /// What it needs.
        needs: &'static str,
    },
    /// A filter that cannot be.
    #[error("EMG filter {filter}: {reason}")]
    Filter {
        /// As given.
        filter: String,
        /// Why not.
        reason: String,
    },
    /// No such criterion of selection.
    #[error(
        "{name:?} is no criterion; known are accuracy active_error mean_semi_principal_axis feature_efficiency repeatability \
         separability"
    )]
    UnknownCriterion {
        /// As given.
        name: String,
    },
    /// No such classifier.
    #[error("{name:?} is no classifier; known are lda qda nb knn svm rf linear ridge two_site")]
    UnknownClassifier {
        /// As given.
        name: String,
    },
    /// A class whose windows give no covariance to invert.
    #[error(
        "the {windows} windows of class {class} give no covariance of {features} features that can be inverted{}: record \
         more windows, take fewer features, or use lda or nb",
        .feature.map_or(String::new(), |f| format!(" (feature {f} does not vary by itself)"))
    )]
    SingularClass {
        /// Its number, by name.
        class: usize,
        /// Windows of it.
        windows: usize,
        /// Features of a window.
        features: usize,
        /// The first feature that is constant or told by those before it.
        feature: Option<usize>,
    },
    /// Adaptation of another classifier than LDA.
    #[error(
        "adaptation follows the user of lda only, this model has {kind}; train with lda or switch adaptation off"
    )]
    AdaptsLdaOnly {
        /// Of the model.
        kind: crate::ClassifierKind,
    },
    /// A gesture drives two degrees of freedom, or is the relaxed hand.
    #[error(
        "the degree of freedom {drive} of emg.regression.drives has {gesture}, which is {}; expected different gestures \
         for each, none of them the rest gesture",
        if *rests { "the rest gesture" } else { "another's already" }
    )]
    DuplicateDriveGesture {
        /// The gesture.
        gesture: Gesture,
        /// The degree of freedom that has it too.
        drive: String,
        /// It is that of the relaxed hand.
        rests: bool,
    },
    /// No recording of a gesture that a degree of freedom is driven by.
    #[error(
        "the training data has no {gesture}, which the degree of freedom {drive} needs; it has {}: record it, or name the \
         degrees of freedom that there are with --drives or emg.regression.drives",
        names(known)
    )]
    NoDriveGesture {
        /// The gesture that is missing.
        gesture: String,
        /// The degree of freedom that it drives.
        drive: String,
        /// Gestures of the training data.
        known: Vec<Gesture>,
    },
    /// Recordings of a gesture that drives nothing.
    #[error(
        "the training data has {gesture}, which drives none of the degrees of freedom {}: name its degree of freedom with \
         --drives or emg.regression.drives, or leave its recordings out",
        drives.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
    )]
    UnpairedGesture {
        /// The gesture.
        gesture: Gesture,
        /// The degrees of freedom.
        drives: Vec<DegreeOfFreedom>,
    },
    /// Direct control by two sites cannot be.
    #[error("emg.two_site: {reason}")]
    TwoSite {
        /// What was given, what was expected, and what to do.
        reason: String,
    },
    /// Windows cannot be rejected by a probability that there is not.
    #[error(
        "emg.rejection_threshold is set, but {kind} gives no probability of a gesture to reject windows by: leave it out"
    )]
    RejectionWithoutPosterior {
        /// What decodes.
        kind: crate::ClassifierKind,
    },
    /// Settings of a classifier with a regressor, or the other way round.
    #[error(
        "emg.classifier is {requested}, but the model is {trained}: leave the setting to the model, or train anew"
    )]
    ClassifierMismatch {
        /// In the settings.
        requested: crate::ClassifierKind,
        /// Of the model.
        trained: crate::ClassifierKind,
    },
    /// A decoder in another process that cannot be.
    #[error("emg.process: {reason}")]
    Process {
        /// What is wrong.
        reason: String,
    },
    /// A classifier that is another process cannot be had by itself.
    #[error(
        "a process decodes the windows, which this cannot {what} by itself: make a model with proact emg train --classifier \
         process --decoder-process FILE, and give that with --emg-model or --model"
    )]
    NeedsProcess {
        /// Such as `train`.
        what: &'static str,
    },
    /// As many labels as windows are needed.
    #[error("got {labels} labels for {windows} windows, expected one each")]
    LabelCount {
        /// Windows handed in.
        windows: usize,
        /// Labels handed in.
        labels: usize,
    },
    /// A feature vector of another length.
    #[error("got {got} features, expected {expected}")]
    FeatureCount {
        /// Values handed in.
        got: usize,
        /// Values expected.
        expected: usize,
    },
    /// A feature, or what was computed from it, is NaN or infinite.
    #[error("feature {index} of window {window} is {value}, expected a finite number")]
    NotFinite {
        /// Index of the window; zero when there is only one.
        window: usize,
        /// Index in the feature vector.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// A classifier needs at least two gestures to tell apart.
    #[error("training data has {got} different gestures, a classifier needs at least 2")]
    TooFewClasses {
        /// Different gestures.
        got: usize,
    },
    /// More gestures than a classifier takes.
    #[error("training data has {got} different gestures, a classifier tells at most {MAX_GESTURES} apart")]
    TooManyClasses {
        /// Different gestures.
        got: usize,
    },
    /// Nothing would stop the arm.
    #[error(
        "the rest gesture is {rest}, which the model does not know; it has {}: name one of them as the setting rest",
        names(known)
    )]
    NoRest {
        /// The rest gesture of the settings.
        rest: Gesture,
        /// The gestures of the classifier.
        known: Vec<Gesture>,
    },
    /// The covariance within the classes cannot be estimated.
    #[error("training data has {windows} windows of {classes} gestures, at least {} are needed", classes + 1)]
    TooFewWindows {
        /// Windows handed in.
        windows: usize,
        /// Different gestures.
        classes: usize,
    },
    /// A class number beyond the number of classes, or a class without windows.
    #[error("class {class} of {classes} classes has {windows} windows, expected at least one")]
    EmptyClass {
        /// The class.
        class: usize,
        /// Number of classes.
        classes: usize,
        /// Windows with this label.
        windows: usize,
    },
    /// Nothing varies within any class, as from a dead device.
    #[error("no feature varies within any gesture: the recording is constant")]
    NoVariance,
    /// The singular value decomposition did not converge.
    #[error("the singular value decomposition of the training data did not converge")]
    NoConvergence,
    /// The classifier was trained for another stream.
    #[error("the classifier was trained on {trained} channels, the stream has {stream}")]
    ClassifierChannels {
        /// Channels at training.
        trained: usize,
        /// Channels of the stream.
        stream: usize,
    },
    /// A sample of a recording cannot be used.
    #[error("sample {counter} is unusable: {channels} channels, expected {expected} finite numbers")]
    BadSample {
        /// The sample's counter.
        counter: u64,
        /// Its number of channels.
        channels: usize,
        /// Channels of the stream.
        expected: usize,
    },
    /// A gesture that the classifier was not trained on.
    #[error("the classifier was not trained on {0}")]
    NotTrained(Gesture),
    /// A feature or group that does not exist.
    #[error("{name:?} is no EMG feature or group; known are {}", known_names())]
    UnknownFeature {
        /// As given.
        name: String,
    },
    /// An empty list of features.
    #[error("the list of EMG features is empty, expected at least one")]
    NoFeatures,
    /// A threshold outside its range.
    #[error("{name} is {}, expected {expected}", format_number(*value))]
    OutOfRange {
        /// Which one.
        name: &'static str,
        /// As given.
        value: f64,
        /// The range.
        expected: &'static str,
    },
    /// The effort scale of a gesture is not known: it was trained without amplitudes, on features without MAV.
    #[error("the effort scale is not known: the classifier was trained on {features} without amplitudes")]
    NoEffortScale {
        /// The features.
        features: String,
    },
    /// Zero levels that do not fit the stream.
    #[error("got {got} zero levels, expected {expected} finite numbers, one a channel, or none")]
    DcOffsetCount {
        /// Levels handed in.
        got: usize,
        /// Channels of the stream.
        expected: usize,
    },
    /// A model that was trained on another stream.
    #[error("the model does not fit the stream: {reasons}; calibrate again or choose another model")]
    StreamMismatch {
        /// All of them.
        reasons: String,
    },
    /// Settings that a trained model cannot take.
    #[error(
        "{key} is {requested}, the model was trained with {trained}; train another one (proact emg train)"
    )]
    TrainingMismatch {
        /// The setting, as in the configuration of a trial.
        key: &'static str,
        /// What was asked for.
        requested: String,
        /// What the training had.
        trained: String,
    },
    /// A model that cannot be used.
    #[error("the EMG model cannot be used: {reason}")]
    ModelFile {
        /// What is wrong.
        reason: String,
    },
    /// A calibration cannot be judged by leaving one repetition out.
    #[error("{gesture} has {got} repetitions, at least 2 are needed to test each on the others")]
    TooFewRepetitions {
        /// Which gesture.
        gesture: Gesture,
        /// Its repetitions.
        got: usize,
    },
    /// A calibration asks for a gesture twice in a round.
    #[error("{gesture} is asked for twice in a round, expected each gesture once")]
    RepeatedGesture {
        /// Which gesture.
        gesture: Gesture,
    },
    /// A repetition with too long a gap, too many, or a counter that falls.
    #[error("the repetition has sample {next} after {after}, expected rising counters and short, rare gaps")]
    Gap {
        /// Counter before the gap.
        after: u64,
        /// Counter after it.
        next: u64,
    },
    /// A repetition that is shorter than a window.
    #[error("the repetition of {gesture} has {got} samples, expected at least {expected}, one window")]
    ShortRepetition {
        /// Which gesture.
        gesture: Gesture,
        /// Its samples.
        got: usize,
        /// Samples of a window.
        expected: usize,
    },
    /// The position of the band cannot be told.
    #[error("got {got} gesture besides no motion for the band check, expected at least 2 different ones")]
    TooFewBandGestures {
        /// Different gestures other than no motion.
        got: usize,
    },
}

fn names(gestures: &[Gesture]) -> String {
    gestures.iter().map(Gesture::as_str).collect::<Vec<_>>().join(", ")
}
