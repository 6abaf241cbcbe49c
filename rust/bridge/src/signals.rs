use crate::PostTrialAction;
use proact_types::{Gesture, SimTime};
use serde::{Deserialize, Serialize};

/// Whether the trial goes on, and what the record of it is called.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct TrialStatus {
    /// Simulated time stands still.
    pub paused: bool,
    /// The trial was ended before its time.
    pub aborted: bool,
    /// The experimenter's buttons have an effect.
    pub can_pause: bool,
    /// Simulated time has not begun: it waits for the person's first action.
    pub waiting: bool,
    /// Simulated time stands still, because who drives reads a dialog.
    #[serde(rename = "held")]
    pub paused_by_dialog: bool,
    /// What may be asked for when the trial is over.
    #[serde(rename = "offers")]
    pub post_trial_actions: Vec<PostTrialAction>,
    /// Results of this trial, once it is over, and of those before it, the newest first.
    pub results: Vec<ResultCard>,
    /// Seed of the trial, as text: JavaScript has no whole numbers above 2^53.
    #[serde(serialize_with = "crate::encoding::as_text")]
    #[cfg_attr(feature = "ts", ts(type = "string"))]
    pub seed: u64,
    /// Where it is recorded; none if it is not.
    pub record: Option<String>,
    /// What gives gaze instead of the page's mouse and headset, such as an eye tracker; none if nothing does.
    pub gaze_source: Option<String>,
    /// How often the experimenter has asked for a gaze check. With each, the participant's page begins one.
    pub gaze_checks: u32,
    /// The same for a calibration of the gaze.
    pub gaze_calibrations: u32,
    /// Why what was chosen on the page did not begin, as a sentence; none if it did.
    #[serde(rename = "refused")]
    pub start_error: Option<String>,
}

/// How a trial went, for whoever drove or watched.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct ResultCard {
    /// Who drove, such as `You`.
    #[serde(rename = "who")]
    pub driver: String,
    /// Name of the method.
    pub method: String,
    /// What the task counts.
    pub score: f64,
    /// The most that it can be; none if there is no bound.
    #[serde(rename = "most")]
    pub max_score: Option<u32>,
    /// What the score is, such as `blocks on target`.
    pub score_name: String,
    /// Length of the trial, simulated seconds.
    pub seconds: f64,
    /// Length of the wrist's path, metres.
    pub path_m: f64,
    /// How often the hand closed to take something.
    pub attempts: u32,
    /// What became of each object, for tasks that tell.
    pub objects: Vec<ObjectResultRow>,
    /// What people with two sound hands reach, a line each, where that is known.
    #[serde(default)]
    pub norms: Vec<String>,
    /// What is wrong with the trial, a sentence each.
    #[serde(default)]
    pub faults: Vec<String>,
}

/// What became of one object, as a line of a [`ResultCard`].
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct ObjectResultRow {
    /// Its name.
    pub name: String,
    /// What became of it, such as `on_target`.
    pub outcome: String,
    /// Seconds from the release of the one before, or the start, to the first contact; none if it was never held.
    pub pick_s: Option<f64>,
    /// Seconds from the last contact to the release; none if it was never released.
    pub place_s: Option<f64>,
    /// Horizontal distance from its target at the end, metres.
    pub error_m: Option<f64>,
}

/// What the EMG model makes of the stream.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct Recognition {
    /// The gestures that the model tells apart.
    pub gestures: Vec<Gesture>,
    /// Probability of each in the newest window, in the order of `gestures`; empty before the first window, zeros while the
    /// stream is dead.
    pub posterior: Vec<f64>,
    /// The gesture in force, by the decision rule.
    pub in_force: Gesture,
    /// What the newest window gave to the decision rule; none if it was rejected, or there is none.
    pub window_class: Option<Gesture>,
    /// How hard it is made, 0 to 1.
    pub effort: f64,
    /// Gestures act: no relaxed hand is waited for.
    pub armed: bool,
    /// Why the stream is dead, as a sentence; none while it lives.
    pub fault: Option<String>,
}

/// The power spectrum of the newest second of a channel: Welch's estimate.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct ChannelSpectrum {
    /// Which, from 0.
    pub channel: usize,
    /// From line to line, hertz; the first is at zero.
    pub step_hz: f64,
    /// Power a hertz, the device's unit squared; without the mean, up to 1 kHz.
    pub density: Vec<f64>,
}

/// The newest value of a channel of an inertial measurement unit.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct InertialValue {
    /// Such as `acceleration_x`.
    pub name: String,
    /// Such as `g`.
    pub unit: String,
    /// None before the first, and for what is no number.
    pub value: Option<f64>,
}

/// What an [`IntentEstimate`] is spread over.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(rename_all = "snake_case")]
pub enum IntentDomain {
    /// The objects of the scene, while the hand is empty.
    #[default]
    Objects,
    /// The targets of the scene, while something is held. This is for display: methods take the place that is looked at.
    #[serde(rename = "places")]
    Targets,
}

/// What gaze and task say of what is meant, each for itself and both together. Lists have the order of the scene and sum to
/// one, rounded.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct IntentEstimate {
    /// Of what.
    #[serde(rename = "over")]
    pub domain: IntentDomain,
    /// By the gaze alone, without task context: what method C goes by.
    pub likelihood: Vec<f64>,
    /// By the task alone.
    pub prior: Vec<f64>,
    /// By both: what method D goes by.
    pub posterior: Vec<f64>,
}

/// A part of the way from a muscle to the light of a screen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(rename_all = "snake_case")]
pub enum LatencyStage {
    /// From the change of what a simulated person makes to the gesture in force: windows and decision rule, trial time.
    Recognition,
    /// From the arrival of a live armband's sample to the tick that takes it.
    Queue,
    /// The EMG stage of a tick.
    Emg,
    /// Gaze, task and what is meant.
    Intent,
    /// The control method, with its watch over the sources.
    Method,
    /// Joint targets.
    Actuation,
    /// From the beginning of a tick in which a window ends to its joint targets: the four above together.
    #[serde(rename = "target")]
    JointTarget,
    /// Physics.
    World,
    /// The task's rules, cues and digest.
    Task,
    /// All stages of a tick.
    Tick,
    /// From a gesture in force, with arm and hand at rest, to the first joint that moves; a plan's time is in it. Trial time.
    Motion,
    /// From there to the next frame, trial time.
    Frame,
    /// From the server to the page.
    #[serde(rename = "line")]
    Network,
    /// From there to the screen, with the delay by which the page smooths motion.
    #[serde(rename = "picture")]
    Render,
    /// From the change of what a simulated person makes to the picture on which a joint has moved.
    #[serde(rename = "whole")]
    EndToEnd,
}

/// How long one stage took so far in the trial.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct LatencyRow {
    /// Which.
    pub stage: LatencyStage,
    /// How often it was measured.
    #[cfg_attr(feature = "ts", ts(type = "number"))]
    pub count: u64,
    /// Milliseconds.
    pub median_ms: f64,
    /// What 99 of 100 keep, milliseconds.
    pub p99_ms: f64,
    /// Milliseconds.
    pub worst_ms: f64,
}

/// What the experimenter watches beside the scene: about ten times a second, the latest only.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct Signals {
    /// The instant of the last sample.
    pub time: SimTime,
    /// EMG since the message before, `[n_rows][n_channels]`, in the device's unit; empty without an armband. Rows are samples,
    /// or, of streams too dense to draw, in turn the lowest and the highest values of a block of samples.
    pub emg: Vec<Vec<f64>>,
    /// Rows of `emg` a second, hertz; zero without an armband.
    pub emg_row_hz: f64,
    /// Spectra of some channels, in turn, of streams whose samples are not sent; each channel's stays until the next.
    pub spectra: Vec<ChannelSpectrum>,
    /// Nominal sampling rate, hertz; zero without an armband.
    pub emg_rate_hz: f64,
    /// Newest values of an inertial measurement unit; empty without one.
    pub inertial: Vec<InertialValue>,
    /// One light a channel: `green`, `amber`, `red`.
    #[serde(rename = "lights")]
    pub channel_status: Vec<String>,
    /// What is wrong with a channel, for each, such as `flat` or `mains`; none if nothing is.
    pub faults: Vec<Option<String>>,
    /// Share of samples that were lost, 0 to 1.
    pub emg_lost_share: f64,
    /// What the muscles say; none without an armband.
    pub recognition: Option<Recognition>,
    /// What gaze and task say; none for methods that do not go by the gaze, and while there is nothing to mean.
    pub intent: Option<IntentEstimate>,
    /// Milliseconds since the last valid gaze; none if there was none yet.
    #[cfg_attr(feature = "ts", ts(type = "number | null"))]
    pub gaze_age_ms: Option<u64>,
    /// Gaze samples a second.
    pub gaze_hz: f64,
    /// Tracked shoulder poses a second.
    pub tracking_hz: f64,
    /// Mean computing time of a tick of 1 ms, microseconds.
    pub tick_mean_us: f64,
    /// Longest one since the message before, microseconds.
    pub tick_max_us: f64,
    /// Simulated over real time since the message before; 1 is in step.
    #[serde(rename = "pace")]
    pub real_time_factor: f64,
    /// What the way from muscle to light takes, stage by stage; what was not measured yet is not there.
    pub latency: Vec<LatencyRow>,
    /// Pages connected.
    #[serde(rename = "pages")]
    pub page_count: usize,
}
