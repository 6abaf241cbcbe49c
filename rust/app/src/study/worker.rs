//! Trials with simulated participants in programs of their own: the generators of physics and planner are a process's, so that
//! trials side by side are processes side by side.
//!
//! A worker reads [`TrialJob`]s from its standard input, one JSON object a line, and writes an answer for each to its standard
//! output. When its input ends, as it does when whoever ordered is killed, the trial under way ends too, and its record is closed.

use crate::{
    Arm, Recorder, Registry, RunOutputs,
    analysis::LiveTraceBuilder,
    read_lines,
    renamed_key_warnings::silence_renamed_keys,
    run_to_end,
    trial::{self, Assembly},
    trial_choice::{TrialContext, trial_config},
};
use proact_analysis::table::TableCell;
use proact_devices::EmgOrigin;
use proact_emg::EmgConfig;
use proact_recording::StudyTrialId;
use proact_study::TrialOptions;
use proact_testbed::{TrialConfig, TrialResult};
use serde::{Deserialize, Serialize};
use std::{
    error::Error,
    io::{self, BufRead, Write},
    path::PathBuf,
    process::{Child, ChildStdin, Command, Stdio},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::{Receiver, RecvTimeoutError, channel},
    },
    time::Duration,
};

/// Where person and box are in a trial that says nothing.
pub(super) const DEFAULT_SETUP: &str = "seated";
/// How often it is looked whether the trial is to end.
const POLL_PERIOD: Duration = Duration::from_millis(50);

/// A trial to be run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrialJob {
    /// What it is made of.
    #[serde(rename = "choice")]
    pub options: TrialOptions,
    /// Of every random stream.
    pub seed: u64,
    /// Where the blocks stand; by the seed if left out.
    pub arrangement: Option<String>,
    /// Where it is recorded; nowhere if left out.
    pub dir: Option<PathBuf>,
    /// Name of the record's bag.
    pub bag: String,
    /// Where in a study the trial belongs.
    #[serde(default)]
    #[serde(rename = "place")]
    pub study_place: Option<StudyTrialId>,
    /// Whether it is scored as an analysis scores it.
    #[serde(default)]
    #[serde(rename = "scored")]
    pub with_scores: bool,
}

impl TrialJob {
    /// The arm and the configuration; `emg` are the settings of the EMG stage that assignments begin with.
    ///
    /// # Errors
    /// Names that mean nothing, values out of range.
    pub fn config(
        &self,
        registry: &Registry,
        emg: Option<EmgConfig>,
    ) -> Result<(Arm, TrialConfig), Box<dyn Error>> {
        let context = TrialContext {
            methods: &registry.methods,
            default_setup: DEFAULT_SETUP,
            seed: self.seed,
            arrangement: self.arrangement.as_deref(),
            process: None,
            intent: None,
            emg,
        };
        trial_config(&self.options, context)
    }
}

/// What an analysis finds in a trial: rows of its tables, without what names the trial.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrialScores {
    /// The trial's measures, a row.
    pub measures: Vec<Vec<TableCell>>,
    /// Objects, a row each.
    pub objects: Vec<Vec<TableCell>>,
    /// Picks and places.
    pub phases: Vec<Vec<TableCell>>,
    /// What went wrong.
    pub faults: Vec<Vec<TableCell>>,
}

/// A trial that is over.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FinishedTrial {
    /// What came of it.
    pub result: TrialResult,
    /// What an analysis finds in it, if that was asked for.
    pub scores: Option<TrialScores>,
}

/// What came of an order.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum TrialReply {
    Result(Box<FinishedTrial>),
    Error(String),
}

/// Why there is no result.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WorkerError {
    /// The program ended by itself, or was killed: another one may do better.
    #[error("a program that ran a trial ended before the trial did ({exit_status})")]
    WorkerExited {
        /// As the system tells it.
        exit_status: String,
    },
    /// The trial cannot be run.
    #[error("{0}")]
    Trial(String),
}

/// Runs a trial with a simulated participant, as fast as it goes.
///
/// # Errors
/// Names that mean nothing; a native library or the disk refuses.
pub fn run_simulated_trial(
    registry: &Registry,
    order: &TrialJob,
    interrupted: &AtomicBool,
) -> Result<FinishedTrial, Box<dyn Error>> {
    let (arm, config) = order.config(registry, None)?;
    let Assembly { trial, classifier, plans, .. } =
        trial::simulated_trial_with_model(&registry.methods, &arm, config, &EmgOrigin::Synthetic, None)?;
    let config = trial.testbed().config().clone();
    let recorder = match &order.dir {
        Some(dir) => {
            let recorder = Recorder::create_in_study(
                dir,
                (order.bag.as_str(), order.study_place.clone()),
                &config,
                &arm,
                classifier.as_ref(),
            )?;
            Some(recorder.with_plans(plans)?)
        }
        None => None,
    };
    let mut outputs = RunOutputs::none(interrupted);
    let mut trace_builder = order.with_scores.then(|| LiveTraceBuilder::new(trial.testbed()));
    let result = run_to_end(trial, recorder, &mut outputs, order.dir.as_deref(), |step, testbed| {
        trace_builder.iter_mut().for_each(|trace_builder| trace_builder.add_step(step, testbed));
    })?;
    let scores = trace_builder
        .map(|trace_builder| trace_builder.finish_and_score(arm.model(), &result.result))
        .transpose()?;
    Ok(FinishedTrial { result, scores })
}

/// Does what is ordered, until `orders` end or `interrupted` is raised, which the end of `orders` does.
///
/// # Errors
/// Nobody reads the answers.
pub fn run_worker(
    registry: &Registry,
    orders: impl BufRead + Send + 'static,
    answers: &mut impl Write,
    interrupted: &Arc<AtomicBool>,
) -> io::Result<()> {
    // Whoever ordered the trials has shown them.
    silence_renamed_keys();
    let lines = read_lines(orders);
    // The end of the orders has to end the trial under way, which does not look at them.
    let (handed, waiting) = channel();
    let ended = Arc::clone(interrupted);
    std::thread::spawn(move || {
        while let Ok(line) = lines.recv() {
            if handed.send(line).is_err() {
                return;
            }
        }
        ended.store(true, Ordering::Relaxed);
    });
    while let Ok(line) = waiting.recv() {
        let order = serde_json::from_str(&line).map_err(Box::<dyn Error>::from);
        let reply = order.and_then(|order| run_simulated_trial(registry, &order, interrupted)).map_or_else(
            |error| TrialReply::Error(error.to_string()),
            |done| TrialReply::Result(Box::new(done)),
        );
        serde_json::to_writer(&mut *answers, &reply)?;
        answers.write_all(b"\n")?;
        answers.flush()?;
    }
    Ok(())
}

/// A program that does what is ordered. It ends when this is dropped.
#[derive(Debug)]
pub struct TrialWorker {
    child: Child,
    /// Closed to have it end.
    orders: Option<ChildStdin>,
    answers: Receiver<String>,
}

impl TrialWorker {
    /// Starts `command`, a program that calls [`run_worker`] on its standard input and output.
    ///
    /// # Errors
    /// The system refuses.
    pub fn start(command: &mut Command) -> io::Result<Self> {
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
        let orders = child.stdin.take();
        let output = child.stdout.take().ok_or_else(|| io::Error::other("the worker has no output"))?;
        Ok(Self { child, orders, answers: read_lines(io::BufReader::new(output)) })
    }

    /// Has a trial run. If `ends` says so meanwhile, the trial ends, its record is closed, and this worker takes no more orders.
    ///
    /// # Errors
    /// [`WorkerError`].
    pub fn run(&mut self, order: &TrialJob, ends: impl Fn() -> bool) -> Result<FinishedTrial, WorkerError> {
        let mut line = serde_json::to_vec(order).map_err(|error| WorkerError::Trial(error.to_string()))?;
        line.push(b'\n');
        let sent = self.orders.as_mut().map(|orders| orders.write_all(&line).and_then(|()| orders.flush()));
        if !matches!(sent, Some(Ok(()))) {
            return Err(self.exit_error());
        }
        loop {
            match self.answers.recv_timeout(POLL_PERIOD) {
                Ok(answer) => {
                    return match serde_json::from_str(&answer) {
                        Ok(TrialReply::Result(done)) => Ok(*done),
                        Ok(TrialReply::Error(reason)) => Err(WorkerError::Trial(reason)),
                        Err(error) => {
                            Err(WorkerError::Trial(format!("unreadable answer of a trial: {error}")))
                        }
                    };
                }
                Err(RecvTimeoutError::Timeout) if ends() => drop(self.orders.take()),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return Err(self.exit_error()),
            }
        }
    }

    fn exit_error(&mut self) -> WorkerError {
        self.orders = None;
        let how = self.child.wait().map_or_else(|error| error.to_string(), |status| status.to_string());
        WorkerError::WorkerExited { exit_status: how }
    }
}

impl Drop for TrialWorker {
    fn drop(&mut self) {
        // It ends with its input, within a tick of the trial under way.
        self.orders = None;
        let _ = self.child.wait();
    }
}
