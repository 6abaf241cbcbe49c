//! `proact emg usage`: days and hours of use.

use clap::Args;
use proact_app::usage_log::{DailyUsage, UsageReport, read_usage_log};
use std::{error::Error, path::PathBuf};

/// Columns of the longest bar.
const MAX_BAR_COLUMNS: f64 = 30.0;

/// Options of `proact emg usage`.
#[derive(Debug, Args)]
pub struct UsageArgs {
    /// The log, as `proact serve --usage-log` writes it.
    #[arg(value_name = "FILE")]
    log: PathBuf,
    /// As a table for other programs: one row a day, times in seconds.
    #[arg(long)]
    csv: bool,
}

/// What the log says.
///
/// # Errors
/// The file cannot be read.
pub(super) fn text(args: &UsageArgs, json: bool) -> Result<String, Box<dyn Error>> {
    let report =
        read_usage_log(&args.log).map_err(|error| format!("cannot read {}: {error}", args.log.display()))?;
    if json {
        return Ok(proact_types::to_json(&report)? + "\n");
    }
    for (number, reason) in &report.unreadable {
        proact_app::print_status(format_args!("{}, line {number} left out: {reason}", args.log.display()));
    }
    if args.csv { csv(&report) } else { Ok(daily_text(&report)) }
}

fn csv(report: &UsageReport) -> Result<String, Box<dyn Error>> {
    let mut gestures: Vec<&str> =
        report.days.iter().flat_map(|day| day.usage.gestures.keys().map(String::as_str)).collect();
    gestures.sort_unstable();
    gestures.dedup();
    let mut table = csv::Writer::from_writer(Vec::new());
    let fixed = ["day", "sittings", "connected_secs", "active_secs", "moving_secs", "trials", "score"];
    table.write_record(fixed.iter().copied().chain(gestures.iter().copied()))?;
    for day in &report.days {
        let numbers = [day.usage.connected_secs, day.usage.active_secs, day.usage.moving_secs]
            .map(|secs| format!("{secs:.3}"));
        let [connected, active, moving] = numbers;
        let row = [
            day.day.clone(),
            day.program_runs.to_string(),
            connected,
            active,
            moving,
            day.usage.trials.to_string(),
            day.usage.score.to_string(),
        ];
        let counts =
            gestures.iter().map(|gesture| day.usage.gestures.get(*gesture).copied().unwrap_or(0).to_string());
        table.write_record(row.into_iter().chain(counts))?;
    }
    Ok(String::from_utf8(table.into_inner()?)?)
}

/// A line a day with a bar of its hours, and what they add up to.
fn daily_text(report: &UsageReport) -> String {
    let sum = |of: fn(&DailyUsage) -> f64| report.days.iter().map(of).sum::<f64>();
    let max_secs = report.days.iter().map(|day| day.usage.connected_secs).fold(0.0, f64::max);
    let mut out = String::new();
    for day in &report.days {
        let columns = if max_secs > 0.0 {
            (MAX_BAR_COLUMNS * day.usage.connected_secs / max_secs).round() as usize
        } else {
            0
        };
        out += &format!(
            "{}  {:30}  {}  {} active, {} moving, {} gestures, {} trials, score {}\n",
            day.day,
            "#".repeat(columns),
            duration_text(day.usage.connected_secs),
            duration_text(day.usage.active_secs),
            duration_text(day.usage.moving_secs),
            day.usage.gestures.values().sum::<u64>(),
            day.usage.trials,
            day.usage.score
        );
    }
    let unreadable = match report.unreadable.len() {
        0 => String::new(),
        count => format!("; {count} lines cannot be read"),
    };
    out + &format!(
        "{} days of use, {} in all, {} active, {} moving{unreadable}\n",
        report.days.len(),
        duration_text(sum(|day| day.usage.connected_secs)),
        duration_text(sum(|day| day.usage.active_secs)),
        duration_text(sum(|day| day.usage.moving_secs))
    )
}

/// Hours and minutes and seconds, as `1:05:09`.
fn duration_text(secs: f64) -> String {
    let whole = secs.round() as u64;
    format!("{}:{:02}:{:02}", whole / 3600, whole / 60 % 60, whole % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOG: &str = concat!(
        r#"{"sitting":"a","start":"2026-03-01T09:00:00+01:00","end":"2026-03-01T09:01:00+01:00","used":{"connected_secs":3600,"active_secs":60,"moving_secs":30.5,"gestures":{"hand_close":2},"trials":1,"score":4}}"#,
        "\nbroken\n",
        r#"{"sitting":"b","start":"2026-03-02T09:00:00+01:00","end":"2026-03-02T09:01:00+01:00","used":{"connected_secs":1800,"active_secs":0,"moving_secs":0,"gestures":{"pinch":1},"trials":0,"score":0}}"#,
        "\n",
    );

    #[test]
    fn a_log_is_told_as_bars_as_a_table_and_as_json() {
        let dir = tempfile::tempdir().expect("a folder");
        let log = dir.path().join("use.jsonl");
        std::fs::write(&log, LOG).expect("written");
        let report_text = |csv, json| text(&UsageArgs { log: log.clone(), csv }, json).expect("a log");
        let plain = report_text(false, false);
        let lines: Vec<&str> = plain.lines().collect();
        assert_eq!(lines.len(), 3, "{plain}");
        assert!(lines[0].starts_with(&format!("2026-03-01  {}  1:00:00", "#".repeat(30))), "{plain}");
        assert!(lines[1].starts_with(&format!("2026-03-02  {:30}  0:30:00", "#".repeat(15))), "{plain}");
        assert_eq!(
            lines[2],
            "2 days of use, 1:30:00 in all, 0:01:00 active, 0:00:31 moving; 1 lines cannot be read"
        );
        assert_eq!(
            report_text(true, false),
            "day,sittings,connected_secs,active_secs,moving_secs,trials,score,hand_close,pinch\n\
             2026-03-01,1,3600.000,60.000,30.500,1,4,2,0\n\
             2026-03-02,1,1800.000,0.000,0.000,0,0,0,1\n"
        );
        let json: serde_json::Value = serde_json::from_str(&report_text(false, true)).expect("it is JSON");
        assert_eq!(
            (json["days"][1]["connected_secs"].as_f64(), json["unreadable"][0][0].as_u64()),
            (Some(1800.0), Some(2))
        );
        let gone = text(&UsageArgs { log: dir.path().join("other"), csv: false }, false);
        assert!(gone.is_err_and(|error| error.to_string().starts_with("cannot read")));
    }
}
