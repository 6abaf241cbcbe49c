//! Recordings of a gesture that are another recording of it, altered: with noise, at another speed, filtered, backwards, of another
//! gain or polarity, with the channels moved on.
//!
//! Compared are envelopes: how loud each channel is, in steps of 20 ms, beside its own half a second and beside the other channels.
//! That does not change with gain, polarity, phase or moderate filtering, and a change of speed of half a per cent shifts it
//! little. In contractions of their own these fluctuations are noise, so that the correlation of two recordings is as that of noise.

use super::{RecordingFault, RecordingSet, columns::ColumnStatistics};
use crate::fft::{Complex, Fft};

/// Samples of an envelope per second; of slow streams half of their rate.
const ENVELOPE_HZ: f64 = 50.0;
/// The electrode's level is its mean over so long, seconds.
const LEVEL_SECS: f64 = 0.1;
/// Samples of the envelope over which loudness is compared with itself.
const LOUDNESS_WINDOW_BLOCKS: usize = 13;
/// Fluctuations are limited to so many standard deviations.
const MAX_FLUCTUATION_SDS: f64 = 2.5;
/// Channels from which on what all of them do together is left out: an onset is alike in all repetitions.
const MIN_CHANNELS_FOR_COMMON_MODE: usize = 4;
/// Changes of speed that are searched for, per cent; the envelope tells one from the next over a few seconds.
const SPEED_CHANGES_PERCENT: core::ops::RangeInclusive<i32> = -6..=6;
/// Pairs of recordings up to which other speeds are searched for: each costs a millisecond or two. Of more, copies at another speed are
/// not found.
const MAX_PAIRS: usize = 1000;
/// Channels up to which those that are moved on are searched for: more are a grid, which nobody turns by one.
const MAX_ROTATED_CHANNELS: usize = 16;
/// Samples of the envelope that two recordings have in common at least: half a second.
const MIN_OVERLAP: usize = 25;
/// Standard deviations of the correlation of noise, above which two recordings are one: of many channels, of few. `docs/emg.md` has
/// the largest of all recordings that were compared, and those of copies.
const MIN_CORRELATION_SDS: [f64; 2] = [8.5, 10.0];
/// And it is so many times as large as at any other shift: a tremor fits itself at each of its periods.
const MIN_PEAK_RATIO: f64 = 1.7;
/// Shifts, in samples of the envelope, that belong to one peak.
const PEAK: usize = 4;

/// Where two recordings are most alike.
#[derive(Clone, Copy, Debug, Default)]
struct EnvelopeMatch {
    /// Standard deviations of the correlation of noise.
    score: f64,
    /// That at the best of all other shifts.
    next: f64,
    /// The correlation.
    correlation: f64,
    /// How many times as fast the later one runs.
    speed: f64,
    backwards: bool,
    /// Channel c of the earlier is channel c + rotation of the later.
    rotation: usize,
}

/// Recordings of one gesture that are another one altered, but for the pairs (first, second) in `known`.
pub(super) fn altered_copies(
    recording_set: &RecordingSet<'_>,
    columns: &[ColumnStatistics],
    electrodes: &[usize],
    known: &[RecordingFault],
) -> Vec<RecordingFault> {
    let channels: Vec<&ColumnStatistics> = electrodes.iter().map(|c| &columns[*c]).collect();
    let mut gestures: Vec<_> = recording_set.repetitions.iter().map(|r| r.gesture).collect();
    gestures.sort_unstable();
    gestures.dedup();
    let pairs: usize = gestures
        .iter()
        .map(|gesture| recording_set.repetitions.iter().filter(|r| r.gesture == *gesture).count())
        .map(|count| count * (count - 1) / 2)
        .sum();
    let speeds = if pairs > MAX_PAIRS { 0..=0 } else { SPEED_CHANGES_PERCENT };
    let mut faults = Vec::new();
    for gesture in gestures {
        let of_gesture = (0..recording_set.repetitions.len())
            .filter(|index| recording_set.repetitions[*index].gesture == gesture);
        let parts: Vec<usize> = of_gesture.collect();
        for (first, second, found) in matching_pairs(recording_set.rate_hz, &channels, &parts, &speeds) {
            let (a, b) = (&recording_set.repetitions[first], &recording_set.repetitions[second]);
            let names = ((a.gesture, a.repetition), (b.gesture, b.repetition));
            let is_known = |fault: &RecordingFault| matches!(fault, RecordingFault::CopiedRecording { first, second, .. } if (*first, *second) == names);
            if !known.iter().any(is_known) {
                faults.push(RecordingFault::AlteredCopy {
                    first: names.0,
                    second: names.1,
                    correlation: found.correlation,
                    speed: found.speed,
                    backwards: found.backwards,
                    rotation: found.rotation,
                    files: vec![a.file.to_owned(), b.file.to_owned()],
                });
            }
        }
    }
    faults
}

/// The pairs of the recordings `parts` that are alike at one of `speeds`, per cent faster.
fn matching_pairs(
    rate_hz: f64,
    channels: &[&ColumnStatistics],
    parts: &[usize],
    speeds: &core::ops::RangeInclusive<i32>,
) -> Vec<(usize, usize, EnvelopeMatch)> {
    let level = ((LEVEL_SECS * rate_hz) as usize).max(3);
    let loudness = |part: &usize| channels.iter().map(|column| sums(&column.values[*part], level)).collect();
    let loudness: Vec<Vec<Vec<f64>>> = parts.iter().map(loudness).collect();
    let block = (rate_hz / ENVELOPE_HZ).max(2.0);
    let envelopes: Vec<Envelope> = loudness.iter().map(|sums| Envelope::new(sums, block)).collect();
    let max_rows = envelopes.iter().map(|envelope| envelope.rows).max().unwrap_or(0);
    if channels.is_empty() || max_rows < MIN_OVERLAP {
        return vec![];
    }
    // Room for the faster and for the slower one.
    let fourier = Fft::new(2 * max_rows + max_rows / 8 + 1);
    let bins: Vec<Vec<Bins>> = envelopes.iter().map(|envelope| envelope.bins(&fourier)).collect();
    let mut found = Vec::new();
    for (index, part) in parts.iter().enumerate() {
        let mut best = vec![EnvelopeMatch::default(); parts.len()];
        for per_cent in speeds.clone() {
            let speed = 1.0 + f64::from(per_cent) / 100.0;
            let own = Envelope::new(&loudness[index], speed * block);
            let own_bins = own.bins(&fourier);
            for later in index + 1..parts.len() {
                for likeness in compare(&fourier, (&own, &own_bins), (&envelopes[later], &bins[later])) {
                    if likeness.score > best[later].score {
                        best[later] = EnvelopeMatch { speed, ..likeness };
                    }
                }
            }
        }
        let limit = MIN_CORRELATION_SDS[usize::from(channels.len() < MIN_CHANNELS_FOR_COMMON_MODE)];
        let is_alike = |likeness: &EnvelopeMatch| {
            likeness.score > limit && likeness.score > MIN_PEAK_RATIO * likeness.next
        };
        found.extend(
            best.into_iter()
                .enumerate()
                .filter(|(_, l)| is_alike(l))
                .map(|(later, l)| (*part, parts[later], l)),
        );
    }
    found
}

/// Fluctuations of the loudness of all channels of a recording.
struct Envelope {
    rows: usize,
    /// `[channel][row]`, of variance one.
    values: Vec<Vec<f64>>,
    /// Sum of the squares of all rows before each.
    energy: Vec<f64>,
}

impl Envelope {
    /// Of the [`sums`] of each channel, a row for each `block` samples.
    fn new(sums: &[Vec<f64>], block: f64) -> Envelope {
        let mut values: Vec<Vec<f64>> = sums.iter().map(|sums| fluctuations(sums, block)).collect();
        let rows = values.iter().map(Vec::len).min().unwrap_or(0);
        let count = values.len() as f64;
        for row in 0..rows {
            let mean = if values.len() < MIN_CHANNELS_FOR_COMMON_MODE {
                0.0
            } else {
                values.iter().map(|v| v[row]).sum::<f64>() / count
            };
            let square = values.iter().map(|v| (v[row] - mean).powi(2)).sum::<f64>() / count;
            // A burst counts as any other moment.
            let gain = square.sqrt().max(1.0).recip();
            values.iter_mut().for_each(|v| {
                v[row] = ((v[row] - mean) * gain).clamp(-MAX_FLUCTUATION_SDS, MAX_FLUCTUATION_SDS)
            });
        }
        let mut energy = vec![0.0; rows + 1];
        for row in 0..rows {
            energy[row + 1] = energy[row] + values.iter().map(|v| v[row] * v[row]).sum::<f64>();
        }
        Envelope { rows, values, energy }
    }

    fn bins(&self, fourier: &Fft) -> Vec<Bins> {
        self.values.iter().map(|values| Bins::new(fourier, &values[..self.rows])).collect()
    }

    /// Sum of the squares of `rows` rows from `first`, counted from the end if it is read `backwards`.
    fn energy(&self, first: usize, rows: usize, backwards: bool) -> f64 {
        let first = if backwards { self.rows - first - rows } else { first };
        self.energy[first + rows] - self.energy[first]
    }
}

/// Sums of the absolute deviations from the level, a mean over `level` samples, before each sample and at the end.
fn sums(values: &[f64], level: usize) -> Vec<f64> {
    let mut sum = 0.0;
    let deviations =
        values.iter().zip(moving_mean(values, level)).map(|(value, level)| (value - level).abs());
    let sums = deviations.map(|deviation| {
        sum += deviation;
        sum
    });
    core::iter::once(0.0).chain(sums).collect()
}

/// Logarithm of the mean absolute deviation in blocks of `block` samples, beside its mean over [`BESIDE`] blocks; over its standard
/// deviation.
fn fluctuations(sums: &[f64], block: f64) -> Vec<f64> {
    let last = sums.len() - 1;
    let rows = (last as f64 / block) as usize;
    let at = |row: usize| {
        let sample_index = row as f64 * block;
        let (k, share) = ((sample_index as usize).min(last), sample_index.fract());
        sums[k] + share * (sums[(k + 1).min(last)] - sums[k])
    };
    let blocks: Vec<f64> = (0..rows).map(|row| (at(row + 1) - at(row)) / block).collect();
    let Some(median) = crate::model::median(blocks.clone()).filter(|median| *median > 0.0) else {
        return vec![0.0; rows];
    };
    let logarithms: Vec<f64> = blocks.iter().map(|value| (value / median + 0.5).ln()).collect();
    let beside = moving_mean(&logarithms, LOUDNESS_WINDOW_BLOCKS);
    let mut all: Vec<f64> = logarithms.iter().zip(beside).map(|(value, beside)| value - beside).collect();
    let deviation = super::columns::moments(all.iter().copied(), None).1.sqrt();
    if deviation > 0.0 {
        all.iter_mut().for_each(|value| *value /= deviation);
    }
    all
}

/// At each value the mean of `width` values around it; the ends go on as they are.
fn moving_mean(values: &[f64], width: usize) -> Vec<f64> {
    let Some(last) = values.len().checked_sub(1) else { return vec![] };
    let (before, origin) = (width / 2, values[0]);
    // About the first value: a code of 24 bits has digits to lose.
    let at = |k: usize| values[k.saturating_sub(before).min(last)] - origin;
    let mut sum: f64 = (0..width).map(at).sum();
    let mut means = Vec::with_capacity(values.len());
    for k in 0..values.len() {
        means.push(origin + sum / width as f64);
        sum += at(k + width) - at(k);
    }
    means
}

/// The best of all shifts and rotations, forwards and backwards.
fn compare(
    fourier: &Fft,
    (earlier, earlier_bins): (&Envelope, &[Bins]),
    (later, later_bins): (&Envelope, &[Bins]),
) -> [EnvelopeMatch; 2] {
    let (size, channels) = (fourier.size(), earlier_bins.len());
    let mut both = [EnvelopeMatch::default(); 2];
    let half = size / 2 + 1;
    let mut values = vec![(0.0, 0.0); size];
    let norms = [false, true].map(|backwards| Overlap::all(earlier, later, channels, size, backwards));
    let rotations = if channels > MAX_ROTATED_CHANNELS { 1 } else { channels };
    for rotation in 0..rotations {
        let mut sums =
            Products { rr: vec![0.0; half], ii: vec![0.0; half], ri: vec![0.0; half], ir: vec![0.0; half] };
        for (channel, own) in earlier_bins.iter().enumerate() {
            sums.add(own, &later_bins[(channel + rotation) % channels]);
        }
        // Forwards: a b*; backwards: a b. Both correlations are real, so that one transform gives both.
        for bin in 0..half {
            let forwards = (sums.rr[bin] + sums.ii[bin], sums.ir[bin] - sums.ri[bin]);
            let backwards = (sums.rr[bin] - sums.ii[bin], sums.ri[bin] + sums.ir[bin]);
            // forwards + i backwards, with the parts exchanged for the inverse.
            values[bin] = (forwards.1 + backwards.0, forwards.0 - backwards.1);
            if bin > 0 && bin < size / 2 {
                values[size - bin] = (backwards.0 - forwards.1, forwards.0 + backwards.1);
            }
        }
        fourier.transform(&mut values);
        for (index, best) in both.iter_mut().enumerate() {
            let sum = |overlap: &Overlap| {
                let value = values[overlap.lag_index];
                (if index == 0 { value.1 } else { value.0 }) / size as f64
            };
            let scores = || norms[index].iter().map(|overlap| sum(overlap) * overlap.scale);
            let Some((peak, score)) = scores().enumerate().max_by(|a, b| a.1.total_cmp(&b.1)) else {
                continue;
            };
            if score > best.score {
                let others = scores().enumerate().filter(|(k, _)| k.abs_diff(peak) > PEAK);
                let next = others.map(|(_, score)| score).fold(0.0, f64::max);
                let correlation = score / norms[index][peak].root;
                *best =
                    EnvelopeMatch { score, next, correlation, speed: 1.0, backwards: index == 1, rotation };
            }
        }
    }
    both
}

/// The transform of one channel: real and imaginary parts apart, so that several bins are multiplied at once.
struct Bins {
    re: Vec<f64>,
    im: Vec<f64>,
}

impl Bins {
    fn new(fourier: &Fft, values: &[f64]) -> Bins {
        let mut all: Vec<Complex> = values.iter().map(|value| (*value, 0.0)).collect();
        all.resize(fourier.size(), (0.0, 0.0));
        fourier.transform(&mut all);
        let (re, im) = all.into_iter().take(fourier.size() / 2 + 1).unzip();
        Bins { re, im }
    }
}

/// Sums over channels of the products of real and imaginary parts, of each bin.
struct Products {
    rr: Vec<f64>,
    ii: Vec<f64>,
    ri: Vec<f64>,
    ir: Vec<f64>,
}

impl Products {
    fn add(&mut self, a: &Bins, b: &Bins) {
        let sums = self.rr.iter_mut().zip(&mut self.ii).zip(self.ri.iter_mut().zip(&mut self.ir));
        for (((rr, ii), (ri, ir)), ((a_re, a_im), (b_re, b_im))) in
            sums.zip(a.re.iter().zip(&a.im).zip(b.re.iter().zip(&b.im)))
        {
            *rr += a_re * b_re;
            *ii += a_im * b_im;
            *ri += a_re * b_im;
            *ir += a_im * b_re;
        }
    }
}

/// What two recordings have in common at one shift.
struct Overlap {
    /// Where its correlation stands.
    lag_index: usize,
    /// Makes standard deviations of it.
    scale: f64,
    /// Root of the number of values.
    root: f64,
}

impl Overlap {
    /// At all shifts at which it is long enough, in their order.
    fn all(
        earlier: &Envelope,
        later: &Envelope,
        channels: usize,
        size: usize,
        backwards: bool,
    ) -> Vec<Overlap> {
        let (a, b) = (earlier.rows, later.rows);
        // Row k of the later is row k + shift of the earlier; counted from the shift 1 - b on.
        let of = |index: usize| {
            let (first, own) = ((index + 1).saturating_sub(b), (b - 1).saturating_sub(index));
            let rows = (a - first).min(b - own);
            let values = (rows * channels) as f64;
            let energy = (earlier.energy(first, rows, false) * later.energy(own, rows, backwards)).sqrt();
            // The transform of a product is a convolution, which begins at the shift 1 - b; a correlation begins at the shift 0.
            let index_in_block = if backwards { index } else { (size + index + 1 - b) % size };
            let scale = values.sqrt() / energy.max(0.5 * values);
            (rows >= MIN_OVERLAP).then_some(Overlap { lag_index: index_in_block, scale, root: values.sqrt() })
        };
        (0..(a + b).saturating_sub(1)).filter_map(of).collect()
    }
}
