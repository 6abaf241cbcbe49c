//! Notices a client whose gaze stands still, as that of an eye tracker never does.

use proact_messages::{MessageValue, original::topic};
use std::time::{Duration, Instant};

/// The ray that one client published last, and since when it is the same.
#[derive(Debug)]
pub(crate) struct FrozenGazeDetector {
    /// None: a gaze that stands still is never reported.
    timeout: Option<Duration>,
    /// Position and direction, without their headers.
    ray: [Option<MessageValue>; 2],
    last_change: Option<Instant>,
    reported: bool,
}

impl FrozenGazeDetector {
    /// A gaze that is the same for longer than `limit` is frozen.
    pub(crate) fn new(limit: Option<Duration>) -> Self {
        Self { timeout: limit, ray: [None, None], last_change: None, reported: false }
    }

    /// Takes a message of any topic. The reason, once, if the gaze has been the same for too long.
    pub(crate) fn check(&mut self, topic: &str, message: &MessageValue, now: Instant) -> Option<String> {
        let limit = self.timeout?;
        let half = [topic::GAZE_POSITION, topic::GAZE_DIRECTION].iter().position(|name| *name == topic)?;
        let vector = message.get("vector")?;
        if self.ray[half].as_ref() != Some(vector) {
            self.ray[half] = Some(vector.clone());
            (self.last_change, self.reported) = (Some(now), false);
        }
        let still = now.saturating_duration_since(self.last_change?);
        if self.reported || still <= limit {
            return None;
        }
        self.reported = true;
        Some(format!(
            "{} and {} have been the same for {:.1} s: that is a frozen eye tracker, and methods that use gaze stop the arm \
             until it changes; this is reported once",
            topic::GAZE_POSITION,
            topic::GAZE_DIRECTION,
            still.as_secs_f64()
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn vector(x: f64) -> MessageValue {
        let number = |name: &str, value| (name.into(), MessageValue::Float(value));
        let vector = MessageValue::Message(vec![number("x", x), number("y", 0.0), number("z", -1.0)]);
        // A header that differs in each message makes no measurement of it.
        MessageValue::Message(vec![
            ("header".into(), MessageValue::Uint((x * 1e6) as u64)),
            ("vector".into(), vector),
        ])
    }

    #[test]
    fn a_gaze_that_stands_still_is_reported_once_and_again_after_it_has_moved() {
        let (start, limit) = (Instant::now(), Duration::from_secs(1));
        let mut gaze = FrozenGazeDetector::new(Some(limit));
        let mut frozen_count = |ms: u64, eye: f64, direction: f64| {
            let now = start + Duration::from_millis(ms);
            let both = [(topic::GAZE_POSITION, eye), (topic::GAZE_DIRECTION, direction)];
            both.into_iter().filter_map(|(name, x)| gaze.check(name, &vector(x), now)).count()
        };
        // The head rests, the eye moves.
        assert_eq!((0..300).map(|k| frozen_count(10 * k, 0.5, 1e-4 * k as f64)).sum::<usize>(), 0);
        assert_eq!((300..500).map(|k| frozen_count(10 * k, 0.5, 0.7)).sum::<usize>(), 1, "once");
        assert_eq!(
            (500..900).map(|k| frozen_count(10 * k, 0.5, 0.8)).sum::<usize>(),
            1,
            "it moved in between"
        );
    }

    #[test]
    fn other_topics_and_other_shapes_are_no_gaze() {
        let (start, late) = (Instant::now(), Instant::now() + Duration::from_secs(60));
        let mut gaze = FrozenGazeDetector::new(Some(Duration::from_secs(1)));
        for now in [start, late] {
            assert_eq!(gaze.check("/hololens/head", &vector(1.0), now), None);
            assert_eq!(gaze.check(topic::GAZE_POSITION, &MessageValue::Uint(1), now), None);
        }
        let mut none = FrozenGazeDetector::new(None);
        assert_eq!(
            [start, late].map(|now| none.check(topic::GAZE_POSITION, &vector(1.0), now)),
            [None, None]
        );
    }
}
