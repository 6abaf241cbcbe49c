//! A trial scored from its bag beside the same trial recomputed from its input log: scores taken from bags had 1.6 m of shoulder
//! motion and joint jumps that never happened, for the first instants were scored before any pose had been received.

use super::*;
use crate::{
    Registry,
    analysis::scores::empty_score_tables,
    study::{TrialJob, run_simulated_trial},
};
use proact_analysis::{plausibility::find_implausible_values, table::TableCell};
use proact_recording::{TrialHeader, TrialWriter};
use proact_study::TrialOptions;
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

fn record(parent: &Path, of: (&str, &str, &str)) -> PathBuf {
    record_arranged(parent, of, None)
}

/// A trial whose blocks stand in `arrangement`, or where the seed puts them.
fn record_arranged(parent: &Path, of: (&str, &str, &str), arrangement: Option<String>) -> PathBuf {
    let (method, task, arm) = of;
    let dir = parent.join(format!("{method}-{task}-{arm}{}", arrangement.as_deref().unwrap_or("")));
    let choice = TrialOptions {
        method: Some(method.to_owned()),
        task: Some(task.to_owned()),
        arm: Some(arm.to_owned()),
        limit_secs: Some(LIMIT_SECS),
        ..TrialOptions::default()
    };
    let order = TrialJob {
        options: choice,
        seed: 3,
        arrangement,
        dir: Some(dir.clone()),
        bag: "trial.bag".to_owned(),
        study_place: None,
        with_scores: true,
    };
    let done = run_simulated_trial(&Registry::standard(), &order, &AtomicBool::new(false)).unwrap();
    // As it ran, it is scored to the same numbers as recomputed.
    let RecordTrace { trace, flaws } = trace_from_record(&MethodRegistry::standard(), &dir).unwrap();
    assert_eq!(flaws, [], "{}", dir.display());
    let [measures, objects, phases, faults] = score_rows(&[], &trace);
    assert_eq!(done.scores.unwrap(), TrialScores { measures, objects, phases, faults }, "{}", dir.display());
    dir
}

/// The record in `dir` again in `other`, with another head.
fn again(dir: &Path, other: &Path, change: impl FnOnce(&mut TrialHeader)) {
    let CheckedRecord { record, recorded_spans: recorded, result, .. } = check_record(dir, true).unwrap();
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
    let temp_dir = tempfile::tempdir().unwrap();
    let dir = record(temp_dir.path(), ("D", "modified_bbt", "mpl_right"));
    let methods = MethodRegistry::standard();
    let expected = trace_from_record(&methods, &dir).unwrap().trace;
    let (diverged, foreign) = (temp_dir.path().join("diverged"), temp_dir.path().join("foreign"));
    again(&dir, &diverged, |header| {
        let mut config = TrialConfig::from_toml(&header.config_toml).unwrap();
        config.intent.gaze_sigma *= 4.0;
        header.config_toml = config.to_toml().unwrap();
    });
    again(&dir, &foreign, |header| {
        header.versions.insert("KDL".to_owned(), "0.0.1".to_owned());
    });
    for (dir, flaw, expected_text) in
        [(diverged, "diverged", "is not the recorded one between"), (foreign, "foreign", "KDL 0.0.1")]
    {
        let RecordTrace { trace, flaws } = trace_from_record(&methods, &dir).unwrap();
        assert_eq!(flaws.iter().map(Flaw::label).collect::<Vec<_>>(), [flaw]);
        assert!(flaws[0].to_string().contains(expected_text), "{}", flaws[0]);
        assert_eq!(trace.points.len(), expected.points.len());
    }
}

fn near(a: &TableCell, b: &TableCell) -> bool {
    match (a, b) {
        (TableCell::Number(a), TableCell::Number(b)) => (a - b).abs() <= TOLERANCE * a.abs().max(1.0),
        _ => a == b,
    }
}

#[test]
fn twelve_trials_have_the_same_tables_from_their_bags_and_recomputed_and_no_value_that_cannot_be() {
    let temp_dir = tempfile::tempdir().unwrap();
    let mut rows_compared = 0;
    for trial in TRIALS {
        let dir = record(temp_dir.path(), trial);
        let recomputed = trace_from_record(&MethodRegistry::standard(), &dir).unwrap().trace;
        let checked = check_record(&dir, false).unwrap();
        let (from_bag, gap) = trace_from_record_bag(&dir, &checked, &dir.join("trial.bag")).unwrap();
        assert_eq!(gap, None);
        let key = vec![TableCell::Missing; 5];
        let [recomputed, from_bag] = [recomputed, from_bag].map(|trace| score_rows(&key, &trace));
        for ((mut table, recomputed), from_bag) in
            empty_score_tables().into_iter().zip(recomputed).zip(from_bag)
        {
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
            assert_eq!(find_implausible_values(&table), [], "{trial:?}: {:?}", table.rows);
        }
    }
    assert!(rows_compared > 60, "{rows_compared}");
}

/// Caught: a bag alone was judged from the default arrangement, so that blocks which were never touched had been moved.
#[test]
fn twelve_trials_of_other_arrangements_have_the_outcomes_of_their_records_from_the_bag_alone() {
    let temp_dir = tempfile::tempdir().unwrap();
    let arm = Arm::load(TrialConfig::DEFAULT_ARM).unwrap();
    let own = bag_playback::default_task().scene().objects[0].pose;
    let mut elsewhere = 0;
    for (k, arrangement) in proact_tasks::Arrangement::all().step_by(2).enumerate() {
        let of = (["A", "B", "C", "D"][k % 4], "modified_bbt", TrialConfig::DEFAULT_ARM);
        let dir = record_arranged(temp_dir.path(), of, Some(arrangement.to_string()));
        let recorded = check_record(&dir, false).unwrap().result.unwrap();
        let BagTrace { trace, result, .. } = trace_from_bag(&dir.join("trial.bag"), &arm).unwrap();
        let outcomes = |result: &Map<String, Value>| {
            let lines = proact_tasks::object_results(result).unwrap();
            lines.into_iter().map(|line| (line.block, line.outcome)).collect::<Vec<_>>()
        };
        assert_eq!(outcomes(&result.unwrap().result), outcomes(&recorded.result), "{arrangement}");
        let start = trace.scene.objects[0].pose;
        elsewhere += usize::from((start.translation.vector - own.translation.vector).norm() > 0.05);
    }
    assert!(elsewhere > 6, "the trials are of other arrangements: {elsewhere}");
}
