use crate::ChannelStatistics;
use crate::goertzel::{Goertzel, MAINS_HZ};
use arrayvec::ArrayVec;
use proact_types::{EmgSample, MAX_EMG_CHANNELS, SimTime};
use serde::{Deserialize, Serialize};

/// A traffic light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(rename_all = "snake_case")]
pub enum ChannelStatus {
    /// Nothing found.
    #[default]
    Green,
    /// Usable, but to be looked at.
    Amber,
    /// Not fit for training.
    Red,
}

impl ChannelStatus {
    /// Amber above the first limit, red above the second.
    pub(crate) fn from_limits(value: f64, [amber, red]: [f64; 2]) -> ChannelStatus {
        if value > red {
            ChannelStatus::Red
        } else if value > amber {
            ChannelStatus::Amber
        } else {
            ChannelStatus::Green
        }
    }
}

/// What is wrong with a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ChannelFault {
    /// Hardly any variance: a dead channel.
    Flat,
    /// At the ends of the range.
    Railed,
    /// Far from where it rested in calibration.
    Drift,
    /// Mains hum.
    Mains,
    /// Louder than any gesture of the calibration: the electrode has lost the skin.
    LiftOff,
}

impl ChannelFault {
    /// In words.
    pub fn text(self) -> &'static str {
        match self {
            ChannelFault::Flat => "flat: a dead channel",
            ChannelFault::Railed => "cut off at the ends of the range",
            ChannelFault::Drift => "far from where it rested",
            ChannelFault::Mains => "mains hum",
            ChannelFault::LiftOff => "louder than any gesture: off the skin?",
        }
    }
}

/// What the monitor knows about the stream, and its limits: `[amber, red]`, each exceeded by more than the value.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct QualityConfig {
    /// Size of one count of the converter in the stream's unit. Default 1.
    #[serde(rename = "count")]
    pub adc_step: f64,
    /// Lowest and highest value that the converter gives, after centring. Default: not checked.
    pub rails: Option<[f64; 2]>,
    /// Standard deviations, in counts, below which a channel is flat: amber, red. Default 0.5 and 0.2, since rounding
    /// alone gives 0.29.
    pub flat: [f64; 2],
    /// Share of samples at the rails. Default 0.005 and 0.05.
    pub railed: [f64; 2],
    /// Distance of the mean of a second from the rest median, in standard deviations at rest (of at least one count).
    /// Default 3 and 8.
    pub drift: [f64; 2],
    /// Share of the power at the mains frequency and two harmonics. Default 0.35 and 0.6; muscle alone stays below
    /// 0.3.
    pub mains: [f64; 2],
    /// Standard deviation of a fifth of a second over the largest of the calibration. Default 2 and 4.
    pub lift_off: [f64; 2],
    /// Share of samples lost in a second. Default 0 and 0.05.
    pub lost: [f64; 2],
    /// Share by which the rate differs from the nominal one. Default 0.01 and 0.05.
    pub rate: [f64; 2],
}

impl Default for QualityConfig {
    fn default() -> Self {
        // No source has numbers; these were set on the recordings and planted faults of the tests.
        QualityConfig {
            adc_step: 1.0,
            rails: None,
            flat: [0.5, 0.2],
            railed: [0.005, 0.05],
            drift: [3.0, 8.0],
            mains: [0.35, 0.6],
            lift_off: [2.0, 4.0],
            lost: [0.0, 0.05],
            rate: [0.01, 0.05],
        }
    }
}

/// The newest second of one channel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ChannelQuality {
    /// The verdict.
    #[serde(rename = "light")]
    pub status: ChannelStatus,
    /// The worst finding, if the light is not green.
    pub fault: Option<ChannelFault>,
    /// Standard deviation, in the stream's unit.
    pub sd: f64,
    /// Share of samples at the rails.
    pub rail_share: f64,
    /// Distance of the mean from the rest median, in standard deviations at rest; none without calibration.
    pub drift: Option<f64>,
    /// 50 or 60 Hz, whichever is stronger; 0 if the rate is too low to see either.
    pub mains_hz: f64,
    /// Share of the power at that frequency and two harmonics.
    pub mains_share: f64,
    /// Newest fifth of a second over the largest standard deviation of the calibration; none without calibration.
    pub lift_off: Option<f64>,
}

/// The stream as a whole.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
pub struct StreamQuality {
    /// The verdict on gaps and rate.
    #[serde(rename = "light")]
    pub status: ChannelStatus,
    /// Share of samples lost or unusable in the newest second.
    pub lost_share: f64,
    /// Gaps since the start.
    #[cfg_attr(feature = "ts", ts(type = "number"))]
    pub gaps: u64,
    /// Samples a second by the device's counter and the host's clock over up to five seconds; none in the first two, and
    /// in the two after a silence: what had piled up comes in a burst then.
    pub rate_hz: Option<f64>,
}

/// Watches a live stream: per channel flat, railed, drift, mains hum and lift-off, and gaps and rate of the whole. A
/// verdict comes every fifth of a second, a whole number of periods of 50 and of 60 Hz, and covers the newest second.
///
/// Storage is allocated at construction only. The same samples at the same times give the same verdicts.
///
/// Known weakness: at 200 Hz only the mains frequency itself can be seen, no harmonics.
#[derive(Clone, Debug)]
pub struct QualityMonitor {
    config: QualityConfig,
    rate_hz: f64,
    calibration: Vec<ChannelStatistics>,
    block_samples: u64,
    /// Goertzel filters of both mains frequencies, per channel.
    hum: Vec<[Goertzel; 2]>,
    running: Vec<Block>,
    /// `[channel][BLOCKS]`; the newest is at `(blocks - 1) % BLOCKS`.
    history: Vec<[Block; BLOCKS]>,
    blocks: usize,
    expected: Option<u64>,
    block_end: u64,
    lost: u64,
    lost_history: [u64; BLOCKS],
    /// Time and samples sent at the ends of the newest blocks, from [`SETTLING_MILLIS`] after the stream began.
    arrivals: ArrayVec<(SimTime, u64), ARRIVALS>,
    /// Samples that came or were lost: a loss is not a slow device.
    sent: u64,
    /// When the stream began, or began again after a silence.
    since: Option<SimTime>,
    last_sample_at: SimTime,
    channels: Vec<ChannelQuality>,
    stream: StreamQuality,
}

/// Blocks in a second.
const BLOCKS: usize = 5;
/// Block ends over which the rate is measured.
const ARRIVALS: usize = 26;
/// What came within this time after a start is no measure of the rate: a driver hands out at once what piled up.
const SETTLING_MILLIS: u64 = 1000;
/// A silence after which samples pile up in the same way.
const SILENCE_MILLIS: u64 = 500;
/// Packets come on time to about so many milliseconds, so that the ends of a block are known no better.
const PACKET_MILLIS: f64 = 30.0;

#[derive(Clone, Copy, Debug, Default)]
struct Block {
    samples: f64,
    /// About `origin`, so that an offset does not eat the digits.
    sum: f64,
    square: f64,
    origin: f64,
    railed: f64,
    hum: [f64; 2],
}

impl Block {
    fn mean(&self) -> f64 {
        self.origin + self.sum / self.samples.max(1.0)
    }

    fn variance(&self) -> f64 {
        let samples = self.samples.max(1.0);
        (self.square / samples - (self.sum / samples).powi(2)).max(0.0)
    }
}

impl QualityMonitor {
    /// A monitor of a stream of `channels` channels at a nominal rate. `calibration` is that of the model, or empty;
    /// without it drift and lift-off are not judged.
    pub fn new(
        config: QualityConfig,
        rate_hz: f64,
        channels: usize,
        calibration: &[ChannelStatistics],
    ) -> Self {
        let channels = channels.min(MAX_EMG_CHANNELS);
        let rate_hz = rate_hz.max(1.0);
        let filters = MAINS_HZ.map(|hz| Goertzel::new(hz, rate_hz));
        QualityMonitor {
            config,
            rate_hz,
            calibration: calibration.iter().take(channels).copied().collect(),
            block_samples: (rate_hz / BLOCKS as f64).round().max(1.0) as u64,
            hum: vec![filters; channels],
            running: vec![Block::default(); channels],
            history: vec![[Block::default(); BLOCKS]; channels],
            blocks: 0,
            expected: None,
            block_end: 0,
            lost: 0,
            lost_history: [0; BLOCKS],
            arrivals: ArrayVec::new(),
            sent: 0,
            since: None,
            last_sample_at: SimTime(0),
            channels: vec![ChannelQuality::default(); channels],
            stream: StreamQuality::default(),
        }
    }

    /// Takes a sample that arrived at `now`. True if the verdicts were renewed. Does not allocate.
    pub fn push(&mut self, now: SimTime, sample: &EmgSample) -> bool {
        match self.expected {
            // A repeated or late sample says nothing new; a step far back is a new start of the device.
            Some(expected) if sample.counter < expected => {
                if expected - sample.counter <= self.block_samples {
                    return false;
                }
                self.block_end = sample.counter.saturating_add(self.block_samples);
            }
            Some(expected) if sample.counter > expected => {
                self.stream.gaps += 1;
                self.lost = self.lost.saturating_add(sample.counter - expected);
                self.sent = self.sent.saturating_add(sample.counter - expected);
            }
            Some(_) => {}
            None => self.block_end = sample.counter.saturating_add(self.block_samples),
        }
        self.expected = Some(sample.counter.saturating_add(1));
        if self.since.is_none() || now.millis_since(self.last_sample_at) > SILENCE_MILLIS {
            self.since = Some(now);
            self.arrivals.clear();
        }
        self.last_sample_at = now;
        self.sent = self.sent.saturating_add(1);
        let due = sample.counter >= self.block_end;
        if due {
            self.block_end = sample.counter.saturating_add(self.block_samples);
            self.finish(now);
        }
        let usable = sample.channels.len() == self.running.len();
        if usable && sample.channels.iter().all(|v| v.is_finite()) {
            for (c, value) in sample.channels.iter().enumerate() {
                self.running[c].push(*value, self.config.rails);
                self.hum[c].iter_mut().for_each(|filter| filter.push(*value));
            }
        } else {
            self.lost += 1;
        }
        due
    }

    /// Verdicts per channel; green until the first block is complete.
    pub fn channels(&self) -> &[ChannelQuality] {
        &self.channels
    }

    /// Verdict on the stream.
    pub fn stream(&self) -> &StreamQuality {
        &self.stream
    }

    /// The worst light of all; training should wait while it is red.
    pub fn status(&self) -> ChannelStatus {
        self.channels.iter().map(|c| c.status).max().unwrap_or_default().max(self.stream.status)
    }

    /// Ends a block and judges the newest second.
    fn finish(&mut self, now: SimTime) {
        let slot = self.blocks % BLOCKS;
        for c in 0..self.running.len() {
            let mut block = std::mem::take(&mut self.running[c]);
            for (power, filter) in block.hum.iter_mut().zip(&mut self.hum[c]) {
                *power = filter.finish();
            }
            self.running[c].origin = block.mean();
            self.history[c][slot] = block;
        }
        self.lost_history[slot] = std::mem::take(&mut self.lost);
        self.blocks += 1;
        for c in 0..self.channels.len() {
            self.channels[c] = self.assess_channel(c, slot);
        }

        if self.since.is_some_and(|since| now.millis_since(since) >= SETTLING_MILLIS) {
            if self.arrivals.is_full() {
                self.arrivals.remove(0);
            }
            self.arrivals.push((now, self.sent));
        }
        let span =
            self.arrivals.first().map(|(first, before)| (now.millis_since(*first), self.sent - before));
        let span = span.filter(|(millis, _)| *millis >= 1000);
        let measured = span.map(|(millis, samples)| samples as f64 * 1000.0 / millis as f64);
        let uncertain = span.map_or(0.0, |(millis, _)| PACKET_MILLIS / millis as f64);
        let lost = self.lost_history.iter().fold(0_u64, |sum, block| sum.saturating_add(*block));
        let covered = self.history.first().map_or(0.0, |h| h.iter().map(|b| b.samples).sum());
        let lost_share = lost as f64 / (lost as f64 + covered).max(1.0);
        let off = measured.map_or(0.0, |rate| (rate / self.rate_hz - 1.0).abs() - uncertain);
        self.stream = StreamQuality {
            status: ChannelStatus::from_limits(lost_share, self.config.lost)
                .max(ChannelStatus::from_limits(off, self.config.rate)),
            lost_share,
            gaps: self.stream.gaps,
            rate_hz: measured,
        };
    }

    fn assess_channel(&self, channel: usize, newest: usize) -> ChannelQuality {
        let filled = self.blocks.min(BLOCKS);
        let blocks = &self.history[channel][..filled];
        let samples = blocks.iter().map(|b| b.samples).sum::<f64>().max(1.0);
        let mean = blocks.iter().map(|b| b.mean() * b.samples).sum::<f64>() / samples;
        // Variance within the blocks: a slow drift is judged by itself.
        let variance = blocks.iter().map(|b| b.variance() * b.samples).sum::<f64>() / samples;
        let sd = variance.sqrt();
        let rail_share = blocks.iter().map(|b| b.railed).sum::<f64>() / samples;
        let hum = [0, 1].map(|k| blocks.iter().map(|b| b.hum[k] * b.samples).sum::<f64>() / samples);
        let louder = usize::from(hum[1] > hum[0]);
        let mains_share = if variance > 0.0 { (hum[louder] / variance).min(1.0) } else { 0.0 };
        let calibration = self.calibration.get(channel);
        let count = self.config.adc_step;
        let drift = calibration.map(|c| (mean - c.rest_median).abs() / c.rest_sd.max(count));
        let block_sd = self.history[channel][newest].variance().sqrt();
        let lift_off = calibration.map(|c| block_sd / c.max_sd.max(count));

        let limits = &self.config;
        // Flat is the one below which it gets worse.
        let flat = ChannelStatus::from_limits(-sd / count, limits.flat.map(|v| -v));
        let findings = [
            (flat, ChannelFault::Flat),
            (ChannelStatus::from_limits(rail_share, limits.railed), ChannelFault::Railed),
            (
                lift_off.map_or(ChannelStatus::Green, |v| ChannelStatus::from_limits(v, limits.lift_off)),
                ChannelFault::LiftOff,
            ),
            (
                drift.map_or(ChannelStatus::Green, |v| ChannelStatus::from_limits(v, limits.drift)),
                ChannelFault::Drift,
            ),
            // A channel that is flat has no hum worth the name.
            (
                if flat == ChannelStatus::Green {
                    ChannelStatus::from_limits(mains_share, limits.mains)
                } else {
                    ChannelStatus::Green
                },
                ChannelFault::Mains,
            ),
        ];
        let light = findings.iter().map(|f| f.0).max().unwrap_or_default();
        let fault = findings.iter().find(|f| f.0 == light && light != ChannelStatus::Green).map(|f| f.1);
        ChannelQuality {
            status: light,
            fault,
            sd,
            rail_share,
            drift,
            mains_hz: if hum[louder] > 0.0 { MAINS_HZ[louder] } else { 0.0 },
            mains_share,
            lift_off,
        }
    }
}

impl Block {
    fn push(&mut self, value: f64, rails: Option<[f64; 2]>) {
        if self.samples == 0.0 {
            self.origin = value;
        }
        self.samples += 1.0;
        self.sum += value - self.origin;
        self.square += (value - self.origin).powi(2);
        if rails.is_some_and(|[low, high]| value <= low || value >= high) {
            self.railed += 1.0;
        }
    }
}
