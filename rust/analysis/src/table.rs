//! Tidy tables: one row an observation, one column a variable, and what each variable is.

use proact_types::Number;
use serde::{Deserialize, Serialize};

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TableColumn {
    /// Its name.
    pub name: &'static str,
    /// Its unit; empty for a name, a text or a count.
    pub unit: &'static str,
    /// What it is.
    pub meaning: &'static str,
    /// Where it comes from.
    pub source: &'static str,
    /// The name that it had in older exports; empty if it always had its present one.
    pub formerly: &'static str,
}

impl TableColumn {
    /// The column with the name that it had in older exports.
    #[must_use]
    pub const fn formerly(self, name: &'static str) -> Self {
        Self { formerly: name, ..self }
    }

    /// Whether this is its present name or an older one.
    pub fn is_named(&self, name: &str) -> bool {
        self.name == name || !self.formerly.is_empty() && self.formerly == name
    }

    /// The name to write.
    pub fn written_name(&self, names: ColumnNames) -> &'static str {
        match names {
            ColumnNames::Legacy if !self.formerly.is_empty() => self.formerly,
            _ => self.name,
        }
    }
}

/// Which names columns are written with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColumnNames {
    /// The names that the codebook has.
    #[default]
    Present,
    /// Those of older exports, for scripts that expect them.
    Legacy,
}

/// A value in a table. As JSON: null, a number, a string.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum TableCell {
    /// There is none.
    Missing,
    /// A whole number.
    #[serde(rename = "Whole")]
    Integer(i64),
    /// A number; one that is not finite is missing.
    #[serde(rename = "Real")]
    Number(f64),
    /// Words.
    #[serde(rename = "Words")]
    Text(String),
}

impl From<&str> for TableCell {
    fn from(words: &str) -> Self {
        TableCell::Text(words.to_owned())
    }
}

impl From<String> for TableCell {
    fn from(words: String) -> Self {
        TableCell::Text(words)
    }
}

impl From<f64> for TableCell {
    fn from(number: f64) -> Self {
        // Adding zero makes a negative zero positive.
        if number.is_finite() { TableCell::Number(number + 0.0) } else { TableCell::Missing }
    }
}

impl From<bool> for TableCell {
    fn from(yes: bool) -> Self {
        TableCell::Integer(i64::from(yes))
    }
}

macro_rules! whole {
    ($($number:ty),*) => {$(
        impl From<$number> for TableCell {
            fn from(number: $number) -> Self {
                i64::try_from(number).map_or(TableCell::Missing, TableCell::Integer)
            }
        }
    )*};
}
whole!(i64, u32, u64, usize);

impl<T: Into<TableCell>> From<Option<T>> for TableCell {
    fn from(value: Option<T>) -> Self {
        value.map_or(TableCell::Missing, Into::into)
    }
}

impl std::fmt::Display for TableCell {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            TableCell::Missing => Ok(()),
            TableCell::Integer(number) => write!(to, "{number}"),
            TableCell::Number(number) => write!(to, "{}", Number(*number)),
            TableCell::Text(words) => to.write_str(words),
        }
    }
}

impl TableCell {
    /// What a file has as text: a number if it is written as one.
    pub fn parse(text: &str) -> Self {
        match (text.parse::<i64>(), text.parse::<f64>()) {
            _ if text.is_empty() => TableCell::Missing,
            // Tables of earlier versions have it.
            _ if text == "-0" => TableCell::Number(0.0),
            // `007` is a name.
            (Ok(whole), _) if whole.to_string() == text => TableCell::Integer(whole),
            (Err(_), Ok(real)) if real.is_finite() => real.into(),
            _ => TableCell::Text(text.to_owned()),
        }
    }
}

/// A value as the word that files have for it, such as `on_target`.
pub fn serialized_name<T: serde::Serialize>(value: &T) -> String {
    match serde_json::to_value(value) {
        Ok(serde_json::Value::String(text)) => text,
        Ok(other) => other.to_string(),
        Err(_) => String::new(),
    }
}

/// A table. Every row has a cell for every column.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Its name, which is that of its file too.
    pub name: &'static str,
    /// What a row is.
    pub row_meaning: &'static str,
    /// The columns.
    pub columns: &'static [TableColumn],
    /// The rows.
    pub rows: Vec<Vec<TableCell>>,
}

impl Table {
    /// A table without rows.
    pub fn new(name: &'static str, row: &'static str, columns: &'static [TableColumn]) -> Self {
        Self { name, row_meaning: row, columns, rows: Vec::new() }
    }

    /// The place of the column called `name`, now or in older exports.
    pub fn column_index(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|column| column.is_named(name))
    }

    /// What `row` has in the column called `name`.
    pub fn cell<'a>(&self, row: &'a [TableCell], name: &str) -> Option<&'a TableCell> {
        row.get(self.column_index(name)?).filter(|cell| **cell != TableCell::Missing)
    }

    /// The number that `row` has in the column called `name`.
    pub fn number(&self, row: &[TableCell], name: &str) -> Option<f64> {
        match self.cell(row, name)? {
            TableCell::Integer(number) => Some(*number as f64),
            TableCell::Number(number) => Some(*number),
            // What a person answered is words, whatever was asked.
            TableCell::Text(words) => words.parse().ok().filter(|number: &f64| number.is_finite()),
            TableCell::Missing => None,
        }
    }

    /// What `row` has in the column called `name`, as words; empty if it is missing.
    pub fn text(&self, row: &[TableCell], name: &str) -> String {
        self.cell(row, name).map(TableCell::to_string).unwrap_or_default()
    }

    /// Adds a row.
    ///
    /// # Panics
    /// If it has not as many cells as there are columns.
    pub fn push(&mut self, row: Vec<TableCell>) {
        assert_eq!(row.len(), self.columns.len(), "cells of a row of {}", self.name);
        self.rows.push(row);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tables had `-0`, which a reader takes for another value than 0.
    #[test]
    fn no_cell_shows_a_negative_zero() {
        for cell in [
            TableCell::from(-0.0),
            TableCell::parse("-0.0"),
            TableCell::parse("-0"),
            TableCell::from(Some(-0.0)),
        ] {
            assert_eq!(cell.to_string(), "0");
            assert_eq!(serde_json::to_string(&cell).unwrap(), "0.0");
        }
        assert_eq!(TableCell::from(-1e-9).to_string(), "-0.000000001");
    }
}
