//! What is wrong with recordings, before a classifier is trained on them or tested with them: columns that are no electrode,
//! samples that stand in two recordings, held rows, dead, cut-off, humming and noisy channels. Thresholds do not depend on the
//! unit of the samples; they were set on recordings of 29 people with two armbands and on planted faults.

mod columns;
mod copies;
mod held_rows;
mod text;

use crate::goertzel::{Goertzel, MAINS_HZ};
use crate::{ChannelFault, Light};
use columns::Column;
use proact_types::{EmgSample, GestureName};
use serde::Serialize;

/// A recording to be checked: one repetition of one gesture, raw codes.
#[derive(Clone, Copy, Debug)]
pub struct RecordedRepetition<'a> {
    /// What the person was asked for.
    pub gesture: GestureName,
    /// Its number, from 0.
    pub repetition: u32,
    /// The name of its file, by which findings name it.
    pub file: &'a str,
    /// `[n_samples]`, each of all channels.
    pub samples: &'a [EmgSample],
}

/// Recordings of one person that are used together.
#[derive(Clone, Copy, Debug)]
pub struct RecordedSession<'a> {
    /// Samples per second.
    pub rate_hz: f64,
    /// Columns of each sample that are judged, from the first.
    pub channels: usize,
    /// The gesture of a relaxed hand.
    pub rest: GestureName,
    /// Keys beside the recordings that seem to say the rate but are unknown. Empty where the rate is known.
    pub unknown_rate_keys: &'a [String],
    /// All recordings.
    pub repetitions: &'a [RecordedRepetition<'a>],
}

impl RecordedSession<'_> {
    /// The files of those recordings whose index `which` names.
    fn files(&self, which: impl Fn(usize) -> bool) -> Vec<String> {
        let named = self.repetitions.iter().enumerate().filter(|(index, _)| which(*index));
        let mut files: Vec<String> = named.map(|(_, repetition)| repetition.file.to_owned()).collect();
        // Some layouts keep several repetitions in one file.
        files.dedup();
        files
    }
}

/// What is wrong with recordings. Channels count from 0; `files` are those in which it was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "fault", rename_all = "snake_case")]
pub enum RecordedFault {
    /// A channel that is dead, cut off or hums.
    Channel {
        /// Which channel.
        channel: usize,
        /// How bad it is where it is found.
        light: Light,
        /// Why.
        finding: ChannelFault,
        /// In which recordings, gesture and repetition.
        recordings: Vec<(GestureName, u32)>,
        /// Recordings in all.
        of: usize,
        /// The gesture or repetition that it covers while the others are better.
        coincides: Option<Coincidence>,
        /// Their files.
        files: Vec<String>,
    },
    /// A channel is as loud at rest as in any gesture, and louder at rest than the others: no muscle drives it.
    Noisy {
        /// Which channel.
        channel: usize,
        /// Standard deviation at rest over the median of all channels.
        times: f64,
        /// Their files.
        files: Vec<String>,
    },
    /// A column only rises: time stamps or a counter, not a muscle.
    TimeStamps {
        /// Which channel.
        channel: usize,
        /// Their files.
        files: Vec<String>,
    },
    /// A column counts, and begins again: a sample or packet number, not a muscle.
    Counter {
        /// Which channel.
        channel: usize,
        /// Their files.
        files: Vec<String>,
    },
    /// A column holds one value in each recording, and not in all the same: a label, not a muscle.
    Label {
        /// Which channel.
        channel: usize,
        /// Their files.
        files: Vec<String>,
    },
    /// Four columns keep their length together: an orientation (quaternion), not muscles.
    Orientation {
        /// Which channels.
        channels: Vec<usize>,
        /// The length.
        length: f64,
        /// Their files.
        files: Vec<String>,
    },
    /// Three columns keep their length together: an acceleration or a magnetic field, not muscles.
    Acceleration {
        /// Which channels.
        channels: Vec<usize>,
        /// The length.
        length: f64,
        /// Their files.
        files: Vec<String>,
    },
    /// A column moves slowly, as a limb does: no electrode, or one whose level drifts.
    Slow {
        /// Which channel.
        channel: usize,
        /// Share of its variance below 10 Hz.
        share: f64,
        /// At least half of the channels are slow: envelopes, or a converter without a high pass.
        most: bool,
        /// Their files.
        files: Vec<String>,
    },
    /// Rows repeat the one before in all channels: the device sent fewer samples than were written.
    Held {
        /// Share of rows that repeat the one before, in the recordings that are named.
        share: f64,
        /// Most equal rows one after the other.
        longest: usize,
        /// Recordings in which rows are held.
        recordings: usize,
        /// Recordings in all.
        of: usize,
        /// Their files.
        files: Vec<String>,
    },
    /// The same samples stand in two recordings: what is tested was trained on.
    Shared {
        /// The earlier recording, gesture and repetition.
        first: (GestureName, u32),
        /// The later one.
        second: (GestureName, u32),
        /// Samples of the later one that stand in the earlier one too.
        samples: usize,
        /// Samples of the later one.
        of: usize,
        /// The file of the earlier and that of the later.
        files: Vec<String>,
    },
    /// The rate was assumed although the metadata seems to say it under an unknown key.
    RateKey {
        /// Which keys.
        keys: Vec<String>,
        /// What was assumed, Hz.
        assumed_hz: f64,
    },
}

/// With what a fault of a channel coincides: a gesture that is recognised by the fault, or a repetition that is tested or
/// trained on with another set of channels than the others.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Coincidence {
    /// Most recordings of this gesture.
    Gesture(GestureName),
    /// Most recordings of this repetition.
    Repetition(u32),
}

impl RecordedFault {
    /// Red: nothing should be trained on it or tested with it. Amber is said and used all the same: a channel that is dead or hums in no
    /// more than half of the recordings and not just in one gesture or repetition, a noisy one, and slow channels that are at least half
    /// of all.
    pub fn light(&self) -> Light {
        match self {
            RecordedFault::Channel { light, recordings, of, coincides: None, .. }
                if 2 * recordings.len() <= *of =>
            {
                (*light).min(Light::Amber)
            }
            RecordedFault::Channel { light, .. } => *light,
            RecordedFault::Slow { most: true, .. } | RecordedFault::Noisy { .. } => Light::Amber,
            _ => Light::Red,
        }
    }
}

/// A channel is dead if it is never louder than this share of the median channel.
const DEAD: f64 = 0.02;
/// And in one recording if it is this much quieter there than usual with this gesture.
const DEAD_HERE: f64 = 0.05;
/// Recordings of a gesture of which one can be told to be unusual.
const FEWEST_TAKES: usize = 3;
/// Steps of its converter that the median channel moves at rest, above which a channel that is still at rest is dead.
const RESTING_STEPS: f64 = 3.0;
/// Share of samples at the ends of a channel's range above which it is cut off.
const CUT_OFF: f64 = 0.3;
/// Distinct values that a channel needs before its ends tell anything: one that rounds to a handful of counts is at its
/// ends all the time.
const FEWEST_LEVELS: usize = 16;
/// Share of a channel's power at the mains frequency and its harmonics: amber, red. A relaxed hand may be above in some recordings.
const HUM: [f64; 2] = [0.35, 0.6];
/// Blocks of a second over which hum is measured: whole periods of 50 and of 60 Hz, and wide enough for a mains that is off by 1 Hz.
const HUM_BLOCKS: f64 = 5.0;
/// A noisy channel is so many times as loud at rest as the median channel, and its loudest gesture no more than so
/// many times as loud as its rest. On the recordings of six people no channel that is above the first is below the second.
const NOISY: [f64; 2] = [4.0, 1.3];

/// Judges recordings of one person. Worst first. Deterministic.
pub fn check_recordings(session: &RecordedSession<'_>) -> Vec<RecordedFault> {
    if session.repetitions.is_empty() {
        return Vec::new();
    }
    let columns = columns::columns(session);
    let (mut explained, mut faults) = columns::no_electrodes(session, &columns);
    let keys = session.unknown_rate_keys.to_vec();
    if !keys.is_empty() {
        faults.push(RecordedFault::RateKey { keys, assumed_hz: session.rate_hz });
    }
    // A copy with other time stamps is a copy.
    let electrodes = |explained: &[bool]| (0..columns.len()).filter(|c| !explained[*c]).collect::<Vec<_>>();
    let all = electrodes(&explained);
    faults.extend(copies::copies(session, &columns, &all));
    faults.extend(held_rows::held_rows(session, &columns, &all));
    let typical = |sd: &dyn Fn(usize) -> f64| crate::model::median(all.iter().copied().map(sd).collect());
    let usual = Usual {
        loudest: typical(&|channel| columns[channel].loudest()).unwrap_or(0.0),
        at_rest: typical(&|channel| {
            largest(session, &columns[channel], |gesture| gesture == session.rest).unwrap_or(0.0)
        })
        .unwrap_or(0.0),
    };
    for channel in all {
        if let Some(fault) = channel_fault(session, channel, &columns[channel], &usual) {
            explained[channel] = fault.light() == Light::Red;
            faults.push(fault);
        }
    }
    faults.extend(noisy(session, &columns, &electrodes(&explained)));
    faults.sort_by_key(|fault| std::cmp::Reverse(fault.light()));
    faults
}

/// Standard deviations of the median channel.
struct Usual {
    /// In the loudest recording.
    loudest: f64,
    /// In the loudest of a relaxed hand.
    at_rest: f64,
}

/// What is wrong with a channel: dead, else cut off, else humming.
fn channel_fault(
    session: &RecordedSession<'_>,
    channel: usize,
    column: &Column,
    usual: &Usual,
) -> Option<RecordedFault> {
    let fault = |finding: ChannelFault, light: Light, found: Vec<bool>| {
        let in_which = session.repetitions.iter().zip(&found).filter(|(_, found)| **found);
        let recordings: Vec<_> = in_which.map(|(r, _)| (r.gesture, r.repetition)).collect();
        let (of, files) = (found.len(), session.files(|index| found[index]));
        let by_itself = |with: &Coincidence| match finding {
            // A strong gesture is cut off in all its recordings.
            ChannelFault::Railed => true,
            // A relaxed hand may be less than a step of the converter.
            ChannelFault::Flat => {
                *with == Coincidence::Gesture(session.rest) && usual.at_rest < RESTING_STEPS * column.step
            }
            _ => false,
        };
        let coincides = coincidence(session.repetitions, &found).filter(|with| !by_itself(with));
        let any = !recordings.is_empty();
        any.then_some(RecordedFault::Channel { channel, light, finding, recordings, of, coincides, files })
    };
    let dead = match column.is_still() || column.loudest() < DEAD * usual.loudest {
        true => vec![true; column.values.len()],
        false => dead_here(session, column),
    };
    let cut_off = |values: &Vec<f64>| {
        let at_ends = values.iter().filter(|value| column.ends.contains(value)).count();
        column.levels >= FEWEST_LEVELS && at_ends as f64 > CUT_OFF * values.len() as f64
    };
    fault(ChannelFault::Flat, Light::Red, dead)
        .or_else(|| {
            let found: Vec<bool> = column.values.iter().map(cut_off).collect();
            // The strongest gesture of a strong person is cut off by an armband of 8 bits, and recognised all the same.
            let at_least_half = 2 * found.iter().filter(|found| **found).count() >= found.len();
            if at_least_half { fault(ChannelFault::Railed, Light::Red, found) } else { None }
        })
        .or_else(|| {
            let (light, humming) = hum(session, column);
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
fn dead_here(session: &RecordedSession<'_>, column: &Column) -> Vec<bool> {
    let usual = |gesture: GestureName| {
        let takes = session.repetitions.iter().zip(&column.sds).filter(|(r, _)| r.gesture == gesture);
        let sds: Vec<f64> = takes.map(|(_, sd)| *sd).collect();
        if sds.len() < FEWEST_TAKES { 0.0 } else { crate::model::median(sds).unwrap_or(0.0) }
    };
    let takes = session.repetitions.iter().zip(&column.sds);
    takes.map(|(r, sd)| *sd == 0.0 || *sd < DEAD_HERE * usual(r.gesture)).collect()
}

/// How much a channel hums, and in which recordings. A hum that only fills the silence of a relaxed hand is none.
fn hum(session: &RecordedSession<'_>, column: &Column) -> (Light, Vec<bool>) {
    let rate_hz = session.rate_hz;
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
    let loud: Vec<bool> = powers.iter().map(|of| share(of) > HUM[1] && of[1].max(of[2]) > mean).collect();
    if coincidence(session.repetitions, &loud).is_some() {
        return (Light::Red, loud);
    }
    for (limit, light) in [(HUM[1], Light::Red), (HUM[0], Light::Amber)] {
        let found = above(limit);
        let most = 2 * found.iter().filter(|found| **found).count() > found.len();
        if most || share(&total) > limit {
            return (light, found);
        }
    }
    (Light::Red, loud)
}

/// The largest standard deviation in recordings of the gestures that `which` names.
fn largest(
    session: &RecordedSession<'_>,
    column: &Column,
    which: impl Fn(GestureName) -> bool,
) -> Option<f64> {
    let of = session.repetitions.iter().zip(&column.sds);
    of.filter(|(r, _)| which(r.gesture)).map(|(_, sd)| *sd).max_by(f64::total_cmp)
}

/// Which of the channels in `suspects` are noisy.
fn noisy(session: &RecordedSession<'_>, columns: &[Column], suspects: &[usize]) -> Vec<RecordedFault> {
    let rested = |channel: usize| largest(session, &columns[channel], |gesture| gesture == session.rest);
    let moved = |channel: usize| largest(session, &columns[channel], |gesture| gesture != session.rest);
    let at_rest: Vec<f64> = suspects.iter().filter_map(|channel| rested(*channel)).collect();
    let Some(median) = crate::model::median(at_rest) else { return vec![] };
    let loud = |channel: usize| {
        let (rested, moved) = (rested(channel)?, moved(channel)?);
        let times = rested / median.max(columns[channel].step);
        let noisy = times > NOISY[0] && moved < NOISY[1] * rested;
        noisy.then(|| RecordedFault::Noisy { channel, times, files: session.files(|_| true) })
    };
    suspects.iter().copied().filter_map(loud).collect()
}

#[cfg(test)]
mod tests;
