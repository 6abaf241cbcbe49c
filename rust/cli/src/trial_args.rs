//! The options of a trial, the same for every command that begins one.

use clap::Args;
use proact_app::{Arm, DEFAULT_METHOD, TrialContext, sets_emg, trial_config};
use proact_control::{MethodProgram, MethodRegistry};
use proact_emg::EmgConfig;
use proact_study::TrialChoice;
use proact_tasks::DEFAULT_TASK;
use proact_testbed::TrialConfig;
use std::error::Error;

/// What a trial is, on the command line.
#[derive(Clone, Debug, Args)]
pub(crate) struct TrialArgs {
    /// Control method by its name, or the TOML file of an outside one (docs/methods)
    #[arg(long, value_name = "NAME|FILE", default_value = DEFAULT_METHOD)]
    method: String,
    /// How the methods behave: default, or original for the numbers of the first testbed
    #[arg(long, default_value = "default")]
    profile: String,
    /// The arm: one that ships with the program, such as mpl_left, or the folder of one's own (docs/arms.md)
    #[arg(long, value_name = "NAME|FOLDER", default_value = TrialConfig::DEFAULT_ARM)]
    arm: String,
    /// Seed of every random stream of the trial; in serve, each restart counts it up
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    seed: u64,
    /// Where person and box are: seated or still; by default seated, in serve still
    #[arg(long)]
    setup: Option<String>,
    /// The task: modified_bbt, targeted_bbt, bbt, or a file that describes one (docs/extending.md)
    #[arg(long, value_name = "NAME|FILE", default_value = DEFAULT_TASK)]
    task: String,
    /// Seconds after which the trial ends; by default what the task says
    #[arg(long, value_name = "SECONDS")]
    limit: Option<f64>,
    /// Where the blocks of modified_bbt stand: red1,red2,blue1,blue2 such as FL,NM,NL,FM; by default from the seed
    #[arg(long)]
    arrangement: Option<String>,
    /// Another program in the place of the method; it reads and writes JSON lines (docs/methods)
    #[arg(long, value_name = "PROGRAM ARGS")]
    method_command: Option<String>,
    /// Another value of the trial configuration, such as profile.level=below_elbow; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

impl TrialArgs {
    /// The arm and the configuration, by one of `methods`, in the set-up `default_setup` unless another was asked for. `emg` are the settings
    /// of the EMG stage that assignments begin with.
    ///
    /// # Errors
    /// Names that do not exist, values out of range, an arm that cannot be used.
    pub(crate) fn config(
        &self,
        methods: &MethodRegistry,
        default_setup: &str,
        emg: Option<EmgConfig>,
    ) -> Result<(Arm, TrialConfig), Box<dyn Error>> {
        let choice = TrialChoice {
            method: Some(self.method.clone()),
            task: Some(self.task.clone()),
            arm: Some(self.arm.clone()),
            setup: self.setup.clone(),
            profile: Some(self.profile.clone()),
            limit_secs: self.limit,
            instruction: None,
            set: self.set.clone(),
        };
        let process = self
            .method_command
            .as_ref()
            .map(|command| MethodProgram::new(command.split_whitespace().map(str::to_owned).collect()));
        let (seed, arrangement) = (self.seed, self.arrangement.as_deref());
        trial_config(&choice, TrialContext { methods, default_setup, seed, arrangement, process, emg })
    }

    /// Whether a setting of the EMG stage is asked for.
    pub(crate) fn sets_emg(&self) -> bool {
        sets_emg(&self.set)
    }

    /// What is asked for when a page begins another trial: by `method` if it chose one, with the same blocks `again`
    /// or those of the next seed. There is one method at a time: one that the page chose takes the place of another
    /// program.
    pub(crate) fn next(self, method: Option<String>, again: bool) -> Self {
        let method_command = self.method_command.filter(|_| method.is_none());
        let (method, seed) = (method.unwrap_or(self.method), self.seed + u64::from(!again));
        Self { method, seed, method_command, ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_two_methods_one_has_the_say_and_the_record_tells_which() -> Result<(), Box<dyn Error>> {
        let asked = TrialArgs {
            method: "A".to_owned(),
            profile: "default".into(),
            arm: TrialConfig::DEFAULT_ARM.into(),
            seed: 5,
            setup: None,
            task: DEFAULT_TASK.into(),
            limit: None,
            arrangement: None,
            method_command: Some("python3 method.py".into()),
            set: vec![],
        };
        // A program stands in the place of the method that was named beside it.
        let config = asked.config(&MethodRegistry::standard(), "still", None)?.1;
        let process = config.method_process.clone().expect("a program was named");
        assert_eq!(process.command, ["python3", "method.py"]);
        assert_ne!(config.method_label(), "A");
        // It stays when the page begins anew, and leaves when the page chooses a method.
        assert_eq!(
            asked.clone().next(None, true).config(&MethodRegistry::standard(), "still", None)?.1,
            config
        );
        let chosen =
            asked.next(Some("B".to_owned()), false).config(&MethodRegistry::standard(), "still", None)?.1;
        assert_eq!((chosen.method_process, chosen.method.to_string(), chosen.seed), (None, "B".into(), 6));
        assert!(config.to_toml()?.contains("method.py"));
        Ok(())
    }
}
