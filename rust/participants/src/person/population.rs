use super::{Learning, PersonTraits, PracticeHistory, stream};
use crate::{OutOfRange, ParticipantOptions};
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

/// How a trait is distributed between people: log-normal.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TraitDistribution {
    /// In the unit of the trait.
    pub median: f64,
    /// Standard deviation of the logarithm.
    pub log_sd: f64,
    /// Correlation of the logarithm with the person's skill, -1 to 1.
    pub skill_correlation: f64,
}

/// The people that are drawn from, as `data/population.toml` describes them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Population {
    /// [`PersonTraits::decision_time_ms`].
    pub decision_time_ms: TraitDistribution,
    /// [`PersonTraits::confusions_per_min`].
    pub confusions_per_min: TraitDistribution,
    /// [`ParticipantOptions::reaction_ms`].
    pub reaction_ms: TraitDistribution,
    /// [`ParticipantOptions::gaze_error_deg`].
    pub gaze_error_deg: TraitDistribution,
    /// [`PersonTraits::depth_error_m`].
    pub depth_error_m: TraitDistribution,
    /// [`ParticipantOptions::place_tolerance_m`].
    pub place_tolerance_m: TraitDistribution,
    /// What is the same for everybody.
    pub person: PersonTraits,
    /// What practice and time do.
    pub learning: Learning,
}

impl Population {
    /// The people that ship with the program.
    ///
    /// # Panics
    /// Never: the file ships with the program and is tested.
    pub fn standard() -> Self {
        toml::from_str(include_str!("../../data/population.toml"))
            .expect("ships with the program and is tested there")
    }

    /// The options of person `index` of those that `master_seed` draws, in a trial after `practice`. Nobody is drawn twice,
    /// and each is the same in all trials.
    pub fn person(&self, master_seed: u64, index: u32, practice: &PracticeHistory) -> ParticipantOptions {
        let mut rng = stream(master_seed, &format!("person {index}"));
        let mut unit = || -> f64 { StandardNormal.sample(&mut rng) };
        let skill = unit();
        let mut draw = |of: &TraitDistribution| {
            let own: f64 = unit();
            let along = of.skill_correlation.clamp(-1.0, 1.0);
            // Nobody further than 2.5 spreads from the median.
            let z = (along * skill + (1.0 - along * along).sqrt() * own).clamp(-2.5, 2.5);
            of.median * (of.log_sd * z).exp()
        };
        let thinking_ms = draw(&self.decision_time_ms);
        let confusions_per_min = draw(&self.confusions_per_min);
        let reaction_ms = draw(&self.reaction_ms);
        let gaze_error_deg = draw(&self.gaze_error_deg);
        let depth_error_m = draw(&self.depth_error_m);
        let place_tolerance_m = draw(&self.place_tolerance_m);
        let traits = PersonTraits {
            decision_time_ms: thinking_ms.min(60_000.0) as u64,
            confusions_per_min: confusions_per_min.min(600.0),
            depth_error_m: depth_error_m.min(0.2),
            ..self.person
        };
        ParticipantOptions {
            reaction_ms: reaction_ms.min(10_000.0) as u64,
            gaze_error_deg: gaze_error_deg.min(45.0),
            place_tolerance_m: place_tolerance_m.clamp(0.001, 0.2),
            person: self.learning.after_practice(&traits, practice),
            ..ParticipantOptions::default()
        }
    }

    /// Checks ranges.
    ///
    /// # Errors
    /// The first key that is out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        let traits = [
            ("decision_time_ms", &self.decision_time_ms),
            ("confusions_per_min", &self.confusions_per_min),
            ("reaction_ms", &self.reaction_ms),
            ("gaze_error_deg", &self.gaze_error_deg),
            ("depth_error_m", &self.depth_error_m),
            ("place_tolerance_m", &self.place_tolerance_m),
        ];
        for (key, TraitDistribution { median, log_sd: spread, skill_correlation: skill }) in traits {
            let right = (0.0..=1e5).contains(median) && (0.0..=3.0).contains(spread) && skill.abs() <= 1.0;
            if !right {
                let got = format!("{{ median = {median}, log_sd = {spread}, skill_correlation = {skill} }}");
                let expected = "a median of 0 to 100000, log_sd of 0 to 3, skill_correlation of -1 to 1";
                return Err(OutOfRange { key, got, expected });
            }
        }
        self.person.check()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::Instruction;

    fn people(count: u32, practice: &PracticeHistory) -> Vec<ParticipantOptions> {
        let population = Population::standard();
        (0..count).map(|index| population.person(7, index, practice)).collect()
    }

    #[test]
    fn people_differ_are_themselves_in_every_trial_and_pass_the_checks_of_a_trial() {
        Population::standard().check().unwrap();
        let drawn = people(300, &PracticeHistory::default());
        drawn.iter().for_each(|options| options.check().unwrap());
        assert_eq!(drawn, people(300, &PracticeHistory::default()));
        let mut times: Vec<u64> = drawn.iter().map(|options| options.person.decision_time_ms).collect();
        times.sort_unstable();
        let (median, population) = (times[150] as f64, Population::standard());
        assert!((median / population.decision_time_ms.median).ln().abs() < 0.25, "{median}");
        let other = population.person(8, 0, &PracticeHistory::default());
        assert_ne!(other, drawn[0], "another study has other people");
    }

    #[test]
    fn who_is_slow_is_confused_more_often() {
        let drawn = people(400, &PracticeHistory::default());
        let logs = |of: &dyn Fn(&PersonTraits) -> f64| -> Vec<f64> {
            drawn.iter().map(|options| of(&options.person).ln()).collect()
        };
        let (x, y) = (logs(&|p| p.decision_time_ms as f64), logs(&|p| p.confusions_per_min));
        let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
        let (mx, my) = (mean(&x), mean(&y));
        let sum = |f: &dyn Fn(f64, f64) -> f64| x.iter().zip(&y).map(|(a, b)| f(a - mx, b - my)).sum::<f64>();
        let r = sum(&|a, b| a * b) / (sum(&|a, _| a * a) * sum(&|_, b| b * b)).sqrt();
        // 0.7 of one and 0.5 of the other go along with skill.
        assert!((0.25..0.45).contains(&r), "{r}");
    }

    #[test]
    fn practice_makes_quicker_fatigue_makes_errors_and_an_instruction_stills_the_body() {
        let population = Population::standard();
        let at = |practice: PracticeHistory| population.person(1, 1, &practice).person;
        let first = at(PracticeHistory::default());
        let third = at(PracticeHistory { trials_with_method: 2, ..PracticeHistory::default() });
        assert!(
            third.decision_time_ms < first.decision_time_ms
                && third.learned_directions > first.learned_directions
        );
        let late =
            at(PracticeHistory { minutes: 90.0, minutes_since_training: 90.0, ..PracticeHistory::default() });
        let retrained = at(PracticeHistory { minutes: 90.0, ..PracticeHistory::default() });
        assert!(late.confusions_per_min > retrained.confusions_per_min);
        assert!(retrained.confusions_per_min > first.confusions_per_min);
        let next_day = at(PracticeHistory { days_before: 1, ..PracticeHistory::default() });
        assert!(next_day.confusions_per_min < first.confusions_per_min);
        let limited =
            at(PracticeHistory { instruction: Instruction::LimitBody, ..PracticeHistory::default() });
        assert!(limited.trunk_share < first.trunk_share);
    }
}
