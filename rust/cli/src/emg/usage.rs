//! `proact emg use`: days and hours of use.

use clap::Args;
use proact_app::use_log::{DayOfUse, UseReport, read_use_log};
use std::{error::Error, path::PathBuf};

/// Columns of the longest bar.
const BAR: f64 = 30.0;

/// Options of `proact emg use`.
#[derive(Debug, Args)]
pub struct UseArgs {
    /// The log, as `proact serve --use-log` writes it.
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
pub(super) fn text(args: &UseArgs, json: bool) -> Result<String, Box<dyn Error>> {
    let report =
        read_use_log(&args.log).map_err(|error| format!("cannot read {}: {error}", args.log.display()))?;
    if json {
        return Ok(proact_types::to_json(&report)? + "\n");
    }
    for (number, reason) in &report.unreadable {
        proact_app::tell(format_args!("{}, line {number} left out: {reason}", args.log.display()));
    }
    if args.csv { csv(&report) } else { Ok(days(&report)) }
}

fn csv(report: &UseReport) -> Result<String, Box<dyn Error>> {
    let mut gestures: Vec<&str> =
        report.days.iter().flat_map(|day| day.used.gestures.keys().map(String::as_str)).collect();
    gestures.sort_unstable();
    gestures.dedup();
    let mut table = csv::Writer::from_writer(Vec::new());
    let fixed = ["day", "sittings", "connected_secs", "active_secs", "moving_secs", "trials", "score"];
    table.write_record(fixed.iter().copied().chain(gestures.iter().copied()))?;
    for day in &report.days {
        let numbers = [day.used.connected_secs, day.used.active_secs, day.used.moving_secs]
            .map(|secs| format!("{secs:.3}"));
        let [connected, active, moving] = numbers;
        let row = [
            day.day.clone(),
            day.sittings.to_string(),
            connected,
            active,
            moving,
            day.used.trials.to_string(),
            day.used.score.to_string(),
        ];
        let counts =
            gestures.iter().map(|gesture| day.used.gestures.get(*gesture).copied().unwrap_or(0).to_string());
        table.write_record(row.into_iter().chain(counts))?;
    }
    Ok(String::from_utf8(table.into_inner()?)?)
}

/// A line a day with a bar of its hours, and what they add up to.
fn days(report: &UseReport) -> String {
    let sum = |of: fn(&DayOfUse) -> f64| report.days.iter().map(of).sum::<f64>();
    let longest = report.days.iter().map(|day| day.used.connected_secs).fold(0.0, f64::max);
    let mut out = String::new();
    for day in &report.days {
        let columns =
            if longest > 0.0 { (BAR * day.used.connected_secs / longest).round() as usize } else { 0 };
        out += &format!(
            "{}  {:30}  {}  {} active, {} moving, {} gestures, {} trials, score {}\n",
            day.day,
            "#".repeat(columns),
            hours(day.used.connected_secs),
            hours(day.used.active_secs),
            hours(day.used.moving_secs),
            day.used.gestures.values().sum::<u64>(),
            day.used.trials,
            day.used.score
        );
    }
    let unreadable = match report.unreadable.len() {
        0 => String::new(),
        count => format!("; {count} lines cannot be read"),
    };
    out + &format!(
        "{} days of use, {} in all, {} active, {} moving{unreadable}\n",
        report.days.len(),
        hours(sum(|day| day.used.connected_secs)),
        hours(sum(|day| day.used.active_secs)),
        hours(sum(|day| day.used.moving_secs))
    )
}

/// Hours and minutes and seconds, as `1:05:09`.
fn hours(secs: f64) -> String {
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
        let told = |csv, json| text(&UseArgs { log: log.clone(), csv }, json).expect("a log");
        let plain = told(false, false);
        let lines: Vec<&str> = plain.lines().collect();
        assert_eq!(lines.len(), 3, "{plain}");
        assert!(lines[0].starts_with(&format!("2026-03-01  {}  1:00:00", "#".repeat(30))), "{plain}");
        assert!(lines[1].starts_with(&format!("2026-03-02  {:30}  0:30:00", "#".repeat(15))), "{plain}");
        assert_eq!(
            lines[2],
            "2 days of use, 1:30:00 in all, 0:01:00 active, 0:00:31 moving; 1 lines cannot be read"
        );
        assert_eq!(
            told(true, false),
            "day,sittings,connected_secs,active_secs,moving_secs,trials,score,hand_close,pinch\n\
             2026-03-01,1,3600.000,60.000,30.500,1,4,2,0\n\
             2026-03-02,1,1800.000,0.000,0.000,0,0,0,1\n"
        );
        let json: serde_json::Value = serde_json::from_str(&told(false, true)).expect("it is JSON");
        assert_eq!(
            (json["days"][1]["connected_secs"].as_f64(), json["unreadable"][0][0].as_u64()),
            (Some(1800.0), Some(2))
        );
        let gone = text(&UseArgs { log: dir.path().join("other"), csv: false }, false);
        assert!(gone.is_err_and(|error| error.to_string().starts_with("cannot read")));
    }
}
