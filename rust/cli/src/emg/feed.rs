//! Where the repetitions of a calibration come from.

use proact_devices::{EmgPacket, Recordings, SampleSource, SourceEvent};
use proact_types::{GestureName, SimTime};
use std::{
    error::Error,
    time::{Duration, Instant},
};

/// A source that goes on by itself, or recordings.
pub(super) enum Feed {
    Live {
        source: Box<dyn SampleSource>,
        begin: Instant,
        now: SimTime,
        /// The repetition for which a position of the limb was asked for last.
        position: Option<usize>,
    },
    Recorded(Recordings),
}

/// What came of a moment's wait.
pub(super) struct Heard {
    /// The time of the stream, which never goes back.
    pub(super) now: SimTime,
    /// What to tell the person.
    pub(super) said: Option<String>,
}

impl Feed {
    pub(super) fn live(source: Box<dyn SampleSource>) -> Feed {
        Feed::Live { source, begin: Instant::now(), now: SimTime(0), position: None }
    }

    /// Tells a simulated person what to make.
    pub(super) fn prompt(&mut self, gesture: GestureName) {
        if let Feed::Live { source, .. } = self {
            source.prompt(gesture);
        }
    }

    /// What to tell a person before repetition `repetition`, where a new position of the limb is asked for; a simulated person goes
    /// there.
    pub(super) fn prompt_position(&mut self, positions: &[String], repetition: usize) -> Option<String> {
        let place = repetition.checked_rem(positions.len())?;
        let Feed::Live { source, position, .. } = self else { return None };
        if position.replace(repetition) == Some(repetition) {
            return None;
        }
        source.prompt_position(place, positions.len());
        Some(format!("Position of the arm: {}", positions[place]))
    }

    /// Waits a moment for what the source brings next: `packet` is empty if that is no packet. Nothing of
    /// recordings.
    ///
    /// # Errors
    /// What the source cannot mend, or its end.
    pub(super) fn poll(&mut self, packet: &mut EmgPacket) -> Result<Option<Heard>, Box<dyn Error>> {
        let Feed::Live { source, begin, now, .. } = self else { return Ok(None) };
        let event = source.poll(Duration::from_millis(20), packet)?;
        // The stream's clock must not go back, whichever clock it is read from.
        *now = (*now).max(SimTime(match event {
            SourceEvent::Packet => packet.received.as_millis() as u64,
            _ => begin.elapsed().as_millis() as u64,
        }));
        let said = match event {
            SourceEvent::Ended => return Err("the source ended before the calibration did".into()),
            SourceEvent::Lost { reason } => Some(format!("armband lost: {reason}")),
            SourceEvent::Restored => Some("armband found again".to_owned()),
            _ => None,
        };
        Ok(Some(Heard { now: *now, said }))
    }
}
