use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// The questionnaires that ship with the program, by name.
pub const SHIPPED_FORMS: &[(&str, &str)] = &[
    ("participant", include_str!("../data/forms/participant.toml")),
    ("embodiment", include_str!("../data/forms/embodiment.toml")),
    ("ease_agency_speed", include_str!("../data/forms/ease_agency_speed.toml")),
    ("ranking", include_str!("../data/forms/ranking.toml")),
    ("last_trial", include_str!("../data/forms/last_trial.toml")),
    ("nasa_tlx", include_str!("../data/forms/nasa_tlx.toml")),
    ("pros_tlx", include_str!("../data/forms/pros_tlx.toml")),
    ("sus", include_str!("../data/forms/sus.toml")),
    ("comments", include_str!("../data/forms/comments.toml")),
];

/// A text by language, such as `en`.
pub type TranslatedText = BTreeMap<String, String>;

/// A questionnaire: a file of data.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(deny_unknown_fields)]
pub struct Form {
    /// By which a plan names it.
    pub name: String,
    /// For people.
    pub title: TranslatedText,
    /// Where the items come from.
    pub source: String,
    /// Under which they may be used.
    #[serde(rename = "licence")]
    pub license: String,
    /// The wording is that of the source, item by item.
    #[serde(rename = "confirmed")]
    pub wording_verified: bool,
    /// How it is scored.
    #[serde(default)]
    pub scoring: Scoring,
    /// What is asked, in this order.
    pub items: Vec<FormItem>,
}

/// How a questionnaire is scored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(tag = "by", rename_all = "snake_case", deny_unknown_fields)]
pub enum Scoring {
    /// It is not.
    #[default]
    #[serde(rename = "nothing")]
    Unscored,
    /// As the NASA Task Load Index: the mean of the ratings, and with `pairs` their mean weighted by how often each item is
    /// chosen among all pairs (Hart and Staveland 1988). No score where a rating or a choice is missing.
    TaskLoad {
        /// Every pair of items is asked for: which of them contributed more.
        pairs: bool,
    },
    /// As the System Usability Scale: odd items count from 0 up, even ones from 0 down, times 2.5 (Brooke 1996). A missing
    /// answer counts as the middle, as there; no score where all are missing.
    Usability {},
}

/// Something that is asked.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum FormItem {
    /// A number between two anchors.
    Scale {
        /// In the tables.
        key: String,
        /// Its short name; the text if left out.
        #[serde(default)]
        name: TranslatedText,
        /// The question.
        text: TranslatedText,
        /// What the lowest number means.
        low: TranslatedText,
        /// What the highest number means.
        high: TranslatedText,
        /// The lowest number.
        #[serde(rename = "least")]
        min: f64,
        /// The highest number.
        #[serde(rename = "most")]
        max: f64,
        /// From one number to the next.
        step: f64,
    },
    /// One of some answers.
    Choice {
        /// In the tables.
        key: String,
        /// The question.
        text: TranslatedText,
        /// What can be answered.
        options: Vec<FormOption>,
        /// More than one may be chosen.
        #[serde(default)]
        #[serde(rename = "several")]
        multiple: bool,
    },
    /// The study's conditions in an order, in which several may share a place.
    Ranking {
        /// In the tables.
        key: String,
        /// The question.
        text: TranslatedText,
    },
    /// One of the study's conditions.
    Condition {
        /// In the tables.
        key: String,
        /// The question.
        text: TranslatedText,
    },
    /// The person agrees to take part.
    Consent {
        /// In the tables.
        key: String,
        /// Which text is agreed to; the answer, and with it the tables, say it.
        version: String,
        /// What is agreed to.
        text: TranslatedText,
    },
    /// Free words.
    Text {
        /// In the tables.
        key: String,
        /// The question.
        text: TranslatedText,
        /// It may be left empty.
        #[serde(default)]
        optional: bool,
    },
}

/// An answer that can be chosen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(deny_unknown_fields)]
pub struct FormOption {
    /// In the tables.
    pub value: String,
    /// For people.
    pub text: TranslatedText,
}

/// Why a questionnaire, or an answer to one, is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FormError {
    /// Not TOML, a key that there is not.
    #[error("the form is unreadable: {0}")]
    Text(String),
    /// Something in it cannot be.
    #[error("form {form}: {what} is {got}, expected {expected}")]
    Value {
        /// Its name.
        form: String,
        /// Such as `step of ease`.
        what: String,
        /// As given.
        got: String,
        /// In words.
        expected: String,
    },
}

/// A score of an answered questionnaire.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FormScore {
    /// Such as `nasa_tlx_raw`.
    pub name: String,
    /// None where too much is missing.
    pub value: Option<f64>,
    /// Items without an answer.
    pub missing: Vec<String>,
}

impl FormItem {
    /// In the tables.
    pub fn key(&self) -> &str {
        match self {
            FormItem::Scale { key, .. }
            | FormItem::Choice { key, .. }
            | FormItem::Ranking { key, .. }
            | FormItem::Condition { key, .. }
            | FormItem::Consent { key, .. }
            | FormItem::Text { key, .. } => key,
        }
    }
}

/// In the tables: the choice between two items.
pub fn pair_key(first: &str, second: &str) -> String {
    format!("{first}_or_{second}")
}

impl Form {
    /// Reads a questionnaire.
    ///
    /// # Errors
    /// [`FormError`].
    pub fn from_text(text: &str) -> Result<Self, FormError> {
        let form: Self = toml::from_str(text).map_err(|error| FormError::Text(error.to_string()))?;
        form.check()?;
        Ok(form)
    }

    /// The one that ships under this name.
    pub fn shipped(name: &str) -> Option<Self> {
        let (_, text) = SHIPPED_FORMS.iter().find(|(other, _)| *other == name)?;
        Self::from_text(text).ok()
    }

    pub(crate) fn value_error(
        &self,
        what: String,
        got: impl ToString,
        expected: impl Into<String>,
    ) -> FormError {
        FormError::Value { form: self.name.clone(), what, got: got.to_string(), expected: expected.into() }
    }

    fn check(&self) -> Result<(), FormError> {
        let mut keys = BTreeSet::new();
        for item in &self.items {
            let key = item.key();
            let plain = |c: char| c.is_ascii_alphanumeric() || c == '_';
            if key.is_empty() || !key.chars().all(plain) || !keys.insert(key) {
                return Err(self.value_error(
                    "a key".to_owned(),
                    format!("{key:?}"),
                    "letters, digits and _, each key once",
                ));
            }
            match item {
                FormItem::Scale { min, max, step, .. } => {
                    let steps = (max - min) / step;
                    let whole = (steps - steps.round()).abs() < 1e-9;
                    if !(*step > 0.0 && (1.0..=1000.0).contains(&steps) && whole) {
                        let got = format!("{min} to {max} by {step}");
                        return Err(self.value_error(
                            format!("the scale of {key}"),
                            got,
                            "1 to 1000 whole steps upwards",
                        ));
                    }
                }
                FormItem::Choice { options, .. } if options.len() < 2 => {
                    return Err(self.value_error(
                        format!("the options of {key}"),
                        options.len(),
                        "at least 2",
                    ));
                }
                _ => {}
            }
        }
        if self.items.is_empty() {
            return Err(self.value_error("the number of items".to_owned(), 0, "at least 1"));
        }
        let scales = self.items.iter().all(|item| matches!(item, FormItem::Scale { .. }));
        if self.scoring != Scoring::Unscored && !scales {
            return Err(self.value_error(
                "an item".to_owned(),
                "no scale",
                "scales alone, since the form is scored",
            ));
        }
        Ok(())
    }

    /// The pairs of items between which is chosen, as [`pair_key`] names them; none without such choices.
    pub fn pairs(&self) -> Vec<(&str, &str)> {
        if self.scoring != (Scoring::TaskLoad { pairs: true }) {
            return Vec::new();
        }
        let keys: Vec<&str> = self.items.iter().map(FormItem::key).collect();
        (0..keys.len())
            .flat_map(|a| (a + 1..keys.len()).map(move |b| (a, b)))
            .map(|(a, b)| (keys[a], keys[b]))
            .collect()
    }

    /// Scores an answered questionnaire: `ratings` by item, `chosen` by pair.
    ///
    /// # Errors
    /// A number that is not on its scale, a choice that is neither of its pair.
    pub fn scores(
        &self,
        ratings: &BTreeMap<String, f64>,
        chosen: &BTreeMap<String, String>,
    ) -> Result<Vec<FormScore>, FormError> {
        let mut values = Vec::new();
        for item in &self.items {
            let FormItem::Scale { key, min, max, step, .. } = item else { continue };
            let value = ratings.get(key).copied();
            if let Some(value) = value {
                let steps = (value - min) / step;
                if !(value >= *min && value <= *max && (steps - steps.round()).abs() < 1e-9) {
                    let expected = format!("{min} to {max} in steps of {step}");
                    return Err(self.value_error(format!("the answer to {key}"), value, &expected));
                }
            }
            values.push((key.as_str(), value, (min + max) / 2.0));
        }
        let missing: Vec<String> = values
            .iter()
            .filter(|(_, value, _)| value.is_none())
            .map(|(key, ..)| (*key).to_owned())
            .collect();
        let score = |name: &str, value: Option<f64>, missing: Vec<String>| FormScore {
            name: format!("{}{name}", self.name),
            value,
            missing,
        };
        let given: Option<Vec<f64>> = values.iter().map(|(_, value, _)| *value).collect();
        Ok(match self.scoring {
            Scoring::Unscored => Vec::new(),
            Scoring::Usability {} => {
                let points = values.iter().enumerate().map(|(k, (_, value, middle))| {
                    let value = value.unwrap_or(*middle);
                    if k % 2 == 0 { value - 1.0 } else { 5.0 - value }
                });
                let sum = 2.5 * points.sum::<f64>();
                vec![score("", (missing.len() < values.len()).then_some(sum), missing)]
            }
            Scoring::TaskLoad { pairs } => {
                let raw = given.as_ref().map(|given| given.iter().sum::<f64>() / given.len() as f64);
                let mut scores = vec![score("_raw", raw, missing.clone())];
                if pairs {
                    let (weights, without) = self.weights(chosen)?;
                    let count: f64 = weights.values().sum();
                    let weighted = given.filter(|_| without.is_empty()).map(|given| {
                        values.iter().zip(given).map(|((key, ..), value)| weights[*key] * value).sum::<f64>()
                            / count
                    });
                    scores.push(score("_weighted", weighted, [missing, without].concat()));
                }
                scores
            }
        })
    }

    /// How often each item was chosen, and the pairs without a choice.
    fn weights(
        &self,
        chosen: &BTreeMap<String, String>,
    ) -> Result<(BTreeMap<&str, f64>, Vec<String>), FormError> {
        let mut weights: BTreeMap<&str, f64> = self.items.iter().map(|item| (item.key(), 0.0)).collect();
        let mut without = Vec::new();
        for (first, second) in self.pairs() {
            let key = pair_key(first, second);
            match chosen.get(&key).map(String::as_str) {
                Some(choice) if choice == first || choice == second => {
                    *weights.entry(if choice == first { first } else { second }).or_default() += 1.0;
                }
                Some(other) => {
                    let expected = format!("{first} or {second}");
                    return Err(self.value_error(
                        format!("the answer to {key}"),
                        format!("{other:?}"),
                        &expected,
                    ));
                }
                None => without.push(key),
            }
        }
        Ok((weights, without))
    }
}
