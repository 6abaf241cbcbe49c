/// Weight of a sample's deviation in the line that stamps are expected on.
const TIMESTAMP_GAIN: f64 = 0.05;
/// Weight of a sample's deviation in the stream's jitter.
const JITTER_GAIN: f64 = 0.002;
/// Jitter that a stream is taken to have at first, seconds.
const INITIAL_JITTER_SECS: f64 = 0.002;
/// A stamp is on the line if it is no further from it than so many times the jitter.
const GAP_JITTER_FACTOR: f64 = 5.0;
/// However unsteady the stamps, a hole of this length is one, seconds.
const MAX_JITTER_SECS: f64 = 0.05;
/// A stamp so far off is of another clock, seconds.
const CLOCK_RESET_SECS: f64 = 1.0;

/// Finds the losses of a stream from its time stamps.
///
/// Stamps are expected on a line of the nominal rate that follows them slowly. One that is later by more than the
/// stream's own jitter comes after a gap. A stream whose sender stamps by its sample clock shows the loss of a single
/// sample; one that stamps packets when they arrive shows what is longer than its unsteadiness.
#[derive(Clone, Debug)]
pub(super) struct TimestampNumbering {
    period_secs: f64,
    jitter_secs: f64,
    /// Expected stamp of the next sample, and when the last one arrived, seconds.
    expected_secs: Option<(f64, f64)>,
    clock_resets: u64,
}

impl TimestampNumbering {
    pub(super) fn new(rate_hz: f64) -> TimestampNumbering {
        TimestampNumbering {
            period_secs: 1.0 / rate_hz,
            jitter_secs: INITIAL_JITTER_SECS,
            expected_secs: None,
            clock_resets: 0,
        }
    }

    /// Times that the sender's clock jumped.
    pub(super) fn clock_resets(&self) -> u64 {
        self.clock_resets
    }

    /// Samples lost before the one stamped `stamp`, finite, which arrived at `arrived` on the host's clock.
    pub(super) fn lost_before(&mut self, stamp: f64, arrived: f64) -> u64 {
        let period = self.period_secs;
        let Some((due, before)) = self.expected_secs.replace((stamp + period, arrived)) else { return 0 };
        let off = stamp - due;
        let tolerance =
            (GAP_JITTER_FACTOR * self.jitter_secs).max(0.5 * period).min(MAX_JITTER_SECS.max(1.5 * period));
        self.jitter_secs += JITTER_GAIN * (off.abs().min(tolerance) - self.jitter_secs);
        let silent = arrived - before;
        if off.abs() <= tolerance {
            self.expected_secs = Some((due + period + TIMESTAMP_GAIN * off, arrived));
            0
        } else if off < -CLOCK_RESET_SECS || off > silent + CLOCK_RESET_SECS {
            // Another clock does not tell how much is missing; the time that passed here does.
            self.clock_resets += 1;
            ((silent / period).round() as u64).max(1)
        } else if off > 0.0 {
            (off / period).round() as u64
        } else {
            // What was taken for a gap was a late stamp; the counter has stepped and cannot go back.
            0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random_stream;
    use rand::RngExt;

    /// Losses before each of the samples stamped and received at the same time.
    fn losses(
        numbering: &mut TimestampNumbering,
        stamps: impl IntoIterator<Item = f64>,
    ) -> Vec<(usize, u64)> {
        let lost = stamps.into_iter().map(|stamp| numbering.lost_before(stamp, stamp)).enumerate();
        lost.filter(|(_, lost)| *lost > 0).collect()
    }

    #[test]
    fn exact_stamps_show_the_loss_of_one_sample_and_of_many() {
        let mut numbering = TimestampNumbering::new(1000.0);
        let kept = (0..5000).filter(|k| *k != 3000 && !(4000..4016).contains(k));
        let found = losses(&mut numbering, kept.map(|k| 7e5 + f64::from(k) / 1000.0));
        assert_eq!(found, [(3000, 1), (3999, 16)]);
        assert_eq!(numbering.clock_resets(), 0);
    }

    #[test]
    fn a_rate_that_is_not_quite_the_nominal_one_loses_nothing() {
        for true_rate in [990.0, 1000.3, 1010.0] {
            let mut numbering = TimestampNumbering::new(1000.0);
            let found = losses(&mut numbering, (0..60_000).map(|k| f64::from(k) / true_rate));
            assert_eq!(found, [], "{true_rate}");
        }
    }

    #[test]
    fn a_sender_on_another_clock_costs_the_time_that_passed_here() {
        let mut numbering = TimestampNumbering::new(200.0);
        assert_eq!(losses(&mut numbering, (0..400).map(|k| 1e6 + f64::from(k) / 200.0)), []);
        assert_eq!(numbering.lost_before(50.0, 1e6 + 2.0 + 3.0), 601, "silent for 3 s and a sample");
        assert_eq!(numbering.lost_before(50.005, 1e6 + 5.005), 0);
        assert_eq!(numbering.lost_before(9e9, 1e6 + 5.01), 1);
        assert_eq!(numbering.clock_resets(), 2);
    }

    #[test]
    fn late_packets_are_no_gaps_and_a_lost_packet_is_one() {
        for seed in 0..50 {
            // Packets of 16 stamped when they arrive, up to 4 ms late; one is lost.
            let mut rng = random_stream(seed, "emg/test/late");
            let (mut numbering, mut found) = (TimestampNumbering::new(1000.0), Vec::new());
            for packet in (0..300).filter(|packet| *packet != 200) {
                let late = rng.random_range(0.0..0.004);
                let stamps = (0..16).map(|k| f64::from(16 * packet + k) / 1000.0 + late);
                let lost = losses(&mut numbering, stamps).iter().map(|(_, lost)| lost).sum::<u64>();
                if lost > 0 {
                    found.push((packet, lost));
                }
            }
            // The stamps are no better than their unsteadiness, and so is the length of the gap.
            assert!(matches!(found[..], [(201, 12..=20)]), "seed {seed}: {found:?}");
        }
    }
}
