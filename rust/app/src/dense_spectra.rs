//! Spectra of streams that are too dense for a page to have all their samples.

use proact_bridge::ChannelSpectrum;
use proact_emg::welch;
use std::collections::VecDeque;

/// Seconds of signal that a spectrum is taken of.
const WINDOW_SECS: f64 = 1.0;
/// Messages in which all channels come, where they are few enough: those of a second.
const MESSAGES_PER_SEC: usize = 10;
/// Most channels in a message, so that their transforms hold up no tick for long.
const MAX_CHANNELS_PER_MESSAGE: usize = 8;
/// Lines above this are not sent, hertz: muscle ends below 500.
const MAX_FREQUENCY_HZ: f64 = 1000.0;

/// Keeps the newest second of all channels, and gives the spectra of a few in turn.
#[derive(Debug)]
pub(crate) struct DenseSpectra {
    rate_hz: f64,
    samples: usize,
    channels: Vec<VecDeque<f64>>,
    next: usize,
}

impl DenseSpectra {
    /// For a stream of `channels` channels at `rate_hz`.
    pub(crate) fn new(rate_hz: f64, channels: usize) -> Self {
        let samples = (WINDOW_SECS * rate_hz).ceil() as usize;
        Self { rate_hz, samples, channels: vec![VecDeque::new(); channels], next: 0 }
    }

    /// Takes a sample. What is lost shifts the signal; a spectrum of one second hardly shows it.
    pub(crate) fn push(&mut self, values: &[f64]) {
        for (kept, value) in self.channels.iter_mut().zip(values) {
            if kept.len() == self.samples {
                kept.pop_front();
            }
            kept.push_back(*value);
        }
    }

    /// The spectra of the channels whose turn it is; none before a second has come.
    pub(crate) fn next_spectra(&mut self) -> Vec<ChannelSpectrum> {
        let count = self.channels.len();
        let mut spectra = Vec::new();
        for _ in 0..count.div_ceil(MESSAGES_PER_SEC).min(MAX_CHANNELS_PER_MESSAGE) {
            let channel = self.next % count;
            self.next = channel + 1;
            let kept = &mut self.channels[channel];
            if kept.len() < self.samples {
                continue;
            }
            if let Some(spectrum) = welch(kept.make_contiguous(), self.rate_hz) {
                let (step_hz, mut density) = (spectrum.bin_width_hz, spectrum.density);
                density.truncate((MAX_FREQUENCY_HZ / step_hz) as usize + 1);
                spectra.push(ChannelSpectrum { channel, step_hz, density });
            }
        }
        spectra
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_channel_of_a_grid_has_its_turn_within_a_second_and_its_own_line() {
        let mut spectra = DenseSpectra::new(4000.0, 64);
        let line_hz = |channel: usize| 4000.0 / 1024.0 * (10 + 3 * channel) as f64;
        for k in 0..5000 {
            let value = |c: usize| (std::f64::consts::TAU * line_hz(c) * f64::from(k) / 4000.0).sin();
            spectra.push(&(0..64).map(value).collect::<Vec<_>>());
            if k == 3000 {
                assert_eq!(spectra.next_spectra(), [], "not yet a second");
            }
        }
        let mut seen: Vec<usize> = Vec::new();
        for _ in 0..MESSAGES_PER_SEC {
            let turn = spectra.next_spectra();
            assert!(turn.len() <= MAX_CHANNELS_PER_MESSAGE);
            for ChannelSpectrum { channel, step_hz, density } in turn {
                let peak = (0..density.len()).max_by(|a, b| density[*a].total_cmp(&density[*b])).unwrap();
                assert!((peak as f64 * step_hz - line_hz(channel)).abs() < 1e-9, "channel {channel}");
                assert!(density.len() as f64 * step_hz < MAX_FREQUENCY_HZ + 2.0 * step_hz);
                seen.push(channel);
            }
        }
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen, (0..64).collect::<Vec<_>>());
    }
}
