use crate::{Form, FormError, FormItem, pair_key};
use rand::{RngExt, SeedableRng, seq::SliceRandom};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// Longest answer in free words, bytes.
const MOST_WORDS: usize = 10_000;

/// What was answered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "ts", derive(ts_rs::TS))]
#[serde(untagged)]
pub enum Answer {
    /// On a scale.
    Number(f64),
    /// One of several answers, a condition, free words, or the version of what was agreed to.
    Words(String),
    /// Some of several answers.
    Several(Vec<String>),
    /// The conditions, place by place; several may share one.
    Places(Vec<Vec<String>>),
}

impl Answer {
    /// As in the tables: those of several with a comma between, those of a shared place with `=`.
    pub fn to_cell(&self) -> String {
        match self {
            Answer::Number(number) => number.to_string(),
            Answer::Words(words) => words.clone(),
            Answer::Several(several) => several.join(","),
            Answer::Places(places) => {
                places.iter().map(|place| place.join("=")).collect::<Vec<_>>().join(",")
            }
        }
    }

    /// From what a person types at a terminal for an item of this kind.
    pub fn typed(item: Option<&FormItem>, text: &str) -> Self {
        let parts = |text: &str, at: char| text.split(at).map(|part| part.trim().to_owned()).collect();
        match item {
            Some(FormItem::Scale { .. }) => {
                text.trim().parse().map_or_else(|_| Answer::Words(text.to_owned()), Answer::Number)
            }
            Some(FormItem::Choice { several: true, .. }) => Answer::Several(parts(text, ',')),
            Some(FormItem::Ranking { .. }) => {
                Answer::Places(text.split(',').map(|place| parts(place, '=')).collect())
            }
            _ => Answer::Words(text.trim().to_owned()),
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
    pub fn check_answer(&self, key: &str, answer: &Answer, conditions: &[String]) -> Result<(), FormError> {
        let wrong =
            |expected: String| Err(self.refused(format!("the answer to {key}"), answer.to_cell(), expected));
        let one_of = |known: &[&str], got: &str| match known.contains(&got) {
            true => Ok(()),
            false => wrong(format!("one of {}", known.join(", "))),
        };
        let Some(item) = self.item(key) else {
            let pair = self.pairs().into_iter().find(|(first, second)| pair_key(first, second) == key);
            return match (pair, answer) {
                (Some((first, second)), Answer::Words(words)) => one_of(&[first, second], words),
                (Some((first, second)), _) => wrong(format!("{first} or {second}")),
                (None, _) => {
                    let expected = format!("one of {}", self.keys().join(", "));
                    Err(self.refused("an item".to_owned(), key, expected))
                }
            };
        };
        let conditions: Vec<&str> = conditions.iter().map(String::as_str).collect();
        match (item, answer) {
            (FormItem::Scale { least, most, step, .. }, Answer::Number(value)) => {
                let steps = (value - least) / step;
                match value >= least && value <= most && (steps - steps.round()).abs() < 1e-9 {
                    true => Ok(()),
                    false => wrong(format!("{least} to {most} in steps of {step}")),
                }
            }
            (FormItem::Choice { options, several: false, .. }, Answer::Words(words)) => {
                one_of(&options.iter().map(|option| option.value.as_str()).collect::<Vec<_>>(), words)
            }
            (FormItem::Choice { options, several: true, .. }, Answer::Several(chosen)) => {
                let known: Vec<&str> = options.iter().map(|option| option.value.as_str()).collect();
                let distinct: BTreeSet<&String> = chosen.iter().collect();
                if distinct.len() < chosen.len() {
                    return wrong("each answer once".to_owned());
                }
                chosen.iter().try_for_each(|choice| one_of(&known, choice))
            }
            (FormItem::Ranking { .. }, Answer::Places(places)) => {
                let mut ranked: Vec<&str> = places.iter().flatten().map(String::as_str).collect();
                let mut all = conditions.clone();
                ranked.sort_unstable();
                all.sort_unstable();
                match ranked == all && places.iter().all(|place| !place.is_empty()) {
                    true => Ok(()),
                    false => wrong(format!("each of {} once", conditions.join(", "))),
                }
            }
            (FormItem::Condition { .. }, Answer::Words(words)) => one_of(&conditions, words),
            (FormItem::Consent { version, .. }, Answer::Words(words)) => match words == version {
                true => Ok(()),
                false => wrong(format!("version {version:?}")),
            },
            (FormItem::Text { .. }, Answer::Words(words)) if words.len() <= MOST_WORDS => Ok(()),
            (FormItem::Scale { least, most, .. }, _) => wrong(format!("a number from {least} to {most}")),
            (FormItem::Choice { several: true, .. }, _) => wrong("a list of answers".to_owned()),
            (FormItem::Ranking { .. }, _) => wrong("a list of places, each a list of conditions".to_owned()),
            (FormItem::Text { .. }, _) => wrong(format!("at most {MOST_WORDS} bytes of text")),
            _ => wrong("a text".to_owned()),
        }
    }

    /// Keys of what has no answer and should have one.
    pub fn missing(&self, answers: &BTreeMap<String, Answer>) -> Vec<String> {
        let optional = |key: &String| matches!(self.item(key), Some(FormItem::Text { optional: true, .. }));
        self.keys().into_iter().filter(|key| !answers.contains_key(key) && !optional(key)).collect()
    }

    /// Whether the form asks for consent.
    pub fn asks_for_consent(&self) -> bool {
        self.items.iter().any(|item| matches!(item, FormItem::Consent { .. }))
    }

    /// Whether the form asks for consent, and it was not given.
    pub fn lacks_consent(&self, answers: &BTreeMap<String, Answer>) -> bool {
        let asks = |item: &&FormItem| matches!(item, FormItem::Consent { .. });
        self.items.iter().filter(asks).any(|item| !answers.contains_key(item.key()))
    }

    /// The scores of these answers; see [`Form::scores`].
    ///
    /// # Errors
    /// As [`Form::scores`].
    pub fn scores_of(&self, answers: &BTreeMap<String, Answer>) -> Result<Vec<crate::FormScore>, FormError> {
        let mut ratings = BTreeMap::new();
        let mut chosen = BTreeMap::new();
        for (key, answer) in answers {
            match answer {
                Answer::Number(number) => drop(ratings.insert(key.clone(), *number)),
                Answer::Words(words) => drop(chosen.insert(key.clone(), words.clone())),
                Answer::Several(_) | Answer::Places(_) => {}
            }
        }
        self.scores(&ratings, &chosen)
    }

    /// Answers that could be somebody's, drawn at random: for rehearsals of a study. They say nothing about anything.
    pub fn rehearsed(&self, conditions: &[String], seed: u64) -> Vec<(String, Answer)> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut pick = |options: &[String]| options[random.random_range(0..options.len())].clone();
        let mut answers = Vec::new();
        for key in self.keys() {
            let answer = match self.item(&key) {
                Some(FormItem::Scale { least, most, step, .. }) => {
                    let steps = ((most - least) / step).round() as u64;
                    let places: Vec<String> = (0..=steps).map(|k| k.to_string()).collect();
                    let place: f64 = pick(&places).parse().expect("each is a number");
                    Answer::Number(least + step * place)
                }
                Some(FormItem::Choice { options, several, .. }) => {
                    let values: Vec<String> = options.iter().map(|option| option.value.clone()).collect();
                    let choice = pick(&values);
                    if *several { Answer::Several(vec![choice]) } else { Answer::Words(choice) }
                }
                Some(FormItem::Ranking { .. }) => {
                    let first = pick(conditions);
                    let rest = conditions.iter().filter(|other| **other != first).cloned().collect();
                    let places = vec![vec![first], rest];
                    Answer::Places(
                        places.into_iter().filter(|place: &Vec<String>| !place.is_empty()).collect(),
                    )
                }
                Some(FormItem::Condition { .. }) => Answer::Words(pick(conditions)),
                Some(FormItem::Consent { version, .. }) => Answer::Words(version.clone()),
                Some(FormItem::Text { .. }) => Answer::Words("simulated".to_owned()),
                None => {
                    let pairs = self.pairs();
                    let pair = pairs.iter().find(|(first, second)| pair_key(first, second) == key);
                    let both: Vec<String> =
                        pair.iter().flat_map(|(a, b)| [(*a).to_owned(), (*b).to_owned()]).collect();
                    Answer::Words(pick(&both))
                }
            };
            answers.push((key, answer));
        }
        // In which order they are answered does not matter.
        answers.shuffle(&mut ChaCha8Rng::seed_from_u64(seed ^ 1));
        answers
    }
}
