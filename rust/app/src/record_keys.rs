//! One rule for the files of a record: a key, a kind or a value that this program does not know is an error that names the file and
//! the key. It refuses the whole analysis or export, since what has another name would be missing from every table.

use crate::{recorder::PLANS_FILE, study::tables::MisplacedRecord};
use proact_planning::PlanStats;
use proact_recording::{EVENTS_FILE, InputLog, RESULT_FILE, RecordingError, check_lines, read_result};
use proact_testbed::TrialResult;
use proact_types::Event;
use std::{error::Error, fmt::Display, path::Path};

/// Refuses the record in `dir` if one of its files has an unknown key. This comes before all other checks, so that the key is named
/// also where the file is not the recorded one any more.
///
/// # Errors
/// [`RecordingError::Unknown`]; [`RecordingError::Damaged`] for a result that is no JSON.
pub(crate) fn check_keys(dir: &Path) -> Result<(), RecordingError> {
    // Records of formats with another layout had other keys. They are refused by their format.
    if let Err(RecordingError::WrongFormat { .. }) = InputLog::open(dir) {
        return Ok(());
    }
    match read_result::<TrialResult>(dir) {
        Err(error) if is_fatal_for_analysis(&error) => return Err(error),
        // What else is wrong is found when the record is opened.
        _ => {}
    }
    check_lines::<Event>(dir, EVENTS_FILE)?;
    check_lines::<PlanStats>(dir, PLANS_FILE)
}

/// Whether an error refuses the whole analysis, and not one record alone: the record is of another trial, or has a key that is
/// unknown.
pub(crate) fn is_fatal_for_analysis(error: &(dyn Error + 'static)) -> bool {
    let unknown = |error: &RecordingError| match error {
        RecordingError::UnknownKey { .. } => true,
        RecordingError::Damaged { file, .. } => file.ends_with(RESULT_FILE),
        _ => false,
    };
    error.is::<MisplacedRecord>() || error.downcast_ref().is_some_and(unknown)
}

/// An error about the record or file `path` with that path, once.
pub fn with_path(path: &Path, error: &dyn Display) -> String {
    let (location, text) = (path.display().to_string(), error.to_string());
    if text.contains(&location) { text } else { format!("{location}: {text}") }
}
