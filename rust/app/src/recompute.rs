//! A recorded trial, tick by tick: for tables of what it held.

use crate::replay::{OpenedTrial, ReplayOptions, last_digest, open_trial};
use proact_testbed::{Divergence, SpanDigest, Testbed, TrialConfig, TrialResult, first_divergence};
use proact_types::{Event, TickInput};
use std::{error::Error, path::Path};

/// What a record holds beside its ticks.
#[derive(Clone, Debug)]
pub struct RecomputedRecord {
    /// What the trial depended on.
    pub config: TrialConfig,
    /// What happened.
    pub events: Vec<Event>,
    /// What it ended with; none if it was interrupted.
    pub result: Option<TrialResult>,
    /// What the recomputed trial ended with.
    pub recomputed_result: TrialResult,
    /// Decisions of the EMG's classifier that were published.
    pub decisions: u64,
    /// Digest of the record.
    pub recorded_digest: String,
    /// Where the recomputed trial and the record part; none where they agree.
    pub divergence: Option<Divergence>,
}

/// Recomputes the trial in `dir` up to the end of its record: `seen` gets each tick's input and the testbed after it, at first the
/// testbed at time zero with no input.
///
/// # Errors
/// As [`replay_trial`](crate::replay_trial).
pub fn recompute_record(
    dir: &Path,
    options: &ReplayOptions,
    seen: impl FnMut(&Testbed, &TickInput),
) -> Result<RecomputedRecord, Box<dyn Error>> {
    recompute_opened(open_trial(dir, options)?, seen)
}

/// The same of a trial that is open.
///
/// # Errors
/// As [`retrace`].
pub(crate) fn recompute_opened(
    opened: OpenedTrial,
    mut seen: impl FnMut(&Testbed, &TickInput),
) -> Result<RecomputedRecord, Box<dyn Error>> {
    let OpenedTrial { record, config, mut testbed, recorded_spans: recorded, result, .. } = opened;
    seen(&testbed, &TickInput::default());
    let mut inputs = record.inputs()?;
    let mut next = inputs.next().transpose()?;
    let mut spans: Vec<SpanDigest> = Vec::new();
    let mut decisions = 0;
    let last = record.end().0;
    for tick in 1..=last {
        let mut input = TickInput::default();
        while let Some(logged) = next.take_if(|logged| logged.tick.0 <= tick) {
            input = logged.input;
            next = inputs.next().transpose()?;
        }
        let output = testbed.tick(&input, tick == last)?;
        decisions += u64::from(output.published_command.is_some());
        spans.extend(output.span_digest);
        seen(&testbed, &input);
    }
    Ok(RecomputedRecord {
        config,
        events: record.events()?,
        result,
        recomputed_result: TrialResult::from_testbed(&testbed),
        decisions,
        divergence: first_divergence(&recorded, &spans),
        recorded_digest: last_digest(&recorded),
    })
}
