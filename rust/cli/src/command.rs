use crate::{
    analyze::AnalyzeArgs, demo::DemoArgs, doctor, emg::EmgCommand, export::ExportArgs,
    interrupt::ignore_file_size_signal, localize::LocalizeCommand, method_files, model::ModelCommand,
    reference, renames, replay::ReplayArgs, serve::ServeArgs, shell, study::StudyCommand,
    update_digests::UpdateDigestsArgs,
};
use clap::{
    Args, CommandFactory, FromArgMatches, Parser, Subcommand,
    builder::{PossibleValue, PossibleValuesParser},
};
use proact_app::query::{self, QueryOptions};
use proact_app::{
    Registry,
    libraries::{library_versions, set_source_commit},
    print_result, print_result_json, print_status,
};
use proact_bench::PlanningBench;
use proact_files::{make_folder, write_atomically};
use proact_types::MethodInfo;
use std::{
    collections::BTreeMap,
    error::Error,
    io::{stdin, stdout},
    path::PathBuf,
    process::ExitCode,
};

/// Problems of the planning bench.
const PLANNING_PROBLEMS: usize = 1000;

/// Open testbed for intelligent prosthetic arms: EMG, gaze, planning and physics in one process.
#[derive(Debug, Parser)]
#[command(name = "proact", version, arg_required_else_help = true)]
#[command(
    after_help = "Examples:\n  proact demo                     watch a simulated participant in the browser\n  \
    proact demo --headless --json   the same without a page, result as JSON\n  \
    proact serve                    drive the arm yourself: mouse is gaze, keys are gestures"
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Run one trial with a simulated participant and show it in the browser
    Demo(DemoArgs),
    /// Run the trial that a configuration file describes
    Run(crate::demo::RunArgs),
    /// Recompute a recorded trial and check its digest
    Replay(ReplayArgs),
    /// Serve the live page: mouse is gaze, keys are gestures
    Serve(ServeArgs),
    /// EMG: evaluate recordings, compute features
    Emg {
        /// One JSON object on standard output
        #[arg(long, global = true)]
        json: bool,
        #[command(subcommand)]
        command: EmgCommand,
    },
    /// Answer questions on kinematics, dynamics, plans and collisions, one JSON object a line
    Query(QueryArgs),
    /// Check or import an arm's description
    Model {
        /// One JSON object on standard output
        #[arg(long, global = true)]
        json: bool,
        #[command(subcommand)]
        command: ModelCommand,
    },
    /// Measure a stage, beside its peer where there is one
    Bench(BenchArgs),
    /// Run many trials with simulated participants, and sum them up
    Simulate(crate::simulate::SimulateArgs),
    /// Compare control methods on the same simulated people: a leader board with its statistics
    Compare(crate::compare::CompareArgs),
    /// The simulated people: fit them to the paper, and predict it
    Participants {
        #[command(subcommand)]
        command: crate::participants::ParticipantsCommand,
    },
    /// Plan a study, conduct its sessions, get its tables
    Study {
        /// One JSON object on standard output
        #[arg(long, global = true)]
        json: bool,
        #[command(subcommand)]
        command: StudyCommand,
    },
    /// Numbers from recorded trials
    Analyze(AnalyzeArgs),
    /// Write a recorded trial as a file that other programs read
    Export(ExportArgs),
    /// Run a stage, or all of them, as a node on a ROS 1 graph
    Node(crate::node::NodeArgs),
    /// Make the digests of the repository's trials the committed ones of this platform
    UpdateDigests(UpdateDigestsArgs),
    /// Calibrate where shoulder, headset and box are, from recorded poses
    Localize {
        /// One JSON object on standard output
        #[arg(long, global = true)]
        json: bool,
        #[command(subcommand)]
        command: LocalizeCommand,
    },
    /// Look at this machine: libraries, tools, ports
    Doctor(doctor::DoctorArgs),
    /// Print what completes these commands in a shell
    Completions(shell::CompletionsArgs),
    /// Write the manual pages of all commands
    Man(shell::ManArgs),
    /// Write the pages of the documentation that follow from the program
    Reference(reference::ReferenceArgs),
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  echo '{\"op\":\"fk\",\"q\":[0,0,0,0.5,0,0,0]}' | proact query\n\n\
    Operations: fk, jacobian, condition, inverse_dynamics, ik, plan, collision. SI units, radians, quaternions \
    x, y, z, w. A line that cannot be answered gives {\"error\": ..} and the stream goes on.")]
struct QueryArgs {
    /// Another arm: its folder, or the name of one that ships with the program
    #[arg(long, value_name = "FOLDER|NAME", conflicts_with = "urdf")]
    arm: Option<String>,
    /// Another arm's URDF file
    #[arg(long, value_name = "FILE")]
    urdf: Option<PathBuf>,
    /// First link of the chain
    #[arg(long, value_name = "LINK")]
    base: Option<String>,
    /// Last link of the chain
    #[arg(long, value_name = "LINK")]
    tip: Option<String>,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  proact bench kinematics --json")]
struct BenchArgs {
    /// What to measure
    #[arg(value_parser = proact_bench::STAGES)]
    stage: String,
    /// One JSON object on standard output
    #[arg(long)]
    json: bool,
    /// Problems of the stage planning [default: 1000]
    #[arg(long, value_name = "N")]
    problems: Option<usize>,
    /// Seed of the stage planning's problems; one that nothing was tuned on if left out
    #[arg(long)]
    seed: Option<u64>,
    /// How long the stage planning searches, in seconds, before a goal counts as out of reach
    #[arg(long, value_name = "SECONDS", default_value_t = 30.0)]
    reachability_timeout: f64,
    /// Folder for the charts of the stage growth
    #[arg(long, value_name = "DIR")]
    charts: Option<PathBuf>,
}

impl BenchArgs {
    fn planning_bench(&self) -> PlanningBench {
        PlanningBench::new(
            self.seed,
            self.problems.unwrap_or(PLANNING_PROBLEMS),
            Some(self.reachability_timeout),
        )
    }
}

/// The whole command with what `registry` has to choose from: parses the command line and runs it. The exit code is 0 only on success.
///
/// A laboratory's own program is this with its own method added:
///
/// ```no_run
/// use proact_control::{JointJog, MethodEntry, MethodRegistry};
/// use proact_types::MethodInfo;
///
/// fn main() -> std::process::ExitCode {
///     let info = MethodInfo { name: "mine".into(), title: "my own".into(), ..MethodInfo::default() };
///     let mine = MethodEntry::new(info, |profile, arm, joints| Ok(Box::new(JointJog::new(profile, arm, joints)?)));
///     proact_cli::run(MethodRegistry::standard().with(mine).expect("a name of its own"))
/// }
/// ```
pub fn run(registry: impl Into<Registry>) -> ExitCode {
    run_with_commit(None, registry)
}

/// As [`run`], for a program that knows the commit it was built from, which `--version` and its records say then.
pub fn run_with_commit(commit: Option<&str>, registry: impl Into<Registry>) -> ExitCode {
    if let Some(commit) = commit.filter(|commit| !commit.is_empty()) {
        set_source_commit(commit);
    }
    let mut registry = registry.into();
    let words = match method_files::register_method_files(registry.methods, std::env::args_os().collect()) {
        Ok((methods, words)) => {
            registry.methods = methods;
            words
        }
        Err(error) => {
            print_status(format_args!("proact: {error}"));
            return ExitCode::FAILURE;
        }
    };
    let mut cli = build_command_line(&registry);
    // The libraries are looked for on the disk, which no other command waits for.
    if words.get(1).is_some_and(|word| word == "--version") {
        cli = cli.long_version(version(commit, &library_versions()));
    }
    renames::rename_warnings(&cli, &words).iter().for_each(print_status);
    let parsed = cli.try_get_matches_from_mut(words).and_then(|words| Cli::from_arg_matches(&words));
    let command = match parsed {
        Ok(parsed) => parsed.command,
        // Help and version are printed too, and like every answer may find nobody to read them.
        Err(clap_error) => {
            return match clap_error.print() {
                Ok(()) => u8::try_from(clap_error.exit_code()).map_or(ExitCode::FAILURE, ExitCode::from),
                Err(_) => ExitCode::FAILURE,
            };
        }
    };
    match ignore_file_size_signal().map_err(Into::into).and_then(|()| dispatch(&registry, command)) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            print_status(format_args!("proact: {error}"));
            ExitCode::FAILURE
        }
    }
}

/// What `--version` says: the program with its commit, then a line for each native library.
fn version(commit: Option<&str>, libraries: &BTreeMap<&'static str, String>) -> String {
    let commit = commit.filter(|commit| !commit.is_empty()).map(|commit| format!(" (commit {commit})"));
    let program = format!("{}{}", env!("CARGO_PKG_VERSION"), commit.unwrap_or_default());
    libraries.iter().fold(program, |text, (name, version)| format!("{text}\n{name} {version}"))
}

/// The command line with what `registry` has wherever something can be chosen, and with the old names of what has a new one.
fn build_command_line(registry: &Registry) -> clap::Command {
    renames::accept_old_names(build_with_new_names(registry))
}

/// The same without old names.
fn build_with_new_names(registry: &Registry) -> clap::Command {
    let value = |info: &MethodInfo| PossibleValue::new(info.name.clone()).help(info.title.clone());
    let methods: Vec<PossibleValue> =
        registry.methods.entries().iter().map(|entry| value(entry.info())).collect();
    let listed = |what: &str, lines: Vec<(String, &str)>| {
        lines.iter().fold(what.to_owned(), |text, (form, help)| format!("{text}\n  {form}: {help}"))
    };
    let source = |what: &str| {
        let lines = registry.sources.schemes().iter().map(|scheme| (scheme.syntax(), scheme.help));
        listed(what, lines.collect())
    };
    let sinks = registry.sinks.iter().map(|sink| (format!("{}{}", sink.scheme, sink.address), sink.help));
    let sinks = listed("Where cues go, to be heard or felt; may be repeated:", sinks.collect());
    let cli = ["demo", "serve", "node"].into_iter().fold(Cli::command(), |cli, name| {
        let methods = methods.clone();
        cli.mut_subcommand(name, |command| {
            command.mut_arg("method", |arg| arg.value_parser(PossibleValuesParser::new(methods)))
        })
    });
    let cli = ["demo", "run", "serve"].into_iter().fold(cli, |cli, name| {
        let sinks = sinks.clone();
        cli.mut_subcommand(name, |command| command.mut_arg("feedback", |arg| arg.help(sinks)))
    });
    let cli = cli.mut_subcommand("serve", |command| {
        command.mut_arg("emg_source", |arg| {
            arg.help(source("Gestures from an armband instead of keys, one of:"))
        })
    });
    cli.mut_subcommand("emg", |emg| {
        ["train", "test", "stream"].into_iter().fold(emg, |emg, name| {
            let text = source("Where samples come from, one of:");
            emg.mut_subcommand(name, |command| command.mut_arg("source", |arg| arg.help(text)))
        })
    })
}

fn dispatch(registry: &Registry, command: Command) -> Result<bool, Box<dyn Error>> {
    match command {
        Command::Demo(args) => crate::demo::demo(registry, &args),
        Command::Run(args) => crate::demo::run(registry, &args),
        Command::Replay(args) => crate::replay::command(&registry.methods, &args),
        Command::Serve(args) => crate::serve::command(registry, &args),
        Command::Emg { json, command } => crate::emg::run(&registry.sources, &command, json).map(|()| true),
        Command::Query(QueryArgs { arm, urdf, base, tip }) => {
            query::run(QueryOptions { arm, urdf, base, tip }, stdin().lock(), stdout().lock())?;
            Ok(true)
        }
        Command::Model { json, command } => crate::model::run(&command, json),
        Command::Bench(args) => {
            // Before minutes of measuring.
            if let Some(folder) = &args.charts {
                if args.stage != "growth" {
                    return Err(
                        format!("the stage {} has no charts: --charts is for growth", args.stage).into()
                    );
                }
                make_folder(folder)?;
            }
            let report = proact_bench::run(&args.stage, args.planning_bench())?;
            for (folder, chart) in
                args.charts.iter().flat_map(|folder| report.charts.iter().map(move |chart| (folder, chart)))
            {
                write_atomically(&folder.join(&chart.name).with_extension("svg"), &chart.svg)?;
            }
            if args.json {
                print_result_json(&report)?;
            } else {
                print_result(report.to_string().trim_end())?;
            }
            Ok(true)
        }
        Command::Localize { json, command } => crate::localize::run(registry, &command, json),
        Command::Study { json, command } => crate::study::run(registry, &command, json),
        Command::Simulate(args) => crate::simulate::command(registry, &args),
        Command::Participants { command } => crate::participants::run(registry, &command),
        Command::Compare(args) => crate::compare::command(registry, args),
        Command::Analyze(args) => crate::analyze::command(&registry.methods, &args),
        Command::Export(args) => crate::export::command(&registry.methods, &args),
        Command::Node(args) => crate::node::command(registry, &args),
        Command::UpdateDigests(args) => crate::update_digests::command(&args),
        Command::Doctor(args) => Ok(doctor::run(registry, &args)?),
        Command::Completions(args) => shell::completions(&mut build_command_line(registry), &args),
        Command::Reference(args) => reference::command(build_command_line(registry), &args),
        Command::Man(args) => shell::man(build_command_line(registry), &args),
    }
}

#[cfg(test)]
mod documents;
#[cfg(test)]
mod old_names;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_version_names_the_commit_and_each_library() {
        let libraries = BTreeMap::from([("KDL", "1.5.1".to_owned()), ("ODE", "0.16.2".to_owned())]);
        let known = version(Some("0123abc"), &libraries);
        let number = env!("CARGO_PKG_VERSION");
        assert_eq!(known, format!("{number} (commit 0123abc)\nKDL 1.5.1\nODE 0.16.2"));
        assert_eq!(version(None, &BTreeMap::new()), number);
        assert_eq!(version(Some(""), &BTreeMap::new()), number);
    }
}
