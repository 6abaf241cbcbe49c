use proact_types::{SimTime, TargetDwell};

/// One goal that something is brought to and kept at: a point to a ball, or joints to a posture.
///
/// The clock begins when the goal is shown and ends when it was entered for the last time: the reaction counts, the dwell
/// does not.
#[derive(Clone, Debug)]
pub(crate) struct GoalAttempt {
    shown_at: SimTime,
    start: Vec<f64>,
    last: Vec<f64>,
    /// Way so far, in the unit of the coordinates.
    path: f64,
    dwell: TargetDwell,
}

/// How it went.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct GoalAttemptResult {
    /// It stayed for the whole dwell.
    pub(crate) reached: bool,
    /// Until it was entered for the last time; the whole time where it was not reached.
    pub(crate) seconds: f64,
    /// As often it was left before the dwell was over.
    pub(crate) overshoots: u32,
    /// Straight way over the way that was taken, 0 to 1; none where it was not reached, or without a way.
    pub(crate) path_efficiency: Option<f64>,
    /// Where it began and where it ended.
    pub(crate) from: Vec<f64>,
    pub(crate) to: Vec<f64>,
}

impl GoalAttempt {
    /// A goal that is shown at `now`, while the coordinates are `at`.
    pub(crate) fn new(now: SimTime, at: &[f64]) -> Self {
        Self {
            shown_at: now,
            start: at.to_vec(),
            last: at.to_vec(),
            path: 0.0,
            dwell: TargetDwell::default(),
        }
    }

    /// Advances to `now`; what came of it once it was `inside` for the dwell, or time is up.
    pub(crate) fn step(
        &mut self,
        now: SimTime,
        at: &[f64],
        inside: bool,
        dwell: SimTime,
        limit: SimTime,
    ) -> Option<GoalAttemptResult> {
        self.path += distance(&self.last, at);
        self.last.copy_from_slice(at);
        let entered = self.dwell.step(now, inside, dwell.0);
        if entered.is_none() && now.millis_since(self.shown_at) < limit.0 {
            return None;
        }
        let efficiency = distance(&self.start, at) / self.path;
        Some(GoalAttemptResult {
            reached: entered.is_some(),
            seconds: entered.unwrap_or(now).millis_since(self.shown_at) as f64 / 1e3,
            overshoots: self.dwell.overshoots(),
            path_efficiency: (entered.is_some() && self.path > 0.0).then_some(efficiency),
            from: self.start.clone(),
            to: at.to_vec(),
        })
    }
}

pub(crate) fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}
