//! What a node must hear again and again, and what of it has fallen silent.

use proact_types::SimTime;
use std::collections::{BTreeMap, BTreeSet};

/// A topic or a node that is silent for longer is lost, ms of simulated time: twelve messages at 100 Hz. The arm is at rest within
/// 250 ms of the last message.
pub const HEARTBEAT_TIMEOUT_MS: u64 = 120;
/// Keys that are watched, at most.
const MAX_KEYS: usize = 64;

/// When each key, a topic or a node, was heard last. A key is watched from its first message on: what was never there is not missed.
/// Pure.
#[derive(Clone, Debug)]
pub struct HeartbeatMonitor<K> {
    last_heartbeat: BTreeMap<K, SimTime>,
    stale: BTreeSet<K>,
}

impl<K> Default for HeartbeatMonitor<K> {
    fn default() -> Self {
        Self { last_heartbeat: BTreeMap::new(), stale: BTreeSet::new() }
    }
}

impl<K: Ord + Clone> HeartbeatMonitor<K> {
    /// `key` was heard at `now`. One of too many keys is not watched.
    pub fn record(&mut self, key: K, now: SimTime) {
        self.stale.remove(&key);
        if self.last_heartbeat.len() < MAX_KEYS || self.last_heartbeat.contains_key(&key) {
            self.last_heartbeat.insert(key, now);
        }
    }

    /// The keys that fell silent since the last call.
    pub fn step(&mut self, now: SimTime) -> Vec<K> {
        let is_silent = |at: &SimTime| now.millis_since(*at) > HEARTBEAT_TIMEOUT_MS;
        let late = self.last_heartbeat.iter().filter(|(_, at)| is_silent(at)).map(|(key, _)| key);
        let new: Vec<K> = late.filter(|key| !self.stale.contains(key)).cloned().collect();
        self.stale.extend(new.iter().cloned());
        new
    }

    /// The keys that are silent.
    pub fn stale(&self) -> impl Iterator<Item = &K> {
        self.stale.iter()
    }

    /// Whether `key` is watched.
    pub fn is_watched(&self, key: &K) -> bool {
        self.last_heartbeat.contains_key(key)
    }

    /// Nothing is watched until it is heard again.
    pub fn clear(&mut self) {
        self.last_heartbeat.clear();
        self.stale.clear();
    }

    /// `key` is not watched until it is heard again.
    pub fn forget(&mut self, key: &K) {
        self.last_heartbeat.remove(key);
        self.stale.remove(key);
    }
}

/// What a node says on `/proact/heartbeat`: its name, and the input that it misses.
pub fn format_heartbeat(name: &str, missed: Option<&str>) -> String {
    match missed {
        Some(input) => format!("{name} misses {input}"),
        None => name.to_owned(),
    }
}

/// Name and missed input of a heartbeat.
pub fn parse_heartbeat(text: &str) -> (&str, Option<&str>) {
    match text.split_once(" misses ") {
        Some((name, input)) => (name, Some(input)),
        None => (text, None),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_topic_is_missed_from_its_first_message_on_until_it_is_heard_again_or_forgotten() {
        let mut watch = HeartbeatMonitor::default();
        assert_eq!(watch.step(SimTime(1000)), Vec::<&str>::new(), "no topic was there");
        watch.record("state", SimTime(1000));
        watch.record("intent", SimTime(1050));
        assert_eq!(watch.step(SimTime(1000 + HEARTBEAT_TIMEOUT_MS)), Vec::<&str>::new());
        assert_eq!(watch.step(SimTime(1001 + HEARTBEAT_TIMEOUT_MS)), ["state"]);
        assert_eq!(watch.step(SimTime(1002 + HEARTBEAT_TIMEOUT_MS)), Vec::<&str>::new(), "reported once");
        assert_eq!(watch.step(SimTime(2000)), ["intent"]);
        assert_eq!(watch.stale().collect::<Vec<_>>(), [&"intent", &"state"]);
        watch.record("state", SimTime(2000));
        watch.forget(&"intent");
        assert_eq!(watch.stale().count(), 0);
        assert!(watch.is_watched(&"state") && !watch.is_watched(&"intent"));
        assert_eq!(watch.step(SimTime(3000)), ["state"], "reported again after it was back");
    }

    #[test]
    fn a_clock_that_stands_still_or_goes_back_makes_no_silence() {
        let mut watch = HeartbeatMonitor::default();
        watch.record("state", SimTime(1000));
        assert_eq!(watch.step(SimTime(1000)), Vec::<&str>::new());
        assert_eq!(watch.step(SimTime(5)), Vec::<&str>::new());
    }

    #[test]
    fn a_heartbeat_names_the_node_and_the_input_that_it_misses() {
        for missed in [None, Some("proact/state")] {
            assert_eq!(parse_heartbeat(&format_heartbeat("/lab/emg", missed)), ("/lab/emg", missed));
        }
    }

    #[test]
    fn names_without_end_take_no_memory_without_end() {
        let mut watch = HeartbeatMonitor::default();
        (0..1000).for_each(|key| watch.record(key, SimTime(1)));
        assert_eq!(watch.step(SimTime(1000)).len(), MAX_KEYS);
    }
}
