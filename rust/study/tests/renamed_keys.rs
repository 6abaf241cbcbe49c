//! A plan with the keys that were renamed since: it is the same as with the present ones.

use proact_study::StudyPlan;
use proact_types::renamed_keys::{ConfigFile, RENAMED_KEYS};

/// A plan that has all keys of the table, by their old names.
const OLD: &str = r#"
name = "old"
participants = 4

[[conditions]]
name = "A"
trial = { method = "A" }
begin = [{ do = "train", repetitions = 2, hold_secs = 3, pass_runs = 1, minutes = 10 }]
end = [{ do = "train", repetitions = 2, hold_secs = 3, pass_runs = 2, minutes = 10 }]

[[conditions]]
name = "D"
trial = { method = "D" }

[[conditions]]
name = "C"
trial = { method = "C" }

[order]
by = "balanced"
apart = [["A", "D"]]

[arrangements]
by = "balanced"
same = false

[[sessions]]
name = "1"
positions = [1, 2, 3]
trials = 4
begin = [{ do = "train", repetitions = 2, hold_secs = 3, pass_runs = 3, minutes = 10 }]
before_condition = [{ do = "train", repetitions = 2, hold_secs = 3, pass_runs = 4, minutes = 10 }]
after_condition = [{ do = "train", repetitions = 2, hold_secs = 3, pass_runs = 5, minutes = 10 }]
end = [{ do = "train", repetitions = 2, hold_secs = 3, pass_runs = 6, minutes = 10 }]
within = [{ after_trials = [1, 3], steps = [{ do = "train", repetitions = 2, hold_secs = 3, pass_runs = 7, minutes = 10 }] }]
rests = [{ after_trial = 2, minutes = 2 }]
"#;

fn with_present_names() -> String {
    let mut text = OLD.to_owned();
    for (old, new) in [
        ("apart =", "never_adjacent ="),
        ("same =", "same_for_all_conditions ="),
        ("positions =", "condition_positions ="),
        ("within =", "inter_trial_steps ="),
        ("rests =", "breaks ="),
        ("pass_runs =", "consecutive_correct_runs ="),
    ] {
        text = text.replace(old, new);
    }
    text
}

#[test]
fn a_plan_of_old_keys_is_that_of_the_present_ones_and_each_is_told() {
    let (mut noted, mut none) = (Vec::new(), Vec::new());
    let plan = StudyPlan::from_text_noting(OLD, &mut noted).expect("a good plan");
    assert_eq!(StudyPlan::from_text_noting(&with_present_names(), &mut none), Ok(plan.clone()));
    assert!(none.is_empty(), "{none:?}");
    assert_eq!(StudyPlan::from_text(OLD), Ok(plan), "journals are read without a word");
    let rows = RENAMED_KEYS.iter().filter(|row| row.file == ConfigFile::StudyPlan);
    assert_eq!(noted, rows.collect::<Vec<_>>(), "all that there are, in the order of the table");
}

#[test]
fn a_key_by_both_names_is_refused() {
    let both = OLD.replace("\nrests =", "\nbreaks = []\nrests =");
    let error = StudyPlan::from_text(&both).expect_err("both").to_string();
    assert_eq!(
        error,
        "the plan is unreadable: sessions[].rests is the old name of sessions[].breaks: both are given, expected \
         sessions[].breaks alone"
    );
}
