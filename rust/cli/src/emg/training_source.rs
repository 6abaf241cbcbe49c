//! Where the repetitions of a calibration come from.

use proact_devices::{EmgPacket, Recordings, SampleSource, SourceEvent};
use proact_types::{Gesture, SimTime};
use std::{
    error::Error,
    time::{Duration, Instant},
};

/// A source that goes on by itself, or recordings.
pub(super) enum TrainingSource {
    Live {
        source: Box<dyn SampleSource>,
        begin: Instant,
        now: SimTime,
        /// The repetition for which a position of the limb was asked for last.
        prompted_repetition: Option<usize>,
    },
    Recorded(Recordings),
}

/// What came of a moment's wait.
pub(super) struct SourceUpdate {
    /// The time of the stream, which never goes back.
    pub(super) now: SimTime,
    /// What to tell the person.
    pub(super) message: Option<String>,
}

impl TrainingSource {
    pub(super) fn from_source(source: Box<dyn SampleSource>) -> TrainingSource {
        TrainingSource::Live { source, begin: Instant::now(), now: SimTime(0), prompted_repetition: None }
    }

    /// Tells a simulated person what to make.
    pub(super) fn prompt(&mut self, gesture: Gesture) {
        if let TrainingSource::Live { source, .. } = self {
            source.prompt(gesture);
        }
    }

    /// What to tell a person before repetition `repetition`, where a new position of the limb is asked for; a simulated person goes
    /// there.
    pub(super) fn prompt_position(&mut self, positions: &[String], repetition: usize) -> Option<String> {
        let index = repetition.checked_rem(positions.len())?;
        let TrainingSource::Live { source, prompted_repetition: position, .. } = self else { return None };
        if position.replace(repetition) == Some(repetition) {
            return None;
        }
        source.prompt_position(index, positions.len());
        Some(format!("Position of the arm: {}", positions[index]))
    }

    /// Waits a moment for what the source brings next: `packet` is empty if that is no packet. Nothing of
    /// recordings.
    ///
    /// # Errors
    /// What the source cannot mend, or its end.
    pub(super) fn poll(&mut self, packet: &mut EmgPacket) -> Result<Option<SourceUpdate>, Box<dyn Error>> {
        let TrainingSource::Live { source, begin, now, .. } = self else { return Ok(None) };
        let event = source.poll(Duration::from_millis(20), packet)?;
        // The stream's clock must not go back, whichever clock it is read from.
        *now = (*now).max(SimTime(match event {
            SourceEvent::Packet => packet.received.as_millis() as u64,
            _ => begin.elapsed().as_millis() as u64,
        }));
        let message = match event {
            SourceEvent::Ended => return Err("the source ended before the calibration did".into()),
            SourceEvent::Lost { reason } => Some(format!("armband lost: {reason}")),
            SourceEvent::Restored => Some("armband found again".to_owned()),
            _ => None,
        };
        Ok(Some(SourceUpdate { now: *now, message }))
    }
}
