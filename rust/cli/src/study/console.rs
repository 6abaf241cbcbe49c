//! The terminal of whoever conducts a study: shows what the experimenter's page shows, and asks for the same.

use proact_app::{print_status, read_lines};
use proact_bridge::{
    AnswerInput, ClientInput, ExperimenterScreen, FormScreen, StepActivity, StudyAction, StudyButton,
    StudyRequest,
};
use proact_study::{FormAnswer, FormItem};
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
pub(super) struct StudyConsole {
    /// The questionnaire that is being filled in, for who types an answer.
    form: Arc<Mutex<Option<FormScreen>>>,
    last_text: String,
}

impl StudyConsole {
    pub(super) fn new() -> Self {
        Self::default()
    }

    /// Takes what is typed from now on.
    pub(super) fn read_commands(&mut self, requests: Sender<ClientInput>) {
        print_status(format_args!("{HELP}\n"));
        let form = Arc::clone(&self.form);
        std::thread::spawn(move || {
            for line in read_lines(BufReader::new(stdin())) {
                let form = form.lock().unwrap_or_else(PoisonError::into_inner).clone();
                match parse_request(line.trim(), form.as_ref()) {
                    Ok(request) => {
                        if requests.send(request).is_err() {
                            return;
                        }
                    }
                    Err(error) => print_status(error),
                }
            }
        });
    }

    /// Shows what has changed.
    pub(super) fn show(&mut self, screen: &ExperimenterScreen) {
        let now = screen.session.as_ref().and_then(|session| session.current_step.as_ref());
        let form = match now.map(|now| &now.activity) {
            Some(StepActivity::Form(form)) => Some(form.clone()),
            _ => None,
        };
        *self.form.lock().unwrap_or_else(PoisonError::into_inner) = form;
        let text = screen_text(screen);
        if text != self.last_text {
            print_status(&text);
            self.last_text = text;
        }
    }
}

/// What a line asks for.
///
/// # Errors
/// What to type instead.
fn parse_request(line: &str, form: Option<&FormScreen>) -> Result<ClientInput, String> {
    let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
    let rest = rest.trim().to_owned();
    let conduct = |request| Ok(ClientInput::Conduct(request));
    let study = |action| Ok(ClientInput::Study(action));
    let with_reason = |request: fn(String) -> StudyRequest| match rest.is_empty() {
        true => Err(format!("{word} needs a reason: {word} REASON")),
        false => conduct(request(rest.clone())),
    };
    match word {
        _ if line.contains('=') => parse_answer(line, form),
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

fn parse_answer(line: &str, form: Option<&FormScreen>) -> Result<ClientInput, String> {
    let Some(form) = form else { return Err("there is no questionnaire now".to_owned()) };
    let (key, value) = line.split_once('=').unwrap_or((line, ""));
    let (key, value) = (key.trim().to_owned(), value.trim());
    let item = form.form.item(&key);
    let answer = (!value.is_empty()).then(|| FormAnswer::from_terminal(item, value));
    Ok(ClientInput::Answer(AnswerInput { step: form.step, key, answer }))
}

/// What the terminal shows of a screen; times alone are no news.
fn screen_text(screen: &ExperimenterScreen) -> String {
    let mut lines = vec![String::new()];
    if !screen.notice.is_empty() {
        lines.push(format!("! {}", screen.notice));
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
            if let Some(now) = &session.current_step {
                lines.push(format!("{}{}", now.label, if now.running { "" } else { " (not begun)" }));
                lines.extend(step_lines(&now.activity));
            }
        }
        (None, Some(next)) => {
            let who =
                next.id.clone().unwrap_or_else(|| format!("participant {}, who is new", next.participant));
            let again = if next.begun { ", which was begun before" } else { "" };
            lines.push(format!("next: {who}, session {}{again}", next.session));
            if !next.plan_deviation.is_empty() {
                lines.push(format!("* {}", next.plan_deviation));
            }
        }
        (None, None) => lines.push("the study is finished".to_owned()),
    }
    let can: Vec<&str> = screen.available_buttons.iter().map(|button| button_command(*button)).collect();
    lines.push(format!("> {}", can.join(", ")));
    lines.join("\n")
}

fn button_command(button: StudyButton) -> &'static str {
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

fn step_lines(what: &StepActivity) -> Vec<String> {
    match what {
        StepActivity::Say { text } => text.trim().lines().map(|line| format!("  | {line}")).collect(),
        StepActivity::Form(form) => form_lines(form),
        StepActivity::Train(prompt) => {
            let wanted = prompt.required_sequences.map_or_else(String::new, |wanted| format!(" of {wanted}"));
            vec![format!(
                "  {}: {}; {}{wanted} in a row",
                prompt.gesture, prompt.text, prompt.consecutive_sequences
            )]
        }
        StepActivity::CalibrateGaze { error_deg: Some(error) } => vec![format!("  {error:.1} degrees off")],
        StepActivity::CalibrateGaze { error_deg: None } => vec!["  on the participant's page".to_owned()],
        StepActivity::Practice { transferred: carried, planned_transfers: transfers } => {
            vec![format!("  {carried} of {transfers} carried")]
        }
        StepActivity::Demonstrate {} | StepActivity::Rest { .. } => Vec::new(),
        StepActivity::Trial { checks, number: [number, all], previous_result: before } => {
            let mut lines = vec![format!("  trial {number} of {all} of the session")];
            if !before.is_empty() {
                lines.push(format!("  the one before: {before}"));
            }
            lines.extend(checks.iter().map(|check| {
                // How much is free and what time it is would be news all the time.
                let found = if check.ready { "" } else { check.detail.as_str() };
                let verdict = if check.ready { "ok" } else { "NOT READY" };
                format!("  {:12} {verdict} {found}", check.name).trim_end().to_owned()
            }));
            lines
        }
    }
}

fn form_lines(form: &FormScreen) -> Vec<String> {
    let mut lines = Vec::new();
    let preferred_text = |texts: &proact_study::TranslatedText| {
        texts.get("en").or_else(|| texts.values().next()).cloned().unwrap_or_default()
    };
    for item in &form.form.items {
        let (text, expected) = match item {
            FormItem::Scale { text, low, high, min, max, .. } => (
                preferred_text(text),
                format!("{min} {} to {max} {}", preferred_text(low), preferred_text(high)),
            ),
            FormItem::Choice { text, options, .. } => (
                preferred_text(text),
                options.iter().map(|option| option.value.as_str()).collect::<Vec<_>>().join(", "),
            ),
            FormItem::Ranking { text, .. } => (preferred_text(text), form.conditions.join(", ")),
            FormItem::Condition { text, .. } => (preferred_text(text), form.conditions.join(", ")),
            FormItem::Consent { text, version, .. } => (preferred_text(text), version.clone()),
            FormItem::Text { text, .. } => (preferred_text(text), "words".to_owned()),
        };
        let given = form.answers.get(item.key()).map_or("-".to_owned(), FormAnswer::to_cell);
        lines.push(format!("  {} = {given}   {} [{expected}]", item.key(), text.trim()));
    }
    for pair in &form.pairs {
        let given = form.answers.get(&pair.key).map_or("-".to_owned(), FormAnswer::to_cell);
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
        let parse = |line: &str| parse_request(line, None);
        assert_eq!(parse(""), Ok(ClientInput::Conduct(StudyRequest::Next {})));
        assert_eq!(
            parse("new P07"),
            Ok(ClientInput::Conduct(StudyRequest::Begin { id: Some("P07".to_owned()), new: true }))
        );
        assert_eq!(parse("begin"), Ok(ClientInput::Conduct(StudyRequest::Begin { id: None, new: false })));
        assert_eq!(
            parse("redo the armband slipped"),
            Ok(ClientInput::Conduct(StudyRequest::Redo { reason: "the armband slipped".to_owned() }))
        );
        assert_eq!(parse("end"), Ok(ClientInput::Study(StudyAction::Abort)));
        for wrong in ["redo", "note", "new", "submit", "fly", "ease = 3"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn an_answer_is_typed_as_its_question_wants_it() {
        let typed = |name: &str, line: &str| match parse_request(line, Some(&form(name))).unwrap() {
            ClientInput::Answer(given) => (given.step, given.key, given.answer),
            other => panic!("{other:?}"),
        };
        let ranking = form("ranking").form.items[0].key().to_owned();
        assert_eq!(
            typed("ranking", &format!("{ranking} = B, A")),
            (4, ranking.clone(), Some(FormAnswer::Ranking(vec![vec!["B".to_owned()], vec!["A".to_owned()]])))
        );
        assert_eq!(
            typed("ranking", &format!("{ranking} = B = A")).2,
            Some(FormAnswer::Ranking(vec![vec!["B".to_owned(), "A".to_owned()]]))
        );
        let scale = form("sus").form.items[0].key().to_owned();
        assert_eq!(typed("sus", &format!("{scale}=4")), (4, scale.clone(), Some(FormAnswer::Number(4.0))));
        assert_eq!(typed("sus", &format!("{scale} =")), (4, scale, None), "nothing takes it back");
    }
}
