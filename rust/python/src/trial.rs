//! Whole trials, with methods, intent models, participants and classifiers in Python.

use crate::{
    choice::{Choice, emg_origin, refused},
    worker::{Decoder, Faults, Meaning, Method, Person, Worker},
};
use proact_app::{
    Arm, Audience, Recorder, Registry, ReplayOptions, replay_trial, run_to_end,
    trial::{Assembly, EmgOf, OwnParts, simulated_by},
};
use proact_control::{MethodEntry, MethodProgram, MethodRegistry, ports::MethodProcess};
use proact_devices::FeedbackSinks;
use proact_emg::{DecoderProcess, EmgModel};
use proact_intent::{IntentProcess, IntentProgram};
use proact_participants::Participant;
use proact_testbed::{TrialConfig, TrialResult};
use proact_types::{MethodInfo, PlannerView};
use pyo3::{exceptions::PyKeyboardInterrupt, prelude::*, types::PyDict};
use serde_json::json;
use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

/// What stands for the program of a method, or of an intent model, in Python. A replay takes its answers from the log.
const PYTHON_COMMAND: &str = "proact:python";
/// Ticks from one look at Ctrl-C to the next.
const SIGNAL_TICKS: u64 = 1000;
/// What went wrong in Python, in a trial directory.
const FAULTS_FILE: &str = "python_faults.json";

/// What of a trial is in Python.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct InPython {
    /// Told of the method, JSON text.
    method_info: Option<String>,
    method: Option<Py<PyAny>>,
    participant: Option<Py<PyAny>>,
    classifier: Option<Py<PyAny>>,
    /// Model whose windows the classifier decodes, JSON text.
    model: Option<String>,
    intent: Option<Py<PyAny>>,
    patience_secs: f64,
}

/// How a trial is run.
struct Run {
    arm: Arm,
    methods: MethodRegistry,
    config: TrialConfig,
    emg: Option<String>,
    gaze_error_deg: f64,
    dir: Option<PathBuf>,
    python: InPython,
}

/// Runs a trial to its end; the result with `faults` and `reasons`, JSON text.
#[pyfunction]
#[pyo3(signature = (choice, python, *, emg=None, gaze_error_deg=1.5, record=None))]
pub(crate) fn run_trial(
    py: Python<'_>,
    choice: &Bound<'_, PyDict>,
    python: &Bound<'_, PyDict>,
    emg: Option<String>,
    gaze_error_deg: f64,
    record: Option<PathBuf>,
) -> PyResult<String> {
    let methods = Registry::standard().methods;
    let python: InPython = python.extract()?;
    let (arm, mut config) = Choice::of(choice)?.config(&methods)?;
    if let Some(info) = &python.method_info {
        let info: MethodInfo = serde_json::from_str(info).map_err(refused)?;
        let program =
            MethodProgram { info: Some(info.clone()), ..MethodProgram::new(vec![PYTHON_COMMAND.to_owned()]) };
        program.check().map_err(refused)?;
        config = config.by(&MethodEntry::outside(info, program));
    }
    if python.intent.is_some() {
        config.intent_process = Some(IntentProgram::new(vec![PYTHON_COMMAND.to_owned()]));
    }
    let run = Run { arm, methods, config, emg, gaze_error_deg, dir: record, python };
    // Others may run while the trial does; what is asked of Python comes back for the interpreter.
    let ran = py.detach(move || run.finish());
    py.check_signals()?;
    match ran {
        Ok(None) => Err(PyKeyboardInterrupt::new_err("the trial was interrupted; its record is closed")),
        Ok(Some(result)) => Ok(result),
        Err(reason) => Err(refused(reason)),
    }
}

impl Run {
    /// The result as JSON text; none if it was interrupted.
    fn finish(self) -> Result<Option<String>, String> {
        let Run { arm, methods, config, emg, gaze_error_deg, dir, python } = self;
        let (interrupted, faults) = (Arc::new(AtomicBool::new(false)), Faults::default());
        if !(python.patience_secs > 0.0 && python.patience_secs <= 3600.0) {
            return Err(format!(
                "patience_secs is {}, expected above 0 and at most 3600",
                python.patience_secs
            ));
        }
        let patience = Duration::from_secs_f64(python.patience_secs);
        let worker = |object| Worker::new(object, patience, interrupted.clone());
        let own = OwnParts {
            participant: python
                .participant
                .map(|object| Box::new(Person::new(worker(object), faults.clone())) as Box<dyn Participant>),
            method: python
                .method
                .map(|object| Box::new(Method(worker(object), faults.clone())) as Box<dyn MethodProcess>),
            decoder: python
                .classifier
                .map(|object| Box::new(Decoder(worker(object), faults.clone())) as Box<dyn DecoderProcess>),
            intent: python
                .intent
                .map(|object| Box::new(Meaning(worker(object), faults.clone())) as Box<dyn IntentProcess>),
        };
        let trained = python.model.map(|model| EmgModel::from_json(&model)).transpose();
        let trained = trained.map_err(|error| error.to_string())?;
        let origin = emg.map(emg_origin);
        let emg = origin.as_ref().map(|origin| EmgOf { origin, trained: trained.as_ref() });
        let text = |error: &dyn std::fmt::Display| error.to_string();
        let Assembly { session, classifier, arm, plans, .. } =
            simulated_by(&methods, &arm, config, emg, gaze_error_deg, own).map_err(|e| text(&e))?;
        let recorder = match &dir {
            Some(dir) => {
                let config = session.testbed().config();
                let recorder = Recorder::create(dir, config, &arm, classifier.as_ref());
                Some(recorder.and_then(|recorder| recorder.with_plans(plans)).map_err(|e| text(&e))?)
            }
            None => None,
        };
        let mut audience = Audience {
            page: None,
            inputs: None,
            rosbridge: None,
            shoulder: None,
            feedback: FeedbackSinks::default(),
            interrupted: &interrupted,
        };
        let mut reasons = BTreeSet::new();
        let mut known = 0;
        let ran = run_to_end(session, recorder, &mut audience, dir.as_deref(), |step| {
            if let Some(frame) = &step.frame {
                if let PlannerView::Failed { reason, .. } = &frame.planner {
                    reasons.insert(reason.clone());
                }
                reasons.extend(frame.stop.as_ref().map(|stop| stop.reason.clone()));
            }
            let all = faults.all();
            if let (Some(dir), true) = (&dir, all.len() > known) {
                known = all.len();
                // Beside the record, which holds the answers themselves: a disk that refuses this refuses that too.
                let _ = fs::write(dir.join(FAULTS_FILE), json!(all).to_string());
            }
            if step.time.0.is_multiple_of(SIGNAL_TICKS) && Python::attach(|py| py.check_signals()).is_err() {
                interrupted.store(true, Ordering::Relaxed);
            }
        });
        let result = ran.map_err(|error| error.to_string())?;
        if interrupted.load(Ordering::Relaxed) {
            return Ok(None);
        }
        told(&result, &faults.all(), &reasons).map(Some)
    }
}

fn told(result: &TrialResult, faults: &[String], reasons: &BTreeSet<String>) -> Result<String, String> {
    let mut told = serde_json::to_value(result).map_err(|error| error.to_string())?;
    if let Some(object) = told.as_object_mut() {
        object.insert("faults".to_owned(), json!(faults));
        object.insert("reasons".to_owned(), json!(reasons));
    }
    Ok(told.to_string())
}

/// Recomputes the trial recorded in `dir`; what was found, JSON text.
#[pyfunction]
pub(crate) fn replay(py: Python<'_>, dir: PathBuf) -> PyResult<String> {
    let replayed = py.detach(move || {
        let options = ReplayOptions { methods: Registry::standard().methods, ..ReplayOptions::default() };
        let replayed = replay_trial(Path::new(&dir), options).map_err(|error| error.to_string())?;
        serde_json::to_string(&replayed).map_err(|error| error.to_string())
    });
    replayed.map_err(refused)
}
