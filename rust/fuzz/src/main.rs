//! Every reader of the project beside mutated files, packets and messages.
//!
//! A *target* is a function over bytes that calls a reader as the program does. The driver runs it in a child process with
//! limits on memory, stack and time per input: first on the whole corpus, then on mutations of it. What ends the child is a
//! finding. Equal seeds give equal inputs; with `--seconds` the machine decides how many.
//!
//! ```text
//! proact-fuzz --list
//! proact-fuzz urdf srdf --seconds 60 --seed 2
//! proact-fuzz urdf --input build/fuzz/urdf-0123456789ab
//! ```
#![allow(clippy::disallowed_methods)] // Processes, files and the clock are its trade.

mod child;
mod driver;
mod mutate;
mod targets;

use clap::Parser;
use std::{path::PathBuf, process::ExitCode};

/// Readers beside mutated input.
#[derive(Debug, Parser)]
#[command(name = "proact-fuzz", after_help = "Example:\n  proact-fuzz urdf --seconds 60")]
struct Args {
    /// Which targets; all if none is named
    targets: Vec<String>,
    /// Names the targets
    #[arg(long)]
    list: bool,
    /// Time for the mutations of each target, after its corpus; 0 for the corpus alone
    #[arg(long, default_value_t = 5.0)]
    seconds: f64,
    /// Number of mutations of each target instead, however long they take
    #[arg(long, value_name = "COUNT", conflicts_with = "seconds")]
    inputs: Option<u64>,
    /// Seed of the mutations
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// These files alone, as they are
    #[arg(long, value_name = "FILE")]
    input: Vec<PathBuf>,
    /// Folder with a folder of inputs for each target
    #[arg(long, value_name = "DIR", default_value = "tests/fuzz/corpus")]
    corpus: PathBuf,
    /// Where inputs are kept that end a target
    #[arg(long, value_name = "DIR", default_value = "build/fuzz")]
    out: PathBuf,
    /// Runs a target on the inputs that come in on standard input
    #[arg(long, hide = true, value_name = "FOLDER")]
    child: Option<PathBuf>,
}

fn main() -> ExitCode {
    let args = Args::parse();
    let chosen = match targets::targets_by_name(&args.targets) {
        Ok(chosen) => chosen,
        Err(unknown) => {
            eprintln!("proact-fuzz: {unknown}");
            return ExitCode::FAILURE;
        }
    };
    if args.list {
        chosen.iter().for_each(|target| println!("{:<18} {}", target.name, target.reads));
        return ExitCode::SUCCESS;
    }
    let done = match (&args.child, chosen.as_slice()) {
        (Some(scratch), [target]) => child::run_inputs(target, scratch).map(|()| 0),
        (Some(_), _) => Err("a child runs one target".into()),
        (None, _) => driver::run(&chosen, &args),
    };
    match done {
        Ok(0) => ExitCode::SUCCESS,
        Ok(_) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("proact-fuzz: {error}");
            ExitCode::FAILURE
        }
    }
}
