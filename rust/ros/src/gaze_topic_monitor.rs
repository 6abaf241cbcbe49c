//! What other people's topics tell of the eye tracker, and of the node that infers from gaze what is meant.
//!
//! The original's intent node publishes `/block_id` and `/gaze_table_hit_location_logging` with every gaze, but
//! `/gaze_table_hit_location` only while the gaze meets the table where blocks are put down: its absence means nothing.

use proact_types::SimTime;

/// A block's name is no measurement: it says that the tracker measures only if no topic with numbers came within this time, ms.
const MEASUREMENT_TIMEOUT_MS: u64 = 200;

/// A topic that tells of gaze.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GazeTopic {
    /// `/gaze_position`: of the headset.
    Position,
    /// `/gaze_direction`: of the headset.
    Direction,
    /// `/gaze_table_hit_location_logging`: with every gaze that meets the table's plane.
    LoggedHit,
    /// `/gaze_table_hit_location`: only where blocks are put down.
    Hit,
    /// `/block_id`: with every gaze, and it may rightly stay the same.
    Block,
}

/// What a message says of the eye tracker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GazeUpdate {
    /// A new measurement.
    Fresh,
    /// The same values as in the message before.
    Repeated,
}

/// Judges messages by what came before. Pure.
#[derive(Clone, Debug, Default)]
pub struct GazeTopicMonitor {
    /// The last values of each topic that has any.
    last: [Option<[f64; 3]>; 4],
    /// When a topic with values came last.
    measured_at: Option<SimTime>,
    /// When the intent node published anything, and whether it publishes with every gaze.
    inferred_at: Option<SimTime>,
    publishes_every_gaze: bool,
}

impl GazeTopicMonitor {
    /// `topic` brought `values` at `now`; of [`GazeTopic::Block`] they do not count. None: the message says nothing of the tracker.
    pub fn record(&mut self, now: SimTime, topic: GazeTopic, values: [f64; 3]) -> Option<GazeUpdate> {
        if matches!(topic, GazeTopic::LoggedHit | GazeTopic::Hit | GazeTopic::Block) {
            self.inferred_at = Some(now);
            self.publishes_every_gaze |= topic != GazeTopic::Hit;
        }
        if topic == GazeTopic::Block {
            let measures = self.measured_at.is_some_and(|at| now.millis_since(at) <= MEASUREMENT_TIMEOUT_MS);
            return (!measures).then_some(GazeUpdate::Fresh);
        }
        self.measured_at = Some(now);
        let repeats = self.last[topic as usize].replace(values) == Some(values);
        Some(if repeats { GazeUpdate::Repeated } else { GazeUpdate::Fresh })
    }

    /// Whether an intent node that publishes with every gaze has published nothing for longer than `limit_ms`.
    pub fn intent_is_stale(&self, now: SimTime, limit_ms: u64) -> bool {
        self.publishes_every_gaze && self.inferred_at.is_some_and(|at| now.millis_since(at) > limit_ms)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use GazeTopic::{Block, Direction, Hit, LoggedHit, Position};
    use GazeUpdate::{Fresh, Repeated};

    const AT: [f64; 3] = [0.1, 0.2, 1.015];

    #[test]
    fn a_block_tells_of_the_tracker_only_where_nothing_else_does() {
        let mut monitor = GazeTopicMonitor::default();
        assert_eq!(monitor.record(SimTime(10), Block, AT), Some(Fresh));
        assert_eq!(monitor.record(SimTime(30), Hit, AT), Some(Fresh));
        assert_eq!(monitor.record(SimTime(50), Hit, AT), Some(Repeated), "a frozen tracker");
        assert_eq!(monitor.record(SimTime(51), Block, AT), None);
        // The gaze leaves the place region: no hit any more, and the tracker is alive.
        assert_eq!(monitor.record(SimTime(51 + MEASUREMENT_TIMEOUT_MS), Block, AT), Some(Fresh));
    }

    #[test]
    fn any_topic_with_new_values_says_that_the_tracker_measures() {
        let mut monitor = GazeTopicMonitor::default();
        for topic in [Position, Direction, LoggedHit, Hit] {
            assert_eq!(monitor.record(SimTime(1), topic, AT), Some(Fresh), "{topic:?}");
            assert_eq!(monitor.record(SimTime(2), topic, AT), Some(Repeated), "{topic:?}");
        }
        // The head rests and the eye moves.
        assert_eq!(monitor.record(SimTime(3), Position, AT), Some(Repeated));
        assert_eq!(monitor.record(SimTime(3), Direction, [1.0, 0.0, 0.0]), Some(Fresh));
    }

    #[test]
    fn an_intent_node_is_missed_only_if_it_publishes_with_every_gaze() {
        let mut monitor = GazeTopicMonitor::default();
        monitor.record(SimTime(1), Hit, AT);
        assert!(!monitor.intent_is_stale(SimTime(5000), 1000), "the gaze is elsewhere");
        monitor.record(SimTime(5000), Block, AT);
        monitor.record(SimTime(5900), Direction, AT);
        assert!(!monitor.intent_is_stale(SimTime(6000), 1000));
        assert!(monitor.intent_is_stale(SimTime(6001), 1000), "the headset goes on, the node does not");
        monitor.record(SimTime(6002), LoggedHit, AT);
        assert!(!monitor.intent_is_stale(SimTime(6003), 1000));
    }
}
