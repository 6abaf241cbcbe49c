//! How far a study is.

use clap::Args;
use proact_app::{
    print_result, print_result_json,
    study::{self, Study, StudyView},
};
use proact_control::MethodRegistry;
use proact_study::{ScheduledSession, SessionItem};
use serde_json::{Value, json};
use std::{error::Error, path::PathBuf};

/// Arguments of `proact study status` and `next`.
#[derive(Debug, Args)]
pub struct StatusArgs {
    /// Folder of the study
    #[arg(value_name = "FOLDER")]
    study: PathBuf,
}

/// Steps, or trials alone, of a session that are over, and all.
fn count_steps(view: &StudyView, session: &ScheduledSession, trials: bool) -> (usize, usize) {
    let steps = view.progress.step_ids(session).zip(&session.items);
    let steps = steps.filter(|(_, step)| !trials || matches!(step, SessionItem::Trial(_)));
    steps.fold((0, 0), |(over, all), (step_id, _)| {
        (over + usize::from(view.progress.step(&step_id).outcome.is_some()), all + 1)
    })
}

pub(super) fn status(methods: &MethodRegistry, args: &StatusArgs, json: bool) -> Result<(), Box<dyn Error>> {
    let study = Study::open(&args.study, methods)?;
    let view = study::open_view(&study)?;
    let (over, all) = view.progress.count(|step| matches!(step, SessionItem::Trial(_)));
    let mut sessions = Vec::new();
    let mut lines = Vec::new();
    for session in &view.progress.schedule().sessions {
        let (steps, trials) = (count_steps(&view, session, false), count_steps(&view, session, true));
        let id = view.progress.pseudonyms().get(&session.participant);
        let days = view.progress.days(session.participant, &session.session);
        let departs: std::collections::BTreeSet<&str> = view
            .progress
            .step_ids(session)
            .flat_map(|step_id| view.progress.step(&step_id).deviations)
            .map(proact_study::Deviation::label)
            .collect();
        let departs: Vec<&str> = departs.into_iter().collect();
        lines.push(format!(
            "  {:>3}  {:10} {:10} {:>3} of {:<3} {:>3} of {:<3}  {:21} {}",
            session.participant,
            id.map_or("-", String::as_str),
            session.session,
            steps.0,
            steps.1,
            trials.0,
            trials.1,
            days.join(", "),
            if departs.is_empty() { String::new() } else { format!("* {}", departs.join(", ")) }
        ));
        sessions.push(json!({ "participant": session.participant, "id": id, "session": session.session,
            "steps": [steps.0, steps.1], "trials": [trials.0, trials.1], "days": days, "deviations": departs }));
    }
    if json {
        let object = json!({ "name": study.plan.name, "simulated": view.simulated, "trials": [over, all],
            "finished": view.progress.finished(), "sessions": sessions });
        return Ok(print_result_json(&object)?);
    }
    print_result(format_args!(
        "{}{}: {over} of {all} trials are over",
        study.plan.name,
        if view.simulated { " (simulated participants)" } else { "" }
    ))?;
    print_result("       who        session     steps       trials     days")?;
    lines.iter().try_for_each(|line| print_result(line.trim_end()))?;
    if view.progress.finished() {
        print_result("the study is finished")?;
    }
    Ok(())
}

pub(super) fn next(methods: &MethodRegistry, args: &StatusArgs, json: bool) -> Result<(), Box<dyn Error>> {
    let study = Study::open(&args.study, methods)?;
    let view = study::open_view(&study)?;
    let next = view.progress.next_participant().and_then(|participant| {
        let session = view.progress.next_session(participant)?;
        let step_id = view.progress.next_step(session)?;
        Some((participant, session.session.clone(), step_id.clone(), view.progress.item(&step_id)?.label()))
    });
    let Some((participant, session, step_id, label)) = next else {
        return Ok(print_result(if json {
            Value::Null.to_string()
        } else {
            "the study is finished".to_owned()
        })?);
    };
    let id = view.progress.pseudonyms().get(&participant);
    if json {
        let object = json!({ "participant": participant, "id": id, "session": session, "step": step_id.step, "label": label });
        return Ok(print_result_json(&object)?);
    }
    let who = id.map_or_else(|| format!("participant {participant}, who is not enrolled yet"), Clone::clone);
    Ok(print_result(format_args!("{who}: session {session}, step {}: {label}", step_id.step))?)
}
