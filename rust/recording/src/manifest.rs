//! `SHA256SUMS`: a hash of every file of a finished record, as `sha256sum -c SHA256SUMS` checks it too.

use crate::{MANIFEST_FILE, RecordingError, files, trial_writer::write_file};
use proact_types::MAX_TEXT_BYTES;
use sha2::{Digest, Sha256};
use std::{
    collections::BTreeMap,
    fs,
    io::{self, Read},
    path::Path,
};

/// Hashes every file in `dir` and writes the hashes down. Written last: what it covers is complete. Folders, and files
/// whose names `sha256sum` would have to mask, are left out.
///
/// # Errors
/// [`RecordingError::Io`].
pub fn write_manifest(dir: &Path) -> Result<(), RecordingError> {
    let mut names = Vec::new();
    for entry in fs::read_dir(dir).map_err(RecordingError::io("read", dir))? {
        let entry = entry.map_err(RecordingError::io("read", dir))?;
        let plain = |name: &String| name != MANIFEST_FILE && !name.contains(['\\', '\n', '\r']);
        if entry.path().is_file() {
            names.extend(entry.file_name().into_string().ok().filter(plain));
        }
    }
    names.sort();
    let mut text = String::new();
    for name in names {
        let path = dir.join(&name);
        let sum = sha256_of_file(&path).map_err(RecordingError::io("read", &path))?;
        text += &format!("{sum}  {name}\n");
    }
    write_file(&dir.join(MANIFEST_FILE), text.as_bytes())
}

/// Whether the files in `dir` are those that [`write_manifest`] wrote down; false if it did not.
///
/// # Errors
/// [`RecordingError::Changed`] with every file that is missing or has another hash; [`RecordingError::Damaged`] for a manifest that
/// cannot be read.
pub fn verify_manifest(dir: &Path) -> Result<bool, RecordingError> {
    check(dir, &[])
}

/// What [`RecordingError::Changed`] says of a file with another hash.
pub const HASH_MISMATCH_TEXT: &str = "has changed";

/// Compares the files in `dir` with the manifest. False if there is none.
///
/// # Errors
/// [`RecordingError::Changed`] with every file that is missing or has another hash, or that is in `expected` and the
/// manifest does not cover; [`RecordingError::Damaged`] if the manifest itself cannot be read.
pub(crate) fn check(dir: &Path, expected: &[&str]) -> Result<bool, RecordingError> {
    let path = dir.join(MANIFEST_FILE);
    let text = match files::read(&path, MAX_TEXT_BYTES) {
        Ok(text) => text,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(false),
        Err(error) => return Err(RecordingError::io("read", &path)(error)),
    };
    let mut sums = BTreeMap::new();
    let mut offset = 0;
    for line in text.split_inclusive(|byte| *byte == b'\n') {
        let (sum, name) = parse(line).ok_or_else(|| RecordingError::Damaged {
            file: path.clone(),
            offset,
            reason: "expected a hash of 64 hexadecimal digits, two blanks and a name".to_owned(),
        })?;
        // As it is written: each name once, in order.
        if sums.last_key_value().is_some_and(|(last, _)| *last >= name) {
            let reason = format!("{name} stands after a name that comes later, or twice");
            return Err(RecordingError::Damaged { file: path, offset, reason });
        }
        sums.insert(name, sum);
        offset += line.len() as u64;
    }
    let mut changed: Vec<String> = Vec::new();
    for (name, sum) in &sums {
        match sha256_of_file(&dir.join(name)) {
            Ok(now) if now == *sum => {}
            Ok(_) => changed.push(format!("{name} {HASH_MISMATCH_TEXT}")),
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                changed.push(format!("{name} is missing"))
            }
            Err(error) => return Err(RecordingError::io("read", &dir.join(name))(error)),
        }
    }
    let uncovered = expected.iter().filter(|name| !sums.contains_key(**name));
    changed.extend(uncovered.map(|name| format!("{name} is not in {MANIFEST_FILE}")));
    match changed.is_empty() {
        true => Ok(true),
        false => Err(RecordingError::Changed { dir: dir.to_owned(), files: changed.join(", ") }),
    }
}

/// Hash and name of a line. A name is that of a file in the directory itself.
fn parse(line: &[u8]) -> Option<(&str, &str)> {
    let line = std::str::from_utf8(line).ok()?.strip_suffix('\n')?;
    let (sum, name) = line.split_once("  ")?;
    let hexadecimal =
        sum.len() == 64 && sum.bytes().all(|b| b.is_ascii_digit() || (b'a'..=b'f').contains(&b));
    let plain = !name.is_empty() && !name.contains('/') && name != "..";
    (hexadecimal && plain).then_some((sum, name))
}

/// SHA-256 of a file, 64 hexadecimal digits.
fn sha256_of_file(path: &Path) -> io::Result<String> {
    sha256(files::open(path)?)
}

/// SHA-256 of all that can be read, 64 hexadecimal digits.
///
/// # Errors
/// As the source.
pub fn sha256(mut from: impl Read) -> io::Result<String> {
    let (mut hasher, mut bytes) = (Sha256::new(), vec![0; 1 << 16]);
    loop {
        match from.read(&mut bytes)? {
            0 => return Ok(hex(&hasher.finalize())),
            count => hasher.update(&bytes[..count]),
        }
    }
}

/// SHA-256 of some bytes, 64 hexadecimal digits.
pub fn sha256_of_bytes(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
