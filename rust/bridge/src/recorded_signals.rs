//! What the muscles said in a recorded trial, for plots over time beside the replay.

use proact_types::{Gesture, SimTime};
use serde::Serialize;

/// EMG of a recorded trial, thinned for a picture, and what the EMG model made of it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct RecordedEmg {
    /// Nominal sampling rate, hertz.
    pub rate_hz: f64,
    /// Length of a step of `lowest` and `highest`, milliseconds; the first begins at zero.
    #[cfg_attr(feature = "ts", ts(type = "number"))]
    pub step_ms: u64,
    /// Lowest value of each channel in each step, `[n_steps][n_channels]`, in the device's unit; a step without samples is empty.
    pub lowest: Vec<Vec<f64>>,
    /// The highest ones.
    pub highest: Vec<Vec<f64>>,
    /// The gestures that the model tells apart.
    pub gestures: Vec<Gesture>,
    /// What it made of each window, times ascending.
    pub windows: Vec<RecordedWindow>,
}

/// What the EMG model made of a window.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct RecordedWindow {
    /// When the window ended.
    pub time: SimTime,
    /// Probability of each gesture, in the order of [`RecordedEmg::gestures`]; zeros while the stream is dead.
    pub posterior: Vec<f64>,
    /// The gesture in force then, by the decision rule.
    pub in_force: Gesture,
    /// How hard it is made, 0 to 1.
    pub effort: f64,
}
