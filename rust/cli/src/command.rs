use crate::{demo::DemoArgs, emg::EmgCommand, replay::ReplayArgs, serve::ServeArgs};
use clap::{Parser, Subcommand};
use std::{error::Error, process::ExitCode};

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
    /// EMG: evaluate recordings, compute features
    Emg {
        /// One JSON object on standard output
        #[arg(long, global = true)]
        json: bool,
        #[command(subcommand)]
        command: EmgCommand,
    },
    /// Serve the live page: mouse is gaze, keys are gestures
    Serve(ServeArgs),
}

/// Parses the command line and runs it. The exit code is 0 only on success.
pub fn main() -> ExitCode {
    let result: Result<bool, Box<dyn Error>> = match Cli::parse().command {
        Command::Demo(args) => crate::demo::demo(&args),
        Command::Run(args) => crate::demo::run(&args),
        Command::Replay(args) => crate::replay::command(&args),
        Command::Emg { json, command } => crate::emg::run(&command, json).map(|()| true),
        Command::Serve(args) => crate::serve::command(&args),
    };
    match result {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("proact: {error}");
            ExitCode::FAILURE
        }
    }
}
