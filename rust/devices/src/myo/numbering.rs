use super::protocol::{EMG_CHARACTERISTIC_ORDER, PACKET_SAMPLES, RATE_HZ};
use crate::gforce::Characteristic;
use std::time::Duration;

/// After a silence of this length the clock tells how many whole turns of the four characteristics are missing. Shorter
/// ones may be a radio that was late and lost nothing.
const GAP_SILENCE: Duration = Duration::from_millis(500);

/// Numbers the samples of a Myo, which have no numbers. Notifications come on four characteristics in turn, so that up to three
/// lost in a row are known. Four, which are 40 ms, or a multiple show in a silence of half a second or longer only.
#[derive(Clone, Debug, Default)]
pub(super) struct RoundRobinNumbering {
    /// Place of the last characteristic in the turn; none before the first and after the link was lost.
    last_index: Option<usize>,
    last_arrival: Option<Duration>,
    next_counter: u64,
}

impl RoundRobinNumbering {
    /// The link was lost: the turn may begin anywhere, and only the clock knows what is missing.
    pub(super) fn restart(&mut self) {
        self.last_index = None;
    }

    /// The number of the first sample of the notification that arrived on `characteristic` at `arrived`, and how many are lost
    /// before it. None if it is none of the four.
    pub(super) fn number(&mut self, characteristic: Characteristic, arrived: Duration) -> Option<(u64, u64)> {
        let index = EMG_CHARACTERISTIC_ORDER.iter().position(|emg| *emg == characteristic)?;
        let period = PACKET_SAMPLES as f64 / f64::from(RATE_HZ);
        let silent = self.last_arrival.map(|previous| arrived.saturating_sub(previous));
        let passed = silent.map_or(1.0, |silent| silent.as_secs_f64() / period);
        let notifications = match self.last_index {
            None => passed.round().max(1.0) as u64,
            Some(last) => {
                // One to four: the same again comes after a whole turn.
                let step =
                    (index + EMG_CHARACTERISTIC_ORDER.len() - last - 1) % EMG_CHARACTERISTIC_ORDER.len() + 1;
                let turns = match silent {
                    Some(silent) if silent >= GAP_SILENCE => {
                        ((passed - step as f64) / EMG_CHARACTERISTIC_ORDER.len() as f64).round().max(0.0)
                            as u64
                    }
                    _ => 0,
                };
                step as u64 + turns * EMG_CHARACTERISTIC_ORDER.len() as u64
            }
        };
        (self.last_index, self.last_arrival) = (Some(index), Some(arrived));
        let lost = (notifications - 1) * PACKET_SAMPLES as u64;
        let first = self.next_counter + lost;
        self.next_counter = first + PACKET_SAMPLES as u64;
        Some((first, lost))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Losses before the notifications of these numbers, each as late as said, milliseconds.
    fn losses(plan: &[(u64, u64)]) -> Vec<u64> {
        let mut numbering = RoundRobinNumbering::default();
        let mut number = |&(k, late): &(u64, u64)| {
            let at = Duration::from_millis(10 * k + late);
            numbering.number(EMG_CHARACTERISTIC_ORDER[(k % 4) as usize], at).map(|(first, lost)| {
                assert_eq!(first, 2 * k - 2 * plan[0].0, "the number is the device's");
                lost
            })
        };
        plan.iter().filter_map(&mut number).collect()
    }

    #[test]
    fn up_to_three_lost_in_a_row_are_known_by_the_turn() {
        assert_eq!(losses(&[(0, 0), (1, 0), (3, 0), (6, 0), (10, 0)]), [0, 0, 2, 4, 6]);
        assert_eq!(losses(&[(2, 0), (3, 0), (4, 0)]), [0, 0, 0], "it begins anywhere");
    }

    #[test]
    fn a_late_radio_loses_nothing_and_a_silence_is_as_long_as_it_was() {
        // 300 ms late, then all that waited at once.
        let burst: Vec<(u64, u64)> =
            (0..40).map(|k| (k, if k < 5 { 0 } else { 350_u64.saturating_sub(10 * k) })).collect();
        assert!(losses(&burst).iter().all(|lost| *lost == 0));
        assert_eq!(losses(&[(0, 0), (101, 0), (102, 3)]), [0, 200, 0]);
        assert_eq!(losses(&[(0, 0), (101, 14), (102, 3)]), [0, 200, 0], "the turn corrects the clock");
    }

    #[test]
    fn after_a_lost_link_the_clock_counts() {
        let mut numbering = RoundRobinNumbering::default();
        assert_eq!(numbering.number(EMG_CHARACTERISTIC_ORDER[2], Duration::ZERO), Some((0, 0)));
        numbering.restart();
        assert_eq!(numbering.number(EMG_CHARACTERISTIC_ORDER[0], Duration::from_secs(3)), Some((600, 598)));
        assert_eq!(numbering.number(Characteristic::Battery, Duration::from_secs(3)), None);
    }
}
