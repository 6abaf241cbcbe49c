//! The terminal of whoever conducts a study: shows what the experimenter's page shows, and asks for the same.

use proact_app::{lines_of, tell};
use proact_bridge::{
    ClientInput, ExperimenterScreen, FormScreen, GivenAnswer, NowWhat, StudyAction, StudyButton, StudyRequest,
};
use proact_study::{Answer, FormItem};
use std::{
    io::{BufReader, stdin},
    sync::{Arc, Mutex, PoisonError, mpsc::Sender},
};

const HELP: &str = "Enter: done, or begin       begin [ID], new ID: a session    leave: the session goes on another time
anyway, skip, redo, retrain, gaze, each with a REASON: start although not ready; leave out; do the last trial again; train again;
  calibrate the gaze again  pause, resume, end: the trial         note WORDS
QUESTION = ANSWER: answers it; several with commas between, shared places with =      submit: the questionnaire is filled in";

/// A terminal that shows a study.
#[derive(Default)]
pub(super) struct Terminal {
    /// The questionnaire that is being filled in, for who types an answer.
    form: Arc<Mutex<Option<FormScreen>>>,
    shown: String,
}

impl Terminal {
    pub(super) fn new() -> Self {
        Self::default()
    }

    /// Takes what is typed from now on.
    pub(super) fn listen(&mut self, requests: Sender<ClientInput>) {
        tell(format_args!("{HELP}\n"));
        let form = Arc::clone(&self.form);
        std::thread::spawn(move || {
            for line in lines_of(BufReader::new(stdin())) {
                let form = form.lock().unwrap_or_else(PoisonError::into_inner).clone();
                match request(line.trim(), form.as_ref()) {
                    Ok(request) => {
                        if requests.send(request).is_err() {
                            return;
                        }
                    }
                    Err(told) => tell(told),
                }
            }
        });
    }

    /// Shows what has changed.
    pub(super) fn show(&mut self, screen: &ExperimenterScreen) {
        let now = screen.session.as_ref().and_then(|session| session.now.as_ref());
        let form = match now.map(|now| &now.what) {
            Some(NowWhat::Form(form)) => Some(form.clone()),
            _ => None,
        };
        *self.form.lock().unwrap_or_else(PoisonError::into_inner) = form;
        let text = text(screen);
        if text != self.shown {
            tell(&text);
            self.shown = text;
        }
    }
}

/// What a line asks for.
///
/// # Errors
/// What to type instead.
fn request(line: &str, form: Option<&FormScreen>) -> Result<ClientInput, String> {
    let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
    let rest = rest.trim().to_owned();
    let conduct = |request| Ok(ClientInput::Conduct(request));
    let study = |action| Ok(ClientInput::Study(action));
    let with_reason = |request: fn(String) -> StudyRequest| match rest.is_empty() {
        true => Err(format!("{word} needs a reason: {word} REASON")),
        false => conduct(request(rest.clone())),
    };
    match word {
        _ if line.contains('=') => answer(line, form),
        "" | "next" => conduct(StudyRequest::Next {}),
        "begin" => conduct(StudyRequest::Begin { id: Some(rest).filter(|id| !id.is_empty()), new: false }),
        "new" if rest.is_empty() => Err("new needs a pseudonym: new ID".to_owned()),
        "new" => conduct(StudyRequest::Begin { id: Some(rest), new: true }),
        "leave" => conduct(StudyRequest::Leave {}),
        "anyway" => with_reason(|reason| StudyRequest::StartAnyway { reason }),
        "skip" => with_reason(|reason| StudyRequest::Skip { reason }),
        "redo" => with_reason(|reason| StudyRequest::Redo { reason }),
        "retrain" => with_reason(|reason| StudyRequest::Retrain { reason }),
        "gaze" => with_reason(|reason| StudyRequest::Recalibrate { reason }),
        "note" if rest.is_empty() => Err("note needs words: note WORDS".to_owned()),
        "note" => conduct(StudyRequest::Note { text: rest }),
        "pause" => study(StudyAction::Pause),
        "resume" => study(StudyAction::Resume),
        "end" => study(StudyAction::Abort),
        "submit" => form.map_or_else(
            || Err("there is no questionnaire now".to_owned()),
            |form| Ok(ClientInput::Submit { step: form.step }),
        ),
        _ => Err(format!("{word:?} is none of these:\n{HELP}")),
    }
}

fn answer(line: &str, form: Option<&FormScreen>) -> Result<ClientInput, String> {
    let Some(form) = form else { return Err("there is no questionnaire now".to_owned()) };
    let (key, value) = line.split_once('=').unwrap_or((line, ""));
    let (key, value) = (key.trim().to_owned(), value.trim());
    let item = form.form.item(&key);
    let answer = (!value.is_empty()).then(|| Answer::typed(item, value));
    Ok(ClientInput::Answer(GivenAnswer { step: form.step, key, answer }))
}

/// What the terminal shows of a screen; times alone are no news.
fn text(screen: &ExperimenterScreen) -> String {
    let mut lines = vec![String::new()];
    if !screen.told.is_empty() {
        lines.push(format!("! {}", screen.told));
    }
    match (&screen.session, &screen.next) {
        (Some(session), _) => {
            let over = session.steps.iter().filter(|step| step.outcome.is_some()).count();
            lines.push(format!(
                "{}, session {}: {over} of {} steps are over",
                session.id,
                session.session,
                session.steps.len()
            ));
            if let Some(now) = &session.now {
                lines.push(format!("{}{}", now.label, if now.running { "" } else { " (not begun)" }));
                lines.extend(of_step(&now.what));
            }
        }
        (None, Some(next)) => {
            let who =
                next.id.clone().unwrap_or_else(|| format!("participant {}, who is new", next.participant));
            let again = if next.begun { ", which was begun before" } else { "" };
            lines.push(format!("next: {who}, session {}{again}", next.session));
            if !next.departs.is_empty() {
                lines.push(format!("* {}", next.departs));
            }
        }
        (None, None) => lines.push("the study is finished".to_owned()),
    }
    let can: Vec<&str> = screen.can.iter().map(|button| word(*button)).collect();
    lines.push(format!("> {}", can.join(", ")));
    lines.join("\n")
}

fn word(button: StudyButton) -> &'static str {
    match button {
        StudyButton::Begin => "begin",
        StudyButton::Next => "Enter",
        StudyButton::StartAnyway => "anyway",
        StudyButton::Skip => "skip",
        StudyButton::Redo => "redo",
        StudyButton::Pause => "pause",
        StudyButton::Abort => "end",
        StudyButton::Retrain => "retrain",
        StudyButton::Recalibrate => "gaze",
        StudyButton::Leave => "leave",
    }
}

fn of_step(what: &NowWhat) -> Vec<String> {
    match what {
        NowWhat::Say { text } => text.trim().lines().map(|line| format!("  | {line}")).collect(),
        NowWhat::Form(form) => of_form(form),
        NowWhat::Train(prompt) => {
            let wanted = prompt.wanted.map_or_else(String::new, |wanted| format!(" of {wanted}"));
            vec![format!("  {}: {}; {}{wanted} in a row", prompt.gesture, prompt.text, prompt.in_a_row)]
        }
        NowWhat::CalibrateGaze { error_deg: Some(error) } => vec![format!("  {error:.1} degrees off")],
        NowWhat::CalibrateGaze { error_deg: None } => vec!["  on the participant's page".to_owned()],
        NowWhat::Practise { carried, transfers } => vec![format!("  {carried} of {transfers} carried")],
        NowWhat::Demonstrate {} | NowWhat::Rest { .. } => Vec::new(),
        NowWhat::Trial { checks, number: [number, all], before } => {
            let mut lines = vec![format!("  trial {number} of {all} of the session")];
            if !before.is_empty() {
                lines.push(format!("  the one before: {before}"));
            }
            lines.extend(checks.iter().map(|check| {
                // How much is free and what time it is would be news all the time.
                let found = if check.ready { "" } else { check.found.as_str() };
                let verdict = if check.ready { "ok" } else { "NOT READY" };
                format!("  {:12} {verdict} {found}", check.name).trim_end().to_owned()
            }));
            lines
        }
    }
}

fn of_form(form: &FormScreen) -> Vec<String> {
    let mut lines = Vec::new();
    let asked = |texts: &proact_study::Texts| {
        texts.get("en").or_else(|| texts.values().next()).cloned().unwrap_or_default()
    };
    for item in &form.form.items {
        let (text, expected) = match item {
            FormItem::Scale { text, low, high, least, most, .. } => {
                (asked(text), format!("{least} {} to {most} {}", asked(low), asked(high)))
            }
            FormItem::Choice { text, options, .. } => (
                asked(text),
                options.iter().map(|option| option.value.as_str()).collect::<Vec<_>>().join(", "),
            ),
            FormItem::Ranking { text, .. } => (asked(text), form.conditions.join(", ")),
            FormItem::Condition { text, .. } => (asked(text), form.conditions.join(", ")),
            FormItem::Consent { text, version, .. } => (asked(text), version.clone()),
            FormItem::Text { text, .. } => (asked(text), "words".to_owned()),
        };
        let given = form.answers.get(item.key()).map_or("-".to_owned(), Answer::to_cell);
        lines.push(format!("  {} = {given}   {} [{expected}]", item.key(), text.trim()));
    }
    for pair in &form.pairs {
        let given = form.answers.get(&pair.key).map_or("-".to_owned(), Answer::to_cell);
        lines.push(format!("  {} = {given}   [{} or {}]", pair.key, pair.first, pair.second));
    }
    if let Some(refused) = &form.refused {
        lines.push(format!("! {}: {}", refused.key, refused.reason));
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_study::Form;
    use std::collections::BTreeMap;

    fn form(name: &str) -> FormScreen {
        FormScreen {
            step: 4,
            form: Form::shipped(name).unwrap(),
            pairs: vec![],
            conditions: vec!["A".to_owned(), "B".to_owned()],
            about: None,
            answers: BTreeMap::new(),
            missing: vec![],
            refused: None,
        }
    }

    #[test]
    fn what_is_typed_is_what_the_pages_ask_for() {
        let asks = |line: &str| request(line, None);
        assert_eq!(asks(""), Ok(ClientInput::Conduct(StudyRequest::Next {})));
        assert_eq!(
            asks("new P07"),
            Ok(ClientInput::Conduct(StudyRequest::Begin { id: Some("P07".to_owned()), new: true }))
        );
        assert_eq!(asks("begin"), Ok(ClientInput::Conduct(StudyRequest::Begin { id: None, new: false })));
        assert_eq!(
            asks("redo the armband slipped"),
            Ok(ClientInput::Conduct(StudyRequest::Redo { reason: "the armband slipped".to_owned() }))
        );
        assert_eq!(asks("end"), Ok(ClientInput::Study(StudyAction::Abort)));
        for wrong in ["redo", "note", "new", "submit", "fly", "ease = 3"] {
            assert!(asks(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn an_answer_is_typed_as_its_question_wants_it() {
        let typed = |name: &str, line: &str| match request(line, Some(&form(name))).unwrap() {
            ClientInput::Answer(given) => (given.step, given.key, given.answer),
            other => panic!("{other:?}"),
        };
        let ranking = form("ranking").form.items[0].key().to_owned();
        assert_eq!(
            typed("ranking", &format!("{ranking} = B, A")),
            (4, ranking.clone(), Some(Answer::Places(vec![vec!["B".to_owned()], vec!["A".to_owned()]])))
        );
        assert_eq!(
            typed("ranking", &format!("{ranking} = B = A")).2,
            Some(Answer::Places(vec![vec!["B".to_owned(), "A".to_owned()]]))
        );
        let scale = form("sus").form.items[0].key().to_owned();
        assert_eq!(typed("sus", &format!("{scale}=4")), (4, scale.clone(), Some(Answer::Number(4.0))));
        assert_eq!(typed("sus", &format!("{scale} =")), (4, scale, None), "nothing takes it back");
    }
}
