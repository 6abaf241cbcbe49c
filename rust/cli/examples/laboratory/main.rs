//! A laboratory's own program: `proact` with a control method, an armband and a feedback device of its own.
//!
//! ```sh
//! cargo run --release -p proact-cli --example laboratory -- demo --headless --method follow_gaze --feedback log:cues.txt
//! cargo run --release -p proact-cli --example laboratory -- emg stream --source textband://127.0.0.1:7000
//! ```

#![allow(clippy::disallowed_methods)] // A device has a clock of its own.

mod armband;
mod feedback;
#[path = "../../../../docs/methods/follow_gaze.rs"]
mod follow_gaze;

use proact_app::Registry;
use proact_control::MethodEntry;
use proact_types::{MethodHelp, MethodInfo, MethodNeeds, MethodStyle};
use std::{error::Error, process::ExitCode};

fn main() -> ExitCode {
    match registry() {
        Ok(registry) => proact_cli::run(registry),
        Err(error) => {
            proact_app::print_status(error);
            ExitCode::FAILURE
        }
    }
}

/// What ships with the program, and a line for each thing of our own.
fn registry() -> Result<Registry, Box<dyn Error>> {
    let mut registry = Registry::standard();
    registry.methods = registry.methods.with(method())?;
    registry.sources = registry.sources.with(armband::TEXT_BAND)?;
    registry.sinks.push(feedback::LOG);
    Ok(registry)
}

/// The example of docs/methods, as an entry.
fn method() -> MethodEntry {
    let info = MethodInfo {
        name: "follow_gaze".to_owned(),
        title: "Towards what you look at".to_owned(),
        needs: MethodNeeds { gaze: true, ..MethodNeeds::default() },
        style: MethodStyle::Selecting,
        help: MethodHelp { wrist_extension: "towards it (hold)".to_owned(), ..MethodHelp::default() },
    };
    MethodEntry::new(info, |_profile, _arm, _joints| Ok(Box::new(follow_gaze::FollowGaze::default())))
}
