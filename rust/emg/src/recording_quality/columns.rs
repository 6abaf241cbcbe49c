//! Columns that are no electrode: clocks, counters, labels, orientations, accelerations.

use super::{RecordingFault, RecordingSet};
use crate::welch;
use proact_types::Gesture;
use std::collections::BTreeMap;

/// One column of all recordings, with the figures that tell a muscle from another signal.
pub(super) struct ColumnStatistics {
    /// `[recording][sample]`.
    pub(super) values: Vec<Vec<f64>>,
    /// Smallest difference between two values, the converter's step; 0 for a constant column.
    pub(super) step: f64,
    /// Distinct values.
    pub(super) levels: usize,
    /// Smallest and largest value.
    pub(super) value_range: [f64; 2],
    /// Variance of all samples about that mean.
    pub(super) variance: f64,
    /// Standard deviation in each recording.
    pub(super) sds: Vec<f64>,
    /// Share of the variance below about 10 Hz, between recordings included.
    slow_share: f64,
    /// Share of the variance within recordings below [`LIMB_HZ`].
    limb_share: f64,
    /// Mean of each recording.
    means: Vec<f64>,
    rises: Vec<f64>,
    falls: Vec<f64>,
}

/// A block of this length keeps what is slower than about 10 Hz. Muscle lies above: on 29 people no channel has more than 0.22 of
/// its variance there.
const SLOW_BLOCK_SECS: f64 = 0.1;
/// Share of slow variance above which a column is no unfiltered electrode.
const SLOW_SHARE: f64 = 0.6;
/// A limb that is shaken moves at up to about 10 Hz, which a gyroscope and an accelerometer show.
const LIMB_HZ: f64 = 15.0;
/// Share of the variance below [`LIMB_HZ`] above which a column is the motion of a limb. `docs/emg.md` has the largest of muscles.
const LIMB_SHARE: f64 = 0.5;
/// Beside fast channels, which have no more than this below [`LIMB_HZ`], slow ones are of another sensor however many they are.
const MAX_FAST_CHANNEL_LIMB_SHARE: f64 = 0.25;
/// The same beside columns of a fixed length, which is evidence by itself.
const MIN_FIXED_LENGTH_LIMB_SHARE: f64 = 0.3;
/// Share of changes in one direction that no muscle has: on 29 people it lies between 0.40 and 0.61.
const MIN_MONOTONIC_SHARE: f64 = 0.9;
/// The same where all changes in a direction are equal, as those of a counter with few values.
const MIN_MONOTONIC_SHARE_EQUAL_STEPS: f64 = 0.65;
/// Changes that are needed to tell.
const MIN_CHANGES: usize = 20;
/// Columns of fixed length: how many, and the largest deviation of the length over its mean. Four electrodes reach 0.58 at least.
const ORIENTATION: (usize, f64) = (4, 0.05);
const ACCELERATION: (usize, f64) = (3, 0.15);
/// Some of the columns keep the length as well as all do if their relative deviation is no more than this many times as large: the
/// others have no part in it.
const SUBSET_DEVIATION_RATIO: f64 = 1.01;
/// Deviation of the length over that of the columns: one for independent columns is `1 / sqrt(columns)`.
const FIXED_LENGTH: [f64; 2] = [0.05, 0.3];
/// An electrode is more than this much louder in its loudest recording than in its quietest.
const MIN_LOUDNESS_RATIO: f64 = 1.5;
/// A label among few: it changes at no more than this share of the samples.
const MAX_LABEL_CHANGE_SHARE: f64 = 0.02;
/// The level of a column tells the gesture: standard deviation of the levels of the gestures over that of the samples, and over that of
/// the levels within a gesture. `docs/emg.md` has the largest of electrodes.
const LEVEL_SEPARATION_LIMITS: [f64; 2] = [0.6, 8.0];
/// Recordings that are needed to tell whether a column is louder in some of them.
const MIN_RECORDINGS: usize = 4;

/// All columns of a session.
pub(super) fn columns(recording_set: &RecordingSet<'_>) -> Vec<ColumnStatistics> {
    let block = ((SLOW_BLOCK_SECS * recording_set.rate_hz).round() as usize).max(1);
    (0..recording_set.channels).map(|channel| ColumnStatistics::new(recording_set, channel, block)).collect()
}

impl ColumnStatistics {
    fn new(recording_set: &RecordingSet<'_>, channel: usize, block: usize) -> ColumnStatistics {
        let of = |sample: &proact_types::EmgSample| sample.channels.get(channel).copied();
        let values: Vec<Vec<f64>> =
            recording_set.repetitions.iter().map(|r| r.samples.iter().filter_map(of).collect()).collect();
        let mut sorted: Vec<f64> = values.iter().flatten().copied().collect();
        sorted.sort_unstable_by(f64::total_cmp);
        sorted.dedup();
        let step = sorted.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
        let (mean, variance) = moments(values.iter().flatten().copied(), None);
        let each: Vec<(f64, f64)> = values.iter().map(|part| moments(part.iter().copied(), None)).collect();
        let sds = each.iter().map(|(_, variance)| variance.sqrt()).collect();
        let blocks = values.iter().flat_map(|part| part.chunks_exact(block));
        let slow = moments(blocks.map(|block| block.iter().sum::<f64>() / block.len() as f64), Some(mean)).1;
        let changes = || values.iter().flat_map(|part| part.windows(2).map(|pair| pair[1] - pair[0]));
        ColumnStatistics {
            step: if step.is_finite() { step } else { 0.0 },
            levels: sorted.len(),
            value_range: [sorted.first().copied().unwrap_or(0.0), sorted.last().copied().unwrap_or(0.0)],
            variance,
            slow_share: if variance > 0.0 { slow / variance } else { 0.0 },
            rises: changes().filter(|change| *change > 0.0).collect(),
            falls: changes().filter(|change| *change < 0.0).map(f64::abs).collect(),
            limb_share: limb_share(&values, recording_set.rate_hz),
            means: each.iter().map(|(mean, _)| *mean).collect(),
            sds,
            values,
        }
    }

    /// The largest standard deviation over the recordings.
    pub(super) fn loudest(&self) -> f64 {
        self.sds.iter().copied().fold(0.0, f64::max)
    }

    /// Whether no recording is much louder than another.
    fn is_unmodulated(&self) -> bool {
        let quietest = self.sds.iter().copied().fold(f64::INFINITY, f64::min);
        self.sds.len() >= MIN_RECORDINGS && self.loudest() < MIN_LOUDNESS_RATIO * quietest
    }

    /// Mostly one value in each recording, and not in all the same.
    fn is_label(&self) -> bool {
        let samples: usize = self.values.iter().map(Vec::len).sum();
        let changes = self.rises.len() + self.falls.len();
        let mut usual: Vec<f64> =
            self.values.iter().filter_map(|part| crate::model::median(part.clone())).collect();
        usual.sort_unstable_by(f64::total_cmp);
        usual.dedup();
        usual.len() > 1 && changes as f64 <= MAX_LABEL_CHANGE_SHARE * samples as f64
    }

    /// How far apart the levels of the gestures are, in standard deviations of a recording, if the level tells the gesture.
    fn gesture_level_separation(&self, gestures: &[Gesture]) -> Option<f64> {
        let mut levels: BTreeMap<Gesture, Vec<f64>> = BTreeMap::new();
        for (gesture, mean) in gestures.iter().zip(&self.means) {
            levels.entry(*gesture).or_default().push(*mean);
        }
        levels.retain(|_, means| means.len() > 1);
        let each = levels.values().map(|means| moments(means.iter().copied(), None));
        let count = levels.len().max(2) as f64;
        let between = (moments(each.clone().map(|(mean, _)| mean), None).1 * count / (count - 1.0)).sqrt();
        let within = (each.map(|(_, variance)| variance).sum::<f64>() / count).sqrt();
        let deviation = crate::model::median(self.sds.clone())?;
        let separates_gestures =
            between > LEVEL_SEPARATION_LIMITS[0] * deviation && between > LEVEL_SEPARATION_LIMITS[1] * within;
        separates_gestures.then_some(between / deviation)
    }

    /// Whether it runs in one direction: without a way back, or with steps back as a counter has.
    fn monotonicity(&self) -> Option<Monotonicity> {
        let (up, down) = (self.rises.len(), self.falls.len());
        let share = up.max(down) as f64 / (up + down).max(1) as f64;
        let equal = || is_equal(&self.rises) && is_equal(&self.falls);
        if up + down < MIN_CHANGES
            || !(share > MIN_MONOTONIC_SHARE || share > MIN_MONOTONIC_SHARE_EQUAL_STEPS && equal())
        {
            return None;
        }
        Some(if up.min(down) > 0 {
            Monotonicity::Counts
        } else if down == 0 {
            Monotonicity::Rises
        } else {
            Monotonicity::Falls
        })
    }
}

/// Share of the variance within recordings below [`LIMB_HZ`]; 0 where nothing can be told.
fn limb_share(recordings: &[Vec<f64>], rate_hz: f64) -> f64 {
    let (mut below, mut all) = (0.0, 0.0);
    for spectrum in recordings.iter().filter_map(|values| welch(values, rate_hz)) {
        let limb = (LIMB_HZ / spectrum.bin_width_hz) as usize + 1;
        below += spectrum.density.iter().take(limb).sum::<f64>();
        all += spectrum.density.iter().sum::<f64>();
    }
    if all > 0.0 { below / all } else { 0.0 }
}

/// How a clock runs.
enum Monotonicity {
    Rises,
    Falls,
    Counts,
}

/// Whether nearly all are the median.
fn is_equal(changes: &[f64]) -> bool {
    let Some(median) = crate::model::median(changes.to_vec()) else { return true };
    let same = changes.iter().filter(|change| (*change - median).abs() <= 1e-6 * median).count();
    same as f64 >= MIN_MONOTONIC_SHARE * changes.len() as f64
}

/// Mean and variance, the latter about `center` if one is given.
pub(super) fn moments(values: impl Iterator<Item = f64> + Clone, center: Option<f64>) -> (f64, f64) {
    let count = values.clone().count().max(1) as f64;
    // About the first value: a clock has digits to lose.
    let origin = values.clone().next().unwrap_or(0.0);
    let mean = origin + values.clone().map(|v| v - origin).sum::<f64>() / count;
    let center = center.unwrap_or(mean);
    (mean, values.map(|v| (v - center).powi(2)).sum::<f64>() / count)
}

/// Columns that are clocks, counters and labels: which, and what is said of them.
pub(super) fn clocks_and_labels(
    recording_set: &RecordingSet<'_>,
    columns: &[ColumnStatistics],
) -> (Vec<bool>, Vec<RecordingFault>) {
    let mut found = vec![false; columns.len()];
    let mut faults = Vec::new();
    let files = || recording_set.files(|_| true);
    for (channel, column) in columns.iter().enumerate() {
        let fault = match column.monotonicity() {
            Some(Monotonicity::Rises) => RecordingFault::TimeStamps { channel, files: files() },
            Some(Monotonicity::Falls | Monotonicity::Counts) => {
                RecordingFault::Counter { channel, files: files() }
            }
            None if column.is_label() => RecordingFault::Label { channel, files: files() },
            None => continue,
        };
        found[channel] = true;
        faults.push(fault);
    }
    (found, faults)
}

/// Columns of other sensors, and those whose level tells the gesture; `found` gains them. A channel that is `held` is slower than it was.
pub(super) fn other_sensors(
    recording_set: &RecordingSet<'_>,
    columns: &[ColumnStatistics],
    found: &mut [bool],
    held: &[bool],
) -> Vec<RecordingFault> {
    let mut faults = Vec::new();
    let files = || recording_set.files(|_| true);
    for (count, spread) in [ORIENTATION, ACCELERATION] {
        while let Some((first, length)) = fixed_length(columns, found, count, spread) {
            let channels: Vec<usize> = (first..first + count).collect();
            found[first..first + count].fill(true);
            faults.push(if count == ORIENTATION.0 {
                RecordingFault::Orientation { channels, length, files: files() }
            } else {
                RecordingFault::Acceleration { channels, length, files: files() }
            });
        }
    }
    let rest: Vec<usize> = (0..columns.len()).filter(|c| !found[*c] && !columns[*c].is_still()).collect();
    let is_slow =
        |c: usize| columns[c].slow_share > SLOW_SHARE || columns[c].limb_share > LIMB_SHARE && !held[c];
    let (slow, fast): (Vec<usize>, Vec<usize>) = rest.iter().partition(|c| is_slow(**c));
    let separates = fast.len() > 1
        && fast
            .iter()
            .all(|c| columns[*c].limb_share.max(columns[*c].slow_share) < MAX_FAST_CHANNEL_LIMB_SHARE);
    let is_majority = 2 * slow.len() >= rest.len() && !separates;
    for channel in slow {
        // Of electrodes without a high pass, and of envelopes, all are slow: they can still be recognised.
        found[channel] = !is_majority;
        let share = columns[channel].slow_share.max(columns[channel].limb_share);
        faults.push(RecordingFault::Slow { channel, share, is_majority_slow: is_majority, files: files() });
    }
    // The level of an envelope tells the gesture, as it should.
    let gestures: Vec<Gesture> = recording_set.repetitions.iter().map(|r| r.gesture).collect();
    for channel in fast {
        if let Some(times) = columns[channel].gesture_level_separation(&gestures) {
            found[channel] = true;
            faults.push(RecordingFault::LabelWithin { channel, ratio: times, files: files() });
        }
    }
    faults
}

impl ColumnStatistics {
    /// Whether it holds a value, but for the last digit.
    pub(super) fn is_still(&self) -> bool {
        self.levels <= 3 || self.loudest() < self.step
    }
}

/// The first of `count` neighbouring columns that together keep their length, and the length: of those that keep it best.
fn fixed_length(
    columns: &[ColumnStatistics],
    found: &[bool],
    count: usize,
    spread: f64,
) -> Option<(usize, f64)> {
    let candidate = |first: usize| {
        let group = columns.get(first..first + count)?;
        if found[first..first + count].contains(&true) || group.iter().filter(|c| !c.is_still()).count() < 2 {
            return None;
        }
        let (length, deviation) = length_and_deviation(group, None);
        let columns_deviation = group.iter().map(|c| c.variance).sum::<f64>().sqrt();
        let share = deviation / columns_deviation;
        let fixed = share < FIXED_LENGTH[0]
            || share < FIXED_LENGTH[1] && group.iter().any(|c| c.slow_share > MIN_FIXED_LENGTH_LIMB_SHARE)
            || group.iter().all(|c| c.is_still() || c.is_unmodulated());
        if !fixed || deviation >= spread * length {
            return None;
        }
        // An offset or a clock beside electrodes; an electrode beside an acceleration.
        let as_well =
            |(part, of_part): (f64, f64)| of_part * length <= SUBSET_DEVIATION_RATIO * deviation * part;
        let one = || group.chunks(1).any(|one| as_well(length_and_deviation(one, None)));
        let three = || (0..count).any(|left_out| as_well(length_and_deviation(group, Some(left_out))));
        let in_part = one() || count == ORIENTATION.0 && three();
        (!in_part).then_some((first, length, deviation / length))
    };
    let all = (0..columns.len()).filter_map(candidate);
    all.min_by(|a, b| a.2.total_cmp(&b.2)).map(|(first, length, _)| (first, length))
}

/// Mean and standard deviation of the length of columns, without the one that is left out.
fn length_and_deviation(group: &[ColumnStatistics], left_out: Option<usize>) -> (f64, f64) {
    let square = |part: usize, k: usize| {
        let kept = group.iter().enumerate().filter(|(index, _)| Some(*index) != left_out);
        kept.map(|(_, c)| c.values[part].get(k).map_or(0.0, |v| v * v)).sum::<f64>()
    };
    let rows =
        (0..group[0].values.len()).flat_map(|part| (0..group[0].values[part].len()).map(move |k| (part, k)));
    let (length, variance) = moments(rows.map(|(part, k)| square(part, k).sqrt()), None);
    (length, variance.sqrt())
}
