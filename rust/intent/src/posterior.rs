use nalgebra::Unit;
use proact_types::{GazeSample, ObjectId, Point, TaskContext, format_number};
use serde::{Deserialize, Serialize};

/// Probability of each object being meant, in the order of the scene; sums to one.
pub type Posterior = Vec<f64>;

/// Parameters of all models; each reads those that concern it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct IntentOptions {
    /// Spread of gaze about the block that is meant, in the image plane at unit distance (tan of the angle).
    ///
    /// Default 0.03, a block's radius seen from the eye. The original's 0.1 makes a straight look at a dropped block
    /// lose to a neighbour of the other colour that is closer than 8.4 degrees; at 0.03 the limit is 2.5 degrees
    /// (measured with the error of a tracker in `docs/intent.md`).
    pub gaze_sigma: f64,
    /// Half of the probability, before gaze, of all objects together that the task does not ask for (paper, table
    /// "Probability weighting": 0.125 for each of the two blocks of the colour that is not due; 0.375 for each of the
    /// others). At 0.25 the task has no say over as many due as other objects.
    pub off_task_weight: f64,
    /// The posterior of another block must exceed that of the highlighted one by this factor before the
    /// highlight moves. One means that the best one always wins, as in the paper.
    pub highlight_hysteresis: f64,
    /// The colour that is due changes when a block is taken already, as in the original; else when it is released.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub context_changes_at_grasp: bool,
    /// Filtered: how often a person comes to mean another block, 1/s; the new one is drawn from the task's prior.
    /// Default 0.3: about once in the three seconds between looking and locking (assumed).
    pub goal_switching_rate_per_s: f64,
    /// Filtered: looking for this long counts as one independent look, ms. Samples of one fixation share their
    /// error, so counting each for itself would make the model surer at a faster tracker, and far too sure at
    /// any. Default 250, the length of a common fixation (assumed).
    pub independent_fixation_ms: f64,
    /// Filtered: likelihood of a gaze far from the block that is meant, relative to that of a gaze at its centre:
    /// people also look at the hand. Default 0.01 (assumed).
    pub off_target_likelihood: f64,
    /// Hand motion: how straight people go, 1/m: the log-odds that a metre of way gained on a block is worth.
    /// Default 20 (assumed): five centimetres are one unit of log-odds.
    pub straightness_per_m: f64,
}

impl Default for IntentOptions {
    fn default() -> Self {
        Self {
            gaze_sigma: 0.03,
            off_task_weight: 0.125,
            highlight_hysteresis: 1.0,
            context_changes_at_grasp: false,
            goal_switching_rate_per_s: 0.3,
            independent_fixation_ms: 250.0,
            off_target_likelihood: 0.01,
            straightness_per_m: 20.0,
        }
    }
}

impl IntentOptions {
    /// Checks ranges.
    ///
    /// # Errors
    /// [`IntentError::Option`] naming the first key that is out of range or not a number.
    pub fn check(&self) -> Result<(), IntentError> {
        let within = |key, got: f64, allowed: std::ops::RangeInclusive<f64>, expected| {
            if allowed.contains(&got) { Ok(()) } else { Err(IntentError::Option { key, got, expected }) }
        };
        within("gaze_sigma", self.gaze_sigma, 1e-3..=10.0, "0.001 to 10")?;
        within("off_task_weight", self.off_task_weight, 0.0..=0.5, "0 to 0.5")?;
        within("highlight_hysteresis", self.highlight_hysteresis, 1.0..=1e6, "1 to 1000000")?;
        within("goal_switching_rate_per_s", self.goal_switching_rate_per_s, 0.0..=1e3, "0 to 1000")?;
        within("independent_fixation_ms", self.independent_fixation_ms, 1.0..=1e5, "1 to 100000")?;
        within("off_target_likelihood", self.off_target_likelihood, 0.0..=1.0, "0 to 1")?;
        within("straightness_per_m", self.straightness_per_m, 0.0..=1e4, "0 to 10000")
    }
}

/// What the task says about the next object, before any gaze: probability of each of `count` objects. Without a
/// `context` nothing, which is method C; with one, the objects that are due share `1 - 2 weight_other`, and the others the
/// rest (ProACT, arXiv:2407.05025, table of p(a|s) conditioned on previous colour). Where none is due, or all are, the task
/// has no say.
pub fn prior_weights(count: usize, context: Option<&TaskContext>, options: &IntentOptions) -> Posterior {
    let due = |k: usize| context.is_some_and(|context| context.expected_objects.contains(ObjectId::new(k)));
    let is_due: Vec<bool> = (0..count).map(due).collect();
    let dues = is_due.iter().filter(|due| **due).count();
    if dues == 0 || dues == count {
        return vec![1.0 / count as f64; count];
    }
    let all_others = 2.0 * options.off_task_weight;
    let (each_due, each_other) = ((1.0 - all_others) / dues as f64, all_others / (count - dues) as f64);
    is_due.into_iter().map(|due| if due { each_due } else { each_other }).collect()
}

/// Why there is no posterior.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum IntentError {
    /// The gaze is NaN, infinite, or has no direction.
    #[error("gaze {what} is {value}, expected finite numbers and a direction that is not zero")]
    Gaze {
        /// `origin` or `direction`.
        what: &'static str,
        /// As text.
        value: String,
    },
    /// An option is outside its range.
    #[error("intent option {key} = {}, expected {expected}", format_number(*got))]
    Option {
        /// Such as `sigma`.
        key: &'static str,
        /// What was given.
        got: f64,
        /// What is allowed.
        expected: &'static str,
    },
    /// A number or a word of an intent model in another program cannot be.
    #[error("intent_process.{key} = {got}, expected {expected}")]
    Program {
        /// Such as `deadline_ms`.
        key: &'static str,
        /// What was given.
        got: String,
        /// What is allowed.
        expected: &'static str,
    },
    /// No such model.
    #[error("intent model {got:?} is unknown; expected one of {known}")]
    Model {
        /// What was asked for.
        got: String,
        /// What there is.
        known: String,
    },
}

/// Posterior over objects (ProACT, arXiv:2407.05025, Bayes' rule with a Gaussian likelihood in the image plane).
///
/// `centers`: their centres in `world`. `candidates`: those that may be meant; the others get zero, as do objects behind
/// the eye. `None` when no candidate is in front of the eye. All three have the order of the scene.
///
/// The likelihood of object i is exp(-x_i^2 / 2 sigma^2), x_i = tan of the angle between the gaze and the line to
/// the object: its distance from the gaze in a plane at unit distance. Computed as logarithms, so that a gaze far
/// from all objects still ranks them (the original underflows to zero and picks red 1).
///
/// # Errors
/// [`IntentError::Gaze`] if the gaze is not finite or has no direction.
pub fn posterior(
    gaze: &GazeSample,
    centers: &[Point],
    candidates: &[bool],
    prior: &[f64],
    options: &IntentOptions,
) -> Result<Option<Posterior>, IntentError> {
    let likelihood = log_likelihood(gaze, centers, options.gaze_sigma)?;
    let score = |(i, likelihood): (usize, Option<f64>)| {
        let possible = candidates[i] && prior[i] > 0.0;
        likelihood.filter(|_| possible).map(|score| prior[i].ln() + score)
    };
    Ok(normalize_log_weights(likelihood.into_iter().enumerate().map(score)))
}

/// Logarithm of the likelihood of the gaze for each object, up to a constant; none for one that is behind the
/// eye or whose place is not known.
pub(crate) fn log_likelihood(
    gaze: &GazeSample,
    centers: &[Point],
    sigma: f64,
) -> Result<Vec<Option<f64>>, IntentError> {
    let bad = |what, value: String| IntentError::Gaze { what, value };
    if !gaze.origin.coords.iter().all(|v| v.is_finite()) {
        return Err(bad("origin", format!("{:?}", gaze.origin.coords.as_slice())));
    }
    if !gaze.direction.iter().all(|v| v.is_finite()) || gaze.direction.norm() < 1e-9 {
        return Err(bad("direction", format!("{:?}", gaze.direction.as_slice())));
    }
    let direction = Unit::new_normalize(gaze.direction);
    let score = |center: &Point| {
        let to_block = center - gaze.origin;
        let ahead = to_block.dot(&direction);
        if ahead.is_nan() || ahead <= 1e-9 {
            return None;
        }
        let distance = (to_block - direction.into_inner() * ahead).norm() / ahead;
        Some(-0.5 * (distance / sigma).powi(2))
    };
    Ok(centers.iter().map(score).collect())
}

/// Probabilities from logarithms of weights. Objects without one, or with one that is not finite, get zero; none
/// if none is left.
pub(crate) fn normalize_log_weights(scores: impl Iterator<Item = Option<f64>>) -> Option<Posterior> {
    let scores: Vec<Option<f64>> = scores.map(|score| score.filter(|s| s.is_finite())).collect();
    let best = scores.iter().flatten().copied().reduce(f64::max)?;
    let mut weights: Posterior = scores.iter().map(|s| s.map_or(0.0, |s| (s - best).exp())).collect();
    let sum: f64 = weights.iter().sum();
    weights.iter_mut().for_each(|w| *w /= sum);
    Some(weights)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::{ObjectSet, Vector};

    const CENTERS: [Point; 4] = [
        Point::new(0.6, 0.1, -0.5),
        Point::new(0.6, -0.1, -0.5),
        Point::new(0.8, 0.1, -0.5),
        Point::new(0.8, -0.1, -0.5),
    ];

    fn look(direction: Vector) -> GazeSample {
        GazeSample { origin: Point::origin(), direction, valid: true }
    }

    /// Red comes first.
    fn red_is_due() -> TaskContext {
        TaskContext { expected_objects: ObjectSet::first(2), selection_number: 0 }
    }

    fn blue_is_due() -> TaskContext {
        TaskContext { expected_objects: [2, 3].map(ObjectId::new).into_iter().collect(), selection_number: 1 }
    }

    fn ask(gaze: &GazeSample, context: Option<TaskContext>) -> Posterior {
        let options = IntentOptions::default();
        let prior = prior_weights(4, context.as_ref(), &options);
        posterior(gaze, &CENTERS, &[true; 4], &prior, &options).expect("a finite gaze").expect("blocks ahead")
    }

    #[test]
    fn the_posterior_sums_to_one_and_prefers_the_block_looked_at() {
        for (i, center) in CENTERS.iter().enumerate() {
            let p = ask(&look(center.coords * 3.0), None);
            assert!((p.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            assert!((0..4).all(|k| k == i || p[k] < p[i]), "{p:?}");
        }
    }

    #[test]
    fn the_colour_that_is_due_weighs_three_times_as_much() {
        let between = look(Vector::new(0.7, 0.0, -0.5));
        let options = IntentOptions::default();
        let weights = prior_weights(4, Some(&blue_is_due()), &options);
        assert_eq!(weights, [0.125, 0.125, 0.375, 0.375]);
        assert_eq!(prior_weights(4, Some(&red_is_due()), &options), [0.375, 0.375, 0.125, 0.125]);
        // One of sixteen is due: it has three quarters, the others share the rest.
        let one = TaskContext { expected_objects: ObjectSet::first(1), selection_number: 1 };
        let of_sixteen = prior_weights(16, Some(&one), &options);
        assert_eq!((of_sixteen[0], of_sixteen[15]), (0.75, 0.25 / 15.0));
        assert_eq!(prior_weights(2, Some(&red_is_due()), &options), [0.5, 0.5], "all are due");
        let red_due = ask(&between, Some(red_is_due()));
        let uniform = ask(&between, None);
        assert!((red_due[0] / red_due[2] - 3.0 * uniform[0] / uniform[2]).abs() < 1e-9);
    }

    #[test]
    fn blocks_behind_the_eye_and_excluded_blocks_get_nothing() {
        let options = IntentOptions::default();
        let prior = prior_weights(4, None, &options);
        let away = look(Vector::new(-1.0, 0.0, 0.0));
        assert_eq!(posterior(&away, &CENTERS, &[true; 4], &prior, &options), Ok(None));
        let p = posterior(&look(CENTERS[0].coords), &CENTERS, &[false, true, true, true], &prior, &options)
            .expect("finite")
            .expect("three are left");
        assert_eq!(p[0], 0.0);
        assert_eq!(posterior(&look(Vector::x()), &CENTERS, &[false; 4], &prior, &options), Ok(None));
    }

    #[test]
    fn a_gaze_far_from_every_block_still_ranks_them() {
        let p = ask(&look(Vector::new(0.02, 1.0, 0.0)), None);
        assert!((p.iter().sum::<f64>() - 1.0).abs() < 1e-12 && p.iter().all(|v| v.is_finite()));
        assert!(p[0] + p[2] > 0.99, "the left blocks are nearer to a gaze to the left: {p:?}");
    }

    #[test]
    fn a_gaze_that_is_not_a_number_or_has_no_direction_is_an_error() {
        let options = IntentOptions::default();
        for direction in [Vector::new(f64::NAN, 0.0, 0.0), Vector::zeros()] {
            let error = posterior(&look(direction), &CENTERS, &[true; 4], &[0.25; 4], &options);
            assert!(matches!(error, Err(IntentError::Gaze { what: "direction", .. })), "{error:?}");
        }
    }

    #[test]
    fn a_straight_look_at_a_block_that_is_not_due_wins_from_two_and_a_half_degrees() {
        // Numbers of the documentation: at sigma 0.03 a same-distance neighbour 2.5 degrees away no longer wins.
        let options = IntentOptions::default();
        let prior = prior_weights(4, Some(&blue_is_due()), &options);
        for (degrees, wins) in [(2.6_f64, true), (2.4, false)] {
            let angle = degrees.to_radians();
            let far = Point::new(-1.0, 0.0, 0.0);
            let centers = [Point::new(1.0, 0.0, 0.0), far, Point::new(angle.cos(), angle.sin(), 0.0), far];
            let p = posterior(&look(Vector::x()), &centers, &[true; 4], &prior, &options)
                .expect("finite")
                .expect("ahead");
            assert_eq!(p[0] > p[2], wins, "{degrees} degrees: {p:?}");
        }
    }
}
