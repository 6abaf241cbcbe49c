//! What is wrong with recordings that somebody else made, before a classifier is trained on them: the checks of a live
//! calibration, and those that only files need.

use crate::{ChannelFault, Light, QualityConfig, QualityMonitor};
use proact_types::{EmgSample, GestureName, SimTime};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

/// A recording to be checked: one repetition of one gesture, raw codes.
#[derive(Clone, Copy, Debug)]
pub struct RecordedRepetition<'a> {
    /// What the person was asked for.
    pub gesture: GestureName,
    /// Its number, from 0.
    pub repetition: u32,
    /// `[n_samples]`, each of all channels.
    pub samples: &'a [EmgSample],
}

/// What is wrong with recordings. Channels count from 0.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "fault", rename_all = "snake_case")]
pub enum RecordedFault {
    /// A traffic light that was not green.
    Channel {
        /// Which channel.
        channel: usize,
        /// The worst light.
        light: Light,
        /// Why.
        finding: ChannelFault,
        /// In which recordings, gesture and repetition.
        recordings: Vec<(GestureName, u32)>,
        /// Of so many.
        of: usize,
    },
    /// A channel is as loud at rest as in any gesture, and louder at rest than the others: no muscle drives it.
    Noisy {
        /// Which channel.
        channel: usize,
        /// Standard deviation at rest over the median of all channels.
        times: f64,
    },
    /// A column only rises: a counter or time stamps, not a muscle.
    TimeStamps {
        /// Which channel.
        channel: usize,
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
    },
}

impl RecordedFault {
    /// Red: nothing should be trained on it. A channel that is red in no more than half of the recordings is amber: of strong
    /// people a strong gesture is cut off, and a second may hum; their recordings are recognised all the same.
    pub fn light(&self) -> Light {
        match self {
            RecordedFault::Channel { light, recordings, of, .. } if 2 * recordings.len() <= *of => {
                (*light).min(Light::Amber)
            }
            RecordedFault::Channel { light, .. } => *light,
            _ => Light::Red,
        }
    }
}

/// Distinct values that a channel needs before its ends tell anything: one that rounds to a handful of counts is at its
/// ends all the time.
const FEWEST_LEVELS: usize = 16;
/// A noisy channel is so many times as loud at rest as the median channel, and its loudest gesture no more than so
/// many times as loud as its rest. On the recordings of six people no channel that is above the first is below the second.
const NOISY: [f64; 2] = [4.0, 1.3];
/// Samples that must rise one after the other for a column of time stamps.
const FEWEST_RISES: usize = 20;
/// Equal samples in a row that show a shared stretch: by chance eight channels of noise do not agree once.
const SHARED: usize = 20;

/// Checks recordings of one person: lights as in a live calibration over each second of each repetition, and what only
/// files can have. `rest` is the gesture of a relaxed hand. Worst first. Deterministic.
pub fn check_recordings(
    config: &QualityConfig,
    rate_hz: f64,
    channels: usize,
    rest: GestureName,
    recordings: &[RecordedRepetition<'_>],
) -> Vec<RecordedFault> {
    let mut faults = Vec::new();
    let stamps: Vec<bool> =
        (0..channels).map(|c| recordings.iter().all(|r| only_rises(r.samples, c))).collect();
    for (channel, _) in stamps.iter().enumerate().filter(|(_, rises)| **rises && !recordings.is_empty()) {
        faults.push(RecordedFault::TimeStamps { channel });
    }
    faults.extend(shared(recordings));
    let lights: Vec<Vec<(Light, Option<ChannelFault>)>> =
        recordings.iter().map(|r| lights(config, rate_hz, channels, r.samples)).collect();
    for channel in (0..channels).filter(|c| !stamps[*c]) {
        let clipped = clipping(config, recordings, channel);
        let found = lights.iter().zip(&clipped).map(|(lights, clipped)| match lights[channel] {
            (light, Some(fault)) if light >= *clipped => (light, Some(fault)),
            _ => (*clipped, (*clipped != Light::Green).then_some(ChannelFault::Railed)),
        });
        let found: Vec<_> = found
            .zip(recordings)
            .filter_map(|((light, fault), r)| Some((light, fault?, (r.gesture, r.repetition))))
            .collect();
        if let Some((light, finding, _)) = found.iter().copied().max_by_key(|(light, ..)| *light) {
            let same = found.iter().filter(|(l, f, _)| (*l, *f) == (light, finding));
            let recordings = same.map(|(.., which)| *which).collect();
            faults.push(RecordedFault::Channel { channel, light, finding, recordings, of: lights.len() });
        }
    }
    let explained = |c: usize| {
        let red = |fault: &RecordedFault| matches!(fault, RecordedFault::Channel { channel, light: Light::Red, .. } if *channel == c);
        stamps[c] || faults.iter().any(red)
    };
    let unexplained: Vec<usize> = (0..channels).filter(|c| !explained(*c)).collect();
    faults.extend(noisy(config, channels, rest, recordings, &unexplained));
    faults.sort_by_key(|fault| std::cmp::Reverse(fault.light()));
    faults
}

/// The worst light of each channel and its reason, once a whole second is known; at the end of a shorter recording.
fn lights(
    config: &QualityConfig,
    rate_hz: f64,
    channels: usize,
    samples: &[EmgSample],
) -> Vec<(Light, Option<ChannelFault>)> {
    let mut monitor = QualityMonitor::new(config.clone(), rate_hz, channels, &[]);
    let mut worst = vec![(Light::Green, None); channels];
    let (Some(first), Some(last)) = (samples.first(), samples.last()) else { return worst };
    let secs = |sample: &EmgSample| sample.counter.saturating_sub(first.counter) as f64 / rate_hz;
    let judged_from = secs(last).min(1.0);
    for sample in samples {
        let now = SimTime((1000.0 * secs(sample)).round() as u64);
        if monitor.push(now, sample) && secs(sample) >= judged_from - 0.2 {
            for (worst, quality) in worst.iter_mut().zip(monitor.channels()) {
                if quality.light > worst.0 {
                    *worst = (quality.light, quality.fault);
                }
            }
        }
    }
    worst
}

/// The light of each recording for samples at the ends of the channel's range: at the rails where they are known, else
/// at the largest and smallest value that any recording has.
fn clipping(config: &QualityConfig, recordings: &[RecordedRepetition<'_>], channel: usize) -> Vec<Light> {
    let values = |r: &RecordedRepetition<'_>| -> Vec<f64> {
        r.samples.iter().filter_map(|s| s.channels.get(channel).copied()).collect()
    };
    let levels: BTreeSet<u64> = recordings.iter().flat_map(values).map(f64::to_bits).collect();
    // A monitor that knows the rails has looked already.
    if config.rails.is_some() || levels.len() < FEWEST_LEVELS {
        return vec![Light::Green; recordings.len()];
    }
    let all = || levels.iter().map(|bits| f64::from_bits(*bits));
    let ends = [all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max)];
    let share = |r: &RecordedRepetition<'_>| {
        let values = values(r);
        values.iter().filter(|v| ends.contains(v)).count() as f64 / values.len().max(1) as f64
    };
    recordings.iter().map(|r| Light::above(share(r), config.railed)).collect()
}

/// Whether the column never falls and rises often.
fn only_rises(samples: &[EmgSample], channel: usize) -> bool {
    let value = |sample: &EmgSample| sample.channels.get(channel).copied().unwrap_or(f64::NAN);
    let rises = samples.windows(2).filter(|pair| value(&pair[1]) > value(&pair[0])).count();
    let never_falls = samples.windows(2).all(|pair| value(&pair[1]) >= value(&pair[0]));
    never_falls && rises >= FEWEST_RISES
}

/// Which of the channels in `suspects` are noisy.
fn noisy(
    config: &QualityConfig,
    channels: usize,
    rest: GestureName,
    recordings: &[RecordedRepetition<'_>],
    suspects: &[usize],
) -> Vec<RecordedFault> {
    let sd = |r: &RecordedRepetition<'_>, c: usize| {
        let values: Vec<f64> = r.samples.iter().filter_map(|s| s.channels.get(c).copied()).collect();
        let count = values.len().max(1) as f64;
        let mean = values.iter().sum::<f64>() / count;
        (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / count).sqrt()
    };
    let largest = |c: usize, resting: bool| {
        let of = recordings.iter().filter(|r| (r.gesture == rest) == resting);
        of.map(|r| sd(r, c)).fold(None, |most: Option<f64>, sd| Some(most.map_or(sd, |most| most.max(sd))))
    };
    let at_rest: Vec<Option<f64>> = (0..channels).map(|c| largest(c, true)).collect();
    let Some(median) = crate::model::median(at_rest.iter().copied().flatten().collect()) else {
        return vec![];
    };
    let loud = |c: usize| {
        let (rested, moved) = (at_rest[c]?, largest(c, false)?);
        let times = rested / median.max(config.count);
        let noisy = times > NOISY[0] && moved < NOISY[1] * rested;
        noisy.then_some(RecordedFault::Noisy { channel: c, times })
    };
    suspects.iter().copied().filter_map(loud).collect()
}

/// Recordings that hold the same samples.
fn shared(recordings: &[RecordedRepetition<'_>]) -> Vec<RecordedFault> {
    let bits = |samples: &[EmgSample]| -> Vec<u64> {
        samples.iter().flat_map(|s| s.channels.iter().map(|v| v.to_bits())).collect()
    };
    let constant = |samples: &[EmgSample]| samples.windows(2).all(|p| p[0].channels == p[1].channels);
    // Stretches of the recordings before, and where they stand.
    let mut known: BTreeMap<Vec<u64>, usize> = BTreeMap::new();
    let mut faults = Vec::new();
    for (index, recording) in recordings.iter().enumerate() {
        let mut found: BTreeMap<usize, usize> = BTreeMap::new();
        let mut place = 0;
        while let Some(stretch) = recording.samples.get(place..place + SHARED) {
            match known.get(&bits(stretch)) {
                Some(earlier) => {
                    *found.entry(*earlier).or_default() += SHARED;
                    place += SHARED;
                }
                None => place += 1,
            }
        }
        for (earlier, samples) in found {
            let name = |r: &RecordedRepetition<'_>| (r.gesture, r.repetition);
            let (first, second) = (name(&recordings[earlier]), name(recording));
            faults.push(RecordedFault::Shared { first, second, samples, of: recording.samples.len() });
        }
        for stretch in recording.samples.chunks_exact(SHARED).filter(|stretch| !constant(stretch)) {
            known.entry(bits(stretch)).or_insert(index);
        }
    }
    faults
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::Gesture;

    const CHANNELS: usize = 4;
    const RATE_HZ: f64 = 200.0;

    /// Noise of standard deviation one, nearly Gaussian, from a counter.
    fn noise(seed: u64, k: u64) -> f64 {
        (0..4).map(|part| uniform(seed.wrapping_add(1000 * part), k)).sum::<f64>() / 2.0
    }

    fn uniform(seed: u64, k: u64) -> f64 {
        let mut z =
            seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(k.wrapping_mul(0xd1b5_4a32_d192_ed03));
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) as f64 / u64::MAX as f64 - 0.5) * 12_f64.sqrt()
    }

    type Session = Vec<(GestureName, u32, Vec<EmgSample>)>;

    /// Three repetitions of rest and of a fist of 3 s, channel 1 changed by `change(seconds, value)`.
    fn session(change: impl Fn(f64, f64) -> f64) -> Session {
        let mut session = Vec::new();
        for repetition in 0..3 {
            for (gesture, strength) in [(Gesture::NoMotion, 3.0), (Gesture::HandClose, 20.0)] {
                let seed = u64::from(repetition) * 16 + strength as u64 * 100;
                let sample = |k: u64| {
                    let value = |c: u64| (strength * noise(seed + c, k)).round().clamp(-128.0, 127.0);
                    let mut channels: Vec<f64> = (0..CHANNELS as u64).map(value).collect();
                    channels[1] = change(k as f64 / RATE_HZ, channels[1]);
                    EmgSample { counter: k, channels: channels.into_iter().collect() }
                };
                session.push((gesture.into(), repetition, (0..600).map(sample).collect()));
            }
        }
        session
    }

    fn check(session: &Session) -> Vec<RecordedFault> {
        let recordings: Vec<RecordedRepetition<'_>> = session
            .iter()
            .map(|(gesture, repetition, samples)| RecordedRepetition {
                gesture: *gesture,
                repetition: *repetition,
                samples,
            })
            .collect();
        check_recordings(&QualityConfig::default(), RATE_HZ, CHANNELS, Gesture::NoMotion.into(), &recordings)
    }

    fn on_channel_1(finding: ChannelFault) -> impl Fn(&RecordedFault) -> bool {
        move |fault| matches!(fault, RecordedFault::Channel { channel: 1, light: Light::Red, finding: f, .. } if *f == finding)
    }

    #[test]
    fn good_recordings_have_no_fault() {
        assert_eq!(check(&session(|_, v| v)), []);
    }

    #[test]
    fn each_planted_fault_is_the_only_one_found() {
        let only = |change: &dyn Fn(f64, f64) -> f64| {
            let mut faults = check(&session(change));
            assert_eq!(faults.len(), 1, "{faults:?}");
            faults.remove(0)
        };
        assert!(on_channel_1(ChannelFault::Flat)(&only(&|_, _| 3.0)));
        let hum = |t: f64, v: f64| v + 40.0 * (std::f64::consts::TAU * 50.0 * t).sin();
        assert!(on_channel_1(ChannelFault::Mains)(&only(&hum)));
        assert!(on_channel_1(ChannelFault::Railed)(&only(&|_, v| (1.5 * v).clamp(-20.0, 20.0))));
        assert_eq!(only(&|t, _| 1000.0 + t), RecordedFault::TimeStamps { channel: 1 });
        let loud = |t: f64, _: f64| (40.0 * noise(7, (t * 200.0).round() as u64)).round();
        assert!(matches!(only(&loud), RecordedFault::Noisy { channel: 1, times } if times > 5.0));
    }

    #[test]
    fn a_channel_that_is_red_in_few_recordings_is_told_with_their_names_and_refused_in_most() {
        let dead_in = |count: usize| {
            let mut session = session(|_, v| v);
            for (.., samples) in session.iter_mut().take(count) {
                samples.iter_mut().for_each(|sample| sample.channels[1] = 3.0);
            }
            let mut faults = check(&session);
            assert_eq!(faults.len(), 1, "{faults:?}");
            faults.remove(0)
        };
        let (one, most) = (dead_in(1), dead_in(4));
        assert_eq!((one.light(), most.light()), (Light::Amber, Light::Red));
        let rest = GestureName::from(Gesture::NoMotion);
        assert!(
            matches!(&one, RecordedFault::Channel { recordings, of: 6, .. } if *recordings == [(rest, 0)]),
            "{one:?}"
        );
    }

    #[test]
    fn repetitions_that_share_samples_are_named_whole_or_in_part() {
        let mut copied = session(|_, v| v);
        copied[5].2 = copied[1].2.clone();
        let close = GestureName::from(Gesture::HandClose);
        let expected = RecordedFault::Shared { first: (close, 0), second: (close, 2), samples: 600, of: 600 };
        assert_eq!(check(&copied), [expected]);
        // The second half of one recording is the beginning of the next.
        let mut cut = session(|_, v| v);
        let half = cut[1].2[290..].to_vec();
        cut[3].2.splice(..half.len(), half);
        match check(&cut).as_slice() {
            [RecordedFault::Shared { first, second, samples, of: 600 }] => {
                assert_eq!((*first, *second), ((close, 0), (close, 1)));
                assert!((280..=310).contains(samples), "{samples}");
            }
            other => panic!("{other:?}"),
        }
    }
}
