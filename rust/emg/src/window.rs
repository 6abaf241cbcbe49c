use crate::features::FeatureParameters;
use crate::lanes::{AlignedLanes, LANES};
use crate::{EmgConfig, EmgError};
use proact_types::{ChannelValues, EmgSample};
use serde::{Deserialize, Serialize};

/// What a stream has brought, so far or in one step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct StreamCounts {
    /// Whole windows.
    pub windows: u64,
    /// Windows that a gap or an unusable sample spoilt.
    pub rejected_windows: u64,
    /// Whole windows of which some samples were bridged.
    #[serde(default)]
    #[serde(rename = "bridged_windows")]
    pub interpolated_windows: u64,
    /// Gaps in the sample counter.
    pub gaps: u64,
    /// Samples with a NaN, an infinity, or another number of channels.
    pub unusable_samples: u64,
    /// Samples whose counter had been seen before or was passed already; they are dropped.
    pub repeated_samples: u64,
    /// Times the counter went back by more than a window: the device started anew.
    pub restarts: u64,
}

impl StreamCounts {
    /// What came since `earlier` counts of the same stream.
    pub fn since(self, earlier: StreamCounts) -> StreamCounts {
        StreamCounts {
            windows: self.windows - earlier.windows,
            rejected_windows: self.rejected_windows - earlier.rejected_windows,
            interpolated_windows: self.interpolated_windows - earlier.interpolated_windows,
            gaps: self.gaps - earlier.gaps,
            unusable_samples: self.unusable_samples - earlier.unusable_samples,
            repeated_samples: self.repeated_samples - earlier.repeated_samples,
            restarts: self.restarts - earlier.restarts,
        }
    }
}

/// Cuts a stream into windows aligned to its sample counter: with W samples a window and an increment of I, window
/// k ends at the sample whose counter is `first + W - 1 + k I`, whatever happened in between. A window with an unusable
/// sample in it, or with a gap that [`crate::GapInterpolationConfig`] does not bridge, is never handed out; nor is one whose last
/// sample was lost.
///
/// Storage is allocated at construction only.
#[derive(Clone, Debug)]
pub struct SlidingWindow {
    channels: usize,
    /// Places in a sample of the channels of an inertial measurement unit that are features.
    imu: Vec<usize>,
    /// Values of a sample.
    sample_channels: usize,
    length: usize,
    increment: usize,
    /// The electrodes, eight side by side: `[channels / 8, rounded up][capacity]`, so that a window is one slice of each eight.
    data: Vec<AlignedLanes>,
    /// `[imu][capacity]`.
    imu_data: Vec<f64>,
    /// One for each sample that was lost and bridged: `[capacity]`.
    marks: Vec<u8>,
    capacity: usize,
    /// Samples in each row.
    filled: usize,
    /// Usable or bridged samples up to the newest, at most `length`.
    usable_run: usize,
    /// Longest gap that is bridged, samples.
    max_gap_samples: u64,
    /// Bridged samples that a window may have.
    max_interpolated: usize,
    /// Counter expected next; none before the first sample.
    expected: Option<u64>,
    /// Counter of the last sample of the next window.
    next_end: u64,
    counts: StreamCounts,
    parameters: FeatureParameters,
}

/// The samples of one window.
#[derive(Clone, Copy, Debug)]
pub struct WindowView<'a> {
    data: &'a [AlignedLanes],
    channels: usize,
    imu_data: &'a [f64],
    capacity: usize,
    start: usize,
    length: usize,
    interpolated: usize,
    parameters: FeatureParameters,
}

impl<'a> WindowView<'a> {
    /// Samples in a channel.
    pub fn length(&self) -> usize {
        self.length
    }

    /// Samples that were lost, and lie on a straight line between their neighbours.
    pub fn interpolated(&self) -> usize {
        self.interpolated
    }

    /// Sum over channels of the mean absolute value, in the stream's unit: the measure of effort.
    pub fn amplitude(&self) -> f64 {
        let length = self.length as f64;
        let means = self.blocks().map(|x| {
            let mut sums = [0.0; LANES];
            for eight in x {
                sums.iter_mut().zip(eight.0).for_each(|(sum, value)| *sum += value.abs());
            }
            sums.map(|sum| sum / length)
        });
        means.flatten().take(self.channels).sum()
    }

    pub(crate) fn parameters(&self) -> &FeatureParameters {
        &self.parameters
    }

    /// Number of channels of EMG.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Mean of each channel of an inertial measurement unit that is a feature, in its unit.
    pub(crate) fn imu_means(&self) -> impl Iterator<Item = f64> {
        let rows = self.imu_data.chunks_exact(self.capacity);
        rows.map(|row| row[self.start..self.start + self.length].iter().sum::<f64>() / self.length as f64)
    }

    /// The samples of eight channels each, oldest first; behind the last channel there are zeros.
    pub(crate) fn blocks(&self) -> impl Iterator<Item = &'a [AlignedLanes]> {
        let (start, length) = (self.start, self.length);
        self.data.chunks_exact(self.capacity).map(move |row| &row[start..start + length])
    }

    /// Samples of one channel, oldest first.
    ///
    /// # Panics
    /// If there is no such channel.
    pub fn channel(&self, channel: usize) -> impl ExactSizeIterator<Item = f64> + Clone + 'a {
        assert!(channel < self.channels, "channel {channel} of {}", self.channels);
        let start = channel / LANES * self.capacity + self.start;
        self.data[start..start + self.length].iter().map(move |eight| eight.0[channel % LANES])
    }
}

impl SlidingWindow {
    /// An empty window for the stream of `config`.
    ///
    /// # Errors
    /// If the settings cannot work.
    pub fn new(config: &EmgConfig) -> Result<Self, EmgError> {
        config.check()?;
        let (length, increment) = (config.window_samples()?, config.increment_samples()?);
        // Rows are three windows long, so that samples are moved to the front only now and then.
        let capacity = 3 * length;
        let imu: Vec<usize> =
            config.imu.feature_indices().into_iter().map(|index| config.channels + index).collect();
        Ok(SlidingWindow {
            channels: config.channels,
            data: vec![AlignedLanes::default(); config.channels.div_ceil(LANES) * capacity],
            imu_data: vec![0.0; imu.len() * capacity],
            marks: vec![0; capacity],
            imu,
            sample_channels: config.sample_channels(),
            length,
            increment,
            capacity,
            filled: 0,
            usable_run: 0,
            max_gap_samples: (config.gap_interpolation.max_gap_ms as f64 * config.rate_hz / 1000.0) as u64,
            max_interpolated: (config.gap_interpolation.max_interpolated_share * length as f64) as usize,
            expected: None,
            next_end: 0,
            counts: StreamCounts::default(),
            parameters: FeatureParameters {
                ssc_threshold: config.ssc_threshold,
                wamp_threshold: config.wamp_threshold,
            },
        })
    }

    /// Counters since the start.
    pub fn counts(&self) -> StreamCounts {
        self.counts
    }

    /// Takes the next sample; returns the window that ends with it, if there is one.
    pub fn push(&mut self, sample: &EmgSample) -> Option<WindowView<'_>> {
        let usable = self.is_usable(&sample.channels);
        self.push_checked(sample, usable)
    }

    /// As [`SlidingWindow::push`]; `usable` is what [`SlidingWindow::is_usable`] says of the sample.
    #[inline(always)]
    pub(crate) fn push_checked(&mut self, sample: &EmgSample, usable: bool) -> Option<WindowView<'_>> {
        // What most samples are, without all that could be wrong: the next one, and no window ends with it.
        if usable && self.expected == Some(sample.counter) && sample.counter < self.next_end {
            self.expected = Some(sample.counter + 1);
            self.store(&sample.channels, 0);
            return None;
        }
        self.push_any(sample, usable)
    }

    #[inline(never)]
    fn push_any(&mut self, sample: &EmgSample, usable: bool) -> Option<WindowView<'_>> {
        let gap = self.advance_to(sample.counter)?;
        if usable {
            self.interpolate_gap(gap, &sample.channels);
            self.store(&sample.channels, 0);
        } else {
            self.counts.unusable_samples += 1;
            self.usable_run = 0;
        }
        if sample.counter != self.next_end {
            return None;
        }
        self.next_end = self.next_end.saturating_add(self.increment as u64);
        let start = self.filled - self.usable_run.min(self.length);
        let bridged = self.marks[start..self.filled].iter().map(|mark| usize::from(*mark)).sum();
        if self.usable_run < self.length || bridged > self.max_interpolated {
            self.counts.rejected_windows = self.counts.rejected_windows.saturating_add(1);
            return None;
        }
        self.counts.windows += 1;
        self.counts.interpolated_windows += u64::from(bridged > 0);
        Some(WindowView {
            data: &self.data,
            channels: self.channels,
            imu_data: &self.imu_data,
            capacity: self.capacity,
            start,
            length: self.length,
            interpolated: bridged,
            parameters: self.parameters,
        })
    }

    /// A sample of the stream's length, whose electrodes and features of an inertial measurement unit are numbers.
    #[inline(always)]
    pub(crate) fn is_usable(&self, values: &[f64]) -> bool {
        // Without a way out at the first: all are looked at side by side.
        let finite = |values: &[f64]| values.iter().fold(true, |all, v| all & v.is_finite());
        values.len() == self.sample_channels
            && {
                let (eights, rest) = values[..self.channels].as_chunks::<LANES>();
                eights.iter().all(|eight| finite(eight)) && finite(rest)
            }
            && self.imu.iter().all(|index| values[*index].is_finite())
    }

    /// No window may hold a sample from before: what came is no signal of an arm.
    pub fn invalidate(&mut self) {
        self.usable_run = 0;
    }

    /// Compares `counter` with the one expected: how many samples are to be bridged before this one. None if it is to be
    /// dropped.
    fn advance_to(&mut self, counter: u64) -> Option<u64> {
        let mut gap = 0;
        let restart = match self.expected {
            None => true,
            Some(expected) if counter < expected => {
                // A late or repeated packet lies within a window of the newest sample; further back means that
                // the device's counter started anew.
                if expected - counter <= self.length as u64 {
                    self.counts.repeated_samples += 1;
                    return None;
                }
                self.counts.restarts += 1;
                true
            }
            Some(expected) => {
                if counter > expected {
                    self.counts.gaps += 1;
                    gap = counter - expected;
                    if gap > self.max_gap_samples {
                        (self.usable_run, gap) = (0, 0);
                    }
                }
                false
            }
        };
        if restart {
            self.usable_run = 0;
            self.next_end = counter.saturating_add(self.length as u64 - 1);
        } else if counter > self.next_end {
            // Windows whose end was lost in the gap.
            let increment = self.increment as u64;
            let lost = (counter - self.next_end).div_ceil(increment);
            self.counts.rejected_windows = self.counts.rejected_windows.saturating_add(lost);
            self.next_end = self.next_end.saturating_add(lost.saturating_mul(increment));
        }
        self.expected = Some(counter.saturating_add(1));
        Some(gap)
    }

    /// Puts `gap` lost samples on straight lines from the newest sample to `values`, which follow them. Without a sample
    /// before them there is no line.
    fn interpolate_gap(&mut self, gap: u64, values: &[f64]) {
        if gap == 0 || self.usable_run == 0 {
            return;
        }
        let newest = self.filled - 1;
        // Of a sample as long as the stream's; what is no feature stays as it is.
        let mut before: ChannelValues = values.into();
        for (channel, value) in before[..self.channels].iter_mut().enumerate() {
            *value = self.data[channel / LANES * self.capacity + newest].0[channel % LANES];
        }
        for (row, index) in self.imu.iter().enumerate() {
            before[*index] = self.imu_data[row * self.capacity + newest];
        }
        for k in 1..=gap {
            let share = k as f64 / (gap + 1) as f64;
            let line = before.iter().zip(values).map(|(from, to)| from + share * (to - from));
            let between: ChannelValues = line.collect();
            self.store(&between, 1);
        }
    }

    /// Takes the values of a sample; `mark` is one for one that was bridged.
    #[inline(always)]
    fn store(&mut self, values: &[f64], mark: u8) {
        if self.filled == self.capacity {
            self.keep_newest();
        }
        let (eights, rest) = values[..self.channels].as_chunks::<LANES>();
        let mut index = self.filled;
        for eight in eights {
            self.data[index].0 = *eight;
            index += self.capacity;
        }
        if !rest.is_empty() {
            // Behind the last channel there are zeros from the start.
            self.data[index].0[..rest.len()].copy_from_slice(rest);
        }
        for (row, from) in self.imu.iter().enumerate() {
            self.imu_data[row * self.capacity + self.filled] = values[*from];
        }
        self.marks[self.filled] = mark;
        self.filled += 1;
        self.usable_run = (self.usable_run + 1).min(self.length);
    }

    /// Moves to the front what the next window may still need.
    #[inline(never)]
    fn keep_newest(&mut self) {
        let keep = self.length - 1;
        let kept = self.capacity - keep..;
        self.data.chunks_exact_mut(self.capacity).for_each(|row| row.copy_within(kept.clone(), 0));
        self.imu_data.chunks_exact_mut(self.capacity).for_each(|row| row.copy_within(kept.clone(), 0));
        self.marks.copy_within(kept, 0);
        self.filled = keep;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{GapInterpolationConfig, WindowLength};

    /// One channel at 1 kHz; no gap is bridged.
    fn window(length: u32, increment: u32) -> SlidingWindow {
        bridging(
            length,
            increment,
            GapInterpolationConfig { max_gap_ms: 0, ..GapInterpolationConfig::default() },
        )
    }

    fn bridging(length: u32, increment: u32, bridge: GapInterpolationConfig) -> SlidingWindow {
        SlidingWindow::new(&EmgConfig {
            channels: 1,
            window: WindowLength::Samples(length),
            increment: WindowLength::Samples(increment),
            gap_interpolation: bridge,
            ..EmgConfig::default()
        })
        .expect("valid settings")
    }

    fn sample(counter: u64, value: f64) -> EmgSample {
        EmgSample { counter, channels: [value].into_iter().collect() }
    }

    /// First sample and length of each window, with the counter as the signal.
    fn push_all(window: &mut SlidingWindow, counters: impl IntoIterator<Item = u64>) -> Vec<(f64, usize)> {
        let mut out = Vec::new();
        for k in counters {
            if let Some(view) = window.push(&sample(k, k as f64)) {
                let values: Vec<f64> = view.channel(0).collect();
                assert!(values.windows(2).all(|w| w[1] == w[0] + 1.0), "torn window {values:?}");
                out.push((values[0], values.len()));
            }
        }
        out
    }

    #[test]
    fn windows_lie_at_multiples_of_the_increment_and_the_tail_is_dropped() {
        let windows = push_all(&mut window(10, 5), 100..124);
        assert_eq!(windows, [(100.0, 10), (105.0, 10), (110.0, 10)]);
    }

    #[test]
    fn an_increment_longer_than_the_window_leaves_samples_out() {
        assert_eq!(push_all(&mut window(3, 7), 0..24), [(0.0, 3), (7.0, 3), (14.0, 3), (21.0, 3)]);
    }

    #[test]
    fn a_gap_rejects_the_windows_it_touches_and_keeps_the_grid() {
        let mut window = window(10, 5);
        let windows = push_all(&mut window, (0..22).chain(24..60));
        assert_eq!(
            windows.iter().map(|w| w.0).collect::<Vec<_>>(),
            [0.0, 5.0, 10.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0]
        );
        let counts = window.counts();
        assert_eq!((counts.gaps, counts.rejected_windows, counts.windows), (1, 2, 9));
    }

    #[test]
    fn a_short_gap_is_bridged_by_a_straight_line_and_marked() {
        let mut window =
            bridging(10, 5, GapInterpolationConfig { max_gap_ms: 3, max_interpolated_share: 0.3 });
        let mut seen = Vec::new();
        // Two samples are lost, then three, then four in a row, and two gaps of two in one window.
        let counters = (0..12).chain(14..31).chain(34..47).chain(51..72).chain(74..75).chain(77..90);
        for k in counters {
            if let Some(view) = window.push(&sample(k, k as f64)) {
                let values: Vec<f64> = view.channel(0).collect();
                assert!(values.windows(2).all(|w| (w[1] - w[0] - 1.0).abs() < 1e-9), "no line: {values:?}");
                seen.push((k, view.interpolated()));
            }
        }
        // 49 was lost itself; 54 and 59 hold the gap of four, 79 two gaps of two, 74 the first of them.
        assert_eq!(
            seen,
            [
                (9, 0),
                (14, 2),
                (19, 2),
                (24, 0),
                (29, 0),
                (34, 3),
                (39, 3),
                (44, 0),
                (64, 0),
                (69, 0),
                (74, 2),
                (84, 2),
                (89, 0)
            ]
        );
        let counts = window.counts();
        assert_eq!((counts.gaps, counts.interpolated_windows, counts.rejected_windows), (5, 6, 4));
    }

    #[test]
    fn a_gap_at_the_start_or_after_an_unusable_sample_has_nothing_before_it_to_bridge_from() {
        let mut window =
            bridging(10, 5, GapInterpolationConfig { max_gap_ms: 5, max_interpolated_share: 0.5 });
        let mut ends = Vec::new();
        for k in (0..12).chain(14..40) {
            let value = if k == 11 { f64::NAN } else { k as f64 };
            ends.extend(window.push(&sample(k, value)).map(|view| (k, view.interpolated())));
        }
        assert_eq!(ends, [(9, 0), (24, 0), (29, 0), (34, 0), (39, 0)]);
    }

    #[test]
    fn a_long_gap_counts_every_window_lost_in_it() {
        let mut window = window(10, 5);
        push_all(&mut window, (0..10).chain(1000..1010));
        // Ends 14, 19, .., 1004 are lost or spoilt, 1009 is whole again.
        assert_eq!(window.counts().rejected_windows, 199);
        assert_eq!(window.counts().windows, 2);
    }

    #[test]
    fn a_nan_or_a_missing_channel_rejects_the_windows_that_hold_it() {
        for bad in [sample(12, f64::NAN), EmgSample { counter: 12, channels: Default::default() }] {
            let mut window = window(10, 5);
            let mut starts = Vec::new();
            for k in 0..40 {
                let sample = if k == 12 { bad.clone() } else { sample(k, k as f64) };
                starts.extend(window.push(&sample).map(|v| v.channel(0).next().expect("samples")));
            }
            assert_eq!(starts, [0.0, 15.0, 20.0, 25.0, 30.0]);
            assert_eq!((window.counts().unusable_samples, window.counts().rejected_windows), (1, 2));
        }
    }

    #[test]
    fn repeated_samples_are_dropped_and_a_new_start_of_the_counter_begins_a_new_grid() {
        let mut window = window(10, 5);
        let windows = push_all(&mut window, (0..12).chain(9..20).chain(0..10));
        assert_eq!(windows, [(0.0, 10), (5.0, 10), (10.0, 10), (0.0, 10)]);
        assert_eq!((window.counts().repeated_samples, window.counts().restarts), (3, 1));
    }
}
