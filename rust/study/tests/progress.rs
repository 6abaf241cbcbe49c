//! What is next in a study, whatever happened to it.
#![allow(clippy::unwrap_used)]

use proact_study::{
    Answer, Deviation, Form, Happening, Plan, Progress, ProgressError, ProtocolStep, SHIPPED, Spot,
    StepOutcome, StudyEvent,
};
use proptest::prelude::*;

fn plan() -> Plan {
    let mut plan = Plan::from_text(SHIPPED[0].1).unwrap();
    (plan.participants, plan.arrangements) = (2, None);
    let proact_study::ConditionOrder::Table { rows } = &mut plan.order else { panic!("a table") };
    rows.truncate(2);
    plan
}

fn begun(plan: &Plan) -> Progress {
    let mut progress = Progress::new(plan.schedule(&[]).unwrap());
    for (participant, id) in [(1, "P01"), (2, "P02")] {
        progress.take(&StudyEvent::Enrolled { participant, id: id.to_owned() }).unwrap();
    }
    progress
}

fn begin(spot: &Spot, attempt: usize) -> StudyEvent {
    StudyEvent::StepBegan { spot: spot.clone(), attempt, record: None }
}

fn end(spot: &Spot, attempt: usize, outcome: StepOutcome) -> StudyEvent {
    StudyEvent::StepEnded { spot: spot.clone(), attempt, outcome, digest: None }
}

fn next(progress: &Progress) -> Option<Spot> {
    progress.next_session(progress.next_participant()?).and_then(|session| progress.next_step(session))
}

proptest! {
    /// However often steps are interrupted or done again, each counts once in the end and comes in its place.
    #[test]
    fn each_step_counts_once(fates in prop::collection::vec(0_u8..4, 0..300)) {
        let mut progress = begun(&plan());
        let mut counted = Vec::new();
        let mut fates = fates.into_iter();
        while let Some(spot) = next(&progress) {
            let attempt = progress.step(&spot).attempts + 1;
            progress.take(&begin(&spot, attempt)).unwrap();
            prop_assert!(progress.take(&begin(&spot, attempt + 1)).is_err(), "it is under way");
            prop_assert_eq!(progress.open(), vec![spot.clone()]);
            match fates.next() {
                Some(0) => progress.take(&end(&spot, attempt, StepOutcome::Interrupted)).unwrap(),
                Some(1) => {
                    progress.take(&end(&spot, attempt, StepOutcome::Aborted)).unwrap();
                    let reason = "the armband slipped".to_owned();
                    progress.take(&StudyEvent::Repeated { spot, reason }).unwrap();
                }
                _ => {
                    progress.take(&end(&spot, attempt, StepOutcome::Done)).unwrap();
                    prop_assert!(progress.take(&begin(&spot, attempt + 1)).is_err(), "it counts already");
                    counted.push(spot);
                }
            }
        }
        let sessions = &progress.schedule().sessions;
        let all: Vec<Spot> = sessions.iter().flat_map(|session| progress.spots(session).collect::<Vec<_>>()).collect();
        prop_assert_eq!(counted, all);
        prop_assert!(progress.finished());
        prop_assert_eq!(progress.count(|step| matches!(step, Happening::Trial(_))), (24, 24));
    }
}

#[test]
fn who_is_under_way_comes_before_who_is_next() {
    let mut progress = begun(&plan());
    assert_eq!(progress.next_participant(), Some(1));
    let second = Spot { participant: 2, session: "1".to_owned(), step: 1 };
    progress.take(&begin(&second, 1)).unwrap();
    assert_eq!(progress.next_participant(), Some(2), "her session was begun");
}

#[test]
fn a_place_and_a_pseudonym_are_somebodys_once() {
    let mut progress = begun(&plan());
    let enrol = |participant, id: &str| StudyEvent::Enrolled { participant, id: id.to_owned() };
    let taken = progress.take(&enrol(1, "P03")).unwrap_err();
    assert_eq!(taken.to_string(), "participant 1 is P01, not P03");
    assert!(matches!(progress.take(&enrol(3, "P03")), Err(ProgressError::NoSuchStep(_))));
    assert_eq!((progress.place("P02"), progress.place("P03"), progress.free_place()), (Some(2), None, None));
}

#[test]
fn the_newest_answer_counts_and_deviations_stay() {
    let mut progress = begun(&plan());
    let spot = Spot { participant: 1, session: "1".to_owned(), step: 1 };
    let answer = |answer| StudyEvent::Answered {
        spot: spot.clone(),
        form: "participant".to_owned(),
        item: "sex".to_owned(),
        answer,
    };
    progress.take(&answer(Some(Answer::Words("male".to_owned())))).unwrap();
    progress.take(&answer(Some(Answer::Words("female".to_owned())))).unwrap();
    assert_eq!(progress.step(&spot).answers["sex"], Answer::Words("female".to_owned()));
    progress.take(&answer(None)).unwrap();
    assert!(progress.step(&spot).answers.is_empty());
    let reason = "a question came up".to_owned();
    progress.take(&StudyEvent::Repeated { spot: spot.clone(), reason }).unwrap();
    assert!(progress.step(&spot).deviations.contains(&Deviation::Repeated));
    let nowhere = Spot { step: 99, ..spot };
    assert_eq!(
        progress.take(&begin(&nowhere, 1)).unwrap_err().to_string(),
        "the plan has no step 99 in session 1 of participant 1"
    );
}

#[test]
fn a_plan_may_change_where_nothing_was_done_yet() {
    let mut progress = begun(&plan());
    let first = next(&progress).unwrap();
    progress.take(&begin(&first, 1)).unwrap();
    progress.take(&end(&first, 1, StepOutcome::Done)).unwrap();
    let mut later = plan();
    later.sessions[0].end.push(ProtocolStep::Form { form: "sus".to_owned(), minutes: 2.0 });
    let changed = progress.changed_to(later.schedule(&[]).unwrap()).unwrap();
    assert_eq!(next(&changed).map(|spot| spot.step), Some(2), "what was done stays done");
    let mut earlier = plan();
    earlier.sessions[0].begin.insert(0, ProtocolStep::Rest { minutes: 1.0 });
    let error = progress.changed_to(earlier.schedule(&[]).unwrap()).unwrap_err();
    assert_eq!(error, "step 1 of session 1 of participant 1 was done and is another one now");
}

#[test]
fn answers_are_checked_against_their_items() {
    let conditions = ["A", "B", "C"].map(str::to_owned);
    let words = |text: &str| Answer::Words(text.to_owned());
    let places = |places: &[&[&str]]| {
        Answer::Places(
            places.iter().map(|place| place.iter().map(|&name| name.to_owned()).collect()).collect(),
        )
    };
    let refused = |form: &str, key: &str, answer: &Answer| {
        Form::shipped(form).unwrap().check_answer(key, answer, &conditions).map_err(|error| error.to_string())
    };
    assert_eq!(refused("ranking", "ease", &places(&[&["B"], &["A", "C"]])), Ok(()), "places may be shared");
    assert_eq!(
        refused("ranking", "ease", &places(&[&["B"], &["A"]])),
        Err("form ranking: the answer to ease is B,A, expected each of A, B, C once".to_owned())
    );
    assert!(refused("ranking", "ease", &places(&[&["B"], &[], &["A", "C"]])).is_err());
    assert_eq!(refused("last_trial", "choice", &words("C")), Ok(()));
    assert!(refused("last_trial", "choice", &words("D")).is_err());
    assert_eq!(refused("participant", "consent", &words("1")), Ok(()));
    assert!(refused("participant", "consent", &words("2")).is_err(), "another text than the one shown");
    assert!(refused("sus", "1", &Answer::Number(f64::NAN)).is_err());
    assert!(refused("comments", "nothing", &words("")).unwrap_err().contains("expected one of"));
    let participant = Form::shipped("participant").unwrap();
    assert!(participant.lacks_consent(&Default::default()));
}

#[test]
fn rehearsed_answers_fit_every_form_and_follow_from_their_seed() {
    let conditions = ["A", "B"].map(str::to_owned);
    for (name, _) in proact_study::SHIPPED_FORMS {
        let form = Form::shipped(name).unwrap();
        let answers = form.rehearsed(&conditions, 7);
        assert_eq!(answers, form.rehearsed(&conditions, 7));
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
    let typed = Answer::typed(form.item("ease"), "B, A = C");
    assert_eq!(typed.to_cell(), "B,A=C");
    assert_eq!(form.check_answer("ease", &typed, &["A", "B", "C"].map(str::to_owned)), Ok(()));
    let sus = Form::shipped("sus").unwrap();
    let first = &sus.keys()[0];
    assert_eq!(Answer::typed(sus.item(first), " 4 "), Answer::Number(4.0));
}
