//! `proact bench safety`: how long the arm goes on after a source dies, source by source and death by death.
//!
//! Each case is a trial with the real receiver and a real connection on this machine, in lock-step: a tick waits for what
//! the device sent to have arrived. So the times are ticks, and the same on any machine.

mod armband;
mod trackers;
mod websocket_sources;

use crate::{BenchFigure, BenchReport};
use proact_testbed::RunningTrial;
use proact_types::{Command, EventKind, InputSource, SimTime, StopCause};
use std::{
    error::Error,
    time::{Duration, Instant},
};

type Outcome<T> = Result<T, Box<dyn Error>>;

/// A joint slower than this is at rest, rad/s.
const REST_SPEED_RAD_PER_S: f64 = 0.01;
/// A joint faster than this moves, rad/s.
const MOVING_SPEED_RAD_PER_S: f64 = 0.1;
/// A joint that is as near as this to where it was has stayed there, rad: 0.4 rad/s for 600 ms would be 0.24.
const MAX_DRIFT_RAD: f64 = 0.01;
/// How long the hand is relaxed at the start, and how long the arm moves before the source dies, ms.
const RELAXED_MS: u64 = 600;
const MOVING_MS: u64 = 300;
/// How long it is looked at after the time in which the arm must be at rest, ms.
const OBSERVATION_MS: u64 = 400;
/// A source whose messages have not arrived after this time, by the clock on the wall, never sends them.
const DELIVERY_TIMEOUT: Duration = Duration::from_secs(20);

/// A way to die.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FailureMode {
    /// It says nothing any more; the connection stays.
    Silent,
    /// It ends the connection as the protocol has it.
    Closed,
    /// Its program is killed: the connection breaks.
    Killed,
    /// What comes is no message of the protocol.
    Garbage,
    /// The last value comes for ever.
    Constant,
    /// The last packet comes for ever.
    Repeated,
    /// Zeros come.
    Zeros,
    /// One channel stands still.
    Flat,
    /// One channel jumps between the ends of its range.
    Railed,
    /// Every second packet is lost.
    HalfLost,
    /// Packets come half as often.
    HalfRate,
    /// It measures, but the eye is lost.
    Blank,
}

impl FailureMode {
    fn name(self) -> &'static str {
        match self {
            FailureMode::Silent => "silent",
            FailureMode::Closed => "closed",
            FailureMode::Killed => "killed",
            FailureMode::Garbage => "garbage",
            FailureMode::Constant => "constant",
            FailureMode::Repeated => "repeated packet",
            FailureMode::Zeros => "zeros",
            FailureMode::Flat => "one channel flat",
            FailureMode::Railed => "one channel railed",
            FailureMode::HalfLost => "half lost",
            FailureMode::HalfRate => "half the rate",
            FailureMode::Blank => "eye lost",
        }
    }
}

/// What is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StopCase {
    /// As it is called in the report.
    pub device: &'static str,
    /// Who dies.
    pub source: InputSource,
    /// How.
    pub failure: FailureMode,
    /// The promise: from the first bad or missing value to the arm at rest, ms.
    pub limit_ms: u64,
}

/// What was found.
#[derive(Clone, Debug, PartialEq)]
pub struct StopTime {
    /// From the first bad or missing value to the arm at rest, ms.
    pub rest_ms: u64,
    /// From there to the event that names the source, ms.
    pub detection_ms: u64,
    /// What the event says.
    pub cause: StopCause,
    /// As shown.
    pub reason: String,
    /// The arm stayed at rest when the source came back with the gesture still held.
    pub stays_at_rest: bool,
    /// It moved again after the hand was relaxed and the gesture made anew.
    pub moves_again: bool,
}

/// A source under test.
trait FailingSource {
    /// What it sends in the tick that follows, arrived and handed to the session. `command`: what the person makes.
    fn send_tick(
        &mut self,
        trial: &mut RunningTrial,
        tick: u64,
        command: Command,
        lives: bool,
    ) -> Outcome<()>;

    /// The tick of the first value that was bad or missing.
    fn first_bad_tick(&self) -> Option<u64>;
}

/// Every case.
pub fn cases() -> Vec<StopCase> {
    use FailureMode::{
        Blank, Closed, Constant, Flat, Garbage, HalfLost, HalfRate, Killed, Railed, Repeated, Silent, Zeros,
    };
    let of = |device, source, limit_ms, deaths: &[FailureMode]| -> Vec<StopCase> {
        deaths.iter().map(|&death| StopCase { device, source, failure: death, limit_ms }).collect()
    };
    let every =
        [Silent, Closed, Killed, Garbage, Constant, Repeated, Zeros, Flat, Railed, HalfLost, HalfRate];
    let links = [Silent, Closed, Killed, Garbage];
    // An eye has the profile's second, and the arm the time to stop.
    let eye = 1000 + 250;
    [
        of("armband gForce, TCP", InputSource::Armband, 250, &every),
        of("page, WebSocket", InputSource::Page, 250, &links),
        of("/emg, rosbridge", InputSource::GestureTopic, 250, &links),
        of("eye tracker, UDP", InputSource::EyeTracker, eye, &[Silent, Garbage, Constant, Zeros, Blank]),
        of("limb tracker, UDP", InputSource::LimbTracker, 250, &[Silent, Garbage, Constant]),
        of("shoulder, rosbridge", InputSource::ShoulderTracker, 250, &[Silent, Closed, Garbage, Constant]),
    ]
    .concat()
}

/// Runs one case.
///
/// # Errors
/// A trial that cannot be set up, an arm that does not move or does not stop, a connection that brings nothing.
pub fn measure(case: StopCase) -> Outcome<StopTime> {
    let (mut trial, mut device) = match case.source {
        InputSource::Armband => armband::device(case.failure)?,
        InputSource::Page | InputSource::GestureTopic => {
            websocket_sources::device(case.source, case.failure)?
        }
        _ => trackers::device(case.source, case.failure)?,
    };
    let mut run = SafetyRun { trial: &mut trial, source: device.as_mut(), tick: 0, stop_events: Vec::new() };
    run.advance(RELAXED_MS, Command::NoMotion, true)?;
    let mut waited = 0;
    while run.advance(1, Command::WristExtension, true)?.max_speed_rad_per_s < MOVING_SPEED_RAD_PER_S {
        waited += 1;
        if waited > 5000 {
            return Err(format!("{case:?}: the arm does not move").into());
        }
    }
    let before = run.advance(MOVING_MS, Command::WristExtension, true)?;
    if let Some((tick, _)) = run.stop_events.first() {
        return Err(format!(
            "{case:?}: stopped at {} ms, before anything died: {:?}",
            tick.0, run.stop_events
        )
        .into());
    }
    let dying = run.advance(case.limit_ms + OBSERVATION_MS, Command::WristExtension, false)?;
    let first_bad = run.source.first_bad_tick().ok_or("nothing has died")?;
    let last_moving = dying.last_moving_tick.or(before.last_moving_tick).unwrap_or(first_bad);
    let Some((noticed, EventKind::Stopped { source, cause, reason })) = run.stop_events.first().cloned()
    else {
        return Err(format!("{case:?}: nothing was told").into());
    };
    if source != case.source {
        return Err(format!("{case:?}: {source} was named").into());
    }
    // By angles, not by speeds: a shoulder that is seen again moves the base, and that shakes the joints for a moment.
    let at = run.angles();
    run.advance(600, Command::WristExtension, true)?;
    let stays = run.angles().iter().zip(&at).all(|(now, then)| (now - then).abs() < MAX_DRIFT_RAD);
    run.advance(RELAXED_MS, Command::NoMotion, true)?;
    let again = run.advance(3000, Command::WristExtension, true)?;
    Ok(StopTime {
        rest_ms: (last_moving + 1).saturating_sub(first_bad),
        detection_ms: noticed.0.saturating_sub(first_bad),
        cause,
        reason,
        stays_at_rest: stays,
        moves_again: again.max_speed_rad_per_s > MOVING_SPEED_RAD_PER_S,
    })
}

/// Every case as figures.
///
/// # Errors
/// The first case that could not be run.
pub(crate) fn safety() -> Outcome<BenchReport> {
    let cases = cases();
    let bar = indicatif::ProgressBar::new(cases.len() as u64);
    let mut figures = Vec::new();
    for case in cases {
        let found = measure(case)?;
        let name = format!("{}: {}", case.device, case.failure.name());
        let note = format!("at most {} ms; {}", case.limit_ms, found.reason);
        figures.push(BenchFigure::without_peer(&name, found.rest_ms as f64, "ms", &note));
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(BenchReport::new("safety", figures))
}

struct SafetyRun<'a> {
    trial: &'a mut RunningTrial,
    source: &'a mut dyn FailingSource,
    tick: u64,
    /// Stops, with their time.
    stop_events: Vec<(SimTime, EventKind)>,
}

/// What the arm did.
struct Motion {
    last_moving_tick: Option<u64>,
    max_speed_rad_per_s: f64,
}

impl SafetyRun<'_> {
    fn angles(&self) -> Vec<f64> {
        let testbed = self.trial.testbed();
        testbed.plant().state().position[..testbed.model().arm_count()].to_vec()
    }

    fn advance(&mut self, ticks: u64, command: Command, lives: bool) -> Outcome<Motion> {
        let mut motion = Motion { last_moving_tick: None, max_speed_rad_per_s: 0.0 };
        for _ in 0..ticks {
            self.tick += 1;
            self.source.send_tick(self.trial, self.tick, command, lives)?;
            let step = self.trial.step(false)?;
            let stops = step
                .output
                .events
                .into_iter()
                .filter(|event| matches!(event.kind, EventKind::Stopped { .. }));
            self.stop_events.extend(stops.map(|event| (event.time, event.kind)));
            let testbed = self.trial.testbed();
            let arm = testbed.model().arm_count();
            let speeds = &testbed.plant().state().velocity[..arm];
            let speed = speeds.iter().fold(0.0_f64, |max, v| max.max(v.abs()));
            motion.max_speed_rad_per_s = motion.max_speed_rad_per_s.max(speed);
            if speed >= REST_SPEED_RAD_PER_S {
                motion.last_moving_tick = Some(self.tick);
            }
        }
        Ok(motion)
    }
}

/// Asks until the answer is yes.
fn wait_for(what: &str, mut came: impl FnMut() -> Outcome<bool>) -> Outcome<()> {
    let begin = Instant::now();
    while !came()? {
        if begin.elapsed() > DELIVERY_TIMEOUT {
            return Err(format!("{what} did not arrive within {} s", DELIVERY_TIMEOUT.as_secs()).into());
        }
        std::thread::sleep(Duration::from_micros(50));
    }
    Ok(())
}
