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
pub(crate) const ECHO_PERIOD: Duration = Duration::from_millis(50);
/// Pings that may wait for an answer at once; the oldest counts, so that more would tell nothing new.
const MOST_WAITING: usize = 64;

/// The round trips of one connection.
#[derive(Debug, Default)]
pub(crate) struct LineDelay {
    next: u64,
    waiting: VecDeque<(u64, Instant)>,
    measured: Option<Duration>,
}

impl LineDelay {
    /// What the next ping carries; none while too many wait.
    pub(crate) fn ask(&mut self, now: Instant) -> Option<Vec<u8>> {
        if self.waiting.len() >= MOST_WAITING {
            return None;
        }
        self.next += 1;
        self.waiting.push_back((self.next, now));
        Some(self.next.to_string().into_bytes())
    }

    /// A ping came back. Its answer is one to all before it (RFC 6455, 5.5.3); what was not asked is ignored.
    pub(crate) fn answer(&mut self, carried: &[u8], now: Instant) {
        let is_asked = |(number, _): &(u64, Instant)| number.to_string().as_bytes() == carried;
        let Some(place) = self.waiting.iter().position(is_asked) else {
            return;
        };
        if let Some((_, asked)) = self.waiting.drain(..=place).next_back() {
            self.measured = Some(now.saturating_duration_since(asked));
        }
    }

    /// The last round trip, or the age of the oldest ping without an answer if that is longer. None for a client that never answered a
    /// ping: its library does not, and nothing is known of its line.
    pub(crate) fn at(&self, now: Instant) -> Option<Duration> {
        let waits = self.waiting.front().map(|(_, asked)| now.saturating_duration_since(*asked));
        Some(self.measured?.max(waits.unwrap_or_default()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_round_trip_is_measured_and_a_ping_without_an_answer_ages() {
        let (mut line, start) = (LineDelay::default(), Instant::now());
        let ms = Duration::from_millis;
        let asked: Vec<_> = (0..3).map(|k| line.ask(start + ms(50 * k)).unwrap()).collect();
        assert_eq!(line.at(start + ms(900)), None, "a client that never answers is not judged");
        line.answer(b"nonsense", start + ms(300));
        line.answer(&asked[1], start + ms(310));
        assert_eq!(line.at(start + ms(310)), Some(ms(260)), "the later answer counts for the earlier ping");
        line.answer(&asked[1], start + ms(900));
        assert_eq!(line.at(start + ms(500)), Some(ms(400)), "the third waits since 100 ms");
        line.answer(&asked[2], start + ms(500));
        line.ask(start + ms(500));
        assert_eq!(line.at(start + ms(510)), Some(ms(400)));
    }

    #[test]
    fn pings_that_nobody_answers_do_not_pile_up() {
        let (mut line, start) = (LineDelay::default(), Instant::now());
        assert_eq!((0..1000).filter_map(|_| line.ask(start)).count(), MOST_WAITING);
    }
}
