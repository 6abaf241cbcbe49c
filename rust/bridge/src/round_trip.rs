//! How late what a page sends arrives, measured by echoes.
//!
//! The server sends WebSocket pings with a number. The browser's network code answers them, not the page: a page that draws slowly is
//! not late for that, and a client in any language answers by its library. A constant delay of the line, which no missing message
//! betrays, is in every round trip. Pure: the time is passed in.

use std::{
    collections::VecDeque,
    time::{Duration, Instant},
};

/// From one ping to the next while a page drives: a fifth of the default limit.
pub(crate) const PING_PERIOD: Duration = Duration::from_millis(50);
/// Pings that may wait for an answer at once; the oldest counts, so that more would tell nothing new.
const MAX_PENDING_PINGS: usize = 64;
/// A line that was delayed by more than the limit is usable again below this share of it. Without the gap, round trips that vary
/// around the limit stopped the arm and gave it back many times a second.
const RECOVERY_RATIO: f64 = 0.8;

/// The round trips of one connection.
#[derive(Debug, Default)]
pub(crate) struct RoundTripMonitor {
    last_id: u64,
    pending_pings: VecDeque<(u64, Instant)>,
    last_round_trip: Option<Duration>,
    /// It was delayed by more than the limit when that was asked for last.
    over_limit: bool,
}

impl RoundTripMonitor {
    /// What the next ping carries; none while too many wait.
    pub(crate) fn next_ping(&mut self, now: Instant) -> Option<Vec<u8>> {
        if self.pending_pings.len() >= MAX_PENDING_PINGS {
            return None;
        }
        self.last_id += 1;
        self.pending_pings.push_back((self.last_id, now));
        Some(self.last_id.to_string().into_bytes())
    }

    /// A ping came back. Its answer is one to all before it (RFC 6455, 5.5.3); what was not asked is ignored.
    pub(crate) fn record_pong(&mut self, carried: &[u8], now: Instant) {
        let is_answered = |(number, _): &(u64, Instant)| number.to_string().as_bytes() == carried;
        let Some(index) = self.pending_pings.iter().position(is_answered) else {
            return;
        };
        if let Some((_, sent_at)) = self.pending_pings.drain(..=index).next_back() {
            self.last_round_trip = Some(now.saturating_duration_since(sent_at));
        }
    }

    /// The last round trip, or the age of the oldest ping without an answer if that is longer. None for a client that never answered a
    /// ping: its library does not, and nothing is known of its line.
    pub(crate) fn round_trip_at(&self, now: Instant) -> Option<Duration> {
        let waits = self.pending_pings.front().map(|(_, sent_at)| now.saturating_duration_since(*sent_at));
        Some(self.last_round_trip?.max(waits.unwrap_or_default()))
    }

    /// [`RoundTripMonitor::round_trip_at`] while the line is delayed by more than `limit`: from a round trip above it to the first one below 0.8 of it.
    /// No limit: never.
    pub(crate) fn excess_at(&mut self, now: Instant, limit: Option<Duration>) -> Option<Duration> {
        let delay = limit.and_then(|limit| {
            let bound = if self.over_limit { limit.mul_f64(RECOVERY_RATIO) } else { limit };
            self.round_trip_at(now)
                .filter(|delay| if self.over_limit { *delay >= bound } else { *delay > bound })
        });
        self.over_limit = delay.is_some();
        delay
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_round_trip_is_measured_and_a_ping_without_an_answer_ages() {
        let (mut line, start) = (RoundTripMonitor::default(), Instant::now());
        let ms = Duration::from_millis;
        let pings: Vec<_> = (0..3).map(|k| line.next_ping(start + ms(50 * k)).unwrap()).collect();
        assert_eq!(line.round_trip_at(start + ms(900)), None, "a client that never answers is not judged");
        line.record_pong(b"nonsense", start + ms(300));
        line.record_pong(&pings[1], start + ms(310));
        assert_eq!(
            line.round_trip_at(start + ms(310)),
            Some(ms(260)),
            "the later answer counts for the earlier ping"
        );
        line.record_pong(&pings[1], start + ms(900));
        assert_eq!(line.round_trip_at(start + ms(500)), Some(ms(400)), "the third waits since 100 ms");
        line.record_pong(&pings[2], start + ms(500));
        line.next_ping(start + ms(500));
        assert_eq!(line.round_trip_at(start + ms(510)), Some(ms(400)));
    }

    /// Round trips of 240 and 260 ms in turns, with a limit of 250 ms, stopped the arm at each second one.
    #[test]
    fn round_trips_around_the_limit_delay_a_line_once_until_they_are_well_below_it() {
        let (mut line, mut now) = (RoundTripMonitor::default(), Instant::now());
        let (ms, limit) = (Duration::from_millis, Some(Duration::from_millis(250)));
        let mut over = |trip: u64, limit| {
            let ping = line.next_ping(now).unwrap();
            now += ms(trip);
            line.record_pong(&ping, now);
            line.excess_at(now, limit).map(|delay| delay.as_millis())
        };
        assert_eq!(over(250, limit), None, "the limit itself is allowed");
        let around: Vec<_> = [240, 260, 240, 251, 249, 260, 200].map(|trip| over(trip, limit)).into();
        let expected = [None, Some(260), Some(240), Some(251), Some(249), Some(260), Some(200)];
        assert_eq!(around, expected);
        assert_eq!([199, 249, 251].map(|trip| over(trip, limit)), [None, None, Some(251)]);
        assert_eq!(over(251, None), None);
        assert_eq!(over(249, limit), None, "without a limit nothing is over it");
    }

    #[test]
    fn pings_that_nobody_answers_do_not_pile_up() {
        let (mut line, start) = (RoundTripMonitor::default(), Instant::now());
        assert_eq!((0..1000).filter_map(|_| line.next_ping(start)).count(), MAX_PENDING_PINGS);
    }
}
