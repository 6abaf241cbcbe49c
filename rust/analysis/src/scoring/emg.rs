//! What the classifier of the EMG did.

use super::{Trace, joints};
use proact_types::{Command, EventKind, SimTime};

/// A gesture that came and went within this, milliseconds, between two spells of another one was nobody's wish: people take
/// 0.22 s to make a wanted one (Kuiken et al. 2009, PMC3036162).
const MAX_FALSE_TRIGGER_MS: u64 = 200;

/// Gestures in force with their beginnings, in order.
fn gesture_intervals(trace: &Trace) -> Vec<(SimTime, Command)> {
    let changes = trace.events.iter().filter_map(|event| match event.kind {
        EventKind::GestureChanged { gesture } => Some((event.time, gesture)),
        _ => None,
    });
    let changes: Vec<_> = changes.collect();
    if !changes.is_empty() || trace.has_all_events {
        return changes;
    }
    // A record without events has the gesture of each instant.
    let mut found: Vec<(SimTime, Command)> = Vec::new();
    for instant in &trace.points {
        if found.last().map_or(Command::NoMotion, |last| last.1) != instant.gesture {
            found.push((instant.time, instant.gesture));
        }
    }
    found
}

/// Gestures that came and went between two spells of one other gesture within 200 ms: when, and for how many milliseconds.
pub(super) fn false_triggers(trace: &Trace) -> Vec<(SimTime, u64)> {
    let mut spells = gesture_intervals(trace);
    spells.insert(0, (SimTime(0), Command::NoMotion));
    let between = spells.windows(3).filter(|three| three[0].1 == three[2].1);
    between
        .map(|three| (three[1].0, three[2].0.millis_since(three[1].0)))
        .filter(|(_, lasted)| *lasted <= MAX_FALSE_TRIGGER_MS)
        .collect()
}

/// Decisions a second.
pub(super) fn decision_rate(trace: &Trace) -> Option<f64> {
    let secs = trace.duration.as_secs();
    trace.decisions.filter(|_| secs > 0.0).map(|decisions| decisions as f64 / secs)
}

/// Changes of the gesture.
pub(super) fn changes(trace: &Trace) -> usize {
    gesture_intervals(trace).len()
}

/// Middle one of the times from a gesture to the motion of the arm that followed, milliseconds; none if none did.
pub(super) fn gesture_to_motion_ms(trace: &Trace) -> Option<f64> {
    let changes: Vec<(SimTime, bool)> = gesture_intervals(trace)
        .into_iter()
        .map(|(at, command)| (at, command == Command::NoMotion))
        .collect();
    let found = joints::gesture_to_motion_latencies_ms(trace, &changes);
    crate::summary::SampleSummary::of(&found).map(|summary| summary.median)
}
