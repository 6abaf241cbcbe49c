//! `proact study`: from a plan to recorded sessions and their tables.

mod console;
mod files;
mod plan;
mod power;
mod run;
mod status;

use clap::Subcommand;
use proact_app::Registry;
use std::error::Error;

pub(crate) use run::worker_command;

/// What to do with a study.
#[derive(Debug, Subcommand)]
pub enum StudyCommand {
    /// Make a folder with a plan, to be changed with any editor
    #[command(
        after_help = "Examples:\n  proact study new pilot\n  proact study new replication --template study1\n  \
        proact study new mine --from-armsym imitate.json go_to.json\n\n\
        study1 and study2 are those of the ProACT paper; minivie, vie, armsym, holopham and virtual-bbt are like these systems; empty has two methods, two \
        trials each. docs/studies.md says what \
        can be in a plan."
    )]
    New(plan::NewArgs),
    /// Say who does what, every imbalance with its size, what is confounded, and how long a session takes
    #[command(
        after_help = "Examples:\n  proact study check pilot\n  proact study check pilot --schedule > schedule.csv\n\n\
        An imbalance is no error: the exit code is 0 if the plan can be run."
    )]
    Check(plan::StudyCheckArgs),
    /// Say how likely a plan is to show a difference, by simulating it many times
    #[command(after_help = "Examples:\n  proact study power pilot --effect expected.toml\n  \
        proact study power bigger --pilot pilot --participants 8,12,16,24 --dropout 0.1 --figure power\n\n\
        The plan's own order is simulated with so many people. A pilot of simulated participants is no evidence about people.")]
    Power(power::PowerArgs),
    /// Conduct sessions: the experimenter's page and the terminal show where the study is, and either can drive it
    #[command(
        after_help = "Examples:\n  proact study run pilot\n  proact study run pilot --participant P07 --enroll\n  \
        proact study run pilot --emg-source ble --headset\n  proact study run pilot --simulated\n\n\
        Whatever ended the last run, this one goes on from the last event on the disk. Ctrl-C ends; a trial under way counts as \
        interrupted and is done again. With --simulated the exit code is 0 only if the study is finished."
    )]
    Run(run::StudyRunArgs),
    /// Say who is next, and with what
    #[command(after_help = "Example:\n  proact study next pilot")]
    Next(status::StatusArgs),
    /// Say how far a study is, by participant
    #[command(after_help = "Example:\n  proact study status pilot --json")]
    Status(status::StatusArgs),
    /// Write the tables of a study: CSV and SQLite, with a codebook and checksums
    #[command(
        after_help = "Examples:\n  proact study export pilot\n  proact study export pilot --raw --out shared/pilot\n\n\
        Participants are called by their places in the plan unless --keep-pseudonyms. Free words are as they were written: read them \
        before you share them. One row is one observation; codebook.csv says what each column is."
    )]
    Export(files::StudyExportArgs),
    /// Put a whole study into one zip file: plan, journal, records, models, with checksums
    #[command(
        after_help = "Example:\n  proact study archive pilot\n\nWhat was written is read again and compared."
    )]
    Archive(files::ArchiveArgs),
    /// Run trials that come on standard input
    #[command(hide = true)]
    Worker,
}

/// Runs the command. True for success.
///
/// # Errors
/// A plan that cannot be read or run, by its file's name; what each command says.
pub fn run(registry: &Registry, command: &StudyCommand, json: bool) -> Result<bool, Box<dyn Error>> {
    match command {
        StudyCommand::New(args) => plan::new(args, json)?,
        StudyCommand::Check(args) => plan::check(&registry.methods, args, json)?,
        StudyCommand::Power(args) => power::command(&registry.methods, args, json)?,
        StudyCommand::Run(args) => return run::command(registry, args, json),
        StudyCommand::Next(args) => status::next(&registry.methods, args, json)?,
        StudyCommand::Status(args) => status::status(&registry.methods, args, json)?,
        StudyCommand::Export(args) => files::export(&registry.methods, args, json)?,
        StudyCommand::Archive(args) => files::archive(&registry.methods, args, json)?,
        StudyCommand::Worker => run::run_worker(registry)?,
    }
    Ok(true)
}
