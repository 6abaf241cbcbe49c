//! Recordings and reference vectors outside the repository.

use std::path::PathBuf;

/// The data folder beside the repository, or none with a message.
pub fn shared() -> Option<PathBuf> {
    let beside = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    let dir = std::env::var_os("PROACT_SHARED").map_or_else(beside, PathBuf::from).join("data/emg");
    if !dir.is_dir() {
        println!("skipped: ../shared not found");
        return None;
    }
    Some(dir)
}
