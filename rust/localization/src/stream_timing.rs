//! How steady a stream of poses is: rate, jitter, lag and drop-outs.

use crate::Nanos;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Samples of so long are looked at, ns.
const WINDOW: Nanos = 10_000_000_000;
/// Fewer samples say nothing.
const MIN_SAMPLES: usize = 10;
/// Stamps further apart than so many periods have a drop-out between them.
const DROP_PERIODS: f64 = 2.5;

/// What the last ten seconds of a stream were like.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StreamTiming {
    /// Samples a second, between drop-outs.
    pub rate_hz: f64,
    /// How much later than the quickest sample half of them arrive, s: what is lost beside the system's own delay, which no
    /// stamp tells.
    pub lag_secs: f64,
    /// The same for one in a hundred, less the lag, s.
    pub jitter_secs: f64,
    /// Gaps in the stamps: samples that the system left out.
    pub dropouts: u32,
    /// The longest of them, s; 0 without any.
    #[serde(rename = "longest_secs")]
    pub longest_dropout_secs: f64,
    /// Share of the time that was missing, 0 to 1.
    #[serde(rename = "missing")]
    pub missing_share: f64,
}

/// Looks at stamps and arrivals of one body. Deterministic.
#[derive(Clone, Debug, Default)]
pub struct StreamMeter {
    /// Stamp and arrival, in the order of arrival.
    samples: VecDeque<(Nanos, Nanos)>,
}

impl StreamMeter {
    /// The next sample: measured at `stamp` on the device's clock, arrived at `arrival` on ours.
    pub fn update(&mut self, stamp: Nanos, arrival: Nanos) {
        if self.samples.back().is_some_and(|(last, _)| stamp <= *last) {
            // A clock that was set: what was before tells nothing of what comes.
            if self.samples.back().is_some_and(|(last, _)| stamp < *last) {
                self.samples.clear();
            } else {
                return;
            }
        }
        self.samples.push_back((stamp, arrival));
        while self.samples.front().is_some_and(|(_, first)| arrival.saturating_sub(*first) > WINDOW) {
            self.samples.pop_front();
        }
    }

    /// What the stream was like up to `now` on our clock; none before there are enough samples.
    pub fn timing(&self, now: Nanos) -> Option<StreamTiming> {
        let recent: Vec<(Nanos, Nanos)> = self
            .samples
            .iter()
            .filter(|(_, arrival)| now.saturating_sub(*arrival) <= WINDOW)
            .copied()
            .collect();
        if recent.len() < MIN_SAMPLES {
            return None;
        }
        let secs = |nanos: Nanos| nanos as f64 * 1e-9;
        let mut steps: Vec<f64> =
            recent.windows(2).map(|two| secs(two[1].0.saturating_sub(two[0].0))).collect();
        let all = steps.clone();
        steps.sort_by(f64::total_cmp);
        let period = steps[steps.len() / 2].max(1e-6);
        let gaps: Vec<f64> = all.into_iter().filter(|step| *step > DROP_PERIODS * period).collect();
        let mut delays: Vec<f64> =
            recent.iter().map(|(stamp, arrival)| secs(arrival.saturating_sub(*stamp))).collect();
        delays.sort_by(f64::total_cmp);
        let min_delay = delays[0];
        let at = |share: f64| delays[((delays.len() - 1) as f64 * share) as usize] - min_delay;
        let span = secs(recent[recent.len() - 1].0.saturating_sub(recent[0].0)).max(period);
        let missing = gaps.iter().fold(0.0, |all, gap| all + gap - period);
        Some(StreamTiming {
            rate_hz: (recent.len() - 1) as f64 / (span - missing).max(period),
            lag_secs: at(0.5),
            jitter_secs: at(0.99) - at(0.5),
            dropouts: u32::try_from(gaps.len()).unwrap_or(u32::MAX),
            longest_dropout_secs: gaps.into_iter().fold(0.0, f64::max),
            missing_share: missing / span,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MILLI: Nanos = 1_000_000;

    #[test]
    fn rate_lag_jitter_and_drop_outs_are_those_of_the_stream_whatever_its_clock() {
        let mut meter = StreamMeter::default();
        assert_eq!(meter.timing(0), None);
        let (stamp_of, mut now) = (|k: Nanos| 77_000_000_000 + k * 10 * MILLI, 0);
        for k in 0..500 {
            // Two gaps of 100 ms, and one sample in fifty 20 ms late.
            if (200..209).contains(&k) || (300..309).contains(&k) {
                continue;
            }
            let late = if k % 50 == 0 { 20 } else { k % 5 } * MILLI;
            now = k * 10 * MILLI + 4 * MILLI + late;
            meter.update(stamp_of(k), now);
        }
        let quality = meter.timing(now).unwrap();
        assert!((quality.rate_hz - 100.0).abs() < 0.5, "{quality:?}");
        assert!(
            (quality.lag_secs - 0.002).abs() < 1e-9 && (quality.jitter_secs - 0.018).abs() < 1e-9,
            "{quality:?}"
        );
        assert_eq!(quality.dropouts, 2);
        assert!(
            (quality.longest_dropout_secs - 0.1).abs() < 1e-9
                && (quality.missing_share - 0.18 / 4.99).abs() < 1e-6,
            "{quality:?}"
        );
        // Long after, nothing is known; a clock that was set begins anew.
        assert_eq!(meter.timing(now + 2 * WINDOW), None);
        meter.update(0, now);
        assert_eq!(meter.timing(now), None);
    }
}
