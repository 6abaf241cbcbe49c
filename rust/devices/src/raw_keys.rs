use std::{
    io::{IsTerminal, Read, stdin},
    process::{Command, Stdio},
};

/// Standard input, key by key where it is a terminal; the terminal is put right again in the end.
pub(crate) struct RawKeys {
    terminal: bool,
}

impl RawKeys {
    pub(crate) fn new() -> RawKeys {
        let terminal = stdin().is_terminal() && stty(&["-icanon", "-echo"]);
        RawKeys { terminal }
    }
}

/// Without it a key needs Enter after it, which is no reason to stop.
fn stty(words: &[&str]) -> bool {
    let command = Command::new("stty").args(words).stdin(Stdio::inherit()).status();
    command.is_ok_and(|status| status.success())
}

impl Read for RawKeys {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        stdin().read(buffer)
    }
}

impl Drop for RawKeys {
    fn drop(&mut self) {
        if self.terminal {
            stty(&["icanon", "echo"]);
        }
    }
}
