//! EMG thinned for a picture.

use proact_types::ChannelValues;

/// Numbers a second that a page is sent: 8 channels at 1 kHz. With the scene that is some 120 kB a second.
const MAX_VALUES_PER_SEC: f64 = 8_000.0;
/// What a picture tells apart, as a share of what a channel spans.
const ROUNDING_FRACTION: f64 = 3e-3;

/// Streams of up to 8 channels at 1 kHz go to the page as they are. Of denser ones each block of samples goes as two rows,
/// the lowest and the highest value of each channel in it: what a trace of many samples a pixel shows.
#[derive(Debug)]
pub(crate) struct TraceEnvelope {
    block: usize,
    seen: usize,
    lowest: ChannelValues,
    highest: ChannelValues,
}

impl TraceEnvelope {
    /// For a stream of `channels` channels at `rate_hz`.
    pub(crate) fn new(rate_hz: f64, channels: usize) -> Self {
        let excess = rate_hz * channels as f64 / MAX_VALUES_PER_SEC;
        let block = if excess <= 1.0 { 1 } else { 2 * excess.ceil() as usize };
        Self { block, seen: 0, lowest: ChannelValues::new(), highest: ChannelValues::new() }
    }

    /// Rows are no samples.
    pub(crate) fn is_decimated(&self) -> bool {
        self.block > 1
    }

    /// Rows a second of a stream at `rate_hz`.
    pub(crate) fn row_hz(&self, rate_hz: f64) -> f64 {
        if self.block == 1 { rate_hz } else { 2.0 * rate_hz / self.block as f64 }
    }

    /// Takes a sample; the rows that it completes go to `rows`.
    pub(crate) fn push(&mut self, values: &[f64], rows: &mut Vec<Vec<f64>>) {
        if self.block == 1 {
            rows.push(values.to_vec());
            return;
        }
        if self.seen == 0 || self.lowest.len() != values.len() {
            (self.lowest, self.highest, self.seen) = (values.into(), values.into(), 0);
        }
        for ((low, high), value) in self.lowest.iter_mut().zip(&mut self.highest).zip(values) {
            (*low, *high) = (f64::min(*low, *value), f64::max(*high, *value));
        }
        self.seen += 1;
        if self.seen == self.block {
            self.seen = 0;
            rows.extend([self.lowest.to_vec(), self.highest.to_vec()]);
        }
    }
}

/// Rounds each channel to at most three thousandths of what it spans in `rows`: digits that no picture shows are most of a message. Levels
/// stay, however far from zero a device puts them.
pub(crate) fn round(rows: &mut [Vec<f64>]) {
    for channel in 0..rows.first().map_or(0, Vec::len) {
        let values =
            rows.iter().filter_map(|row| row.get(channel).copied()).filter(|value| value.is_finite());
        let (low, high) = values
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        // Powers of ten, so that few digits are left; at least those of a device that counts in billionths.
        let decimals = -((high - low) * ROUNDING_FRACTION).log10().floor();
        if !(-9.0..=12.0).contains(&decimals) {
            continue;
        }
        let scale = 10_f64.powf(decimals);
        for value in rows.iter_mut().filter_map(|row| row.get_mut(channel)) {
            *value = (*value * scale).round() / scale;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_is_not_seen_and_keeps_what_stands_still() {
        let fine = |k: usize| (k as f64 * 0.37).sin();
        let mut rows: Vec<Vec<f64>> = (0..100)
            .map(|k| {
                vec![12.0 * fine(k), 2e-5 * fine(k), 8_388_608.0 + 30.0 * fine(k), 0.123_456_789, f64::NAN]
            })
            .collect();
        let whole = rows.clone();
        round(&mut rows);
        for (channel, span) in [(0, 24.0), (1, 4e-5), (2, 60.0)] {
            let worst =
                rows.iter().zip(&whole).map(|(a, b)| (a[channel] - b[channel]).abs()).fold(0.0, f64::max);
            assert!(worst <= 0.5 * ROUNDING_FRACTION * span, "channel {channel}: {worst}");
            assert!(worst > 0.0);
        }
        assert!(rows.iter().all(|row| row[3] == 0.123_456_789 && row[4].is_nan()));
        let text = serde_json::to_string(&rows).unwrap();
        assert!(text.len() < serde_json::to_string(&whole).unwrap().len() * 3 / 4);
    }

    #[test]
    fn armbands_go_as_they_are_and_grids_as_lowest_and_highest() {
        let mut band = TraceEnvelope::new(1000.0, 8);
        let mut rows = Vec::new();
        (0..3).for_each(|k| band.push(&[f64::from(k); 8], &mut rows));
        assert_eq!((rows.len(), band.row_hz(1000.0)), (3, 1000.0));
        assert_eq!(rows[2], [2.0; 8]);

        let mut grid = TraceEnvelope::new(4000.0, 64);
        let mut rows = Vec::new();
        for k in 0..6400_i32 {
            // A peak of one sample stays.
            grid.push(&[if k == 1234 { 99.0 } else { f64::from(k % 7) }; 64], &mut rows);
        }
        assert_eq!((rows.len() as f64, rows[0].len()), (1.6 * grid.row_hz(4000.0), 64));
        assert!((rows.len() * 64) as f64 <= 1.6 * MAX_VALUES_PER_SEC);
        assert_eq!((&rows[0], &rows[1]), (&vec![0.0; 64], &vec![6.0; 64]));
        assert_eq!(rows.iter().filter(|row| row[63] == 99.0).count(), 1);
    }
}
