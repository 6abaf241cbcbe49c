//! `proact emg` as a process.
// Each test uses some of it.
#![allow(dead_code)]
#![allow(clippy::unwrap_used, clippy::disallowed_methods)] // Tests of processes.

pub mod in_folder;

use serde_json::Value;
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

/// `proact emg` as a person calls it, with further words.
pub fn plain(words: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_proact"));
    command.arg("emg").args(words).stdin(Stdio::null());
    command
}

/// Lines of a stream that ran to its end.
pub fn stream(words: &[&str]) -> Vec<Value> {
    let output = proact(&[&["stream"], words].concat()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// Those lines that tell an event.
pub fn event<'a>(lines: &'a [Value], name: &str) -> Vec<&'a Value> {
    lines.iter().filter(|l| l["event"] == name).collect()
}
