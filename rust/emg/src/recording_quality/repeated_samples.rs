//! Channels that a slower reader held, but for the last digit, or whose values lie on straight lines between fewer samples.

use super::{RecordingFault, RecordingSet, columns::ColumnStatistics};

/// Seconds of a stretch that is judged by itself: a muscle is quiet and loud in one recording.
const STRETCH_SECS: f64 = 0.25;
const MIN_SEGMENT_SAMPLES: usize = 25;
/// Differences up to this are still: steps of the converter (two values that are each one step off differ by two), and shares of the
/// mean difference.
const STILL_STEPS: f64 = 2.5;
const STILL_SHARE: f64 = 0.05;
/// Steps by which a second difference is off where each of its values is off by one.
const STILL_STEPS_TWICE: f64 = 4.5;
/// A stretch is judged if a tenth of its differences are at least so many times as large as a still one.
const MIN_ACTIVITY_RATIO: f64 = 4.0;
/// Share of still differences, above that which a muscle has by chance, from which on a channel is held: a reader that is a quarter too fast
/// holds 0.2. `docs/emg.md` has the largest of all recordings that were compared.
const MIN_REPEATED_SHARE: f64 = 0.15;
/// The same of second differences: half of them are still if every other sample is interpolated.
const MIN_INTERPOLATED_SHARE: f64 = 0.3;

/// Channels that are held, and channels that are interpolated, each with the share of its samples.
#[derive(Debug, Default)]
pub(super) struct RepeatedSampleChannels {
    repeated: Vec<(usize, f64)>,
    interpolated: Vec<(usize, f64)>,
}

/// Those of `electrodes`.
pub(super) fn find_repeated_samples(
    recording_set: &RecordingSet<'_>,
    columns: &[ColumnStatistics],
    electrodes: &[usize],
) -> RepeatedSampleChannels {
    let stretch = ((STRETCH_SECS * recording_set.rate_hz) as usize).max(MIN_SEGMENT_SAMPLES);
    let mut found = RepeatedSampleChannels::default();
    for channel in electrodes.iter().copied() {
        let column = &columns[channel];
        let still = |order: usize, steps: f64| {
            let each = column.values.iter().map(|values| differences(values, order, column.value_range));
            let all =
                each.map(|differences| StillDifferences::of(&differences, steps * column.step, stretch));
            all.fold(StillDifferences::default(), StillDifferences::combined).share(recording_set.rate_hz)
        };
        let (held, line) = (still(1, STILL_STEPS), still(2, STILL_STEPS).max(still(2, STILL_STEPS_TWICE)));
        if held > MIN_REPEATED_SHARE {
            found.repeated.push((channel, held));
        } else if line > MIN_INTERPOLATED_SHARE {
            found.interpolated.push((channel, line));
        }
    }
    found
}

impl RepeatedSampleChannels {
    /// All of them.
    pub(super) fn all(&self) -> impl Iterator<Item = usize> + '_ {
        self.repeated.iter().chain(&self.interpolated).map(|(channel, _)| *channel)
    }

    /// What is said of those that nothing else explains.
    pub(super) fn faults(&self, recording_set: &RecordingSet<'_>, explained: &[bool]) -> Vec<RecordingFault> {
        let files = || recording_set.files(|_| true);
        let open = |of: &[(usize, f64)]| -> (Vec<usize>, f64) {
            let open = of.iter().filter(|(channel, _)| !explained[*channel]);
            (
                open.clone().map(|(channel, _)| *channel).collect(),
                open.map(|(_, share)| *share).fold(0.0, f64::max),
            )
        };
        let mut faults = Vec::new();
        let (channels, share) = open(&self.repeated);
        if !channels.is_empty() {
            faults.push(RecordingFault::RepeatedSamples { channels, share, files: files() });
        }
        let (channels, share) = open(&self.interpolated);
        if !channels.is_empty() {
            faults.push(RecordingFault::Interpolated { channels, share, files: files() });
        }
        faults
    }
}

/// First or second differences, but for those among equal values at the ends of the range: a strong muscle is cut off there.
fn differences(values: &[f64], order: usize, ends: [f64; 2]) -> Vec<f64> {
    let cut_off = |part: &[f64]| ends.contains(&part[0]) && part.iter().all(|value| *value == part[0]);
    let parts = values.windows(order + 1).filter(|part| !cut_off(part));
    let difference = |part: &[f64]| match part {
        [a, b, c] => c - 2.0 * b + a,
        [a, b] => b - a,
        _ => 0.0,
    };
    parts.map(difference).collect()
}

/// How many differences are still, over lively stretches.
#[derive(Clone, Copy, Debug, Default)]
struct StillDifferences {
    still: usize,
    /// Those up to three times as large as a still one: of a muscle twice as many.
    small: usize,
    of: usize,
}

impl StillDifferences {
    fn of(differences: &[f64], steps: f64, stretch: usize) -> StillDifferences {
        let mut all = StillDifferences::default();
        for part in differences.chunks_exact(stretch) {
            let mut sizes: Vec<f64> = part.iter().map(|difference| difference.abs()).collect();
            sizes.sort_unstable_by(f64::total_cmp);
            let mean = sizes.iter().sum::<f64>() / sizes.len() as f64;
            let still = steps.max(STILL_SHARE * mean);
            if sizes[9 * sizes.len() / 10] >= MIN_ACTIVITY_RATIO * still {
                let below = |limit: f64| sizes.partition_point(|size| *size <= limit);
                all = all.combined(StillDifferences {
                    still: below(still),
                    small: below(3.0 * still) - below(still),
                    of: sizes.len(),
                });
            }
        }
        all
    }

    fn combined(self, other: StillDifferences) -> StillDifferences {
        StillDifferences {
            still: self.still + other.still,
            small: self.small + other.small,
            of: self.of + other.of,
        }
    }

    /// The share above that of chance; 0 of no more than `fewest` differences, a second of a channel.
    fn share(self, fewest: f64) -> f64 {
        let excess = self.still as f64 - 0.5 * self.small as f64;
        if self.of as f64 > fewest { excess.max(0.0) / self.of as f64 } else { 0.0 }
    }
}
