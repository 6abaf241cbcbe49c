//! How noisy samples are, learned while they come.

use nalgebra::UnitQuaternion;
use proact_types::Vector;

/// Second differences that a level rests on at least.
const MIN_DIFFERENCES: u32 = 6;
/// Each moves the median by this share at most.
const MIN_STEP_SHARE: f64 = 0.03;
/// Of the norm of three Gaussians the median is so many standard deviations.
const MEDIAN_OF_NORM: f64 = 1.538;

/// Standard deviation of one coordinate, from the median of second differences: motion with constant speed has none, and one
/// sample in a few may be wrong. The median is followed by small steps up and down.
#[derive(Clone, Debug)]
pub(crate) struct NoiseLevel {
    level: f64,
    count: u32,
    last: [Option<(f64, Vector)>; 2],
    origin: Option<UnitQuaternion<f64>>,
}

impl NoiseLevel {
    /// Begins with what is usual.
    pub fn new(usual: f64) -> Self {
        Self { level: usual, count: 0, last: [None; 2], origin: None }
    }

    /// The next sample; the level with it.
    pub fn update(&mut self, time: f64, value: Vector) -> f64 {
        let [first, second] = self.last;
        self.last = [second, Some((time, value))];
        if let (Some((t0, first)), Some((t1, second))) = (first, second)
            && time - t0 < 0.1
            && time > t1
        {
            let share = (t1 - t0) / (time - t0);
            let off = (second - first.lerp(&value, share)).norm();
            let one = off / (1.0 + share * share + (1.0 - share) * (1.0 - share)).sqrt() / MEDIAN_OF_NORM;
            // Quick at first, then slowly.
            let step = MIN_STEP_SHARE.max(0.5 / f64::from(self.count + 1));
            self.level *= 1.0 + if one > self.level { step } else { -step };
            self.level = self.level.max(1e-7);
            self.count = self.count.saturating_add(1);
        }
        self.level
    }

    /// A turn as small numbers about one attitude.
    pub fn rotation_vector(&mut self, rotation: &UnitQuaternion<f64>) -> Vector {
        let origin = *self.origin.get_or_insert(*rotation);
        let turn = (rotation * origin.inverse()).scaled_axis();
        if turn.norm() > 0.3 {
            self.origin = Some(*rotation);
            self.last = [None; 2];
            return Vector::zeros();
        }
        turn
    }

    /// The level, once it rests on enough.
    pub fn converged_sd(&self) -> Option<f64> {
        (self.count >= MIN_DIFFERENCES).then_some(self.level)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, Normal};

    #[test]
    fn the_noise_of_a_moving_body_is_learned_though_one_sample_in_ten_is_wild() {
        for truth in [1e-4, 2e-3] {
            let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
            let normal = Normal::new(0.0, truth).unwrap();
            let mut level = NoiseLevel::new(3e-4);
            assert_eq!(level.converged_sd(), None);
            for k in 0..1000 {
                let t = f64::from(k) * 0.01;
                let mut draw = || normal.sample(&mut rng);
                let wild = if k % 10 == 0 { 0.1 } else { 0.0 };
                level.update(t, Vector::new(draw() + 0.3 * t, draw() + wild, draw()));
            }
            let found = level.converged_sd().unwrap();
            // Three of ten second differences hold a wild sample, which moves the median up.
            assert!(found > 0.8 * truth && found < 1.6 * truth, "{found}");
        }
    }
}
