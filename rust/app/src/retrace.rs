//! A recorded trial, tick by tick: for tables of what it held.

use crate::replay::{Opened, ReplayOptions, last_digest, open_trial};
use proact_testbed::{Divergence, SpanDigest, Testbed, TrialConfig, TrialResult, first_divergence};
use proact_types::{Event, TickInput};
use std::{error::Error, path::Path};

/// What a record holds beside its ticks.
#[derive(Clone, Debug)]
pub struct Retraced {
    /// What the trial depended on.
    pub config: TrialConfig,
    /// What happened.
    pub events: Vec<Event>,
    /// What it ended with; none if it was interrupted.
    pub result: Option<TrialResult>,
    /// Digest of the record.
    pub recorded: String,
    /// Where the recomputed trial and the record part; none where they agree.
    pub divergence: Option<Divergence>,
}

/// Recomputes the trial in `dir` up to the end of its record: `seen` gets each tick's input and the testbed after it, at first the
/// testbed at time zero with no input.
///
/// # Errors
/// As [`replay_trial`](crate::replay_trial).
pub fn retrace(
    dir: &Path,
    options: &ReplayOptions,
    mut seen: impl FnMut(&Testbed, &TickInput),
) -> Result<Retraced, Box<dyn Error>> {
    let Opened { record, config, mut testbed, recorded, result, .. } = open_trial(dir, options)?;
    seen(&testbed, &TickInput::default());
    let mut inputs = record.inputs()?;
    let mut next = inputs.next().transpose()?;
    let mut spans: Vec<SpanDigest> = Vec::new();
    let last = record.end().0;
    for tick in 1..=last {
        let mut input = TickInput::default();
        while let Some(logged) = next.take_if(|logged| logged.tick.0 <= tick) {
            input = logged.input;
            next = inputs.next().transpose()?;
        }
        spans.extend(testbed.tick(&input, tick == last)?.span);
        seen(&testbed, &input);
    }
    Ok(Retraced {
        config,
        events: record.events()?,
        result,
        divergence: first_divergence(&recorded, &spans),
        recorded: last_digest(&recorded),
    })
}
