use proact_types::{Event, EventKind, SimTime};
use serde::{Deserialize, Serialize};

/// From events to what a person is to hear and feel.
#[derive(Clone, Copy, Debug, Default)]
pub struct FeedbackStage;

/// What a person is to hear and feel at an event, as data: who drives a loudspeaker or a vibrating band decides how.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FeedbackCue {
    /// When.
    pub time: SimTime,
    /// Why.
    pub cue: Cue,
    /// What is to be heard.
    pub sound: Option<Tone>,
    /// What is to be felt.
    pub vibration: Option<Vibration>,
}

/// The occasions for a cue.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cue {
    /// The hand took hold of a block.
    ContactMade,
    /// The hand let go of a block.
    ContactLost,
    /// A block came to rest on its target.
    OnTarget,
    /// A block came to rest elsewhere.
    OffTarget,
}

/// A tone.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tone {
    /// Hz at the beginning, and at the end: it glides.
    pub hz: [f64; 2],
    /// Milliseconds.
    pub ms: u32,
}

/// A buzz.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Vibration {
    /// 0 to 1.
    pub strength: f64,
    /// Milliseconds.
    pub ms: u32,
}

impl FeedbackStage {
    /// The cues of the events of tick `now`, in their order. The tones are our own choice: up for contact, down for its
    /// loss.
    pub fn step(&mut self, now: SimTime, events: &[Event]) -> Vec<FeedbackCue> {
        let cue = |event: &Event| {
            let (cue, hz, strength) = match event.kind {
                EventKind::BlockAttached { .. } => (Cue::ContactMade, [440.0, 660.0], Some(1.0)),
                EventKind::BlockReleased { .. } => (Cue::ContactLost, [660.0, 440.0], Some(0.5)),
                EventKind::BlockOnTarget { .. } => (Cue::OnTarget, [880.0, 880.0], None),
                EventKind::BlockOffTarget { .. } => (Cue::OffTarget, [220.0, 220.0], None),
                _ => return None,
            };
            let vibration = strength.map(|strength| Vibration { strength, ms: 150 });
            Some(FeedbackCue { time: now, cue, sound: Some(Tone { hz, ms: 150 }), vibration })
        };
        events.iter().filter_map(cue).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::BlockId;

    #[test]
    fn contact_is_heard_and_felt_and_a_block_on_its_target_is_heard() {
        let event = |kind| Event { time: SimTime(7), kind };
        let block = BlockId::ALL[0];
        let events = [
            event(EventKind::Unlocked),
            event(EventKind::BlockAttached { block }),
            event(EventKind::BlockOnTarget { block, distance: 0.01 }),
        ];
        let cues = FeedbackStage.step(SimTime(7), &events);
        assert_eq!(cues.iter().map(|cue| cue.cue).collect::<Vec<_>>(), [Cue::ContactMade, Cue::OnTarget]);
        assert!(cues.iter().all(|cue| cue.time == SimTime(7) && cue.sound.is_some()));
        assert_eq!(cues.iter().map(|cue| cue.vibration.is_some()).collect::<Vec<_>>(), [true, false]);
    }
}
