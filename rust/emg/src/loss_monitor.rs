use crate::{LivenessConfig, SignalFault};
use proact_types::SimTime;

/// How many samples came and were lost in each of the newest ticks.
#[derive(Clone, Debug)]
pub(crate) struct LossMonitor {
    /// Usable samples, and lost or unusable ones, per tick, a ring.
    ticks: Vec<[u32; 2]>,
    sums: [u64; 2],
    now: SimTime,
    /// When the stream began, or began again.
    since: Option<SimTime>,
    /// When the last sample came.
    last: SimTime,
}

impl LossMonitor {
    pub(crate) fn new(span: usize) -> Self {
        Self {
            ticks: vec![[0; 2]; span.max(1)],
            sums: [0; 2],
            now: SimTime(0),
            since: None,
            last: SimTime(0),
        }
    }

    pub(crate) fn advance_to(&mut self, now: SimTime) {
        let span = self.ticks.len() as u64;
        let passed = now.millis_since(self.now).min(span);
        for tick in (now.0 + 1).saturating_sub(passed)..=now.0 {
            let index = (tick % span) as usize;
            for (sum, old) in self.sums.iter_mut().zip(std::mem::take(&mut self.ticks[index])) {
                *sum -= u64::from(old);
            }
        }
        self.now = now;
    }

    pub(crate) fn add(&mut self, lost: u64, usable: bool) {
        let span = self.ticks.len() as u64;
        // After a silence as long as the span there is nothing to compare with: a new beginning, and what was lost
        // meanwhile was lost in that silence.
        let begins = self.since.is_none() || self.now.millis_since(self.last) >= span;
        if begins {
            self.since = Some(self.now);
            self.ticks.fill([0; 2]);
            self.sums = [0; 2];
        }
        self.last = self.now;
        let lost = if begins { 0 } else { lost };
        let lost = u32::try_from(lost).unwrap_or(u32::MAX / 2);
        let index = (self.now.0 % span) as usize;
        for (k, count) in [u32::from(usable), lost + u32::from(!usable)].into_iter().enumerate() {
            let before = self.ticks[index][k];
            self.ticks[index][k] = before.saturating_add(count);
            self.sums[k] += u64::from(self.ticks[index][k] - before);
        }
    }

    pub(crate) fn fault(&self, config: &LivenessConfig, rate_hz: f64) -> Option<SignalFault> {
        let span = self.ticks.len() as f64;
        let [usable, lost] = self.sums.map(|sum| sum as f64);
        let nominal = span * rate_hz / 1000.0;
        if lost > config.max_lost_share * nominal.max(lost + usable) {
            return Some(SignalFault::Lossy(lost / (lost + usable)));
        }
        // The rate is known once the span is full.
        if self.since.is_none_or(|since| self.now.millis_since(since) < self.ticks.len() as u64) {
            return None;
        }
        let share = (usable + lost) / nominal;
        let [min, max] = config.rate_ratio_limits;
        (share < min || share > max).then_some(SignalFault::WrongRate(share * rate_hz))
    }
}
