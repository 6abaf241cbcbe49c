//! A gaze comes in two messages, where the eye is and where it looks: what belongs together is found by the stamps.

use proact_types::{Point, Vector};
use std::collections::VecDeque;

/// Positions that are kept for directions that come later.
const MAX_POSITIONS: usize = 16;

/// Stamps of messages, ns; 0 for none.
type Stamp = i64;

/// Finds the position of each direction. Pure.
#[derive(Clone, Debug, Default)]
pub struct GazePairs {
    /// Oldest first.
    positions: VecDeque<(Stamp, Point)>,
    /// A direction whose position has not come.
    waiting: Option<(Stamp, Vector)>,
}

impl GazePairs {
    /// Takes a position; a gaze if its direction waited for it.
    pub fn add_position(&mut self, stamp: Stamp, position: Point) -> Option<(Point, Vector)> {
        if self.positions.len() == MAX_POSITIONS {
            self.positions.pop_front();
        }
        self.positions.push_back((stamp, position));
        let (_, direction) = self.waiting.take_if(|(waits, _)| *waits == stamp)?;
        Some((position, direction))
    }

    /// Takes a direction; a gaze with the position of its own stamp. If that has not come it is waited for, until the next
    /// direction; where stamps never agree (each message has its own time) the nearest in time is taken from then on, and
    /// of equally near ones the newest: a stamp that stands still does not bring back an old position.
    pub fn add_direction(&mut self, stamp: Stamp, direction: Vector) -> Option<(Point, Vector)> {
        if stamp == 0 {
            return self.positions.back().map(|(_, position)| (*position, direction));
        }
        let time_difference = |(other, _): &&(Stamp, Point)| (other - stamp).abs();
        let nearest = self.positions.iter().rev().min_by_key(time_difference).copied();
        match nearest {
            Some((other, position)) if other == stamp => {
                self.waiting = None;
                Some((position, direction))
            }
            nearest => {
                let in_vain = self.waiting.replace((stamp, direction)).is_some();
                nearest.filter(|_| in_vain).map(|(_, position)| (position, direction))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f64) -> Point {
        Point::new(x, 0.0, 0.0)
    }

    fn to(y: f64) -> Vector {
        Vector::new(0.0, y, 1.0)
    }

    #[test]
    fn a_direction_has_the_position_of_its_own_stamp_whichever_comes_first() {
        let mut pairs = GazePairs::default();
        assert_eq!(pairs.add_direction(10, to(1.0)), None, "there is none at all");
        assert_eq!(pairs.add_position(10, at(1.0)), Some((at(1.0), to(1.0))));
        assert_eq!(pairs.add_position(20, at(2.0)), None);
        assert_eq!(pairs.add_position(30, at(3.0)), None);
        // A newer position is there already.
        assert_eq!(pairs.add_direction(20, to(2.0)), Some((at(2.0), to(2.0))));
        // The direction is faster than its position.
        assert_eq!(pairs.add_direction(40, to(4.0)), None);
        assert_eq!(pairs.add_position(40, at(4.0)), Some((at(4.0), to(4.0))));
        assert_eq!(pairs.add_direction(50, to(5.0)), None);
        assert_eq!(pairs.add_position(50, at(5.0)), Some((at(5.0), to(5.0))));
    }

    #[test]
    fn messages_without_stamps_or_with_stamps_that_never_agree_still_are_gazes() {
        let mut pairs = GazePairs::default();
        pairs.add_position(0, at(1.0));
        assert_eq!(pairs.add_direction(0, to(1.0)), Some((at(1.0), to(1.0))));
        // A clock that stands still.
        let mut pairs = GazePairs::default();
        for x in [1.0, 2.0] {
            pairs.add_position(7, at(x));
            assert_eq!(
                pairs.add_direction(7, to(0.0)),
                Some((at(x), to(0.0))),
                "of this gaze, not of the one before"
            );
        }
        let mut pairs = GazePairs::default();
        let mut seen = 0;
        for k in 1..100 {
            pairs.add_position(1000 * k, at(k as f64));
            if let Some((position, _)) = pairs.add_direction(1000 * k + 7, to(0.0)) {
                assert_eq!(position, at(k as f64), "the nearest in time");
                seen += 1;
            }
        }
        assert_eq!(seen, 98, "all but the first");
    }
}
