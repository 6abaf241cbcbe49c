//! The generators' properties, for 2 to 12 conditions and 2 to 48 participants, and what the check finds on the plans that ship.

#![allow(missing_docs)]
#![allow(clippy::unwrap_used)]

use proact_study::{
    CounterbalanceReport, PlannedStep, PlannedTrial, ProtocolStep, SHIPPED_PLANS, SessionItem, StudyPlan,
};
use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// The four places of four blocks, in all orders.
fn pool() -> Vec<String> {
    let regions = ["FL", "FM", "NL", "NM"];
    let all = (0..256usize).map(|k| [k / 64, k / 16 % 4, k / 4 % 4, k % 4]);
    let different = all.filter(|four| four.iter().collect::<BTreeSet<_>>().len() == 4);
    different.map(|four| four.map(|k| regions[k]).join(",")).collect()
}

fn shipped(name: &str) -> StudyPlan {
    let (_, text) = SHIPPED_PLANS.iter().find(|(other, _)| *other == name).unwrap();
    StudyPlan::from_text(text).unwrap()
}

/// A plan of `conditions` (c1, c2, ..) and `participants`, with one session of `trials` each.
fn plan(conditions: usize, participants: usize, order: &str, trials: usize, arrangements: &str) -> StudyPlan {
    let names: String = (1..=conditions)
        .map(|k| format!("[[conditions]]\nname = \"c{k}\"\ntrial = {{ method = \"A\" }}\n"))
        .collect();
    let text = format!(
        "name = \"p\"\nparticipants = {participants}\n{names}[order]\n{order}\n{arrangements}\n[[sessions]]\nname = \"1\"\n\
         trials = {trials}\n"
    );
    StudyPlan::from_text(&text).unwrap()
}

/// Conditions in each participant's order, from 0.
fn rows(plan: &StudyPlan) -> Vec<Vec<usize>> {
    let schedule = plan.schedule(&pool()).unwrap();
    let mut rows: BTreeMap<usize, BTreeMap<usize, usize>> = BTreeMap::new();
    for PlannedTrial { participant, position, condition, .. } in schedule.trials() {
        let index = plan.conditions.iter().position(|c| c.name == *condition).unwrap();
        rows.entry(*participant).or_default().insert(*position, index);
    }
    rows.into_values().map(|row| row.into_values().collect()).collect()
}

/// Largest less smallest count of a condition in a place.
fn uneven_places(rows: &[Vec<usize>]) -> usize {
    let count = rows[0].len();
    let mut counts = vec![0; count * count];
    for row in rows {
        for (position, condition) in row.iter().enumerate() {
            counts[position * count + condition] += 1;
        }
    }
    counts.iter().max().unwrap() - counts.iter().min().unwrap()
}

/// The same for who follows whom.
fn uneven_pairs(rows: &[Vec<usize>]) -> usize {
    let count = rows[0].len();
    let mut counts: BTreeMap<(usize, usize), usize> =
        (0..count).flat_map(|a| (0..count).filter(move |b| a != *b).map(move |b| ((a, b), 0))).collect();
    for pair in rows.iter().flat_map(|row| row.windows(2)) {
        *counts.get_mut(&(pair[0], pair[1])).unwrap() += 1;
    }
    counts.values().max().unwrap() - counts.values().min().unwrap()
}

fn each_condition_once(rows: &[Vec<usize>]) {
    for row in rows {
        assert_eq!(row.iter().collect::<BTreeSet<_>>().len(), row.len(), "{row:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(48) })]

    #[test]
    fn designs_have_each_condition_once_and_even_places(conditions in 2_usize..=12, participants in 2_usize..=48) {
        for order in ["by = \"latin_square\"", "by = \"williams\"", "by = \"balanced\""] {
            let rows = rows(&plan(conditions, participants, order, 1, ""));
            prop_assert_eq!(rows.len(), participants);
            each_condition_once(&rows);
            // Two squares of an odd Williams design make the places even after each of them alone.
            let even = participants.is_multiple_of(conditions);
            prop_assert!(uneven_places(&rows) <= usize::from(!even), "{}: {:?}", order, rows);
        }
        let rows = rows(&plan(conditions, participants, "by = \"williams\"", 1, ""));
        let whole = if conditions.is_multiple_of(2) { conditions } else { 2 * conditions };
        if participants.is_multiple_of(whole) {
            prop_assert_eq!(uneven_pairs(&rows), 0);
        }
    }

    #[test]
    fn two_groups_take_turns_and_places_stay_even(size in 1_usize..=6, participants in 2_usize..=48) {
        let name = |k: usize| format!("\"c{k}\"");
        let group = |from: usize| (from..from + size).map(name).collect::<Vec<_>>().join(", ");
        let order = format!("by = \"balanced\"\nalternate = [[{}], [{}]]", group(1), group(1 + size));
        let rows = rows(&plan(2 * size, participants, &order, 1, ""));
        each_condition_once(&rows);
        for row in &rows {
            prop_assert!(row.windows(2).all(|pair| (pair[0] < size) != (pair[1] < size)), "{:?}", row);
        }
        let even = participants.is_multiple_of(2 * size);
        prop_assert!(uneven_places(&rows) <= usize::from(!even), "{:?}", rows);
    }

    #[test]
    fn pairs_that_are_kept_apart_never_meet(conditions in 4_usize..=12, participants in 2_usize..=48, seed in 0_u64..1000) {
        let mut plan = plan(conditions, participants, "by = \"balanced\"\nnever_adjacent = [[\"c1\", \"c2\"], [\"c1\", \"c3\"]]", 1, "");
        plan.seed = seed;
        let rows = rows(&plan);
        each_condition_once(&rows);
        let apart = |a: usize, b: usize| (a, b) != (0, 1) && (a, b) != (1, 0) && (a, b) != (0, 2) && (a, b) != (2, 0);
        prop_assert!(rows.iter().flat_map(|row| row.windows(2)).all(|pair| apart(pair[0], pair[1])), "{:?}", rows);
        // What cannot be even is said.
        let said = CounterbalanceReport::of(&plan, &plan.schedule(&pool()).unwrap(), &pool());
        let size = said.imbalances.iter().chain(&said.balanced)
            .find(|i| (i.factor_a, i.factor_b) == ("condition", "position")).unwrap().size;
        prop_assert_eq!(size as usize, uneven_places(&rows));
        if participants >= 2 * conditions {
            prop_assert!(said.imbalances.iter().any(|i| i.factor_b == "previous condition"));
        }
    }

    #[test]
    fn arrangements_are_used_evenly(conditions in 2_usize..=8, participants in 2_usize..=48, trials in 1_usize..=24) {
        for same in [true, false] {
            let arrangements = format!("[arrangements]\nby = \"balanced\"\nsame_for_all_conditions = {same}");
            let plan = plan(conditions, participants, "by = \"latin_square\"", trials, &arrangements);
            let schedule = plan.schedule(&pool()).unwrap();
            let mut used: BTreeMap<String, usize> = BTreeMap::new();
            let mut by_condition: BTreeMap<(usize, String), Vec<String>> = BTreeMap::new();
            for trial in schedule.trials() {
                let arrangement = trial.arrangement.clone().unwrap();
                *used.entry(arrangement.clone()).or_default() += 1;
                by_condition.entry((trial.participant, trial.condition.clone())).or_default().push(arrangement);
            }
            for (who, own) in &by_condition {
                prop_assert_eq!(own.iter().collect::<BTreeSet<_>>().len(), trials, "{:?} meets one twice", who);
                if same {
                    let first = &by_condition[&(who.0, "c1".to_owned())];
                    prop_assert_eq!(own.iter().collect::<BTreeSet<_>>(), first.iter().collect::<BTreeSet<_>>());
                }
            }
            if (participants * trials).is_multiple_of(24) {
                prop_assert_eq!(used.len(), 24);
                if same {
                    prop_assert_eq!(used.values().max(), used.values().min(), "{:?}", used);
                }
            }
        }
    }
}

#[test]
fn a_schedule_follows_from_the_plan_alone_and_another_seed_gives_another_one() {
    let order = "by = \"balanced\"\nnever_adjacent = [[\"c1\", \"c2\"]]";
    let mut plan = plan(5, 10, order, 2, "[arrangements]\nby = \"balanced\"");
    let first = plan.schedule(&pool()).unwrap();
    assert_eq!(first, plan.schedule(&pool()).unwrap());
    let seeds: BTreeSet<u64> = first.trials().map(|trial| trial.seed).collect();
    assert_eq!(seeds.len(), 100, "each trial has a seed of its own");
    plan.seed += 1;
    assert_ne!(first, plan.schedule(&pool()).unwrap());
}

fn size(balance: &CounterbalanceReport, a: &str, b: &str) -> Option<u64> {
    balance.imbalances.iter().find(|i| (i.factor_a, i.factor_b) == (a, b)).map(|i| i.size)
}

#[test]
fn the_papers_first_study_uses_half_of_the_arrangements_and_ties_them_to_people() {
    let plan = shipped("study1");
    let schedule = plan.schedule(&pool()).unwrap();
    assert_eq!(schedule.trials().count(), 96);
    let balance = CounterbalanceReport::of(&plan, &schedule, &pool());
    // All eight orders in which direct and assisted methods take turns: each method is twice in each place ..
    assert_eq!(size(&balance, "condition", "position"), None);
    // .. and A and B, C and D never follow each other, while each other pair does three times.
    assert_eq!(size(&balance, "condition", "previous condition"), Some(3));
    let used: BTreeSet<String> = schedule.trials().map(|trial| trial.arrangement.clone().unwrap()).collect();
    assert_eq!(used.len(), 12);
    assert_eq!(size(&balance, "arrangement", "use"), Some(16), "{:?}", balance.imbalances);
    assert_eq!(size(&balance, "arrangement", "participant"), Some(4));
    assert_eq!(size(&balance, "arrangement", "trial"), Some(4));
    // The same three arrangements in each condition of a participant.
    assert_eq!(size(&balance, "condition", "arrangement"), None);
    assert_eq!(size(&balance, "arrangement", "position"), None);
    assert!(balance.confounds.is_empty(), "{:?}", balance.confounds);
    let [session] = &balance.minutes_per_session[..] else { panic!("one session") };
    assert!((60.0..=120.0).contains(&session.minutes), "{session:?}");
}

#[test]
fn the_papers_second_study_cannot_tell_method_from_day() {
    let plan = shipped("study2");
    let schedule = plan.schedule(&pool()).unwrap();
    assert_eq!(schedule.trials().count(), 144);
    let balance = CounterbalanceReport::of(&plan, &schedule, &pool());
    let is_confounded =
        |a: &str, b: &str| balance.confounds.iter().any(|c| (c.factor, c.determines) == (a, b));
    assert!(
        is_confounded("condition", "session")
            && is_confounded("session", "condition")
            && is_confounded("position", "condition")
    );
    assert!(is_confounded("trial", "arrangement"), "each trial number has one arrangement");
    assert_eq!(balance.minutes_per_session.len(), 2);
    assert!(balance.minutes_per_session.iter().all(|session| session.minutes <= 120.0), "{balance:?}");
}

#[test]
fn a_better_second_study_is_found_balanced() {
    let mut plan = shipped("study2");
    plan.order = toml::from_str("by = \"williams\"").unwrap();
    plan.arrangements = Some(toml::from_str("by = \"balanced\"").unwrap());
    let balance = CounterbalanceReport::of(&plan, &plan.schedule(&pool()).unwrap(), &pool());
    assert_eq!(size(&balance, "condition", "position"), None);
    assert_eq!(size(&balance, "condition", "session"), None);
    assert_eq!(size(&balance, "arrangement", "use"), None);
    assert_eq!(size(&balance, "condition", "arrangement"), None);
    assert!(balance.confounds.is_empty(), "{:?}", balance.confounds);
}

#[test]
fn what_is_wrong_with_a_plan_is_said_in_one_sentence() {
    let text = SHIPPED_PLANS[0].1;
    let cases = [
        ("participants = 8", "participants = 0", "participants is 0, expected 1 to 10000"),
        (
            "participants = 8",
            "participants = 9",
            "the number of rows of order is 8, expected a row for each of the 9 participants",
        ),
        ("participants = 8", "participant = 8", "unknown field `participant`"),
        ("name = \"study1\"", "name = \"../up\"", "expected 1 to 64 letters"),
        (
            "[\"A\", \"C\", \"B\", \"D\"]",
            "[\"A\", \"C\", \"B\", \"B\"]",
            "row 1 of order is A, C, B, B, expected the 4 conditions, each once",
        ),
        (
            "[\"A\", \"C\", \"B\", \"D\"]",
            "[\"A\", \"C\", \"B\", \"E\"]",
            "row 1 of order names \"E\", but there is no such condition; there is A, B, C, D",
        ),
        (
            "\"FL,NM,NL,FM\", \"FL,NL,NM,FM\", \"FM,FL,NL,NM\"",
            "\"FL,NM,NL,FM\"",
            "row 1 of arrangements is 1 long, expected 3",
        ),
        (
            "text = \"welcome\"",
            "text = \"hello\"",
            "names \"hello\", but there is no such text; there is as_before, welcome",
        ),
        ("trials = 3", "trials = 0", "sessions.1.trials is 0, expected at least 1"),
        (
            "trial = { method = \"A\" }",
            "trial = { task = \"bbt\" }",
            "conditions.A.trial.method is nothing, expected a method",
        ),
        (
            "by = \"table\"\nrows = [\n  [\"A\"",
            "by = \"chance\"\nrows = [\n  [\"A\"",
            "unknown variant `chance`",
        ),
        ("name = \"B\"", "name = \"A\"", "two conditions are called \"A\""),
        ("limit_secs = 300", "limit_secs = -1", "trial.limit_secs is -1, expected 0.001 to"),
        (
            "do = \"calibrate_gaze\", minutes = 2",
            "do = \"calibrate_gaze\", minutes = nan",
            "minutes in sessions.1 is NaN",
        ),
        (
            "repetitions = 2",
            "repetitions = 0",
            "repetitions of a training in sessions.1 is 0, expected 1 to 100",
        ),
    ];
    for (from, to, expected) in cases {
        assert!(text.contains(from), "{from}");
        let error = StudyPlan::from_text(&text.replacen(from, to, 1)).unwrap_err().to_string();
        assert!(error.contains(expected), "{to}: {error}");
    }
    let other = StudyPlan::from_text(&text.replacen("\"FL,NM,NL,FM\"", "\"FL,FL,NL,FM\"", 1)).unwrap();
    let error = other.schedule(&pool()).unwrap_err().to_string();
    let expected =
        "row 1 of arrangements names \"FL,FL,NL,FM\", but there is no such arrangement; there is FL,FM,NL,NM";
    assert!(error.starts_with(expected), "{error}");
    let error = other.schedule(&[]).unwrap_err().to_string();
    assert_eq!(error, "arrangements is given, expected nothing: the task has no arrangements");
    let itself = "by = \"balanced\"\nnever_adjacent = [[\"A\", \"A\"]]";
    let error = StudyPlan::from_text(&SHIPPED_PLANS[2].1.replace("by = \"williams\"", itself))
        .unwrap_err()
        .to_string();
    assert_eq!(error, "order.never_adjacent is A and A, expected two conditions");
    let never_adjacent =
        "by = \"balanced\"\nnever_adjacent = [[\"c1\", \"c2\"], [\"c2\", \"c3\"], [\"c1\", \"c3\"]]";
    let error = plan(3, 4, never_adjacent, 1, "").schedule(&[]).unwrap_err().to_string();
    assert_eq!(
        error,
        "no order of c1, c2, c3 keeps the constraints c1 and c2 apart, c2 and c3 apart, c1 and c3 apart"
    );
}

#[test]
fn the_plans_that_ship_are_plans() {
    for (name, _) in SHIPPED_PLANS {
        let plan = shipped(name);
        assert_eq!(plan.name, *name);
        plan.schedule(&pool()).unwrap();
    }
}

#[test]
fn what_comes_within_a_condition_comes_after_its_trials_and_before_a_break() {
    let text = |within: &str| {
        format!(
            "name = \"p\"\nparticipants = 1\n[[conditions]]\nname = \"c\"\ntrial = {{ method = \"A\" }}\n[order]\nby = \"listed\"\n\
             [[sessions]]\nname = \"1\"\ntrials = 3\nbreaks = [{{ after_trial = 2, minutes = 1 }}]\ninter_trial_steps = [{within}]\n"
        )
    };
    let form = "steps = [{ do = \"form\", form = \"embodiment\", minutes = 1 }]";
    let plan = StudyPlan::from_text(&text(&format!("{{ after_trials = [2, 3], {form} }}"))).unwrap();
    let schedule = plan.schedule(&pool()).unwrap();
    let labels: Vec<String> = schedule.sessions[0]
        .items
        .iter()
        .map(|item| match item {
            SessionItem::Trial(trial) => trial.trial.to_string(),
            SessionItem::Step(PlannedStep { step: ProtocolStep::Form { form, .. }, condition }) => {
                format!("{form} of {}", condition.as_deref().unwrap_or("none"))
            }
            SessionItem::Step(PlannedStep { step, .. }) => format!("{step:?}"),
        })
        .collect();
    assert_eq!(labels, ["1", "2", "embodiment of c", "Break { minutes: 1.0 }", "3", "embodiment of c"]);
    for (within, key) in [("after_trials = [4]", "after_trials"), ("after_trials = [0]", "after_trials")] {
        let error = StudyPlan::from_text(&text(&format!("{{ {within}, {form} }}"))).unwrap_err().to_string();
        assert!(error.contains(key) && error.contains("1 to 3"), "{error}");
    }
}

/// The documentation said that the time left is hidden unless `countdown = true`; a session without the key shows it.
#[test]
fn a_session_without_countdown_shows_the_time_left_as_documented() {
    let plan = plan(2, 2, "by = \"listed\"", 1, "");
    assert!(plan.sessions[0].countdown);
    let page = include_str!("../../../docs/studies.md");
    let line = page.lines().find(|line| line.starts_with("countdown = ")).unwrap();
    assert!(line.ends_with("; true if left out"), "{line}");
    assert!(!page.contains("`countdown = true`"), "a session has it by default");
}
