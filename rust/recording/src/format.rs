//! The format of a record: one number for all files of a trial directory, and for what they mean.

use crate::RecordingError;
use std::path::Path;

/// The format that this program writes, and the only one that it replays. It stands in the head of `inputs.log`.
///
/// It goes up by one when any file of a trial directory changes its layout, or when the same inputs no longer lead to
/// the same digest. The program before the change then enters [`LAST_REPLAYING_VERSIONS`].
pub const RECORD_FORMAT: u32 = 8;

/// For each earlier format the last program that replays it.
const LAST_REPLAYING_VERSIONS: [(u32, &str); 7] = [
    (1, "0.1.0 at commit 477d3a7"),
    (2, "0.1.0 at commit 8cb6c71"),
    (3, "0.1.0 at commit c9e48b2"),
    (4, "0.1.0 at commit 4f3c662"),
    (5, "0.1.0 at commit 6d703e6"),
    (6, "0.1.0 at commit b13adcf"),
    (7, "0.1.0 at commit ca6e481"),
];

/// The oldest format that can be read: its files are laid out as today's, but the same inputs lead to another digest.
const OLDEST_READABLE_FORMAT: u32 = 7;

/// Accepts a record in `dir` of format `got` that can be read.
///
/// # Errors
/// As [`check_replayable`], for formats of another layout.
pub(crate) fn check_readable(dir: &Path, got: u32, writer: Option<&str>) -> Result<(), RecordingError> {
    if (OLDEST_READABLE_FORMAT..=RECORD_FORMAT).contains(&got) {
        Ok(())
    } else {
        check_replayable(dir, got, writer)
    }
}

/// Accepts a record in `dir` of format `got` that can be computed again.
///
/// # Errors
/// [`RecordingError::WrongFormat`] for any other than [`RECORD_FORMAT`], with the program that replays it; `writer` is
/// the version that wrote the record, if that could be read.
pub(crate) fn check_replayable(dir: &Path, got: u32, writer: Option<&str>) -> Result<(), RecordingError> {
    if got == RECORD_FORMAT {
        return Ok(());
    }
    let last = LAST_REPLAYING_VERSIONS.iter().find(|(format, _)| *format == got).map(|(_, version)| *version);
    let replayed_by = match (last, writer) {
        (Some(version), _) => format!("the last program that replays format {got} is proact {version}"),
        (None, Some(version)) => format!("proact {version} wrote it and replays it"),
        (None, None) if got > RECORD_FORMAT => "a newer proact replays it".to_owned(),
        (None, None) => "no program is known that replays it".to_owned(),
    };
    Err(RecordingError::WrongFormat { dir: dir.to_owned(), got, expected: RECORD_FORMAT, replayed_by })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(got: u32, writer: Option<&str>) -> String {
        check_replayable(Path::new("trial"), got, writer).expect_err("another format").to_string()
    }

    // Catches a new format whose predecessor was left out of the table.
    #[test]
    fn every_earlier_format_has_a_program_that_replays_it() {
        let formats: Vec<u32> = LAST_REPLAYING_VERSIONS.iter().map(|(format, _)| *format).collect();
        assert_eq!(formats, (1..RECORD_FORMAT).collect::<Vec<u32>>());
        for (format, version) in LAST_REPLAYING_VERSIONS {
            let refused = refusal(format, Some("9.9.9"));
            assert!(refused.contains(version) && refused.contains(&format!("format {format}")), "{refused}");
        }
    }

    #[test]
    fn formats_of_another_layout_cannot_be_read() {
        let read = |got| check_readable(Path::new("trial"), got, None).is_ok();
        let formats: Vec<u32> = (0..=RECORD_FORMAT + 1).filter(|got| read(*got)).collect();
        assert_eq!(formats, (OLDEST_READABLE_FORMAT..=RECORD_FORMAT).collect::<Vec<u32>>());
    }

    #[test]
    fn a_newer_format_names_who_wrote_it() {
        assert!(check_replayable(Path::new("trial"), RECORD_FORMAT, None).is_ok());
        assert!(refusal(RECORD_FORMAT + 1, Some("0.7.0")).contains("proact 0.7.0 wrote it"));
        assert!(refusal(RECORD_FORMAT + 1, None).contains("a newer proact"));
    }
}
