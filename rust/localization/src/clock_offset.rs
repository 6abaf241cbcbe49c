//! A device's clock on ours.

use crate::Nanos;
use std::collections::VecDeque;

/// How long the quickest sample counts, ns: clocks drift by some 50 us in a second.
const WINDOW: Nanos = 10_000_000_000;

/// Our clock minus the device's, from the sample that was least delayed in the last ten seconds: delays only add.
#[derive(Clone, Debug, Default)]
pub struct ClockOffset {
    /// Arrival and offset, offsets rising: the first is the least.
    offset_minima: VecDeque<(Nanos, Nanos)>,
}

impl ClockOffset {
    /// The stamp on our clock, s, as if the sample had had no delay but the least.
    pub fn update(&mut self, stamp: Nanos, arrival: Nanos) -> f64 {
        let offset = arrival.saturating_sub(stamp);
        while self.offset_minima.back().is_some_and(|(_, other)| *other >= offset) {
            self.offset_minima.pop_back();
        }
        self.offset_minima.push_back((arrival, offset));
        while self.offset_minima.front().is_some_and(|(at, _)| arrival.saturating_sub(*at) > WINDOW) {
            self.offset_minima.pop_front();
        }
        stamp.saturating_add(self.offset()) as f64 * 1e-9
    }

    /// What is added to a stamp to be on our clock, ns.
    pub fn offset(&self) -> Nanos {
        self.offset_minima.front().map_or(0, |(_, offset)| *offset)
    }
}
