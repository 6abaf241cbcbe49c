use crate::decoder_process::{DecodeRequest, DecoderProcess, DecoderProcessConfig};
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
    config: Option<DecoderProcessConfig>,
    /// None in a replay.
    process: Option<Arc<Mutex<Box<dyn DecoderProcess>>>>,
    /// Windows so far.
    request_count: u64,
    /// What the log has for this step.
    logged_answers: VecDeque<WindowAnswer>,
    /// What was answered in this step.
    answers: Vec<WindowAnswer>,
    /// Windows of this step without a decision.
    undecided: usize,
    /// Why the newest window has no decision.
    fault: Option<String>,
}

impl fmt::Debug for DecoderTap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("DecoderTap")
            .field("config", &self.config)
            .field("asked", &self.request_count)
            .finish()
    }
}

/// Why a window has no decision.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum DecodeFailure {
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
        self.logged_answers.clear();
        self.logged_answers.extend(answers.iter().cloned());
        self.answers.clear();
        self.undecided = 0;
    }

    /// What was answered in this step.
    pub(crate) fn answers(&self) -> &[WindowAnswer] {
        &self.answers
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
    ) -> Result<Prediction, DecodeFailure> {
        self.request_count += 1;
        let answer = self.answer(now, window, features);
        let decoded = match &answer {
            WindowAnswer::Line(line) => classifier
                .parse_response(self.request_count, line)
                .map_err(|reason| (DecodeFailure::Failed, reason)),
            WindowAnswer::TimedOut { deadline_ms } => {
                let reason = format!("it has not answered within {deadline_ms} ms");
                Err((DecodeFailure::Late, reason))
            }
            WindowAnswer::Failed(reason) => Err((DecodeFailure::Failed, reason.clone())),
        };
        self.answers.push(answer);
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
        if let Some(logged) = self.logged_answers.pop_front() {
            return logged;
        }
        let (Some(config), Some(process)) = (&self.config, &self.process) else {
            return WindowAnswer::Failed("nobody was asked".to_owned());
        };
        let line = DecodeRequest::new(config.input, self.request_count, now, window, features).text();
        process.lock().unwrap_or_else(PoisonError::into_inner).decode(self.request_count, &line)
    }
}
