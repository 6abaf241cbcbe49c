//! A trial scored from its bag beside the same trial recomputed from its input log: scores taken from bags had 1.6 m of shoulder
//! motion and joint jumps that never happened, for the first instants were scored before any pose had been received.

use super::*;
use crate::{
    Registry,
    analysis::scores::empty,
    study::{TrialOrder, simulated_trial},
};
use proact_analysis::{limits::impossible, table::Cell};
use proact_recording::{TrialHeader, TrialWriter};
use proact_study::TrialChoice;
use proact_testbed::TrialConfig;
use std::sync::atomic::AtomicBool;

/// Each method, task and arm with most of the others. Reaching in space has no object to take, which C and D need; the other arm has
/// joints that turn beyond half a turn.
const TRIALS: [(&str, &str, &str); 12] = [
    ("A", "modified_bbt", "mpl_right"),
    ("A", "targeted_bbt", "wam"),
    ("A", "reaching", "mpl_right"),
    ("B", "modified_bbt", "wam"),
    ("B", "targeted_bbt", "mpl_right"),
    ("B", "reaching", "wam"),
    ("C", "modified_bbt", "mpl_right"),
    ("C", "targeted_bbt", "mpl_right"),
    ("C", "modified_bbt", "wam"),
    ("D", "modified_bbt", "wam"),
    ("D", "targeted_bbt", "wam"),
    ("D", "modified_bbt", "mpl_right"),
];
/// Long enough for a pick and a place with C and D; with A and B for a pick.
const LIMIT_SECS: f64 = 25.0;
/// A bag holds every number that is scored to the last bit, but turns joints into (-pi, pi], normalises quaternions and directions:
/// a few units in the last place, which sums over some thousand instants make larger.
const TOLERANCE: f64 = 1e-9;

fn record(place: &Path, (method, task, arm): (&str, &str, &str)) -> PathBuf {
    let dir = place.join(format!("{method}-{task}-{arm}"));
    let choice = TrialChoice {
        method: Some(method.to_owned()),
        task: Some(task.to_owned()),
        arm: Some(arm.to_owned()),
        limit_secs: Some(LIMIT_SECS),
        ..TrialChoice::default()
    };
    let order = TrialOrder {
        choice,
        seed: 3,
        arrangement: None,
        dir: Some(dir.clone()),
        bag: "trial.bag".to_owned(),
        place: None,
        scored: true,
    };
    let done = simulated_trial(&Registry::standard(), &order, &AtomicBool::new(false)).unwrap();
    // As it ran, it is scored to the same numbers as recomputed.
    let OfRecord { trace, flaws } = of_record(&MethodRegistry::standard(), &dir).unwrap();
    assert_eq!(flaws, [], "{}", dir.display());
    let [measures, objects, phases, faults] = scores(&[], &trace);
    assert_eq!(done.scores.unwrap(), TrialScores { measures, objects, phases, faults }, "{}", dir.display());
    dir
}

/// The record in `dir` again in `other`, with another head.
fn again(dir: &Path, other: &Path, change: impl FnOnce(&mut TrialHeader)) {
    let Checked { record, recorded, result, .. } = check_record(dir, true).unwrap();
    let mut header = record.header().clone();
    change(&mut header);
    let mut writer = TrialWriter::create(other, &header).unwrap();
    for input in record.inputs().unwrap() {
        let input = input.unwrap();
        writer.write_input(input.tick, &input.input).unwrap();
    }
    record.events().unwrap().iter().for_each(|event| writer.write_event(event).unwrap());
    recorded.iter().for_each(|span| writer.write_digest(span).unwrap());
    fs::copy(dir.join("trial.bag"), other.join("trial.bag")).unwrap();
    writer.finish(record.end(), &result.unwrap()).unwrap();
}

#[test]
fn a_record_that_becomes_another_trial_or_is_of_another_program_is_scored_from_its_bag_and_marked() {
    let place = tempfile::tempdir().unwrap();
    let dir = record(place.path(), ("D", "modified_bbt", "mpl_right"));
    let methods = MethodRegistry::standard();
    let expected = of_record(&methods, &dir).unwrap().trace;
    let (diverged, foreign) = (place.path().join("diverged"), place.path().join("foreign"));
    again(&dir, &diverged, |header| {
        let mut config = TrialConfig::from_toml(&header.config_toml).unwrap();
        config.intent.sigma *= 4.0;
        header.config_toml = config.to_toml().unwrap();
    });
    again(&dir, &foreign, |header| {
        header.versions.insert("KDL".to_owned(), "0.0.1".to_owned());
    });
    for (dir, flaw, told) in
        [(diverged, "diverged", "is not the recorded one between"), (foreign, "foreign", "KDL 0.0.1")]
    {
        let OfRecord { trace, flaws } = of_record(&methods, &dir).unwrap();
        assert_eq!(flaws.iter().map(Flaw::label).collect::<Vec<_>>(), [flaw]);
        assert!(flaws[0].to_string().contains(told), "{}", flaws[0]);
        assert_eq!(trace.instants.len(), expected.instants.len());
    }
}

fn near(a: &Cell, b: &Cell) -> bool {
    match (a, b) {
        (Cell::Real(a), Cell::Real(b)) => (a - b).abs() <= TOLERANCE * a.abs().max(1.0),
        _ => a == b,
    }
}

#[test]
fn twelve_trials_have_the_same_tables_from_their_bags_and_recomputed_and_no_value_that_cannot_be() {
    let place = tempfile::tempdir().unwrap();
    let mut rows_compared = 0;
    for trial in TRIALS {
        let dir = record(place.path(), trial);
        let recomputed = of_record(&MethodRegistry::standard(), &dir).unwrap().trace;
        let checked = check_record(&dir, false).unwrap();
        let from_bag = of_record_from_bag(&dir, &checked, &dir.join("trial.bag")).unwrap();
        let key = vec![Cell::Missing; 5];
        let [recomputed, from_bag] = [recomputed, from_bag].map(|trace| scores(&key, &trace));
        for ((mut table, recomputed), from_bag) in empty().into_iter().zip(recomputed).zip(from_bag) {
            assert_eq!(recomputed.len(), from_bag.len(), "rows of {} of {trial:?}", table.name);
            for (recomputed, from_bag) in recomputed.iter().zip(&from_bag) {
                rows_compared += 1;
                for ((column, a), b) in table.columns.iter().zip(recomputed).zip(from_bag) {
                    assert!(
                        near(a, b),
                        "{trial:?}, {} in {}: recomputed {a}, from the bag {b}",
                        column.name,
                        table.name
                    );
                }
            }
            crate::analysis::append(&mut table, recomputed);
            assert_eq!(impossible(&table), [], "{trial:?}: {:?}", table.rows);
        }
    }
    assert!(rows_compared > 60, "{rows_compared}");
}
