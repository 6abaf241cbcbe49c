//! `proact emg` as a process.

use std::process::{Child, Command, Stdio};

/// A process that does not outlive its test.
pub struct Running(pub Child);

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// `proact emg --json` with further words.
pub fn proact(words: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_proact"));
    command.args(["emg", "--json"]).args(words).stdin(Stdio::null());
    command
}
