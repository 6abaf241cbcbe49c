//! Who wears a simulated armband.

use proact_devices::{
    EmgFeed, REACTION_TIME,
    gforce::{CodeSource, SharedPrompt},
};
use proact_types::{Command, EmgSample, Gesture, SimTime};
use std::collections::VecDeque;

/// A gesture, and how long it is held.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimedGesture {
    /// The gesture.
    pub gesture: Gesture,
    /// How long, seconds; above zero.
    pub secs: f64,
}

/// The gesture at a time; the list begins again when it is over.
fn gesture_at(held: &[TimedGesture], secs: f64, rest: Gesture) -> Gesture {
    let whole: f64 = held.iter().map(|h| h.secs).sum();
    let mut left = secs % whole;
    for TimedGesture { gesture, secs } in held {
        if left < *secs {
            return *gesture;
        }
        left -= secs;
    }
    rest
}

/// One sample a call, with the gesture of its time, or that of the newest prompt once somebody prompts: the simulated
/// person follows it a little later.
pub fn wearer_code_source(
    mut feed: EmgFeed,
    rate_hz: f64,
    held: Vec<TimedGesture>,
    prompted: SharedPrompt,
) -> CodeSource {
    let reaction = REACTION_TIME.as_millis() as u64;
    let mut ready: VecDeque<EmgSample> = VecDeque::new();
    let rest = feed.gesture_for(Command::NoMotion);
    let (mut tick, mut last_prompt, mut made) = (0, None, rest);
    Box::new(move || {
        loop {
            if let Some(sample) = ready.pop_front() {
                return sample.channels;
            }
            let intended = match prompted.get() {
                None => gesture_at(&held, tick as f64 / 1000.0, rest),
                Some(gesture) => {
                    let (of, since) = *last_prompt.get_or_insert((gesture, tick));
                    if of != gesture {
                        last_prompt = Some((gesture, tick));
                    } else if tick - since >= reaction {
                        made = gesture;
                    }
                    made
                }
            };
            // The feed's time is that of its samples: no sample comes early and none is skipped.
            ready.extend(feed.sample_at(SimTime(tick), intended));
            debug_assert!(rate_hz <= 1000.0);
            tick += 1;
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gestures_are_held_in_turn_and_begin_again() {
        let held = [(Command::NoMotion, 1.0), (Command::HandClose, 2.5)]
            .map(|(gesture, secs)| TimedGesture { gesture: gesture.into(), secs });
        let at = |secs| gesture_at(&held, secs, Gesture::default());
        assert_eq!(
            [0.0, 0.99, 1.0, 3.49].map(at),
            [Command::NoMotion, Command::NoMotion, Command::HandClose, Command::HandClose]
        );
        assert_eq!([3.5, 4.6].map(at), [Command::NoMotion, Command::HandClose]);
    }
}
