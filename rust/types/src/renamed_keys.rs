//! Keys of configurations that have another name than they had, and the change of a tree of values from the old names to
//! the new ones before it becomes types.
//!
//! There is one table for all files. A reader parses its text into a tree, calls [`rename_keys`], and deserializes what
//! comes out. Nothing is printed here: the reader gets the rows that were used, and whoever reads a file that people
//! write shows them.

mod table;
mod tree;

pub use table::RENAMED_KEYS;
pub use tree::ConfigTree;

use std::{borrow::Cow, collections::BTreeSet, fmt};
use thiserror::Error;

/// What a key is a key of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ConfigFile {
    /// The configuration of a trial: its file, `--set`, `--sweep`, `set` of a study plan, `settings` in Python, and its parts in
    /// files of their own: a profile, the options of the intent model, the EMG settings of a model file.
    Trial,
    /// The plan of a study.
    StudyPlan,
    /// What `study power` expects of each condition.
    ExpectedEffect,
    /// The parameters of a ROS node.
    NodeParameter,
}

impl ConfigFile {
    /// All, in the order of the documentation.
    pub const ALL: [Self; 4] = [Self::Trial, Self::StudyPlan, Self::ExpectedEffect, Self::NodeParameter];

    /// As a heading.
    pub fn title(self) -> &'static str {
        match self {
            ConfigFile::Trial => "Trial configuration",
            ConfigFile::StudyPlan => "Study plans",
            ConfigFile::ExpectedEffect => "Expected effects of `study power`",
            ConfigFile::NodeParameter => "Parameters of ROS nodes",
        }
    }
}

/// A key that has another name. If it is a table, the keys below it move along.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenamedKey {
    /// Where it is a key.
    pub file: ConfigFile,
    /// What it was called, with a dot for each table and `[]` behind what is a list of tables.
    pub old: &'static str,
    /// What it is called.
    pub new: &'static str,
    /// The new value is the old one times this; 1 where the unit is the same.
    pub factor: f64,
    /// The version that renamed it.
    pub since: &'static str,
}

impl RenamedKey {
    /// The table that holds it, by the present names, and the last words of both names. Tables have rows of their own, before
    /// those of their keys.
    fn split(&self) -> (&'static str, &'static str, &'static str) {
        let (table, new) = self.new.rsplit_once('.').unwrap_or(("", self.new));
        let old = self.old.rsplit_once('.').map_or(self.old, |(_, word)| word);
        (table, old, new)
    }
}

impl fmt::Display for RenamedKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} is now {}", self.old, self.new)?;
        if self.factor == 1.0 { Ok(()) } else { write!(f, ", the old value times {}", self.factor) }
    }
}

/// A key is there by both of its names.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{old} is the old name of {new}: both are given, expected {new} alone")]
pub struct DuplicateKey {
    /// The old name.
    pub old: String,
    /// The new one.
    pub new: String,
}

/// Gives the keys of `tree`, which is the part `section` of a `file`, their new names; an empty `section` is all of it. Returns the rows
/// of the table that were used.
///
/// ```
/// use proact_types::renamed_keys::{ConfigFile, rename_keys};
/// let mut tree: serde_json::Value = serde_json::from_str(r#"{"required": 5}"#)?;
/// let used = rename_keys(&mut tree, ConfigFile::Trial, "emg")?;
/// assert_eq!(tree.to_string(), r#"{"consecutive_decisions":5}"#);
/// assert_eq!(used[0].to_string(), "emg.required is now emg.consecutive_decisions");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// A key that is there by both names.
pub fn rename_keys<T: ConfigTree>(
    tree: &mut T,
    file: ConfigFile,
    section: &str,
) -> Result<Vec<&'static RenamedKey>, DuplicateKey> {
    rename_keys_of(RENAMED_KEYS, tree, file, section)
}

/// Renames the dotted `key` of an assignment in a `file`, and the keys in its `value`.
///
/// # Errors
/// A key that is there by both names.
pub fn rename_assignment<T: ConfigTree>(
    key: &str,
    value: T,
    file: ConfigFile,
) -> Result<(String, T, Vec<&'static RenamedKey>), DuplicateKey> {
    let steps: Vec<&str> = key.split('.').collect();
    let mut tree = steps.iter().rev().fold(value, |inner, step| T::table(step, inner));
    let used = rename_keys(&mut tree, file, "")?;
    // A new name has as many words as the old one: the value is as deep as before.
    let mut names = Vec::new();
    for step in steps {
        let (name, inner) = tree.into_entry().unwrap_or_else(|tree| (step.to_owned(), tree));
        names.push(name);
        tree = inner;
    }
    Ok((names.join("."), tree, used))
}

/// `text`, which is TOML, with the present names of its keys, and the rows that were used; as it is where it has none of the old
/// names, or cannot be read, which whoever reads it will say.
///
/// # Errors
/// A key that is there by both names.
pub fn rename_keys_in_toml<'a>(
    text: &'a str,
    file: ConfigFile,
    section: &str,
) -> Result<(Cow<'a, str>, Vec<&'static RenamedKey>), DuplicateKey> {
    let Ok(table) = toml::from_str::<toml::Table>(text) else { return Ok((Cow::Borrowed(text), Vec::new())) };
    let mut tree = toml::Value::Table(table);
    let used = rename_keys(&mut tree, file, section)?;
    let Some(renamed) = tree.as_table().filter(|_| !used.is_empty()) else {
        return Ok((Cow::Borrowed(text), used));
    };
    // Lines stay where they are if names alone change, so that an error names the line of the file.
    let in_place = rename_in_place(text, &used);
    let same = toml::from_str::<toml::Table>(&in_place).is_ok_and(|table| table == *renamed);
    Ok((Cow::Owned(if same { in_place } else { renamed.to_string() }), used))
}

/// `text` with each old name replaced where it stands as a key or in the heading of a table.
fn rename_in_place(text: &str, used: &[&RenamedKey]) -> String {
    let mut out = text.to_owned();
    for row in used {
        let (_, old, new) = row.split();
        let is_word = |c: char| c.is_alphanumeric() || c == '_' || c == '-';
        let lines = out.split_inclusive('\n').map(|line| {
            let mut renamed = String::with_capacity(line.len());
            let mut rest = line;
            while let Some(at) = rest.find(old) {
                let (before, after) = (&rest[..at], &rest[at + old.len()..]);
                let starts = !before.ends_with(is_word);
                let ends =
                    matches!(after.trim_start_matches([' ', '\t']).chars().next(), Some('=' | '.' | ']'));
                renamed += before;
                renamed += if starts && ends { new } else { old };
                rest = after;
            }
            renamed + rest
        });
        out = lines.collect();
    }
    out
}

fn rename_keys_of<'a, T: ConfigTree>(
    rows: &'a [RenamedKey],
    tree: &mut T,
    file: ConfigFile,
    section: &str,
) -> Result<Vec<&'a RenamedKey>, DuplicateKey> {
    let mut used = Vec::new();
    for row in rows.iter().filter(|row| row.file == file) {
        let (table, old, new) = row.split();
        let table = match section {
            "" => Some(table),
            _ if table == section => Some(""),
            _ => table.strip_prefix(section).and_then(|rest| rest.strip_prefix('.')),
        };
        let Some(table) = table else { continue };
        let steps: Vec<&str> = table.split('.').filter(|step| !step.is_empty()).collect();
        let mut found = false;
        visit_tables(tree, &steps, &mut |tree: &mut T| {
            let Some(mut value) = tree.take(old) else { return Ok(()) };
            if tree.child_mut(new).is_some() {
                return Err(DuplicateKey { old: row.old.to_owned(), new: row.new.to_owned() });
            }
            if row.factor != 1.0 {
                value.scale(row.factor);
            }
            tree.put(new, value);
            found = true;
            Ok(())
        })?;
        if found {
            used.push(row);
        }
    }
    Ok(used)
}

/// Calls `change` for each table at `steps`. What is no table, or no list where one should be, is left to whoever reads it.
fn visit_tables<T: ConfigTree>(
    tree: &mut T,
    steps: &[&str],
    change: &mut impl FnMut(&mut T) -> Result<(), DuplicateKey>,
) -> Result<(), DuplicateKey> {
    let Some((step, rest)) = steps.split_first() else { return change(tree) };
    match step.strip_suffix("[]") {
        None => tree.child_mut(step).map_or(Ok(()), |inner| visit_tables(inner, rest, change)),
        Some(list) => {
            let Some(list) = tree.child_mut(list) else { return Ok(()) };
            list.items_mut().iter_mut().try_for_each(|inner| visit_tables(inner, rest, change))
        }
    }
}

/// The rows that were not shown before, so that each is shown once.
#[derive(Clone, Debug, Default)]
pub struct ShownRenames {
    shown: BTreeSet<(ConfigFile, &'static str)>,
}

impl ShownRenames {
    /// None is shown.
    pub const fn new() -> Self {
        Self { shown: BTreeSet::new() }
    }

    /// Those of `used` that are new here.
    pub fn first_uses(&mut self, used: &[&'static RenamedKey]) -> Vec<&'static RenamedKey> {
        used.iter().copied().filter(|row| self.shown.insert((row.file, row.old))).collect()
    }
}

/// The table as text for `docs/renames.md`: a heading and a table for each kind of file.
pub fn renamed_keys_page() -> String {
    let mut page = String::new();
    for file in ConfigFile::ALL {
        page +=
            &format!("### {}\n\n| Old | New | Factor | Since |\n| --- | --- | --- | --- |\n", file.title());
        for row in RENAMED_KEYS.iter().filter(|row| row.file == file) {
            page += &format!("| `{}` | `{}` | {} | {} |\n", row.old, row.new, row.factor, row.since);
        }
        page.push('\n');
    }
    page
}

#[cfg(test)]
mod tests;
