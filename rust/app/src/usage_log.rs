//! The log of use: when somebody sat before an arm, for how long, and what they did, over days and weeks. One line of JSON a minute of
//! use, so that a crash or a power cut costs a minute at most.

use crate::{TrialInputs, print_status};
use jiff::{Timestamp, Zoned, civil::Date};
use proact_bridge::{ClientInput, PageServer};
use proact_testbed::TrialResult;
use proact_types::{DisplayFrame, Gesture, JointVector, LineRead, SimTime, read_line};
use serde::{Deserialize, Serialize};
use std::{
    collections::{BTreeMap, BTreeSet},
    fs::{File, OpenOptions},
    io::{self, BufRead, BufReader, Read, Seek, SeekFrom, Write},
    path::Path,
    sync::mpsc::{Sender, channel},
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

/// A line is written after so much time.
const LINE_PERIOD: Duration = Duration::from_secs(60);
/// Longest line that is read, bytes: 64 gestures of 64 bytes have room.
const MAX_LINE_BYTES: usize = 1 << 14;
/// The arm moves while a joint turns faster than this, rad/s: slower is the settling of an arm that holds.
const MOVES_RAD_PER_S: f64 = 0.02;
/// No two frames of a trial in real time are further apart than this, s: what is was no use.
const MAX_FRAME_GAP_SECS: f64 = 1.0;

/// One stretch of use: a line of the log.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UsageLine {
    /// When the program was started, which all lines of a sitting have in common: local time with its offset, such as
    /// `2026-03-01T09:30:00+01:00`.
    #[serde(rename = "sitting")]
    pub program_start: String,
    /// When the stretch began.
    pub start: String,
    /// When it ended.
    pub end: String,
    /// What was done in it.
    #[serde(rename = "used")]
    pub usage: Usage,
}

/// What was done in some time.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Usage {
    /// Time with a page connected, s.
    pub connected_secs: f64,
    /// Time in trials with another gesture in force than that of a relaxed hand, s.
    pub active_secs: f64,
    /// Time in trials in which a joint of the arm or hand moved, s.
    pub moving_secs: f64,
    /// How often each gesture but rest came into force.
    pub gestures: BTreeMap<String, u64>,
    /// Trials that ended.
    pub trials: u64,
    /// Sum of their scores.
    pub score: f64,
}

impl Usage {
    fn add(&mut self, other: Usage) {
        self.connected_secs += other.connected_secs;
        self.active_secs += other.active_secs;
        self.moving_secs += other.moving_secs;
        for (gesture, count) in other.gestures {
            let known = self.gestures.entry(gesture).or_default();
            *known = known.saturating_add(count);
        }
        self.trials = self.trials.saturating_add(other.trials);
        self.score += other.score;
    }
}

impl UsageLine {
    /// Reads a line.
    ///
    /// # Errors
    /// What is wrong, in words.
    pub fn parse(text: &str) -> Result<UsageLine, String> {
        let line: UsageLine = serde_json::from_str(text).map_err(|error| error.to_string())?;
        line.day()?;
        for (name, value) in [("start", &line.start), ("end", &line.end)] {
            let _: Timestamp = value.parse().map_err(|error| format!("{name} {value:?}: {error}"))?;
        }
        for (name, value) in [
            ("connected_secs", line.usage.connected_secs),
            ("active_secs", line.usage.active_secs),
            ("moving_secs", line.usage.moving_secs),
        ] {
            if !(0.0..=86_400.0).contains(&value) {
                return Err(format!("{name} is {value}, expected 0 to 86400"));
            }
        }
        Ok(line)
    }

    /// The day on which it began, where it was written.
    fn day(&self) -> Result<Date, String> {
        let date = self.start.get(..10).unwrap_or(&self.start);
        date.parse().map_err(|error| format!("start {:?}: {error}", self.start))
    }

    fn has_usage(&self) -> bool {
        self.usage.connected_secs > 0.0 || self.usage.trials > 0
    }
}

/// Writes the log while a program runs. The disk has a thread of its own: a trial never waits for it.
pub struct UsageLog {
    line: UsageLine,
    began: Instant,
    /// When connections were last looked at.
    last_check: Instant,
    /// The frame before.
    previous_frame: Option<(SimTime, JointVector)>,
    in_force: Gesture,
    lines: Option<Sender<String>>,
    writer: Option<JoinHandle<()>>,
}

impl UsageLog {
    /// As [`UsageLog::lock`], where a path was given.
    ///
    /// # Errors
    /// The file cannot be opened or written to, by its name.
    pub fn open_if_given(path: Option<&Path>) -> Result<Option<UsageLog>, String> {
        let Some(path) = path else { return Ok(None) };
        let failed = |error| format!("cannot write the use log {}: {error}", path.display());
        UsageLog::open(path).map(Some).map_err(failed)
    }

    /// Goes on with the log at `path`, or begins it. A line that was cut off is ended first.
    ///
    /// # Errors
    /// The file cannot be opened or written to.
    pub fn open(path: &Path) -> io::Result<UsageLog> {
        let mut file = OpenOptions::new().create(true).append(true).read(true).open(path)?;
        let mut last = [b'\n'];
        // Of a pipe or device there is no end to look at, and no disk to wait for.
        let regular = file.metadata()?.is_file();
        if file.metadata()?.len() > 0 {
            file.seek(SeekFrom::End(-1))?;
            file.read_exact(&mut last)?;
        }
        if last != [b'\n'] {
            file.write_all(b"\n")?;
        }
        let (sender, lines) = channel::<String>();
        let shown = path.display().to_string();
        let write = move || {
            for line in lines {
                // One call a line, so that none is mixed with another program's.
                let sync = |()| if regular { file.sync_data() } else { Ok(()) };
                if let Err(error) = (&file).write_all(line.as_bytes()).and_then(sync) {
                    print_status(format_args!("use log {shown}: {error}; this minute is lost"));
                }
            }
        };
        let writer = thread::Builder::new().name("use-log".to_owned()).spawn(write)?;
        let start = local_time();
        let line = UsageLine { program_start: start.clone(), start, ..UsageLine::default() };
        let now = Instant::now();
        Ok(UsageLog {
            line,
            began: now,
            last_check: now,
            previous_frame: None,
            in_force: Gesture::default(),
            lines: Some(sender),
            writer: Some(writer),
        })
    }

    /// Whether a page is connected at `now`, asked often.
    pub fn update_connection(&mut self, now: Instant, connected: bool) {
        if connected {
            self.line.usage.connected_secs += now.duration_since(self.last_check).as_secs_f64();
        }
        self.last_check = now;
        if now.duration_since(self.began) >= LINE_PERIOD {
            self.end_line(now);
        }
    }

    /// An instant of a trial, in which the gesture `rest` is that of a relaxed hand.
    pub fn record_frame(&mut self, frame: &DisplayFrame, rest: Gesture) {
        let (active, last) = (frame.recognized_gesture != rest, self.previous_frame.take());
        if active && frame.recognized_gesture != self.in_force {
            *self.line.usage.gestures.entry(frame.recognized_gesture.to_string()).or_default() += 1;
        }
        self.in_force = frame.recognized_gesture;
        if let Some((then, joints)) = last.filter(|(then, _)| *then < frame.time) {
            let secs = (frame.time.millis_since(then) as f64 / 1000.0).min(MAX_FRAME_GAP_SECS);
            let fastest = joints
                .iter()
                .zip(&frame.joints)
                .map(|(before, now)| (now - before).abs() / secs)
                .fold(0.0, f64::max);
            self.line.usage.active_secs += if active { secs } else { 0.0 };
            self.line.usage.moving_secs += if fastest > MOVES_RAD_PER_S { secs } else { 0.0 };
        }
        self.previous_frame = Some((frame.time, frame.joints.clone()));
    }

    /// A trial ended with this score.
    pub fn end_trial(&mut self, score: f64) {
        self.line.usage.trials += 1;
        self.line.usage.score += if score.is_finite() { score } else { 0.0 };
        self.previous_frame = None;
    }

    /// Writes the stretch down, if anything happened in it, and begins the next.
    fn end_line(&mut self, now: Instant) {
        let end = local_time();
        let next = UsageLine {
            program_start: self.line.program_start.clone(),
            start: end.clone(),
            ..UsageLine::default()
        };
        let mut line = std::mem::replace(&mut self.line, next);
        self.began = now;
        if !line.has_usage() {
            return;
        }
        line.end = end;
        for secs in [&mut line.usage.connected_secs, &mut line.usage.active_secs, &mut line.usage.moving_secs]
        {
            *secs = (*secs * 1000.0).round() / 1000.0;
        }
        if let (Ok(text), Some(lines)) = (serde_json::to_string(&line), &self.lines) {
            let _ = lines.send(text + "\n");
        }
    }
}

impl Drop for UsageLog {
    fn drop(&mut self) {
        self.end_line(Instant::now());
        // Without a sender the writer ends with the last line.
        self.lines = None;
        if let Some(writer) = self.writer.take() {
            let _ = writer.join();
        }
    }
}

/// The time of day here, with its offset from universal time.
fn local_time() -> String {
    Zoned::now().strftime("%Y-%m-%dT%H:%M:%S%:z").to_string()
}

/// What comes from a page, looked at by a log of use.
pub struct LoggedInputs<'a> {
    /// The page.
    pub page: &'a PageServer,
    /// The log; none that is kept.
    pub log: Option<&'a mut UsageLog>,
    /// The gesture of a relaxed hand.
    pub rest: Gesture,
}

impl TrialInputs for LoggedInputs<'_> {
    fn drain(&mut self) -> Vec<ClientInput> {
        if let Some(log) = &mut self.log {
            log.update_connection(Instant::now(), self.page.client_count() > 0);
        }
        self.page.drain_inputs()
    }

    fn frame_shown(&mut self, frame: &DisplayFrame) {
        if let Some(log) = &mut self.log {
            log.record_frame(frame, self.rest);
        }
    }

    fn trial_ended(&mut self, result: &TrialResult) {
        if let Some(log) = &mut self.log {
            log.end_trial(result.score);
        }
    }
}

/// What a log says of one day, or of all.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct DailyUsage {
    /// Such as `2026-03-01`.
    pub day: String,
    /// Sittings that were used on it.
    #[serde(rename = "sittings")]
    pub program_runs: usize,
    /// What was done on it.
    #[serde(flatten)]
    #[serde(rename = "used")]
    pub usage: Usage,
}

/// What a log says.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct UsageReport {
    /// Days with use, the oldest first.
    pub days: Vec<DailyUsage>,
    /// Lines that cannot be read: number from 1, and why.
    pub unreadable: Vec<(u64, String)>,
}

/// Reads the log at `path`. A line that cannot be read is named, and the others count.
///
/// # Errors
/// The file itself cannot be read.
pub fn read_usage_log(path: &Path) -> io::Result<UsageReport> {
    let mut from = BufReader::new(File::open(path)?);
    let mut days: BTreeMap<Date, (BTreeSet<String>, DailyUsage)> = BTreeMap::new();
    let (mut report, mut bytes) = (UsageReport::default(), Vec::new());
    for number in 1.. {
        let read = read_line(&mut from, MAX_LINE_BYTES, &mut bytes)?;
        match read {
            LineRead::End => break,
            LineRead::Complete => {}
            LineRead::TooLong => {
                from.skip_until(b'\n')?;
                report.unreadable.push((number, format!("more than {MAX_LINE_BYTES} bytes")));
                continue;
            }
        }
        let text = String::from_utf8_lossy(&bytes);
        let text = text.trim();
        if text.is_empty() {
            continue;
        }
        match UsageLine::parse(text).and_then(|line| Ok((line.day()?, line))) {
            Ok((day, line)) => {
                let (sittings, sum) = days.entry(day).or_default();
                sittings.insert(line.program_start.clone());
                sum.usage.add(line.usage);
            }
            Err(reason) => report.unreadable.push((number, reason)),
        }
    }
    report.days = days
        .into_iter()
        .map(|(day, (sittings, sum))| DailyUsage {
            day: day.to_string(),
            program_runs: sittings.len(),
            ..sum
        })
        .collect();
    Ok(report)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proact_types::Command;
    use serde_json::json;

    fn frame(time: u64, command: Command, angle: f64) -> DisplayFrame {
        let pose = json!({ "rotation": [0.0, 0.0, 0.0, 1.0], "translation": [0.0, 0.0, 0.0] });
        serde_json::from_value(json!({
            "time": time, "method": "A", "joints": [angle, 0.0], "world_from_base": pose, "world_from_tip": pose,
            "world_from_head": pose, "objects": [], "hand": { "state": "open", "holds": null }, "gaze": null,
            "target": { "object": null, "place": null, "locked": false, "posterior": [] },
            "planner": { "state": "idle", "motion": "holding" }, "gesture": command, "recognised": command,
            "confidence": 1.0, "emg_source": "keys", "time_left_secs": 1.0, "next": null, "score": 0,
            "finished": false, "events": [],
        }))
        .expect("a frame")
    }

    fn file() -> (tempfile::TempDir, std::path::PathBuf) {
        let dir = tempfile::tempdir().expect("a folder");
        let path = dir.path().join("use.jsonl");
        (dir, path)
    }

    #[test]
    fn a_minute_is_a_line_and_the_end_another_and_both_add_up_to_what_was_done() {
        let (_dir, path) = file();
        let mut log = UsageLog::open(&path).expect("a new log");
        let (start, rest) = (log.began, Gesture::default());
        let after = |secs| start + Duration::from_secs(secs);
        log.update_connection(after(10), false);
        log.update_connection(after(30), true);
        // Two seconds of closing, in the first of which the arm moves; then rest.
        for tick in 0..=20_u64 {
            log.record_frame(&frame(100 * tick, Command::HandClose, 0.1 * tick.min(10) as f64), rest);
        }
        log.record_frame(&frame(2100, Command::NoMotion, 1.0), rest);
        log.record_frame(&frame(2200, Command::HandClose, 1.0), rest);
        log.update_connection(after(60), true);
        log.end_trial(3.0);
        log.end_trial(f64::NAN);
        drop(log);
        let text = std::fs::read_to_string(&path).expect("written");
        assert_eq!(text.lines().count(), 2, "{text}");
        let report = read_usage_log(&path).expect("a log");
        let [day] = report.days.as_slice() else { panic!("one day, unless it is midnight: {report:?}") };
        assert_eq!(
            (day.program_runs, day.usage.trials, day.usage.score, report.unreadable.len()),
            (1, 2, 3.0, 0)
        );
        assert_eq!(day.usage.gestures, BTreeMap::from([("hand_close".to_owned(), 2)]));
        assert_eq!(
            (day.usage.connected_secs, day.usage.active_secs, day.usage.moving_secs),
            (50.0, 2.1, 1.0)
        );
    }

    #[test]
    fn minutes_without_anybody_are_not_written() {
        let (_dir, path) = file();
        let mut log = UsageLog::open(&path).expect("a new log");
        let start = log.began;
        (1..=10).for_each(|minute| log.update_connection(start + Duration::from_secs(60 * minute), false));
        drop(log);
        assert_eq!(std::fs::read_to_string(&path).expect("made"), "");
    }

    #[test]
    fn a_line_that_was_cut_off_is_ended_and_what_cannot_be_read_is_named() {
        let (_dir, path) = file();
        let good = UsageLine {
            program_start: "2026-03-01T09:30:00+01:00".to_owned(),
            start: "2026-03-01T23:59:30+01:00".to_owned(),
            end: "2026-03-02T00:00:30+01:00".to_owned(),
            usage: Usage { connected_secs: 60.0, ..Usage::default() },
        };
        let good = serde_json::to_string(&good).expect("plain");
        let other = good.replace("\"start\":\"2026-03-01", "\"start\":\"2026-02-28");
        let long = "x".repeat(2 * MAX_LINE_BYTES);
        let negative = good.replace("60.0", "-1.0");
        std::fs::write(&path, format!("{good}\n{long}\n{other}\n\n{negative}\n{}", &good[..40]))
            .expect("written");
        let mut log = UsageLog::open(&path).expect("an old log");
        log.end_trial(1.0);
        drop(log);
        let report = read_usage_log(&path).expect("a log");
        let days: Vec<&str> = report.days.iter().map(|day| day.day.as_str()).collect();
        assert_eq!(days[..2], ["2026-02-28", "2026-03-01"]);
        assert_eq!((days.len(), report.days[2].usage.trials), (3, 1), "what came after the cut counts");
        let numbers: Vec<u64> = report.unreadable.iter().map(|(number, _)| *number).collect();
        assert_eq!(numbers, [2, 5, 6]);
        assert!(report.unreadable[0].1.contains("16384 bytes"), "{report:?}");
        assert!(report.unreadable[1].1.contains("connected_secs is -1"), "{report:?}");
    }

    #[test]
    fn a_day_that_is_none_and_a_key_too_much_are_refused() {
        for (text, part) in [
            ("{}", "missing field"),
            ("[1]", "expected"),
            (
                r#"{"sitting":"","start":"2026-13-01T00:00:00Z","end":"","used":{"connected_secs":0,"active_secs":0,"moving_secs":0,"gestures":{},"trials":0,"score":0}}"#,
                "2026-13-01",
            ),
            (
                r#"{"sitting":"","start":"ü","end":"","used":{"connected_secs":0,"active_secs":0,"moving_secs":0,"gestures":{},"trials":0,"score":0}}"#,
                "start",
            ),
            (r#"{"color":1}"#, "unknown field"),
            (r#"{"used":{"color":1}}"#, "unknown field"),
        ] {
            let error = UsageLine::parse(text).expect_err("no line of use");
            assert!(error.contains(part), "{text}: {error}");
        }
    }
}
