//! The journal of a study: events, each on the disk before it is acknowledged, in one SQLite file.

use crate::FileLock;
use proact_analysis::table::{ColumnNames, Table, TableCell};
use rusqlite::{Connection, OpenFlags, ToSql, params, types::ToSqlOutput};
use serde::{Serialize, de::DeserializeOwned};
use std::{
    fs::{self, File, TryLockError},
    io,
    path::{Path, PathBuf},
    time::Duration,
};

/// The layout of the file, in SQLite's `user_version`.
const JOURNAL_FORMAT: i64 = 1;
/// So long a reader and the writer wait for each other.
const BUSY_TIMEOUT: Duration = Duration::from_secs(5);
/// Tables that are the journal's own.
const RESERVED_TABLES: [&str; 2] = ["journal", "texts"];

/// Why a journal cannot be opened, read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum JournalError {
    /// Another program writes to it.
    #[error("{} is in use: another program runs this study; end that one first", path.display())]
    InUse {
        /// The file.
        path: PathBuf,
    },
    /// The disk is full; what was not acknowledged is not there, all else is.
    #[error(
        "the disk is full: {} could not be written to; nothing that was acknowledged is lost. Make room, then run the study again",
        path.display()
    )]
    DiskFull {
        /// The file.
        path: PathBuf,
    },
    /// There is none.
    #[error("there is no {}: the study was not run yet", path.display())]
    Missing {
        /// The file.
        path: PathBuf,
    },
    /// The file was made, and its first page never came on the disk.
    #[error(
        "{} is empty: the program that made it ended before anything was on the disk, as on a full one. Nothing was \
         recorded and nothing is lost; make room and run the study again",
        path.display()
    )]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// It is of another program.
    #[error("{} has format {got}, expected {JOURNAL_FORMAT}: another version of the program wrote it", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// Its format.
        got: i64,
    },
    /// An event cannot be understood.
    #[error("{}: event {id} is not readable: {reason}", path.display())]
    Event {
        /// The file.
        path: PathBuf,
        /// Which.
        id: i64,
        /// Why.
        reason: String,
    },
    /// A text that events name is not there.
    #[error("{}: the text with the hash {hash} is missing, such as the plan that the study began with", path.display())]
    MissingText {
        /// The file.
        path: PathBuf,
        /// Which.
        hash: String,
    },
    /// SQLite or the system refused.
    #[error("{}: {source}", path.display())]
    Sqlite {
        /// The file.
        path: PathBuf,
        /// What it said.
        source: rusqlite::Error,
    },
    /// The system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What it said.
        source: io::Error,
    },
}

/// An event of the journal.
#[derive(Clone, Debug, PartialEq)]
pub struct JournalEntry<E> {
    /// Its number, from 1 without gaps.
    pub id: i64,
    /// When it was written, by the clock of the machine, as RFC 3339 in UTC.
    pub written_at: String,
    /// What happened.
    pub event: E,
}

/// A journal. One program at a time writes to it; others may read. An event that was acknowledged is on the disk, whatever
/// happens to program and machine (SQLite with `synchronous = EXTRA`); the order of events is that of their numbers, not that
/// of the clock.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    db: Connection,
    /// Held while this journal writes.
    _lock: Option<FileLock>,
}

impl Journal {
    /// Opens the journal in the file `path` for writing, and makes it if it is not there. The lock is `path` with `.lock`.
    ///
    /// # Errors
    /// [`JournalError`].
    pub fn open(path: &Path) -> Result<Self, JournalError> {
        let io = |source| JournalError::Io { path: path.to_owned(), source };
        let mut name = path.as_os_str().to_owned();
        name.push(".lock");
        let lock = fs::OpenOptions::new().create(true).append(true).open(&name).map_err(io)?;
        let lock = FileLock::try_acquire(lock).map_err(|error| match error {
            TryLockError::WouldBlock => JournalError::InUse { path: path.to_owned() },
            TryLockError::Error(source) => io(source),
        })?;
        let db = Connection::open(path).map_err(sqlite_error(path))?;
        let journal = Self { path: path.to_owned(), db, _lock: Some(lock) };
        journal.begin().map_err(sqlite_error(path))?;
        journal.check_format()?;
        Ok(journal)
    }

    /// Opens the journal for reading, beside a program that writes to it.
    ///
    /// # Errors
    /// [`JournalError`].
    pub fn open_read_only(path: &Path) -> Result<Self, JournalError> {
        if !path.is_file() {
            return Err(JournalError::Missing { path: path.to_owned() });
        }
        let db = Connection::open_with_flags(path, OpenFlags::SQLITE_OPEN_READ_WRITE)
            .map_err(sqlite_error(path))?;
        db.busy_timeout(BUSY_TIMEOUT).map_err(sqlite_error(path))?;
        let journal = Self { path: path.to_owned(), db, _lock: None };
        journal.check_format()?;
        Ok(journal)
    }

    fn begin(&self) -> rusqlite::Result<()> {
        self.db.busy_timeout(BUSY_TIMEOUT)?;
        self.db.pragma_update(None, "synchronous", "EXTRA")?;
        let format: i64 = self.db.pragma_query_value(None, "user_version", |row| row.get(0))?;
        if format == 0 {
            // As a whole or not at all.
            self.db.execute_batch(&format!(
                "BEGIN IMMEDIATE;
                 CREATE TABLE journal (id INTEGER PRIMARY KEY, at TEXT NOT NULL, event TEXT NOT NULL,
                   kind TEXT GENERATED ALWAYS AS (json_extract(event, '$.kind')) VIRTUAL);
                 CREATE TABLE texts (hash TEXT PRIMARY KEY, name TEXT NOT NULL, text TEXT NOT NULL);
                 PRAGMA user_version = {JOURNAL_FORMAT};
                 COMMIT;"
            ))?;
        }
        Ok(())
    }

    fn check_format(&self) -> Result<(), JournalError> {
        let format = self.db.pragma_query_value(None, "user_version", |row| row.get::<_, i64>(0));
        match format.map_err(sqlite_error(&self.path))? {
            JOURNAL_FORMAT => Ok(()),
            0 if self.is_empty().map_err(sqlite_error(&self.path))? => {
                Err(JournalError::Empty { path: self.path.clone() })
            }
            got => Err(JournalError::Format { path: self.path.clone(), got }),
        }
    }

    /// Whether nothing was ever written to the file.
    fn is_empty(&self) -> rusqlite::Result<bool> {
        self.db.query_row("SELECT count(*) = 0 FROM sqlite_schema", [], |row| row.get(0))
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Appends an event; when this returns it is on the disk. Its number.
    ///
    /// # Errors
    /// [`JournalError`]; the event is not there then.
    pub fn append<E: Serialize>(&mut self, at: &str, event: &E) -> Result<i64, JournalError> {
        let unreadable = |error: serde_json::Error| JournalError::Event {
            path: self.path.clone(),
            id: 0,
            reason: error.to_string(),
        };
        let text = serde_json::to_string(event).map_err(unreadable)?;
        self.db
            .prepare_cached("INSERT INTO journal (at, event) VALUES (?1, ?2)")
            .and_then(|mut insert| insert.execute(params![at, text]))
            .map_err(sqlite_error(&self.path))?;
        Ok(self.db.last_insert_rowid())
    }

    /// All events, in their order.
    ///
    /// # Errors
    /// [`JournalError`].
    pub fn entries<E: DeserializeOwned>(&self) -> Result<Vec<JournalEntry<E>>, JournalError> {
        let read = || -> rusqlite::Result<Vec<(i64, String, String)>> {
            let mut select = self.db.prepare("SELECT id, at, event FROM journal ORDER BY id")?;
            let rows = select.query_map([], |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?)))?;
            rows.collect()
        };
        let rows = read().map_err(sqlite_error(&self.path))?;
        let parse = |(id, at, text): (i64, String, String)| {
            let event = serde_json::from_str(&text).map_err(|error| JournalError::Event {
                path: self.path.clone(),
                id,
                reason: error.to_string(),
            })?;
            Ok(JournalEntry { id, written_at: at, event })
        };
        rows.into_iter().map(parse).collect()
    }

    /// Keeps a text by its hash, such as a version of the plan.
    ///
    /// # Errors
    /// [`JournalError`].
    pub fn store_text(&mut self, hash: &str, name: &str, text: &str) -> Result<(), JournalError> {
        self.db
            .execute(
                "INSERT OR IGNORE INTO texts (hash, name, text) VALUES (?1, ?2, ?3)",
                params![hash, name, text],
            )
            .map_err(sqlite_error(&self.path))?;
        Ok(())
    }

    /// The text with this hash.
    ///
    /// # Errors
    /// [`JournalError`].
    pub fn text(&self, hash: &str) -> Result<Option<String>, JournalError> {
        let found = self.db.query_row("SELECT text FROM texts WHERE hash = ?1", [hash], |row| row.get(0));
        match found {
            Ok(text) => Ok(Some(text)),
            Err(rusqlite::Error::QueryReturnedNoRows) => Ok(None),
            Err(error) => Err(sqlite_error(&self.path)(error)),
        }
    }

    /// Puts these tables beside the journal, in place of those of the same name; all of them or none.
    ///
    /// # Errors
    /// [`JournalError`].
    pub fn put_tables(&mut self, tables: &[Table]) -> Result<(), JournalError> {
        insert_tables(&mut self.db, tables, ColumnNames::Present).map_err(sqlite_error(&self.path))
    }

    /// Writes these tables into the new SQLite file `path`, without a journal.
    ///
    /// # Errors
    /// [`JournalError`], also if `path` exists.
    pub fn write_tables(path: &Path, tables: &[Table], names: ColumnNames) -> Result<(), JournalError> {
        // SQLite opens what is there.
        File::create_new(path).map_err(|source| JournalError::Io { path: path.to_owned(), source })?;
        let mut db = Connection::open(path).map_err(sqlite_error(path))?;
        insert_tables(&mut db, tables, names).map_err(sqlite_error(path))
    }

    /// Copies the whole file, as it is at one moment, to `to`.
    ///
    /// # Errors
    /// [`JournalError`], also if `to` exists.
    pub fn copy_to(&self, to: &Path) -> Result<(), JournalError> {
        let name = to.to_string_lossy();
        self.db.execute("VACUUM INTO ?1", [name.as_ref()]).map_err(sqlite_error(to))?;
        Ok(())
    }
}

fn insert_tables(db: &mut Connection, tables: &[Table], names: ColumnNames) -> rusqlite::Result<()> {
    let transaction = db.transaction()?;
    for table in tables.iter().filter(|table| !RESERVED_TABLES.contains(&table.name)) {
        let name = quote_identifier(table.name);
        let columns: Vec<String> =
            table.columns.iter().map(|column| quote_identifier(column.written_name(names))).collect();
        transaction.execute_batch(&format!(
            "DROP TABLE IF EXISTS {name}; CREATE TABLE {name} ({});",
            columns.join(", ")
        ))?;
        let placeholders = vec!["?"; columns.len()].join(", ");
        let mut insert = transaction.prepare(&format!("INSERT INTO {name} VALUES ({placeholders})"))?;
        for row in &table.rows {
            insert.execute(rusqlite::params_from_iter(row.iter().map(SqlValue)))?;
        }
    }
    transaction.commit()
}

struct SqlValue<'a>(&'a TableCell);

impl ToSql for SqlValue<'_> {
    fn to_sql(&self) -> rusqlite::Result<ToSqlOutput<'_>> {
        match self.0 {
            TableCell::Missing => {
                rusqlite::types::Null.to_sql().map(|_| ToSqlOutput::from(rusqlite::types::Null))
            }
            TableCell::Integer(number) => Ok(ToSqlOutput::from(*number)),
            TableCell::Number(number) => Ok(ToSqlOutput::from(*number)),
            TableCell::Text(words) => Ok(ToSqlOutput::from(words.as_str())),
        }
    }
}

fn quote_identifier(name: &str) -> String {
    format!("\"{}\"", name.replace('"', "\"\""))
}

fn sqlite_error(path: &Path) -> impl FnOnce(rusqlite::Error) -> JournalError {
    let path = path.to_owned();
    move |source| match source.sqlite_error_code() {
        Some(rusqlite::ErrorCode::DiskFull) => JournalError::DiskFull { path },
        _ => JournalError::Sqlite { path, source },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_analysis::table::TableColumn;
    use serde_json::{Value as Json, json};

    fn temp_journal() -> (tempfile::TempDir, PathBuf) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("study.sqlite");
        (dir, path)
    }

    #[test]
    fn what_was_appended_is_there_and_one_program_writes() {
        let (_dir, path) = temp_journal();
        assert!(matches!(Journal::open_read_only(&path), Err(JournalError::Missing { .. })));
        let mut journal = Journal::open(&path).unwrap();
        assert_eq!(
            journal.append("2026-01-01T00:00:00Z", &json!({"kind": "noted", "text": "one"})).unwrap(),
            1
        );
        let second = Journal::open(&path).unwrap_err();
        assert!(second.to_string().contains("another program runs this study"), "{second}");
        // Who reads is not kept out, and sees what is newest.
        let reader = Journal::open_read_only(&path).unwrap();
        assert_eq!(
            journal.append("2025-01-01T00:00:00Z", &json!({"kind": "noted", "text": "two"})).unwrap(),
            2
        );
        let texts: Vec<String> = reader
            .entries::<Json>()
            .unwrap()
            .iter()
            .map(|entry| entry.event["text"].as_str().unwrap().to_owned())
            .collect();
        assert_eq!(texts, ["one", "two"], "by number, not by the clock");
        drop(journal);
        assert!(Journal::open(&path).is_ok(), "the lock goes with the program");
    }

    #[test]
    fn files_that_are_no_journal_of_this_program_are_refused() {
        let (_dir, path) = temp_journal();
        fs::write(&path, "not a database at all, but a text that somebody put here").unwrap();
        assert!(Journal::open(&path).unwrap_err().to_string().contains("file is not a database"));
        fs::remove_file(&path).unwrap();
        Connection::open(&path).unwrap().pragma_update(None, "user_version", 99).unwrap();
        let error = Journal::open(&path).unwrap_err();
        assert!(error.to_string().contains("has format 99, expected 1"), "{error}");
    }

    #[test]
    fn a_file_that_a_full_disk_left_empty_is_told_and_taken_up() {
        // It was of "format 0, another version of the program wrote it".
        let (_dir, path) = temp_journal();
        File::create(&path).unwrap();
        let error = Journal::open_read_only(&path).unwrap_err().to_string();
        assert!(error.contains("is empty") && error.contains("run the study again"), "{error}");
        Journal::open(&path).unwrap();
        Journal::open_read_only(&path).unwrap();
    }

    #[test]
    fn texts_are_kept_by_their_hash_and_tables_are_replaced() {
        let (dir, path) = temp_journal();
        let mut journal = Journal::open(&path).unwrap();
        journal.store_text("ab", "plan.toml", "participants = 1").unwrap();
        journal.store_text("ab", "plan.toml", "participants = 2").unwrap();
        assert_eq!(journal.text("ab").unwrap().as_deref(), Some("participants = 1"));
        assert_eq!(journal.text("cd").unwrap(), None);
        const COLUMNS: &[TableColumn] = &[
            TableColumn { name: "who", unit: "", meaning: "a name", source: "test", formerly: "" },
            TableColumn { name: "much", unit: "s", meaning: "a number", source: "test", formerly: "" },
        ];
        let mut table = Table::new("trials", "a trial", COLUMNS);
        table.push(vec!["a".into(), 1.5.into()]);
        table.push(vec!["b\"; DROP TABLE journal; --".into(), TableCell::Missing]);
        journal.put_tables(std::slice::from_ref(&table)).unwrap();
        table.rows.truncate(1);
        journal.put_tables(&[table]).unwrap();
        let copy = dir.path().join("copy.sqlite");
        journal.copy_to(&copy).unwrap();
        let rows: i64 = Connection::open(&copy)
            .unwrap()
            .query_row("SELECT count(*) FROM trials WHERE much = 1.5", [], |row| row.get(0))
            .unwrap();
        assert_eq!(rows, 1);
        assert!(journal.copy_to(&copy).is_err(), "nothing is overwritten");
    }

    #[test]
    fn a_full_disk_costs_only_what_was_not_acknowledged() {
        let (_dir, path) = temp_journal();
        let mut journal = Journal::open(&path).unwrap();
        journal.db.pragma_update(None, "max_page_count", 8).unwrap();
        let long = "x".repeat(3000);
        let mut acknowledged = 0;
        let error = loop {
            match journal.append("", &json!({"kind": "noted", "text": long})) {
                Ok(id) => acknowledged = id,
                Err(error) => break error,
            }
        };
        assert!(matches!(error, JournalError::DiskFull { .. }), "{error}");
        drop(journal);
        assert_eq!(Journal::open(&path).unwrap().entries::<Json>().unwrap().len() as i64, acknowledged);
        assert!(acknowledged > 0);
    }
}
