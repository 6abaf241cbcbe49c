//! An intent model in another process: started here, asked gaze by gaze, ended with the trial.

use crate::method_process::{ExternalProcess, MethodProcessError};
use proact_intent::IntentProcess;
use proact_testbed::TrialConfig;
use proact_types::{IntentAnswer, SimTime};

/// Starts the program that says what is meant in a trial of `config`, if one does. A live trial does not wait for each answer.
///
/// # Errors
/// If the program cannot be started.
pub fn start(config: &TrialConfig) -> Result<Option<Box<dyn IntentProcess>>, MethodProcessError> {
    let Some(program) = &config.intent_process else { return Ok(None) };
    let running =
        ExternalProcess::start("intent model", &program.command, config.wait_for_plans, program.deadline_ms)?;
    Ok(Some(Box::new(running)))
}

impl IntentProcess for ExternalProcess {
    fn ask(&mut self, now: SimTime, line: &str) -> IntentAnswer {
        self.request(now, line)
    }
}
