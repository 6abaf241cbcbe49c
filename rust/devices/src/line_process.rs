//! A program that is asked line by line, with a thread for each direction, so that nobody waits longer than they may.

use serde::Deserialize;
use std::{
    io::{self, BufRead, BufReader, Read, Write},
    process::{Child, ChildStdin, ChildStdout, Command, Stdio},
    sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TryRecvError, TrySendError, sync_channel},
    thread,
    time::{Duration, Instant},
};

/// Lines under way in each direction: a process that does not read, or says too much, must not hold up the tick.
const MAX_QUEUED_LINES: usize = 32;

/// Milliseconds that a process which has closed its output may take to end.
const EXIT_GRACE_MS: u32 = 50;

/// Why a line has no answer.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LineProcessError {
    /// Nothing came in time. The process may still answer, which is skipped then.
    #[error("the process has not answered within {} ms", timeout.as_millis())]
    Timeout {
        /// Time that was waited.
        timeout: Duration,
    },
    /// It does not read its input, so that lines wait for it.
    #[error("the process does not read its input, or says more than one line for each that it reads")]
    InputNotRead,
    /// It has ended, or says what is no line.
    #[error("{0}")]
    Broken(String),
}

/// A program that reads and writes lines. It is ended when this is dropped.
#[derive(Debug)]
pub struct LineProcess {
    child: Child,
    lines: Option<SyncSender<String>>,
    answers: Receiver<Result<String, String>>,
    /// Stamps of lines that were not answered in time, rising.
    unanswered: Vec<u64>,
    /// Milliseconds that may be waited for its end.
    exit_grace_ms: u32,
}

/// What an answer says of the line that it answers.
#[derive(Deserialize)]
struct AnswerStamp {
    #[serde(alias = "window")]
    time: u64,
}

impl LineProcess {
    /// Starts `command`, a program and its arguments. Lines of up to `longest_line` bytes are answers.
    ///
    /// # Errors
    /// If the program cannot be started, or there is none.
    pub fn start(command: &[String], longest_line: u64) -> io::Result<LineProcess> {
        let (program, arguments) =
            command.split_first().ok_or_else(|| io::Error::from(io::ErrorKind::InvalidInput))?;
        let mut child =
            Command::new(program).args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
        let (lines, to_write) = sync_channel(MAX_QUEUED_LINES);
        let (answer_sender, answers) = sync_channel(MAX_QUEUED_LINES);
        if let (Some(input), Some(output)) = (child.stdin.take(), child.stdout.take()) {
            thread::spawn(move || write(input, &to_write));
            thread::spawn(move || read(output, longest_line, &answer_sender));
        }
        Ok(LineProcess {
            child,
            lines: Some(lines),
            answers,
            unanswered: Vec::new(),
            exit_grace_ms: EXIT_GRACE_MS,
        })
    }

    /// Writes `line` and waits at most for `timeout` for its answer. Answers to earlier lines (by their `time` or `window`) that
    /// were not answered in time are skipped; all else is given.
    ///
    /// # Errors
    /// [`LineProcessError`].
    pub fn ask(&mut self, stamp: u64, line: String, timeout: Duration) -> Result<String, LineProcessError> {
        match self.lines.as_ref().map(|lines| lines.try_send(line)) {
            Some(Ok(())) => {}
            Some(Err(TrySendError::Full(_))) => {
                return Err(self.pending_failure().unwrap_or(LineProcessError::InputNotRead));
            }
            Some(Err(TrySendError::Disconnected(_))) | None => {
                return Err(self.pending_failure().unwrap_or_else(|| self.exit_reason()));
            }
        }
        let deadline = Instant::now() + timeout;
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            let answer = match self.answers.recv_timeout(left) {
                Ok(answer) => answer.map_err(LineProcessError::Broken)?,
                Err(RecvTimeoutError::Timeout) => {
                    self.unanswered.push(stamp);
                    return Err(LineProcessError::Timeout { timeout });
                }
                Err(RecvTimeoutError::Disconnected) => return Err(self.exit_reason()),
            };
            match serde_json::from_str::<AnswerStamp>(&answer) {
                Ok(late) if late.time < stamp && self.unanswered.contains(&late.time) => {
                    self.unanswered.retain(|missed| *missed > late.time);
                }
                _ => return Ok(answer),
            }
        }
    }

    /// What was wrong with what it said, if nothing can come behind it; answers that wait before are dropped.
    fn pending_failure(&mut self) -> Option<LineProcessError> {
        loop {
            match self.answers.try_recv() {
                Ok(Ok(_)) => {}
                Ok(Err(reason)) => return Some(LineProcessError::Broken(reason)),
                Err(TryRecvError::Empty) => return None,
                Err(TryRecvError::Disconnected) => return Some(self.exit_reason()),
            }
        }
    }

    /// Why nothing comes any more. A process that has just closed its output takes a moment to end: its exit status says more.
    fn exit_reason(&mut self) -> LineProcessError {
        for _ in 0..std::mem::take(&mut self.exit_grace_ms) {
            if !matches!(self.child.try_wait(), Ok(None)) {
                break;
            }
            thread::sleep(Duration::from_millis(1));
        }
        LineProcessError::Broken(match self.child.try_wait() {
            Ok(Some(status)) => format!("the process has ended ({status})"),
            _ => "the process has closed its output".to_owned(),
        })
    }
}

/// Ends when the process does not listen any more, or nobody writes.
fn write(mut input: ChildStdin, lines: &Receiver<String>) {
    while let Ok(line) = lines.recv() {
        if writeln!(input, "{line}").and_then(|()| input.flush()).is_err() {
            return;
        }
    }
}

/// Ends when the process says no more, or nobody listens.
fn read(output: ChildStdout, longest_line: u64, answer_sender: &SyncSender<Result<String, String>>) {
    let mut output = BufReader::new(output);
    loop {
        let mut line = Vec::new();
        let read = output.by_ref().take(longest_line).read_until(b'\n', &mut line);
        let answer = match read {
            Ok(0) => return,
            Ok(_) if line.ends_with(b"\n") => Ok(String::from_utf8_lossy(&line).trim_end().to_owned()),
            Ok(_) => Err(format!("the process broke off, or wrote a line over {longest_line} bytes")),
            Err(error) => Err(format!("the process cannot be heard: {error}")),
        };
        let over = answer.is_err();
        if answer_sender.send(answer).is_err() || over {
            return;
        }
    }
}

impl Drop for LineProcess {
    fn drop(&mut self) {
        // Its input ends first; what does not end by itself then is ended.
        self.lines = None;
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Catches an answer with the stamp of an earlier line that was skipped until the deadline, and called no answer.
    #[test]
    fn an_answer_to_a_line_that_was_answered_already_is_given_and_not_skipped() {
        let command = ["sh", "-c", "while read -r line; do echo '{\"time\": 5}'; done"].map(str::to_owned);
        let mut process = LineProcess::start(&command, 100).expect("there is a shell");
        for stamp in [5, 10] {
            let answer = process.ask(stamp, "{}".to_owned(), Duration::from_secs(60));
            assert_eq!(answer, Ok("{\"time\": 5}".to_owned()));
        }
    }
}
