//! Judges a live stream as recordings are judged, against the training of its model.

use crate::recording_quality::{RecordedRepetition, RecordingFault, RecordingSet, check_recent_samples};
use crate::{ChannelStatistics, StreamQuality};
use proact_types::{EmgSample, Gesture, SimTime};
use std::collections::VecDeque;

/// Seconds that are judged together, at most and at least.
const WINDOW_SECS: [f64; 2] = [5.0, 3.0];
/// Milliseconds from one judgement to the next.
const PERIOD_MS: u64 = 1000;
/// Judgements in a row that must find a fault: a jolt, which is no other sensor, is in five of them.
const MIN_CONSECUTIVE_FINDINGS: u32 = 6;
/// A stream is of another range if most channels are this many times as loud as the loudest recording of the training, or below this
/// share of the relaxed hand.
const AMPLITUDE_RATIO_LIMITS: [f64; 2] = [4.0, 0.1];
/// Values per second up to which a stream is judged: each judgement sorts the newest seconds, and must not hold up the stream.
const MAX_VALUES_PER_S: f64 = 32_000.0;
/// Share by which the measured rate may differ from the nominal one.
const RATE_TOLERANCE: f64 = 0.05;

/// Keeps the newest seconds of a stream, and what is wrong with them.
///
/// Deterministic: the same samples at the same times give the same findings. Dead, cut-off and humming channels are those of
/// [`QualityMonitor`](crate::QualityMonitor). Streams of more than 32,000 values per second are not judged.
#[derive(Clone, Debug)]
pub struct LiveCheck {
    rate_hz: f64,
    channels: usize,
    calibration: Vec<ChannelStatistics>,
    samples: VecDeque<EmgSample>,
    judged_at: Option<SimTime>,
    /// What the newest judgements found, and how many of them in a row.
    findings: Vec<(RecordingFault, u32)>,
    reported: Vec<RecordingFault>,
}

impl LiveCheck {
    /// Of a stream of `channels` electrodes; `calibration` is that of the model, or empty, whose range is not judged then.
    pub fn new(rate_hz: f64, channels: usize, calibration: &[ChannelStatistics]) -> LiveCheck {
        LiveCheck {
            rate_hz,
            channels,
            calibration: calibration.to_vec(),
            samples: VecDeque::new(),
            judged_at: None,
            findings: Vec::new(),
            reported: Vec::new(),
        }
    }

    /// Takes a centred sample that arrived at `now`, and what is known of the stream. All that is wrong, if that has changed; at most
    /// once a second.
    pub fn push(
        &mut self,
        now: SimTime,
        sample: &EmgSample,
        stream: &StreamQuality,
    ) -> Option<&[RecordingFault]> {
        if self.rate_hz * self.channels as f64 > MAX_VALUES_PER_S {
            return None;
        }
        // What a gap interrupts is judged anew.
        if self.samples.back().is_some_and(|before| before.counter.checked_add(1) != Some(sample.counter)) {
            self.samples.clear();
        }
        let [max_samples, min_samples] = WINDOW_SECS.map(|secs| (secs * self.rate_hz) as usize);
        if self.samples.len() >= max_samples.max(1) {
            self.samples.pop_front();
        }
        self.samples.push_back(sample.clone());
        let since = *self.judged_at.get_or_insert(now);
        if now.millis_since(since) < PERIOD_MS || self.samples.len() < min_samples {
            return None;
        }
        self.judged_at = Some(now);
        self.check_samples(stream);
        let current_findings: Vec<RecordingFault> = self
            .findings
            .iter()
            .filter(|(_, times)| *times >= MIN_CONSECUTIVE_FINDINGS)
            .map(|(fault, _)| fault.clone())
            .collect();
        let changed = current_findings.len() != self.reported.len()
            || current_findings.iter().zip(&self.reported).any(|(a, b)| !a.is_same_finding(b));
        self.reported = current_findings;
        changed.then_some(&self.reported[..])
    }

    fn check_samples(&mut self, stream: &StreamQuality) {
        let samples = self.samples.make_contiguous();
        let mut found = check_recent_samples(&RecordingSet {
            rate_hz: self.rate_hz,
            channels: self.channels,
            rest: Gesture::default(),
            unknown_rate_keys: &[],
            repetitions: &[RecordedRepetition {
                gesture: Gesture::default(),
                repetition: 0,
                file: "",
                samples,
            }],
        });
        found.extend(self.amplitude_mismatch());
        let off = |measured: &f64| (measured / self.rate_hz - 1.0).abs() > RATE_TOLERANCE;
        let measured = stream.rate_hz.filter(off);
        found.extend(
            measured
                .map(|measured_hz| RecordingFault::RateMismatch { measured_hz, nominal_hz: self.rate_hz }),
        );
        let before = std::mem::take(&mut self.findings);
        let lasting = |fault: RecordingFault| {
            let times =
                before.iter().find(|(known, _)| known.is_same_finding(&fault)).map_or(0, |(_, times)| *times);
            (fault, times + 1)
        };
        self.findings = found.into_iter().map(lasting).collect();
    }

    /// Whether most channels are far louder or far quieter than in training.
    fn amplitude_mismatch(&self) -> Option<RecordingFault> {
        let spread = |channel: usize| {
            let values =
                || self.samples.iter().filter_map(move |sample| sample.channels.get(channel).copied());
            let mean = values().sum::<f64>() / values().count().max(1) as f64;
            (values().map(|value| (value - mean).powi(2)).sum::<f64>() / values().count().max(1) as f64)
                .sqrt()
        };
        let each: Vec<(f64, ChannelStatistics)> = self
            .calibration
            .iter()
            .take(self.channels)
            .enumerate()
            .map(|(c, own)| (spread(c), *own))
            .collect();
        let louder = |(sd, own): &&(f64, ChannelStatistics)| {
            own.max_sd > 0.0 && *sd > AMPLITUDE_RATIO_LIMITS[0] * own.max_sd
        };
        let quieter = |(sd, own): &&(f64, ChannelStatistics)| *sd < AMPLITUDE_RATIO_LIMITS[1] * own.rest_sd;
        let is_majority = |count: usize| 2 * count > each.len();
        let far = is_majority(each.iter().filter(louder).count())
            || is_majority(each.iter().filter(quieter).count());
        let times =
            each.iter().filter(|(_, own)| own.max_sd > 0.0).map(|(sd, own)| sd / own.max_sd).collect();
        crate::model::median(times)
            .filter(|_| far)
            .map(|times| RecordingFault::AmplitudeMismatch { ratio: times })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE_HZ: f64 = 200.0;

    /// White noise of standard deviation about 20, from a counter.
    fn noise(channel: usize, k: u64) -> f64 {
        let mut z =
            k.wrapping_mul(0xd1b5_4a32_d192_ed03) ^ (channel as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (70.0 * ((z ^ (z >> 31)) as f64 / u64::MAX as f64 - 0.5)).round()
    }

    /// The times, s, at which what is found changed, and the kinds then, in 20 s of four channels.
    fn warnings_of(stream: &StreamQuality, value: impl Fn(usize, u64) -> f64) -> Vec<(f64, Vec<String>)> {
        let own = ChannelStatistics { rest_median: 0.0, rest_sd: 2.0, max_sd: 20.0, noise_floor: None };
        let mut check = LiveCheck::new(RATE_HZ, 4, &[own; 4]);
        let mut reports = Vec::new();
        for counter in 0..4000 {
            let now = SimTime((1000.0 * counter as f64 / RATE_HZ) as u64);
            let sample = EmgSample { counter, channels: (0..4).map(|c| value(c, counter)).collect() };
            if let Some(findings) = check.push(now, &sample, stream) {
                let kind = |fault: &RecordingFault| {
                    let value = serde_json::to_value(fault).expect("it is data");
                    value["fault"].as_str().expect("a kind").to_owned()
                };
                reports.push((now.as_secs(), findings.iter().map(kind).collect()));
            }
        }
        reports
    }

    #[test]
    fn what_lasts_is_told_once_and_so_is_its_end() {
        let good = StreamQuality::default();
        assert_eq!(warnings_of(&good, noise), []);
        let off = StreamQuality { rate_hz: Some(167.0), ..good };
        let kinds = |reports: Vec<(f64, Vec<String>)>| {
            reports.into_iter().map(|(_, kinds)| kinds).collect::<Vec<_>>()
        };
        assert_eq!(kinds(warnings_of(&off, noise)), [["other_rate"]]);
        assert_eq!(kinds(warnings_of(&good, |c, k| 10.0 * noise(c, k))), [["other_range"]]);
        assert_eq!(kinds(warnings_of(&good, |c, k| 0.001 * noise(c, k))), [["other_range"]]);
        let held = |c: usize, k: u64| if c < 2 { noise(c, k - k % 2) } else { noise(c, k) };
        assert_eq!(kinds(warnings_of(&good, held)), [["held_channels"]]);
        let turns = |c: usize, k: u64| if c == 3 { 100.0 * (k as f64 / 8.0).sin() } else { noise(c, k) };
        assert_eq!(kinds(warnings_of(&good, turns)), [["slow"]]);
        // For ten seconds: it is told when it has lasted, and when it is over.
        let a_while = |c: usize, k: u64| if (400..2400).contains(&k) { held(c, k) } else { noise(c, k) };
        let changes = warnings_of(&good, a_while);
        assert_eq!(kinds(changes.clone()), [vec!["held_channels".to_owned()], vec![]]);
        assert!(changes[0].0 < 11.0 && (12.0..18.0).contains(&changes[1].0), "{changes:?}");
        // A jolt of a second is nothing.
        assert_eq!(
            warnings_of(&good, |c, k| if (1000..1010).contains(&k) { 300.0 } else { noise(c, k) }),
            []
        );
    }
}
