//! A simulated trial with parts that the calling program brings in its own process.

use super::{
    Assembly, AssemblyError, build_physics, build_planner, build_testbed, prepare_simulated_person,
    start_decoder, start_method,
};
use crate::{Arm, intent_process};
use proact_control::{MethodRegistry, ports::MethodProcess};
use proact_devices::{EmgOrigin, SimulatedEyeTracker};
use proact_emg::{DecoderProcess, EmgModel};
use proact_intent::IntentProcess;
use proact_participants::Participant;
use proact_testbed::{ConfigError, PersonParts, RunningTrial, TrialConfig};

/// Parts of a simulated trial that a program brings itself, in its own process. What they answer is input of the trial and
/// goes into its record, so that a replay needs none of them.
#[derive(Default)]
pub struct CustomParts {
    /// Acts in the place of the simulated participant.
    pub participant: Option<Box<dyn Participant>>,
    /// Answers for an outside method in the place of its program.
    pub method: Option<Box<dyn MethodProcess>>,
    /// Decodes EMG in the place of the program that the configuration names.
    pub decoder: Option<Box<dyn DecoderProcess>>,
    /// Says what is meant in the place of the program that the configuration names (`intent_process`).
    pub intent: Option<Box<dyn IntentProcess>>,
}

/// Where the EMG of a trial comes from, and the model that was trained before, if one is given.
#[derive(Clone, Copy)]
pub struct EmgInput<'a> {
    /// Its stream.
    pub origin: &'a EmgOrigin,
    /// Its model; without one it is trained on the spot.
    pub trained: Option<&'a EmgModel>,
}

/// [`simulated_trial_with_model`](super::simulated_with) with parts of the caller's `own`. Without `emg` the gestures are given directly,
/// as by keys. The eye tracker of a participant of one's own is off by `gaze_error_deg`, degrees.
///
/// # Errors
/// [`AssemblyError`]; neither EMG nor a participant of one's own.
pub fn simulate_with(
    methods: &MethodRegistry,
    arm: &Arm,
    mut config: TrialConfig,
    emg: Option<EmgInput<'_>>,
    gaze_error_deg: f64,
    own: CustomParts,
) -> Result<Assembly, AssemblyError> {
    let (mut parts, classifier, findings) = match emg {
        Some(EmgInput { origin, trained }) => {
            let person = prepare_simulated_person(methods, arm, &mut config, origin, trained)?;
            (person.parts, Some(person.classifier), person.findings)
        }
        None if own.participant.is_none() => {
            return Err(ConfigError::UnusedSettings {
                key: "emg = none",
                why: "nobody gives gestures without it",
            }
            .into());
        }
        None => (PersonParts::default(), None, Vec::new()),
    };
    if own.participant.is_some() {
        // Who acts is not the participant of the configuration, whose habits would be recorded as if they had a part.
        (parts.participant, config.participant) = (own.participant, None);
        parts.gaze = Some(Box::new(SimulatedEyeTracker::new(gaze_error_deg, config.seed)?));
    }
    let worker = build_planner(arm.model(), &config)?;
    let plans = worker.log();
    let method =
        own.method.map_or_else(|| start_method(methods, &config, arm.model()), |own| Ok(Some(own)))?;
    let decoder =
        own.decoder.map_or_else(|| start_decoder(&config, classifier.as_ref()), |own| Ok(Some(own)))?;
    let intent = own.intent.map_or_else(|| intent_process::start(&config), |own| Ok(Some(own)))?;
    let plan_service = Box::new(worker);
    let testbed =
        build_testbed(methods, arm, config, plan_service, classifier.clone(), method, build_physics)?;
    let trial = RunningTrial::new(testbed.with_decoder(decoder).with_intent(intent), parts);
    Ok(Assembly { trial, classifier, arm: arm.clone(), plans, recording_faults: findings })
}
