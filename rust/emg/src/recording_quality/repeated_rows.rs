//! Rows that repeat the one before: the device sent fewer than were written.

use super::{RecordingFault, RecordingSet, columns::ColumnStatistics};

/// Share of repeated rows above which a recording is held. Real streams have none; a fast reader of a slow device starts at a
/// fifth or more.
const MIN_REPEATED_SHARE: f64 = 0.05;
/// Steps of the converter by which a channel changes, at the median of its changes, so that equal neighbours are not chance.
const MIN_CHANGE_STEPS: f64 = 2.0;
/// Chance of equal neighbours in such a channel.
const MAX_EQUAL_NEIGHBOR_PROBABILITY: f64 = 0.25;

/// Whether rows are held, in which recordings. `electrodes` are the channels that are judged.
pub(super) fn find_repeated_rows(
    recording_set: &RecordingSet<'_>,
    columns: &[ColumnStatistics],
    electrodes: &[usize],
) -> Option<RecordingFault> {
    let (mut equal, mut rows, mut max_run) = (0, 0, 0);
    let mut held = vec![false; recording_set.repetitions.len()];
    for (part, held) in held.iter_mut().enumerate() {
        let lively: Vec<&[f64]> = electrodes
            .iter()
            .map(|channel| (&columns[*channel].values[part][..], columns[*channel].step))
            .filter(|(values, step)| median_change(values) >= MIN_CHANGE_STEPS * step && *step > 0.0)
            .map(|(values, _)| values)
            .collect();
        let Some(first) = lively.first() else { continue };
        let repeats = |k: usize| lively.iter().all(|values| values[k] == values[k - 1]);
        let repeated: Vec<bool> = (1..first.len()).map(repeats).collect();
        let count = repeated.iter().filter(|repeats| **repeats).count();
        let probability = MAX_EQUAL_NEIGHBOR_PROBABILITY.powi(lively.len() as i32);
        *held = count as f64 > (MIN_REPEATED_SHARE + probability) * repeated.len() as f64;
        if *held {
            equal += count;
            rows += first.len();
            let runs = repeated.chunk_by(|a, b| a == b).filter(|run| run[0]);
            max_run = runs.map(|run| run.len() + 1).fold(max_run, usize::max);
        }
    }
    let recordings = held.iter().filter(|held| **held).count();
    (recordings > 0).then(|| RecordingFault::RepeatedRows {
        share: equal as f64 / rows as f64,
        max_run,
        recordings,
        recording_count: held.len(),
        files: recording_set.files(|index| held[index]),
    })
}

/// The median of the changes that there are; 0 if there are none.
fn median_change(values: &[f64]) -> f64 {
    let changes = values.windows(2).map(|pair| (pair[1] - pair[0]).abs()).filter(|change| *change > 0.0);
    crate::model::median(changes.collect()).unwrap_or(0.0)
}
