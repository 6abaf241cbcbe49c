//! A control method in another process: started here, asked line by line, ended with the trial.

use crate::vmpl::{VMPL_COMMAND, VmplError, VmplMethod};
use proact_arm::ArmModel;
use proact_control::{ControlError, MethodEntry, MethodProgram, ports::MethodProcess};
use proact_devices::{LineProcess, LineProcessError};
use proact_types::{ExternalAnswer, MAX_TEXT_BYTES, MethodAnswer, SimTime, read_text};
use std::{
    fs::File,
    path::{Path, PathBuf},
    time::Duration,
};

/// A line longer than this is no answer, bytes.
const MAX_LINE_BYTES: u64 = 1 << 20;
/// In a batch each answer is waited for, but not for ever.
const BATCH_TIMEOUT: Duration = Duration::from_secs(10);

/// Why a method, or an intent model, in another process cannot be asked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MethodProcessError {
    /// The program does not start.
    #[error(
        "the {part} {command:?} does not start: {source}; give a program that reads and writes JSON lines"
    )]
    Start {
        /// What it is in the trial, such as `method`.
        part: &'static str,
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
    let text = File::open(path).and_then(|file| read_text(file, MAX_TEXT_BYTES)).map_err(unreadable)?;
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
    Ok(MethodEntry::external(entry.info().clone(), MethodProgram { command, ..program.clone() }))
}

/// A program that answers line by line, and how long a tick may wait for it.
pub(crate) struct ExternalProcess {
    /// Or why it does not start.
    process: Result<LineProcess, String>,
    timeout: Duration,
}

impl ExternalProcess {
    /// Starts `command`, which is this `part` of a trial. A live trial does not wait `for_each_answer`, and is refused if the
    /// program does not start. A simulated one runs and has that in its record, so that a batch lists it and goes on.
    pub(crate) fn start(
        part: &'static str,
        command: &[String],
        for_each_answer: bool,
        deadline_ms: u64,
    ) -> Result<Self, MethodProcessError> {
        let failed = |source| MethodProcessError::Start { part, command: command.to_owned(), source };
        let process = match LineProcess::start(command, MAX_LINE_BYTES).map_err(failed) {
            Err(error) if for_each_answer => Err(error.to_string()),
            started => Ok(started?),
        };
        let timeout = if for_each_answer { BATCH_TIMEOUT } else { Duration::from_millis(deadline_ms) };
        Ok(Self { process, timeout })
    }

    /// Its answer to the line of `now`.
    pub(crate) fn request(&mut self, now: SimTime, line: &str) -> ExternalAnswer {
        let process = match &mut self.process {
            Ok(process) => process,
            Err(reason) => return ExternalAnswer::Failed(reason.clone()),
        };
        match process.ask(now.0, line.to_owned(), self.timeout) {
            Ok(line) => ExternalAnswer::Line(line),
            Err(fault @ (LineProcessError::Timeout { .. } | LineProcessError::InputNotRead)) => {
                ExternalAnswer::TimedOut(fault.to_string())
            }
            Err(fault) => ExternalAnswer::Failed(fault.to_string()),
        }
    }
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
    Ok(Some(Box::new(ExternalProcess::start("method", command, for_each_answer, *deadline_ms)?)))
}

impl MethodProcess for ExternalProcess {
    fn ask(&mut self, now: SimTime, line: &str) -> MethodAnswer {
        self.request(now, line)
    }
}
