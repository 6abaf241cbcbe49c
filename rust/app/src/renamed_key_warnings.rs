//! Warnings about keys that were given by an old name: each key once in a process.

use crate::print_status;
use proact_types::renamed_keys::{RenamedKey, ShownRenames};
use std::sync::{
    Mutex, PoisonError,
    atomic::{AtomicBool, Ordering},
};

static SHOWN: Mutex<ShownRenames> = Mutex::new(ShownRenames::new());
static SILENT: AtomicBool = AtomicBool::new(false);

/// Shows which keys have another name now, on standard error.
pub fn warn_of_renamed_keys(used: &[&'static RenamedKey]) {
    if SILENT.load(Ordering::Relaxed) {
        return;
    }
    for row in SHOWN.lock().unwrap_or_else(PoisonError::into_inner).first_uses(used) {
        print_status(format_args!("warning: {row}"));
    }
}

/// Shows nothing from now on: for a process that computes for another one, which has shown it.
pub(crate) fn silence_renamed_keys() {
    SILENT.store(true, Ordering::Relaxed);
}
