//! How long the way from a muscle to the light of a screen takes, stage by stage, in a trial that runs in real time.
//!
//! Wall clock where computers are waited for, trial time where the trial itself takes it: in real time the two pass alike. What
//! a person's own muscles do, nobody knows; the rows that begin with a muscle are those of simulated people.

use arrayvec::ArrayVec;
use hdrhistogram::Histogram;
use proact_bridge::{LatencyRow, LatencyStage, PictureAge};
use proact_files::write_whole;
use proact_testbed::{Session, Step, stages::StageName};
use proact_types::{Gesture, SimTime};
use serde::Serialize;
use std::{
    collections::VecDeque,
    path::Path,
    time::{Duration, Instant},
};

/// The table of a trial, in its record.
const LATENCY_FILE: &str = "latency.json";
/// Longest time that is told apart from longer ones, ns.
const LONGEST_NS: u64 = 60_000_000_000;
/// Slower than this, arm and hand are at rest, rad/s.
const AT_REST: f64 = 0.02;
/// Faster than this, a joint moves, rad/s.
const MOVES: f64 = 0.05;
/// A gesture that moves nothing for so long, such as one that asks for the next joint, moved nothing.
const MOVES_WITHIN_MS: u64 = 2000;
/// Motions whose pictures are waited for.
const MOST_SHOWN: usize = 16;

const STAGES: [LatencyStage; 15] = [
    LatencyStage::Recognition,
    LatencyStage::Queue,
    LatencyStage::Emg,
    LatencyStage::Intent,
    LatencyStage::Method,
    LatencyStage::Actuation,
    LatencyStage::Target,
    LatencyStage::World,
    LatencyStage::Task,
    LatencyStage::Tick,
    LatencyStage::Motion,
    LatencyStage::Frame,
    LatencyStage::Line,
    LatencyStage::Picture,
    LatencyStage::Whole,
];

/// What is known of a gesture on its way to a motion.
#[derive(Clone, Copy, Debug)]
struct Gestured {
    /// When the muscle changed; none where nobody knows.
    muscle: Option<SimTime>,
    /// When the gesture came in force, and then when a joint moved.
    at: SimTime,
}

/// The stages of one tick, as they end.
#[derive(Debug)]
pub(crate) struct StageClock {
    began: Instant,
    last: Instant,
    took: ArrayVec<(LatencyStage, Duration), 6>,
}

impl StageClock {
    /// A tick begins.
    pub(crate) fn start() -> Self {
        let now = Instant::now();
        Self { began: now, last: now, took: ArrayVec::new() }
    }

    /// A stage has ended.
    pub(crate) fn done(&mut self, stage: StageName) {
        let row = match stage {
            StageName::Emg => LatencyStage::Emg,
            StageName::Intent => LatencyStage::Intent,
            StageName::Method => LatencyStage::Method,
            StageName::Actuation => LatencyStage::Actuation,
            StageName::World => LatencyStage::World,
            StageName::Task => LatencyStage::Task,
        };
        let now = Instant::now();
        self.took.push((row, now - self.last));
        self.last = now;
    }

    /// All stages of the tick.
    pub(crate) fn took(&self) -> Duration {
        self.last - self.began
    }
}

/// The table of one trial.
pub(crate) struct Latency {
    /// Nanoseconds, in the order of `STAGES`.
    times: Vec<Histogram<u64>>,
    /// What is made, and since when, until it is in force; then no time.
    intended: (Option<Gesture>, Option<SimTime>),
    in_force: Gesture,
    /// The fastest joint after the tick before, rad/s.
    fastest: f64,
    /// A gesture that has moved nothing yet.
    waiting: Option<Gestured>,
    /// A motion that no frame has shown yet.
    moved: Option<Gestured>,
    /// Frames on which a joint moved first, whose pictures are waited for.
    shown: VecDeque<(SimTime, Gestured)>,
}

impl Default for Latency {
    fn default() -> Self {
        let times = STAGES.map(|_| {
            // Three digits: a thousandth is more than a clock between two programs is worth.
            Histogram::new_with_bounds(1, LONGEST_NS, 3)
                .expect("bounds and digits are in the library's range")
        });
        Self {
            times: times.into(),
            intended: (None, None),
            in_force: Gesture::NoMotion,
            fastest: 0.0,
            waiting: None,
            moved: None,
            shown: VecDeque::new(),
        }
    }
}

impl Latency {
    /// One tick of `session`, whose stages took what `clock` says.
    pub(crate) fn take(&mut self, step: &Step, session: &Session, clock: &StageClock) {
        for &(stage, took) in &clock.took {
            self.note(stage, took);
        }
        self.note(LatencyStage::Tick, clock.took());
        if step.output.emg.is_some() {
            // Up to the stage that gives them.
            let stages = clock.took.iter().take_while(|(stage, _)| *stage != LatencyStage::World);
            self.note(LatencyStage::Target, stages.map(|(_, took)| *took).sum());
        }
        if !step.input.emg.is_empty()
            && let Some(waited) = session.who().waited()
        {
            self.note(LatencyStage::Queue, waited);
        }
        let testbed = session.testbed();
        let fastest =
            testbed.plant().state().velocity.iter().fold(0.0_f64, |most, speed| most.max(speed.abs()));
        self.follow(step.time, session.who().intended(), testbed.gesture(), fastest);
        if step.frame.is_some()
            && let Some(moved) = self.moved.take()
        {
            self.note(LatencyStage::Frame, span(step.time, moved.at));
            if self.shown.len() == MOST_SHOWN {
                self.shown.pop_front();
            }
            self.shown.push_back((step.time, moved));
        }
    }

    /// From the muscle over the gesture in force to the first joint that moves; the fastest is at `fastest`, rad/s.
    fn follow(&mut self, now: SimTime, intended: Option<Gesture>, in_force: Gesture, fastest: f64) {
        if intended != self.intended.0 {
            self.intended = (intended, Some(now));
        }
        if in_force != self.in_force {
            self.in_force = in_force;
            let muscle = self.intended.1.filter(|_| intended == Some(in_force));
            if let Some(muscle) = muscle {
                self.intended.1 = None;
                self.note(LatencyStage::Recognition, span(now, muscle));
            }
            // The gesture may move a joint in the very tick that brings it.
            let begins = in_force != Gesture::NoMotion && self.fastest < AT_REST;
            self.waiting = begins.then_some(Gestured { muscle, at: now });
        }
        if let Some(waiting) = self.waiting {
            if fastest > MOVES {
                self.note(LatencyStage::Motion, span(now, waiting.at));
                self.moved = Some(Gestured { at: now, ..waiting });
            }
            if fastest > MOVES || now.millis_since(waiting.at) > MOVES_WITHIN_MS {
                self.waiting = None;
            }
        }
        self.fastest = fastest;
    }

    /// Frames were on a screen.
    pub(crate) fn see(&mut self, ages: &[PictureAge]) {
        for age in ages {
            self.note(LatencyStage::Line, age.line);
            self.note(LatencyStage::Picture, age.page);
            let Some(place) = self.shown.iter().position(|(frame, _)| *frame == age.time) else { continue };
            let Some((_, moved)) = self.shown.remove(place) else { continue };
            if let Some(muscle) = moved.muscle {
                self.note(LatencyStage::Whole, span(age.time, muscle) + age.line + age.page);
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
    pub(crate) fn keep(&self, dir: &Path) -> Result<(), String> {
        #[derive(Serialize)]
        struct Table {
            stages: Vec<LatencyRow>,
        }
        let text = serde_json::to_string_pretty(&Table { stages: self.rows() });
        let text = text.map_err(|error| format!("cannot write {LATENCY_FILE}: {error}"))?;
        Ok(write_whole(&dir.join(LATENCY_FILE), format!("{text}\n"))?)
    }

    fn note(&mut self, stage: LatencyStage, took: Duration) {
        let ns = u64::try_from(took.as_nanos()).unwrap_or(LONGEST_NS);
        if let Some(place) = STAGES.iter().position(|known| *known == stage) {
            self.times[place].saturating_record(ns);
        }
    }
}

/// Trial time from `earlier` to `later`.
fn span(later: SimTime, earlier: SimTime) -> Duration {
    Duration::from_millis(later.millis_since(earlier))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(latency: &Latency, stage: LatencyStage) -> Option<(u64, f64)> {
        latency
            .rows()
            .into_iter()
            .find(|row| row.stage == stage)
            .map(|row| (row.count, row.median_ms.round()))
    }

    #[test]
    fn a_gesture_is_followed_from_the_muscle_to_the_light() {
        let mut latency = Latency::default();
        let close = Gesture::HandClose;
        let mut follow = |from: u64, to: u64, intended, in_force, speed| {
            for now in from..to {
                latency.follow(SimTime(now), Some(intended), in_force, speed);
            }
        };
        follow(1, 100, Gesture::NoMotion, Gesture::NoMotion, 0.0);
        // Made at 100, in force at 250, moves at 260.
        follow(100, 250, close, Gesture::NoMotion, 0.0);
        follow(250, 260, close, close, 0.03);
        follow(260, 270, close, close, 0.5);
        assert_eq!(row(&latency, LatencyStage::Recognition), Some((1, 150.0)));
        assert_eq!(row(&latency, LatencyStage::Motion), Some((1, 10.0)));
        let moved = latency.moved.take().unwrap();
        assert_eq!((moved.at, moved.muscle), (SimTime(260), Some(SimTime(100))));

        latency.shown.push_back((SimTime(267), moved));
        let ms = Duration::from_millis;
        let age = |time| PictureAge { time: SimTime(time), line: ms(3), page: ms(40) };
        latency.see(&[age(250), age(267), age(283)]);
        assert_eq!(row(&latency, LatencyStage::Line), Some((3, 3.0)));
        assert_eq!(row(&latency, LatencyStage::Whole), Some((1, 210.0)));
        latency.see(&[age(267)]);
        assert_eq!(row(&latency, LatencyStage::Whole).unwrap().0, 1, "one picture of a motion is the first");
    }

    #[test]
    fn what_begins_no_motion_is_no_motion() {
        let mut latency = Latency::default();
        let mut at = |now, intended, in_force, speed| {
            latency.follow(SimTime(now), intended, in_force, speed);
        };
        // The arm moves already; then a gesture that moves nothing; then one that a person made, whose muscle nobody knows.
        at(9, None, Gesture::NoMotion, 0.5);
        at(10, None, Gesture::HandOpen, 0.5);
        at(20, None, Gesture::NoMotion, 0.0);
        at(30, None, Gesture::WristFlexion, 0.0);
        at(30 + MOVES_WITHIN_MS + 1, None, Gesture::WristFlexion, 0.0);
        at(40 + MOVES_WITHIN_MS, None, Gesture::WristFlexion, 0.5);
        at(3000, None, Gesture::NoMotion, 0.0);
        at(3010, None, Gesture::HandClose, 0.0);
        at(3020, None, Gesture::HandClose, 0.5);
        assert_eq!(row(&latency, LatencyStage::Recognition), None);
        assert_eq!(row(&latency, LatencyStage::Motion), Some((1, 10.0)));
        // A wrong class in between is not what was made.
        let mut latency = Latency::default();
        let mut at = |now, intended, in_force| latency.follow(SimTime(now), Some(intended), in_force, 0.0);
        at(1, Gesture::NoMotion, Gesture::NoMotion);
        at(10, Gesture::HandClose, Gesture::NoMotion);
        at(100, Gesture::HandClose, Gesture::WristFlexion);
        at(160, Gesture::HandClose, Gesture::HandClose);
        assert_eq!(row(&latency, LatencyStage::Recognition), Some((1, 150.0)));
    }
}
