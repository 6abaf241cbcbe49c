//! When frames were on a screen: handed to the server, come to the page, part of a picture.

use proact_types::SimTime;
use serde::Deserialize;
use std::{
    collections::VecDeque,
    time::{Duration, Instant},
};

/// Frames whose pictures are waited for: five seconds.
const MAX_SENT_FRAMES: usize = 300;
/// Ages that wait for whoever asks: more than come between two questions.
const MAX_LATENCIES: usize = 512;
/// A page that says that it took longer is mistaken, or was asleep.
const MAX_LATENCY: Duration = Duration::from_secs(10);

/// A frame that was on a picture, as the page tells it. Times are on the server's clock, as `pong` gave it to the page.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(deny_unknown_fields)]
pub(crate) struct DisplayedFrame {
    /// Which frame: its instant.
    pub(crate) time: SimTime,
    /// It had come to the page, ms.
    #[serde(rename = "came_ms")]
    pub(crate) received_ms: f64,
    /// The first picture that was no older than it had been handed to the screen, ms.
    pub(crate) shown_ms: f64,
}

/// How long a frame took to a screen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameLatency {
    /// The frame's instant.
    pub time: SimTime,
    /// From the server to the page. As exact as half the shortest round trip of the last seconds.
    pub network: Duration,
    /// From there to the screen, with the delay by which the page smooths motion.
    pub render: Duration,
}

/// Frames on their way.
#[derive(Debug)]
pub(crate) struct FrameLatencyTracker {
    start: Instant,
    sent: VecDeque<(SimTime, Instant)>,
    latencies: VecDeque<FrameLatency>,
}

impl Default for FrameLatencyTracker {
    fn default() -> Self {
        Self { start: Instant::now(), sent: VecDeque::new(), latencies: VecDeque::new() }
    }
}

impl FrameLatencyTracker {
    /// The server's clock, ms.
    pub(crate) fn clock_ms(&self, now: Instant) -> f64 {
        now.duration_since(self.start).as_secs_f64() * 1e3
    }

    /// The frame of the instant `time` goes out. One that is shown again, while time stands still, is no news.
    pub(crate) fn record_sent(&mut self, time: SimTime, now: Instant) {
        match self.sent.back() {
            Some((latest, _)) if *latest == time => return,
            // Another trial began.
            Some((latest, _)) if *latest > time => {
                self.sent.clear();
                self.latencies.clear();
            }
            _ => {}
        }
        if self.sent.len() == MAX_SENT_FRAMES {
            self.sent.pop_front();
        }
        self.sent.push_back((time, now));
    }

    /// A page saw these. What cannot be is dropped: no trial depends on it.
    pub(crate) fn record_displayed(&mut self, frames: &[DisplayedFrame]) {
        for frame in frames {
            let Some(&(_, sent)) = self.sent.iter().rev().find(|(time, _)| *time == frame.time) else {
                continue;
            };
            let sent_ms = self.clock_ms(sent);
            // A clock that is read over a line may be off by a little: a frame does not come before it goes.
            let line = checked_duration(frame.received_ms.max(sent_ms) - sent_ms);
            let Some((line, page)) = line.zip(checked_duration(frame.shown_ms - frame.received_ms)) else {
                continue;
            };
            if self.latencies.len() == MAX_LATENCIES {
                self.latencies.pop_front();
            }
            self.latencies.push_back(FrameLatency { time: frame.time, network: line, render: page });
        }
    }

    /// What pages have told since the last call.
    pub(crate) fn drain(&mut self) -> Vec<FrameLatency> {
        self.latencies.drain(..).collect()
    }
}

/// A time that can be; none for what is negative, too long or no number.
fn checked_duration(ms: f64) -> Option<Duration> {
    Duration::try_from_secs_f64(ms / 1e3).ok().filter(|span| *span <= MAX_LATENCY)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(pictures: &FrameLatencyTracker, ms: u64) -> Instant {
        pictures.start + Duration::from_millis(ms)
    }

    #[test]
    fn a_frame_is_followed_to_the_screen_and_nonsense_is_dropped() {
        let mut pictures = FrameLatencyTracker::default();
        for (time, ms) in [(16, 100), (33, 117), (33, 400), (50, 134)] {
            pictures.record_sent(SimTime(time), after(&pictures, ms));
        }
        let seen =
            |time, came_ms, shown_ms| DisplayedFrame { time: SimTime(time), received_ms: came_ms, shown_ms };
        pictures.record_displayed(&[
            seen(16, 103.0, 143.0),
            // Shown again at 400: what counts is when it went first. The page's clock is 2 ms slow.
            seen(33, 115.0, 155.0),
            seen(34, 120.0, 160.0),
            seen(50, 136.0, 130.0),
            seen(50, f64::NAN, 160.0),
            seen(50, 136.0, 1e9),
        ]);
        let ms = Duration::from_millis;
        let age =
            |time, line, page| FrameLatency { time: SimTime(time), network: ms(line), render: ms(page) };
        assert_eq!(pictures.drain(), [age(16, 3, 40), age(33, 0, 40)]);
        assert_eq!(pictures.drain(), []);

        // Another trial has the same instants; what was told of the one before and not taken is of no trial.
        pictures.record_displayed(&[seen(16, 103.0, 143.0)]);
        pictures.record_sent(SimTime(1), after(&pictures, 1000));
        pictures.record_displayed(&[seen(16, 1000.0, 1000.0)]);
        assert_eq!(pictures.drain(), []);
        for time in 0..2 * MAX_SENT_FRAMES as u64 {
            pictures.record_sent(SimTime(time + 2), after(&pictures, 2000));
        }
        assert_eq!(pictures.sent.len(), MAX_SENT_FRAMES);
        let many = vec![seen(500, 2000.0, 2000.0); 2 * MAX_LATENCIES];
        pictures.record_displayed(&many);
        assert_eq!(pictures.drain().len(), MAX_LATENCIES);
    }
}
