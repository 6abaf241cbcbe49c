//! How far a study is.

use clap::Args;
use proact_app::{
    answer, answer_json,
    study::{self, Look, Study},
};
use proact_control::MethodRegistry;
use proact_study::{Happening, ScheduledSession};
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
fn counted(look: &Look, session: &ScheduledSession, trials: bool) -> (usize, usize) {
    let steps = look.progress.spots(session).zip(&session.happenings);
    let steps = steps.filter(|(_, step)| !trials || matches!(step, Happening::Trial(_)));
    steps.fold((0, 0), |(over, all), (spot, _)| {
        (over + usize::from(look.progress.step(&spot).outcome.is_some()), all + 1)
    })
}

pub(super) fn status(methods: &MethodRegistry, args: &StatusArgs, json: bool) -> Result<(), Box<dyn Error>> {
    let study = Study::open(&args.study, methods)?;
    let look = study::look(&study)?;
    let (over, all) = look.progress.count(|step| matches!(step, Happening::Trial(_)));
    let mut sessions = Vec::new();
    let mut lines = Vec::new();
    for session in &look.progress.schedule().sessions {
        let (steps, trials) = (counted(&look, session, false), counted(&look, session, true));
        let id = look.progress.people().get(&session.participant);
        let days = look.progress.days(session.participant, &session.session);
        let departs: std::collections::BTreeSet<&str> = look
            .progress
            .spots(session)
            .flat_map(|spot| look.progress.step(&spot).deviations)
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
        let object = json!({ "name": study.plan.name, "simulated": look.simulated, "trials": [over, all],
            "finished": look.progress.finished(), "sessions": sessions });
        return Ok(answer_json(&object)?);
    }
    answer(format_args!(
        "{}{}: {over} of {all} trials are over",
        study.plan.name,
        if look.simulated { " (simulated participants)" } else { "" }
    ))?;
    answer("       who        session     steps       trials     days")?;
    lines.iter().try_for_each(|line| answer(line.trim_end()))?;
    if look.progress.finished() {
        answer("the study is finished")?;
    }
    Ok(())
}

pub(super) fn next(methods: &MethodRegistry, args: &StatusArgs, json: bool) -> Result<(), Box<dyn Error>> {
    let study = Study::open(&args.study, methods)?;
    let look = study::look(&study)?;
    let next = look.progress.next_participant().and_then(|participant| {
        let session = look.progress.next_session(participant)?;
        let spot = look.progress.next_step(session)?;
        Some((participant, session.session.clone(), spot.clone(), look.progress.happening(&spot)?.label()))
    });
    let Some((participant, session, spot, label)) = next else {
        return Ok(answer(if json { Value::Null.to_string() } else { "the study is finished".to_owned() })?);
    };
    let id = look.progress.people().get(&participant);
    if json {
        let object = json!({ "participant": participant, "id": id, "session": session, "step": spot.step, "label": label });
        return Ok(answer_json(&object)?);
    }
    let who = id.map_or_else(|| format!("participant {participant}, who is not enrolled yet"), Clone::clone);
    Ok(answer(format_args!("{who}: session {session}, step {}: {label}", spot.step))?)
}
