//! The options of a trial, the same for every command that begins one.

use clap::Args;
use proact_app::Arm;
use proact_emg::EmgConfig;
use proact_tasks::Arrangement;
use proact_testbed::{MethodName, MethodProcessConfig, Setup, TrialConfig};
use std::error::Error;

/// What a trial is, on the command line.
#[derive(Clone, Debug, Args)]
pub(crate) struct TrialArgs {
    /// Control method: A joint by joint, B end-effector, C gaze, D gaze and context
    #[arg(long, default_value = "D")]
    method: MethodName,
    /// How the methods behave: default, or original for the numbers of the first testbed
    #[arg(long, default_value = "default")]
    profile: String,
    /// The arm: mpl_right_arm, mpl_left_arm, or a folder with the URDF and SRDF of one's own (docs/arms.md)
    #[arg(long, value_name = "NAME|FOLDER", default_value = TrialConfig::DEFAULT_ARM)]
    arm: String,
    /// Seed of every random stream of the trial; in serve, each restart counts it up
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    seed: u64,
    /// Where person and box are: seated or still; by default seated, in serve still
    #[arg(long)]
    setup: Option<String>,
    /// Where the blocks stand: red1,red2,blue1,blue2 such as FL,NM,NL,FM; by default from the seed
    #[arg(long)]
    arrangement: Option<Arrangement>,
    /// Another program in the place of the method; it reads and writes JSON lines (docs/methods)
    #[arg(long, value_name = "PROGRAM ARGS")]
    method_command: Option<String>,
    /// Another value of the trial configuration, such as profile.level=below_elbow; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

impl TrialArgs {
    /// The arm and the configuration, in the set-up `default_setup` unless another was asked for. `emg` are the settings
    /// of the EMG stage that assignments begin with.
    ///
    /// # Errors
    /// Names that do not exist, values out of range, an arm that cannot be used.
    pub(crate) fn config(
        &self,
        default_setup: &str,
        emg: Option<EmgConfig>,
    ) -> Result<(Arm, TrialConfig), Box<dyn Error>> {
        let arm = Arm::named(&self.arm)?;
        let setup = Setup::named(self.setup.as_deref().unwrap_or(default_setup))?;
        let mut config = TrialConfig::new(self.method, self.seed, setup).with_profile(&self.profile)?;
        config.arrangement = self.arrangement.unwrap_or(config.arrangement);
        config.method_process = self
            .method_command
            .as_ref()
            .map(|command| MethodProcessConfig::new(command.split_whitespace().map(str::to_owned).collect()));
        config.arm = arm.pinned();
        if self.sets_emg() {
            config.emg = emg;
        }
        config.check()?;
        Ok((arm, config.with_values(&self.set)?))
    }

    /// Whether a setting of the EMG stage is asked for.
    pub(crate) fn sets_emg(&self) -> bool {
        self.set.iter().any(|assignment| assignment.trim_start().starts_with("emg."))
    }

    /// What is asked for when a page begins another trial: by `method` if it chose one, with the same blocks `again`
    /// or those of the next seed. There is one method at a time: one that the page chose takes the place of another
    /// program.
    pub(crate) fn next(self, method: Option<MethodName>, again: bool) -> Self {
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
            method: MethodName::A,
            profile: "default".into(),
            arm: TrialConfig::DEFAULT_ARM.into(),
            seed: 5,
            setup: None,
            arrangement: None,
            method_command: Some("python3 method.py".into()),
            set: vec![],
        };
        // A program stands in the place of the method that was named beside it.
        let config = asked.config("still", None)?.1;
        let process = config.method_process.clone().expect("a program was named");
        assert_eq!(process.command, ["python3", "method.py"]);
        assert_ne!(config.method_label(), "A");
        // It stays when the page begins anew, and leaves when the page chooses a method.
        assert_eq!(asked.clone().next(None, true).config("still", None)?.1, config);
        let chosen = asked.next(Some(MethodName::B), false).config("still", None)?.1;
        assert_eq!((chosen.method_process, chosen.method.to_string(), chosen.seed), (None, "B".into(), 6));
        assert!(config.to_toml()?.contains("method.py"));
        Ok(())
    }
}
