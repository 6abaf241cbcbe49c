//! Whether a stream is that of a living armband on a living arm: what may still come, sample for sample and with
//! rising counters, after a converter froze, an electrode fell off or a radio lost half of its packets.

use crate::imu::{ImuFault, ImuMonitor};
use crate::loss_monitor::LossMonitor;
use crate::{EmgError, ImuConfig};
use proact_types::{ChannelValues, EmgSample, SimTime, StopCause};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Longest period of a repetition that is found, ms; and in samples its least and greatest.
const PERIOD_MS: f64 = 150.0;
const PERIODS: [usize; 2] = [16, 1024];
/// Fewest equal samples that count as a repetition or a flat line, at any rate.
const MIN_RUN_SAMPLES: f64 = 8.0;

/// From when on a stream is not that of a living arm. No value has a source: each stands clear of what the recordings
/// of six people show (`docs/emg.md`), and together with a packet's time and the arm's own stop within 250 ms.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LivenessConfig {
    /// All channels repeat what they were up to 150 ms ago, for so long and for more than that time, ms. Default 100; 0
    /// is off.
    pub frozen_ms: u64,
    /// A channel does not change for so long, ms. Default 150; 0 is off.
    pub flat_ms: u64,
    /// A channel is at the ends of its range for so long, ms. Default 150; 0 is off.
    pub railed_ms: u64,
    /// Smallest and largest code of the converter, before centring; none where it is not known.
    pub rails: Option<[f64; 2]>,
    /// Over so long a channel is smoother than the share below allows, ms. Default 150; 0 is off.
    pub noise_window_ms: u64,
    /// Share of the quietest roughness of the training below which a channel is no muscle. Default 0.25.
    pub min_noise_share: f64,
    /// Per channel the mean absolute second difference of the quietest stretch of the training, in the stream's unit.
    /// Zero: the channel was flat then and is not judged. Empty: not known, so smoothness is not judged.
    pub noise_floors: Vec<f64>,
    /// Loss and rate are judged over so long, ms. Default 200; 0 is off.
    pub loss_window_ms: u64,
    /// Share of samples lost or unusable, at most. Default 0.3.
    pub max_lost_share: f64,
    /// Rate over the nominal one, least and most. Default 0.55 and 1.85: half and twice the rate are found, a radio
    /// that holds its packets back for a moment is not.
    pub rate_ratio_limits: [f64; 2],
}

impl Default for LivenessConfig {
    fn default() -> Self {
        LivenessConfig {
            frozen_ms: 100,
            flat_ms: 150,
            railed_ms: 150,
            rails: None,
            noise_window_ms: 150,
            min_noise_share: 0.25,
            noise_floors: Vec::new(),
            loss_window_ms: 200,
            max_lost_share: 0.3,
            rate_ratio_limits: [0.55, 1.85],
        }
    }
}

impl LivenessConfig {
    /// Checks every value for a stream of `channels` channels.
    ///
    /// # Errors
    /// The first [`EmgError`] found.
    pub fn check(&self, channels: usize) -> Result<(), EmgError> {
        let refused = |name, value, expected| Err(EmgError::OutOfRange { name, value, expected });
        for (name, millis) in [
            ("liveness.frozen_ms", self.frozen_ms),
            ("liveness.flat_ms", self.flat_ms),
            ("liveness.railed_ms", self.railed_ms),
            ("liveness.noise_window_ms", self.noise_window_ms),
            ("liveness.loss_window_ms", self.loss_window_ms),
        ] {
            if millis > 10_000 {
                return refused(name, millis as f64, "at most 10000, or 0 for off");
            }
        }
        if !(0.0..=1.0).contains(&self.min_noise_share) {
            return refused("liveness.min_noise_share", self.min_noise_share, "0 to 1");
        }
        if !(0.0..=1.0).contains(&self.max_lost_share) {
            return refused("liveness.max_lost_share", self.max_lost_share, "0 to 1");
        }
        let [min, max] = self.rate_ratio_limits;
        if !(0.0..1.0).contains(&min) {
            return refused("liveness.rate_ratio_limits", min, "at least 0 and less than 1 first");
        }
        if !(max > 1.0 && max.is_finite()) {
            return refused("liveness.rate_ratio_limits", max, "more than 1 second");
        }
        if let Some([low, high]) = self.rails
            && !(low < high && low.is_finite() && high.is_finite())
        {
            return refused("liveness.rails", low, "the lower end first");
        }
        if !self.noise_floors.is_empty() && self.noise_floors.len() != channels {
            let got = self.noise_floors.len() as f64;
            return refused("liveness.noise_floors", got, "as many values as channels, or none");
        }
        if let Some(&floor) = self.noise_floors.iter().find(|v| !(v.is_finite() && **v >= 0.0)) {
            return refused("liveness.noise_floors", floor, "finite numbers from 0 on");
        }
        Ok(())
    }
}

/// Why a stream is not that of a living arm. Channels count from one, as people do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SignalFault {
    /// No usable window came for too long.
    Silent,
    /// The same samples come over and over.
    Frozen,
    /// A channel does not change.
    Flat(usize),
    /// A channel is at the end of its range.
    Railed(usize),
    /// A channel is smoother than muscle.
    Noiseless(usize),
    /// A share of the samples is lost or unusable.
    Lossy(f64),
    /// Samples a second.
    WrongRate(f64),
    /// No numbers come from an inertial measurement unit that decisions need: one of its channels.
    ImuSilent(usize),
    /// A sensor of it does not change: one of its channels.
    ImuFrozen(usize),
}

impl SignalFault {
    /// The kind of death.
    pub fn cause(&self) -> StopCause {
        match self {
            SignalFault::Silent | SignalFault::ImuSilent(_) => StopCause::Silent,
            SignalFault::Frozen | SignalFault::ImuFrozen(_) => StopCause::Frozen,
            SignalFault::Flat(_) => StopCause::Flat,
            SignalFault::Railed(_) => StopCause::Railed,
            SignalFault::Noiseless(_) => StopCause::Noiseless,
            SignalFault::Lossy(_) => StopCause::Lossy,
            SignalFault::WrongRate(_) => StopCause::WrongRate,
        }
    }
}

impl fmt::Display for SignalFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            SignalFault::Silent => f.write_str("the armband is silent"),
            SignalFault::Frozen => f.write_str("the armband repeats its samples"),
            SignalFault::Flat(channel) => write!(f, "channel {channel} of the armband is flat"),
            SignalFault::Railed(channel) => {
                write!(f, "channel {channel} of the armband is at the end of its range")
            }
            SignalFault::Noiseless(channel) => write!(f, "channel {channel} of the armband shows no muscle"),
            SignalFault::Lossy(share) => {
                write!(f, "{:.0} % of the armband's samples are lost", 100.0 * share)
            }
            SignalFault::WrongRate(hz) => write!(f, "the armband sends {hz:.0} samples a second"),
            SignalFault::ImuSilent(channel) => {
                write!(f, "channel {channel} of the inertial measurement unit is silent")
            }
            SignalFault::ImuFrozen(channel) => {
                write!(f, "channel {channel} of the inertial measurement unit repeats its values")
            }
        }
    }
}

/// Watches a stream sample by sample. It is alive again with the first sample that breaks no rule.
///
/// Storage is allocated at construction only. The same samples at the same times give the same faults.
///
/// Known weakness: a recording played in a loop longer than 150 ms passes, and so does a band of which
/// nothing but the noise of the amplifier is left, as long as it is as rough as a quiet arm.
#[derive(Clone, Debug)]
pub struct Liveness {
    config: LivenessConfig,
    rate_hz: f64,
    /// Subtracted from the stream before it comes here; rails are those of the codes.
    dc_offset: ChannelValues,
    repetition: Option<RepeatDetector>,
    channels: Vec<Channel>,
    imu: ImuMonitor,
    arrivals: Option<LossMonitor>,
    /// Counter expected next; none before the first sample.
    expected: Option<u64>,
    fault: Option<SignalFault>,
}

impl Liveness {
    /// For a stream of `channels` channels.
    ///
    /// # Errors
    /// Settings that cannot work.
    pub fn new(config: &LivenessConfig, rate_hz: f64, channels: usize) -> Result<Self, EmgError> {
        config.check(channels)?;
        let samples = |millis: u64| {
            let samples = (millis as f64 * rate_hz / 1000.0).round().max(MIN_RUN_SAMPLES) as u32;
            (millis > 0).then_some(samples)
        };
        let channel = |c: usize| {
            let floor = config.noise_floors.get(c).copied();
            let dead = floor == Some(0.0);
            Channel {
                flat_limit: samples(config.flat_ms).filter(|_| !dead),
                rail_limit: samples(config.railed_ms).filter(|_| config.rails.is_some()),
                roughness: floor.filter(|_| !dead).and_then(|floor| {
                    let length = samples(config.noise_window_ms)? as usize;
                    Some(Roughness::new(length, floor * config.min_noise_share))
                }),
                ..Channel::default()
            }
        };
        Ok(Self {
            rate_hz,
            dc_offset: ChannelValues::new(),
            repetition: samples(config.frozen_ms).map(|limit| {
                let [min, max] = PERIODS;
                RepeatDetector::new(((PERIOD_MS * rate_hz / 1000.0) as usize).clamp(min, max), limit)
            }),
            channels: (0..channels).map(channel).collect(),
            imu: ImuMonitor::new(&ImuConfig::default(), rate_hz),
            arrivals: (config.loss_window_ms > 0).then(|| LossMonitor::new(config.loss_window_ms as usize)),
            expected: None,
            fault: None,
            config: config.clone(),
        })
    }

    /// The same for a stream with an inertial measurement unit, which is watched where decisions need it.
    pub fn with_imu(mut self, config: &ImuConfig) -> Self {
        self.imu = ImuMonitor::new(config, self.rate_hz);
        self
    }

    /// What was subtracted from each channel, so that rails are compared with codes.
    pub fn set_dc_offset(&mut self, levels: &[f64]) {
        self.dc_offset = levels.iter().copied().take(self.channels.len()).collect();
    }

    /// Why the stream is not alive; none while it is. Silence is not noticed here.
    pub fn fault(&self) -> Option<SignalFault> {
        self.fault
    }

    /// The samples of the tick `now` follow; call it every tick.
    pub fn begin_tick(&mut self, now: SimTime) {
        if let Some(arrivals) = &mut self.arrivals {
            arrivals.advance_to(now);
        }
    }

    /// Takes the next sample of the tick. True while the stream is alive.
    pub fn push(&mut self, sample: &EmgSample) -> bool {
        let Some(lost) = self.count(sample.counter) else { return self.fault.is_none() };
        let electrodes = self.channels.len();
        let whole = sample.channels.len() == electrodes + self.imu.channels();
        let (emg, imu) = sample.channels.split_at(electrodes.min(sample.channels.len()));
        let usable = whole && emg.iter().all(|value| value.is_finite()) && self.imu.is_usable(imu);
        if let Some(arrivals) = &mut self.arrivals {
            arrivals.add(lost, usable);
        }
        if usable {
            self.check_sample(emg);
        }
        if let Some(fault) = whole.then(|| self.imu.push(imu)).flatten() {
            let fault = match fault {
                ImuFault::Silent(channel) => SignalFault::ImuSilent(channel),
                ImuFault::Frozen(channel) => SignalFault::ImuFrozen(channel),
            };
            // Without its numbers samples are unusable, and the share of those says less.
            if matches!(self.fault, None | Some(SignalFault::Lossy(_))) {
                self.fault = Some(fault);
            }
        }
        if let Some(fault) = self.arrivals.as_ref().and_then(|a| a.fault(&self.config, self.rate_hz)) {
            // What the samples say goes first: it tells more.
            self.fault = self.fault.or(Some(fault));
        }
        self.fault.is_none()
    }

    /// Samples lost before this counter; none if the sample came before or too late.
    fn count(&mut self, counter: u64) -> Option<u64> {
        let lost = match self.expected {
            Some(expected) if counter < expected => {
                let back = expected - counter;
                if back as f64 <= self.rate_hz * 0.1 {
                    return None;
                }
                0
            }
            Some(expected) => counter - expected,
            None => 0,
        };
        self.expected = Some(counter.saturating_add(1));
        Some(lost)
    }

    fn check_sample(&mut self, values: &[f64]) {
        let repeats = self.repetition.as_mut().is_some_and(|repetition| repetition.push(values));
        let mut fault = repeats.then_some(SignalFault::Frozen);
        for (c, (channel, &value)) in self.channels.iter_mut().zip(values).enumerate() {
            let code = value + self.dc_offset.get(c).copied().unwrap_or(0.0);
            let railed = self.config.rails.is_some_and(|[low, high]| code <= low || code >= high);
            let found = channel.push(value, railed, c + 1);
            fault = fault.or(found);
        }
        self.fault = fault;
    }
}

/// Compares each sample with all those of the last 150 ms: a stream that repeats itself with any period up to there is
/// found, be it one sample or the whole last packet. What comes but twice is no repetition: a simulated person who makes
/// the same recorded gesture again begins it where it began before.
#[derive(Clone, Debug)]
struct RepeatDetector {
    periods: usize,
    /// Equal samples that are one too few, per period; the longest period first.
    limits: Vec<u32>,
    /// Hashes of the samples, oldest first, twice as long as needed so that they are moved only now and then.
    hashes: Vec<u32>,
    /// How many samples in a row equal the one a period before; the longest period first.
    runs: Vec<u32>,
}

impl RepeatDetector {
    fn new(periods: usize, limit: u32) -> Self {
        let limits = (1..=periods as u32).rev().map(|period| period.max(limit)).collect();
        Self { periods, limits, hashes: Vec::with_capacity(4 * periods), runs: vec![0; periods] }
    }

    fn push(&mut self, values: &[f64]) -> bool {
        let hash = hash(values);
        let known = self.hashes.len().min(self.periods);
        let before = &self.hashes[self.hashes.len() - known..];
        let mut repeats = false;
        let first = self.periods - known;
        // The newest hash is the last of both. Without branches, so that several are compared at once.
        for ((run, limit), earlier) in self.runs[first..].iter_mut().zip(&self.limits[first..]).zip(before) {
            *run = run.saturating_add(1) * u32::from(*earlier == hash);
            repeats |= *run > *limit;
        }
        let length = self.hashes.len();
        if length == self.hashes.capacity() {
            self.hashes.copy_within(length - self.periods.., 0);
            self.hashes.truncate(self.periods);
        }
        self.hashes.push(hash);
        repeats
    }
}

/// Of the bits of the values. Two samples that differ share one in four billion times; a hundred in a row do not.
fn hash(values: &[f64]) -> u32 {
    // Multiplication and shift of the golden ratio, as in Fibonacci hashing.
    let mixed = values.iter().fold(0_u64, |hash, value| {
        (hash.rotate_left(23) ^ (value + 0.0).to_bits()).wrapping_mul(0x9e37_79b9_7f4a_7c15)
    });
    (mixed >> 32) as u32
}

#[derive(Clone, Debug, Default)]
struct Channel {
    flat_limit: Option<u32>,
    rail_limit: Option<u32>,
    roughness: Option<Roughness>,
    last: Option<f64>,
    /// Samples in a row that equal the one before.
    flat: u32,
    /// Samples in a row at the rails.
    railed: u32,
}

impl Channel {
    fn push(&mut self, value: f64, railed: bool, number: usize) -> Option<SignalFault> {
        self.flat = if self.last.replace(value) == Some(value) { self.flat + 1 } else { 0 };
        self.railed = if railed { self.railed + 1 } else { 0 };
        let smooth = self.roughness.as_mut().is_some_and(|roughness| roughness.push(value));
        let over = |run: u32, limit: Option<u32>| limit.is_some_and(|limit| run >= limit);
        if over(self.railed, self.rail_limit) {
            Some(SignalFault::Railed(number))
        } else if over(self.flat, self.flat_limit) {
            Some(SignalFault::Flat(number))
        } else {
            smooth.then_some(SignalFault::Noiseless(number))
        }
    }
}

/// Mean absolute second difference of the newest samples of a channel: near nothing for ramps, hum and drift, large for
/// muscle and any noise.
#[derive(Clone, Debug)]
struct Roughness {
    /// Absolute second differences, a ring.
    ring: Vec<f64>,
    sum: f64,
    taken: usize,
    last: [f64; 2],
    min_mean: f64,
}

impl Roughness {
    fn new(length: usize, min_mean: f64) -> Self {
        Self { ring: vec![0.0; length.max(1)], sum: 0.0, taken: 0, last: [0.0; 2], min_mean }
    }

    /// True if the newest samples are smoother than allowed.
    fn push(&mut self, value: f64) -> bool {
        let [before, last] = self.last;
        self.last = [last, value];
        self.taken += 1;
        // The first two have nothing before them.
        let Some(index) = self.taken.checked_sub(3) else { return false };
        let length = self.ring.len();
        let newest = (value - 2.0 * last + before).abs();
        self.sum += newest - std::mem::replace(&mut self.ring[index % length], newest);
        if index.is_multiple_of(length) {
            // A running sum keeps the rounding of large samples, or an overflow, for ever.
            self.sum = self.ring.iter().sum();
        }
        index + 1 >= length && self.sum < self.min_mean * length as f64
    }
}

/// The roughness of the quietest stretch of `millis` in recordings, for [`LivenessConfig::noise_floors`]: one value a
/// channel, zero for a channel that is flat there. Recordings shorter than that are left out; none if all are.
pub fn noise_floors<'a>(
    config: &LivenessConfig,
    rate_hz: f64,
    channels: usize,
    recordings: impl IntoIterator<Item = &'a [EmgSample]>,
) -> Vec<f64> {
    let length = (config.noise_window_ms as f64 * rate_hz / 1000.0).round().max(MIN_RUN_SAMPLES) as usize;
    let mut floors: Option<Vec<f64>> = None;
    for samples in recordings.into_iter().filter(|samples| samples.len() >= length + 2) {
        let floors = floors.get_or_insert_with(|| vec![f64::INFINITY; channels]);
        for (c, floor) in floors.iter_mut().enumerate() {
            let value = |sample: &EmgSample| sample.channels.get(c).copied().unwrap_or(0.0);
            let differences: Vec<f64> = samples
                .windows(3)
                .map(|w| (value(&w[2]) - 2.0 * value(&w[1]) + value(&w[0])).abs())
                .collect();
            *floor = floor.min(min_sliding_sum(&differences, length) / length as f64);
        }
    }
    floors.unwrap_or_default()
}

/// The least sum of `length` values in a row, none of which is negative; each is summed from its first to its last.
fn min_sliding_sum(values: &[f64], length: usize) -> f64 {
    // A sum that slides along is off by its rounding, so that those which could be the least are summed anew.
    let mut sum: f64 = values[..length].iter().sum();
    let mut sliding = vec![sum];
    sliding.extend(values.iter().zip(&values[length..]).map(|(leaves, comes)| {
        sum += comes - leaves;
        sum
    }));
    let rounding = 4.0 * f64::EPSILON * values.len() as f64 * values.iter().sum::<f64>();
    let min_mean = sliding.iter().copied().fold(f64::INFINITY, f64::min) + rounding;
    let is_min_candidate = |(_, sliding): &(&[f64], f64)| *sliding <= min_mean || !rounding.is_finite();
    let sums = values.windows(length).zip(sliding).filter(is_min_candidate);
    sums.map(|(window, _)| window.iter().sum()).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Values like those of a still channel, of codes, of channels at odds by many orders of magnitude, and of none that is finite.
    fn value() -> impl Strategy<Value = f64> {
        prop_oneof![
            8 => Just(0.0),
            8 => (0..3).prop_map(|code| f64::from(code) / 3.0),
            8 => (-12..12).prop_map(|power| 10_f64.powi(power)),
            8 => 0.0..1.0,
            1 => prop_oneof![Just(f64::NAN), Just(f64::INFINITY)],
        ]
    }

    proptest! {
        // Catches a min_sum sum that is passed over because the one that slides is off.
        #[test]
        fn the_least_sum_is_that_of_every_window_summed_anew(
            finite in any::<bool>(),
            values in prop::collection::vec(value(), 40..240),
            length in 1_usize..40,
        ) {
            let values: Vec<f64> = values.into_iter().filter(|value| !finite || value.is_finite()).collect();
            prop_assume!(values.len() >= length);
            let min_sum = values.windows(length).map(|w| w.iter().sum()).fold(f64::INFINITY, f64::min);
            prop_assert_eq!(min_sliding_sum(&values, length).to_bits(), min_sum.to_bits());
        }
    }
}
