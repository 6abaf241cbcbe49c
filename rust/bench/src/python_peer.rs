//! Peers that are Python packages, where `./proact peers` has put them.

use serde_json::Value;
use std::{
    path::{Path, PathBuf},
    process::Command,
};

/// Where peers may be: the folder that `PROACT_PEERS` names, else that of `./proact peers` in the checkout that the
/// program runs or was built in.
fn peer_folders() -> Vec<PathBuf> {
    if let Some(named) = std::env::var_os("PROACT_PEERS") {
        return vec![named.into()];
    }
    let program = std::env::current_exe().unwrap_or_default();
    // target/release/proact
    let checkout = program.ancestors().nth(3).unwrap_or(Path::new("."));
    vec!["build/peers".into(), checkout.join("build/peers")]
}

/// The object that `program` prints as its last line, run with `words` where the package `package` is.
///
/// # Errors
/// No such package, or no such line: in words for the figure's note.
pub(crate) fn run_peer(package: &str, program: &str, words: &[&str]) -> Result<Value, String> {
    let python = peer_folders().into_iter().map(|folder| folder.join("bin/python3")).find(|python| {
        let has = Command::new(python).args(["-c", &format!("import {package}")]).output();
        has.is_ok_and(|output| output.status.success())
    });
    let python = python.ok_or_else(|| {
        format!(
            "{package} not installed; ./proact peers gets it, or name a virtual environment in PROACT_PEERS"
        )
    })?;
    let output =
        Command::new(&python).args(["-c", program]).args(words).output().map_err(|e| e.to_string())?;
    // The package may print warnings of its own before the figures.
    let text = String::from_utf8_lossy(&output.stdout);
    let object = text.lines().last().and_then(|line| serde_json::from_str(line).ok());
    object.ok_or_else(|| {
        let error = String::from_utf8_lossy(&output.stderr);
        format!("{package} could not be measured: {}", error.lines().last().unwrap_or("no output"))
    })
}
