//! From names to a trial's configuration, for commands and studies alike.

use crate::{Arm, heap::settle_heap, method_process::read_method_file, warn_of_renamed_keys};
use proact_control::{MethodProgram, MethodRegistry};
use proact_emg::EmgConfig;
use proact_intent::IntentProgram;
use proact_study::TrialOptions;
use proact_tasks::{BUILT_IN_TASKS, DEFAULT_TASK, TaskSpec};
use proact_testbed::{Setup, TrialConfig};
use proact_types::MAX_TEXT_BYTES;
use std::{error::Error, fs, io, path::Path};

/// The method of a trial that names none.
pub const DEFAULT_METHOD: &str = "D";
const DEFAULT_PROFILE: &str = "default";

/// What a trial's configuration needs beside the choice of names.
#[derive(Clone, Debug)]
pub struct TrialContext<'a> {
    /// Those that can be chosen.
    pub methods: &'a MethodRegistry,
    /// Where person and box are unless the choice says so.
    pub default_setup: &'a str,
    /// Of every random stream.
    pub seed: u64,
    /// Where the blocks stand, such as `FL,NM,NL,FM`; by the seed if left out.
    pub arrangement: Option<&'a str>,
    /// A program in the place of the method.
    pub process: Option<MethodProgram>,
    /// A program in the place of the intent model.
    pub intent: Option<IntentProgram>,
    /// Settings of the EMG stage that assignments to `emg` begin with.
    pub emg: Option<EmgConfig>,
}

/// The arm and the configuration of a trial.
///
/// # Errors
/// Names that do not exist, values out of range, an arm that cannot be used.
pub fn trial_config(
    choice: &TrialOptions,
    context: TrialContext<'_>,
) -> Result<(Arm, TrialConfig), Box<dyn Error>> {
    let TrialContext { methods, default_setup, seed, arrangement, process, intent, emg } = context;
    let or = |name: &Option<String>, default: &str| name.clone().unwrap_or_else(|| default.to_owned());
    let method = or(&choice.method, DEFAULT_METHOD);
    let arm = Arm::load(&or(&choice.arm, TrialConfig::DEFAULT_ARM))?;
    let setup = Setup::named(&or(&choice.setup, default_setup))?;
    let config = TrialConfig::new(&method, seed, setup);
    let config = match is_external_method_file(&method) {
        true => config.with_method(&read_method_file(Path::new(&method))?),
        false => config.with_method(methods.get(&method)?),
    };
    let task = resolve_task(&or(&choice.task, DEFAULT_TASK), seed, arrangement)?;
    let config = config.with_profile(&or(&choice.profile, DEFAULT_PROFILE))?.with_task(task)?;
    let mut config = config.with_arm(arm.pinned(), arm.model());
    config.limit_secs = choice.limit_secs.unwrap_or(config.limit_secs);
    if process.is_some() {
        config.method_process = process;
    }
    config.intent_process = intent;
    if sets_emg(&choice.set) {
        config.emg = emg;
    }
    config.check()?;
    let mut renamed = Vec::new();
    let overridden = config.with_overrides_noting(&choice.set, &mut renamed);
    warn_of_renamed_keys(&renamed);
    let mut config = overridden?;
    config.method_entry(methods)?;
    settle_heap(&mut config, arm.model())?;
    Ok((arm, config))
}

/// Whether the name of a method is that of an outside one's file.
pub(crate) fn is_external_method_file(method: &str) -> bool {
    Path::new(method).extension().is_some_and(|extension| extension == "toml")
}

/// Whether one of these assignments is to a setting of the EMG stage.
pub fn sets_emg(assignments: &[String]) -> bool {
    assignments.iter().any(|assignment| assignment.trim_start().starts_with("emg."))
}

/// The task that ships under this name, or the one in the file.
fn resolve_task(name: &str, seed: u64, arrangement: Option<&str>) -> Result<TaskSpec, Box<dyn Error>> {
    let shipped = BUILT_IN_TASKS.iter().any(|(other, _)| *other == name);
    let mut task = if shipped || !Path::new(name).is_file() {
        TaskSpec::named(name, seed)?
    } else {
        let failed = |error: io::Error| format!("{name}: {error}");
        let file = fs::File::open(name).map_err(failed)?;
        let text = proact_types::read_text(file, MAX_TEXT_BYTES).map_err(failed)?;
        TaskSpec::from_text(text).map_err(|error| format!("{name}: {error}"))?
    };
    if let Some(arrangement) = arrangement {
        task.set_arrangement(arrangement)?;
    }
    Ok(task)
}
