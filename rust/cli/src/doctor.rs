//! `proact doctor`: looks at this machine and says, line by line, what works and what to do about the rest.
//!
//! ```text
//! $ proact doctor
//! ok    OMPL              1.5.2+ds1-1 (libompl.so.1.5.2)
//! warn  port 9090         taken by another program
//!                         -> give rosbridge another port, or end that program
//! ```

use clap::Args;
use proact_app::{
    MocapAxes, Registry,
    doctor::{CheckStatus, DoctorCheck, run_checks, tracking},
};
use proact_devices::SourceName;
use serde::Serialize;
use std::io::{self, Write};

/// Arguments of `proact doctor`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  proact doctor\n  proact doctor --mocap natnet:192.168.1.5/Shoulderpad")]
pub(crate) struct DoctorArgs {
    /// One JSON object on standard output
    #[arg(long)]
    json: bool,
    /// Listen to this tracking source for 4 s: rate, age of the newest pose, verdict; may be repeated
    #[arg(long, value_name = "SOURCE")]
    mocap: Vec<SourceName>,
    /// How their axes lie, as for serve
    #[arg(long, value_name = "KEY=VALUE,..", requires = "mocap")]
    mocap_axes: Option<MocapAxes>,
}

/// Prints the report on standard output, for people or as one JSON object.
///
/// The object has `version`, `ok` and `checks[{name, status, found, advice}]`, where `status` is `ok`, `warn` or
/// `fail`. Returns whether no check failed; a warning is no failure.
///
/// # Errors
/// Standard output cannot be written to.
pub(crate) fn run(registry: &Registry, args: &DoctorArgs) -> io::Result<bool> {
    let mut checks = run_checks(registry);
    let axes = args.mocap_axes.unwrap_or_default();
    checks.extend(args.mocap.iter().map(|source| tracking(registry, source, axes)));
    let json = args.json;
    let healthy = checks.iter().all(|check| check.status != CheckStatus::Fail);
    let mut out = io::stdout().lock();
    if json {
        write_json(&mut out, &checks, healthy)?;
    } else {
        write_text(&mut out, &checks)?;
    }
    Ok(healthy)
}

fn write_text(out: &mut impl Write, checks: &[DoctorCheck]) -> io::Result<()> {
    for check in checks {
        let status = match check.status {
            CheckStatus::Ok => "ok",
            CheckStatus::Warn => "warn",
            CheckStatus::Fail => "FAIL",
        };
        writeln!(out, "{status:<5} {:<18} {}", check.name, check.found)?;
        if !check.advice.is_empty() {
            writeln!(out, "{:<24} -> {}", "", check.advice)?;
        }
    }
    let count = |wanted: CheckStatus| checks.iter().filter(|check| check.status == wanted).count();
    writeln!(
        out,
        "{} in order, {} to know about, {} that must be put right",
        count(CheckStatus::Ok),
        count(CheckStatus::Warn),
        count(CheckStatus::Fail)
    )
}

fn write_json(out: &mut impl Write, checks: &[DoctorCheck], healthy: bool) -> io::Result<()> {
    #[derive(Serialize)]
    struct DoctorReport<'a> {
        version: &'a str,
        ok: bool,
        checks: &'a [DoctorCheck],
    }
    let report = DoctorReport { version: env!("CARGO_PKG_VERSION"), ok: healthy, checks };
    writeln!(out, "{}", proact_types::to_json(&report)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(name: &str, status: CheckStatus, advice: &str) -> DoctorCheck {
        DoctorCheck { name: name.to_owned(), status, found: "1".to_owned(), advice: advice.to_owned() }
    }

    #[test]
    fn the_json_report_is_one_object_on_one_line() {
        let checks = [check("a", CheckStatus::Ok, ""), check("b", CheckStatus::Fail, "do this")];
        let mut out = Vec::new();
        write_json(&mut out, &checks, false).expect("a vector takes everything");
        let text = String::from_utf8(out).expect("JSON is UTF-8");
        assert_eq!(text.lines().count(), 1);
        let value: serde_json::Value = serde_json::from_str(&text).expect("it is JSON");
        assert_eq!(value["ok"], false);
        assert_eq!(value["checks"][1]["status"], "fail");
        assert_eq!(value["checks"][1]["advice"], "do this");
    }

    #[test]
    fn the_text_report_gives_advice_under_its_line_and_counts_them() {
        let checks = [check("a", CheckStatus::Ok, ""), check("b", CheckStatus::Warn, "do this")];
        let mut out = Vec::new();
        write_text(&mut out, &checks).expect("a vector takes everything");
        let text = String::from_utf8(out).expect("the report is UTF-8");
        assert!(text.contains("-> do this"), "{text}");
        assert!(text.ends_with("1 in order, 1 to know about, 0 that must be put right\n"), "{text}");
    }
}
