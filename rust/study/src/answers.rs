use crate::{Form, FormError, FormItem, pair_key};
use rand::{RngExt, SeedableRng, seq::SliceRandom};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// Longest answer in free words, bytes.
const MAX_TEXT_BYTES: usize = 10_000;

/// What was answered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(untagged)]
pub enum FormAnswer {
    /// On a scale.
    Number(f64),
    /// One of several answers, a condition, free words, or the version of what was agreed to.
    #[serde(rename = "Words")]
    Text(String),
    /// Some of several answers.
    #[serde(rename = "Several")]
    Multiple(Vec<String>),
    /// The conditions, place by place; several may share one.
    #[serde(rename = "Places")]
    Ranking(Vec<Vec<String>>),
}

impl FormAnswer {
    /// As in the tables: those of several with a comma between, those of a shared place with `=`.
    pub fn to_cell(&self) -> String {
        match self {
            FormAnswer::Number(number) => number.to_string(),
            FormAnswer::Text(words) => words.clone(),
            FormAnswer::Multiple(several) => several.join(","),
            FormAnswer::Ranking(ranks) => {
                ranks.iter().map(|rank| rank.join("=")).collect::<Vec<_>>().join(",")
            }
        }
    }

    /// From what a person types at a terminal for an item of this kind.
    pub fn from_terminal(item: Option<&FormItem>, text: &str) -> Self {
        let parts = |text: &str, at: char| text.split(at).map(|part| part.trim().to_owned()).collect();
        match item {
            Some(FormItem::Scale { .. }) => {
                text.trim().parse().map_or_else(|_| FormAnswer::Text(text.to_owned()), FormAnswer::Number)
            }
            Some(FormItem::Choice { multiple: true, .. }) => FormAnswer::Multiple(parts(text, ',')),
            Some(FormItem::Ranking { .. }) => {
                FormAnswer::Ranking(text.split(',').map(|rank| parts(rank, '=')).collect())
            }
            _ => FormAnswer::Text(text.trim().to_owned()),
        }
    }
}

impl Form {
    /// Keys of all that is asked, in this order: the items, then the choices between pairs of them.
    pub fn keys(&self) -> Vec<String> {
        let items = self.items.iter().map(|item| item.key().to_owned());
        items.chain(self.pairs().iter().map(|(first, second)| pair_key(first, second))).collect()
    }

    /// The item with this key.
    pub fn item(&self, key: &str) -> Option<&FormItem> {
        self.items.iter().find(|item| item.key() == key)
    }

    /// Whether `answer` can be one to the item `key`, in a study that compares `conditions`.
    ///
    /// # Errors
    /// [`FormError`].
    pub fn check_answer(
        &self,
        key: &str,
        answer: &FormAnswer,
        conditions: &[String],
    ) -> Result<(), FormError> {
        let wrong = |expected: String| {
            Err(self.value_error(format!("the answer to {key}"), answer.to_cell(), expected))
        };
        let one_of = |known: &[&str], got: &str| match known.contains(&got) {
            true => Ok(()),
            false => wrong(format!("one of {}", known.join(", "))),
        };
        let Some(item) = self.item(key) else {
            let pair = self.pairs().into_iter().find(|(first, second)| pair_key(first, second) == key);
            return match (pair, answer) {
                (Some((first, second)), FormAnswer::Text(words)) => one_of(&[first, second], words),
                (Some((first, second)), _) => wrong(format!("{first} or {second}")),
                (None, _) => {
                    let expected = format!("one of {}", self.keys().join(", "));
                    Err(self.value_error("an item".to_owned(), key, expected))
                }
            };
        };
        let conditions: Vec<&str> = conditions.iter().map(String::as_str).collect();
        match (item, answer) {
            (FormItem::Scale { min, max, step, .. }, FormAnswer::Number(value)) => {
                let steps = (value - min) / step;
                match value >= min && value <= max && (steps - steps.round()).abs() < 1e-9 {
                    true => Ok(()),
                    false => wrong(format!("{min} to {max} in steps of {step}")),
                }
            }
            (FormItem::Choice { options, multiple: false, .. }, FormAnswer::Text(words)) => {
                one_of(&options.iter().map(|option| option.value.as_str()).collect::<Vec<_>>(), words)
            }
            (FormItem::Choice { options, multiple: true, .. }, FormAnswer::Multiple(chosen)) => {
                let known: Vec<&str> = options.iter().map(|option| option.value.as_str()).collect();
                let distinct: BTreeSet<&String> = chosen.iter().collect();
                if distinct.len() < chosen.len() {
                    return wrong("each answer once".to_owned());
                }
                chosen.iter().try_for_each(|choice| one_of(&known, choice))
            }
            (FormItem::Ranking { .. }, FormAnswer::Ranking(ranks)) => {
                let mut ranked: Vec<&str> = ranks.iter().flatten().map(String::as_str).collect();
                let mut all = conditions.clone();
                ranked.sort_unstable();
                all.sort_unstable();
                match ranked == all && ranks.iter().all(|rank| !rank.is_empty()) {
                    true => Ok(()),
                    false => wrong(format!("each of {} once", conditions.join(", "))),
                }
            }
            (FormItem::Condition { .. }, FormAnswer::Text(words)) => one_of(&conditions, words),
            (FormItem::Consent { version, .. }, FormAnswer::Text(words)) => match words == version {
                true => Ok(()),
                false => wrong(format!("version {version:?}")),
            },
            (FormItem::Text { .. }, FormAnswer::Text(words)) if words.len() <= MAX_TEXT_BYTES => Ok(()),
            (FormItem::Scale { min, max, .. }, _) => wrong(format!("a number from {min} to {max}")),
            (FormItem::Choice { multiple: true, .. }, _) => wrong("a list of answers".to_owned()),
            (FormItem::Ranking { .. }, _) => wrong("a list of places, each a list of conditions".to_owned()),
            (FormItem::Text { .. }, _) => wrong(format!("at most {MAX_TEXT_BYTES} bytes of text")),
            _ => wrong("a text".to_owned()),
        }
    }

    /// Keys of what has no answer and should have one.
    pub fn missing(&self, answers: &BTreeMap<String, FormAnswer>) -> Vec<String> {
        let optional = |key: &String| matches!(self.item(key), Some(FormItem::Text { optional: true, .. }));
        self.keys().into_iter().filter(|key| !answers.contains_key(key) && !optional(key)).collect()
    }

    /// Whether the form asks for consent.
    pub fn asks_for_consent(&self) -> bool {
        self.items.iter().any(|item| matches!(item, FormItem::Consent { .. }))
    }

    /// Whether the form asks for consent, and it was not given.
    pub fn lacks_consent(&self, answers: &BTreeMap<String, FormAnswer>) -> bool {
        let is_consent = |item: &&FormItem| matches!(item, FormItem::Consent { .. });
        self.items.iter().filter(is_consent).any(|item| !answers.contains_key(item.key()))
    }

    /// The scores of these answers; see [`Form::scores`].
    ///
    /// # Errors
    /// As [`Form::scores`].
    pub fn scores_of(
        &self,
        answers: &BTreeMap<String, FormAnswer>,
    ) -> Result<Vec<crate::FormScore>, FormError> {
        let mut ratings = BTreeMap::new();
        let mut chosen = BTreeMap::new();
        for (key, answer) in answers {
            match answer {
                FormAnswer::Number(number) => drop(ratings.insert(key.clone(), *number)),
                FormAnswer::Text(words) => drop(chosen.insert(key.clone(), words.clone())),
                FormAnswer::Multiple(_) | FormAnswer::Ranking(_) => {}
            }
        }
        self.scores(&ratings, &chosen)
    }

    /// Answers that could be somebody's, drawn at random: for rehearsals of a study. They say nothing about anything.
    pub fn random_answers(&self, conditions: &[String], seed: u64) -> Vec<(String, FormAnswer)> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut pick = |options: &[String]| options[random.random_range(0..options.len())].clone();
        let mut answers = Vec::new();
        for key in self.keys() {
            let answer = match self.item(&key) {
                Some(FormItem::Scale { min, max, step, .. }) => {
                    let steps = ((max - min) / step).round() as u64;
                    let scale_points: Vec<String> = (0..=steps).map(|k| k.to_string()).collect();
                    let scale_index: f64 = pick(&scale_points).parse().expect("each is a number");
                    FormAnswer::Number(min + step * scale_index)
                }
                Some(FormItem::Choice { options, multiple: several, .. }) => {
                    let values: Vec<String> = options.iter().map(|option| option.value.clone()).collect();
                    let choice = pick(&values);
                    if *several { FormAnswer::Multiple(vec![choice]) } else { FormAnswer::Text(choice) }
                }
                Some(FormItem::Ranking { .. }) => {
                    let first = pick(conditions);
                    let rest = conditions.iter().filter(|other| **other != first).cloned().collect();
                    let ranks = vec![vec![first], rest];
                    FormAnswer::Ranking(
                        ranks.into_iter().filter(|rank: &Vec<String>| !rank.is_empty()).collect(),
                    )
                }
                Some(FormItem::Condition { .. }) => FormAnswer::Text(pick(conditions)),
                Some(FormItem::Consent { version, .. }) => FormAnswer::Text(version.clone()),
                Some(FormItem::Text { .. }) => FormAnswer::Text("simulated".to_owned()),
                None => {
                    let pairs = self.pairs();
                    let pair = pairs.iter().find(|(first, second)| pair_key(first, second) == key);
                    let both: Vec<String> =
                        pair.iter().flat_map(|(a, b)| [(*a).to_owned(), (*b).to_owned()]).collect();
                    FormAnswer::Text(pick(&both))
                }
            };
            answers.push((key, answer));
        }
        // In which order they are answered does not matter.
        answers.shuffle(&mut ChaCha8Rng::seed_from_u64(seed ^ 1));
        answers
    }
}
