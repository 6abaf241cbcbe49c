//! What happens again and again is said once and counted.

use std::{
    collections::BTreeMap,
    time::{Duration, Instant},
};

/// From the first time something is said to its first count, and the longest time between two counts.
const FIRST: Duration = Duration::from_secs(10);
const LONGEST: Duration = Duration::from_secs(640);

/// Things to say, by kind. The first of a kind is said at once; what follows is counted, and the count is said with the latest
/// of them after 10 s, 20 s, 40 s and so on. A kind that was quiet for that long begins anew. Kinds are words of the program
/// and not of its clients, so that the memory is bounded.
#[derive(Clone, Debug, Default)]
pub struct Repeats {
    kinds: BTreeMap<&'static str, Kind>,
}

#[derive(Clone, Debug)]
struct Kind {
    said: Instant,
    /// Until the next count.
    wait: Duration,
    /// Not said yet, and the latest of these.
    more: u64,
    latest: String,
}

impl Repeats {
    /// Something of this kind happened: what is to be said of it now, if anything.
    pub fn tell(&mut self, kind: &'static str, text: String, now: Instant) -> Option<String> {
        match self.kinds.get_mut(kind) {
            Some(known) if known.more > 0 || now.saturating_duration_since(known.said) < known.wait => {
                known.more += 1;
                known.latest = text;
                known.due(now)
            }
            _ => {
                let first = Kind { said: now, wait: FIRST, more: 0, latest: String::new() };
                self.kinds.insert(kind, first);
                Some(text)
            }
        }
    }

    /// The counts whose time has come.
    pub fn due(&mut self, now: Instant) -> Vec<String> {
        self.kinds.values_mut().filter_map(|kind| kind.due(now)).collect()
    }

    /// The counts that are left, at the end.
    pub fn finish(&mut self) -> Vec<String> {
        std::mem::take(&mut self.kinds).into_values().filter_map(|mut kind| kind.count()).collect()
    }
}

impl Kind {
    fn due(&mut self, now: Instant) -> Option<String> {
        if now.saturating_duration_since(self.said) < self.wait {
            return None;
        }
        let text = self.count()?;
        self.said = now;
        self.wait = (self.wait * 2).min(LONGEST);
        Some(text)
    }

    fn count(&mut self) -> Option<String> {
        match std::mem::take(&mut self.more) {
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
        let (mut repeats, start) = (Repeats::default(), Instant::now());
        let mut said = Vec::new();
        // A hundred a second for a quarter of an hour, each with words of its own.
        for n in 0..90_000_u64 {
            let now = start + Duration::from_millis(10 * n);
            said.extend(repeats.tell("refused", format!("refused {n}"), now).map(|text| (n / 100, text)));
            said.extend(repeats.due(now).into_iter().map(|text| (n / 100, text)));
        }
        let seconds: Vec<u64> = said.iter().map(|(second, _)| *second).collect();
        assert_eq!(seconds, [0, 10, 30, 70, 150, 310, 630]);
        assert_eq!(said[0].1, "refused 0");
        assert_eq!(said[1].1, "refused 1000 (1000 of these since the last was said)");
        assert_eq!(repeats.kinds.len(), 1);
        let rest = repeats.finish();
        assert_eq!(rest, ["refused 89999 (26999 of these since the last was said)"]);
        assert!(repeats.finish().is_empty());
    }

    #[test]
    fn kinds_are_counted_apart_and_one_that_was_quiet_begins_anew() {
        let (mut repeats, start) = (Repeats::default(), Instant::now());
        let at = |secs| start + Duration::from_secs(secs);
        assert!(repeats.tell("lost", "lost: radio".into(), at(0)).is_some());
        assert!(repeats.tell("found", "found".into(), at(1)).is_some());
        assert_eq!(repeats.tell("lost", "lost: again".into(), at(2)), None);
        // What is counted is said even if it does not go on.
        assert_eq!(repeats.due(at(11)), ["lost: again"]);
        assert_eq!(repeats.tell("found", "found".into(), at(12)).as_deref(), Some("found"));
        assert!(repeats.due(at(100)).is_empty());
        assert_eq!(repeats.tell("lost", "lost: battery".into(), at(200)).as_deref(), Some("lost: battery"));
    }
}
