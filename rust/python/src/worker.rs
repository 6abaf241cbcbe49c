//! Python that is asked within a trial: in a thread of its own, and waited for within bounds, so that what hangs or raises holds the
//! arm and nothing else.

use proact_control::ports::MethodProcess;
use proact_emg::DecoderProcess;
use proact_intent::IntentProcess;
use proact_participants::Participant;
use proact_types::{
    Command, DisplayFrame, ExternalAnswer, IntentAnswer, Intention, MethodAnswer, SimTime, TrunkPosture,
    Vector, WindowAnswer,
};
use pyo3::{exceptions::PyKeyboardInterrupt, prelude::*};
use std::{
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

/// Why Python has not answered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum WorkerFault {
    /// Not in time; it may still be at it.
    Timeout(Duration),
    /// It raised.
    Raised(String),
}

impl WorkerFault {
    fn text(&self, whose: &str) -> String {
        match self {
            WorkerFault::Timeout(timeout) => {
                format!("the Python {whose} has not answered within {} ms", timeout.as_millis())
            }
            WorkerFault::Raised(reason) => format!("the Python {whose} {reason}"),
        }
    }
}

/// A Python object with `ask(text, timeout_secs)`, which gives `(answer, None)`, `(None, reason)` when it raised, or
/// `(None, None)` when it is late (`proact/_worker.py`).
pub(crate) struct PythonWorker {
    worker: Py<PyAny>,
    timeout: Duration,
    interrupted: Arc<AtomicBool>,
}

impl PythonWorker {
    /// Asks `worker`, waiting for each answer at most for `timeout`. Ctrl-C meanwhile raises `interrupted`.
    pub(crate) fn new(worker: Py<PyAny>, timeout: Duration, interrupted: Arc<AtomicBool>) -> Self {
        Self { worker, timeout, interrupted }
    }

    /// Its answer to `question`.
    fn ask(&self, question: &str) -> Result<String, WorkerFault> {
        Python::attach(|py| {
            let reply = self.worker.call_method1(py, "ask", (question, self.timeout.as_secs_f64()));
            match reply.and_then(|answer| answer.extract::<(Option<String>, Option<String>)>(py)) {
                Ok((Some(answer), _)) => Ok(answer),
                Ok((None, Some(reason))) => Err(WorkerFault::Raised(reason)),
                Ok((None, None)) => Err(WorkerFault::Timeout(self.timeout)),
                Err(error) => {
                    if error.is_instance_of::<PyKeyboardInterrupt>(py) {
                        self.interrupted.store(true, Ordering::Relaxed);
                    }
                    Err(WorkerFault::Raised(format!("raised {error}")))
                }
            }
        })
    }
}

/// What went wrong in Python in the course of a trial, each once, in their order.
#[derive(Clone, Default)]
pub(crate) struct FaultList(Arc<Mutex<Vec<String>>>);

impl FaultList {
    fn note(&self, text: &str) {
        let mut faults = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if !faults.iter().any(|known| known == text) {
            faults.push(text.to_owned());
        }
    }

    pub(crate) fn all(&self) -> Vec<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// The answer of `worker`, which is this `part` of the trial, to `line`; what went wrong is noted among the `faults`.
fn ask_part(worker: &PythonWorker, faults: &FaultList, part: &str, line: &str) -> ExternalAnswer {
    let fault = match worker.ask(line) {
        Ok(line) => return ExternalAnswer::Line(line),
        Err(fault) => fault,
    };
    let text = fault.text(part);
    faults.note(&text);
    match fault {
        WorkerFault::Timeout(_) => ExternalAnswer::TimedOut(text),
        WorkerFault::Raised(_) => ExternalAnswer::Failed(text),
    }
}

/// A control method.
pub(crate) struct PythonMethod(pub PythonWorker, pub FaultList);

impl MethodProcess for PythonMethod {
    fn ask(&mut self, _now: SimTime, line: &str) -> MethodAnswer {
        ask_part(&self.0, &self.1, "method", line)
    }
}

/// An intent model.
pub(crate) struct PythonIntentModel(pub PythonWorker, pub FaultList);

impl IntentProcess for PythonIntentModel {
    fn ask(&mut self, _now: SimTime, line: &str) -> IntentAnswer {
        ask_part(&self.0, &self.1, "intent model", line)
    }
}

/// A classifier of EMG.
pub(crate) struct PythonDecoder(pub PythonWorker, pub FaultList);

impl DecoderProcess for PythonDecoder {
    fn decode(&mut self, _window: u64, line: &str) -> WindowAnswer {
        let fault = match self.0.ask(line) {
            Ok(answer) => return WindowAnswer::Line(answer),
            Err(fault) => fault,
        };
        let text = fault.text("classifier");
        self.1.note(&text);
        match fault {
            WorkerFault::Timeout(timeout) => {
                WindowAnswer::TimedOut { deadline_ms: timeout.as_millis() as u64 }
            }
            WorkerFault::Raised(_) => WindowAnswer::Failed(text),
        }
    }
}

/// A participant, and why it gave nothing when it was asked last.
pub(crate) struct PythonParticipant {
    worker: PythonWorker,
    faults: FaultList,
    fault: Option<String>,
}

impl PythonParticipant {
    pub(crate) fn new(worker: PythonWorker, faults: FaultList) -> Self {
        Self { worker, faults, fault: None }
    }

    fn act(&mut self, frame: &DisplayFrame) -> Result<Intention, String> {
        let line = serde_json::to_string(frame).map_err(|error| error.to_string())?;
        let answer = self.worker.ask(&line).map_err(|fault| fault.text("participant"))?;
        let read: Result<Intention, _> = serde_json::from_str(&answer);
        read.map_err(|error| format!("the Python participant answered {answer:?}: {error}"))
    }
}

impl Participant for PythonParticipant {
    /// Who fails lets go and closes the eyes.
    fn step(&mut self, frame: &DisplayFrame) -> Intention {
        self.fault = None;
        self.act(frame).unwrap_or_else(|text| {
            self.faults.note(&text);
            self.fault = Some(text);
            Intention {
                gesture: Command::NoMotion,
                gaze_direction: frame.world_from_head.rotation * Vector::x(),
                eyes_open: false,
                trunk: TrunkPosture::default(),
                limb: None,
            }
        })
    }

    fn fault(&self) -> Option<&str> {
        self.fault.as_deref()
    }
}
