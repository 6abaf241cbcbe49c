use crate::SimTime;

/// Something that has to stay in a target: since when it is in it, and how often it has left it again.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TargetDwell {
    entered_at: Option<SimTime>,
    overshoots: u32,
}

impl TargetDwell {
    /// A target that comes at `now`, in which it is already or not.
    pub fn begin(now: SimTime, inside: bool) -> TargetDwell {
        TargetDwell { entered_at: inside.then_some(now), overshoots: 0 }
    }

    /// Whether it is `inside` at `now`. When it entered, once it has stayed for `millis`.
    pub fn step(&mut self, now: SimTime, inside: bool, millis: u64) -> Option<SimTime> {
        match self.entered_at {
            None if inside => self.entered_at = Some(now),
            Some(_) if !inside => {
                self.overshoots += 1;
                self.entered_at = None;
            }
            _ => {}
        }
        self.entered_at.filter(|since| now.millis_since(*since) >= millis)
    }

    /// Since when it is in the target; none while it is not.
    pub fn entered_at(&self) -> Option<SimTime> {
        self.entered_at
    }

    /// How often it left the target before it had stayed for long enough.
    pub fn overshoots(&self) -> u32 {
        self.overshoots
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_an_unbroken_stay_counts_and_each_exit_is_an_overshoot() {
        let mut dwell = TargetDwell::begin(SimTime(0), false);
        let inside = |tick: u64| (10..20).contains(&tick) || tick == 25 || tick >= 30;
        let done: Vec<Option<SimTime>> =
            (0..60).map(|tick| dwell.step(SimTime(tick), inside(tick), 15)).collect();
        assert_eq!(done.iter().position(Option::is_some), Some(45));
        assert_eq!((done[45], dwell.overshoots()), (Some(SimTime(30)), 2));
        let mut there = TargetDwell::begin(SimTime(7), true);
        assert_eq!(
            (there.entered_at(), there.step(SimTime(9), true, 2)),
            (Some(SimTime(7)), Some(SimTime(7)))
        );
    }
}
