//! Who is in control, and the inputs that wait for the testbed.
//!
//! One client at a time drives: the first to send anything, until another presses a gesture, or sends anything
//! while the first has been silent. A stop is taken from everybody. Pure: the time is handed in.

use crate::input::{ClientInput, StudyAction};
use proact_types::Gesture;
use std::time::{Duration, Instant};

/// A client that holds a gesture and is silent for longer is taken to be gone; another may then take its place. The
/// page sends a sign of life every 40 ms. It does not bring the gesture back: that takes a new press, or a line that
/// falters would toggle the lock. The testbed, which is told of each sign, stops the arm much sooner.
pub(crate) const MAX_SILENCE: Duration = Duration::from_millis(500);

/// Most inputs kept for a testbed that does not drain them: 8 s of gaze at 60 Hz with gestures between.
const MAX_WAITING: usize = 512;

/// Number of a connection, never used twice.
pub(crate) type ClientId = u64;

#[derive(Debug)]
struct Driver {
    client: ClientId,
    heard: Instant,
}

/// The client in control and the queue of its inputs.
#[derive(Debug, Default)]
pub(crate) struct InputArbiter {
    driver: Option<Driver>,
    /// The gesture in force, if it is one that moves anything.
    held: Option<Gesture>,
    /// A gesture was released because the client in control fell silent.
    released: bool,
    /// The client in control said something since that was asked for last.
    heard: bool,
    waiting: Vec<ClientInput>,
}

impl InputArbiter {
    /// Takes a checked message of `client`; none is a sign of life.
    pub(crate) fn accept(&mut self, client: ClientId, now: Instant, input: Option<ClientInput>) {
        let stops = input == Some(ClientInput::Gesture(Gesture::NoMotion));
        if let Some(request @ (ClientInput::Study(_) | ClientInput::GazeCheck(_))) = input {
            // The experimenter does not drive. Whatever is held ends with a pause or the trial.
            if request == ClientInput::Study(StudyAction::Pause)
                || request == ClientInput::Study(StudyAction::Abort)
            {
                self.release();
            }
            return self.push(request);
        }
        let takes_over =
            matches!(input, Some(ClientInput::Gesture(_) | ClientInput::Restart { .. })) && !stops;
        let drives = match &self.driver {
            None => input.is_some() && !stops,
            Some(driver) => {
                driver.client == client
                    || takes_over
                    || (input.is_some() && now.duration_since(driver.heard) > MAX_SILENCE)
            }
        };
        if drives {
            self.driver = Some(Driver { client, heard: now });
            self.heard = true;
        }
        match input {
            Some(ClientInput::Gesture(Gesture::NoMotion)) => {
                // Said again by who has let go only now: without it the testbed does not know of the relaxed hand.
                if drives && std::mem::take(&mut self.released) && self.held.is_none() {
                    self.push(ClientInput::Gesture(Gesture::NoMotion));
                }
                self.release();
            }
            // Only a change is news.
            Some(ClientInput::Gesture(gesture)) if self.held != Some(gesture) => {
                self.held = Some(gesture);
                self.push(ClientInput::Gesture(gesture));
            }
            Some(restart @ ClientInput::Restart { .. }) => {
                self.release();
                self.push(restart);
            }
            Some(input @ (ClientInput::Gaze { .. } | ClientInput::Trunk(_) | ClientInput::Head(_)))
                if drives =>
            {
                self.push(input);
            }
            _ => {}
        }
    }

    /// The connection of `client` has ended.
    pub(crate) fn leave(&mut self, client: ClientId) {
        if self.driver.as_ref().is_some_and(|driver| driver.client == client) {
            self.driver = None;
            self.release();
            self.push(ClientInput::Disconnected);
        }
    }

    /// Releases a gesture whose holder has fallen silent. To be called a few times within [`MAX_SILENCE`].
    pub(crate) fn check_silence(&mut self, now: Instant) {
        if self.driver.as_ref().is_some_and(|driver| now.duration_since(driver.heard) > MAX_SILENCE) {
            self.released |= self.held.is_some();
            self.release();
        }
    }

    /// Whether the client in control said anything since the last call, if only that it is there.
    pub(crate) fn take_heard(&mut self) -> bool {
        std::mem::take(&mut self.heard)
    }

    /// Everything since the last call, oldest first.
    pub(crate) fn drain(&mut self) -> Vec<ClientInput> {
        std::mem::take(&mut self.waiting)
    }

    fn release(&mut self) {
        if self.held.take().is_some() {
            self.push(ClientInput::Gesture(Gesture::NoMotion));
        }
    }

    fn push(&mut self, input: ClientInput) {
        // Of gaze, trunk or head samples in a row only the last one counts.
        let replaces = matches!(
            (self.waiting.last(), &input),
            (Some(ClientInput::Gaze { .. }), ClientInput::Gaze { .. })
                | (Some(ClientInput::Trunk(_)), ClientInput::Trunk(_))
                | (Some(ClientInput::Head(_)), ClientInput::Head(_))
        );
        if replaces {
            self.waiting.pop();
        } else if self.waiting.len() >= MAX_WAITING {
            // Nobody drains. What has piled up is stale, so it goes, and a stop stands in for it.
            self.waiting.clear();
            self.held = None;
            self.waiting.push(ClientInput::Gesture(Gesture::NoMotion));
            return;
        }
        self.waiting.push(input);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::{Point, Vector};

    const WE: ClientInput = ClientInput::Gesture(Gesture::WristExtension);
    const HC: ClientInput = ClientInput::Gesture(Gesture::HandClose);
    const NM: ClientInput = ClientInput::Gesture(Gesture::NoMotion);

    fn gaze(x: f64) -> ClientInput {
        ClientInput::Gaze { origin: Point::origin(), direction: Vector::new(x, 0.0, 1.0), measured: false }
    }

    #[test]
    fn a_held_gesture_that_is_repeated_is_handed_on_once() {
        let (mut input_arbiter, now) = (InputArbiter::default(), Instant::now());
        for _ in 0..5 {
            input_arbiter.accept(1, now, Some(WE));
        }
        input_arbiter.accept(1, now, Some(NM));
        assert_eq!(input_arbiter.drain(), [WE, NM]);
        assert_eq!(input_arbiter.drain(), []);
    }

    #[test]
    fn a_client_that_vanishes_with_a_held_gesture_stops_the_arm() {
        let (mut input_arbiter, now) = (InputArbiter::default(), Instant::now());
        input_arbiter.accept(1, now, Some(WE));
        input_arbiter.leave(1);
        assert_eq!(input_arbiter.drain(), [WE, NM, ClientInput::Disconnected]);
    }

    #[test]
    fn a_pause_of_the_experimenter_releases_what_is_held_and_takes_nobodys_place() {
        let (mut input_arbiter, now) = (InputArbiter::default(), Instant::now());
        let pause = ClientInput::Study(StudyAction::Pause);
        input_arbiter.accept(1, now, Some(WE));
        input_arbiter.accept(2, now, Some(pause.clone()));
        input_arbiter.accept(1, now, Some(gaze(1.0)));
        input_arbiter.accept(2, now, Some(gaze(2.0)));
        assert_eq!(input_arbiter.drain(), [WE, NM, pause, gaze(1.0)]);
    }

    #[test]
    fn a_spectator_that_leaves_changes_nothing() {
        let (mut input_arbiter, now) = (InputArbiter::default(), Instant::now());
        input_arbiter.accept(1, now, Some(WE));
        input_arbiter.leave(2);
        assert_eq!(input_arbiter.drain(), [WE]);
    }

    #[test]
    fn silence_releases_a_held_gesture_and_a_sign_of_life_keeps_it() {
        let (mut input_arbiter, start) = (InputArbiter::default(), Instant::now());
        input_arbiter.accept(1, start, Some(WE));
        input_arbiter.check_silence(start + MAX_SILENCE);
        input_arbiter.accept(1, start + MAX_SILENCE, None);
        input_arbiter.check_silence(start + 2 * MAX_SILENCE);
        assert_eq!(input_arbiter.drain(), [WE]);
        input_arbiter.check_silence(start + 2 * MAX_SILENCE + Duration::from_millis(1));
        assert_eq!(input_arbiter.drain(), [NM]);
        // A released gesture is no word of the client.
        assert!(input_arbiter.take_heard());
        input_arbiter.check_silence(start + 3 * MAX_SILENCE);
        assert!(!input_arbiter.take_heard());
        // Once is enough, and a late sign of life does not press again.
        input_arbiter.check_silence(start + 9 * MAX_SILENCE);
        input_arbiter.accept(1, start + 9 * MAX_SILENCE, None);
        assert_eq!(input_arbiter.drain(), []);
        // That the key is released in the end is news to the testbed.
        input_arbiter.accept(1, start + 9 * MAX_SILENCE, Some(NM));
        assert_eq!(input_arbiter.drain(), [NM]);
        input_arbiter.accept(1, start + 9 * MAX_SILENCE, Some(NM));
        assert_eq!(input_arbiter.drain(), []);
    }

    #[test]
    fn the_gaze_of_a_second_client_is_ignored_until_it_takes_over() {
        let (mut input_arbiter, now) = (InputArbiter::default(), Instant::now());
        input_arbiter.accept(1, now, Some(gaze(1.0)));
        input_arbiter.accept(2, now, Some(gaze(2.0)));
        assert_eq!(input_arbiter.drain(), [gaze(1.0)]);
        input_arbiter.accept(2, now, Some(HC));
        input_arbiter.accept(2, now, Some(gaze(2.0)));
        input_arbiter.accept(1, now, Some(gaze(1.0)));
        assert_eq!(input_arbiter.drain(), [HC, gaze(2.0)]);
        // The first one may come back once the second is silent.
        input_arbiter.accept(1, now + 2 * MAX_SILENCE, Some(gaze(3.0)));
        assert_eq!(input_arbiter.drain(), [gaze(3.0)]);
    }

    #[test]
    fn a_stop_is_taken_from_everybody() {
        let (mut input_arbiter, now) = (InputArbiter::default(), Instant::now());
        input_arbiter.accept(1, now, Some(WE));
        input_arbiter.accept(2, now, Some(NM));
        assert_eq!(input_arbiter.drain(), [WE, NM]);
    }

    #[test]
    fn a_restart_releases_what_is_held_first() {
        let (mut input_arbiter, now) = (InputArbiter::default(), Instant::now());
        input_arbiter.accept(1, now, Some(WE));
        let restart = ClientInput::Restart { method: None, again: false };
        input_arbiter.accept(1, now, Some(restart.clone()));
        assert_eq!(input_arbiter.drain(), [WE, NM, restart]);
    }

    #[test]
    fn of_gaze_samples_in_a_row_the_last_one_is_kept() {
        let (mut input_arbiter, now) = (InputArbiter::default(), Instant::now());
        for x in [1.0, 2.0, 3.0] {
            input_arbiter.accept(1, now, Some(gaze(x)));
        }
        input_arbiter.accept(1, now, Some(HC));
        input_arbiter.accept(1, now, Some(gaze(4.0)));
        assert_eq!(input_arbiter.drain(), [gaze(3.0), HC, gaze(4.0)]);
    }

    #[test]
    fn a_testbed_that_never_drains_costs_bounded_memory_and_ends_with_a_stop() {
        let (mut input_arbiter, now) = (InputArbiter::default(), Instant::now());
        for k in 0..10 * MAX_WAITING {
            input_arbiter.accept(1, now, Some(if k % 2 == 0 { WE } else { HC }));
            assert!(input_arbiter.waiting.len() <= MAX_WAITING);
        }
        assert_eq!(input_arbiter.drain()[0], NM);
    }
}
