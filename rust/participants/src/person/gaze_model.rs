use super::{PersonTraits, stream};
use proact_types::{Point, SimTime};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// How long one look lasts, ms: fixations in manipulation tasks take some 200 to 800. Assumed.
const FIXATION_MS: std::ops::Range<u64> = 250..800;

/// Where the eyes are: on what the task needs, with glances at the hand while something moves. A change takes the
/// latency of a saccade.
pub(crate) struct GazeModel {
    rng: ChaCha8Rng,
    saccade_ms: u64,
    hand_share: f64,
    on_hand: bool,
    fixation_until: SimTime,
    /// What the eyes are to go to, and since when.
    saccade_target: Option<(Point, SimTime)>,
    fixation_point: Option<Point>,
}

/// Points nearer to each other than this are one thing to look at, metres.
const SAME_TARGET_M: f64 = 0.02;

impl GazeModel {
    pub(crate) fn new(traits: &PersonTraits, seed: u64) -> Self {
        Self {
            rng: stream(seed, "eyes"),
            saccade_ms: traits.saccade_ms,
            hand_share: traits.hand_glance_share,
            on_hand: false,
            fixation_until: SimTime(0),
            saccade_target: None,
            fixation_point: None,
        }
    }

    /// Where the eyes point, when the task asks for `target` and the `hand` may be glanced at because something moves.
    pub(crate) fn step(&mut self, now: SimTime, target: Point, hand: Option<Point>) -> Point {
        let glanced = match hand {
            Some(hand) if self.hand_share > 0.0 => {
                if now >= self.fixation_until {
                    self.fixation_until = now.plus_millis(self.rng.random_range(FIXATION_MS));
                    self.on_hand = self.rng.random::<f64>() < self.hand_share;
                }
                if self.on_hand { hand } else { target }
            }
            _ => {
                self.on_hand = false;
                target
            }
        };
        let at = *self.fixation_point.get_or_insert(glanced);
        if self.saccade_ms == 0 || (glanced - at).norm() < SAME_TARGET_M {
            // Followed smoothly.
            (self.fixation_point, self.saccade_target) = (Some(glanced), None);
            return glanced;
        }
        let since = match self.saccade_target {
            Some((wanted, since)) if (wanted - glanced).norm() < SAME_TARGET_M => since,
            _ => now,
        };
        self.saccade_target = Some((glanced, since));
        if now.millis_since(since) >= self.saccade_ms {
            (self.fixation_point, self.saccade_target) = (Some(glanced), None);
            return glanced;
        }
        at
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_saccade_comes_late_and_the_hand_gets_its_share_of_looks() {
        let traits = PersonTraits { saccade_ms: 200, hand_glance_share: 0.3, ..PersonTraits::default() };
        let mut eyes = GazeModel::new(&traits, 1);
        let (block, place_point, hand) =
            (Point::new(0.0, 0.0, 0.0), Point::new(0.0, 0.3, 0.0), Point::new(0.0, 0.0, 0.3));
        assert_eq!(eyes.step(SimTime(0), block, None), block);
        assert_eq!(eyes.step(SimTime(10), place_point, None), block);
        assert_eq!(eyes.step(SimTime(200), place_point, None), block);
        assert_eq!(eyes.step(SimTime(210), place_point, None), place_point);
        let gaze_points: Vec<Point> =
            (300..300_000).step_by(17).map(|now| eyes.step(SimTime(now), place_point, Some(hand))).collect();
        let on_hand = gaze_points.iter().filter(|at| **at == hand).count() as f64 / gaze_points.len() as f64;
        assert!((0.22..0.38).contains(&on_hand), "{on_hand}");
    }

    #[test]
    fn nobody_in_particular_looks_at_what_the_task_asks_for_at_once() {
        let mut eyes = GazeModel::new(&PersonTraits::default(), 1);
        for k in 0..5 {
            let target = Point::new(f64::from(k), 0.0, 0.0);
            assert_eq!(eyes.step(SimTime(k as u64), target, Some(Point::origin())), target);
        }
    }
}
