//! `proact bench safety`: how long the arm goes on after a source dies, source by source and death by death.
//!
//! Each case is a trial with the real receiver and a real connection on this machine, in lock-step: a tick waits for what
//! the device sent to have arrived. So the times are ticks, and the same on any machine.

mod armband;
mod links;
mod trackers;

use crate::{BenchFigure, BenchReport};
use proact_testbed::Session;
use proact_types::{EventKind, Gesture, InputSource, SimTime, StopCause};
use std::{
    error::Error,
    time::{Duration, Instant},
};

type Outcome<T> = Result<T, Box<dyn Error>>;

/// A joint slower than this is at rest, rad/s.
const AT_REST: f64 = 0.01;
/// A joint faster than this moves, rad/s.
const MOVES: f64 = 0.1;
/// A joint that is as near as this to where it was has stayed there, rad: 0.4 rad/s for 600 ms would be 0.24.
const STAYS: f64 = 0.01;
/// How long the hand is relaxed at the start, and how long the arm moves before the source dies, ms.
const RELAXED_MS: u64 = 600;
const MOVING_MS: u64 = 300;
/// How long it is looked at after the time in which the arm must be at rest, ms.
const AFTER_MS: u64 = 400;
/// A source whose messages have not arrived after this time, by the clock on the wall, never sends them.
const PATIENCE: Duration = Duration::from_secs(20);

/// A way to die.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Death {
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

impl Death {
    fn name(self) -> &'static str {
        match self {
            Death::Silent => "silent",
            Death::Closed => "closed",
            Death::Killed => "killed",
            Death::Garbage => "garbage",
            Death::Constant => "constant",
            Death::Repeated => "repeated packet",
            Death::Zeros => "zeros",
            Death::Flat => "one channel flat",
            Death::Railed => "one channel railed",
            Death::HalfLost => "half lost",
            Death::HalfRate => "half the rate",
            Death::Blank => "eye lost",
        }
    }
}

/// What is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Case {
    /// As it is called in the report.
    pub device: &'static str,
    /// Who dies.
    pub source: InputSource,
    /// How.
    pub death: Death,
    /// The promise: from the first bad or missing value to the arm at rest, ms.
    pub limit_ms: u64,
}

/// What was found.
#[derive(Clone, Debug, PartialEq)]
pub struct StopTime {
    /// From the first bad or missing value to the arm at rest, ms.
    pub rest_ms: u64,
    /// From there to the event that names the source, ms.
    pub noticed_ms: u64,
    /// What the event says.
    pub cause: StopCause,
    /// As shown.
    pub reason: String,
    /// The arm stayed at rest when the source came back with the gesture still held.
    pub stays: bool,
    /// It moved again after the hand was relaxed and the gesture made anew.
    pub goes_on: bool,
}

/// A source under test.
trait Device {
    /// What it sends in the tick that follows, arrived and handed to the session. `gesture`: what the person makes.
    fn feed(&mut self, session: &mut Session, tick: u64, gesture: Gesture, lives: bool) -> Outcome<()>;

    /// The tick of the first value that was bad or missing.
    fn first_bad(&self) -> Option<u64>;
}

/// Every case.
pub fn cases() -> Vec<Case> {
    use Death::{
        Blank, Closed, Constant, Flat, Garbage, HalfLost, HalfRate, Killed, Railed, Repeated, Silent, Zeros,
    };
    let of = |device, source, limit_ms, deaths: &[Death]| -> Vec<Case> {
        deaths.iter().map(|&death| Case { device, source, death, limit_ms }).collect()
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
pub fn measure(case: Case) -> Outcome<StopTime> {
    let (mut session, mut device) = match case.source {
        InputSource::Armband => armband::device(case.death)?,
        InputSource::Page | InputSource::GestureTopic => links::device(case.source, case.death)?,
        _ => trackers::device(case.source, case.death)?,
    };
    let mut run = Run { session: &mut session, device: device.as_mut(), tick: 0, told: Vec::new() };
    run.go(RELAXED_MS, Gesture::NoMotion, true)?;
    let mut waited = 0;
    while run.go(1, Gesture::WristExtension, true)?.most_speed < MOVES {
        waited += 1;
        if waited > 5000 {
            return Err(format!("{case:?}: the arm does not move").into());
        }
    }
    let before = run.go(MOVING_MS, Gesture::WristExtension, true)?;
    if let Some((tick, _)) = run.told.first() {
        return Err(
            format!("{case:?}: stopped at {} ms, before anything died: {:?}", tick.0, run.told).into()
        );
    }
    let dying = run.go(case.limit_ms + AFTER_MS, Gesture::WristExtension, false)?;
    let first_bad = run.device.first_bad().ok_or("nothing has died")?;
    let last_moving = dying.last_moving.or(before.last_moving).unwrap_or(first_bad);
    let Some((noticed, EventKind::Stopped { source, cause, reason })) = run.told.first().cloned() else {
        return Err(format!("{case:?}: nothing was told").into());
    };
    if source != case.source {
        return Err(format!("{case:?}: {source} was named").into());
    }
    // By angles, not by speeds: a shoulder that is seen again moves the base, and that shakes the joints for a moment.
    let at = run.angles();
    run.go(600, Gesture::WristExtension, true)?;
    let stays = run.angles().iter().zip(&at).all(|(now, then)| (now - then).abs() < STAYS);
    run.go(RELAXED_MS, Gesture::NoMotion, true)?;
    let again = run.go(3000, Gesture::WristExtension, true)?;
    Ok(StopTime {
        rest_ms: (last_moving + 1).saturating_sub(first_bad),
        noticed_ms: noticed.0.saturating_sub(first_bad),
        cause,
        reason,
        stays,
        goes_on: again.most_speed > MOVES,
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
        let name = format!("{}: {}", case.device, case.death.name());
        let note = format!("at most {} ms; {}", case.limit_ms, found.reason);
        figures.push(BenchFigure::alone(&name, found.rest_ms as f64, "ms", &note));
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(BenchReport::new("safety", figures))
}

struct Run<'a> {
    session: &'a mut Session,
    device: &'a mut dyn Device,
    tick: u64,
    /// Stops, with their time.
    told: Vec<(SimTime, EventKind)>,
}

/// What the arm did.
struct Motion {
    last_moving: Option<u64>,
    most_speed: f64,
}

impl Run<'_> {
    fn angles(&self) -> Vec<f64> {
        let testbed = self.session.testbed();
        testbed.plant().state().position[..testbed.model().arm_count()].to_vec()
    }

    fn go(&mut self, ticks: u64, gesture: Gesture, lives: bool) -> Outcome<Motion> {
        let mut motion = Motion { last_moving: None, most_speed: 0.0 };
        for _ in 0..ticks {
            self.tick += 1;
            self.device.feed(self.session, self.tick, gesture, lives)?;
            let step = self.session.step(false)?;
            let stops = step
                .output
                .events
                .into_iter()
                .filter(|event| matches!(event.kind, EventKind::Stopped { .. }));
            self.told.extend(stops.map(|event| (event.time, event.kind)));
            let testbed = self.session.testbed();
            let arm = testbed.model().arm_count();
            let speeds = &testbed.plant().state().velocity[..arm];
            let speed = speeds.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
            motion.most_speed = motion.most_speed.max(speed);
            if speed >= AT_REST {
                motion.last_moving = Some(self.tick);
            }
        }
        Ok(motion)
    }
}

/// Asks until the answer is yes.
fn wait_for(what: &str, mut came: impl FnMut() -> Outcome<bool>) -> Outcome<()> {
    let begin = Instant::now();
    while !came()? {
        if begin.elapsed() > PATIENCE {
            return Err(format!("{what} did not arrive within {} s", PATIENCE.as_secs()).into());
        }
        std::thread::sleep(Duration::from_micros(50));
    }
    Ok(())
}
