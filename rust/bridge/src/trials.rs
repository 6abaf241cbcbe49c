//! Recorded trials that the replay page looks at.

use crate::{
    BridgeError, PageContent,
    meshes::{self, MeshesById},
};
use axum::body::Bytes;
use proact_types::DisplayFrame;
use serde::Serialize;

/// A recorded trial with everything that its replay shows.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct RecordedTrial {
    /// Name of its directory.
    pub name: String,
    /// Control method.
    pub method: String,
    /// Set-up.
    pub setup: String,
    /// Seed; a bag has none.
    pub seed: Option<u64>,
    /// Length, simulated seconds.
    pub seconds: f64,
    /// What the task counted in the end.
    pub score: u32,
    /// Arm and scene.
    pub content: PageContent,
    /// The recomputed trial has the recorded digest; none for a bag, which is not recomputed.
    pub agrees: Option<bool>,
    /// The record has a result; a trial that crashed has none.
    pub finished: bool,
    /// What was displayed, times ascending.
    pub frames: Vec<DisplayFrame>,
}

/// What the list says of a trial.
#[derive(Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub(crate) struct TrialSummary<'a> {
    name: &'a str,
    method: &'a str,
    setup: &'a str,
    seed: Option<u64>,
    seconds: f64,
    score: u32,
}

/// Trials written out once for all pages.
#[derive(Debug, Default)]
pub(crate) struct StoredTrials {
    /// The list as JSON.
    pub(crate) list: Bytes,
    /// Each trial as JSON.
    pub(crate) trials: Vec<Bytes>,
    /// What their arms are drawn with.
    pub(crate) meshes: MeshesById,
}

impl StoredTrials {
    pub(crate) fn new(trials: &[RecordedTrial]) -> Result<Self, BridgeError> {
        let summaries: Vec<TrialSummary> = trials
            .iter()
            .map(|trial| TrialSummary {
                name: &trial.name,
                method: &trial.method,
                setup: &trial.setup,
                seed: trial.seed,
                seconds: trial.seconds,
                score: trial.score,
            })
            .collect();
        let failed = |error: serde_json::Error| BridgeError::Content { what: error.to_string() };
        Ok(Self {
            list: serde_json::to_vec(&summaries).map_err(failed)?.into(),
            trials: trials
                .iter()
                .map(|trial| serde_json::to_vec(trial).map(Bytes::from).map_err(failed))
                .collect::<Result<_, _>>()?,
            meshes: meshes::by_id(trials.iter().flat_map(|trial| &trial.content.meshes)),
        })
    }
}
