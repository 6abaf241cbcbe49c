//! Recorded trials that the replay page looks at.

use crate::{
    BridgeError, PageContent, RecordedEmg,
    encoding::{accepts_gzip, encoded_response, gzip},
    meshes::{self, MeshesById},
    server::{PageServerState, json_response},
};
use axum::{
    body::Bytes,
    extract::{Path, State},
    http::{HeaderMap, StatusCode, header},
    response::{IntoResponse, Response},
};
use proact_types::DisplayFrame;
use serde::Serialize;
use std::{
    collections::VecDeque,
    sync::{Arc, Mutex, PoisonError},
};

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
    /// Seed, as text: JavaScript has no whole numbers above 2^53. A bag has none.
    #[serde(serialize_with = "crate::encoding::as_text")]
    #[cfg_attr(feature = "ts", ts(type = "string | null"))]
    pub seed: Option<u64>,
    /// Length, simulated seconds.
    pub seconds: f64,
    /// What the task counted in the end.
    pub score: u32,
    /// Arm and scene.
    pub content: PageContent,
    /// The recomputed trial has the recorded digest; none for a bag, which is not recomputed.
    #[serde(rename = "agrees")]
    pub digest_matches: Option<bool>,
    /// The record has a result; a trial that crashed has none.
    pub finished: bool,
    /// What was displayed, times ascending.
    pub frames: Vec<DisplayFrame>,
    /// The muscles; none without an armband, and for a bag.
    pub emg: Option<RecordedEmg>,
}

/// What the list says of a trial.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct TrialSummary {
    /// What it is called.
    pub name: String,
    /// Control method.
    pub method: String,
    /// Set-up.
    pub setup: String,
    /// Seed, as text: JavaScript has no whole numbers above 2^53. A bag has none.
    #[serde(serialize_with = "crate::encoding::as_text")]
    #[cfg_attr(feature = "ts", ts(type = "string | null"))]
    pub seed: Option<u64>,
    /// Length, simulated seconds.
    pub seconds: f64,
    /// What the task counted in the end.
    pub score: u32,
}

/// Recorded trials as the replay page gets them: a list, and each trial when a page asks for it.
pub trait TrialLibrary: Send + Sync {
    /// All trials, in the order of their numbers.
    fn list(&self) -> Vec<TrialSummary>;

    /// The trial of that number in the list. May take seconds: it is called on a thread of its own, one call at a time.
    ///
    /// # Errors
    /// Why it cannot be shown, for the person at the page.
    fn trial(&self, number: usize) -> Result<RecordedTrial, String>;

    /// A report on the trials as an HTML page without scripts, served at `/report`; it links to `replay?trial=NUMBER`.
    fn report(&self) -> Option<String> {
        None
    }
}

impl TrialLibrary for Vec<RecordedTrial> {
    fn list(&self) -> Vec<TrialSummary> {
        let summary = |trial: &RecordedTrial| TrialSummary {
            name: trial.name.clone(),
            method: trial.method.clone(),
            setup: trial.setup.clone(),
            seed: trial.seed,
            seconds: trial.seconds,
            score: trial.score,
        };
        self.iter().map(summary).collect()
    }

    fn trial(&self, number: usize) -> Result<RecordedTrial, String> {
        self.get(number).cloned().ok_or_else(|| format!("there is no trial {number}"))
    }
}

/// So many trials are kept written out: as many as a page shows side by side.
const MAX_CACHED_TRIALS: usize = 2;

/// A trial as JSON, as it is and compressed: megabytes, of which a tenth goes over the line.
#[derive(Clone)]
struct EncodedTrial {
    plain: Bytes,
    gzipped: Bytes,
}

/// A library in front of the pages: written out once for all of them.
pub(crate) struct StoredTrials {
    library: Arc<dyn TrialLibrary>,
    count: usize,
    /// The list as JSON.
    list: Bytes,
    /// The report.
    report: Option<Bytes>,
    /// The trials asked for last. Locked while one is made.
    cache: Arc<tokio::sync::Mutex<VecDeque<(usize, EncodedTrial)>>>,
    /// What their arms are drawn with.
    pub(crate) meshes: Arc<Mutex<MeshesById>>,
}

impl StoredTrials {
    pub(crate) fn new(library: Arc<dyn TrialLibrary>) -> Result<Self, BridgeError> {
        let list = library.list();
        let json =
            proact_types::to_json(&list).map_err(|error| BridgeError::Content { what: error.to_string() })?;
        Ok(Self {
            count: list.len(),
            list: json.into(),
            report: library.report().map(Bytes::from),
            cache: Arc::default(),
            meshes: Arc::default(),
            library,
        })
    }

    /// The trial of that number, or why it cannot be given.
    async fn trial(&self, number: usize) -> Result<EncodedTrial, (StatusCode, String)> {
        if number >= self.count {
            let reason = format!("there is no trial {number}, expected a number below {}\n", self.count);
            return Err((StatusCode::NOT_FOUND, reason));
        }
        let mut made = Arc::clone(&self.cache).lock_owned().await;
        if let Some((_, written)) = made.iter().find(|(other, _)| *other == number) {
            return Ok(written.clone());
        }
        let (library, meshes) = (Arc::clone(&self.library), Arc::clone(&self.meshes));
        // It holds the lock itself: a page that asks and goes away does not let the next one begin beside it.
        let make = move || {
            let trial = library.trial(number)?;
            let plain = proact_types::to_json(&trial).map_err(|error| error.to_string())?;
            let small = gzip(plain.as_bytes()).map_err(|error| error.to_string())?.into();
            let written = EncodedTrial { plain: plain.into(), gzipped: small };
            let own = meshes::meshes_by_id(&trial.content.meshes);
            meshes.lock().unwrap_or_else(PoisonError::into_inner).extend(own);
            made.truncate(MAX_CACHED_TRIALS - 1);
            made.push_front((number, written.clone()));
            Ok::<_, String>(written)
        };
        let done = tokio::task::spawn_blocking(make).await.map_err(|error| error.to_string());
        done.and_then(|made| made).map_err(|why| (StatusCode::UNPROCESSABLE_ENTITY, why))
    }
}

/// `/api/trials`.
pub(crate) async fn list(State(shared): State<Arc<PageServerState>>) -> Response {
    json_response(shared.trials().list.clone())
}

/// `/api/trials/<number>`.
pub(crate) async fn get_trial(
    State(shared): State<Arc<PageServerState>>,
    Path(number): Path<usize>,
    request_headers: HeaderMap,
) -> Response {
    let headers = [(header::CONTENT_TYPE, "application/json"), (header::CACHE_CONTROL, "no-store")];
    match shared.trials().trial(number).await {
        Ok(EncodedTrial { gzipped: small, .. }) if accepts_gzip(&request_headers) => {
            encoded_response(headers, small, true)
        }
        Ok(EncodedTrial { plain, .. }) => encoded_response(headers, plain, false),
        Err(refusal) => refusal.into_response(),
    }
}

/// What the report may do: look as its own style says. It holds what people typed, and runs nothing.
const REPORT_CONTENT_SECURITY_POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// `/report`.
pub(crate) async fn report(State(shared): State<Arc<PageServerState>>) -> Response {
    let Some(report) = shared.trials().report.clone() else {
        let how = "there is no report here; make one with: proact analyze DIR --page\n";
        return (StatusCode::NOT_FOUND, how).into_response();
    };
    let headers = [
        (header::CONTENT_TYPE, "text/html; charset=utf-8"),
        (header::CACHE_CONTROL, "no-store"),
        (header::CONTENT_SECURITY_POLICY, REPORT_CONTENT_SECURITY_POLICY),
    ];
    (headers, report).into_response()
}
