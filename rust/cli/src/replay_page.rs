//! Recorded trials on a page: recomputed from their logs, then served to be scrubbed and compared.

use crate::{
    announce::announce,
    interrupt::{interrupt_flag, wait_for_interrupt},
};
use proact_app::{Arm, bag_playback, print_status, record_playback, with_path};
use proact_bridge::{PageOptions, PageServer};
use proact_control::MethodRegistry;
use proact_testbed::TrialConfig;
use std::{error::Error, path::PathBuf, sync::Arc};

/// Recomputes the trials in `dirs`, reads those that are bags, and serves them until Ctrl-C.
pub(crate) fn serve_replays(
    methods: &MethodRegistry,
    dirs: &[PathBuf],
    port: u16,
    open_browser: bool,
) -> Result<bool, Box<dyn Error>> {
    let mut trials = Vec::new();
    for dir in dirs {
        let trial = if dir.is_file() {
            print_status(format_args!("reading {}", dir.display()));
            bag_playback::read_playback(dir, &Arm::load(TrialConfig::DEFAULT_ARM)?)
        } else {
            print_status(format_args!("recomputing {}", dir.display()));
            record_playback::recompute_playback(methods, dir)
        };
        trials.push(trial.map_err(|error| with_path(dir, &error))?);
    }
    let Some(first) = trials.first() else {
        return Err("no trial directory was given; expected at least one".into());
    };
    let server = PageServer::start(PageOptions { port, ..PageOptions::default() }, first.content.clone())?;
    server.set_trials(Arc::new(trials))?;
    announce(&server, "replay", open_browser, false);
    wait_for_interrupt(&*interrupt_flag()?);
    Ok(true)
}
