//! What a node refused: counted for `/diagnostics`, told on `/rosout`.

use crate::messages::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use std::{
    collections::BTreeMap,
    sync::{Mutex, PoisonError},
    time::{Duration, Instant},
};

/// The same kind of fault is told at most once in this time; it is counted always.
const TELL_AGAIN: Duration = Duration::from_secs(1);

#[derive(Debug, Default)]
struct Kind {
    count: u64,
    told: Option<Instant>,
    last: String,
}

/// Faults of one node, by kind. Shared by all callbacks.
#[derive(Debug, Default)]
pub struct Faults {
    kinds: Mutex<BTreeMap<&'static str, Kind>>,
}

impl Faults {
    /// Something came in that cannot be taken. `kind` is a word such as `trajectory`; `reason` one sentence.
    pub fn refuse(&self, kind: &'static str, reason: &str) {
        let tell = {
            let mut kinds = self.kinds.lock().unwrap_or_else(PoisonError::into_inner);
            let entry = kinds.entry(kind).or_default();
            entry.count += 1;
            entry.last = reason.to_owned();
            let tell = entry.told.is_none_or(|at| at.elapsed() >= TELL_AGAIN);
            if tell {
                entry.told = Some(Instant::now());
            }
            tell
        };
        if tell {
            rosrust::log(
                rosrust::msg::rosgraph_msgs::Log::WARN,
                format!("refused ({kind}): {reason}"),
                file!(),
                line!(),
            );
        }
    }

    /// A source died, `reason` says how, and the arm stands still.
    pub(super) fn stop(&self, reason: &str) {
        self.refuse("stop", &format!("{reason}: no motion until it is back and the hand relaxed"));
    }

    /// The counts as a message.
    pub(super) fn message(&self, node: &str, stamp: rosrust::Time) -> DiagnosticArray {
        let kinds = self.kinds.lock().unwrap_or_else(PoisonError::into_inner);
        let total: u64 = kinds.values().map(|k| k.count).sum();
        let mut status = DiagnosticStatus {
            level: if total == 0 { DiagnosticStatus::OK } else { DiagnosticStatus::WARN },
            name: format!("{node}: input"),
            message: if total == 0 {
                "nothing refused".to_owned()
            } else {
                format!("{total} messages refused")
            },
            hardware_id: node.to_owned(),
            values: vec![],
        };
        for (kind, entry) in kinds.iter() {
            let mut add = |key: String, value: String| status.values.push(KeyValue { key, value });
            add(format!("{kind} refused"), entry.count.to_string());
            add(format!("{kind} last"), entry.last.clone());
        }
        let mut message = DiagnosticArray { status: vec![status], ..DiagnosticArray::default() };
        message.header.stamp = stamp;
        message
    }
}
