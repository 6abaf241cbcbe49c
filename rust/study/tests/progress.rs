//! What is next in a study, whatever happened to it.
#![allow(clippy::unwrap_used)]

use proact_study::{
    Deviation, Form, FormAnswer, ProgressError, ProtocolStep, SHIPPED_PLANS, SessionItem, StepId,
    StepOutcome, StudyEvent, StudyPlan, StudyProgress,
};
use proptest::prelude::*;

fn plan() -> StudyPlan {
    let mut plan = StudyPlan::from_text(SHIPPED_PLANS[0].1).unwrap();
    (plan.participants, plan.arrangements) = (2, None);
    let proact_study::ConditionOrder::Table { rows } = &mut plan.order else { panic!("a table") };
    rows.truncate(2);
    plan
}

fn begun(plan: &StudyPlan) -> StudyProgress {
    let mut progress = StudyProgress::new(plan.schedule(&[]).unwrap());
    for (participant, id) in [(1, "P01"), (2, "P02")] {
        progress.apply(&StudyEvent::Enrolled { participant, id: id.to_owned() }).unwrap();
    }
    progress
}

fn begin(step_id: &StepId, attempt: usize) -> StudyEvent {
    StudyEvent::StepBegan { step_id: step_id.clone(), attempt, record: None }
}

fn end(step_id: &StepId, attempt: usize, outcome: StepOutcome) -> StudyEvent {
    StudyEvent::StepEnded { step_id: step_id.clone(), attempt, outcome, digest: None }
}

fn next(progress: &StudyProgress) -> Option<StepId> {
    progress.next_session(progress.next_participant()?).and_then(|session| progress.next_step(session))
}

proptest! {
    /// However often steps are interrupted or done again, each counts once in the end and comes in its place.
    #[test]
    fn each_step_counts_once(fates in prop::collection::vec(0_u8..4, 0..300)) {
        let mut progress = begun(&plan());
        let mut counted = Vec::new();
        let mut fates = fates.into_iter();
        while let Some(step_id) = next(&progress) {
            let attempt = progress.step(&step_id).attempts + 1;
            progress.apply(&begin(&step_id, attempt)).unwrap();
            prop_assert!(progress.apply(&begin(&step_id, attempt + 1)).is_err(), "it is under way");
            prop_assert_eq!(progress.open(), vec![step_id.clone()]);
            match fates.next() {
                Some(0) => progress.apply(&end(&step_id, attempt, StepOutcome::Interrupted)).unwrap(),
                Some(1) => {
                    progress.apply(&end(&step_id, attempt, StepOutcome::Aborted)).unwrap();
                    let reason = "the armband slipped".to_owned();
                    progress.apply(&StudyEvent::Repeated { step_id, reason }).unwrap();
                }
                _ => {
                    progress.apply(&end(&step_id, attempt, StepOutcome::Done)).unwrap();
                    prop_assert!(progress.apply(&begin(&step_id, attempt + 1)).is_err(), "it counts already");
                    counted.push(step_id);
                }
            }
        }
        let sessions = &progress.schedule().sessions;
        let all: Vec<StepId> = sessions.iter().flat_map(|session| progress.step_ids(session).collect::<Vec<_>>()).collect();
        prop_assert_eq!(counted, all);
        prop_assert!(progress.finished());
        prop_assert_eq!(progress.count(|step| matches!(step, SessionItem::Trial(_))), (24, 24));
    }
}

#[test]
fn who_is_under_way_comes_before_who_is_next() {
    let mut progress = begun(&plan());
    assert_eq!(progress.next_participant(), Some(1));
    let second = StepId { participant: 2, session: "1".to_owned(), step: 1 };
    progress.apply(&begin(&second, 1)).unwrap();
    assert_eq!(progress.next_participant(), Some(2), "her session was begun");
}

#[test]
fn a_place_and_a_pseudonym_are_somebodys_once() {
    let mut progress = begun(&plan());
    let enrol = |participant, id: &str| StudyEvent::Enrolled { participant, id: id.to_owned() };
    let taken = progress.apply(&enrol(1, "P03")).unwrap_err();
    assert_eq!(taken.to_string(), "participant 1 is P01, not P03");
    assert!(matches!(progress.apply(&enrol(3, "P03")), Err(ProgressError::NoSuchStep(_))));
    assert_eq!(
        (
            progress.participant_number("P02"),
            progress.participant_number("P03"),
            progress.first_free_number()
        ),
        (Some(2), None, None)
    );
}

#[test]
fn the_newest_answer_counts_and_deviations_stay() {
    let mut progress = begun(&plan());
    let step_id = StepId { participant: 1, session: "1".to_owned(), step: 1 };
    let answer = |answer| StudyEvent::Answered {
        step_id: step_id.clone(),
        form: "participant".to_owned(),
        item: "sex".to_owned(),
        answer,
    };
    progress.apply(&answer(Some(FormAnswer::Text("male".to_owned())))).unwrap();
    progress.apply(&answer(Some(FormAnswer::Text("female".to_owned())))).unwrap();
    assert_eq!(progress.step(&step_id).answers["sex"], FormAnswer::Text("female".to_owned()));
    progress.apply(&answer(None)).unwrap();
    assert!(progress.step(&step_id).answers.is_empty());
    let reason = "a question came up".to_owned();
    progress.apply(&StudyEvent::Repeated { step_id: step_id.clone(), reason }).unwrap();
    assert!(progress.step(&step_id).deviations.contains(&Deviation::Repeated));
    let nowhere = StepId { step: 99, ..step_id };
    assert_eq!(
        progress.apply(&begin(&nowhere, 1)).unwrap_err().to_string(),
        "the plan has no step 99 in session 1 of participant 1"
    );
}

#[test]
fn a_plan_may_change_where_nothing_was_done_yet() {
    let mut progress = begun(&plan());
    let first = next(&progress).unwrap();
    progress.apply(&begin(&first, 1)).unwrap();
    progress.apply(&end(&first, 1, StepOutcome::Done)).unwrap();
    let mut later = plan();
    later.sessions[0].end.push(ProtocolStep::Form { form: "sus".to_owned(), minutes: 2.0 });
    let changed = progress.with_schedule(later.schedule(&[]).unwrap()).unwrap();
    assert_eq!(next(&changed).map(|step_id| step_id.step), Some(2), "what was done stays done");
    let mut earlier = plan();
    earlier.sessions[0].begin.insert(0, ProtocolStep::Break { minutes: 1.0 });
    let error = progress.with_schedule(earlier.schedule(&[]).unwrap()).unwrap_err();
    assert_eq!(error, "step 1 of session 1 of participant 1 was done and is another one now");
}

#[test]
fn answers_are_checked_against_their_items() {
    let conditions = ["A", "B", "C"].map(str::to_owned);
    let words = |text: &str| FormAnswer::Text(text.to_owned());
    let ranks = |groups: &[&[&str]]| {
        FormAnswer::Ranking(
            groups.iter().map(|rank| rank.iter().map(|&name| name.to_owned()).collect()).collect(),
        )
    };
    let refused = |form: &str, key: &str, answer: &FormAnswer| {
        Form::shipped(form).unwrap().check_answer(key, answer, &conditions).map_err(|error| error.to_string())
    };
    assert_eq!(refused("ranking", "ease", &ranks(&[&["B"], &["A", "C"]])), Ok(()), "places may be shared");
    assert_eq!(
        refused("ranking", "ease", &ranks(&[&["B"], &["A"]])),
        Err("form ranking: the answer to ease is B,A, expected each of A, B, C once".to_owned())
    );
    assert!(refused("ranking", "ease", &ranks(&[&["B"], &[], &["A", "C"]])).is_err());
    assert_eq!(refused("last_trial", "choice", &words("C")), Ok(()));
    assert!(refused("last_trial", "choice", &words("D")).is_err());
    assert_eq!(refused("participant", "consent", &words("1")), Ok(()));
    assert!(refused("participant", "consent", &words("2")).is_err(), "another text than the one shown");
    assert!(refused("sus", "1", &FormAnswer::Number(f64::NAN)).is_err());
    assert!(refused("comments", "nothing", &words("")).unwrap_err().contains("expected one of"));
    let participant = Form::shipped("participant").unwrap();
    assert!(participant.lacks_consent(&Default::default()));
}

#[test]
fn rehearsed_answers_fit_every_form_and_follow_from_their_seed() {
    let conditions = ["A", "B"].map(str::to_owned);
    for (name, _) in proact_study::SHIPPED_FORMS {
        let form = Form::shipped(name).unwrap();
        let answers = form.random_answers(&conditions, 7);
        assert_eq!(answers, form.random_answers(&conditions, 7));
        for (key, answer) in &answers {
            form.check_answer(key, answer, &conditions).unwrap();
        }
        let answers = answers.into_iter().collect();
        assert_eq!(form.missing(&answers), Vec::<String>::new());
        assert!(form.scores_of(&answers).unwrap().iter().all(|score| score.value.is_some()));
        assert!(!form.lacks_consent(&answers));
    }
}

#[test]
fn what_is_typed_is_read_as_the_item_means_it() {
    let form = Form::shipped("ranking").unwrap();
    let typed = FormAnswer::from_terminal(form.item("ease"), "B, A = C");
    assert_eq!(typed.to_cell(), "B,A=C");
    assert_eq!(form.check_answer("ease", &typed, &["A", "B", "C"].map(str::to_owned)), Ok(()));
    let sus = Form::shipped("sus").unwrap();
    let first = &sus.keys()[0];
    assert_eq!(FormAnswer::from_terminal(sus.item(first), " 4 "), FormAnswer::Number(4.0));
}
