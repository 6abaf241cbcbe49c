//! Trials made of doubles, and a person who does what a test says.
#![allow(dead_code)] // Each test program uses its part.

use proact_participants::Participant;
use proact_testbed::{
    PersonParts, RunningTrial, Setup, SpanDigest, Testbed, TestbedError, TestbedParts, TrialConfig,
    TrialStep,
    doubles::{self, ScriptedGaze},
    replay,
};
use proact_types::{Command, DisplayFrame, Event, EventKind, Intention, SimTime, TickInput, TrunkPosture};
use std::error::Error;

pub type Outcome<T = ()> = Result<T, Box<dyn Error>>;

/// A trial of `method` before a shoulder that keeps still.
pub fn config(method: &str, limit_secs: f64) -> TrialConfig {
    let setup = Setup::named("still").expect("ships with the program");
    TrialConfig { limit_secs, ..TrialConfig::new(method, 1, setup) }
}

/// Somebody who stares at one block and makes the gestures of a script.
pub struct Starer {
    pub block: usize,
    /// From which millisecond on which gesture is made; ascending.
    pub script: Vec<(u64, Command)>,
}

impl Participant for Starer {
    fn step(&mut self, frame: &DisplayFrame) -> Intention {
        let eye = frame.world_from_head.translation.vector;
        let fixation_point = frame.objects[self.block].translation.vector;
        let made = self.script.iter().rev().find(|(from, _)| frame.time.0 >= *from);
        Intention {
            gesture: made.map_or(Command::NoMotion, |(_, command)| *command),
            gaze_direction: (fixation_point - eye).normalize(),
            eyes_open: true,
            trunk: TrunkPosture::default(),
            limb: None,
        }
    }
}

/// A trial of `config` in which a [`Starer`] at block 0 follows `script`, measured by `gaze`.
pub fn stare(config: TrialConfig, script: Vec<(u64, Command)>, gaze: ScriptedGaze) -> Outcome<RunningTrial> {
    let parts = doubles::testbed_parts(&config);
    stare_with(config, parts, script, gaze)
}

/// [`stare`] with other parts.
pub fn stare_with(
    config: TrialConfig,
    parts: TestbedParts,
    script: Vec<(u64, Command)>,
    gaze: ScriptedGaze,
) -> Outcome<RunningTrial> {
    let person = PersonParts {
        participant: Some(Box::new(Starer { block: 0, script })),
        emg: None,
        gaze: Some(Box::new(gaze)),
    };
    Ok(RunningTrial::new(Testbed::new(config, parts)?, person))
}

/// What happened in a trial.
#[derive(Default)]
pub struct Run {
    pub inputs: Vec<(SimTime, TickInput)>,
    pub spans: Vec<SpanDigest>,
    pub events: Vec<Event>,
    /// The block that was highlighted, frame by frame.
    pub highlights: Vec<(SimTime, Option<usize>)>,
    /// The first arm joint after each tick, rad.
    pub shoulder: Vec<f64>,
}

impl Run {
    /// Runs `trial` for `ticks`, or to its end.
    pub fn of(trial: &mut RunningTrial, ticks: u64) -> Outcome<Self> {
        let mut run = Self::default();
        for tick in 1..=ticks {
            let TrialStep { time, input, output, frame } = trial.step(tick == ticks)?;
            run.inputs.push((time, *input));
            run.spans.extend(output.span_digest);
            run.events.extend(output.events);
            run.highlights
                .extend(frame.map(|frame| (time, frame.target.object.map(|object| object.index()))));
            run.shoulder.push(trial.testbed().plant().state().position[0]);
            if output.finished {
                break;
            }
        }
        Ok(run)
    }

    /// When the events that `wanted` takes happened.
    pub fn times(&self, wanted: impl Fn(&EventKind) -> bool) -> Vec<u64> {
        self.events.iter().filter(|event| wanted(&event.kind)).map(|event| event.time.0).collect()
    }

    /// How far the first arm joint turned in the ticks after `from` up to `to`, rad.
    pub fn turned(&self, from: u64, to: u64) -> f64 {
        let of = &self.shoulder[from as usize - 1..to as usize];
        of.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum()
    }

    /// The first frame after tick `from` in which block `block`, or nothing, is highlighted.
    pub fn highlighted(&self, from: u64, block: Option<usize>) -> Option<u64> {
        self.highlights.iter().find(|(time, shown)| time.0 > from && *shown == block).map(|(time, _)| time.0)
    }
}

/// The spans of `inputs`, replayed with `config` on fresh doubles, with plans from the log alone.
pub fn replayed(
    config: &TrialConfig,
    inputs: &[(SimTime, TickInput)],
) -> Result<Vec<SpanDigest>, TestbedError> {
    let parts =
        TestbedParts { plans: Box::new(proact_testbed::LoggedPlans), ..doubles::testbed_parts(config) };
    let mut testbed = Testbed::new(config.clone(), parts)?;
    let last = inputs.last().map_or(SimTime(0), |(time, _)| *time);
    replay(&mut testbed, inputs.iter().cloned().map(Ok::<_, TestbedError>), last)
}
