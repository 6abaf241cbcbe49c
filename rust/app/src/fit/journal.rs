use serde::{Deserialize, Serialize};
use std::{
    fs::{File, OpenOptions},
    io::{BufRead, BufReader, Write},
    path::{Path, PathBuf},
};

/// What the evaluations of a journal have in common: with another one they are of no use.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct FitJournalHeader {
    /// Version of the program, and what people and trials follow from.
    #[serde(rename = "of")]
    fit_id: String,
}

/// An evaluation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FitEvaluation {
    /// Values of the parameters, in their order.
    pub values: Vec<f64>,
    /// Score of each trial.
    pub scores: Vec<f64>,
}

/// The evaluations of a fit, each a line on the disk as it ends. The search draws nothing: begun again with these at hand, it comes
/// back to where it was cut off.
pub struct FitJournal {
    file: File,
    path: PathBuf,
    entries: Vec<FitEvaluation>,
}

/// Why a journal is of no use.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FitJournalError {
    /// It belongs to another fit.
    #[error("{} is of another fit ({found}), and this one is of {expected}; name another folder with --out", path.display())]
    OtherFit {
        /// The file.
        path: PathBuf,
        /// What it is of.
        found: String,
        /// What was asked for.
        expected: String,
    },
    /// The disk refuses.
    #[error("{}: {source}", path.display())]
    Disk {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}

impl FitJournal {
    /// Takes up the journal at `path` of the fit `of`, or begins it. A line that was cut off is not there.
    ///
    /// # Errors
    /// [`FitJournalError`].
    pub fn open_or_resume(path: &Path, of: &str) -> Result<Self, FitJournalError> {
        let failed = |source| FitJournalError::Disk { path: path.to_owned(), source };
        let mut known = Vec::new();
        let mut whole = 0;
        let mut has_header = false;
        if path.is_file() {
            let mut reader = BufReader::new(File::open(path).map_err(failed)?);
            let mut line = String::new();
            while reader.read_line(&mut line).map_err(failed)? > 0 {
                if !line.ends_with('\n') {
                    break;
                }
                if has_header {
                    let Ok(evaluated) = serde_json::from_str(&line) else { break };
                    known.push(evaluated);
                } else {
                    let has = serde_json::from_str::<FitJournalHeader>(&line)
                        .map_or_else(|_| line.clone(), |header| header.fit_id);
                    if has != of {
                        return Err(FitJournalError::OtherFit {
                            path: path.to_owned(),
                            found: has,
                            expected: of.to_owned(),
                        });
                    }
                    has_header = true;
                }
                whole += line.len() as u64;
                line.clear();
            }
        }
        let mut file = OpenOptions::new().create(true).append(true).open(path).map_err(failed)?;
        file.set_len(whole).map_err(failed)?;
        if !has_header {
            let header = serde_json::to_string(&FitJournalHeader { fit_id: of.to_owned() })
                .map_err(|error| failed(error.into()))?;
            file.write_all(format!("{header}\n").as_bytes()).map_err(failed)?;
        }
        Ok(Self { file, path: path.to_owned(), entries: known })
    }

    /// The scores at `values`, if they were found before.
    pub fn scores(&self, values: &[f64]) -> Option<&[f64]> {
        self.entries.iter().find(|known| known.values == values).map(|known| known.scores.as_slice())
    }

    /// All evaluations, oldest first.
    pub fn evaluations(&self) -> &[FitEvaluation] {
        &self.entries
    }

    /// Keeps an evaluation: it is on the disk when this returns.
    ///
    /// # Errors
    /// A disk that refuses.
    pub fn push(&mut self, evaluated: FitEvaluation) -> Result<(), FitJournalError> {
        let failed = |source| FitJournalError::Disk { path: self.path.clone(), source };
        let line = serde_json::to_string(&evaluated).map_err(|error| failed(error.into()))?;
        self.file.write_all(format!("{line}\n").as_bytes()).map_err(failed)?;
        self.file.sync_data().map_err(failed)?;
        self.entries.push(evaluated);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn what_was_evaluated_is_known_after_a_kill_in_the_middle_of_a_line_and_another_fit_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("journal.jsonl");
        let evaluated = |value: f64| FitEvaluation { values: vec![value, 0.1], scores: vec![1.0, 4.0] };
        let mut journal = FitJournal::open_or_resume(&path, "seed 1").unwrap();
        journal.push(evaluated(0.3)).unwrap();
        journal.push(evaluated(0.1 + 0.2)).unwrap();
        let text = fs::read_to_string(&path).unwrap();
        fs::write(&path, &text[..text.len() - 7]).unwrap();
        let mut journal = FitJournal::open_or_resume(&path, "seed 1").unwrap();
        assert_eq!(journal.scores(&[0.3, 0.1]), Some(&[1.0, 4.0][..]));
        assert_eq!(journal.evaluations().len(), 1, "the second one was cut off");
        journal.push(evaluated(7.0)).unwrap();
        assert_eq!(FitJournal::open_or_resume(&path, "seed 1").unwrap().evaluations().len(), 2);
        let refused = FitJournal::open_or_resume(&path, "seed 2").err().map(|error| error.to_string());
        assert!(refused.as_ref().is_some_and(|text| text.contains("seed 1")), "{refused:?}");
    }
}
