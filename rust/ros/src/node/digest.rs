//! Field hashes of one stage's part of a trial, to be compared with those of the trial in one process.

use super::{NodeError, graph::parameter, rosout};
use proact_testbed::{Digest, DigestField, SpanDigest};
use proact_types::SimTime;
use serde::Serialize;
use std::{
    fs::File,
    io::{BufWriter, Write},
};

/// Writes one line of JSON for each span: its last tick, and the hashes of the stage's fields by name.
pub(super) struct SpanDigestWriter {
    pub digest: Digest,
    file: BufWriter<File>,
}

#[derive(Serialize)]
struct SpanDigestLine {
    tick: SimTime,
    fields: std::collections::BTreeMap<&'static str, String>,
}

impl SpanDigestWriter {
    /// Into the file that `~digest_file` names; none where it names none.
    pub(super) fn from_parameter() -> Result<Option<Self>, NodeError> {
        let path: String = parameter("~digest_file", String::new(), "path of a file")?;
        if path.is_empty() {
            return Ok(None);
        }
        let file = File::create(&path).map_err(|error| NodeError::Setup {
            what: format!("~digest_file {path}"),
            reason: error.to_string(),
        })?;
        Ok(Some(Self { digest: Digest::new(""), file: BufWriter::new(file) }))
    }

    /// Ends tick `now`. `fields` are the stage's own; `last`: the trial ends with this tick.
    pub(super) fn end_tick(&mut self, now: SimTime, fields: &[DigestField], last: bool) {
        let Some(SpanDigest { tick, fields: hashes, .. }) = self.digest.end_tick(now, last) else { return };
        let all = DigestField::ALL.iter().zip(hashes);
        let own = all.filter(|(field, _)| fields.contains(field)).map(|(field, hash)| (field.name(), hash));
        let line = SpanDigestLine { tick, fields: own.collect() };
        let written = serde_json::to_writer(&mut self.file, &line)
            .map_err(std::io::Error::from)
            .and_then(|()| self.file.write_all(b"\n"))
            .and_then(|()| self.file.flush());
        if let Err(error) = written {
            rosout::warn(&format!("the digest cannot be written: {error}"));
        }
    }
}
