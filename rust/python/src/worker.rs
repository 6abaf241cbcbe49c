//! Python that is asked within a trial: in a thread of its own, and waited for within bounds, so that what hangs or raises holds the
//! arm and nothing else.

use proact_control::ports::MethodProcess;
use proact_emg::DecoderProcess;
use proact_intent::IntentProcess;
use proact_participants::Participant;
use proact_types::{
    DisplayFrame, ExternalAnswer, Gesture, IntentAnswer, Intention, MethodAnswer, SimTime, TrunkPosture,
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
pub(crate) enum Fault {
    /// Not in time; it may still be at it.
    Late(Duration),
    /// It raised.
    Raised(String),
}

impl Fault {
    fn text(&self, whose: &str) -> String {
        match self {
            Fault::Late(patience) => {
                format!("the Python {whose} has not answered within {} ms", patience.as_millis())
            }
            Fault::Raised(reason) => format!("the Python {whose} {reason}"),
        }
    }
}

/// A Python object with `ask(text, patience_secs)`, which gives `(answer, None)`, `(None, reason)` when it raised, or
/// `(None, None)` when it is late (`proact/_worker.py`).
pub(crate) struct Worker {
    worker: Py<PyAny>,
    patience: Duration,
    interrupted: Arc<AtomicBool>,
}

impl Worker {
    /// Asks `worker`, waiting for each answer at most for `patience`. Ctrl-C meanwhile raises `interrupted`.
    pub(crate) fn new(worker: Py<PyAny>, patience: Duration, interrupted: Arc<AtomicBool>) -> Self {
        Self { worker, patience, interrupted }
    }

    /// Its answer to `question`.
    fn ask(&self, question: &str) -> Result<String, Fault> {
        Python::attach(|py| {
            let asked = self.worker.call_method1(py, "ask", (question, self.patience.as_secs_f64()));
            match asked.and_then(|answer| answer.extract::<(Option<String>, Option<String>)>(py)) {
                Ok((Some(answer), _)) => Ok(answer),
                Ok((None, Some(reason))) => Err(Fault::Raised(reason)),
                Ok((None, None)) => Err(Fault::Late(self.patience)),
                Err(error) => {
                    if error.is_instance_of::<PyKeyboardInterrupt>(py) {
                        self.interrupted.store(true, Ordering::Relaxed);
                    }
                    Err(Fault::Raised(format!("raised {error}")))
                }
            }
        })
    }
}

/// What went wrong in Python in the course of a trial, each once, in their order.
#[derive(Clone, Default)]
pub(crate) struct Faults(Arc<Mutex<Vec<String>>>);

impl Faults {
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
fn answer(worker: &Worker, faults: &Faults, part: &str, line: &str) -> ExternalAnswer {
    let fault = match worker.ask(line) {
        Ok(line) => return ExternalAnswer::Line(line),
        Err(fault) => fault,
    };
    let text = fault.text(part);
    faults.note(&text);
    match fault {
        Fault::Late(_) => ExternalAnswer::Missed(text),
        Fault::Raised(_) => ExternalAnswer::Failed(text),
    }
}

/// A control method.
pub(crate) struct Method(pub Worker, pub Faults);

impl MethodProcess for Method {
    fn ask(&mut self, _now: SimTime, line: &str) -> MethodAnswer {
        answer(&self.0, &self.1, "method", line)
    }
}

/// An intent model.
pub(crate) struct Meaning(pub Worker, pub Faults);

impl IntentProcess for Meaning {
    fn ask(&mut self, _now: SimTime, line: &str) -> IntentAnswer {
        answer(&self.0, &self.1, "intent model", line)
    }
}

/// A classifier of EMG.
pub(crate) struct Decoder(pub Worker, pub Faults);

impl DecoderProcess for Decoder {
    fn ask(&mut self, _window: u64, line: &str) -> WindowAnswer {
        let fault = match self.0.ask(line) {
            Ok(answer) => return WindowAnswer::Line(answer),
            Err(fault) => fault,
        };
        let text = fault.text("classifier");
        self.1.note(&text);
        match fault {
            Fault::Late(patience) => WindowAnswer::Late { deadline_ms: patience.as_millis() as u64 },
            Fault::Raised(_) => WindowAnswer::Failed(text),
        }
    }
}

/// A participant, and why it gave nothing when it was asked last.
pub(crate) struct Person {
    worker: Worker,
    faults: Faults,
    fault: Option<String>,
}

impl Person {
    pub(crate) fn new(worker: Worker, faults: Faults) -> Self {
        Self { worker, faults, fault: None }
    }

    fn act(&mut self, frame: &DisplayFrame) -> Result<Intention, String> {
        let line = serde_json::to_string(frame).map_err(|error| error.to_string())?;
        let answer = self.worker.ask(&line).map_err(|fault| fault.text("participant"))?;
        let read: Result<Intention, _> = serde_json::from_str(&answer);
        read.map_err(|error| format!("the Python participant answered {answer:?}: {error}"))
    }
}

impl Participant for Person {
    /// Who fails lets go and closes the eyes.
    fn step(&mut self, frame: &DisplayFrame) -> Intention {
        self.fault = None;
        self.act(frame).unwrap_or_else(|text| {
            self.faults.note(&text);
            self.fault = Some(text);
            Intention {
                gesture: Gesture::NoMotion,
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
