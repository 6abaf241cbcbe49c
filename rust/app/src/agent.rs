//! A trial that a program drives step by step, in the place of a person or of a control method: actions in, observations and
//! rewards out. The environments of the Python package are this.
//!
//! Deterministic: configuration and actions decide every bit of a trial. What the program does enters as input, so that a
//! recorded trial is replayed without it.

mod action;
mod observation;
mod reward;

pub use action::{ActionError, ActionKind, ActionLevel};
pub use observation::ObservationKind;
pub use reward::RewardKind;

use crate::{
    Arm, Recorder, RecorderError,
    trial::{Assembly, AssemblyError, EmgInput, simulate_with},
};
use action::{ActionDecoder, is_control_tick};
use observation::ObservationWriter;
use proact_control::{JogProfile, JogSteps, MethodRegistry};
use proact_devices::EmgOrigin;
use proact_testbed::{ConfigError, RunningTrial, TestbedError, TrialConfig, TrialEnd, TrialResult};
use proact_types::{DisplayFrame, Event, SimTime};
use reward::RewardFunction;
use std::path::PathBuf;

/// Why a program cannot drive a trial, or not any further.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AgentError {
    /// It cannot be put together.
    #[error(transparent)]
    Assembly(#[from] AssemblyError),
    /// The configuration.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// An action that is none.
    #[error(transparent)]
    Action(#[from] ActionError),
    /// A tick failed.
    #[error(transparent)]
    Testbed(#[from] TestbedError),
    /// The record.
    #[error(transparent)]
    Recorder(#[from] RecorderError),
    /// The trial is over.
    #[error("the trial ended at {at_secs:.3} s; reset before the next step")]
    Ended {
        /// Simulated seconds.
        at_secs: f64,
    },
}

/// How a program drives a trial.
#[derive(Clone, Debug)]
pub struct AgentOptions {
    /// What an action is.
    pub action: ActionLevel,
    /// What is observed.
    pub observation: ObservationKind,
    /// What a step is worth.
    pub reward: RewardKind,
    /// Simulated time of a step, milliseconds, at least 1.
    pub period_ms: u64,
    /// Where the gestures of an agent that acts as a person pass through: none gives them directly, as keys do.
    pub emg: Option<EmgOrigin>,
    /// Root mean square error of the eye tracker, degrees.
    pub gaze_error_deg: f64,
    /// Where the trial is recorded; none records nothing.
    pub record: Option<PathBuf>,
}

/// What one step gave.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AgentStep {
    /// What it was worth.
    pub reward: f64,
    /// The task is done: what follows is worth nothing.
    pub terminated: bool,
    /// Time is up.
    pub truncated: bool,
}

/// A trial that a program drives.
pub struct AgentEnvironment {
    run: AgentLoop,
    observation_writer: ObservationWriter,
    reward: RewardFunction,
    period_ms: u64,
    /// The newest one.
    frame: DisplayFrame,
    dir: Option<PathBuf>,
}

/// What goes on from tick to tick.
struct AgentLoop {
    trial: RunningTrial,
    driver: ActionDecoder,
    recorder: Option<Recorder>,
    /// Of the last step.
    events: Vec<Event>,
    ended: bool,
}

impl AgentEnvironment {
    /// A trial as `config` says with `arm` and the `methods` that there are, at its first display frame. A level of action that
    /// stands in the place of a method replaces the method that `config` names.
    ///
    /// # Errors
    /// [`AgentError`]: a configuration that does not fit, a method that the level of action cannot drive.
    pub fn new(
        methods: &MethodRegistry,
        arm: &Arm,
        mut config: TrialConfig,
        options: &AgentOptions,
    ) -> Result<Self, AgentError> {
        if !(1..=1000).contains(&options.period_ms) {
            let (key, got) = ("period_ms", options.period_ms.to_string());
            return Err(ConfigError::Value { key, got, expected: "1 to 1000" }.into());
        }
        let (driver, own) = ActionDecoder::new(options.action, methods, arm.model(), &mut config)?;
        if options.emg.is_none() {
            // As for keys: a gesture that is given directly has no effort.
            if let JogProfile::Time { speed_steps: steps, .. } = &mut config.profile.jog {
                steps.get_or_insert(JogSteps::KEYS);
            }
            config.set_gesture_source("agent")?;
        }
        let emg = options.emg.as_ref().map(|origin| EmgInput { origin, trained: None });
        let assembly = simulate_with(methods, arm, config, emg, options.gaze_error_deg, own)?;
        let Assembly { trial, classifier, arm, plans, .. } = assembly;
        let recorder = match &options.record {
            Some(dir) => {
                let config = trial.testbed().config();
                Some(Recorder::create(dir, config, &arm, classifier.as_ref())?.with_plans(plans)?)
            }
            None => None,
        };
        let mut run = AgentLoop { trial, driver, recorder, events: Vec::new(), ended: false };
        // An agent sees what a person would: nothing before the first frame.
        let frame = loop {
            if let Some(frame) = run.tick(false)? {
                break frame;
            }
        };
        Ok(Self {
            observation_writer: ObservationWriter::new(options.observation, &run.trial, &frame),
            reward: RewardFunction::new(options.reward, &run.trial),
            period_ms: options.period_ms,
            frame,
            dir: options.record.clone(),
            run,
        })
    }

    /// Holds `action` for one period. Its numbers are those of [`AgentEnvironment::action_kind`].
    ///
    /// # Errors
    /// [`AgentError`]: a trial that is over, an action of another length, numbers that are not finite or out of range; a tick or
    /// the disk that fails.
    pub fn step(&mut self, action: &[f64]) -> Result<AgentStep, AgentError> {
        let run = &mut self.run;
        if run.ended {
            return Err(AgentError::Ended { at_secs: run.trial.testbed().now().as_secs() });
        }
        run.driver.apply_action(action)?;
        run.events.clear();
        for _ in 0..self.period_ms {
            if let Some(frame) = run.tick(false)? {
                self.frame = frame;
            }
            if run.ended {
                break;
            }
        }
        let reward = self.reward.step_reward(&run.trial);
        let testbed = run.trial.testbed();
        let out_of_time = testbed.now() >= SimTime::from_secs(testbed.config().limit_secs);
        let (terminated, truncated) = (run.ended && !out_of_time, run.ended && out_of_time);
        if run.ended {
            self.close_record(self.result().ended)?;
        }
        Ok(AgentStep { reward, terminated, truncated })
    }

    /// Ends the trial, if it has not ended, with one more tick, and closes its record; the result.
    ///
    /// # Errors
    /// A tick or the disk fails.
    pub fn close(&mut self) -> Result<TrialResult, AgentError> {
        if !self.run.ended {
            self.run.tick(true)?;
            self.close_record(TrialEnd::Abort)?;
        }
        Ok(self.result())
    }

    fn close_record(&mut self, ended: TrialEnd) -> Result<(), AgentError> {
        if let Some(recorder) = self.run.recorder.take() {
            recorder.finish(&TrialResult { ended, ..self.result() })?;
        }
        Ok(())
    }

    /// The result as of now.
    pub fn result(&self) -> TrialResult {
        let trial_dir = self.dir.as_deref().map(|dir| dir.display().to_string());
        TrialResult { trial_dir, ..self.run.trial.result() }
    }

    /// Writes what is observed now, in the order of [`AgentEnvironment::observation_names`].
    ///
    /// # Panics
    /// If `out` is not as long as there are names.
    pub fn write_observation(&self, out: &mut [f64]) {
        self.observation_writer.write(&self.run.trial, &self.frame, out);
    }

    /// Names of the numbers that are observed, such as `tip.x`.
    pub fn observation_names(&self) -> &[String] {
        self.observation_writer.names()
    }

    /// What the numbers of an action are.
    pub fn action_kind(&self) -> &ActionKind {
        self.run.driver.kind()
    }

    /// The newest instant that was displayed.
    pub fn frame(&self) -> &DisplayFrame {
        &self.frame
    }

    /// What happened in the last step.
    pub fn events(&self) -> &[Event] {
        &self.run.events
    }

    /// The trial.
    pub fn running_trial(&self) -> &RunningTrial {
        &self.run.trial
    }
}

impl AgentLoop {
    /// One tick, with the frame that it displayed.
    fn tick(&mut self, last: bool) -> Result<Option<DisplayFrame>, AgentError> {
        if is_control_tick(self.trial.testbed().now()) {
            self.driver.update_joint_speeds(&self.trial);
        }
        let step = self.trial.step(last)?;
        if let Some(recorder) = &mut self.recorder {
            recorder.write(&step, self.trial.testbed().plant().state())?;
        }
        self.ended = step.output.finished || last;
        self.events.extend(step.output.events);
        Ok(step.frame.map(|frame| *frame))
    }
}
