//! How likely a study is to show a difference that is there, by simulation.
//!
//! A run draws people, gives each the trials of the design in the design's order, lets some leave, and tests what is left as a report
//! does: Friedman over all conditions, Wilcoxon with Holm over the pairs, of the means of people. The share of runs that find a
//! difference is the power.

use crate::statistics::{RepeatedMeasures, friedman_asymptotic_p, holm_of_pairs, wilcoxon_of_pairs};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, Normal};
use std::collections::BTreeMap;

/// What is expected of each condition.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExpectedEffect {
    /// By condition.
    pub conditions: BTreeMap<String, ExpectedScore>,
    /// Share of the variance that is between people, 0 to 1; the rest is between trials of a person. 0.4 is near what the table of the
    /// ProACT paper gives for methods A and B (a beta-binomial fit).
    #[serde(default = "default_intraclass_correlation")]
    pub intraclass_correlation: f64,
    /// How far a person who is good under one condition is good under all, 0 to 1: assumed.
    #[serde(default = "default_condition_correlation")]
    pub condition_correlation: f64,
    /// What a trial's score gains with each trial before it: learning, or less than zero for fatigue.
    #[serde(default)]
    pub gain_per_trial: f64,
    /// Smallest possible score of a trial.
    #[serde(default)]
    pub min_score: Option<f64>,
    /// Largest possible score of a trial.
    #[serde(default)]
    pub max_score: Option<f64>,
    /// Scores are multiples of this.
    #[serde(default)]
    pub score_step: Option<f64>,
}

/// The score of a trial under a condition, before its bounds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExpectedScore {
    /// Mean over people and trials.
    pub mean: f64,
    /// Standard deviation over people and trials.
    pub sd: f64,
}

fn default_intraclass_correlation() -> f64 {
    0.4
}

fn default_condition_correlation() -> f64 {
    0.5
}

/// Where scores come from.
#[derive(Clone, Debug, PartialEq)]
pub enum ScoreModel {
    /// From what is expected.
    Expected(ExpectedEffect),
    /// From people of a pilot, drawn again with all their trials: `[people][conditions][trials]`.
    Pilot(Vec<Vec<Vec<f64>>>),
}

/// What a simulation of power needs.
#[derive(Clone, Debug, PartialEq)]
pub struct PowerOptions {
    /// Simulated studies.
    pub runs: u32,
    /// A chance below this is a difference.
    pub alpha: f64,
    /// Chance of a person to leave before the end, at any of their trials.
    pub dropout_probability: f64,
    /// Of all that is drawn.
    pub seed: u64,
}

/// A share of runs, with what so few runs leave open.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Proportion {
    /// The share, 0 to 1.
    #[serde(rename = "share")]
    pub value: f64,
    /// Lower end of its interval (Wilson 1927, 95 %).
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl Proportion {
    fn of(hits: u32, runs: u32) -> Self {
        let (n, share) = (f64::from(runs), f64::from(hits) / f64::from(runs));
        let z = Normal::standard().inverse_cdf(0.975);
        let middle = (share + z * z / (2.0 * n)) / (1.0 + z * z / n);
        let half = z / (1.0 + z * z / n) * (share * (1.0 - share) / n + z * z / (4.0 * n * n)).sqrt();
        Proportion { value: share, low: (middle - half).max(0.0), high: (middle + half).min(1.0) }
    }
}

/// The power of a design.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StatisticalPower {
    /// To find that any condition differs; none of fewer than three conditions.
    #[serde(rename = "any")]
    pub any_difference: Option<Proportion>,
    /// To find that two differ, corrected for all pairs, in the order of the conditions.
    pub pairs: Vec<(String, String, Proportion)>,
    /// Mean score of each condition in the simulated studies, bounds and dropouts included.
    pub means: Vec<f64>,
}

/// Why power cannot be computed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PowerError {
    /// A number that cannot be.
    #[error("{name} = {value}, expected {expected}")]
    Range {
        /// Which number.
        name: String,
        /// Its value.
        value: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// The effect or the pilot does not tell of a condition.
    #[error("nothing is said of condition {0:?} of the plan")]
    Unknown(String),
    /// Too little.
    #[error("{0}")]
    TooFew(&'static str),
}

/// The power of a design: `design[person]` has the place in `conditions` of each of the person's trials, in their order.
///
/// Deterministic: equal arguments, equal power. Friedman's chance is that of the chi square distribution here, which is somewhat too
/// large with few people.
///
/// # Errors
/// [`PowerError`].
pub fn simulate_power(
    conditions: &[String],
    design: &[Vec<usize>],
    scores: &ScoreModel,
    options: &PowerOptions,
) -> Result<StatisticalPower, PowerError> {
    check(conditions, design, scores, options)?;
    let count = conditions.len();
    let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
    let pairs: Vec<(usize, usize)> = (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b))).collect();
    let (mut any, mut found) = (0, vec![0; pairs.len()]);
    let mut sums = vec![(0.0, 0_u64); count];
    for _ in 0..options.runs {
        let rows: Vec<Vec<Option<f64>>> = design
            .iter()
            .map(|trials| {
                let stays = draw_completed_trials(trials.len(), options.dropout_probability, &mut rng);
                let drawn = draw_scores(conditions, &trials[..stays], scores, &mut rng);
                for (sum, own) in sums.iter_mut().zip(&drawn) {
                    *sum = (sum.0 + own.iter().sum::<f64>(), sum.1 + own.len() as u64);
                }
                let mean =
                    |own: Vec<f64>| (!own.is_empty()).then(|| own.iter().sum::<f64>() / own.len() as f64);
                drawn.into_iter().map(mean).collect()
            })
            .collect();
        // Scores are finite and rows are as long as there are conditions.
        let Ok(values) = RepeatedMeasures::new(conditions.to_vec(), rows) else { continue };
        any += u32::from(friedman_asymptotic_p(&values.complete()).is_some_and(|p| p <= options.alpha));
        let p_value = |(a, b): &(usize, usize)| Some(wilcoxon_of_pairs(&values.pairs(*a, *b)).ok()?.p);
        let p_values: Vec<Option<f64>> = pairs.iter().map(p_value).collect();
        for (hits, p) in found.iter_mut().zip(holm_of_pairs(&p_values)) {
            *hits += u32::from(p.is_some_and(|p| p <= options.alpha));
        }
    }
    let named = |((a, b), hits): (&(usize, usize), u32)| {
        (conditions[*a].clone(), conditions[*b].clone(), Proportion::of(hits, options.runs))
    };
    Ok(StatisticalPower {
        any_difference: (count > 2).then(|| Proportion::of(any, options.runs)),
        pairs: pairs.iter().zip(found).map(named).collect(),
        means: sums.into_iter().map(|(sum, n)| sum / n as f64).collect(),
    })
}

/// How many of their trials a person does.
fn draw_completed_trials(trials: usize, dropout: f64, rng: &mut ChaCha8Rng) -> usize {
    if trials > 0 && rng.random_bool(dropout) { rng.random_range(0..trials) } else { trials }
}

/// Scores of a person's trials by condition.
fn draw_scores(
    conditions: &[String],
    trials: &[usize],
    scores: &ScoreModel,
    rng: &mut ChaCha8Rng,
) -> Vec<Vec<f64>> {
    let mut drawn = vec![Vec::new(); conditions.len()];
    match scores {
        ScoreModel::Expected(effect) => {
            let normal = Normal::standard();
            let mut draw = || normal.inverse_cdf(rng.random_range(f64::EPSILON..1.0));
            let everywhere = draw();
            let here: Vec<f64> = conditions.iter().map(|_| draw()).collect();
            for (before, position) in trials.iter().enumerate() {
                let expected = effect.conditions[&conditions[*position]];
                let person = effect.condition_correlation.sqrt() * everywhere
                    + (1.0 - effect.condition_correlation).sqrt() * here[*position];
                let noise = effect.intraclass_correlation.sqrt() * person
                    + (1.0 - effect.intraclass_correlation).sqrt() * draw();
                // About the middle of the design, so that the mean stays what was stated.
                let gain = effect.gain_per_trial * (before as f64 - (trials.len() as f64 - 1.0) / 2.0);
                let mut score = expected.mean + expected.sd * noise + gain;
                if let Some(step) = effect.score_step {
                    score = (score / step).round() * step;
                }
                drawn[*position].push(
                    score.clamp(effect.min_score.unwrap_or(f64::MIN), effect.max_score.unwrap_or(f64::MAX)),
                );
            }
        }
        ScoreModel::Pilot(people) => {
            let person = &people[rng.random_range(0..people.len())];
            for position in trials {
                let own = &person[*position];
                if !own.is_empty() {
                    drawn[*position].push(own[rng.random_range(0..own.len())]);
                }
            }
        }
    }
    drawn
}

fn check(
    conditions: &[String],
    design: &[Vec<usize>],
    scores: &ScoreModel,
    options: &PowerOptions,
) -> Result<(), PowerError> {
    let within = |name: &str, value: f64, is_valid: bool, expected| {
        if is_valid { Ok(()) } else { Err(PowerError::Range { name: name.to_owned(), value, expected }) }
    };
    let share = |name, value: f64| within(name, value, (0.0..=1.0).contains(&value), "0 to 1");
    share("dropout", options.dropout_probability)?;
    within("the level", options.alpha, options.alpha > 0.0 && options.alpha < 1.0, "above 0 and below 1")?;
    within("runs", f64::from(options.runs), options.runs > 0, "at least 1")?;
    if conditions.len() < 2 {
        return Err(PowerError::TooFew("a design with one condition compares nothing"));
    }
    if design.is_empty() {
        return Err(PowerError::TooFew("a design without people finds nothing"));
    }
    match scores {
        ScoreModel::Expected(effect) => {
            share("intraclass_correlation", effect.intraclass_correlation)?;
            share("condition_correlation", effect.condition_correlation)?;
            within("gain_per_trial", effect.gain_per_trial, effect.gain_per_trial.is_finite(), "a number")?;
            if let Some(step) = effect.score_step {
                within("score_step", step, step > 0.0 && step.is_finite(), "above 0")?;
            }
            if let (Some(min), Some(max)) = (effect.min_score, effect.max_score) {
                within("max_score", max, max > min, "above min_score")?;
            }
            for name in conditions {
                let expected =
                    effect.conditions.get(name).ok_or_else(|| PowerError::Unknown(name.clone()))?;
                within(&format!("mean of {name}"), expected.mean, expected.mean.is_finite(), "a number")?;
                let sd = expected.sd;
                within(&format!("sd of {name}"), sd, sd >= 0.0 && sd.is_finite(), "0 or above")?;
            }
        }
        ScoreModel::Pilot(people) => {
            if people.is_empty() {
                return Err(PowerError::TooFew("a pilot without people says nothing"));
            }
            for (index, name) in conditions.iter().enumerate() {
                let known = |person: &Vec<Vec<f64>>| person.get(index).is_some_and(|own| !own.is_empty());
                if !people.iter().any(known) {
                    return Err(PowerError::Unknown(name.clone()));
                }
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(count: usize) -> Vec<String> {
        ["A", "B", "C", "D"][..count].iter().map(|name| (*name).to_owned()).collect()
    }

    fn effect(scores: &[(f64, f64)]) -> ScoreModel {
        let conditions = names(scores.len()).into_iter().zip(scores);
        ScoreModel::Expected(ExpectedEffect {
            conditions: conditions
                .map(|(name, (mean, sd))| (name, ExpectedScore { mean: *mean, sd: *sd }))
                .collect(),
            intraclass_correlation: 0.4,
            condition_correlation: 0.5,
            gain_per_trial: 0.0,
            min_score: None,
            max_score: None,
            score_step: None,
        })
    }

    /// Everybody does `trials` of each condition.
    fn design(people: usize, conditions: usize, trials: usize) -> Vec<Vec<usize>> {
        let one: Vec<usize> = (0..conditions).flat_map(|c| vec![c; trials]).collect();
        vec![one; people]
    }

    const OPTIONS: PowerOptions = PowerOptions { runs: 2000, alpha: 0.05, dropout_probability: 0.0, seed: 1 };

    #[test]
    fn without_a_difference_it_finds_one_as_often_as_the_level_or_less() {
        let power =
            simulate_power(&names(3), &design(16, 3, 2), &effect(&[(2.0, 1.0); 3]), &OPTIONS).unwrap();
        assert!(power.any_difference.unwrap().value < 0.07, "{power:?}");
        assert!(power.pairs.iter().all(|(.., found)| found.value < 0.05), "{power:?}");
    }

    #[test]
    fn a_paired_difference_has_the_power_of_the_books() {
        // One trial each, everything between people and nothing common: differences have sd sqrt(2) and mean 1, d = 0.707. A paired t test
        // of 20 people has power 0.86 there; signed ranks have 0.955 of its efficiency.
        let mut scores = effect(&[(0.0, 1.0), (1.0, 1.0)]);
        if let ScoreModel::Expected(effect) = &mut scores {
            (effect.intraclass_correlation, effect.condition_correlation) = (1.0, 0.0);
        }
        let found = simulate_power(&names(2), &design(20, 2, 1), &scores, &OPTIONS).unwrap();
        let (.., share) = &found.pairs[0];
        assert!((0.80..0.88).contains(&share.value), "{found:?}");
        assert!(share.low < share.value && share.value < share.high && share.high - share.low < 0.04);
        assert_eq!(found.any_difference, None);
    }

    #[test]
    fn more_people_find_more_and_those_who_leave_cost() {
        let scores = effect(&[(2.0, 1.0), (2.8, 1.0)]);
        let of = |people, dropout| {
            let options = PowerOptions { dropout_probability: dropout, ..OPTIONS };
            simulate_power(&names(2), &design(people, 2, 2), &scores, &options).unwrap().pairs[0].2.value
        };
        assert!(of(6, 0.0) < of(12, 0.0) && of(12, 0.0) < of(24, 0.0));
        assert!(of(12, 0.5) < of(12, 0.0));
        assert_eq!(of(12, 0.2), of(12, 0.2));
    }

    #[test]
    fn an_order_that_is_not_balanced_is_seen_where_people_learn() {
        // Nothing differs, but B always comes last and people gain with each trial.
        let mut scores = effect(&[(2.0, 1.0), (2.0, 1.0)]);
        if let ScoreModel::Expected(effect) = &mut scores {
            effect.gain_per_trial = 0.5;
        }
        let of = |design: &[Vec<usize>]| {
            simulate_power(&names(2), design, &scores, &OPTIONS).unwrap().pairs[0].2.value
        };
        let last = design(16, 2, 3);
        let mut balanced = last.clone();
        balanced.iter_mut().step_by(2).for_each(|trials| trials.reverse());
        assert!(of(&last) > 0.5 && of(&balanced) < 0.1, "{} {}", of(&last), of(&balanced));
    }

    #[test]
    fn a_pilot_is_drawn_again_person_by_person_within_its_bounds() {
        let pilot = ScoreModel::Pilot(vec![
            vec![vec![0.0, 1.0], vec![3.0]],
            vec![vec![1.0], vec![4.0]],
            vec![vec![2.0], vec![]],
        ]);
        let found = simulate_power(&names(2), &design(12, 2, 1), &pilot, &OPTIONS).unwrap();
        assert!(found.pairs[0].2.value > 0.5, "{found:?}");
        assert!((0.5..1.5).contains(&found.means[0]) && (3.0..4.0).contains(&found.means[1]), "{found:?}");
    }

    #[test]
    fn what_cannot_be_is_refused_with_its_name() {
        let refused = |scores: &ScoreModel, options: &PowerOptions| {
            simulate_power(&names(2), &design(4, 2, 1), scores, options).unwrap_err().to_string()
        };
        assert_eq!(
            refused(&effect(&[(1.0, -1.0), (2.0, 1.0)]), &OPTIONS),
            "sd of A = -1, expected 0 or above"
        );
        assert_eq!(
            refused(&effect(&[(1.0, 1.0)]), &OPTIONS),
            "nothing is said of condition \"B\" of the plan"
        );
        assert!(refused(&ScoreModel::Pilot(vec![]), &OPTIONS).contains("without people"));
        let options = PowerOptions { dropout_probability: 1.5, ..OPTIONS };
        assert_eq!(refused(&effect(&[(1.0, 1.0), (2.0, 1.0)]), &options), "dropout = 1.5, expected 0 to 1");
        let one = simulate_power(&names(1), &design(4, 1, 1), &effect(&[(1.0, 1.0)]), &OPTIONS).unwrap_err();
        assert!(one.to_string().contains("compares nothing"));
    }
}
