//! What a command tells of its pages and its trials.

use proact_app::{print_result, print_status};
use proact_bridge::PageServer;
use proact_testbed::{TrialEnd, TrialResult};
use std::io;

/// Prints the address of a page of this server, and opens it in a browser if there is a screen to open it on. The
/// empty path is the participant's page. A `secret` token is one that was given, and is not printed.
pub(crate) fn announce(server: &PageServer, path: &str, open_browser: bool, secret: bool) {
    let url = server.page_url(path);
    let page = |path| redact_token(&server.page_url(path), secret);
    print_status(format_args!("page: {}", page(path)));
    if path.is_empty() {
        print_status(format_args!(
            "experimenter: {}, read-only: {}",
            page("experimenter"),
            page("spectator")
        ));
    }
    let screen = ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some());
    if open_browser && screen {
        // The address is printed; a browser that does not start is no reason to stop.
        let _ = open::that_detached(url);
    }
}

/// An address as it is printed: terminals are watched and logs are kept, so that a secret token is left out.
pub(crate) fn redact_token(url: &str, secret: bool) -> String {
    match url.split_once("?token=") {
        Some((page, _)) if secret => format!("{page}?token=YOUR_TOKEN"),
        _ => url.to_owned(),
    }
}

/// A trial's result for reading.
///
/// # Errors
/// Standard output is closed or full.
pub(crate) fn print_trial_result(result: &TrialResult) -> io::Result<()> {
    print_result(format_args!(
        "method {}, task {}, arm {}, set-up {}, seed {}, gestures: {}",
        result.method, result.task, result.arm, result.setup, result.seed, result.gesture_source
    ))?;
    if let Some(arrangement) = result.legacy_fields.get("arrangement") {
        print_result(format_args!("arrangement {arrangement}"))?;
    }
    for line in &result.lines {
        print_result(format_args!("  {line}"))?;
    }
    print_result(format_args!(
        "{} {} in {:.1} s, computed in {:.1} s ({:.1} times real time)",
        result.score, result.score_name, result.sim_seconds, result.wall_seconds, result.real_time_factor
    ))?;
    match result.ended {
        TrialEnd::Task => {}
        TrialEnd::Abort => print_result("ended by the experimenter")?,
        TrialEnd::Restart => print_result("ended for another trial")?,
        TrialEnd::Interrupt => print_result("interrupted")?,
        TrialEnd::Failed => print_result("failed: the score does not count")?,
    }
    print_result(format_args!("digest {}", result.digest))?;
    if let Some(dir) = &result.trial_dir {
        print_result(format_args!("recorded in {dir}; check it with: proact replay {dir}"))?;
    }
    Ok(())
}
