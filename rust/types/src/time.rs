use serde::{Deserialize, Serialize};

/// Length of one tick, seconds.
pub const TICK_SECS: f64 = 1e-3;

/// Simulated time since the start of the trial, in whole ticks of 1 ms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(transparent)]
pub struct SimTime(#[cfg_attr(feature = "ts", ts(type = "number"))] pub u64);

impl SimTime {
    /// The tick nearest to `secs`; negative and non-finite seconds give zero.
    pub fn from_secs(secs: f64) -> Self {
        SimTime((secs / TICK_SECS).round() as u64)
    }

    /// Seconds since the start of the trial.
    pub fn as_secs(self) -> f64 {
        self.0 as f64 * TICK_SECS
    }

    /// Milliseconds since `earlier`; zero if `earlier` is not in the past.
    pub fn millis_since(self, earlier: SimTime) -> u64 {
        self.0.saturating_sub(earlier.0)
    }

    /// The time `millis` later.
    pub fn plus_millis(self, millis: u64) -> Self {
        SimTime(self.0 + millis)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_become_whole_ticks_and_nonsense_becomes_zero() {
        assert_eq!(SimTime::from_secs(1.2345), SimTime(1235));
        assert_eq!(SimTime::from_secs(-3.0), SimTime(0));
        assert_eq!(SimTime::from_secs(f64::NAN), SimTime(0));
        assert_eq!(SimTime(5).millis_since(SimTime(9)), 0);
    }
}
