//! What happens again and again is said once and counted.

use std::{
    collections::BTreeMap,
    time::{Duration, Instant},
};

/// From the first time something is said to its first count, and the longest time between two counts.
const FIRST_INTERVAL: Duration = Duration::from_secs(10);
const MAX_INTERVAL: Duration = Duration::from_secs(640);

/// Things to say, by kind. The first of a kind is said at once; what follows is counted, and the count is said with the latest
/// of them after 10 s, 20 s, 40 s and so on. A kind that was quiet for that long begins anew. Kinds are words of the program
/// and not of its clients, so that the memory is bounded.
#[derive(Clone, Debug, Default)]
pub struct LogThrottle {
    kinds: BTreeMap<&'static str, ThrottledMessage>,
}

#[derive(Clone, Debug)]
struct ThrottledMessage {
    last_reported: Instant,
    /// Until the next count.
    interval: Duration,
    /// Not said yet, and the latest of these.
    suppressed_count: u64,
    latest: String,
}

impl LogThrottle {
    /// Something of this kind happened: what is to be said of it now, if anything.
    pub fn report(&mut self, kind: &'static str, text: String, now: Instant) -> Option<String> {
        match self.kinds.get_mut(kind) {
            Some(known)
                if known.suppressed_count > 0
                    || now.saturating_duration_since(known.last_reported) < known.interval =>
            {
                known.suppressed_count += 1;
                known.latest = text;
                known.take_due(now)
            }
            _ => {
                let first = ThrottledMessage {
                    last_reported: now,
                    interval: FIRST_INTERVAL,
                    suppressed_count: 0,
                    latest: String::new(),
                };
                self.kinds.insert(kind, first);
                Some(text)
            }
        }
    }

    /// The counts whose time has come.
    pub fn take_due(&mut self, now: Instant) -> Vec<String> {
        self.kinds.values_mut().filter_map(|kind| kind.take_due(now)).collect()
    }

    /// The counts that are left, at the end.
    pub fn flush(&mut self) -> Vec<String> {
        std::mem::take(&mut self.kinds).into_values().filter_map(|mut kind| kind.take_summary()).collect()
    }
}

impl ThrottledMessage {
    fn take_due(&mut self, now: Instant) -> Option<String> {
        if now.saturating_duration_since(self.last_reported) < self.interval {
            return None;
        }
        let text = self.take_summary()?;
        self.last_reported = now;
        self.interval = (self.interval * 2).min(MAX_INTERVAL);
        Some(text)
    }

    fn take_summary(&mut self) -> Option<String> {
        match std::mem::take(&mut self.suppressed_count) {
            0 => None,
            1 => Some(std::mem::take(&mut self.latest)),
            more => Some(format!(
                "{} ({more} of these since the last was said)",
                std::mem::take(&mut self.latest)
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_is_said_at_once_and_the_rest_is_counted_at_growing_intervals() {
        let (mut repeats, start) = (LogThrottle::default(), Instant::now());
        let mut logged = Vec::new();
        // A hundred a second for a quarter of an hour, each with words of its own.
        for n in 0..90_000_u64 {
            let now = start + Duration::from_millis(10 * n);
            logged.extend(repeats.report("refused", format!("refused {n}"), now).map(|text| (n / 100, text)));
            logged.extend(repeats.take_due(now).into_iter().map(|text| (n / 100, text)));
        }
        let seconds: Vec<u64> = logged.iter().map(|(second, _)| *second).collect();
        assert_eq!(seconds, [0, 10, 30, 70, 150, 310, 630]);
        assert_eq!(logged[0].1, "refused 0");
        assert_eq!(logged[1].1, "refused 1000 (1000 of these since the last was said)");
        assert_eq!(repeats.kinds.len(), 1);
        let rest = repeats.flush();
        assert_eq!(rest, ["refused 89999 (26999 of these since the last was said)"]);
        assert!(repeats.flush().is_empty());
    }

    #[test]
    fn kinds_are_counted_apart_and_one_that_was_quiet_begins_anew() {
        let (mut repeats, start) = (LogThrottle::default(), Instant::now());
        let at = |secs| start + Duration::from_secs(secs);
        assert!(repeats.report("lost", "lost: radio".into(), at(0)).is_some());
        assert!(repeats.report("found", "found".into(), at(1)).is_some());
        assert_eq!(repeats.report("lost", "lost: again".into(), at(2)), None);
        // What is counted is said even if it does not go on.
        assert_eq!(repeats.take_due(at(11)), ["lost: again"]);
        assert_eq!(repeats.report("found", "found".into(), at(12)).as_deref(), Some("found"));
        assert!(repeats.take_due(at(100)).is_empty());
        assert_eq!(repeats.report("lost", "lost: battery".into(), at(200)).as_deref(), Some("lost: battery"));
    }
}
