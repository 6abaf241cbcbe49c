use super::{PersonTraits, stream};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::collections::BTreeMap;

/// After a movement the guess of the speed goes this share of the way to what was seen. Assumed.
const LEARNING_RATE: f64 = 0.6;
/// A guess is not off by more than this factor.
const MAX_SPEED_FACTOR: f64 = 5.0;

/// What the person knows of how WE and WF move each joint and axis, learnt by moving them.
pub(crate) struct MotorSkill {
    rng: ChaCha8Rng,
    traits: PersonTraits,
    modes: BTreeMap<u8, ModeKnowledge>,
}

/// What is known of one joint or axis.
#[derive(Clone, Copy, Debug)]
struct ModeKnowledge {
    direction: bool,
    /// Guess of its speed over the true one of an unhurried user.
    speed_factor: f64,
}

impl MotorSkill {
    pub(crate) fn new(traits: &PersonTraits, seed: u64) -> Self {
        Self { rng: stream(seed, "skill"), traits: *traits, modes: BTreeMap::new() }
    }

    fn knowledge_of(&mut self, mode: u8) -> &mut ModeKnowledge {
        let Self { rng, traits, modes } = self;
        modes.entry(mode).or_insert_with(|| {
            let direction =
                traits.learned_directions >= 1.0 || rng.random::<f64>() < traits.learned_directions;
            let unit: f64 = if traits.speed_estimate_log_sd > 0.0 { StandardNormal.sample(rng) } else { 0.0 };
            let factor =
                (traits.speed_estimate_log_sd * unit).exp().clamp(1.0 / MAX_SPEED_FACTOR, MAX_SPEED_FACTOR);
            ModeKnowledge { direction, speed_factor: factor }
        })
    }

    /// Whether a movement of `mode` is begun in the direction that is meant: a guess while it is not known.
    pub(crate) fn starts_in_intended_direction(&mut self, mode: u8) -> bool {
        let known = self.knowledge_of(mode).direction;
        match (known, self.traits.wrong_direction_probability) {
            (true, wrong) if wrong <= 0.0 => true,
            (true, wrong) => self.rng.random::<f64>() >= wrong,
            (false, _) => self.rng.random(),
        }
    }

    /// How fast `mode` is thought to move, if practice has it at `speed`.
    pub(crate) fn speed(&mut self, mode: u8, speed: f64) -> f64 {
        speed * self.knowledge_of(mode).speed_factor
    }

    /// A movement of `mode` was seen that brought `share` of what was expected of it; negative if it went the other way.
    pub(crate) fn update_from_movement(&mut self, mode: u8, share: f64) {
        let known = self.knowledge_of(mode);
        known.direction = true;
        let seen = share.abs();
        // Something that was met says nothing of the speed.
        if self.traits.speed_estimate_log_sd > 0.0 && seen > 0.3 {
            let known = self.knowledge_of(mode);
            known.speed_factor = (known.speed_factor * seen.powf(LEARNING_RATE))
                .clamp(1.0 / MAX_SPEED_FACTOR, MAX_SPEED_FACTOR);
        }
    }

    /// An imagined movement of `amount`, as it is imagined.
    pub(crate) fn predicted_amount(&mut self, amount: f64) -> f64 {
        if self.traits.forward_model_relative_error <= 0.0 {
            return amount;
        }
        let unit: f64 = StandardNormal.sample(&mut self.rng);
        amount * (1.0 + self.traits.forward_model_relative_error * unit.clamp(-2.0, 2.0))
    }

    /// Whether the trunk is used where it could do what is to be done.
    pub(crate) fn uses_trunk(&mut self) -> bool {
        self.draw_bernoulli(self.traits.trunk_share)
    }

    /// Whether something wrong is noticed at a look.
    pub(crate) fn detects_error(&mut self) -> bool {
        self.draw_bernoulli(self.traits.error_detection_probability)
    }

    /// Whether a lock is forgotten.
    pub(crate) fn omits_lock(&mut self) -> bool {
        self.draw_bernoulli(self.traits.lock_omission_probability)
    }

    /// Whether WE is let go before the arm has arrived.
    pub(crate) fn releases_early(&mut self) -> bool {
        self.draw_bernoulli(self.traits.early_release_probability)
    }

    /// Draws nothing where there is nothing to draw.
    fn draw_bernoulli(&mut self, probability: f64) -> bool {
        probability >= 1.0 || (probability > 0.0 && self.rng.random::<f64>() < probability)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_guessed_until_a_movement_was_seen() {
        let traits = PersonTraits { learned_directions: 0.0, ..PersonTraits::default() };
        let right = |seed: u64, seen: bool| {
            let mut skill = MotorSkill::new(&traits, seed);
            if seen {
                skill.update_from_movement(3, -1.0);
            }
            skill.starts_in_intended_direction(3)
        };
        let guessed = (0..400).filter(|seed| right(*seed, false)).count();
        assert!((160..240).contains(&guessed), "{guessed} of 400");
        assert!((0..400).all(|seed| right(seed, true)));
    }

    #[test]
    fn a_guess_of_a_speed_comes_near_what_is_seen_within_a_few_movements() {
        let traits = PersonTraits { speed_estimate_log_sd: 0.6, ..PersonTraits::default() };
        let mut skill = MotorSkill::new(&traits, 9);
        let off = |skill: &mut MotorSkill| (skill.speed(1, 0.4) / 0.4).ln().abs();
        let before = off(&mut skill);
        for _ in 0..4 {
            // Who takes a joint for slower than it is sees it go further.
            let share = 0.4 / skill.speed(1, 0.4);
            skill.update_from_movement(1, share);
        }
        assert!(before > 0.1 && off(&mut skill) < before / 10.0, "{before}");
    }

    #[test]
    fn nobody_in_particular_knows_everything() {
        let mut skill = MotorSkill::new(&PersonTraits::default(), 1);
        assert!(
            (0..20).all(|mode| skill.starts_in_intended_direction(mode) && skill.speed(mode, 0.4) == 0.4)
        );
        assert_eq!(skill.predicted_amount(0.3), 0.3);
        assert!(
            !skill.uses_trunk() && skill.detects_error() && !skill.omits_lock() && !skill.releases_early()
        );
    }
}
