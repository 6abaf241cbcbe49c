use crate::trial::{self, AssemblyError};
use proact_devices::EmgOrigin;
use proact_testbed::{ConfigError, Digest, Setup, SpanDigest, TrialConfig};
use serde::{Deserialize, Serialize};
use std::error::Error;

/// A trial of the list, on the command line of `proact demo --headless`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrialEntry {
    /// Its name in files and messages: no blanks.
    pub name: String,
    method: String,
    setup: String,
    #[serde(default = "TrialEntry::default_profile")]
    profile: String,
    seed: u64,
    #[serde(default)]
    set: Vec<String>,
}

impl TrialEntry {
    fn default_profile() -> String {
        "default".to_owned()
    }

    fn config(&self) -> Result<TrialConfig, ConfigError> {
        let setup = Setup::named(&self.setup)?;
        let config = TrialConfig::new(&self.method, self.seed, setup).with_profile(&self.profile)?;
        config.with_overrides(&self.set)
    }

    /// Runs the trial.
    ///
    /// # Errors
    /// A configuration that is refused, a trial that breaks off; with the trial's name.
    pub fn run(&self) -> Result<TrialDigest, Box<dyn Error>> {
        let named = |error: &dyn Error| format!("trial {}: {error}", self.name);
        let config = self.config().map_err(|error| named(&error))?;
        let assembled: Result<_, AssemblyError> = trial::simulated_trial(config, &EmgOrigin::Synthetic);
        let mut trial = assembled.map_err(|error| named(&error))?.trial;
        let configuration = trial.testbed().config().to_toml()?;
        let mut spans = Vec::new();
        loop {
            let output = trial.step(false).map_err(|error| named(&error))?.output;
            spans.extend(output.span_digest);
            if output.finished {
                break;
            }
        }
        let testbed = trial.testbed();
        let blocks = &testbed.plant().state().objects;
        let scene = testbed.task().scene();
        let result = trial.result();
        // What the task says of each object, in its order; of one that says nothing, all objects in theirs.
        let object_results = proact_tasks::object_results(&result.result).map_err(|error| named(&error))?;
        let mut lines: Vec<(String, String)> =
            object_results.into_iter().map(|line| (line.block, line.outcome.as_str().to_owned())).collect();
        if lines.is_empty() {
            lines = scene.ids().map(|id| (scene.name(id), "-".to_owned())).collect();
        }
        let block_end = |(name, outcome): (String, String)| BlockOutcome {
            position_mm: scene.find_object(&name).map_or([0; 3], |id| {
                let position = blocks[id.index()].pose.translation.vector;
                std::array::from_fn(|k| (position[k] * 1e3).round() as i64)
            }),
            name,
            outcome,
        };
        Ok(TrialDigest {
            outcome: TrialOutcome {
                trial: self.name.clone(),
                ticks: testbed.now().0,
                on_target: result.score as u32,
                blocks: lines.into_iter().map(block_end).collect(),
            },
            configuration: Digest::new(&configuration).value()[..16].to_owned(),
            spans,
        })
    }
}

/// What is known of a trial that was run.
#[derive(Clone, Debug, PartialEq)]
pub struct TrialDigest {
    /// How it ended.
    pub outcome: TrialOutcome,
    /// Hash of its configuration, 16 hexadecimal digits.
    pub configuration: String,
    /// One hash a field for each span. The chain is left out of files and comparisons.
    pub spans: Vec<SpanDigest>,
}

/// How a trial ended: on every platform about the same.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrialOutcome {
    /// Name of the trial.
    pub trial: String,
    /// Its length, ms.
    pub ticks: u64,
    /// What the task counts.
    pub on_target: u32,
    /// The objects in the order of the task.
    pub blocks: Vec<BlockOutcome>,
}

/// Where a block ended.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BlockOutcome {
    /// Such as `red1`.
    pub name: String,
    /// What became of it.
    pub outcome: String,
    /// Its centre, `world`, millimetres.
    #[serde(rename = "place_mm")]
    pub position_mm: [i64; 3],
}
