//! Datagrams that cannot be used: counted, and reported once a second with the reason of the first.

use std::time::{Duration, Instant};

/// Shortest time between two reports.
const REPORT_EVERY: Duration = Duration::from_secs(1);

/// Counts the datagrams of one receiver that were refused.
#[derive(Clone, Debug, Default)]
pub struct RefusedDatagrams {
    total: u64,
    unreported: u64,
    first_reason: String,
    reported_at: Option<Instant>,
}

impl RefusedDatagrams {
    /// One more was refused.
    pub fn record_refusal(&mut self, reason: impl ToString) {
        if self.unreported == 0 {
            self.first_reason = reason.to_string();
        }
        self.unreported += 1;
        self.total += 1;
    }

    /// All so far.
    pub fn total(&self) -> u64 {
        self.total
    }

    /// The report that is due at `now`: none if nothing was refused since the last one, or that is less than a second ago.
    pub fn report(&mut self, now: Instant) -> Option<String> {
        let waits = self.reported_at.is_some_and(|at| now.saturating_duration_since(at) < REPORT_EVERY);
        if self.unreported == 0 || waits {
            return None;
        }
        self.reported_at = Some(now);
        let (count, total) = (std::mem::take(&mut self.unreported), self.total);
        let datagrams = if count == 1 { "datagram" } else { "datagrams" };
        Some(format!(
            "{count} {datagrams} refused, {total} so far; reason of the first: {}",
            self.first_reason
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refused_datagrams_are_reported_at_once_and_then_once_a_second_with_the_reason_of_the_first() {
        let (mut refused, start) = (RefusedDatagrams::default(), Instant::now());
        let mut reports = Vec::new();
        // A hundred a second for 2.5 s.
        for n in 0..250_u64 {
            let now = start + Duration::from_millis(10 * n);
            refused.record_refusal(format!("reason {n}"));
            reports.extend(refused.report(now));
        }
        assert_eq!(
            reports,
            [
                "1 datagram refused, 1 so far; reason of the first: reason 0",
                "100 datagrams refused, 101 so far; reason of the first: reason 1",
                "100 datagrams refused, 201 so far; reason of the first: reason 101",
            ]
        );
        assert_eq!(refused.total(), 250);
        assert!(refused.report(start + Duration::from_secs(4)).is_some_and(|text| text.starts_with("49 ")));
        assert_eq!(refused.report(start + Duration::from_secs(9)), None);
    }
}
