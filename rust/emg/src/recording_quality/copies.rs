//! Recordings that hold the same samples: a copy, whole or in part, shifted in time, with another gain or offset.

use super::{RecordingFault, RecordingSet, columns::ColumnStatistics};
use std::collections::BTreeMap;

/// Samples of a stretch that is compared bit by bit.
const STRETCH: usize = 20;
/// Changes of one channel whose directions are compared to find a copy of another gain.
const SIGNS: usize = 32;
/// Channels that are asked for directions: those that change most.
const MAX_SIGN_CHANNELS: usize = 3;
/// Places that a pattern may have: one that comes more often is a tone, and tells nothing.
const MAX_PATTERN_OCCURRENCES: usize = 4;
/// Equal patterns that two recordings need at one shift.
const MIN_VOTES: usize = 4;
/// Shifts that have at least a third of the patterns of the best one: a tone fits itself at each of its periods, a copy at few.
const MAX_SHIFTS: usize = 4;
/// Share of the power of the changes of a stretch that a copy explains. Independent electrodes explain a few hundredths.
const MIN_EXPLAINED_POWER: f64 = 0.98;
/// The same for most of the channels, each by itself: those that hardly move are rounded.
const MIN_CHANNEL_EXPLAINED_POWER: f64 = 0.8;
/// Bits that a stretch needs to be no chance.
const MIN_INFORMATION_BITS: f64 = 48.0;
/// Length of a stretch that is compared with another gain, and that all of them need: neighbouring samples of a fast stream are
/// nearly equal, so that few of them say nothing.
const STRETCH_SECS: f64 = 0.1;
const MIN_COPY_SECS: f64 = 0.25;

/// Two recordings and how far the later one is behind: sample k of the later is sample `k + shift` of the earlier.
type Pair = (usize, usize, i64);

/// The recordings that share samples in the channels `electrodes`.
pub(super) fn copies(
    recording_set: &RecordingSet<'_>,
    columns: &[ColumnStatistics],
    electrodes: &[usize],
) -> Vec<RecordingFault> {
    let recordings: Vec<Vec<&[f64]>> = (0..recording_set.repetitions.len())
        .map(|part| electrodes.iter().map(|c| &columns[*c].values[part][..]).collect())
        .collect();
    let steps: Vec<f64> = electrodes.iter().map(|channel| columns[*channel].step).collect();
    let mut shared: BTreeMap<(usize, usize), Vec<bool>> = BTreeMap::new();
    let mut mark = |(earlier, later, shift): Pair,
                    stretch: usize,
                    min_length: usize,
                    same: &dyn Fn(usize, usize) -> bool| {
        let len = |index: usize| recordings[index].first().map_or(0, |values: &&[f64]| values.len());
        let mut own = vec![false; len(later)];
        let mut start = 0;
        while start + stretch <= own.len() {
            let there = usize::try_from(start as i64 + shift).ok();
            let there = there.filter(|there| there + stretch <= len(earlier));
            if there.is_some_and(|there| same(there, start)) {
                own[start..start + stretch].fill(true);
                start += stretch;
            } else {
                start += stretch / STRETCH;
            }
        }
        if own.iter().filter(|own| **own).count() >= min_length {
            let known = shared.entry((earlier, later)).or_insert_with(|| vec![false; own.len()]);
            known.iter_mut().zip(&own).for_each(|(known, own)| *known |= own);
        }
    };
    for pair in exact_copies(&recordings, &steps) {
        mark(pair, STRETCH, STRETCH, &|there, start| {
            let mut channels = recordings[pair.0].iter().zip(&recordings[pair.1]);
            channels.all(|(a, b)| a[there..there + STRETCH] == b[start..start + STRETCH])
                && bits(&recordings[pair.1], &steps, start) >= MIN_INFORMATION_BITS
        });
    }
    let samples = |secs: f64| ((secs * recording_set.rate_hz).round() as usize).max(STRETCH);
    for pair in scaled_copies(&recordings, &steps) {
        let stretch = samples(STRETCH_SECS);
        mark(pair, stretch, samples(MIN_COPY_SECS), &|there, start| {
            let part = |index: usize, from: usize| -> Vec<&[f64]> {
                recordings[index].iter().map(|values| &values[from..from + stretch]).collect()
            };
            explained_power(&part(pair.0, there), &part(pair.1, start)) >= MIN_EXPLAINED_POWER
        });
    }
    let name = |index: usize| {
        let repetition = &recording_set.repetitions[index];
        ((repetition.gesture, repetition.repetition), repetition.file.to_owned())
    };
    let fault = |((earlier, later), own): ((usize, usize), Vec<bool>)| {
        let (first, file) = name(earlier);
        let (second, copy) = name(later);
        let samples = own.iter().filter(|own| **own).count();
        RecordingFault::CopiedRecording {
            first,
            second,
            samples,
            later_samples: own.len(),
            files: vec![file, copy],
        }
    };
    shared.into_iter().map(fault).collect()
}

/// Pairs that have a stretch in common bit by bit.
fn exact_copies(recordings: &[Vec<&[f64]>], steps: &[f64]) -> Vec<Pair> {
    // Of all bits of a stretch; stretches of equal keys are compared before anything is said.
    let key = |channels: &[&[f64]], start: usize| -> u64 {
        let values = channels.iter().flat_map(|values| &values[start..start + STRETCH]);
        values.fold(0xcbf2_9ce4_8422_2325, |key, value| {
            (key ^ value.to_bits()).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29)
        })
    };
    let mut known: BTreeMap<u64, (usize, usize)> = BTreeMap::new();
    let mut pairs: BTreeMap<Pair, u32> = BTreeMap::new();
    for (index, channels) in recordings.iter().enumerate() {
        let len = channels.first().map_or(0, |values| values.len());
        let mut start = 0;
        while start + STRETCH <= len {
            match known.get(&key(channels, start)) {
                Some((earlier, there)) => {
                    *pairs.entry((*earlier, index, *there as i64 - start as i64)).or_default() += 1;
                    start += STRETCH;
                }
                None => start += 1,
            }
        }
        for start in (0..(len + 1).saturating_sub(STRETCH)).step_by(STRETCH) {
            if bits(channels, steps, start) >= MIN_INFORMATION_BITS {
                known.entry(key(channels, start)).or_insert((index, start));
            }
        }
    }
    pairs.into_keys().collect()
}

/// Pairs whose channels go up and down together at one shift, as those of a copy do whatever its gain and offset.
fn scaled_copies(recordings: &[Vec<&[f64]>], steps: &[f64]) -> Vec<Pair> {
    let mut known: BTreeMap<(usize, u32), Vec<(usize, usize)>> = BTreeMap::new();
    let mut votes: Vec<Pair> = Vec::new();
    for (index, channels) in recordings.iter().enumerate() {
        let patterns: Vec<(usize, Vec<Option<u32>>)> = most_active_channels(channels, steps)
            .into_iter()
            .map(|channel| (channel, directions(channels[channel])))
            .collect();
        for (channel, patterns) in &patterns {
            for (start, pattern) in patterns.iter().enumerate() {
                let starts = pattern.and_then(|pattern| known.get(&(*channel, pattern)));
                let starts =
                    starts.filter(|starts| starts.len() <= MAX_PATTERN_OCCURRENCES).into_iter().flatten();
                votes.extend(starts.map(|(earlier, there)| (*earlier, index, *there as i64 - start as i64)));
            }
        }
        for (channel, patterns) in patterns {
            for (start, pattern) in patterns.into_iter().enumerate().step_by(STRETCH / 4) {
                let starts = pattern.map(|pattern| known.entry((channel, pattern)).or_default());
                if let Some(starts) = starts.filter(|starts| starts.len() <= MAX_PATTERN_OCCURRENCES) {
                    starts.push((index, start));
                }
            }
        }
    }
    let mut shifts: BTreeMap<(usize, usize), Vec<(usize, i64)>> = BTreeMap::new();
    votes.sort_unstable();
    for same in votes.chunk_by(|a, b| a == b).filter(|same| same.len() >= MIN_VOTES) {
        let (earlier, later, shift) = same[0];
        shifts.entry((earlier, later)).or_default().push((same.len(), shift));
    }
    let mut pairs = Vec::new();
    for ((earlier, later), mut shifts) in shifts {
        let max_count = shifts.iter().map(|(count, _)| *count).max().unwrap_or(0);
        shifts.retain(|(count, _)| 3 * count >= max_count);
        if shifts.len() <= MAX_SHIFTS {
            pairs.extend(shifts.into_iter().map(|(_, shift)| (earlier, later, shift)));
        }
    }
    pairs
}

/// The channels of a recording that change most, in steps of their converters.
fn most_active_channels(channels: &[&[f64]], steps: &[f64]) -> Vec<usize> {
    let change = |channel: usize| {
        let values = channels[channel];
        let sum: f64 = values.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum();
        if steps[channel] > 0.0 { sum / steps[channel] } else { 0.0 }
    };
    let mut order: Vec<(f64, usize)> = (0..channels.len()).map(|c| (change(c), c)).collect();
    order.sort_by(|a, b| b.0.total_cmp(&a.0));
    order.into_iter().take(MAX_SIGN_CHANNELS).map(|(_, channel)| channel).collect()
}

/// At each sample the directions of the next [`SIGNS`] changes, the first of them up; none where one is no change.
fn directions(values: &[f64]) -> Vec<Option<u32>> {
    let changes: Vec<f64> = values.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let pattern = |changes: &[f64]| {
        let up = changes.iter().fold(0_u32, |bits, change| bits << 1 | u32::from(*change > 0.0));
        // A copy may have the other polarity.
        (!changes.contains(&0.0)).then_some(if up >> (SIGNS - 1) == 1 { up } else { !up })
    };
    changes.windows(SIGNS).map(pattern).collect()
}

/// How much a stretch tells, bits: changes in steps of the converter.
fn bits(channels: &[&[f64]], steps: &[f64], start: usize) -> f64 {
    let of = |(values, step): (&&[f64], &f64)| {
        let changes = values[start..start + STRETCH].windows(2).map(|pair| (pair[1] - pair[0]).abs());
        if *step > 0.0 { changes.map(|change| (1.0 + change / step).log2()).sum::<f64>() } else { 0.0 }
    };
    channels.iter().zip(steps).map(of).sum()
}

/// Share of the changes of `later` that those of `earlier` explain, each channel with a gain of its own.
fn explained_power(earlier: &[&[f64]], later: &[&[f64]]) -> f64 {
    let (mut sum, mut weight) = (0.0, 0.0);
    let (mut moving, mut alike) = (0, 0);
    for (a, b) in earlier.iter().zip(later) {
        let (mut aa, mut bb, mut ab) = (0.0, 0.0, 0.0);
        // Of the changes: a level that drifts alike in both is no copy.
        for (a, b) in a.windows(2).zip(b.windows(2)) {
            let (x, y) = (a[1] - a[0], b[1] - b[0]);
            (aa, bb, ab) = (aa + x * x, bb + y * y, ab + x * y);
        }
        if aa > 0.0 && bb > 0.0 {
            let share = ab * ab / (aa * bb);
            sum += bb * share;
            moving += 1;
            alike += usize::from(share > MIN_CHANNEL_EXPLAINED_POWER);
        }
        weight += bb;
    }
    // A hum on one channel is no copy of the others.
    if weight > 0.0 && 2 * alike > moving { sum / weight } else { 0.0 }
}
