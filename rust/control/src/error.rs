use proact_types::format_number;

/// Why a method cannot be built.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ControlError {
    /// No such method.
    #[error("method {got:?} is unknown; expected one of {known}")]
    Method {
        /// What was asked for.
        got: String,
        /// What there is.
        known: String,
    },
    /// There is a method of this name already.
    #[error("method {got:?} exists already, among {known}: give yours another name")]
    DuplicateMethod {
        /// The name.
        got: String,
        /// What there is.
        known: String,
    },
    /// A name or a text of a method cannot be shown.
    #[error("method: {key} = {got:?}, expected {expected}")]
    MethodText {
        /// Such as `name`.
        key: &'static str,
        /// What was given.
        got: String,
        /// What is allowed.
        expected: &'static str,
    },
    /// The text is not the file of a method.
    #[error("the method file is unreadable: {0}")]
    MethodFile(String),
    /// A number or a word of an outside method cannot be.
    #[error("method_process.{key} = {got}, expected {expected}")]
    Program {
        /// Such as `deadline_ms`.
        key: &'static str,
        /// What was given.
        got: String,
        /// What is allowed.
        expected: &'static str,
    },
    /// The program of a trial is another method.
    #[error("method is {method:?}, but method_process.info is that of {program:?}: give both the same name")]
    ProgramMismatch {
        /// What the trial names.
        method: String,
        /// What its program is called.
        program: String,
    },
    /// No such profile.
    #[error("profile {got:?} is unknown; expected default, original, or the text of one")]
    Profile {
        /// What was asked for.
        got: String,
    },
    /// The text is not a profile.
    #[error("the profile is unreadable: {0}")]
    Text(String),
    /// A number is outside its range.
    #[error("profile: {key} = {}, expected {expected}", format_number(*got))]
    Value {
        /// Such as `joint_jog.speed_rad_per_s`.
        key: &'static str,
        /// What was given.
        got: f64,
        /// What is allowed.
        expected: &'static str,
    },
    /// A name that the profile uses does not exist.
    #[error("profile: {kind} {got:?} is unknown; expected one of {known}")]
    Name {
        /// `joint` or `level`.
        kind: &'static str,
        /// What was given.
        got: String,
        /// What there is.
        known: String,
    },
    /// Two degrees of freedom move the same thing.
    #[error(
        "profile: jog.simultaneous.drives.\"{drive}\" moves {moves}, which another moves already; expected each once"
    )]
    DuplicateDrive {
        /// The second of them.
        drive: String,
        /// What both move.
        moves: String,
    },
    /// The EMG model and the profile do not go together.
    #[error("profile: {reason}")]
    Drives {
        /// What each has, and what to do.
        reason: String,
    },
    /// The method and the profile do not go together.
    #[error("method {method} {reason}")]
    Unsupported {
        /// The method.
        method: String,
        /// Why not, and what to do.
        reason: &'static str,
    },
}
