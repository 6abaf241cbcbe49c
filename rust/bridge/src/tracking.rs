use proact_types::Pose;
use serde::Serialize;

/// How steady a stream of poses was in the last ten seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct PoseStreamStatistics {
    /// How much later than the quickest pose half of them arrive, s.
    pub lag_secs: f64,
    /// The same for one in a hundred, less the lag, s.
    pub jitter_secs: f64,
    /// Gaps: poses that the system left out.
    pub dropouts: u32,
    /// The longest gap, s.
    #[serde(rename = "longest_secs")]
    pub longest_gap_secs: f64,
    /// Share of the time that was missing, 0 to 1.
    #[serde(rename = "missing")]
    pub missing_fraction: f64,
}

/// A calibration that is in use.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct ActiveCalibration {
    /// `shoulder` or `headset`.
    pub kind: String,
    /// Date, residual and verdict.
    #[serde(rename = "line")]
    pub summary: String,
    /// Whether a trial may rest on it.
    pub usable: bool,
}

/// One place of the box in a picture of what is in reach.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct ReachPoint {
    /// m, `world`: ahead.
    pub x: f64,
    /// m, `world`: to the left.
    pub y: f64,
    /// The smallest lean forward of those tried from which the hand gets there, degrees; none if it does not.
    pub lean_deg: Option<f64>,
}

/// What of the box is in reach for this person and table.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct ReachGrid {
    /// In one sentence.
    #[serde(rename = "line")]
    pub summary: String,
    /// Height of the places, m, `world`.
    pub height_m: f64,
    /// From place to place, m.
    pub spacing_m: f64,
    /// The places.
    #[serde(rename = "spots")]
    pub points: Vec<ReachPoint>,
}

/// How a tracking source stands: for the page of tracking and for `doctor`.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct TrackingReport {
    /// As the source was named, such as `vrpn:192.168.1.5/Shoulderpad`.
    pub source: String,
    /// The body that is followed.
    pub body: String,
    /// All bodies that were seen, in alphabetical order.
    pub bodies: Vec<String>,
    /// Poses of the body per second, over the last two seconds.
    pub rate_hz: f64,
    /// Since the last pose that can be used, s; none before the first.
    pub age_secs: Option<f64>,
    /// What the last ten seconds were like; none before there are enough poses.
    pub stream: Option<PoseStreamStatistics>,
    /// Noise of turns, standard deviation about one axis, rad; none before there are enough.
    pub noise_rad: Option<f64>,
    /// Noise of places, standard deviation of one axis, m; none before there are enough.
    pub noise_m: Option<f64>,
    /// Messages that could not be read.
    #[cfg_attr(feature = "ts", ts(type = "number"))]
    pub malformed: u64,
    /// The newest pose that can be used: `tracking_from_body`, metres with z up.
    #[cfg_attr(feature = "ts", ts(as = "Option<proact_types::typescript::Pose>"))]
    pub tracking_from_body: Option<Pose>,
    /// Where the frame of the tracking system is taken to be; none before the body was first seen.
    #[cfg_attr(feature = "ts", ts(as = "Option<proact_types::typescript::Pose>"))]
    pub world_from_tracking: Option<Pose>,
    /// Where that puts the shoulder.
    #[cfg_attr(feature = "ts", ts(as = "Option<proact_types::typescript::Pose>"))]
    pub world_from_shoulder: Option<Pose>,
    /// The calibrations that are in use.
    pub calibrations: Vec<ActiveCalibration>,
    /// How the headset's world stands in the room; none without a calibrated headset.
    pub headset: Option<String>,
    /// How the person's own limb is followed; none where it is not tracked.
    pub limb: Option<String>,
    /// How the person sits, against how they sat when the shoulder was calibrated; none without a calibration.
    pub posture: Option<String>,
    /// What is in reach from where the shoulder is at the start of a trial; none before one is prepared.
    pub reach: Option<ReachGrid>,
    /// Why the arm does not follow, and what to do about it; none while all is well.
    pub fault: Option<String>,
    /// The same as a key, such as `millimetres`, `waiting`, `no_body`, `silent` or `occluded`.
    pub fault_name: Option<String>,
}
