use super::{PersonTraits, stream};
use proact_types::SimTime;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, LogNormal};

/// The time that decisions take: log-normal, as response times are.
pub(crate) struct DecisionTimer {
    rng: ChaCha8Rng,
    distribution_ms: Option<LogNormal<f64>>,
    until: Option<SimTime>,
}

impl DecisionTimer {
    pub(crate) fn new(traits: &PersonTraits, seed: u64) -> Self {
        let median = traits.decision_time_ms as f64;
        let time_ms = LogNormal::new(median.ln(), traits.decision_time_log_sd).ok().filter(|_| median > 0.0);
        Self { rng: stream(seed, "thinking"), distribution_ms: time_ms, until: None }
    }

    /// False while a decision is being thought about, true when it is made. The call after that begins the next one.
    pub(crate) fn is_decided(&mut self, now: SimTime) -> bool {
        let Some(time_ms) = &self.distribution_ms else { return true };
        let rng = &mut self.rng;
        let until = *self.until.get_or_insert_with(|| now.plus_millis(time_ms.sample(rng) as u64));
        if now < until {
            return false;
        }
        self.until = None;
        true
    }

    /// What was being thought about is not the question any more.
    pub(crate) fn cancel(&mut self) {
        self.until = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decisions(traits: &PersonTraits, seed: u64) -> Vec<u64> {
        let mut thinking = DecisionTimer::new(traits, seed);
        let mut began = 0;
        let over = |now| {
            let over = thinking.is_decided(SimTime(now));
            over.then(|| now - std::mem::replace(&mut began, now + 1))
        };
        (0..2_000_000).filter_map(over).take(500).collect()
    }

    #[test]
    fn half_of_the_decisions_take_longer_than_the_median_and_nobody_takes_none() {
        let traits =
            PersonTraits { decision_time_ms: 1500, decision_time_log_sd: 0.5, ..PersonTraits::default() };
        let mut times = decisions(&traits, 3);
        assert_eq!(times, decisions(&traits, 3), "the same seed");
        assert_ne!(times, decisions(&traits, 4), "another seed");
        times.sort_unstable();
        assert!((1300..1700).contains(&times[250]), "{}", times[250]);
        assert!((times[420] as f64 / times[250] as f64) > 1.4, "{} of {}", times[420], times[250]);
        assert_eq!(decisions(&PersonTraits::default(), 3), vec![0; 500]);
    }
}
