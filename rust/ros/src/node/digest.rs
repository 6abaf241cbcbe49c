//! Field hashes of one stage's part of a trial, to be compared with those of the trial in one process.

use super::{NodeError, graph::parameter};
use proact_testbed::{Digest, Field, SpanDigest};
use proact_types::SimTime;
use serde::Serialize;
use std::{
    fs::File,
    io::{BufWriter, Write},
};

/// Writes one line of JSON for each span: its last tick, and the hashes of the stage's fields by name.
pub(super) struct Spans {
    pub digest: Digest,
    file: BufWriter<File>,
}

#[derive(Serialize)]
struct Line {
    tick: SimTime,
    fields: std::collections::BTreeMap<&'static str, String>,
}

impl Spans {
    /// Into the file that `~digest` names; none where it names none.
    pub(super) fn of_parameter() -> Result<Option<Self>, NodeError> {
        let path: String = parameter("~digest", String::new(), "path of a file")?;
        if path.is_empty() {
            return Ok(None);
        }
        let file = File::create(&path).map_err(|error| NodeError::Setup {
            what: format!("~digest {path}"),
            reason: error.to_string(),
        })?;
        Ok(Some(Self { digest: Digest::new(""), file: BufWriter::new(file) }))
    }

    /// Ends tick `now`. `fields` are the stage's own; `last`: the trial ends with this tick.
    pub(super) fn end_tick(&mut self, now: SimTime, fields: &[Field], last: bool) {
        let Some(SpanDigest { tick, fields: hashes, .. }) = self.digest.end_tick(now, last) else { return };
        let all = Field::ALL.iter().zip(hashes);
        let own = all.filter(|(field, _)| fields.contains(field)).map(|(field, hash)| (field.name(), hash));
        let line = Line { tick, fields: own.collect() };
        let written = serde_json::to_writer(&mut self.file, &line)
            .map_err(std::io::Error::from)
            .and_then(|()| self.file.write_all(b"\n"))
            .and_then(|()| self.file.flush());
        if let Err(error) = written {
            rosrust::ros_warn!("the digest cannot be written: {error}");
        }
    }
}
