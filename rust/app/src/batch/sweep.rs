//! Values that are varied: a grid of cells, of which each is a whole batch.

use crate::warn_of_renamed_keys;
use proact_types::renamed_keys::{ConfigFile, rename_assignment};

/// More cells than this are most likely a slip.
const MAX_CELLS: usize = 10_000;

/// Keys of a trial's configuration with the values that each takes, all with all. The last key changes first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sweep {
    keys: Vec<(String, Vec<String>)>,
}

impl Sweep {
    /// Reads `KEY=VALUE,VALUE`; commas within brackets, braces and quotes belong to a value.
    ///
    /// # Errors
    /// Invalid syntax, duplicate keys or values, or too many cells.
    pub fn parse<S: AsRef<str>>(texts: &[S]) -> Result<Self, String> {
        let mut keys: Vec<(String, Vec<String>)> = Vec::new();
        for text in texts.iter().map(AsRef::as_ref) {
            let wrong = || {
                format!(
                    "--sweep {text:?} is invalid, expected KEY=VALUE,VALUE such as intent.gaze_sigma=0.03,0.1"
                )
            };
            let (key, values) = text.split_once('=').ok_or_else(wrong)?;
            let (key, values) = (present_name(key.trim())?, split_at_commas(values));
            if key.is_empty() || values.iter().any(String::is_empty) {
                return Err(wrong());
            }
            if keys.iter().any(|(other, _)| *other == key) {
                return Err(format!("--sweep {key} is there twice, expected all its values in one"));
            }
            if let Some(twice) = values.iter().enumerate().find(|(k, value)| values[..*k].contains(value)) {
                return Err(format!("--sweep {key} has the value {} twice", twice.1));
            }
            keys.push((key, values));
        }
        let cells = keys.iter().try_fold(1_usize, |cells, (_, values)| cells.checked_mul(values.len()));
        match cells {
            Some(1..=MAX_CELLS) => Ok(Self { keys }),
            _ => Err(format!(
                "--sweep makes {} cells, expected at most {MAX_CELLS}",
                cells.unwrap_or(usize::MAX)
            )),
        }
    }

    /// The keys, in their order.
    pub fn keys(&self) -> impl Iterator<Item = &str> {
        self.keys.iter().map(|(key, _)| key.as_str())
    }

    /// The values of the key in place `key`, in their order.
    pub fn values(&self, key: usize) -> &[String] {
        &self.keys[key].1
    }

    /// How many cells there are: one if nothing is varied.
    pub fn cells(&self) -> usize {
        self.keys.iter().map(|(_, values)| values.len()).product()
    }

    /// The value of each key in a cell.
    pub fn cell(&self, cell: usize) -> Vec<(&str, &str)> {
        let mut rest = cell;
        let mut found: Vec<(&str, &str)> = Vec::with_capacity(self.keys.len());
        for (key, values) in self.keys.iter().rev() {
            found.push((key, &values[rest % values.len()]));
            rest /= values.len();
        }
        found.reverse();
        found
    }

    /// As the command line has it.
    pub(crate) fn to_arguments(&self) -> Vec<String> {
        self.keys.iter().map(|(key, values)| format!("{key}={}", values.join(","))).collect()
    }
}

/// The present name of a key, with a warning if `key` is an old one. A key whose unit changed as well keeps its old name here; reading
/// the configuration converts name and value together.
fn present_name(key: &str) -> Result<String, String> {
    let (name, _, used) = rename_assignment(key, toml::Value::Boolean(true), ConfigFile::Trial)
        .map_err(|error| format!("--sweep {key}: {error}"))?;
    warn_of_renamed_keys(&used);
    let same_units = used.iter().all(|row| row.factor == 1.0);
    Ok(if same_units { name } else { key.to_owned() })
}

/// At the commas that are in no brackets and no quotes.
fn split_at_commas(text: &str) -> Vec<String> {
    let (mut depth, mut quoted) = (0_i32, false);
    let parts = text.split(|letter: char| {
        match letter {
            '"' => quoted = !quoted,
            '[' | '{' if !quoted => depth += 1,
            ']' | '}' if !quoted => depth -= 1,
            _ => {}
        }
        letter == ',' && depth == 0 && !quoted
    });
    parts.map(|part| part.trim().to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_all_values_with_all_and_the_last_key_changes_first() {
        let sweep = Sweep::parse(&["a.b=1, 2", "c=[1, 2],\"x,y\",z"]).unwrap();
        assert_eq!(sweep.cells(), 6);
        assert_eq!(sweep.cell(0), [("a.b", "1"), ("c", "[1, 2]")]);
        assert_eq!(sweep.cell(1), [("a.b", "1"), ("c", "\"x,y\"")]);
        assert_eq!(sweep.cell(5), [("a.b", "2"), ("c", "z")]);
        let old = Sweep::parse(&["intent.sigma=0.01,0.03"]).unwrap();
        assert_eq!(old.cell(1), [("intent.gaze_sigma", "0.03")], "tables and labels have the present name");
        assert!(Sweep::parse(&["intent.sigma=1", "intent.gaze_sigma=2"]).unwrap_err().contains("twice"));
        let none = Sweep::parse::<&str>(&[]).unwrap();
        assert_eq!((none.cells(), none.cell(0)), (1, vec![]));
    }

    #[test]
    fn what_is_no_sweep_is_refused_with_what_is_wrong() {
        for (texts, reason) in [
            (vec!["sigma"], "expected KEY=VALUE,VALUE"),
            (vec!["=1,2"], "expected KEY=VALUE,VALUE"),
            (vec!["sigma=1,,2"], "expected KEY=VALUE,VALUE"),
            (vec!["sigma=1,1"], "the value 1 twice"),
            (vec!["sigma=1", "sigma=2"], "sigma is there twice"),
        ] {
            let error = Sweep::parse(&texts).unwrap_err();
            assert!(error.contains(reason), "{texts:?}: {error}");
        }
        let many: Vec<String> = (0..101).map(|k| k.to_string()).collect();
        let many = [format!("a={}", many.join(",")), format!("b={}", many.join(","))];
        assert!(Sweep::parse(&many).unwrap_err().contains("10201 cells"));
    }
}
