//! What a node refused: counted for `/diagnostics`, told on `/rosout`.

use super::rosout;
use crate::messages::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use std::{
    collections::BTreeMap,
    sync::{Mutex, PoisonError},
    time::{Duration, Instant},
};

/// The same kind of fault is told at most once in this time; it is counted always.
const LOG_PERIOD: Duration = Duration::from_secs(1);

#[derive(Debug, Default)]
struct RefusalCount {
    count: u64,
    logged_at: Option<Instant>,
    last_reason: String,
}

/// Faults of one node, by kind. Shared by all callbacks.
#[derive(Debug, Default)]
pub struct NodeDiagnostics {
    kinds: Mutex<BTreeMap<&'static str, RefusalCount>>,
}

impl NodeDiagnostics {
    /// Something came in that cannot be taken. `kind` is a word such as `trajectory`; `reason` one sentence.
    pub fn record_refusal(&self, kind: &'static str, reason: &str) {
        let tell = {
            let mut kinds = self.kinds.lock().unwrap_or_else(PoisonError::into_inner);
            let entry = kinds.entry(kind).or_default();
            entry.count += 1;
            entry.last_reason = reason.to_owned();
            let tell = entry.logged_at.is_none_or(|at| at.elapsed() >= LOG_PERIOD);
            if tell {
                entry.logged_at = Some(Instant::now());
            }
            tell
        };
        if tell {
            rosout::warn(&format!("refused ({kind}): {reason}"));
        }
    }

    /// A source died, `reason` says how, and the arm stands still.
    pub(super) fn record_stop(&self, reason: &str) {
        self.record_refusal("stop", &format!("{reason}: no motion until the hand relaxes"));
    }

    /// The counts as a message.
    pub(super) fn to_message(&self, node: &str, stamp: rosrust::Time) -> DiagnosticArray {
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
            add(format!("{kind} last"), entry.last_reason.clone());
        }
        let mut message = DiagnosticArray { status: vec![status], ..DiagnosticArray::default() };
        message.header.stamp = stamp;
        message
    }
}
