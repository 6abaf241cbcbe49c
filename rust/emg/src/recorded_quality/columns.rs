//! Columns that are no electrode: clocks, counters, labels, orientations, accelerations.

use super::{RecordedFault, RecordedSession};

/// One column of all recordings, with the figures that tell a muscle from another signal.
pub(super) struct Column {
    /// `[recording][sample]`.
    pub(super) values: Vec<Vec<f64>>,
    /// Smallest difference between two values, the converter's step; 0 for a constant column.
    pub(super) step: f64,
    /// Distinct values.
    pub(super) levels: usize,
    /// Smallest and largest value.
    pub(super) ends: [f64; 2],
    /// Variance of all samples about that mean.
    pub(super) variance: f64,
    /// Standard deviation in each recording.
    pub(super) sds: Vec<f64>,
    /// Share of the variance below about 10 Hz, between recordings included.
    slow_share: f64,
    rises: Vec<f64>,
    falls: Vec<f64>,
}

/// A block of this length keeps what is slower than about 10 Hz. Muscle lies above: on 29 people no channel has more than 0.22 of
/// its variance there.
const SLOW_BLOCK_SECS: f64 = 0.1;
/// Share of slow variance above which a column is no unfiltered electrode.
const SLOW_SHARE: f64 = 0.6;
/// The same beside columns of a fixed length, which is evidence by itself.
const RATHER_SLOW: f64 = 0.3;
/// Share of changes in one direction that no muscle has: on 29 people it lies between 0.40 and 0.61.
const ONE_WAY: f64 = 0.9;
/// The same where all changes in a direction are equal, as those of a counter with few values.
const ONE_WAY_EQUAL: f64 = 0.65;
/// Changes that are needed to tell.
const FEWEST_CHANGES: usize = 20;
/// Columns of fixed length: how many, and the largest deviation of the length over its mean. Four electrodes reach 0.58 at least.
const ORIENTATION: (usize, f64) = (4, 0.05);
const ACCELERATION: (usize, f64) = (3, 0.15);
/// Some of the columns keep the length as well as all do if their relative deviation is no more than this many times as large: the
/// others have no part in it.
const AS_WELL: f64 = 1.01;
/// Deviation of the length over that of the columns: one for independent columns is `1 / sqrt(columns)`.
const FIXED_LENGTH: [f64; 2] = [0.05, 0.3];
/// An electrode is more than this much louder in its loudest recording than in its quietest.
const MODULATED: f64 = 1.5;
/// Recordings that are needed to tell whether a column is louder in some of them.
const FEWEST_RECORDINGS: usize = 4;

/// All columns of a session.
pub(super) fn columns(session: &RecordedSession<'_>) -> Vec<Column> {
    let block = ((SLOW_BLOCK_SECS * session.rate_hz).round() as usize).max(1);
    (0..session.channels).map(|channel| Column::new(session, channel, block)).collect()
}

impl Column {
    fn new(session: &RecordedSession<'_>, channel: usize, block: usize) -> Column {
        let of = |sample: &proact_types::EmgSample| sample.channels.get(channel).copied();
        let values: Vec<Vec<f64>> =
            session.repetitions.iter().map(|r| r.samples.iter().filter_map(of).collect()).collect();
        let mut sorted: Vec<f64> = values.iter().flatten().copied().collect();
        sorted.sort_unstable_by(f64::total_cmp);
        sorted.dedup();
        let step = sorted.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
        let (mean, variance) = moments(values.iter().flatten().copied(), None);
        let sds = values.iter().map(|part| moments(part.iter().copied(), None).1.sqrt()).collect();
        let blocks = values.iter().flat_map(|part| part.chunks_exact(block));
        let slow = moments(blocks.map(|block| block.iter().sum::<f64>() / block.len() as f64), Some(mean)).1;
        let changes = || values.iter().flat_map(|part| part.windows(2).map(|pair| pair[1] - pair[0]));
        Column {
            step: if step.is_finite() { step } else { 0.0 },
            levels: sorted.len(),
            ends: [sorted.first().copied().unwrap_or(0.0), sorted.last().copied().unwrap_or(0.0)],
            variance,
            slow_share: if variance > 0.0 { slow / variance } else { 0.0 },
            rises: changes().filter(|change| *change > 0.0).collect(),
            falls: changes().filter(|change| *change < 0.0).map(f64::abs).collect(),
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
        self.sds.len() >= FEWEST_RECORDINGS && self.loudest() < MODULATED * quietest
    }

    /// One value in each recording, and not in all the same.
    fn is_label(&self) -> bool {
        self.levels > 1 && self.rises.is_empty() && self.falls.is_empty()
    }

    /// Whether it runs in one direction: without a way back, or with steps back as a counter has.
    fn clock(&self) -> Option<Clock> {
        let (up, down) = (self.rises.len(), self.falls.len());
        let share = up.max(down) as f64 / (up + down).max(1) as f64;
        let equal = || is_equal(&self.rises) && is_equal(&self.falls);
        if up + down < FEWEST_CHANGES || !(share > ONE_WAY || share > ONE_WAY_EQUAL && equal()) {
            return None;
        }
        Some(if up.min(down) > 0 {
            Clock::Counts
        } else if down == 0 {
            Clock::Rises
        } else {
            Clock::Falls
        })
    }
}

/// How a clock runs.
enum Clock {
    Rises,
    Falls,
    Counts,
}

/// Whether nearly all are the median.
fn is_equal(changes: &[f64]) -> bool {
    let Some(median) = crate::model::median(changes.to_vec()) else { return true };
    let same = changes.iter().filter(|change| (*change - median).abs() <= 1e-6 * median).count();
    same as f64 >= ONE_WAY * changes.len() as f64
}

/// Mean and variance, the latter about `centre` if one is given.
pub(super) fn moments(values: impl Iterator<Item = f64> + Clone, centre: Option<f64>) -> (f64, f64) {
    let count = values.clone().count().max(1) as f64;
    // About the first value: a clock has digits to lose.
    let origin = values.clone().next().unwrap_or(0.0);
    let mean = origin + values.clone().map(|v| v - origin).sum::<f64>() / count;
    let centre = centre.unwrap_or(mean);
    (mean, values.map(|v| (v - centre).powi(2)).sum::<f64>() / count)
}

/// What a column is, if it is no electrode.
pub(super) fn no_electrodes(
    session: &RecordedSession<'_>,
    columns: &[Column],
) -> (Vec<bool>, Vec<RecordedFault>) {
    let mut found = vec![false; columns.len()];
    let mut faults = Vec::new();
    let files = || session.files(|_| true);
    for (channel, column) in columns.iter().enumerate() {
        let fault = match column.clock() {
            Some(Clock::Rises) => RecordedFault::TimeStamps { channel, files: files() },
            Some(Clock::Falls | Clock::Counts) => RecordedFault::Counter { channel, files: files() },
            None if column.is_label() => RecordedFault::Label { channel, files: files() },
            None => continue,
        };
        found[channel] = true;
        faults.push(fault);
    }
    for (count, spread) in [ORIENTATION, ACCELERATION] {
        while let Some((first, length)) = fixed_length(columns, &found, count, spread) {
            let channels: Vec<usize> = (first..first + count).collect();
            found[first..first + count].fill(true);
            faults.push(if count == ORIENTATION.0 {
                RecordedFault::Orientation { channels, length, files: files() }
            } else {
                RecordedFault::Acceleration { channels, length, files: files() }
            });
        }
    }
    let rest: Vec<usize> = (0..columns.len()).filter(|c| !found[*c] && !columns[*c].is_still()).collect();
    let slow: Vec<usize> = rest.iter().copied().filter(|c| columns[*c].slow_share > SLOW_SHARE).collect();
    let most = 2 * slow.len() >= rest.len();
    for channel in slow {
        // Of electrodes without a high pass, and of envelopes, all are slow: they can still be recognised.
        found[channel] = !most;
        let share = columns[channel].slow_share;
        faults.push(RecordedFault::Slow { channel, share, most, files: files() });
    }
    (found, faults)
}

impl Column {
    /// Whether it holds a value, but for the last digit.
    pub(super) fn is_still(&self) -> bool {
        self.levels <= 3 || self.loudest() < self.step
    }
}

/// The first of `count` neighbouring columns that together keep their length, and the length: of those that keep it best.
fn fixed_length(columns: &[Column], found: &[bool], count: usize, spread: f64) -> Option<(usize, f64)> {
    let candidate = |first: usize| {
        let group = columns.get(first..first + count)?;
        if found[first..first + count].contains(&true) || group.iter().filter(|c| !c.is_still()).count() < 2 {
            return None;
        }
        let (length, deviation) = length_and_deviation(group, None);
        let columns_deviation = group.iter().map(|c| c.variance).sum::<f64>().sqrt();
        let share = deviation / columns_deviation;
        let fixed = share < FIXED_LENGTH[0]
            || share < FIXED_LENGTH[1] && group.iter().any(|c| c.slow_share > RATHER_SLOW)
            || group.iter().all(|c| c.is_still() || c.is_unmodulated());
        if !fixed || deviation >= spread * length {
            return None;
        }
        // An offset or a clock beside electrodes; an electrode beside an acceleration.
        let as_well = |(part, of_part): (f64, f64)| of_part * length <= AS_WELL * deviation * part;
        let one = || group.chunks(1).any(|one| as_well(length_and_deviation(one, None)));
        let three = || (0..count).any(|left_out| as_well(length_and_deviation(group, Some(left_out))));
        let in_part = one() || count == ORIENTATION.0 && three();
        (!in_part).then_some((first, length, deviation / length))
    };
    let all = (0..columns.len()).filter_map(candidate);
    all.min_by(|a, b| a.2.total_cmp(&b.2)).map(|(first, length, _)| (first, length))
}

/// Mean and standard deviation of the length of columns, without the one that is left out.
fn length_and_deviation(group: &[Column], left_out: Option<usize>) -> (f64, f64) {
    let square = |part: usize, k: usize| {
        let kept = group.iter().enumerate().filter(|(index, _)| Some(*index) != left_out);
        kept.map(|(_, c)| c.values[part].get(k).map_or(0.0, |v| v * v)).sum::<f64>()
    };
    let rows =
        (0..group[0].values.len()).flat_map(|part| (0..group[0].values[part].len()).map(move |k| (part, k)));
    let (length, variance) = moments(rows.map(|(part, k)| square(part, k).sqrt()), None);
    (length, variance.sqrt())
}
