//! What people answered: ratings, rankings and scores.

use super::{
    AnalysisData,
    summaries::{NaturalSortKey, ParticipantValue, ReportTable, SUMMARY_HEADERS, participant, summary_rows},
};
use std::collections::{BTreeMap, BTreeSet};

/// Ratings of conditions, by questionnaire and item: answers that are numbers.
pub(super) fn ratings_by_item(collected: &AnalysisData) -> BTreeMap<(String, String), Vec<ParticipantValue>> {
    let mut rated: BTreeMap<(String, String), Vec<ParticipantValue>> = BTreeMap::new();
    let Some(answers) = collected.table("answers") else { return rated };
    for row in &answers.rows {
        let (Some(value), condition) = (answers.number(row, "answer"), answers.text(row, "condition")) else {
            continue;
        };
        if condition.is_empty() {
            continue;
        }
        let key = (answers.text(row, "form"), answers.text(row, "item"));
        rated.entry(key).or_default().push(ParticipantValue {
            participant: participant(answers, row),
            condition,
            value,
        });
    }
    rated
}

pub(super) fn ratings(collected: &AnalysisData, conditions: &[String]) -> Option<ReportTable> {
    let mut rows = Vec::new();
    for ((form, item), found) in ratings_by_item(collected) {
        for mut row in summary_rows(conditions, &found, 2) {
            row.insert(0, format!("{form}: {item}"));
            rows.push(row);
        }
    }
    (!rows.is_empty()).then(|| ReportTable {
        name: "ratings",
        title: "Ratings".to_owned(),
        caption: "Answers on scales, by questionnaire and item; questions.csv of the export has their words."
            .to_owned(),
        headers: std::iter::once("Item").chain(SUMMARY_HEADERS).map(str::to_owned).collect(),
        rows,
    })
}

/// Places of the conditions in a ranking such as `D=C,A,B`; none for other answers.
pub(super) fn parse_ranking(answer: &str, conditions: &[String]) -> Option<Vec<Vec<String>>> {
    let ranks: Vec<Vec<String>> =
        answer.split(',').map(|rank| rank.split('=').map(|name| name.trim().to_owned()).collect()).collect();
    let mut named: Vec<&String> = ranks.iter().flatten().collect();
    named.sort();
    named.dedup();
    let all = named.len() == conditions.len() && named.iter().all(|name| conditions.contains(name));
    (conditions.len() > 1 && all && ranks.iter().map(Vec::len).sum::<usize>() == conditions.len())
        .then_some(ranks)
}

pub(super) fn rankings(collected: &AnalysisData, conditions: &[String]) -> Option<ReportTable> {
    let answers = collected.table("answers")?;
    let mut items: Vec<String> = Vec::new();
    let mut cells: BTreeMap<(NaturalSortKey, String), String> = BTreeMap::new();
    for row in &answers.rows {
        let answer = answers.text(row, "answer");
        let ranking = match parse_ranking(&answer, conditions) {
            Some(ranks) => ranks.iter().map(|rank| rank.join(" = ")).collect::<Vec<_>>().join(" > "),
            // One last trial: which.
            None if answers.text(row, "condition").is_empty() && conditions.contains(&answer) => answer,
            None => continue,
        };
        let item = answers.text(row, "item");
        if !items.contains(&item) {
            items.push(item.clone());
        }
        cells.insert((NaturalSortKey::of(participant(answers, row)), item), ranking);
    }
    let people: BTreeSet<NaturalSortKey> = cells.keys().map(|(who, _)| who.clone()).collect();
    let row = |who: &NaturalSortKey| {
        let cell = |item: &String| {
            cells.get(&(who.clone(), item.clone())).cloned().unwrap_or_else(|| "–".to_owned())
        };
        std::iter::once(who.name.clone()).chain(items.iter().map(cell)).collect()
    };
    (!items.is_empty()).then(|| ReportTable {
        name: "rankings",
        title: "Rankings and choices".to_owned(),
        caption: "Best first; = between methods that share a place.".to_owned(),
        headers: std::iter::once("P".to_owned())
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
pub(super) fn scores_by_form(collected: &AnalysisData) -> BTreeMap<String, Vec<ParticipantValue>> {
    let mut found: BTreeMap<String, Vec<ParticipantValue>> = BTreeMap::new();
    let Some(scores) = collected.table("scores") else { return found };
    for row in &scores.rows {
        let (Some(value), condition) = (scores.number(row, "value"), scores.text(row, "condition")) else {
            continue;
        };
        if !condition.is_empty() {
            found
                .entry(score_name(&scores.text(row, "form"), &scores.text(row, "score_name")))
                .or_default()
                .push(ParticipantValue { participant: participant(scores, row), condition, value });
        }
    }
    found
}

pub(super) fn questionnaires(collected: &AnalysisData, conditions: &[String]) -> Option<ReportTable> {
    let mut rows = Vec::new();
    for (name, found) in scores_by_form(collected) {
        for mut row in summary_rows(conditions, &found, 1) {
            row.insert(0, name.clone());
            rows.push(row);
        }
    }
    (!rows.is_empty()).then(|| ReportTable {
        name: "questionnaires",
        title: "Questionnaires".to_owned(),
        caption: "Scores as each instrument defines them.".to_owned(),
        headers: std::iter::once("Score").chain(SUMMARY_HEADERS).map(str::to_owned).collect(),
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
        let ranks = parse_ranking("D=C,A,B", &conditions).unwrap();
        assert_eq!(ranks, [vec!["D", "C"], vec!["A"], vec!["B"]]);
        for other in ["D", "A,B,C", "A,B,C,C", "A,B,C,D,A", "3", ""] {
            assert_eq!(parse_ranking(other, &conditions), None, "{other}");
        }
    }
}
