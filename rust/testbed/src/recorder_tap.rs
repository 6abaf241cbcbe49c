use proact_control::ports::MethodProcess;
use proact_types::{MethodAnswer, SimTime};
use std::sync::{Arc, Mutex, PoisonError};

/// Stands between a method and its process: notes each answer for the input log, or gives the logged one instead of
/// asking, which is how a replay runs.
#[derive(Clone)]
pub(crate) struct RecorderTap(Arc<Mutex<TapState>>);

struct TapState {
    /// None in a replay.
    process: Option<Box<dyn MethodProcess>>,
    /// Of this tick.
    answer: Option<MethodAnswer>,
}

impl RecorderTap {
    pub(crate) fn new(process: Option<Box<dyn MethodProcess>>) -> Self {
        Self(Arc::new(Mutex::new(TapState { process, answer: None })))
    }

    /// The answer that the log has for this tick, before the step; the one that was given, after it.
    pub(crate) fn exchange_answer(&self, answer: Option<MethodAnswer>) -> Option<MethodAnswer> {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        std::mem::replace(&mut state.answer, answer)
    }
}

impl MethodProcess for RecorderTap {
    fn ask(&mut self, now: SimTime, line: &str) -> MethodAnswer {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(logged) = &state.answer {
            return logged.clone();
        }
        let answer = match &mut state.process {
            Some(process) => process.ask(now, line),
            None => MethodAnswer::Failed("the log holds no such answer".to_owned()),
        };
        state.answer = Some(answer.clone());
        answer
    }
}
