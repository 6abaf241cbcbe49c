//! What people answered: ratings, rankings and scores.

use super::{
    Collected,
    summaries::{Ordered, ReportTable, SUMMED_UP, Value, participant, summed_up},
};
use std::collections::{BTreeMap, BTreeSet};

/// Ratings of conditions, by questionnaire and item: answers that are numbers.
pub(super) fn rated(collected: &Collected) -> BTreeMap<(String, String), Vec<Value>> {
    let mut rated: BTreeMap<(String, String), Vec<Value>> = BTreeMap::new();
    let Some(answers) = collected.table("answers") else { return rated };
    for row in &answers.rows {
        let (Some(value), condition) = (answers.number(row, "answer"), answers.words(row, "condition"))
        else {
            continue;
        };
        if condition.is_empty() {
            continue;
        }
        let key = (answers.words(row, "form"), answers.words(row, "item"));
        rated.entry(key).or_default().push(Value {
            participant: participant(answers, row),
            condition,
            value,
        });
    }
    rated
}

pub(super) fn ratings(collected: &Collected, conditions: &[String]) -> Option<ReportTable> {
    let mut rows = Vec::new();
    for ((form, item), found) in rated(collected) {
        for mut row in summed_up(conditions, &found, 2) {
            row.insert(0, format!("{form}: {item}"));
            rows.push(row);
        }
    }
    (!rows.is_empty()).then(|| ReportTable {
        name: "ratings",
        title: "Ratings".to_owned(),
        caption: "Answers on scales, by questionnaire and item; questions.csv of the export has their words."
            .to_owned(),
        head: std::iter::once("Item").chain(SUMMED_UP).map(str::to_owned).collect(),
        rows,
    })
}

/// Places of the conditions in a ranking such as `D=C,A,B`; none for other answers.
pub(super) fn ranking(answer: &str, conditions: &[String]) -> Option<Vec<Vec<String>>> {
    let places: Vec<Vec<String>> = answer
        .split(',')
        .map(|place| place.split('=').map(|name| name.trim().to_owned()).collect())
        .collect();
    let mut named: Vec<&String> = places.iter().flatten().collect();
    named.sort();
    named.dedup();
    let all = named.len() == conditions.len() && named.iter().all(|name| conditions.contains(name));
    (conditions.len() > 1 && all && places.iter().map(Vec::len).sum::<usize>() == conditions.len())
        .then_some(places)
}

pub(super) fn rankings(collected: &Collected, conditions: &[String]) -> Option<ReportTable> {
    let answers = collected.table("answers")?;
    let mut items: Vec<String> = Vec::new();
    let mut cells: BTreeMap<(Ordered, String), String> = BTreeMap::new();
    for row in &answers.rows {
        let answer = answers.words(row, "answer");
        let told = match ranking(&answer, conditions) {
            Some(places) => places.iter().map(|place| place.join(" = ")).collect::<Vec<_>>().join(" > "),
            // One last trial: which.
            None if answers.words(row, "condition").is_empty() && conditions.contains(&answer) => answer,
            None => continue,
        };
        let item = answers.words(row, "item");
        if !items.contains(&item) {
            items.push(item.clone());
        }
        cells.insert((Ordered::of(participant(answers, row)), item), told);
    }
    let people: BTreeSet<Ordered> = cells.keys().map(|(who, _)| who.clone()).collect();
    let row = |who: &Ordered| {
        let cell = |item: &String| {
            cells.get(&(who.clone(), item.clone())).cloned().unwrap_or_else(|| "–".to_owned())
        };
        std::iter::once(who.name.clone()).chain(items.iter().map(cell)).collect()
    };
    (!items.is_empty()).then(|| ReportTable {
        name: "rankings",
        title: "Rankings and choices".to_owned(),
        caption: "Best first; = between methods that share a place.".to_owned(),
        head: std::iter::once("P".to_owned())
            .chain(items.iter().map(|item| item.replace('_', " ")))
            .collect(),
        rows: people.iter().map(row).collect(),
    })
}

/// What a score is called: an instrument's own begin with its name.
fn score_name(form: &str, score: &str) -> String {
    let name = if score.starts_with(form) { score.to_owned() } else { format!("{form}: {score}") };
    name.replace('_', " ")
}

/// Scores of questionnaires about conditions, by questionnaire and score.
pub(super) fn scored(collected: &Collected) -> BTreeMap<String, Vec<Value>> {
    let mut found: BTreeMap<String, Vec<Value>> = BTreeMap::new();
    let Some(scores) = collected.table("scores") else { return found };
    for row in &scores.rows {
        let (Some(value), condition) = (scores.number(row, "value"), scores.words(row, "condition")) else {
            continue;
        };
        if !condition.is_empty() {
            found
                .entry(score_name(&scores.words(row, "form"), &scores.words(row, "score")))
                .or_default()
                .push(Value { participant: participant(scores, row), condition, value });
        }
    }
    found
}

pub(super) fn questionnaires(collected: &Collected, conditions: &[String]) -> Option<ReportTable> {
    let mut rows = Vec::new();
    for (name, found) in scored(collected) {
        for mut row in summed_up(conditions, &found, 1) {
            row.insert(0, name.clone());
            rows.push(row);
        }
    }
    (!rows.is_empty()).then(|| ReportTable {
        name: "questionnaires",
        title: "Questionnaires".to_owned(),
        caption: "Scores as each instrument defines them.".to_owned(),
        head: std::iter::once("Score").chain(SUMMED_UP).map(str::to_owned).collect(),
        rows,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_score_is_called_by_its_instrument_once() {
        assert_eq!(score_name("nasa_tlx", "nasa_tlx_raw"), "nasa tlx raw");
        assert_eq!(score_name("own", "trust"), "own: trust");
    }

    #[test]
    fn rankings_with_ties_are_read_and_other_answers_are_not() {
        let conditions = ["A", "B", "C", "D"].map(str::to_owned);
        let places = ranking("D=C,A,B", &conditions).unwrap();
        assert_eq!(places, [vec!["D", "C"], vec!["A"], vec!["B"]]);
        for other in ["D", "A,B,C", "A,B,C,C", "A,B,C,D,A", "3", ""] {
            assert_eq!(ranking(other, &conditions), None, "{other}");
        }
    }
}
