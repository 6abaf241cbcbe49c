//! A control method in another process: started here, asked line by line, ended with the trial.

use crate::vmpl::{VMPL_COMMAND, VmplError, VmplMethod};
use proact_arm::ArmModel;
use proact_control::{ControlError, MethodEntry, MethodProgram, ports::MethodProcess};
use proact_types::{MOST_TEXT_BYTES, MethodAnswer, SimTime, read_text};
use serde::Deserialize;
use std::{
    fs::File,
    io::{BufRead, BufReader, Read, Write},
    path::{Path, PathBuf},
    process::{Child, ChildStdin, ChildStdout, Command, Stdio},
    sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel},
    thread,
    time::{Duration, Instant},
};

/// A line longer than this is no answer, bytes.
const LONGEST_LINE: u64 = 1 << 20;
/// Lines under way in each direction: a process that does not read, or says too much, must not hold up the tick.
const MOST_LINES: usize = 32;
/// In a batch each answer is waited for, but not for ever.
const BATCH_PATIENCE: Duration = Duration::from_secs(10);

/// Why a method in another process cannot be asked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MethodProcessError {
    /// The program does not start.
    #[error(
        "the method {command:?} does not start: {source}; give a program that reads and writes JSON lines"
    )]
    Start {
        /// The program and its arguments.
        command: Vec<String>,
        /// Why.
        source: std::io::Error,
    },
    /// The decoder of a vMPL cannot be listened to.
    #[error("method vmpl: {0}")]
    Vmpl(#[from] VmplError),
}

/// Why the file of an outside method is of no use.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MethodFileError {
    /// The disk refuses.
    #[error("cannot read {}: {source}; give the file of a method (TOML, docs/methods)", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// It is not the file of a method.
    #[error("{}: {source}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// Why.
        source: ControlError,
    },
}

/// The outside method that the file at `path` describes. Words of its command that begin with `./` are files beside it.
///
/// # Errors
/// [`MethodFileError`].
pub fn read_method_file(path: &Path) -> Result<MethodEntry, MethodFileError> {
    let unreadable = |source| MethodFileError::Unreadable { path: path.to_owned(), source };
    let text = File::open(path).and_then(|file| read_text(file, MOST_TEXT_BYTES)).map_err(unreadable)?;
    let entry = MethodEntry::from_toml(&text)
        .map_err(|source| MethodFileError::Content { path: path.to_owned(), source })?;
    let Some(program) = entry.program() else { return Ok(entry) };
    let folder = std::path::absolute(path).map_err(unreadable)?;
    let folder = folder.parent().unwrap_or(Path::new("."));
    let beside = |word: &String| match word.strip_prefix("./") {
        Some(file) => folder.join(file).display().to_string(),
        None => word.clone(),
    };
    let command = program.command.iter().map(beside).collect();
    Ok(MethodEntry::outside(entry.info().clone(), MethodProgram { command, ..program.clone() }))
}

/// The process, with a thread for each direction, so that no step waits longer than it may.
struct Running {
    child: Child,
    lines: Option<SyncSender<String>>,
    answers: Receiver<Result<String, String>>,
    patience: Duration,
}

/// Starts the program that `method` is, if it is one, to drive the arm `model`. A live trial does not wait `for_each_answer`.
/// The command `proact:vmpl` is no program: a decoder that speaks to a vMPL answers.
///
/// # Errors
/// If the program cannot be started, or the decoder's port cannot be had.
pub fn start(
    method: &MethodEntry,
    for_each_answer: bool,
    model: &ArmModel,
) -> Result<Option<Box<dyn MethodProcess>>, MethodProcessError> {
    let Some(MethodProgram { command, deadline_ms, .. }) = method.program() else { return Ok(None) };
    if let Some((VMPL_COMMAND, words)) = command.split_first().map(|(first, words)| (first.as_str(), words)) {
        return Ok(Some(Box::new(VmplMethod::open(words, model)?)));
    }
    let failed = |source| MethodProcessError::Start { command: command.clone(), source };
    let (program, arguments) =
        command.split_first().ok_or_else(|| failed(std::io::ErrorKind::InvalidInput.into()))?;
    let mut child = Command::new(program)
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .map_err(failed)?;
    let (lines, to_write) = sync_channel(MOST_LINES);
    let (heard, answers) = sync_channel(MOST_LINES);
    if let (Some(input), Some(output)) = (child.stdin.take(), child.stdout.take()) {
        thread::spawn(move || write(input, &to_write));
        thread::spawn(move || read(output, &heard));
    }
    let patience = if for_each_answer { BATCH_PATIENCE } else { Duration::from_millis(*deadline_ms) };
    Ok(Some(Box::new(Running { child, lines: Some(lines), answers, patience })))
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
fn read(output: ChildStdout, heard: &SyncSender<Result<String, String>>) {
    let mut output = BufReader::new(output);
    loop {
        let mut line = Vec::new();
        let read = output.by_ref().take(LONGEST_LINE).read_until(b'\n', &mut line);
        let answer = match read {
            Ok(0) => return,
            Ok(_) if line.ends_with(b"\n") => Ok(String::from_utf8_lossy(&line).trim_end().to_owned()),
            Ok(_) => Err(format!("the process broke off, or wrote a line over {LONGEST_LINE} bytes")),
            Err(error) => Err(format!("the process cannot be heard: {error}")),
        };
        let over = answer.is_err();
        if heard.send(answer).is_err() || over {
            return;
        }
    }
}

impl Running {
    fn ended(&mut self) -> String {
        match self.child.try_wait() {
            Ok(Some(status)) => format!("the process has ended ({status})"),
            _ => "the process has closed its output".to_owned(),
        }
    }
}

impl MethodProcess for Running {
    fn ask(&mut self, now: SimTime, line: &str) -> MethodAnswer {
        match self.lines.as_ref().map(|lines| lines.try_send(line.to_owned())) {
            Some(Ok(())) => {}
            Some(Err(TrySendError::Full(_))) => return Err("the process does not read its input".to_owned()),
            Some(Err(TrySendError::Disconnected(_))) | None => return Err(self.ended()),
        }
        let deadline = Instant::now() + self.patience;
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            let answer = match self.answers.recv_timeout(left) {
                Ok(answer) => answer?,
                Err(RecvTimeoutError::Timeout) => {
                    return Err(format!(
                        "the process has not answered within {} ms",
                        self.patience.as_millis()
                    ));
                }
                Err(RecvTimeoutError::Disconnected) => return Err(self.ended()),
            };
            // An answer that came too late for its own step is skipped; what is no answer at all is said.
            let late = serde_json::from_str::<Stamp>(&answer).is_ok_and(|stamp| stamp.time < now);
            if !late {
                return Ok(answer);
            }
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // Its input ends first; what does not end by itself then is ended.
        self.lines = None;
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[derive(Deserialize)]
struct Stamp {
    time: SimTime,
}
