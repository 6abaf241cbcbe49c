//! `proact study run`: sessions with people, or all of a study with simulated participants.

use super::{console, files::export_with_bar};
use crate::{
    interrupt::interrupt_flag, progress::progress_bar, served_page::ServedPageArgs,
    user_device_args::UserDeviceArgs,
};
use clap::Args;
use proact_app::{
    LiveArmband, Registry, print_result, print_result_json, print_status,
    study::{
        Conductor, ExportOptions, ExportSummary, LiveStudy, ParticipantKind, RehearsalEvent,
        RehearsalOptions, Study, StudyEquipment, check_pseudonym, current_export, initial_page_content,
        rehearse, run_worker as work_on,
    },
    usage_log::UsageLog,
};
use proact_bridge::{ClientInput, StudyRequest};
use proact_devices::SourceName;
use proact_study::SessionItem;
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
pub struct StudyRunArgs {
    /// Folder of the study
    #[arg(value_name = "FOLDER")]
    study: PathBuf,
    /// Simulated participants instead of people, as fast as it goes; answers are drawn at random and marked as simulated
    #[arg(long, conflicts_with_all = ["participant", "emg_source"])]
    simulated: bool,
    /// The kind of simulated participants: competent, or person, with delays, errors and habits
    #[arg(long, value_name = "KIND", requires = "simulated", default_value = ParticipantKind::NAMES[0])]
    participant_kind: ParticipantKind,
    /// So many simulated participants at once; by default one a processor
    #[arg(long, value_name = "N", requires = "simulated", value_parser = clap::value_parser!(u16).range(1..=256))]
    jobs: Option<u16>,
    /// Begin with the session of this participant
    #[arg(long, value_name = "ID")]
    participant: Option<String>,
    /// The participant is new, and takes the next place in the plan
    #[arg(long, requires = "participant")]
    enroll: bool,
    /// Print the number of each event once it is on the disk, a line each
    #[arg(long)]
    print_events: bool,
    /// Gestures from an armband instead of keys, such as ble, gforce-sim://HOST:PORT or synthetic (proact serve --help)
    #[arg(long, value_name = "SOURCE")]
    emg_source: Option<SourceName>,
    /// Model of an earlier training; without it the gestures are trained in the session
    #[arg(long, value_name = "FILE", requires = "emg_source")]
    emg_model: Option<PathBuf>,
    /// Log of use, as of proact serve: connection, practice and trials; proact emg usage FILE adds it up
    #[arg(long, value_name = "FILE", conflicts_with = "simulated")]
    usage_log: Option<PathBuf>,
    #[command(flatten)]
    page: ServedPageArgs,
    #[command(flatten)]
    user_devices: UserDeviceArgs,
}

pub(super) fn command(registry: &Registry, args: &StudyRunArgs, json: bool) -> Result<bool, Box<dyn Error>> {
    // Before the page starts.
    if let Some(id) = args.participant.as_deref().filter(|_| args.enroll) {
        check_pseudonym(id)?;
    }
    let interrupted = interrupt_flag()?;
    let study = Study::open(&args.study, &registry.methods)?;
    let (conductor, found) =
        Conductor::open_or_resume(study.clone(), args.simulated.then_some(args.participant_kind))?;
    if !json {
        found.iter().for_each(print_status);
    }
    if args.print_events {
        acknowledge_events(0, conductor.last_id());
    }
    let finished = if args.simulated {
        run_simulated(conductor, args, json, &interrupted)?
    } else {
        run_live(registry, conductor, &found, args, json, &interrupted)?
    };
    let view = proact_app::study::open_view(&study)?;
    let (over, all) = view.progress.count(|step| matches!(step, SessionItem::Trial(_)));
    let tables = match finished {
        true => Some(current_or_new_tables(registry, &study, json)?),
        false => None,
    };
    if json {
        let object = json!({ "finished": finished, "trials": [over, all], "rows": tables.as_ref().map(|t| &t.rows),
            "tables": tables.as_ref().map(|t| &t.folder) });
        print_result_json(&object)?;
    } else {
        print_result(format_args!(
            "{over} of {all} trials are over{}",
            if finished { "; the study is finished" } else { "" }
        ))?;
        if let Some(tables) = tables {
            print_result(format_args!("tables: {}", tables.folder.display()))?;
        }
    }
    Ok(finished || !args.simulated)
}

/// The tables of a study that is finished: those that are there, if nothing happened since, else new ones.
fn current_or_new_tables(
    registry: &Registry,
    study: &Study,
    json: bool,
) -> Result<ExportSummary, Box<dyn Error>> {
    if let Some(exported) = current_export(study)? {
        return Ok(exported);
    }
    let options = ExportOptions { methods: registry.methods.clone(), ..ExportOptions::default() };
    export_with_bar(study, &options, json)
}

/// Acknowledges events; somebody who reads them no more is no reason to stop.
fn acknowledge_events(before: i64, last: i64) {
    for id in before + 1..=last {
        let _ = print_result(format_args!("event {id}"));
    }
}

/// What starts a program that runs trials.
pub(crate) fn worker_command() -> Command {
    // The program itself, wherever it is; a name that is gone meanwhile is an error of the start.
    let mut command = Command::new(std::env::current_exe().unwrap_or_else(|_| PathBuf::from("proact")));
    command.args(["study", "worker"]);
    command
}

pub(super) fn run_worker(registry: &Registry) -> Result<(), Box<dyn Error>> {
    let interrupted = interrupt_flag()?;
    match work_on(registry, BufReader::new(stdin()), &mut stdout().lock(), &interrupted) {
        // Whoever ordered the trial is gone, and nobody is there to be told.
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        done => Ok(done?),
    }
}

fn run_simulated(
    conductor: Conductor,
    args: &StudyRunArgs,
    json: bool,
    interrupted: &std::sync::atomic::AtomicBool,
) -> Result<bool, Box<dyn Error>> {
    let (over, all) = conductor.progress().count(|step| matches!(step, SessionItem::Trial(_)));
    let bar = progress_bar(!json, all as u64, "{elapsed} {bar:40} {pos} of {len} trials, {eta} left  {msg}");
    bar.set_position(over as u64);
    let jobs = args.jobs.map_or_else(crate::batch_args::processor_count, usize::from);
    let options = RehearsalOptions {
        participant_kind: args.participant_kind,
        jobs,
        worker_command: &worker_command,
        interrupted,
    };
    let finished = rehearse(conductor, &options, |event| match event {
        RehearsalEvent::Acknowledged(id) if args.print_events => acknowledge_events(id - 1, id),
        RehearsalEvent::Acknowledged(_) => {}
        RehearsalEvent::Trial(trial, result) => {
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

fn run_live(
    registry: &Registry,
    conductor: Conductor,
    found: &[String],
    args: &StudyRunArgs,
    json: bool,
    interrupted: &std::sync::atomic::AtomicBool,
) -> Result<bool, Box<dyn Error>> {
    let armband = match (&args.emg_source, &args.emg_model) {
        (Some(source), Some(model)) => Some(LiveArmband::open(&registry.sources, source, model)?),
        _ => None,
    };
    let use_log = UsageLog::open_if_given(args.usage_log.as_deref())?;
    let controller = args.user_devices.mocap.shoulder_controller();
    let page = args.page.start(
        &args.user_devices.rosbridge.access,
        controller,
        initial_page_content(&conductor, registry)?,
    )?;
    print_status(format_args!("conduct the study at {}", page.page_url("experimenter")));
    let equipment = StudyEquipment {
        source: args.emg_source.clone(),
        armband,
        user_devices: None,
        calibrations: args.user_devices.mocap.load_calibrations(registry)?,
        open_user_devices: Box::new(|trial| args.user_devices.open(registry, trial)),
        use_log,
    };
    let (sender, requests) = channel();
    if let Some(id) = &args.participant {
        let request = StudyRequest::Begin { id: Some(id.clone()), new: args.enroll };
        sender.send(ClientInput::Conduct(request))?;
    }
    let mut terminal = console::StudyConsole::new();
    if stdin().is_terminal() && !json {
        terminal.read_commands(sender);
    } else {
        drop(sender);
    }
    let (mut acknowledged, prints) = (conductor.last_id(), args.print_events);
    let on_screen = Box::new(move |screen: &proact_bridge::StudyScreen, last: i64| {
        if prints {
            acknowledge_events(acknowledged, last);
            acknowledged = last;
        }
        if !json {
            terminal.show(&screen.experimenter);
        }
    });
    let mut study =
        LiveStudy::new(registry, conductor, &page, equipment, Some(requests), on_screen, interrupted);
    study.set_message(found.join("; "));
    study.run()
}
