//! Rows that repeat the one before: the device sent fewer than were written.

use super::{RecordedFault, RecordedSession, columns::Column};

/// Share of repeated rows above which a recording is held. Real streams have none; a fast reader of a slow device starts at a
/// fifth or more.
const HELD: f64 = 0.05;
/// Steps of the converter by which a channel changes, at the median of its changes, so that equal neighbours are not chance.
const LIVELY_STEPS: f64 = 2.0;
/// Chance of equal neighbours in such a channel.
const CHANCE: f64 = 0.25;

/// Whether rows are held, in which recordings. `electrodes` are the channels that are judged.
pub(super) fn held_rows(
    session: &RecordedSession<'_>,
    columns: &[Column],
    electrodes: &[usize],
) -> Option<RecordedFault> {
    let (mut equal, mut rows, mut longest) = (0, 0, 0);
    let mut held = vec![false; session.repetitions.len()];
    for (part, held) in held.iter_mut().enumerate() {
        let lively: Vec<&[f64]> = electrodes
            .iter()
            .map(|channel| (&columns[*channel].values[part][..], columns[*channel].step))
            .filter(|(values, step)| changes_by(values) >= LIVELY_STEPS * step && *step > 0.0)
            .map(|(values, _)| values)
            .collect();
        let Some(first) = lively.first() else { continue };
        let repeats = |k: usize| lively.iter().all(|values| values[k] == values[k - 1]);
        let repeated: Vec<bool> = (1..first.len()).map(repeats).collect();
        let count = repeated.iter().filter(|repeats| **repeats).count();
        let chance = CHANCE.powi(lively.len() as i32);
        *held = count as f64 > (HELD + chance) * repeated.len() as f64;
        if *held {
            equal += count;
            rows += first.len();
            let runs = repeated.chunk_by(|a, b| a == b).filter(|run| run[0]);
            longest = runs.map(|run| run.len() + 1).fold(longest, usize::max);
        }
    }
    let recordings = held.iter().filter(|held| **held).count();
    (recordings > 0).then(|| RecordedFault::Held {
        share: equal as f64 / rows as f64,
        longest,
        recordings,
        of: held.len(),
        files: session.files(|index| held[index]),
    })
}

/// The median of the changes that there are; 0 if there are none.
fn changes_by(values: &[f64]) -> f64 {
    let changes = values.windows(2).map(|pair| (pair[1] - pair[0]).abs()).filter(|change| *change > 0.0);
    crate::model::median(changes.collect()).unwrap_or(0.0)
}
