//! `proact study run`: sessions with people, or all of a study with simulated participants.

use super::console;
use crate::{interrupt::interrupt_flag, person_args::PersonArgs, progress::bar, served_page::ServedPageArgs};
use clap::Args;
use proact_app::{
    LiveArmband, Registry, answer,
    study::{
        Conductor, ExportOptions, LiveStudy, People, RehearsalOptions, Rehearsed, Study, StudyEquipment,
        check_pseudonym, export, opening, rehearse, work as work_on,
    },
    tell,
    use_log::UseLog,
};
use proact_bridge::{ClientInput, StudyRequest};
use proact_devices::SourceName;
use proact_study::Happening;
use serde_json::json;
use std::{
    error::Error,
    io::{BufReader, IsTerminal, stdin, stdout},
    path::PathBuf,
    process::Command,
    sync::mpsc::channel,
};

/// Arguments of `proact study run`.
#[derive(Debug, Args)]
pub struct RunArgs {
    /// Folder of the study
    #[arg(value_name = "FOLDER")]
    study: PathBuf,
    /// Simulated participants instead of people, as fast as it goes; answers are drawn at random and marked as simulated
    #[arg(long, conflicts_with_all = ["participant", "emg_source"])]
    simulated: bool,
    /// The kind of simulated participants: competent, or person, with delays, errors and habits
    #[arg(long, value_name = "KIND", requires = "simulated", default_value = People::NAMES[0])]
    people: People,
    /// So many simulated participants at once; by default one a processor
    #[arg(long, value_name = "N", requires = "simulated", value_parser = clap::value_parser!(u16).range(1..=256))]
    jobs: Option<u16>,
    /// Begin with the session of this participant
    #[arg(long, value_name = "ID")]
    participant: Option<String>,
    /// The participant is new, and takes the next place in the plan
    #[arg(long, requires = "participant")]
    new: bool,
    /// Print the number of each event once it is on the disk, a line each
    #[arg(long)]
    print_events: bool,
    /// Gestures from an armband instead of keys, such as ble, gforce-sim://HOST:PORT or synthetic (proact serve --help)
    #[arg(long, value_name = "SOURCE")]
    emg_source: Option<SourceName>,
    /// Model of an earlier training; without it the gestures are trained in the session
    #[arg(long, value_name = "FILE", requires = "emg_source")]
    emg_model: Option<PathBuf>,
    /// Log of use, as of proact serve: connection, practice and trials; proact emg use FILE adds it up
    #[arg(long, value_name = "FILE", conflicts_with = "simulated")]
    use_log: Option<PathBuf>,
    #[command(flatten)]
    page: ServedPageArgs,
    #[command(flatten)]
    person: PersonArgs,
}

pub(super) fn command(registry: &Registry, args: &RunArgs, json: bool) -> Result<bool, Box<dyn Error>> {
    // Before the page starts.
    if let Some(id) = args.participant.as_deref().filter(|_| args.new) {
        check_pseudonym(id)?;
    }
    let interrupted = interrupt_flag()?;
    let study = Study::open(&args.study, &registry.methods)?;
    let (conductor, found) = Conductor::take_up(study.clone(), args.simulated.then_some(args.people))?;
    if !json {
        found.iter().for_each(tell);
    }
    if args.print_events {
        print_up_to(0, conductor.last_id());
    }
    let finished = if args.simulated {
        simulated(conductor, args, json, &interrupted)?
    } else {
        live(registry, conductor, &found, args, json, &interrupted)?
    };
    let look = proact_app::study::look(&study)?;
    let (over, all) = look.progress.count(|step| matches!(step, Happening::Trial(_)));
    let tables = if finished { Some(export(&study, &ExportOptions::default())?) } else { None };
    if json {
        let object = json!({ "finished": finished, "trials": [over, all], "rows": tables.as_ref().map(|t| &t.rows),
            "tables": tables.as_ref().map(|t| &t.folder) });
        answer(object.to_string())?;
    } else {
        answer(format_args!(
            "{over} of {all} trials are over{}",
            if finished { "; the study is finished" } else { "" }
        ))?;
        if let Some(tables) = tables {
            answer(format_args!("tables: {}", tables.folder.display()))?;
        }
    }
    Ok(finished || !args.simulated)
}

/// Acknowledges events; somebody who reads them no more is no reason to stop.
fn print_up_to(before: i64, last: i64) {
    for id in before + 1..=last {
        let _ = answer(format_args!("event {id}"));
    }
}

/// What starts a program that runs trials.
pub(crate) fn worker_command() -> Command {
    // The program itself, wherever it is; a name that is gone meanwhile is an error of the start.
    let mut command = Command::new(std::env::current_exe().unwrap_or_else(|_| PathBuf::from("proact")));
    command.args(["study", "worker"]);
    command
}

pub(super) fn work(registry: &Registry) -> Result<(), Box<dyn Error>> {
    let interrupted = interrupt_flag()?;
    match work_on(registry, BufReader::new(stdin()), &mut stdout().lock(), &interrupted) {
        // Whoever ordered the trial is gone, and nobody is there to be told.
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        done => Ok(done?),
    }
}

fn simulated(
    conductor: Conductor,
    args: &RunArgs,
    json: bool,
    interrupted: &std::sync::atomic::AtomicBool,
) -> Result<bool, Box<dyn Error>> {
    let (over, all) = conductor.progress().count(|step| matches!(step, Happening::Trial(_)));
    let bar = bar(!json, all as u64, "{elapsed} {bar:40} {pos} of {len} trials, {eta} left  {msg}");
    bar.set_position(over as u64);
    let jobs = args.jobs.map_or_else(crate::batch_args::processors, usize::from);
    let options = RehearsalOptions { people: args.people, jobs, worker: &worker_command, interrupted };
    let finished = rehearse(conductor, &options, |told| match told {
        Rehearsed::Acknowledged(id) if args.print_events => print_up_to(id - 1, id),
        Rehearsed::Acknowledged(_) => {}
        Rehearsed::Trial(trial, result) => {
            bar.set_message(format!(
                "{} {}: {} {}",
                trial.condition, trial.trial, result.score, result.score_name
            ));
            bar.inc(1);
        }
    })?;
    bar.finish_and_clear();
    Ok(finished)
}

fn live(
    registry: &Registry,
    conductor: Conductor,
    found: &[String],
    args: &RunArgs,
    json: bool,
    interrupted: &std::sync::atomic::AtomicBool,
) -> Result<bool, Box<dyn Error>> {
    let armband = match (&args.emg_source, &args.emg_model) {
        (Some(source), Some(model)) => Some(LiveArmband::open(&registry.sources, source, model)?),
        _ => None,
    };
    let use_log = UseLog::asked(args.use_log.as_deref())?;
    let controller = args.person.mocap.controller();
    let page = args.page.start(&args.person.rosbridge.access, controller, opening(&conductor, registry)?)?;
    tell(format_args!("conduct the study at {}", page.page_url("experimenter")));
    let equipment = StudyEquipment {
        source: args.emg_source.clone(),
        armband,
        person: None,
        calibrations: args.person.mocap.used(registry)?,
        open_person: Box::new(|session| args.person.open(registry, session)),
        use_log,
    };
    let (sender, requests) = channel();
    if let Some(id) = &args.participant {
        let request = StudyRequest::Begin { id: Some(id.clone()), new: args.new };
        sender.send(ClientInput::Conduct(request))?;
    }
    let mut terminal = console::Terminal::new();
    if stdin().is_terminal() && !json {
        terminal.listen(sender);
    } else {
        drop(sender);
    }
    let (mut told, prints) = (conductor.last_id(), args.print_events);
    let on_screen = Box::new(move |screen: &proact_bridge::StudyScreen, last: i64| {
        if prints {
            print_up_to(told, last);
            told = last;
        }
        if !json {
            terminal.show(&screen.experimenter);
        }
    });
    let mut study =
        LiveStudy::new(registry, conductor, &page, equipment, Some(requests), on_screen, interrupted);
    study.tell(found.join("; "));
    study.run()
}
