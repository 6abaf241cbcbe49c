//! What is measured of whole programs: batches and memory.

use super::{ScalingChart, ScalingLine};
use std::{
    error::Error,
    io::Read,
    process::{Command, Stdio},
    time::Instant,
};

/// Trials of a batch.
const TRIALS: usize = 8;
const JOBS: [usize; 3] = [1, 2, 4];
/// Simulated minutes of a trial.
const MINUTES: [u32; 5] = [1, 2, 5, 15, 30];
/// From look to look at what a program has, milliseconds.
const POLL_PERIOD_MS: u64 = 20;

/// A batch of trials, each in a program of its own.
pub(super) fn jobs() -> Result<ScalingChart, Box<dyn Error>> {
    let mut points = Vec::new();
    for jobs in JOBS {
        let begin = Instant::now();
        let [jobs_text, trials] = [jobs, TRIALS].map(|n| n.to_string());
        let words = ["simulate", "--methods", "D", "--seeds", &trials, "--jobs", &jobs_text, "--json"];
        let output = Command::new(std::env::current_exe()?).args(words).stdin(Stdio::null()).output()?;
        if !output.status.success() {
            return Err(format!("simulate failed: {}", String::from_utf8_lossy(&output.stderr)).into());
        }
        points.push((jobs as f64, begin.elapsed().as_secs_f64() / TRIALS as f64));
    }
    let cores = std::thread::available_parallelism()?;
    let bound = format!("the {cores} cores here; the wall clock, so what else runs on them counts");
    let lines = vec![ScalingLine { name: "batch of trials of D".to_owned(), points, bound }];
    Ok(ScalingChart { file: "jobs", size_label: "jobs", cost_label: "wall clock a trial", unit: "s", lines })
}

/// A recorded trial that goes on: the standard box and blocks refilled until the time is over.
pub(super) fn minutes() -> Result<ScalingChart, Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    let mut lines = ["memory at most", "record on the disk"].map(|name| ScalingLine {
        name: name.to_owned(),
        points: vec![],
        bound: String::new(),
    });
    for minutes in MINUTES {
        let out = folder.path().join(minutes.to_string());
        let limit = (60 * minutes).to_string();
        let words = [
            "demo",
            "--headless",
            "--method",
            "B",
            "--task",
            "bbt",
            "--time-limit",
            &limit,
            "--json",
            "--out",
        ];
        let mut child = Command::new(std::env::current_exe()?)
            .args(words)
            .arg(&out)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()?;
        let mut max_mb = 0.0_f64;
        let status = loop {
            max_mb = max_mb.max(peak_mb(child.id()).unwrap_or(0.0));
            if let Some(status) = child.try_wait()? {
                break status;
            }
            std::thread::sleep(std::time::Duration::from_millis(POLL_PERIOD_MS));
        };
        let mut stderr_text = String::new();
        if let Some(mut errors) = child.stderr.take() {
            errors.read_to_string(&mut stderr_text)?;
        }
        // A trial that its time ended is none that failed; one that broke off has no result.
        if !out.join("result.json").is_file() {
            return Err(format!("a trial of {minutes} min broke off, {status}: {stderr_text}").into());
        }
        lines[0].points.push((f64::from(minutes), max_mb));
        lines[1].points.push((f64::from(minutes), size_mb(&out)?));
        std::fs::remove_dir_all(&out)?;
    }
    lines[0].bound = "the memory of a job".to_owned();
    lines[1].bound = "the disk".to_owned();
    Ok(ScalingChart {
        file: "minutes",
        size_label: "minutes",
        cost_label: "memory and record",
        unit: "MB",
        lines: lines.into(),
    })
}

/// The most memory that a running program has had, megabytes.
fn peak_mb(pid: u32) -> Option<f64> {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.trim().trim_end_matches(" kB").parse::<f64>().ok()? / 1024.0)
}

fn size_mb(folder: &std::path::Path) -> std::io::Result<f64> {
    let mut bytes = 0.0;
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let data = entry.metadata()?;
        bytes += if data.is_dir() { size_mb(&entry.path())? } else { data.len() as f64 / 1e6 };
    }
    Ok(bytes)
}
