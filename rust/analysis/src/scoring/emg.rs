//! What the classifier of the EMG did.

use super::{Trace, joints};
use proact_types::{EventKind, Gesture, SimTime};

/// A gesture that came and went within this, milliseconds, between two spells of another one was nobody's wish: people take
/// 0.22 s to make a wanted one (Kuiken et al. 2009, PMC3036162).
const BURST_MS: u64 = 200;

/// Gestures in force with their beginnings, in order.
fn spells(trace: &Trace) -> Vec<(SimTime, Gesture)> {
    let told = trace.events.iter().filter_map(|event| match event.kind {
        EventKind::GestureChanged { gesture } => Some((event.time, gesture)),
        _ => None,
    });
    let told: Vec<_> = told.collect();
    if !told.is_empty() || trace.tells_events {
        return told;
    }
    // A record without events has the gesture of each instant.
    let mut found: Vec<(SimTime, Gesture)> = Vec::new();
    for instant in &trace.instants {
        if found.last().map_or(Gesture::NoMotion, |last| last.1) != instant.gesture {
            found.push((instant.time, instant.gesture));
        }
    }
    found
}

/// Gestures that came and went between two spells of one other gesture within 200 ms: when, and for how many milliseconds.
pub(super) fn bursts(trace: &Trace) -> Vec<(SimTime, u64)> {
    let mut spells = spells(trace);
    spells.insert(0, (SimTime(0), Gesture::NoMotion));
    let between = spells.windows(3).filter(|three| three[0].1 == three[2].1);
    between
        .map(|three| (three[1].0, three[2].0.millis_since(three[1].0)))
        .filter(|(_, lasted)| *lasted <= BURST_MS)
        .collect()
}

/// Decisions a second.
pub(super) fn decision_rate(trace: &Trace) -> Option<f64> {
    let secs = trace.length.as_secs();
    trace.decisions.filter(|_| secs > 0.0).map(|decisions| decisions as f64 / secs)
}

/// Changes of the gesture.
pub(super) fn changes(trace: &Trace) -> usize {
    spells(trace).len()
}

/// Middle one of the times from a gesture to the motion of the arm that followed, milliseconds; none if none did.
pub(super) fn latency(trace: &Trace) -> Option<f64> {
    let changes: Vec<(SimTime, bool)> =
        spells(trace).into_iter().map(|(at, gesture)| (at, gesture == Gesture::NoMotion)).collect();
    let found = joints::latencies(trace, &changes);
    crate::summary::SampleSummary::of(&found).map(|summary| summary.median)
}
