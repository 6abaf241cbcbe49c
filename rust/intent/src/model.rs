use crate::{
    IntentError, IntentOptions, Posterior,
    hand_motion::HandMotionModel,
    hidden_markov::HiddenMarkovModel,
    memoryless::{MemorylessKind, MemorylessModel},
    prior_weights,
};
use proact_types::{GazeSample, Point, SimTime, TaskContext};
use serde::{Deserialize, Serialize};
use std::{fmt, str::FromStr};

/// What a model knows besides the gaze. Lists have the order of the scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Candidates {
    /// Centres of the objects in `world`. One whose centre is not finite is left out.
    pub centers: Vec<Point>,
    /// Objects that may be meant; the others get zero.
    pub pickable: Vec<bool>,
    /// What the task asks for; none where nothing is known of it. Where all objects are due it has no say (method C), but its
    /// number counts.
    pub context: Option<TaskContext>,
    /// The point of the hand that will meet the object (centre of the grasp), in `world`; none if it is not known.
    pub tip: Option<Point>,
}

impl Candidates {
    /// Objects that may be meant and whose place is known.
    pub(crate) fn valid_candidates(&self) -> Vec<bool> {
        let known = |center: &Point| center.coords.iter().all(|v| v.is_finite());
        self.pickable.iter().zip(&self.centers).map(|(pickable, center)| *pickable && known(center)).collect()
    }

    /// What the task says, over the objects that may be meant; none if there are none.
    pub(crate) fn prior(&self, options: &IntentOptions) -> Option<Posterior> {
        let mut weights = prior_weights(self.centers.len(), self.context.as_ref(), options);
        for (weight, possible) in weights.iter_mut().zip(self.valid_candidates()) {
            *weight = if possible { *weight } else { 0.0 };
        }
        let sum: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= sum);
        (sum > 0.0).then_some(weights)
    }

    /// The number of the task's context: another one begins a new selection.
    pub(crate) fn selection(&self) -> Option<u32> {
        self.context.map(|context| context.selection_number)
    }
}

/// A model of which object a person means, fed with the gaze as it is measured.
///
/// Call [`observe`](IntentModel::observe) with every gaze sample while the hand is empty, in the order of time.
/// Blinks belong to the stream (`valid: false`). A model that remembers begins anew when the task's context
/// changes its number; otherwise it forgets by itself over the time that nothing is observed.
///
/// Deterministic: the calls since the model was built decide what it answers. What it answers for an object does
/// not depend on where the object stands in the lists.
pub trait IntentModel: Send {
    /// Which model it is.
    fn name(&self) -> IntentModelName;

    /// Takes in the sample of tick `now`. The posterior over objects sums to one; those
    /// that may not be meant get zero. `None` if the sample tells this model nothing (a blink, a gaze that is no
    /// number or meets no object, nothing to pick): what was known before stands.
    fn observe(&mut self, now: SimTime, gaze: &GazeSample, scene: &Candidates) -> Option<Posterior>;
}

/// The models there are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum IntentModelName {
    /// What the task says, whatever the eye does.
    PriorOnly,
    /// The likelihood of the present gaze, whatever the task says: method C.
    GazeOnly,
    /// Task times likelihood of the present gaze: method D, the paper's formula.
    #[default]
    Product,
    /// A hidden Markov model over goals: looks add up, and the goal may change at any time.
    Filtered,
    /// Task times maximum-entropy likelihood of the hand's way; the eye has no say.
    HandMotion,
}

impl IntentModelName {
    /// All of them.
    pub const ALL: [IntentModelName; 5] =
        [Self::PriorOnly, Self::GazeOnly, Self::Product, Self::Filtered, Self::HandMotion];

    /// As written in configurations.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::PriorOnly => "prior_only",
            Self::GazeOnly => "gaze_only",
            Self::Product => "product",
            Self::Filtered => "filtered",
            Self::HandMotion => "hand_motion",
        }
    }

    /// The model, before its first sample.
    ///
    /// # Errors
    /// [`IntentError::Option`] as [`IntentOptions::check`].
    pub fn build(self, options: &IntentOptions) -> Result<Box<dyn IntentModel>, IntentError> {
        options.check()?;
        Ok(match self {
            Self::PriorOnly => Box::new(MemorylessModel::new(MemorylessKind::PriorOnly, *options)),
            Self::GazeOnly => Box::new(MemorylessModel::new(MemorylessKind::GazeOnly, *options)),
            Self::Product => Box::new(MemorylessModel::new(MemorylessKind::Product, *options)),
            Self::Filtered => Box::new(HiddenMarkovModel::new(*options)),
            Self::HandMotion => Box::new(HandMotionModel::new(*options)),
        })
    }
}

impl fmt::Display for IntentModelName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

impl FromStr for IntentModelName {
    type Err = IntentError;

    fn from_str(text: &str) -> Result<Self, IntentError> {
        Self::ALL.into_iter().find(|m| m.as_str() == text).ok_or_else(|| IntentError::Model {
            got: text.to_owned(),
            known: Self::ALL.map(Self::as_str).join(", "),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_survive_their_text_and_unknown_ones_are_refused_with_what_there_is() {
        for name in IntentModelName::ALL {
            assert_eq!(name.to_string().parse(), Ok(name));
            assert_eq!(name.build(&IntentOptions::default()).expect("defaults are allowed").name(), name);
        }
        let error = "mind_reading".parse::<IntentModelName>().expect_err("no such model");
        assert_eq!(
            error.to_string(),
            "intent model \"mind_reading\" is unknown; expected one of prior_only, gaze_only, product, filtered, \
             hand_motion"
        );
    }

    #[test]
    fn options_are_data_and_those_out_of_range_are_refused_by_name() {
        let options: IntentOptions =
            toml::from_str("gaze_sigma = 0.1\nindependent_fixation_ms = 100").expect("reads");
        assert_eq!(
            (options.gaze_sigma, options.independent_fixation_ms, options.off_target_likelihood),
            (0.1, 100.0, 0.01)
        );
        let error = toml::from_str::<IntentOptions>("sigm = 0.1").expect_err("an unknown key");
        assert!(error.to_string().contains("sigm"), "{error}");
        let default = IntentOptions::default();
        for (key, bad) in [
            ("independent_fixation_ms", IntentOptions { independent_fixation_ms: 0.0, ..default }),
            ("off_target_likelihood", IntentOptions { off_target_likelihood: f64::NAN, ..default }),
            ("gaze_sigma", IntentOptions { gaze_sigma: 0.0, ..default }),
        ] {
            let error = IntentModelName::Product.build(&bad).err().expect("out of range").to_string();
            assert!(error.contains(key), "{error}");
        }
    }
}
