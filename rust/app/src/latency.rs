//! How long the way from a muscle to the light of a screen takes, stage by stage, in a trial that runs in real time.
//!
//! Wall clock where computers are waited for, trial time where the trial itself takes it: in real time the two pass alike. What
//! a person's own muscles do, nobody knows; the rows that begin with a muscle are those of simulated people.

use arrayvec::ArrayVec;
use hdrhistogram::Histogram;
use proact_bridge::{FrameLatency, LatencyRow, LatencyStage};
use proact_files::write_atomically;
use proact_testbed::{RunningTrial, TrialStep, stages::StageName};
use proact_types::{Command, SimTime};
use serde::Serialize;
use std::{
    collections::VecDeque,
    path::Path,
    time::{Duration, Instant},
};

/// The table of a trial, in its record.
const LATENCY_FILE: &str = "latency.json";
/// Longest time that is told apart from longer ones, ns.
const MAX_LATENCY_NS: u64 = 60_000_000_000;
/// Slower than this, arm and hand are at rest, rad/s.
const REST_SPEED_RAD_PER_S: f64 = 0.02;
/// Faster than this, a joint moves, rad/s.
const MOTION_SPEED_RAD_PER_S: f64 = 0.05;
/// A gesture that moves nothing for so long, such as one that asks for the next joint, moved nothing.
const MOTION_TIMEOUT_MS: u64 = 2000;
/// Motions whose pictures are waited for.
const MAX_PENDING_FRAMES: usize = 16;

const STAGES: [LatencyStage; 15] = [
    LatencyStage::Recognition,
    LatencyStage::Queue,
    LatencyStage::Emg,
    LatencyStage::Intent,
    LatencyStage::Method,
    LatencyStage::Actuation,
    LatencyStage::JointTarget,
    LatencyStage::World,
    LatencyStage::Task,
    LatencyStage::Tick,
    LatencyStage::Motion,
    LatencyStage::Frame,
    LatencyStage::Network,
    LatencyStage::Render,
    LatencyStage::EndToEnd,
];

/// What is known of a gesture on its way to a motion.
#[derive(Clone, Copy, Debug)]
struct GestureTiming {
    /// When the muscle changed; none where nobody knows.
    intended_at: Option<SimTime>,
    /// When the gesture came in force, and then when a joint moved.
    event_time: SimTime,
}

/// The stages of one tick, as they end.
#[derive(Debug)]
pub(crate) struct StageTimer {
    began: Instant,
    last: Instant,
    durations: ArrayVec<(LatencyStage, Duration), 6>,
}

impl StageTimer {
    /// A tick begins.
    pub(crate) fn start() -> Self {
        let now = Instant::now();
        Self { began: now, last: now, durations: ArrayVec::new() }
    }

    /// A stage has ended.
    pub(crate) fn stage_ended(&mut self, stage: StageName) {
        let row = match stage {
            StageName::Emg => LatencyStage::Emg,
            StageName::Intent => LatencyStage::Intent,
            StageName::Method => LatencyStage::Method,
            StageName::Actuation => LatencyStage::Actuation,
            StageName::World => LatencyStage::World,
            StageName::Task => LatencyStage::Task,
        };
        let now = Instant::now();
        self.durations.push((row, now - self.last));
        self.last = now;
    }

    /// All stages of the tick.
    pub(crate) fn total(&self) -> Duration {
        self.last - self.began
    }
}

/// The table of one trial.
pub(crate) struct LatencyTable {
    /// Nanoseconds, in the order of `STAGES`.
    times: Vec<Histogram<u64>>,
    /// What is made, and since when, until it is in force; then no time.
    intended: (Option<Command>, Option<SimTime>),
    in_force: Command,
    /// The fastest joint after the tick before, rad/s.
    fastest: f64,
    /// A gesture that has moved nothing yet.
    pending_gesture: Option<GestureTiming>,
    /// A motion that no frame has shown yet.
    pending_motion: Option<GestureTiming>,
    /// Frames on which a joint moved first, whose pictures are waited for.
    pending_frames: VecDeque<(SimTime, GestureTiming)>,
}

impl Default for LatencyTable {
    fn default() -> Self {
        let times = STAGES.map(|_| {
            // Three digits: a thousandth is more than a clock between two programs is worth.
            Histogram::new_with_bounds(1, MAX_LATENCY_NS, 3)
                .expect("bounds and digits are in the library's range")
        });
        Self {
            times: times.into(),
            intended: (None, None),
            in_force: Command::NoMotion,
            fastest: 0.0,
            pending_gesture: None,
            pending_motion: None,
            pending_frames: VecDeque::new(),
        }
    }
}

impl LatencyTable {
    /// One tick of `trial`, whose stages took what `clock` says.
    pub(crate) fn record_tick(&mut self, step: &TrialStep, trial: &RunningTrial, clock: &StageTimer) {
        for &(stage, took) in &clock.durations {
            self.record(stage, took);
        }
        self.record(LatencyStage::Tick, clock.total());
        if step.output.emg.is_some() {
            // Up to the stage that gives them.
            let stages = clock.durations.iter().take_while(|(stage, _)| *stage != LatencyStage::World);
            self.record(LatencyStage::JointTarget, stages.map(|(_, took)| *took).sum());
        }
        if !step.input.emg.is_empty()
            && let Some(waited) = trial.person_stage().oldest_sample_wait()
        {
            self.record(LatencyStage::Queue, waited);
        }
        let testbed = trial.testbed();
        let fastest =
            testbed.plant().state().velocity.iter().fold(0.0_f64, |max, speed| max.max(speed.abs()));
        self.track_gesture(step.time, trial.person_stage().intended_command(), testbed.command(), fastest);
        if step.frame.is_some()
            && let Some(moved) = self.pending_motion.take()
        {
            self.record(LatencyStage::Frame, elapsed(step.time, moved.event_time));
            if self.pending_frames.len() == MAX_PENDING_FRAMES {
                self.pending_frames.pop_front();
            }
            self.pending_frames.push_back((step.time, moved));
        }
    }

    /// From the muscle over the gesture in force to the first joint that moves; the fastest is at `fastest`, rad/s.
    fn track_gesture(&mut self, now: SimTime, intended: Option<Command>, in_force: Command, fastest: f64) {
        if intended != self.intended.0 {
            self.intended = (intended, Some(now));
        }
        if in_force != self.in_force {
            self.in_force = in_force;
            let muscle = self.intended.1.filter(|_| intended == Some(in_force));
            if let Some(muscle) = muscle {
                self.intended.1 = None;
                self.record(LatencyStage::Recognition, elapsed(now, muscle));
            }
            // The gesture may move a joint in the very tick that brings it.
            let begins = in_force != Command::NoMotion && self.fastest < REST_SPEED_RAD_PER_S;
            self.pending_gesture = begins.then_some(GestureTiming { intended_at: muscle, event_time: now });
        }
        if let Some(waiting) = self.pending_gesture {
            if fastest > MOTION_SPEED_RAD_PER_S {
                self.record(LatencyStage::Motion, elapsed(now, waiting.event_time));
                self.pending_motion = Some(GestureTiming { event_time: now, ..waiting });
            }
            if fastest > MOTION_SPEED_RAD_PER_S || now.millis_since(waiting.event_time) > MOTION_TIMEOUT_MS {
                self.pending_gesture = None;
            }
        }
        self.fastest = fastest;
    }

    /// Frames were on a screen.
    pub(crate) fn record_picture_ages(&mut self, ages: &[FrameLatency]) {
        for age in ages {
            self.record(LatencyStage::Network, age.network);
            self.record(LatencyStage::Render, age.render);
            let Some(index) = self.pending_frames.iter().position(|(frame, _)| *frame == age.time) else {
                continue;
            };
            let Some((_, moved)) = self.pending_frames.remove(index) else { continue };
            if let Some(muscle) = moved.intended_at {
                self.record(LatencyStage::EndToEnd, elapsed(age.time, muscle) + age.network + age.render);
            }
        }
    }

    /// The table so far.
    pub(crate) fn rows(&self) -> Vec<LatencyRow> {
        let measured = STAGES.iter().zip(&self.times).filter(|(_, times)| !times.is_empty());
        measured
            .map(|(&stage, times)| {
                let ms = |ns: u64| ns as f64 / 1e6;
                LatencyRow {
                    stage,
                    count: times.len(),
                    median_ms: ms(times.value_at_quantile(0.5)),
                    p99_ms: ms(times.value_at_quantile(0.99)),
                    worst_ms: ms(times.max()),
                }
            })
            .collect()
    }

    /// Keeps the table with the record in `dir`, before it is closed.
    ///
    /// # Errors
    /// What the disk refuses.
    pub(crate) fn save(&self, dir: &Path) -> Result<(), String> {
        #[derive(Serialize)]
        struct LatencyFile {
            stages: Vec<LatencyRow>,
        }
        let text = proact_types::to_json_pretty(&LatencyFile { stages: self.rows() });
        let text = text.map_err(|error| format!("cannot write {LATENCY_FILE}: {error}"))?;
        Ok(write_atomically(&dir.join(LATENCY_FILE), format!("{text}\n"))?)
    }

    fn record(&mut self, stage: LatencyStage, took: Duration) {
        let ns = u64::try_from(took.as_nanos()).unwrap_or(MAX_LATENCY_NS);
        if let Some(index) = STAGES.iter().position(|known| *known == stage) {
            self.times[index].saturating_record(ns);
        }
    }
}

/// Trial time from `earlier` to `later`.
fn elapsed(later: SimTime, earlier: SimTime) -> Duration {
    Duration::from_millis(later.millis_since(earlier))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(latency: &LatencyTable, stage: LatencyStage) -> Option<(u64, f64)> {
        latency
            .rows()
            .into_iter()
            .find(|row| row.stage == stage)
            .map(|row| (row.count, row.median_ms.round()))
    }

    #[test]
    fn a_gesture_is_followed_from_the_muscle_to_the_light() {
        let mut latency = LatencyTable::default();
        let close = Command::HandClose;
        let mut follow = |from: u64, to: u64, intended, in_force, speed| {
            for now in from..to {
                latency.track_gesture(SimTime(now), Some(intended), in_force, speed);
            }
        };
        follow(1, 100, Command::NoMotion, Command::NoMotion, 0.0);
        // Made at 100, in force at 250, moves at 260.
        follow(100, 250, close, Command::NoMotion, 0.0);
        follow(250, 260, close, close, 0.03);
        follow(260, 270, close, close, 0.5);
        assert_eq!(row(&latency, LatencyStage::Recognition), Some((1, 150.0)));
        assert_eq!(row(&latency, LatencyStage::Motion), Some((1, 10.0)));
        let moved = latency.pending_motion.take().unwrap();
        assert_eq!((moved.event_time, moved.intended_at), (SimTime(260), Some(SimTime(100))));

        latency.pending_frames.push_back((SimTime(267), moved));
        let ms = Duration::from_millis;
        let age = |time| FrameLatency { time: SimTime(time), network: ms(3), render: ms(40) };
        latency.record_picture_ages(&[age(250), age(267), age(283)]);
        assert_eq!(row(&latency, LatencyStage::Network), Some((3, 3.0)));
        assert_eq!(row(&latency, LatencyStage::EndToEnd), Some((1, 210.0)));
        latency.record_picture_ages(&[age(267)]);
        assert_eq!(
            row(&latency, LatencyStage::EndToEnd).unwrap().0,
            1,
            "one picture of a motion is the first"
        );
    }

    #[test]
    fn what_begins_no_motion_is_no_motion() {
        let mut latency = LatencyTable::default();
        let mut at = |now, intended, in_force, speed| {
            latency.track_gesture(SimTime(now), intended, in_force, speed);
        };
        // The arm moves already; then a gesture that moves nothing; then one that a person made, whose muscle nobody knows.
        at(9, None, Command::NoMotion, 0.5);
        at(10, None, Command::HandOpen, 0.5);
        at(20, None, Command::NoMotion, 0.0);
        at(30, None, Command::WristFlexion, 0.0);
        at(30 + MOTION_TIMEOUT_MS + 1, None, Command::WristFlexion, 0.0);
        at(40 + MOTION_TIMEOUT_MS, None, Command::WristFlexion, 0.5);
        at(3000, None, Command::NoMotion, 0.0);
        at(3010, None, Command::HandClose, 0.0);
        at(3020, None, Command::HandClose, 0.5);
        assert_eq!(row(&latency, LatencyStage::Recognition), None);
        assert_eq!(row(&latency, LatencyStage::Motion), Some((1, 10.0)));
        // A wrong class in between is not what was made.
        let mut latency = LatencyTable::default();
        let mut at =
            |now, intended, in_force| latency.track_gesture(SimTime(now), Some(intended), in_force, 0.0);
        at(1, Command::NoMotion, Command::NoMotion);
        at(10, Command::HandClose, Command::NoMotion);
        at(100, Command::HandClose, Command::WristFlexion);
        at(160, Command::HandClose, Command::HandClose);
        assert_eq!(row(&latency, LatencyStage::Recognition), Some((1, 150.0)));
    }
}
