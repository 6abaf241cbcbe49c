//! A study's plan: make one, and see what it is worth.

use clap::Args;
use proact_app::{
    print_result, print_result_json, print_status,
    study::{Study, new_study, new_study_from_armsym},
};
use proact_control::MethodRegistry;
use proact_study::{CounterbalanceReport, Form, Imbalance, SHIPPED_PLANS};
use serde_json::{Map, Value, json};
use std::{error::Error, path::PathBuf};

/// Arguments of `proact study new`.
#[derive(Debug, Args)]
pub struct NewArgs {
    /// Folder of the study; its name is the study's
    folder: PathBuf,
    /// Which plan to begin with
    #[arg(long, value_name = "NAME", default_value = "empty", value_parser = SHIPPED_PLANS.iter().map(|(name, _)| *name).collect::<Vec<_>>())]
    template: String,
    /// Begin with conditions of ArmSym instead: JSON files of its folder Experimental_conditions, or a subject's
    /// identifier.json; several are compared
    #[arg(long, value_name = "FILE", num_args = 1.., conflicts_with = "template")]
    from_armsym: Vec<PathBuf>,
}

/// Arguments of `proact study check`.
#[derive(Debug, Args)]
pub struct StudyCheckArgs {
    /// Folder of the study, or its plan
    #[arg(value_name = "FOLDER|FILE")]
    study: PathBuf,
    /// Print all trials instead, as CSV
    #[arg(long)]
    schedule: bool,
}

/// `proact study new`.
///
/// # Errors
/// A folder that exists, a name that is none for a study, files that are none of ArmSym's.
pub(super) fn new(args: &NewArgs, json: bool) -> Result<(), Box<dyn Error>> {
    let (file, left_out) = match args.from_armsym.as_slice() {
        [] => (new_study(&args.folder, &args.template)?, Vec::new()),
        files => new_study_from_armsym(&args.folder, files)?,
    };
    if json {
        return Ok(print_result_json(&json!({ "plan": file, "left_out": left_out }))?);
    }
    left_out.iter().for_each(print_status);
    Ok(print_result(format!(
        "{}\nEdit it, then look at it: proact study check {}",
        file.display(),
        args.folder.display()
    ))?)
}

/// `proact study check`.
///
/// # Errors
/// A plan that cannot be read or run, by its file's name.
pub(super) fn check(
    methods: &MethodRegistry,
    args: &StudyCheckArgs,
    json: bool,
) -> Result<(), Box<dyn Error>> {
    let study = Study::open(&args.study, methods)?;
    if args.schedule {
        return Ok(print_result(schedule(&study, json)?.trim_end())?);
    }
    let balance = CounterbalanceReport::of(&study.plan, &study.schedule, &study.arrangements);
    let text = if json { check_json(&study, &balance)?.to_string() } else { check_text(&study, &balance) };
    Ok(print_result(text.trim_end())?)
}

/// All trials, as CSV or as JSON.
fn schedule(study: &Study, json: bool) -> Result<String, Box<dyn Error>> {
    if json {
        return Ok(proact_types::to_json(&study.schedule)?);
    }
    let mut table = csv::Writer::from_writer(Vec::new());
    for trial in study.schedule.trials() {
        table.serialize(trial)?;
    }
    Ok(String::from_utf8(table.into_inner()?)?)
}

fn check_json(study: &Study, balance: &CounterbalanceReport) -> Result<Value, Box<dyn Error>> {
    let minutes: Map<String, Value> = balance
        .minutes_per_session
        .iter()
        .map(|session| (session.session.clone(), json!(session.minutes)))
        .collect();
    Ok(json!({
        "name": study.plan.name,
        "participants": study.plan.participants,
        "conditions": study.plan.conditions.iter().map(|condition| &condition.name).collect::<Vec<_>>(),
        "trials": study.schedule.trials().count(),
        "orders": orders(study),
        "forms": study.forms.values().map(|form| json!({ "name": form.name, "confirmed": form.wording_verified })).collect::<Vec<_>>(),
        "imbalances": balance.imbalances,
        "balanced": balance.balanced,
        "confounded": balance.confounds,
        "minutes_per_session": minutes,
        "sessions": balance.minutes_per_session,
    }))
}

/// Each participant's conditions, in their order.
fn orders(study: &Study) -> Vec<Vec<String>> {
    let mut orders = vec![Vec::new(); study.plan.participants];
    for trial in study.schedule.trials().filter(|trial| trial.trial == 1) {
        orders[trial.participant - 1].push(trial.condition.clone());
    }
    orders
}

/// Such as `1 session` or `2 sessions`.
fn pluralize(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

fn check_text(study: &Study, balance: &CounterbalanceReport) -> String {
    let plan = &study.plan;
    let mut text = String::new();
    let mut line = |words: String| {
        text.push_str(&words);
        text.push('\n');
    };
    let title = if plan.title.is_empty() { String::new() } else { format!(": {}", plan.title) };
    line(format!("{}{title}", plan.name));
    line(format!(
        "{}, {}, {} each, {} in all",
        pluralize(plan.participants, "participant"),
        pluralize(plan.conditions.len(), "condition"),
        pluralize(plan.sessions.len(), "session"),
        pluralize(study.schedule.trials().count(), "trial")
    ));
    line("\nOrder of the conditions".to_owned());
    let width = plan.conditions.iter().map(|condition| condition.name.chars().count()).max().unwrap_or(1);
    for (k, order) in orders(study).iter().enumerate() {
        let cells: Vec<String> = order.iter().map(|name| format!("{name:width$}")).collect();
        line(format!("  {:>4}  {}", k + 1, cells.join(" ").trim_end()));
    }
    let rows = |line: &mut dyn FnMut(String), found: &[Imbalance]| {
        for Imbalance { factor_a, factor_b, size, unit, detail, .. } in found {
            line(format!("  {:36} {size:>3} {unit:12} {detail}", format!("{factor_a} by {factor_b}")));
        }
    };
    if balance.imbalances.is_empty() {
        line("\nNo imbalance: all is as even as these numbers allow".to_owned());
    } else {
        line("\nImbalances: largest less smallest count".to_owned());
        rows(&mut line, &balance.imbalances);
    }
    if !balance.balanced.is_empty() {
        line("\nAs even as these numbers allow".to_owned());
        rows(&mut line, &balance.balanced);
    }
    if !balance.confounds.is_empty() {
        line("\nConfounded: what one does cannot be told from what the other does".to_owned());
        for confound in &balance.confounds {
            line(format!(
                "  {:36} {}",
                format!("{} tells {}", confound.factor, confound.determines),
                confound.detail
            ));
        }
    }
    if !study.forms.is_empty() {
        let named = |form: &Form| match form.wording_verified {
            true => form.name.clone(),
            false => format!("{} (not the wording of its source)", form.name),
        };
        line(format!("\nQuestionnaires: {}", study.forms.values().map(named).collect::<Vec<_>>().join(", ")));
    }
    line("\nA session takes at most".to_owned());
    for session in &balance.minutes_per_session {
        line(format!(
            "  {:12} {:>4.0} minutes, {:.0} of them if each of {} lasts until its limit",
            session.session,
            session.minutes,
            session.trial_minutes,
            pluralize(session.trials, "trial")
        ));
    }
    text
}
