use crate::process::{DecoderProcess, ProcessConfig, WindowLine};
use crate::{Classifier, EmgConfig, Prediction, WindowView};
use proact_types::{SimTime, WindowAnswer};
use std::{
    collections::VecDeque,
    fmt,
    sync::{Arc, Mutex, PoisonError},
};

/// Stands between the pipeline and a process that decodes: notes each answer for the input log, or takes the logged one
/// instead of asking, which is how a replay runs.
#[derive(Clone, Default)]
pub(crate) struct DecoderTap {
    config: Option<ProcessConfig>,
    /// None in a replay.
    process: Option<Arc<Mutex<Box<dyn DecoderProcess>>>>,
    /// Windows so far.
    asked: u64,
    /// What the log has for this step.
    logged: VecDeque<WindowAnswer>,
    /// What was answered in this step.
    given: Vec<WindowAnswer>,
    /// Windows of this step without a decision.
    undecided: usize,
    /// Why the newest window has no decision.
    fault: Option<String>,
}

impl fmt::Debug for DecoderTap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("DecoderTap").field("config", &self.config).field("asked", &self.asked).finish()
    }
}

/// Why a window has no decision.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Undecided {
    /// The answer has not come in time: as good as a window that was lost.
    Late,
    /// There is no process any more, or what it says cannot be used.
    Failed,
}

impl DecoderTap {
    pub(crate) fn new(config: &EmgConfig) -> Self {
        DecoderTap { config: config.process.clone(), ..DecoderTap::default() }
    }

    pub(crate) fn set_process(&mut self, process: Option<Box<dyn DecoderProcess>>) {
        self.process = process.map(|process| Arc::new(Mutex::new(process)));
    }

    /// A step begins, for which the log has `answers`.
    pub(crate) fn begin(&mut self, answers: &[WindowAnswer]) {
        self.logged.clear();
        self.logged.extend(answers.iter().cloned());
        self.given.clear();
        self.undecided = 0;
    }

    /// What was answered in this step.
    pub(crate) fn given(&self) -> &[WindowAnswer] {
        &self.given
    }

    /// Whether a window of this step has no decision.
    pub(crate) fn is_undecided(&self) -> bool {
        self.undecided > 0
    }

    /// Why the newest window has no decision; none if it has one.
    pub(crate) fn fault(&self) -> Option<&str> {
        self.fault.as_deref()
    }

    /// What the process says of a window.
    pub(crate) fn decode(
        &mut self,
        now: SimTime,
        window: &WindowView<'_>,
        features: &[f64],
        classifier: &Classifier,
    ) -> Result<Prediction, Undecided> {
        self.asked += 1;
        let answer = self.answer(now, window, features);
        let decoded = match &answer {
            WindowAnswer::Line(line) => {
                classifier.read_answer(self.asked, line).map_err(|reason| (Undecided::Failed, reason))
            }
            WindowAnswer::Late { deadline_ms } => {
                let reason = format!("it has not answered within {deadline_ms} ms");
                Err((Undecided::Late, reason))
            }
            WindowAnswer::Failed(reason) => Err((Undecided::Failed, reason.clone())),
        };
        self.given.push(answer);
        match decoded {
            Ok(prediction) => {
                self.fault = None;
                Ok(prediction)
            }
            Err((undecided, reason)) => {
                self.undecided += 1;
                self.fault = Some(format!("the process that decodes EMG gives no decision: {reason}"));
                Err(undecided)
            }
        }
    }

    fn answer(&mut self, now: SimTime, window: &WindowView<'_>, features: &[f64]) -> WindowAnswer {
        if let Some(logged) = self.logged.pop_front() {
            return logged;
        }
        let (Some(config), Some(process)) = (&self.config, &self.process) else {
            return WindowAnswer::Failed("nobody was asked".to_owned());
        };
        let line = WindowLine::new(config.input, self.asked, now, window, features).text();
        process.lock().unwrap_or_else(PoisonError::into_inner).ask(self.asked, &line)
    }
}
