//! A stage's own time.

use proact_types::SimTime;

/// Ticks as `/clock` brings them. A clock that goes back (a simulator that was started again) does not take the
/// stage's own time back: it goes on from where it was.
#[derive(Clone, Copy, Debug, Default)]
pub struct NodeClock {
    graph_time: Option<SimTime>,
    now: SimTime,
}

/// Longest step of the clock that is taken as time, ms; further on it is a jump.
const MAX_CLOCK_STEP_MS: u64 = 2000;

impl NodeClock {
    /// The stage's own time.
    pub fn now(&self) -> SimTime {
        self.now
    }

    /// The graph's time, for stamps; none before the first message.
    pub fn graph_time(&self) -> Option<SimTime> {
        self.graph_time
    }

    /// In lock-step time comes tick by tick.
    pub fn step_to(&mut self, tick: SimTime) {
        self.now = tick;
        self.graph_time = Some(tick);
    }

    /// A message came: the stage's ticks since the one before, oldest first.
    ///
    /// # Errors
    /// The clock went back or jumped; no tick has passed then.
    pub fn advance(&mut self, graph: SimTime) -> Result<std::ops::RangeInclusive<u64>, String> {
        let Some(before) = self.graph_time.replace(graph) else {
            self.now = graph;
            // Empty: no tick has passed yet.
            return Ok(graph.0 + 1..=graph.0);
        };
        if graph < before {
            return Err(format!(
                "/clock goes back from {:.3} s to {:.3} s",
                before.as_secs(),
                graph.as_secs()
            ));
        }
        let passed = graph.0 - before.0;
        if passed > MAX_CLOCK_STEP_MS {
            return Err(format!("/clock jumps by {:.3} s", passed as f64 * 1e-3));
        }
        let first = self.now.0 + 1;
        self.now = self.now.plus_millis(passed);
        Ok(first..=self.now.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_that_goes_back_is_told_and_the_stages_own_time_goes_on() {
        let mut clock = NodeClock::default();
        assert_eq!(clock.advance(SimTime(500)).map(Iterator::count), Ok(0));
        assert_eq!(clock.advance(SimTime(510)), Ok(501..=510));
        assert!(clock.advance(SimTime(3)).expect_err("it went back").contains("goes back"));
        assert_eq!((clock.now(), clock.graph_time()), (SimTime(510), Some(SimTime(3))));
        assert_eq!(clock.advance(SimTime(5)), Ok(511..=512));
        assert!(clock.advance(SimTime(900_000)).is_err());
        assert_eq!(clock.now(), SimTime(512));
    }
}
