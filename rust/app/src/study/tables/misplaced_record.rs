//! Whether a record is that of its place in the study: folders can be exchanged, and nothing else in them tells.

use super::{CountedTrial, StudyTables};
use crate::{
    record_keys::with_path,
    replay::{last_digest, read_trial},
    study::{record_name, study_place},
};
use proact_recording::{InputLog, StudyTrialId, TrialRecord};
use proact_testbed::{SpanDigest, TrialResult};
use std::{
    error::Error,
    fmt, fs, io,
    path::{Path, PathBuf},
};

/// A record is not of the trial that the journal has in its folder.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the record is not that of its place in the study: {}; put each folder back under the name that it was recorded under",
    in_words(differences)
)]
pub(crate) struct MisplacedRecord {
    differences: Vec<RecordDifference>,
}

/// What a record says of its place, beside what the journal says.
#[derive(Clone, Debug, PartialEq, Eq)]
struct RecordDifference {
    key: &'static str,
    got: String,
    expected: String,
}

fn in_words(differences: &[RecordDifference]) -> String {
    let one = |RecordDifference { key: what, got, expected }: &RecordDifference| {
        format!("its {what} is {got}, the journal has {expected} there")
    };
    differences.iter().map(one).collect::<Vec<_>>().join("; ")
}

/// Refuses a record with any of these differences: what it is called, what the record says, what study or journal say.
fn check_equal<const N: usize>(
    pairs: [(&'static str, &dyn fmt::Display, &dyn fmt::Display); N],
) -> Result<(), MisplacedRecord> {
    let all = pairs.map(|(what, got, expected)| RecordDifference {
        key: what,
        got: got.to_string(),
        expected: expected.to_string(),
    });
    let differences: Vec<RecordDifference> =
        all.into_iter().filter(|difference| difference.got != difference.expected).collect();
    if differences.is_empty() { Ok(()) } else { Err(MisplacedRecord { differences }) }
}

/// Reads the record in `dir` of a trial that counts, once it is known to be in its place: what else is wrong with a record in the
/// wrong folder does not matter there. Records and journals from before this was written have no place or digest: there the name
/// of the bag stands for the place.
///
/// # Errors
/// [`MisplacedRecord`] with what differs; a record that cannot be read.
pub(super) fn read_checked_record(
    counted: &CountedTrial<'_>,
    dir: &Path,
) -> Result<(TrialRecord, TrialResult), Box<dyn Error>> {
    let planned = counted.planned;
    let head = InputLog::open(dir);
    match head.as_ref().ok().and_then(InputLog::study_trial) {
        Some(study_trial) => check_study_place(study_trial, &counted.place())?,
        // A folder that is not there is named when it is read.
        None if !dir.is_dir() => {}
        None => {
            for bag in bags(dir)? {
                check_equal([("bag", &bag, &record_name(planned))])?;
            }
        }
    }
    if let Ok(head) = &head {
        check_equal([("seed", &head.seed(), &planned.seed)])?;
    }
    let (record, result) = read_trial(dir)?;
    let digest = last_digest(&record.digests::<SpanDigest>()?);
    check_equal([("result", &result.digest, &digest)])?;
    counted.digest.iter().try_for_each(|journal| check_equal([("digest", &digest, journal)]))?;
    Ok((record, result))
}

fn check_study_place(got: &StudyTrialId, expected: &StudyTrialId) -> Result<(), MisplacedRecord> {
    let [got_names, expected_names] = [got, expected]
        .map(|trial_id| [&trial_id.session, &trial_id.condition].map(|name| format!("{name:?}")));
    check_equal([
        ("participant", &got.participant, &expected.participant),
        ("session", &got_names[0], &expected_names[0]),
        ("condition", &got_names[1], &expected_names[1]),
        ("trial", &got.trial, &expected.trial),
        ("attempt", &got.attempt, &expected.attempt),
    ])
}

/// Names of the bags in a record, without their ending.
fn bags(dir: &Path) -> io::Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in fs::read_dir(dir)? {
        let path = entry?.path();
        if path.extension().is_some_and(|ending| ending == "bag") {
            names.extend(path.file_stem().map(|stem| stem.to_string_lossy().into_owned()));
        }
    }
    Ok(names)
}

impl CountedTrial<'_> {
    fn place(&self) -> StudyTrialId {
        study_place(self.planned, self.attempt)
    }

    pub(super) fn dir(&self, tables: &StudyTables<'_>) -> PathBuf {
        tables.study.folder.join(&self.record)
    }
}

/// What is wrong with the records of the trials that count, a sentence for each that is missing, cannot be read, or is in the folder of
/// another.
pub(super) fn faulty_records(tables: &StudyTables<'_>) -> Vec<String> {
    let faulty = |counted: CountedTrial<'_>| {
        let dir = counted.dir(tables);
        if !dir.is_dir() {
            return Some(format!("{}: the record is missing", dir.display()));
        }
        read_checked_record(&counted, &dir).err().map(|error| with_path(&dir, &error))
    };
    tables.counted_trials().into_iter().filter_map(faulty).collect()
}
