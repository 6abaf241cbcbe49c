//! Trials with simulated participants in programs of their own: the generators of physics and planner are a process's, so that
//! trials side by side are processes side by side.
//!
//! A worker reads [`TrialOrder`]s from its standard input, one JSON object a line, and writes an answer for each to its standard
//! output. When its input ends, as it does when whoever ordered is killed, the trial under way ends too, and its record is closed.

use crate::{
    Arm, Audience, Recorder, Registry,
    analysis::LiveTrace,
    lines_of, run_to_end,
    trial::{self, Assembly},
    trial_choice::{TrialContext, trial_config},
};
use proact_analysis::table::Cell;
use proact_devices::{EmgOrigin, FeedbackSinks};
use proact_emg::EmgConfig;
use proact_recording::StudyPlace;
use proact_study::TrialChoice;
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
const LOOK: Duration = Duration::from_millis(50);

/// A trial to be run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrialOrder {
    /// What it is made of.
    pub choice: TrialChoice,
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
    pub place: Option<StudyPlace>,
    /// Whether it is scored as an analysis scores it.
    #[serde(default)]
    pub scored: bool,
}

impl TrialOrder {
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
        trial_config(&self.choice, context)
    }
}

/// What an analysis finds in a trial: rows of its tables, without what names the trial.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrialScores {
    /// The trial's measures, a row.
    pub measures: Vec<Vec<Cell>>,
    /// Objects, a row each.
    pub objects: Vec<Vec<Cell>>,
    /// Picks and places.
    pub phases: Vec<Vec<Cell>>,
    /// What went wrong.
    pub faults: Vec<Vec<Cell>>,
}

/// A trial that is over.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrialDone {
    /// What came of it.
    pub result: TrialResult,
    /// What an analysis finds in it, if that was asked for.
    pub scores: Option<TrialScores>,
}

/// What came of an order.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Reply {
    Result(Box<TrialDone>),
    Error(String),
}

/// Why there is no result.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WorkerError {
    /// The program ended by itself, or was killed: another one may do better.
    #[error("a program that ran a trial ended before the trial did ({how})")]
    Gone {
        /// As the system tells it.
        how: String,
    },
    /// The trial cannot be run.
    #[error("{0}")]
    Trial(String),
}

/// Runs a trial with a simulated participant, as fast as it goes.
///
/// # Errors
/// Names that mean nothing; a native library or the disk refuses.
pub fn simulated_trial(
    registry: &Registry,
    order: &TrialOrder,
    interrupted: &AtomicBool,
) -> Result<TrialDone, Box<dyn Error>> {
    let (arm, config) = order.config(registry, None)?;
    let Assembly { session, classifier, plans, .. } =
        trial::simulated_with(&registry.methods, &arm, config, &EmgOrigin::Synthetic, None)?;
    let config = session.testbed().config().clone();
    let recorder = match &order.dir {
        Some(dir) => {
            let recorder = Recorder::create_in_study(
                dir,
                (order.bag.as_str(), order.place.clone()),
                &config,
                &arm,
                classifier.as_ref(),
            )?;
            Some(recorder.with_plans(plans)?)
        }
        None => None,
    };
    let mut nobody = Audience {
        page: None,
        inputs: None,
        rosbridge: None,
        shoulder: None,
        feedback: FeedbackSinks::default(),
        interrupted,
    };
    let mut film = order.scored.then(|| LiveTrace::new(session.testbed().task().scene().clone()));
    let result = run_to_end(session, recorder, &mut nobody, order.dir.as_deref(), |step| {
        film.iter_mut().for_each(|film| film.take(step));
    })?;
    let scores = film.map(|film| film.scores(arm.model(), &result.result)).transpose()?;
    Ok(TrialDone { result, scores })
}

/// Does what is ordered, until `orders` end or `interrupted` is raised, which the end of `orders` does.
///
/// # Errors
/// Nobody reads the answers.
pub fn work(
    registry: &Registry,
    orders: impl BufRead + Send + 'static,
    answers: &mut impl Write,
    interrupted: &Arc<AtomicBool>,
) -> io::Result<()> {
    let lines = lines_of(orders);
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
        let reply = order
            .and_then(|order| simulated_trial(registry, &order, interrupted))
            .map_or_else(|error| Reply::Error(error.to_string()), |done| Reply::Result(Box::new(done)));
        serde_json::to_writer(&mut *answers, &reply)?;
        answers.write_all(b"\n")?;
        answers.flush()?;
    }
    Ok(())
}

/// A program that does what is ordered. It ends when this is dropped.
#[derive(Debug)]
pub struct Worker {
    child: Child,
    /// Closed to have it end.
    orders: Option<ChildStdin>,
    answers: Receiver<String>,
}

impl Worker {
    /// Starts `command`, a program that calls [`work`] on its standard input and output.
    ///
    /// # Errors
    /// The system refuses.
    pub fn start(command: &mut Command) -> io::Result<Self> {
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
        let orders = child.stdin.take();
        let output = child.stdout.take().ok_or_else(|| io::Error::other("the worker has no output"))?;
        Ok(Self { child, orders, answers: lines_of(io::BufReader::new(output)) })
    }

    /// Has a trial run. If `ends` says so meanwhile, the trial ends, its record is closed, and this worker takes no more orders.
    ///
    /// # Errors
    /// [`WorkerError`].
    pub fn run(&mut self, order: &TrialOrder, ends: impl Fn() -> bool) -> Result<TrialDone, WorkerError> {
        let mut line = serde_json::to_vec(order).map_err(|error| WorkerError::Trial(error.to_string()))?;
        line.push(b'\n');
        let sent = self.orders.as_mut().map(|orders| orders.write_all(&line).and_then(|()| orders.flush()));
        if !matches!(sent, Some(Ok(()))) {
            return Err(self.gone());
        }
        loop {
            match self.answers.recv_timeout(LOOK) {
                Ok(answer) => {
                    return match serde_json::from_str(&answer) {
                        Ok(Reply::Result(done)) => Ok(*done),
                        Ok(Reply::Error(reason)) => Err(WorkerError::Trial(reason)),
                        Err(error) => {
                            Err(WorkerError::Trial(format!("unreadable answer of a trial: {error}")))
                        }
                    };
                }
                Err(RecvTimeoutError::Timeout) if ends() => drop(self.orders.take()),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return Err(self.gone()),
            }
        }
    }

    fn gone(&mut self) -> WorkerError {
        self.orders = None;
        let how = self.child.wait().map_or_else(|error| error.to_string(), |status| status.to_string());
        WorkerError::Gone { how }
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        // It ends with its input, within a tick of the trial under way.
        self.orders = None;
        let _ = self.child.wait();
    }
}
