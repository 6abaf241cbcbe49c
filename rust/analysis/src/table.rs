//! Tidy tables: one row an observation, one column a variable, and what each variable is.

use proact_types::Number;
use serde::{Deserialize, Serialize};

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Column {
    /// Its name.
    pub name: &'static str,
    /// Its unit; empty for a name, a text or a count.
    pub unit: &'static str,
    /// What it is.
    pub meaning: &'static str,
    /// Where it comes from.
    pub source: &'static str,
}

/// A value in a table. As JSON: null, a number, a string.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Cell {
    /// There is none.
    Missing,
    /// A whole number.
    Whole(i64),
    /// A number; one that is not finite is missing.
    Real(f64),
    /// Words.
    Words(String),
}

impl From<&str> for Cell {
    fn from(words: &str) -> Self {
        Cell::Words(words.to_owned())
    }
}

impl From<String> for Cell {
    fn from(words: String) -> Self {
        Cell::Words(words)
    }
}

impl From<f64> for Cell {
    fn from(number: f64) -> Self {
        // Adding zero makes a negative zero positive.
        if number.is_finite() { Cell::Real(number + 0.0) } else { Cell::Missing }
    }
}

impl From<bool> for Cell {
    fn from(yes: bool) -> Self {
        Cell::Whole(i64::from(yes))
    }
}

macro_rules! whole {
    ($($number:ty),*) => {$(
        impl From<$number> for Cell {
            fn from(number: $number) -> Self {
                i64::try_from(number).map_or(Cell::Missing, Cell::Whole)
            }
        }
    )*};
}
whole!(i64, u32, u64, usize);

impl<T: Into<Cell>> From<Option<T>> for Cell {
    fn from(value: Option<T>) -> Self {
        value.map_or(Cell::Missing, Into::into)
    }
}

impl std::fmt::Display for Cell {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Cell::Missing => Ok(()),
            Cell::Whole(number) => write!(to, "{number}"),
            Cell::Real(number) => write!(to, "{}", Number(*number)),
            Cell::Words(words) => to.write_str(words),
        }
    }
}

impl Cell {
    /// What a file has as text: a number if it is written as one.
    pub fn read(text: &str) -> Self {
        match (text.parse::<i64>(), text.parse::<f64>()) {
            _ if text.is_empty() => Cell::Missing,
            // Tables of earlier versions have it.
            _ if text == "-0" => Cell::Real(0.0),
            // `007` is a name.
            (Ok(whole), _) if whole.to_string() == text => Cell::Whole(whole),
            (Err(_), Ok(real)) if real.is_finite() => real.into(),
            _ => Cell::Words(text.to_owned()),
        }
    }
}

/// A value as the word that files have for it, such as `on_target`.
pub fn word<T: serde::Serialize>(value: &T) -> String {
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
    pub row: &'static str,
    /// The columns.
    pub columns: &'static [Column],
    /// The rows.
    pub rows: Vec<Vec<Cell>>,
}

impl Table {
    /// A table without rows.
    pub fn new(name: &'static str, row: &'static str, columns: &'static [Column]) -> Self {
        Self { name, row, columns, rows: Vec::new() }
    }

    /// The place of the column called `name`.
    pub fn place(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|column| column.name == name)
    }

    /// What `row` has in the column called `name`.
    pub fn cell<'a>(&self, row: &'a [Cell], name: &str) -> Option<&'a Cell> {
        row.get(self.place(name)?).filter(|cell| **cell != Cell::Missing)
    }

    /// The number that `row` has in the column called `name`.
    pub fn number(&self, row: &[Cell], name: &str) -> Option<f64> {
        match self.cell(row, name)? {
            Cell::Whole(number) => Some(*number as f64),
            Cell::Real(number) => Some(*number),
            // What a person answered is words, whatever was asked.
            Cell::Words(words) => words.parse().ok().filter(|number: &f64| number.is_finite()),
            Cell::Missing => None,
        }
    }

    /// What `row` has in the column called `name`, as words; empty if it is missing.
    pub fn words(&self, row: &[Cell], name: &str) -> String {
        self.cell(row, name).map(Cell::to_string).unwrap_or_default()
    }

    /// Adds a row.
    ///
    /// # Panics
    /// If it has not as many cells as there are columns.
    pub fn push(&mut self, row: Vec<Cell>) {
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
        for cell in [Cell::from(-0.0), Cell::read("-0.0"), Cell::read("-0"), Cell::from(Some(-0.0))] {
            assert_eq!(cell.to_string(), "0");
            assert_eq!(serde_json::to_string(&cell).unwrap(), "0.0");
        }
        assert_eq!(Cell::from(-1e-9).to_string(), "-0.000000001");
    }
}
