use proact_control::ControlError;
use proact_participants::OutOfRange;
use proact_types::{renamed_keys::DuplicateKey, shorten_numbers};

/// Why a configuration is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ConfigError {
    /// A method that needs gaze, in a trial without it.
    #[error(
        "method {method:?} needs gaze, and this trial has none (gaze = false): give it a source of gaze, or choose a method \
         that does without"
    )]
    NoGaze {
        /// The method.
        method: String,
    },
    /// A part of another name than the trial's.
    #[error("{kind} is {got:?}, the trial's is {expected:?}")]
    NameMismatch {
        /// `arm` or `task`.
        kind: &'static str,
        /// What the trial names.
        expected: String,
        /// What was given.
        got: String,
    },
    /// A part of the trial's name with another content.
    #[error(
        "{kind} {name:?} is another one here (hash {got}...) than the one that the trial was made with \
         ({expected}...): take the {kind}, or the program, of that time"
    )]
    ContentMismatch {
        /// `arm` or `task`.
        kind: &'static str,
        /// Its name.
        name: String,
        /// Beginning of the recorded hash.
        expected: String,
        /// Beginning of the hash of what is here.
        got: String,
    },
    /// A right arm in a set-up for a left one, or the other way round.
    #[error(
        "arm {arm:?} is a {side} arm and the set-up is for a {got} one; expected setup.side = \"{side}\" with the body \
         mirrored, as `proact demo --arm` makes it"
    )]
    SideMismatch {
        /// The arm.
        arm: String,
        /// Its side.
        side: &'static str,
        /// The side of the set-up.
        got: &'static str,
    },
    /// No such planner.
    #[error("planner is \"{got}\", expected one of {known}")]
    Planner {
        /// What was asked for.
        got: String,
        /// What there is.
        known: String,
    },
    /// No such set-up.
    #[error("set-up {got:?} is unknown; expected seated or still")]
    Setup {
        /// What was asked for.
        got: String,
    },
    /// What should be a key and its value is not.
    #[error("{got:?} sets nothing; expected KEY=VALUE such as profile.level=below_elbow")]
    InvalidAssignment {
        /// What was given.
        got: String,
    },
    /// A key that does not exist, or a value that it cannot have.
    #[error("cannot set {}: {reason}", shorten_numbers(got))]
    RefusedAssignment {
        /// What was given.
        got: String,
        /// Why not, and what there is.
        reason: String,
    },
    /// A value is outside its range.
    #[error("{key} = {}, expected {expected}", shorten_numbers(got))]
    Value {
        /// Such as `limit_secs`.
        key: &'static str,
        /// What was given.
        got: String,
        /// What is allowed.
        expected: &'static str,
    },
    /// No such profile or method, or two that do not fit.
    #[error(transparent)]
    Control(#[from] ControlError),
    /// The task.
    #[error(transparent)]
    Task(#[from] proact_tasks::TaskError),
    /// The intent model refuses its options.
    #[error(transparent)]
    Intent(#[from] proact_intent::IntentError),
    /// The EMG stage refuses its settings.
    #[error(transparent)]
    Emg(#[from] proact_emg::EmgError),
    /// Settings of who or what has no part in the trial.
    #[error("{key} is set, but {why}: leave it out")]
    UnusedSettings {
        /// Such as `participant`.
        key: &'static str,
        /// Why it has no part.
        why: &'static str,
    },
    /// A number of the participant is out of range.
    #[error(transparent)]
    Participant(#[from] OutOfRange),
    /// A key by its old and its new name.
    #[error(transparent)]
    DuplicateKey(#[from] DuplicateKey),
    /// The text is not a configuration.
    #[error("the trial configuration is unreadable: {0}")]
    Text(String),
}
