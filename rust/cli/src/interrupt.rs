//! Signals that ask the program to end, and one that is only a full disk by another name.

use signal_hook::{
    consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ},
    flag,
};
use std::{
    io,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

/// Exit code of a program that a second Ctrl-C ended, as shells count: 128 and the signal's number.
const INTERRUPTED_EXIT_CODE: i32 = 128 + SIGINT;

/// Blocks until the flag is raised.
pub(crate) fn wait_for_interrupt(interrupted: &AtomicBool) {
    while !interrupted.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// A flag that Ctrl-C, SIGTERM and the end of the terminal raise, so that records and recordings are closed. A second
/// Ctrl-C ends the program at once. A program that was started to outlive its terminal, as by `nohup`, does.
///
/// # Errors
/// The system refuses.
pub(crate) fn interrupt_flag() -> io::Result<Arc<AtomicBool>> {
    let raised = Arc::new(AtomicBool::new(false));
    flag::register_conditional_shutdown(SIGINT, INTERRUPTED_EXIT_CODE, Arc::clone(&raised))?;
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        if signal != SIGHUP || !is_signal_ignored(SIGHUP) {
            flag::register(signal, Arc::clone(&raised))?;
        }
    }
    Ok(raised)
}

/// Makes a file that reaches its limit (`ulimit -f`) an error of the write, instead of the end of the program.
///
/// # Errors
/// The system refuses.
pub(crate) fn ignore_file_size_signal() -> io::Result<()> {
    flag::register(SIGXFSZ, Arc::default()).map(|_| ())
}

/// Whether whoever started the program had it ignore a signal.
fn is_signal_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    mask & (1 << (signal - 1)) != 0
}
