//! What the calibration page shows.

use proact_emg::{
    CalibrationPhase, CalibrationReport, ChannelStatus, CursorReport, HoldReport, MotionReport,
    SequenceReport, StreamQuality, TacAxis, TacPhase, TacReport,
};
use proact_types::Gesture;
use serde::Serialize;
use serde_json::Value;

/// A message to the calibration page.
#[derive(Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(tag = "type", rename_all = "snake_case")]
pub(crate) enum CalibrationMessage<'a> {
    /// There is nothing to show yet.
    Nothing,
    /// The page's last command was ignored.
    Error { message: &'a str },
    /// All that there is to show.
    #[serde(untagged)]
    Screen(&'a CalibrationScreen<'a>),
}

impl CalibrationMessage<'_> {
    /// As JSON text, the keys in alphabetical order.
    pub(crate) fn to_text(&self) -> String {
        serde_json::to_value(self)
            .expect("plain structs with string keys always serialise; non-finite numbers become null")
            .to_string()
    }
}

/// All that the calibration page shows: a page that reloads loses nothing.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct CalibrationScreen<'a> {
    /// Where the EMG comes from.
    pub source: &'a str,
    /// The last sentences to the person, oldest first.
    pub messages: &'a [String],
    /// The button that begins was pressed.
    pub begun: bool,
    /// An object with the result at the end; null before.
    #[cfg_attr(feature = "ts", ts(type = "Record<string, unknown> | null"))]
    pub result: &'a Value,
    /// What is going on.
    #[serde(flatten)]
    pub view: CalibrationView<'a>,
}

/// What is going on at the calibration page.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum CalibrationView<'a> {
    /// Gestures are recorded.
    Calibration {
        /// What the session is doing.
        phase: CalibrationPhase,
        /// The position of the limb that is asked for; none if none is.
        position: Option<&'a str>,
        /// Complete rounds.
        rounds: usize,
        /// Rounds after which no more are offered.
        #[serde(rename = "most_rounds")]
        max_rounds: usize,
        /// The gestures of a round.
        gestures: &'a [Gesture],
        /// Share of windows that has to be recognised, 0 to 1.
        target_accuracy: f64,
        /// R2 that each degree of freedom of a regressor has to reach, at most 1.
        target_r2: f64,
        /// The electrodes.
        channels: Vec<ElectrodeView>,
        /// The stream as a whole.
        stream: &'a StreamQuality,
        /// On the rounds so far; none before the second.
        report: Option<&'a CalibrationReport>,
        /// A round is over, and it waits for a command.
        reviewing: bool,
    },
    /// A test comes next, when the person begins it.
    Ready {
        /// Which.
        next: TestKind,
    },
    /// Gestures are asked for, to test a model.
    Test {
        /// Which test, and how it goes.
        #[serde(flatten)]
        test: GestureTest<'a>,
        /// The gesture asked for.
        prompt: Option<Gesture>,
        /// The gesture in force.
        in_force: Gesture,
    },
    /// The motion test: each motion is made until enough decisions were right, or time is up.
    Motion {
        /// The gesture asked for: rest before each motion.
        prompt: Gesture,
        /// The hand has yet to relax.
        relaxing: bool,
        /// The gesture in force.
        in_force: Gesture,
        /// Right decisions of this motion.
        #[serde(rename = "right")]
        correct_decisions: usize,
        /// As many complete it.
        #[serde(rename = "needed")]
        required_decisions: usize,
        /// Time that is left for it, seconds.
        #[serde(rename = "left_secs")]
        remaining_secs: f64,
        /// Of so much.
        limit_secs: f64,
        /// How it goes.
        report: &'a MotionReport,
    },
    /// Target achievement control: joints of a virtual limb are brought to a target and held there.
    Tac {
        /// What has to go where.
        axes: Vec<TacAxisState<'a>>,
        /// What it waits for.
        phase: TacPhase,
        /// The gesture in force.
        in_force: Gesture,
        /// Share of the dwell time that is over, 0 to 1.
        #[serde(rename = "dwelt")]
        dwell_progress: f64,
        /// Time that is left for the target, seconds.
        #[serde(rename = "left_secs")]
        remaining_secs: f64,
        /// Of so much.
        limit_secs: f64,
        /// How it goes.
        report: &'a TacReport,
    },
    /// A cursor is steered into targets. Places in units of half the picture: x to the right, y up, -1 to 1.
    Cursor {
        /// Where the cursor is.
        cursor: [f64; 2],
        /// Centre of the target.
        target: [f64; 2],
        /// Diameter of the target.
        width: f64,
        /// Share of the dwell time that is over, 0 to 1.
        #[serde(rename = "dwelt")]
        dwell_progress: f64,
        /// The gesture in force.
        in_force: Gesture,
        /// How hard it is made, 0 to 1.
        effort: f64,
        /// How it goes.
        report: &'a CursorReport,
        /// The test is over.
        finished: bool,
    },
    /// The program ends.
    End,
}

/// A test of a model with prompted gestures, and how it goes.
#[derive(Clone, Copy, Debug, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(tag = "test", content = "report", rename_all = "snake_case")]
pub enum GestureTest<'a> {
    /// Sequences without a mistake.
    Sequence(&'a SequenceReport),
    /// The longer trial.
    Trial(&'a HoldReport),
}

/// The tests of a model that the page shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(rename_all = "snake_case")]
pub enum TestKind {
    /// Sequences without a mistake.
    Sequence,
    /// The longer trial.
    Trial,
    /// The motion test.
    Motion,
    /// Target achievement control of one joint after the other.
    Tac1,
    /// The same of several joints together.
    Tac3,
    /// Pointing with a cursor.
    Cursor,
}

/// An axis of the virtual limb during a trial.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct TacAxisState<'a> {
    /// Its name, range, tolerance and gestures.
    pub axis: &'a TacAxis,
    /// Where it is, degrees or per cent of a grasp.
    pub position: f64,
    /// Where it should be.
    pub target: f64,
}

/// What is shown of an electrode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct ElectrodeView {
    /// The verdict.
    #[serde(rename = "light")]
    pub status: ChannelStatus,
    /// What is wrong, for the person; none if nothing is.
    pub fault: Option<&'static str>,
}
