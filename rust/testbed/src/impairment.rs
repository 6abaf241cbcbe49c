//! Delay, jitter and loss that an experiment on latency puts on the ways from a person's devices to the testbed, and from it to the
//! display. What comes out is what is logged, so that a replay needs none of it.

use crate::ConfigError;
use proact_types::{
    DisplayFrame, Heartbeat, InputSource, MAX_TICK_SAMPLES, SimTime, TickInput, format_number,
};
use rand::{RngExt as _, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Longest delay, and longest jitter, ms.
const MAX_DELAY_MS: u64 = 10_000;

/// What is put on one way.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkImpairment {
    /// Which way.
    pub link: ImpairedLink,
    /// Everything comes this much later, ms.
    #[serde(default)]
    pub delay_ms: u64,
    /// And by up to this much more, each time another, all equally likely, ms. What comes keeps its order.
    #[serde(default)]
    pub jitter_ms: u64,
    /// Share of messages that never come, 0 to 1.
    #[serde(default)]
    pub loss_probability: f64,
}

/// Ways that can be impaired.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ImpairedLink {
    /// Samples of muscles; what came in one tick is a message.
    Emg,
    /// Gestures given directly: keys, buttons, gamepads.
    Gestures,
    /// Gaze.
    Gaze,
    /// The tracked shoulder.
    Shoulder,
    /// The tracked limb.
    Limb,
    /// Frames to whoever looks.
    Display,
}

impl ImpairedLink {
    /// Whether signs of this source come by this way.
    fn carries(self, source: InputSource) -> bool {
        match self {
            ImpairedLink::Emg => source == InputSource::Armband,
            ImpairedLink::Gestures => matches!(source, InputSource::Page | InputSource::GestureTopic),
            ImpairedLink::Gaze => source == InputSource::EyeTracker,
            ImpairedLink::Shoulder => source == InputSource::ShoulderTracker,
            ImpairedLink::Limb => source == InputSource::LimbTracker,
            ImpairedLink::Display => false,
        }
    }
}

impl LinkImpairment {
    /// Checks ranges, and that no way is there twice.
    ///
    /// # Errors
    /// [`ConfigError::Value`] naming the first key that is out of range.
    pub fn check(impairments: &[LinkImpairment]) -> Result<(), ConfigError> {
        let bad = |key, got: String, expected| Err(ConfigError::Value { key, got, expected });
        for (k, Self { link, delay_ms, jitter_ms, loss_probability: loss }) in impairments.iter().enumerate()
        {
            if impairments[..k].iter().any(|other| other.link == *link) {
                return bad("impairments.link", format!("{link:?} twice"), "each link once");
            }
            for (key, got) in [("impairments.delay_ms", delay_ms), ("impairments.jitter_ms", jitter_ms)] {
                if *got > MAX_DELAY_MS {
                    return bad(key, got.to_string(), "0 to 10000");
                }
            }
            if !(0.0..=1.0).contains(loss) {
                return bad("impairments.loss_probability", format_number(*loss), "0 to 1");
            }
            // A gesture is said once, when it changes: one that is lost would leave the arm in motion.
            if *link == ImpairedLink::Gestures && *loss > 0.0 {
                return bad(
                    "impairments.loss_probability",
                    format_number(*loss),
                    "0 for gestures, whose connection loses nothing",
                );
            }
        }
        Ok(())
    }
}

/// A way with messages on it.
#[derive(Clone, Debug)]
struct ImpairedStream<T> {
    impairment: LinkImpairment,
    rng: ChaCha8Rng,
    /// Messages with the tick in which they come.
    in_flight: VecDeque<(u64, T)>,
}

impl<T> ImpairedStream<T> {
    /// Each way draws from a stream of its own.
    fn new(impairment: LinkImpairment, seed: u64) -> Self {
        let mut hasher = blake3::Hasher::new();
        hasher.update(b"proact impairment\0");
        hasher.update(&seed.to_le_bytes());
        hasher.update(&[impairment.link as u8]);
        let rng = ChaCha8Rng::from_seed(*hasher.finalize().as_bytes());
        Self { impairment, rng, in_flight: VecDeque::new() }
    }

    fn send(&mut self, now: SimTime, message: T) {
        let LinkImpairment { delay_ms, jitter_ms, loss_probability: loss, .. } = self.impairment;
        // Both are always drawn: whether a message is lost does not depend on the jitter.
        let (lost, jitter) = (self.rng.random::<f64>() < loss, self.rng.random_range(0..=jitter_ms));
        if !lost {
            let before = self.in_flight.back().map_or(0, |(due, _)| *due);
            self.in_flight.push_back(((now.0 + delay_ms + jitter).max(before), message));
        }
    }

    /// The next message, if it has come and `fits`.
    fn receive(&mut self, now: SimTime, fits: impl FnOnce(&T) -> bool) -> Option<T> {
        let came = self.in_flight.front().is_some_and(|(due, message)| *due <= now.0 && fits(message));
        if came { self.in_flight.pop_front().map(|(_, message)| message) } else { None }
    }
}

/// All ways of a trial that are impaired.
#[derive(Clone, Debug, Default)]
pub(crate) struct Impairments {
    inputs: Vec<ImpairedStream<TickInput>>,
    display: Option<ImpairedStream<Box<DisplayFrame>>>,
}

impl Impairments {
    /// Those of a configuration with this seed.
    pub(crate) fn new(impairments: &[LinkImpairment], seed: u64) -> Self {
        let to_display = |impairment: &&LinkImpairment| impairment.link == ImpairedLink::Display;
        let inputs = impairments.iter().filter(|impairment| !to_display(impairment));
        Self {
            inputs: inputs.map(|impairment| ImpairedStream::new(*impairment, seed)).collect(),
            display: impairments
                .iter()
                .find(to_display)
                .map(|impairment| ImpairedStream::new(*impairment, seed)),
        }
    }

    /// Turns what sets out in tick `now` into what comes in.
    pub(crate) fn apply(&mut self, now: SimTime, input: &mut TickInput) {
        for input_link in &mut self.inputs {
            let link = input_link.impairment.link;
            if let Some(message) = take_link_part(link, input) {
                input_link.send(now, message);
            }
            // Gestures come one by one, so that none is passed over; of measurements the newest counts.
            let max_samples = if link == ImpairedLink::Gestures { 1 } else { usize::MAX };
            for _ in 0..max_samples {
                let capacity = MAX_TICK_SAMPLES.saturating_sub(input.emg.len());
                let Some(message) = input_link.receive(now, |message| message.emg.len() <= capacity) else {
                    break;
                };
                merge_part(input, message);
            }
        }
    }

    /// What is to be seen now, where `frame` was drawn; at the `end` of a trial the last frame.
    pub(crate) fn display_frame(
        &mut self,
        now: SimTime,
        frame: Option<Box<DisplayFrame>>,
        end: bool,
    ) -> Option<Box<DisplayFrame>> {
        let Some(display_link) = &mut self.display else { return frame };
        if end {
            return frame;
        }
        if let Some(frame) = frame {
            display_link.send(now, frame);
        }
        let mut seen = None;
        while let Some(frame) = display_link.receive(now, |_| true) {
            seen = Some(frame);
        }
        seen
    }
}

/// Takes out of `input` what goes by `link`.
fn take_link_part(link: ImpairedLink, input: &mut TickInput) -> Option<TickInput> {
    let mut part = TickInput::default();
    match link {
        ImpairedLink::Emg => part.emg = std::mem::take(&mut input.emg),
        ImpairedLink::Gestures => part.command = input.command.take(),
        ImpairedLink::Gaze => part.gaze = input.gaze.take(),
        ImpairedLink::Shoulder => part.shoulder = input.shoulder.take(),
        ImpairedLink::Limb => part.limb = input.limb.take(),
        ImpairedLink::Display => {}
    }
    let carried = |heartbeat: &Heartbeat| link.carries(heartbeat.source);
    part.heartbeats = input.heartbeats.iter().copied().filter(carried).collect();
    input.heartbeats.retain(|heartbeat| !link.carries(heartbeat.source));
    (part != TickInput::default()).then_some(part)
}

/// Puts what has come into `input`.
fn merge_part(input: &mut TickInput, part: TickInput) {
    let TickInput {
        emg,
        command,
        gaze,
        shoulder,
        limb,
        heartbeats,
        plan: _,
        method: _,
        decoder: _,
        intent: _,
        participant: _,
    } = part;
    input.emg.extend(emg);
    input.command = command.or(input.command);
    input.gaze = gaze.or(input.gaze);
    input.shoulder = shoulder.or(input.shoulder);
    input.limb = limb.or(input.limb.take());
    for sign in heartbeats {
        if !input.heartbeats.contains(&sign) {
            // More signs than there is room for say nothing new: each source has its own.
            let _ = input.heartbeats.try_push(sign);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn passed(impairments: &mut Impairments, now: SimTime, mut input: TickInput) -> TickInput {
        impairments.apply(now, &mut input);
        input
    }
    use proact_types::{Command, EmgSample, GazeSample, HeartbeatKind, Point, Vector};

    fn impaired(link: ImpairedLink, delay_ms: u64, jitter_ms: u64, loss: f64) -> LinkImpairment {
        LinkImpairment { link, delay_ms, jitter_ms, loss_probability: loss }
    }

    fn gaze(x: f64) -> TickInput {
        let sample = GazeSample { origin: Point::new(x, 0.0, 0.0), direction: Vector::x(), valid: true };
        let heartbeat = Heartbeat { source: InputSource::EyeTracker, kind: HeartbeatKind::Fresh };
        TickInput {
            gaze: Some(sample),
            heartbeats: [heartbeat].into_iter().collect(),
            ..TickInput::default()
        }
    }

    #[test]
    fn a_delay_is_kept_to_the_tick_with_the_signs_and_other_ways_are_left_alone() {
        let mut impairments = Impairments::new(&[impaired(ImpairedLink::Gaze, 100, 0, 0.0)], 1);
        let page = Heartbeat { source: InputSource::Page, kind: HeartbeatKind::Alive };
        let mut sent = gaze(1.0);
        (sent.command, sent.shoulder) = (Some(Command::HandClose), Some(proact_types::Pose::identity()));
        sent.heartbeats.push(page);
        let now = passed(&mut impairments, SimTime(5), sent);
        assert_eq!(
            (now.gaze, now.command, now.heartbeats.as_slice()),
            (None, Some(Command::HandClose), &[page][..])
        );
        assert!(now.shoulder.is_some());
        for tick in 6..105 {
            assert_eq!(passed(&mut impairments, SimTime(tick), TickInput::default()), TickInput::default());
        }
        assert_eq!(passed(&mut impairments, SimTime(105), TickInput::default()), gaze(1.0));
    }

    /// Ticks late of each of 2000 gaze measurements, 10 ms apart, that came.
    fn lateness(jitter_ms: u64, loss: f64) -> Vec<u64> {
        let mut impairments = Impairments::new(&[impaired(ImpairedLink::Gaze, 50, jitter_ms, loss)], 7);
        let (mut last, mut late) = (None, Vec::new());
        for tick in 0..21_000_u64 {
            let sent = tick.is_multiple_of(10) && tick < 20_000;
            let sent = if sent { gaze(tick as f64) } else { TickInput::default() };
            if let Some(seen) = passed(&mut impairments, SimTime(tick), sent).gaze {
                let at = seen.origin.x as u64;
                assert!(last.is_none_or(|last| at > last), "the order is kept");
                last = Some(at);
                late.push(tick - at);
            }
        }
        late
    }

    #[test]
    fn jitter_keeps_the_order_and_stays_within_its_bounds_and_losses_have_their_share() {
        let late = lateness(30, 0.0);
        assert!(late.iter().all(|late| (50..=80).contains(late)), "{late:?}");
        assert!(late.iter().any(|late| *late < 55) && late.iter().any(|late| *late > 75));
        // Standard deviation 19 of 1500.
        let came = lateness(0, 0.25).len();
        assert!((1400..1600).contains(&came), "{came} of 2000 came");
        assert_eq!(lateness(0, 1.0).len(), 0);
    }

    #[test]
    fn samples_that_come_at_once_wait_for_room_and_gestures_come_one_by_one() {
        let sample = |counter| EmgSample { counter, channels: [0.5].into_iter().collect() };
        let links = [impaired(ImpairedLink::Emg, 20, 0, 0.0), impaired(ImpairedLink::Gestures, 20, 0, 0.0)];
        let mut impairments = Impairments::new(&links, 1);
        for (input_link, due) in impairments.inputs.iter_mut().zip([30, 30]) {
            for tick in 0..5 {
                let command = (input_link.impairment.link == ImpairedLink::Gestures).then_some(match tick {
                    4 => Command::NoMotion,
                    _ => Command::WristExtension,
                });
                let emg = if command.is_none() {
                    [sample(2 * tick), sample(2 * tick + 1)].into_iter().collect()
                } else {
                    Default::default()
                };
                input_link.in_flight.push_back((due, TickInput { emg, command, ..TickInput::default() }));
            }
        }
        let all: Vec<TickInput> =
            (30..36).map(|tick| passed(&mut impairments, SimTime(tick), TickInput::default())).collect();
        assert_eq!((all[0].emg.len(), all[1].emg.len(), all[2].emg.len()), (8, 2, 0));
        let counters: Vec<u64> = all.iter().flat_map(|input| input.emg.iter().map(|s| s.counter)).collect();
        assert_eq!(counters, (0..10).collect::<Vec<_>>());
        assert_eq!(all[4].command, Some(Command::NoMotion), "the end of the motion is not passed over");
        assert_eq!(all[5].command, None);
    }

    #[test]
    fn the_same_seed_loses_the_same_and_another_seed_others() {
        let run = |seed| {
            let mut impairments = Impairments::new(&[impaired(ImpairedLink::Gaze, 0, 5, 0.5)], seed);
            (0..200)
                .map(|tick| passed(&mut impairments, SimTime(tick), gaze(tick as f64)).gaze)
                .collect::<Vec<_>>()
        };
        assert_eq!(run(3), run(3));
        assert_ne!(run(3), run(4));
    }

    #[test]
    fn what_makes_no_sense_is_refused_by_name() {
        for (impairments, part) in [
            (vec![impaired(ImpairedLink::Gaze, 10_001, 0, 0.0)], "impairments.delay_ms"),
            (vec![impaired(ImpairedLink::Gaze, 0, 10_001, 0.0)], "impairments.jitter_ms"),
            (vec![impaired(ImpairedLink::Gaze, 0, 0, f64::NAN)], "impairments.loss_probability"),
            (vec![impaired(ImpairedLink::Gestures, 0, 0, 0.1)], "loses nothing"),
            (vec![impaired(ImpairedLink::Emg, 1, 0, 0.0); 2], "Emg twice"),
        ] {
            let error = LinkImpairment::check(&impairments).expect_err("must be refused").to_string();
            assert!(error.contains(part), "{error}");
        }
        assert!(LinkImpairment::check(&[impaired(ImpairedLink::Emg, 100, 10, 1.0)]).is_ok());
    }
}
