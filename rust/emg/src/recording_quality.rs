//! What is wrong with recordings, before a classifier is trained on them or tested with them: columns that are no electrode,
//! samples that stand in two recordings, copies that were altered, held and interpolated samples, dead, cut-off, humming and noisy
//! channels. Thresholds do not depend on the unit of the samples; they were set on recordings of 29 people with two armbands, those
//! of copies, held and interpolated samples on 137 sessions of 22 and about 50 people, and all on planted faults.

mod altered_copies;
mod columns;
mod copies;
mod fault;
mod fault_text;
mod repeated_rows;
mod repeated_samples;

use crate::goertzel::{Goertzel, MAINS_HZ};
use crate::{ChannelFault, ChannelStatus};
use columns::ColumnStatistics;
pub use fault::{Coincidence, RecordingFault};
use proact_types::{EmgSample, Gesture};

/// A recording to be checked: one repetition of one gesture, raw codes.
#[derive(Clone, Copy, Debug)]
pub struct RecordedRepetition<'a> {
    /// What the person was asked for.
    pub gesture: Gesture,
    /// Its number, from 0.
    pub repetition: u32,
    /// The name of its file, by which findings name it.
    pub file: &'a str,
    /// `[n_samples]`, each of all channels.
    pub samples: &'a [EmgSample],
}

/// Recordings of one person that are used together.
#[derive(Clone, Copy, Debug)]
pub struct RecordingSet<'a> {
    /// Samples per second.
    pub rate_hz: f64,
    /// Columns of each sample that are judged, from the first.
    pub channels: usize,
    /// The gesture of a relaxed hand.
    pub rest: Gesture,
    /// Keys beside the recordings that seem to say the rate but are unknown. Empty where the rate is known.
    pub unknown_rate_keys: &'a [String],
    /// All recordings.
    pub repetitions: &'a [RecordedRepetition<'a>],
}

impl RecordingSet<'_> {
    /// The files of those recordings whose index `which` names.
    fn files(&self, which: impl Fn(usize) -> bool) -> Vec<String> {
        let named = self.repetitions.iter().enumerate().filter(|(index, _)| which(*index));
        let mut files: Vec<String> = named.map(|(_, repetition)| repetition.file.to_owned()).collect();
        // A live stream has none.
        files.retain(|file| !file.is_empty());
        // Some layouts keep several repetitions in one file.
        files.dedup();
        files
    }
}

/// A channel is dead if it is never louder than this share of the median channel.
const DEAD_SD_RATIO: f64 = 0.02;
/// And in one recording if it is this much quieter there than usual with this gesture.
const DEAD_RECORDING_SD_RATIO: f64 = 0.05;
/// Recordings of a gesture of which one can be told to be unusual.
const MIN_RECORDINGS_PER_GESTURE: usize = 3;
/// Steps of its converter that the median channel moves at rest, above which a channel that is still at rest is dead.
const MIN_REST_SD_STEPS: f64 = 3.0;
/// Share of samples at the ends of a channel's range above which it is cut off.
const CLIPPED_SHARE: f64 = 0.3;
/// Distinct values that a channel needs before its ends tell anything: one that rounds to a handful of counts is at its
/// ends all the time.
const MIN_DISTINCT_VALUES: usize = 16;
/// Share of a channel's power at the mains frequency and its harmonics: amber, red. A relaxed hand may be above in some recordings.
const MAINS_SHARE_LIMITS: [f64; 2] = [0.35, 0.6];
/// Blocks of a second over which hum is measured: whole periods of 50 and of 60 Hz, and wide enough for a mains that is off by 1 Hz.
const HUM_BLOCKS: f64 = 5.0;
/// A noisy channel is so many times as loud at rest as the median channel, and its loudest gesture no more than so
/// many times as loud as its rest. On the recordings of six people no channel that is above the first is below the second.
const NOISE_RATIO_LIMITS: [f64; 2] = [4.0, 1.3];

/// Judges recordings of one person. Worst first. Deterministic.
pub fn check_recordings(recording_set: &RecordingSet<'_>) -> Vec<RecordingFault> {
    if recording_set.repetitions.is_empty() {
        return Vec::new();
    }
    let columns = columns::columns(recording_set);
    let (mut explained, mut faults) = check_columns(recording_set, &columns);
    let keys = recording_set.unknown_rate_keys.to_vec();
    if !keys.is_empty() {
        faults.push(RecordingFault::UnknownRateKey { keys, assumed_hz: recording_set.rate_hz });
    }
    // A copy with other time stamps is a copy.
    let electrodes = |explained: &[bool]| (0..columns.len()).filter(|c| !explained[*c]).collect::<Vec<_>>();
    let all = electrodes(&explained);
    let copies = copies::copies(recording_set, &columns, &all);
    faults.extend(altered_copies::altered_copies(recording_set, &columns, &all, &copies));
    faults.extend(copies);
    let typical = |sd: &dyn Fn(usize) -> f64| crate::model::median(all.iter().copied().map(sd).collect());
    let usual = MedianChannelSd {
        loudest: typical(&|channel| columns[channel].loudest()).unwrap_or(0.0),
        at_rest: typical(&|channel| {
            largest(recording_set, &columns[channel], |gesture| gesture == recording_set.rest).unwrap_or(0.0)
        })
        .unwrap_or(0.0),
    };
    for channel in all {
        if let Some(fault) = channel_fault(recording_set, channel, &columns[channel], &usual) {
            explained[channel] = fault.status() == ChannelStatus::Red;
            faults.push(fault);
        }
    }
    faults.extend(noisy(recording_set, &columns, &electrodes(&explained)));
    faults.sort_by_key(|fault| std::cmp::Reverse(fault.status()));
    faults
}

/// Judges the newest seconds of a stream by themselves: a session of one recording. Whether a channel is dead, cut off or hums is not
/// asked.
pub(crate) fn check_recent_samples(recording_set: &RecordingSet<'_>) -> Vec<RecordingFault> {
    check_columns(recording_set, &columns::columns(recording_set)).1
}

/// Columns that are no electrode, which are `true` in what is answered first, and samples that are held or interpolated.
fn check_columns(
    recording_set: &RecordingSet<'_>,
    columns: &[ColumnStatistics],
) -> (Vec<bool>, Vec<RecordingFault>) {
    let (mut explained, mut faults) = columns::clocks_and_labels(recording_set, columns);
    let electrodes = |explained: &[bool]| (0..columns.len()).filter(|c| !explained[*c]).collect::<Vec<_>>();
    let suspects = electrodes(&explained);
    let channels = repeated_samples::find_repeated_samples(recording_set, columns, &suspects);
    let mut is_held =
        vec![repeated_rows::find_repeated_rows(recording_set, columns, &suspects).is_some(); columns.len()];
    channels.all().for_each(|channel| is_held[channel] = true);
    faults.extend(columns::other_sensors(recording_set, columns, &mut explained, &is_held));
    match repeated_rows::find_repeated_rows(recording_set, columns, &electrodes(&explained)) {
        Some(held) => faults.push(held),
        None => faults.extend(channels.faults(recording_set, &explained)),
    }
    (explained, faults)
}

/// Standard deviations of the median channel.
struct MedianChannelSd {
    /// In the loudest recording.
    loudest: f64,
    /// In the loudest of a relaxed hand.
    at_rest: f64,
}

/// What is wrong with a channel: dead, else cut off, else humming.
fn channel_fault(
    recording_set: &RecordingSet<'_>,
    channel: usize,
    column: &ColumnStatistics,
    usual: &MedianChannelSd,
) -> Option<RecordingFault> {
    let fault = |finding: ChannelFault, light: ChannelStatus, found: Vec<bool>| {
        let in_which = recording_set.repetitions.iter().zip(&found).filter(|(_, found)| **found);
        let recordings: Vec<_> = in_which.map(|(r, _)| (r.gesture, r.repetition)).collect();
        let (of, files) = (found.len(), recording_set.files(|index| found[index]));
        let by_itself = |with: &Coincidence| match finding {
            // A strong gesture is cut off in all its recordings.
            ChannelFault::Railed => true,
            // A relaxed hand may be less than a step of the converter.
            ChannelFault::Flat => {
                *with == Coincidence::Gesture(recording_set.rest)
                    && usual.at_rest < MIN_REST_SD_STEPS * column.step
            }
            _ => false,
        };
        let coincides = coincidence(recording_set.repetitions, &found).filter(|with| !by_itself(with));
        let any = !recordings.is_empty();
        any.then_some(RecordingFault::Channel {
            channel,
            status: light,
            finding,
            recordings,
            recording_count: of,
            coincidence: coincides,
            files,
        })
    };
    let dead = match column.is_still() || column.loudest() < DEAD_SD_RATIO * usual.loudest {
        true => vec![true; column.values.len()],
        false => dead_recordings(recording_set, column),
    };
    let cut_off = |values: &Vec<f64>| {
        let at_ends = values.iter().filter(|value| column.value_range.contains(value)).count();
        column.levels >= MIN_DISTINCT_VALUES && at_ends as f64 > CLIPPED_SHARE * values.len() as f64
    };
    fault(ChannelFault::Flat, ChannelStatus::Red, dead)
        .or_else(|| {
            let found: Vec<bool> = column.values.iter().map(cut_off).collect();
            // The strongest gesture of a strong person is cut off by an armband of 8 bits, and recognised all the same.
            let at_least_half = 2 * found.iter().filter(|found| **found).count() >= found.len();
            if at_least_half { fault(ChannelFault::Railed, ChannelStatus::Red, found) } else { None }
        })
        .or_else(|| {
            let (light, humming) = hum(recording_set, column);
            fault(ChannelFault::Mains, light, humming)
        })
}

/// With what a fault in the recordings `found` coincides: it is in most recordings of a gesture or repetition, and in less
/// than half as large a share of the others.
fn coincidence(repetitions: &[RecordedRepetition<'_>], found: &[bool]) -> Option<Coincidence> {
    let covers = |fewest: usize, belongs: &dyn Fn(&RecordedRepetition<'_>) -> bool| {
        let count = |inside: bool, faulty: bool| {
            let all = repetitions.iter().zip(found);
            all.filter(|(r, found)| belongs(r) == inside && (!faulty || **found)).count()
        };
        let share = |inside: bool| count(inside, true) as f64 / count(inside, false).max(1) as f64;
        count(true, false) >= fewest && share(true) > 0.5 && share(false) < 0.5 * share(true)
    };
    let gesture = repetitions.iter().map(|r| r.gesture).find(|gesture| covers(1, &|r| r.gesture == *gesture));
    // One recording of a repetition that other gestures lack is one recording.
    let numbers = || repetitions.iter().map(|r| r.repetition);
    let repetition = || numbers().find(|number| covers(2, &|r| r.repetition == *number));
    gesture.map(Coincidence::Gesture).or_else(|| repetition().map(Coincidence::Repetition))
}

/// In which recordings a channel that is alive in others is dead.
fn dead_recordings(recording_set: &RecordingSet<'_>, column: &ColumnStatistics) -> Vec<bool> {
    let usual = |gesture: Gesture| {
        let takes = recording_set.repetitions.iter().zip(&column.sds).filter(|(r, _)| r.gesture == gesture);
        let sds: Vec<f64> = takes.map(|(_, sd)| *sd).collect();
        if sds.len() < MIN_RECORDINGS_PER_GESTURE { 0.0 } else { crate::model::median(sds).unwrap_or(0.0) }
    };
    let takes = recording_set.repetitions.iter().zip(&column.sds);
    takes.map(|(r, sd)| *sd == 0.0 || *sd < DEAD_RECORDING_SD_RATIO * usual(r.gesture)).collect()
}

/// How much a channel hums, and in which recordings. A hum that only fills the silence of a relaxed hand is none.
fn hum(recording_set: &RecordingSet<'_>, column: &ColumnStatistics) -> (ChannelStatus, Vec<bool>) {
    let rate_hz = recording_set.rate_hz;
    let block = ((rate_hz / HUM_BLOCKS).round() as usize).max(1);
    // Of each recording: variance in blocks, and that at either frequency.
    let powers: Vec<[f64; 3]> = column
        .values
        .iter()
        .map(|values| {
            let mut sums = [0.0; 3];
            let mut filters = MAINS_HZ.map(|hz| Goertzel::new(hz, rate_hz));
            for part in values.chunks_exact(block) {
                sums[0] += columns::moments(part.iter().copied(), None).1;
                for (sum, filter) in sums[1..].iter_mut().zip(&mut filters) {
                    part.iter().for_each(|value| filter.push(*value));
                    *sum += filter.finish();
                }
            }
            let blocks = (values.len() / block).max(1) as f64;
            sums.map(|sum| sum / blocks)
        })
        .collect();
    let share = |[all, a, b]: &[f64; 3]| if *all > 0.0 { a.max(*b) / all } else { 0.0 };
    let total = powers.iter().fold([0.0; 3], |sums, of| [0, 1, 2].map(|k| sums[k] + of[k]));
    let mean = total[0] / powers.len().max(1) as f64;
    let above = |limit: f64| -> Vec<bool> { powers.iter().map(|of| share(of) > limit).collect() };
    // Louder than the muscle is on the average.
    let loud: Vec<bool> =
        powers.iter().map(|of| share(of) > MAINS_SHARE_LIMITS[1] && of[1].max(of[2]) > mean).collect();
    if coincidence(recording_set.repetitions, &loud).is_some() {
        return (ChannelStatus::Red, loud);
    }
    for (limit, light) in
        [(MAINS_SHARE_LIMITS[1], ChannelStatus::Red), (MAINS_SHARE_LIMITS[0], ChannelStatus::Amber)]
    {
        let found = above(limit);
        let is_majority = 2 * found.iter().filter(|found| **found).count() > found.len();
        if is_majority || share(&total) > limit {
            return (light, found);
        }
    }
    (ChannelStatus::Red, loud)
}

/// The largest standard deviation in recordings of the gestures that `which` names.
fn largest(
    recording_set: &RecordingSet<'_>,
    column: &ColumnStatistics,
    which: impl Fn(Gesture) -> bool,
) -> Option<f64> {
    let of = recording_set.repetitions.iter().zip(&column.sds);
    of.filter(|(r, _)| which(r.gesture)).map(|(_, sd)| *sd).max_by(f64::total_cmp)
}

/// Which of the channels in `suspects` are noisy.
fn noisy(
    recording_set: &RecordingSet<'_>,
    columns: &[ColumnStatistics],
    suspects: &[usize],
) -> Vec<RecordingFault> {
    let rested =
        |channel: usize| largest(recording_set, &columns[channel], |gesture| gesture == recording_set.rest);
    let moved =
        |channel: usize| largest(recording_set, &columns[channel], |gesture| gesture != recording_set.rest);
    let at_rest: Vec<f64> = suspects.iter().filter_map(|channel| rested(*channel)).collect();
    let Some(median) = crate::model::median(at_rest) else { return vec![] };
    let loud = |channel: usize| {
        let (rested, moved) = (rested(channel)?, moved(channel)?);
        let times = rested / median.max(columns[channel].step);
        let noisy = times > NOISE_RATIO_LIMITS[0] && moved < NOISE_RATIO_LIMITS[1] * rested;
        noisy.then(|| RecordingFault::Noisy { channel, ratio: times, files: recording_set.files(|_| true) })
    };
    suspects.iter().copied().filter_map(loud).collect()
}

#[cfg(test)]
mod tests;
