//! Whole trials, with methods, intent models, participants and classifiers in Python.

use crate::{
    trial_keywords::{TrialKeywords, emg_origin, fault_policy, value_error},
    worker::{FaultList, PythonDecoder, PythonIntentModel, PythonMethod, PythonParticipant, PythonWorker},
};
use proact_app::{
    Arm, Recorder, Registry, ReplayOptions, RunOutputs, replay_trial, run_to_end,
    trial::{Assembly, CustomParts, EmgInput, simulate_with},
};
use proact_control::{MethodEntry, MethodProgram, MethodRegistry, ports::MethodProcess};
use proact_devices::{EmgOrigin, FeedbackSinks, findings_json};
use proact_emg::{DecoderProcess, EmgModel};
use proact_intent::{IntentProcess, IntentProgram};
use proact_participants::Participant;
use proact_testbed::{TrialConfig, TrialResult};
use proact_types::{MethodInfo, PlannerView};
use pyo3::{exceptions::PyKeyboardInterrupt, prelude::*, types::PyDict};
use serde_json::{Value, json};
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
struct PythonParts {
    /// Description of the method, JSON text.
    method_info: Option<String>,
    method: Option<Py<PyAny>>,
    participant: Option<Py<PyAny>>,
    classifier: Option<Py<PyAny>>,
    /// Model whose windows the classifier decodes, JSON text.
    model: Option<String>,
    intent: Option<Py<PyAny>>,
    timeout_secs: f64,
}

/// How a trial is run.
struct TrialRun {
    arm: Arm,
    methods: MethodRegistry,
    config: TrialConfig,
    emg: Option<EmgOrigin>,
    gaze_error_deg: f64,
    dir: Option<PathBuf>,
    python: PythonParts,
}

/// Runs a trial to its end; the result with `faults`, `reasons`, `findings` and `accepted_faults`, JSON text.
#[pyfunction]
#[pyo3(signature = (choice, python, *, emg=None, gaze_error_deg=1.5, record=None, accept_faults=false))]
pub(crate) fn run_trial(
    py: Python<'_>,
    choice: &Bound<'_, PyDict>,
    python: &Bound<'_, PyDict>,
    emg: Option<String>,
    gaze_error_deg: f64,
    record: Option<PathBuf>,
    accept_faults: bool,
) -> PyResult<String> {
    let methods = Registry::standard().methods;
    let python: PythonParts = python.extract()?;
    let (arm, mut config) = TrialKeywords::from_dict(choice)?.config(&methods)?;
    if let Some(info) = &python.method_info {
        let info: MethodInfo = serde_json::from_str(info).map_err(value_error)?;
        let program =
            MethodProgram { info: Some(info.clone()), ..MethodProgram::new(vec![PYTHON_COMMAND.to_owned()]) };
        program.check().map_err(value_error)?;
        config = config.with_method(&MethodEntry::external(info, program));
    }
    if python.intent.is_some() {
        config.intent_process = Some(IntentProgram::new(vec![PYTHON_COMMAND.to_owned()]));
    }
    let emg = emg.map(|name| emg_origin(name, fault_policy(accept_faults)));
    let run = TrialRun { arm, methods, config, emg, gaze_error_deg, dir: record, python };
    // Others may run while the trial does; what is asked of Python comes back for the interpreter.
    let ran = py.detach(move || run.run());
    py.check_signals()?;
    match ran {
        Ok(None) => Err(PyKeyboardInterrupt::new_err("the trial was interrupted; its record is closed")),
        Ok(Some(result)) => Ok(result),
        Err(reason) => Err(value_error(reason)),
    }
}

impl TrialRun {
    /// The result as JSON text; none if it was interrupted.
    fn run(self) -> Result<Option<String>, String> {
        let TrialRun { arm, methods, config, emg, gaze_error_deg, dir, python } = self;
        let (interrupted, faults) = (Arc::new(AtomicBool::new(false)), FaultList::default());
        if !(python.timeout_secs > 0.0 && python.timeout_secs <= 3600.0) {
            return Err(format!(
                "answer_timeout_secs is {}, expected above 0 and at most 3600",
                python.timeout_secs
            ));
        }
        let timeout = Duration::from_secs_f64(python.timeout_secs);
        let worker = |object| PythonWorker::new(object, timeout, interrupted.clone());
        let own = CustomParts {
            participant: python.participant.map(|object| {
                Box::new(PythonParticipant::new(worker(object), faults.clone())) as Box<dyn Participant>
            }),
            method: python.method.map(|object| {
                Box::new(PythonMethod(worker(object), faults.clone())) as Box<dyn MethodProcess>
            }),
            decoder: python.classifier.map(|object| {
                Box::new(PythonDecoder(worker(object), faults.clone())) as Box<dyn DecoderProcess>
            }),
            intent: python.intent.map(|object| {
                Box::new(PythonIntentModel(worker(object), faults.clone())) as Box<dyn IntentProcess>
            }),
        };
        let trained = python.model.map(|model| EmgModel::from_json(&model)).transpose();
        let trained = trained.map_err(|error| error.to_string())?;
        let emg = emg.as_ref().map(|origin| EmgInput { origin, trained: trained.as_ref() });
        let text = |error: &dyn std::fmt::Display| error.to_string();
        let Assembly { trial, classifier, arm, plans, recording_faults: findings } =
            simulate_with(&methods, &arm, config, emg, gaze_error_deg, own).map_err(|e| text(&e))?;
        let accepted_faults = trial.testbed().config().emg_accepted_faults.clone();
        let recorder = match &dir {
            Some(dir) => {
                let config = trial.testbed().config();
                let recorder = Recorder::create(dir, config, &arm, classifier.as_ref());
                Some(recorder.and_then(|recorder| recorder.with_plans(plans)).map_err(|e| text(&e))?)
            }
            None => None,
        };
        let mut outputs = RunOutputs {
            page: None,
            inputs: None,
            rosbridge: None,
            shoulder: None,
            feedback: FeedbackSinks::default(),
            interrupted: &interrupted,
        };
        let mut reasons = BTreeSet::new();
        let mut known = 0;
        let ran = run_to_end(trial, recorder, &mut outputs, dir.as_deref(), |step, _| {
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
        let beside = [
            ("faults", json!(faults.all())),
            ("reasons", json!(reasons)),
            ("findings", findings_json(&findings)),
            ("accepted_faults", json!(accepted_faults)),
        ];
        result_json(&result, beside).map(Some)
    }
}

/// The result with what stands `beside` it, JSON text.
fn result_json(result: &TrialResult, beside: [(&str, Value); 4]) -> Result<String, String> {
    let mut json = serde_json::to_value(result).map_err(|error| error.to_string())?;
    if let Some(object) = json.as_object_mut() {
        object.extend(beside.map(|(key, value)| (key.to_owned(), value)));
    }
    Ok(json.to_string())
}

/// Recomputes the trial recorded in `dir`; what was found, JSON text.
#[pyfunction]
pub(crate) fn replay(py: Python<'_>, dir: PathBuf) -> PyResult<String> {
    let replayed = py.detach(move || {
        let options = ReplayOptions { methods: Registry::standard().methods, ..ReplayOptions::default() };
        let replayed = replay_trial(Path::new(&dir), options).map_err(|error| error.to_string())?;
        serde_json::to_string(&replayed).map_err(|error| error.to_string())
    });
    replayed.map_err(value_error)
}
