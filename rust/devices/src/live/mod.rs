//! Live sources of EMG samples behind one trait, with doubles for tests.
//!
//! A source hands out packets: samples under the device's own counter, so that what was lost is a step in the
//! counter and never filled in. The clock is the source's affair; who uses one only says how long to wait.

mod doubles;
mod playback;
mod simulated_person;

pub use doubles::{FaultySource, InjectedFault, ScriptedEvent, ScriptedSource};
pub use playback::{Pacing, PlaybackSource};
pub use simulated_person::{KeyboardSource, SimulatedPersonSource};

use crate::DeviceError;
use proact_emg::{ImuChannel, RecordingFault};
use proact_types::{EmgSample, Gesture};
use std::time::Duration;

/// What a stream is, known once it runs.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceInfo {
    /// For display, such as `gForce Pro+ 1.2.3`.
    pub name: String,
    /// Samples per second by the device's settings.
    pub rate_hz: f64,
    /// Electrodes, which come first in every sample.
    pub channels: usize,
    /// Samples of a whole packet; 1 when the source has no packets.
    pub packet_samples: usize,
    /// The code of zero volts by the maker's word, to be subtracted; 0 for signed streams. Makers disagree: the
    /// median at rest is better where there is one.
    pub zero_code: f64,
    /// Smallest and largest code that the converter can give; a signal there is cut off. None where unknown.
    pub rails: Option<(f64, f64)>,
    /// Losses show in the counter, by the device's own numbering or its time stamps. Without it only silences tell.
    pub loss_is_counted: bool,
    /// Volts of one code by the maker's word, from `zero`. None where nobody says.
    pub volts_per_code: Option<f64>,
    /// Channels of an inertial measurement unit, which follow those of the electrodes in every sample: the newest of a sensor that
    /// is slower than the electrodes, no number before its first.
    pub imu: Vec<ImuChannel>,
}

/// Samples that arrived together.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EmgPacket {
    /// Oldest first, raw codes of the device, counters rising by one.
    pub samples: Vec<EmgSample>,
    /// Samples lost before the first of these: a gap, marked here and by the step in the counter.
    pub lost_before: u64,
    /// Time of the last sample by the device: its counter over its rate, seconds.
    pub device_secs: f64,
    /// When the packet arrived, since the source was opened, on the host's clock.
    pub received: Duration,
}

/// What [`SampleSource::poll`] met.
#[derive(Clone, Debug, PartialEq)]
pub enum SourceEvent {
    /// The packet handed in was filled.
    Packet,
    /// Nothing came within the time allowed.
    Nothing,
    /// The device is gone; the source keeps trying to get it back.
    Lost {
        /// What went wrong.
        reason: String,
    },
    /// The device is back. The counter steps over what was missed.
    Restored,
    /// A recording is over; there will be no more samples.
    Ended,
}

/// A live stream of EMG samples.
///
/// Sources wait for data and do not spin. None hands out a sample twice, in the wrong order, or one that the
/// device did not send.
pub trait SampleSource: Send {
    /// What the stream is.
    fn info(&self) -> &SourceInfo;

    /// Waits at most `timeout` for the next event. `packet` is overwritten when it is [`SourceEvent::Packet`]; its
    /// storage is used again, so that a stream of equal packets does not allocate.
    ///
    /// # Errors
    /// Only what cannot be mended by waiting. A device that is gone is an event.
    fn poll(&mut self, timeout: Duration, packet: &mut EmgPacket) -> Result<SourceEvent, DeviceError>;

    /// What the stream brought and lost so far.
    fn counts(&self) -> SourceCounts;

    /// How the sender's clock compares with the host's; none where the sender does not stamp samples.
    fn clock(&self) -> Option<SourceClock> {
        None
    }

    /// What was found in the recordings that it plays, and accepted.
    fn findings(&self) -> &[RecordingFault] {
        &[]
    }

    /// Tells a simulated person what is asked for. Armbands on people, and recordings, take no notice.
    fn prompt(&mut self, _gesture: Gesture) {}

    /// Tells a simulated person into which position the limb is to go: `position` of `count`, from the arm hanging to overhead.
    fn prompt_position(&mut self, _position: usize, _count: usize) {}
}

/// A sender's clock beside the host's, and how old samples are when they arrive.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct SourceClock {
    /// To be added to the sender's time to get the host's, seconds.
    pub offset_secs: f64,
    /// The offset is wrong by no more than this, seconds.
    pub uncertainty_secs: f64,
    /// From the stamp to the arrival, mean since the source was opened, seconds.
    pub mean_age_secs: f64,
    /// The same, the worst, seconds.
    pub worst_age_secs: f64,
}

/// What a source met since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct SourceCounts {
    /// Packets handed out.
    pub packets: u64,
    /// Samples that were lost on the way: the sum of all gaps.
    pub lost_samples: u64,
    /// Packets that came twice and were dropped.
    pub duplicates: u64,
    /// Packets that came after a later one and were dropped.
    pub late: u64,
    /// Packets of a wrong length or with unusable content, dropped.
    pub malformed: u64,
    /// Messages of which a fragment was missing, dropped.
    pub broken_fragments: u64,
    /// Times that the device's numbering began anew without the link being lost.
    pub resyncs: u64,
    /// Times that the device was lost.
    pub disconnects: u64,
}
