//! The questionnaires that ship, and their scores.

#![allow(missing_docs)]
#![allow(clippy::unwrap_used)]

use proact_study::{Form, FormItem, SHIPPED_FORMS, pair_key};
use std::collections::BTreeMap;

fn form(name: &str) -> Form {
    let (_, text) = SHIPPED_FORMS.iter().find(|(other, _)| *other == name).unwrap();
    Form::from_text(text).unwrap()
}

fn ratings(form: &Form, values: &[f64]) -> BTreeMap<String, f64> {
    form.items.iter().map(|item| item.key().to_owned()).zip(values.iter().copied()).collect()
}

/// The first of each pair is chosen.
fn firsts(form: &Form) -> BTreeMap<String, String> {
    form.pairs().into_iter().map(|(a, b)| (pair_key(a, b), a.to_owned())).collect()
}

#[test]
fn forms_are_called_as_they_are_found_and_say_where_they_are_from() {
    for (name, _) in SHIPPED_FORMS {
        let form = form(name);
        assert_eq!(form.name, *name);
        assert!(!form.source.is_empty() && !form.license.is_empty() && form.title.contains_key("en"));
    }
    assert!(!form("pros_tlx").wording_verified, "its wording could not be looked up");
}

#[test]
fn the_task_load_index_is_the_mean_and_the_mean_by_choices() {
    let tlx = form("nasa_tlx");
    assert_eq!(tlx.pairs().len(), 15);
    let given = ratings(&tlx, &[100.0, 50.0, 0.0, 25.0, 75.0, 10.0]);
    let scores = tlx.scores(&given, &firsts(&tlx)).unwrap();
    // Weights are 5, 4, 3, 2, 1, 0 of 15.
    assert!((scores[0].value.unwrap() - 260.0 / 6.0).abs() < 1e-12);
    assert!((scores[1].value.unwrap() - (500.0 + 200.0 + 50.0 + 75.0) / 15.0).abs() < 1e-12);
    assert_eq!((scores[0].name.as_str(), scores[1].name.as_str()), ("nasa_tlx_raw", "nasa_tlx_weighted"));

    let mut some = given.clone();
    some.remove("effort");
    let scores = tlx.scores(&some, &firsts(&tlx)).unwrap();
    assert_eq!((scores[0].value, scores[1].value), (None, None));
    assert_eq!(scores[0].missing, ["effort"]);
    // Without choices the raw score alone.
    let scores = tlx.scores(&given, &BTreeMap::new()).unwrap();
    assert!(scores[0].value.is_some() && scores[1].value.is_none() && scores[1].missing.len() == 15);

    let pros = form("pros_tlx");
    assert_eq!(pros.pairs().len(), 28);
    let scores = pros.scores(&ratings(&pros, &[7.0; 8]), &firsts(&pros)).unwrap();
    assert!(scores.iter().all(|score| (score.value.unwrap() - 7.0).abs() < 1e-12));
}

#[test]
fn the_usability_scale_runs_from_0_to_100_and_takes_the_middle_for_what_is_missing() {
    let sus = form("sus");
    let best: Vec<f64> = (0..10).map(|k| if k % 2 == 0 { 5.0 } else { 1.0 }).collect();
    let worst: Vec<f64> = best.iter().map(|value| 6.0 - value).collect();
    let score = |values: &[f64]| sus.scores(&ratings(&sus, values), &BTreeMap::new()).unwrap().remove(0);
    assert_eq!(score(&best).value, Some(100.0));
    assert_eq!(score(&worst).value, Some(0.0));
    assert_eq!(score(&[3.0; 10]).value, Some(50.0));
    let nine = score(&best[..9]);
    assert_eq!((nine.value, nine.missing), (Some(95.0), vec!["sus_10".to_owned()]));
    // Nobody's opinion is not the middle.
    let none = score(&[]);
    assert_eq!((none.value, none.missing.len()), (None, 10));
}

#[test]
fn answers_beside_their_scale_and_forms_that_cannot_be_are_refused_by_name() {
    let sus = form("sus");
    for wrong in [0.0, 6.0, 2.5, f64::NAN] {
        let error = sus.scores(&ratings(&sus, &[wrong]), &BTreeMap::new()).unwrap_err().to_string();
        assert!(
            error.contains("form sus: the answer to sus_1 is") && error.contains("expected 1 to 5"),
            "{error}"
        );
    }
    let tlx = form("nasa_tlx");
    let mut chosen = firsts(&tlx);
    chosen.insert(pair_key("mental_demand", "effort"), "frustration".to_owned());
    let error = tlx.scores(&ratings(&tlx, &[50.0; 6]), &chosen).unwrap_err().to_string();
    assert!(error.contains("expected mental_demand or effort"), "{error}");

    let (_, text) = SHIPPED_FORMS.iter().find(|(name, _)| *name == "sus").unwrap();
    for (from, to, expected) in [
        ("step = 1", "step = 0", "the scale of sus_1 is 1 to 5 by 0"),
        ("step = 1", "step = 3", "the scale of sus_1 is 1 to 5 by 3"),
        ("key = \"sus_2\"", "key = \"sus_1\"", "a key is \"sus_1\""),
        ("kind = \"scale\"", "kind = \"slider\"", "unknown variant `slider`"),
        ("by = \"usability\"", "by = \"magic\"", "unknown variant `magic`"),
    ] {
        let error = Form::from_text(&text.replacen(from, to, 1)).unwrap_err().to_string();
        assert!(error.contains(expected), "{to}: {error}");
    }
}

#[test]
fn the_participants_form_asks_for_nothing_that_tells_who_somebody_is() {
    for item in form("participant").items {
        assert!(
            matches!(item, FormItem::Choice { .. } | FormItem::Consent { .. }),
            "{} is no choice",
            item.key()
        );
    }
}
