//! Whether a record is that of its place in the study: folders can be exchanged, and nothing else in them tells.

use super::{Counted, Told};
use crate::{
    replay::{last_digest, read_trial},
    study::{record_name, study_place},
};
use proact_recording::{RESULT_FILE, RecordingError, StudyPlace, Trial};
use proact_testbed::{SpanDigest, TrialResult};
use std::{error::Error, fs, io};

/// A record is not of the trial that the journal has in its folder.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the record is not that of its place in the study: its {what} is {got}, the journal has {expected} there; \
     put each folder back under the name that it was recorded under"
)]
pub(crate) struct MisplacedRecord {
    what: &'static str,
    got: String,
    expected: String,
}

/// Compares the record of a trial with what plan and journal have in its place. Records and journals from before this was
/// written have no place or digest: there the name of the bag stands for the place.
///
/// # Errors
/// [`MisplacedRecord`] with the first difference; a record that cannot be read.
pub(super) fn check(
    counted: &Counted<'_>,
    record: &Trial,
    result: &TrialResult,
) -> Result<(), Box<dyn Error>> {
    let same = |what, got: String, expected: String| match got == expected {
        true => Ok(()),
        false => Err(MisplacedRecord { what, got, expected }),
    };
    let planned = counted.planned;
    match &record.header().place {
        Some(place) => same("place", place.to_string(), counted.place().to_string())?,
        None => {
            for bag in bags(record)? {
                same("bag", bag, record_name(planned))?;
            }
        }
    }
    same("seed", record.header().seed.to_string(), planned.seed.to_string())?;
    let digest = last_digest(&record.digests::<SpanDigest>()?);
    same("result", result.digest.clone(), digest.clone())?;
    Ok(counted.digest.iter().try_for_each(|journal| same("digest", digest.clone(), journal.clone()))?)
}

/// Names of the bags beside a record, without their ending.
fn bags(record: &Trial) -> io::Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in fs::read_dir(record.dir())? {
        let path = entry?.path();
        if path.extension().is_some_and(|ending| ending == "bag") {
            names.extend(path.file_stem().map(|stem| stem.to_string_lossy().into_owned()));
        }
    }
    Ok(names)
}

/// Whether an error is no matter of one record that could be left out: it is of another trial, or says what nobody understands.
pub(super) fn refuses_the_study(error: &(dyn Error + 'static)) -> bool {
    let unknown = |error: &RecordingError| matches!(error, RecordingError::Damaged { file, .. } if file.ends_with(RESULT_FILE));
    error.is::<MisplacedRecord>() || error.downcast_ref().is_some_and(unknown)
}

impl Counted<'_> {
    fn place(&self) -> StudyPlace {
        study_place(self.planned, self.attempt)
    }
}

/// Refuses a study of which a record is in the folder of another. Records that cannot be read are left to whoever reads them.
///
/// # Errors
/// The record by its name.
pub(super) fn check_all(told: &Told<'_>) -> Result<(), Box<dyn Error>> {
    for counted in told.counted() {
        let dir = told.study.folder.join(&counted.record);
        let checked = read_trial(&dir)
            .map_err(Into::into)
            .and_then(|(record, result)| check(&counted, &record, &result));
        match checked {
            Err(error) if refuses_the_study(&*error) => {
                return Err(format!("{}: {error}", dir.display()).into());
            }
            _ => {}
        }
    }
    Ok(())
}
