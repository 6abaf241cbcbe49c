//! The options of a trial, the same for every command that begins one.

use clap::Args;
use proact_app::{Arm, TrialContext, sets_emg, study::shipped_trial_options, trial_config};
use proact_control::{MethodProgram, MethodRegistry};
use proact_emg::EmgConfig;
use proact_intent::IntentProgram;
use proact_study::TrialOptions;
use proact_testbed::TrialConfig;
use std::error::Error;

/// What a trial is, on the command line.
#[derive(Clone, Debug, Args)]
pub(crate) struct TrialArgs {
    /// A set-up like another system's, such as minivie, or NAME:CONDITION of a plan that ships with the program; the options below go before it
    #[arg(long, value_name = "NAME")]
    like: Option<String>,
    /// Control method by its name, or the TOML file of an outside one (docs/methods) [default: D]
    #[arg(long, value_name = "NAME|FILE")]
    method: Option<String>,
    /// How the methods behave: default, or original for the numbers of the first testbed
    #[arg(long)]
    profile: Option<String>,
    /// The arm: one that ships with the program, such as mpl_left, or the folder of one's own (docs/arms.md) [default: mpl_right]
    #[arg(long, value_name = "NAME|FOLDER")]
    arm: Option<String>,
    /// Seed of every random stream of the trial; in serve, each restart counts it up
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    seed: u64,
    /// Where person and box are: seated or still; by default seated, in serve still
    #[arg(long)]
    setup: Option<String>,
    /// The task: modified_bbt, targeted_bbt, bbt, or a file that describes one (docs/extending.md) [default: modified_bbt]
    #[arg(long, value_name = "NAME|FILE")]
    task: Option<String>,
    /// Seconds after which the trial ends; by default what the task says
    #[arg(long, value_name = "SECONDS")]
    time_limit: Option<f64>,
    /// Where the blocks of modified_bbt stand: red1,red2,blue1,blue2 such as FL,NM,NL,FM; by default from the seed
    #[arg(long)]
    arrangement: Option<String>,
    /// Another program in the place of the method; it reads and writes JSON lines (docs/methods)
    #[arg(long, value_name = "PROGRAM ARGS")]
    method_command: Option<String>,
    /// A program that says what the person means, in the place of the model; it reads and writes JSON lines (docs/intent.md)
    #[arg(long, value_name = "PROGRAM ARGS")]
    intent_command: Option<String>,
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
        let choice = self.trial_options()?;
        let words = |command: &String| command.split_whitespace().map(str::to_owned).collect();
        let process = self.method_command.as_ref().map(|command| MethodProgram::new(words(command)));
        let intent = self.intent_command.as_ref().map(|command| IntentProgram::new(words(command)));
        let (seed, arrangement) = (self.seed, self.arrangement.as_deref());
        trial_config(
            &choice,
            TrialContext { methods, default_setup, seed, arrangement, process, intent, emg },
        )
    }

    /// What was asked for, over what the set-up says that it should be like.
    fn trial_options(&self) -> Result<TrialOptions, Box<dyn Error>> {
        let own = TrialOptions {
            method: self.method.clone(),
            task: self.task.clone(),
            arm: self.arm.clone(),
            setup: self.setup.clone(),
            profile: self.profile.clone(),
            limit_secs: self.time_limit,
            instruction: None,
            set: self.set.clone(),
        };
        Ok(match &self.like {
            Some(name) => own.with_defaults_from(&shipped_trial_options(name)?),
            None => own,
        })
    }

    /// Whether a setting of the EMG stage is asked for.
    ///
    /// # Errors
    /// A set-up that does not exist.
    pub(crate) fn sets_emg(&self) -> Result<bool, Box<dyn Error>> {
        Ok(sets_emg(&self.trial_options()?.set))
    }

    /// What is asked for when a page begins another trial: by `method` if it chose one, with the same blocks `again`
    /// or those of the next seed. There is one method at a time: one that the page chose takes the place of another
    /// program.
    pub(crate) fn next_trial(self, method: Option<String>, again: bool) -> Self {
        let method_command = self.method_command.filter(|_| method.is_none());
        let (method, seed) = (method.or(self.method), self.seed + u64::from(!again));
        Self { method, seed, method_command, ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_two_methods_one_has_the_say_and_the_record_tells_which() -> Result<(), Box<dyn Error>> {
        let args = TrialArgs {
            method: Some("A".to_owned()),
            like: None,
            profile: None,
            arm: None,
            seed: 5,
            setup: None,
            task: None,
            time_limit: None,
            arrangement: None,
            method_command: Some("python3 method.py".into()),
            intent_command: None,
            set: vec![],
        };
        // A program stands in the place of the method that was named beside it.
        let config = args.config(&MethodRegistry::standard(), "still", None)?.1;
        let process = config.method_process.clone().expect("a program was named");
        assert_eq!(process.command, ["python3", "method.py"]);
        assert_ne!(config.method_label(), "A");
        // It stays when the page begins anew, and leaves when the page chooses a method.
        assert_eq!(
            args.clone().next_trial(None, true).config(&MethodRegistry::standard(), "still", None)?.1,
            config
        );
        let chosen = args
            .next_trial(Some("B".to_owned()), false)
            .config(&MethodRegistry::standard(), "still", None)?
            .1;
        assert_eq!((chosen.method_process, chosen.method.to_string(), chosen.seed), (None, "B".into(), 6));
        assert!(config.to_toml()?.contains("method.py"));
        Ok(())
    }

    #[test]
    fn a_set_up_is_like_another_system_but_for_what_is_asked() -> Result<(), Box<dyn Error>> {
        #[derive(clap::Parser)]
        struct Line {
            #[command(flatten)]
            trial: TrialArgs,
        }
        let parse = |words: &str| {
            let line = <Line as clap::Parser>::try_parse_from(words.split(' '))?;
            line.trial.config(&MethodRegistry::standard(), "still", None)
        };
        let (_, config) = parse("demo --like holopham")?;
        assert_eq!(
            (config.method.to_string(), config.task.name.clone()),
            ("C".into(), "frame_transfer".into())
        );
        let (_, config) = parse("demo --like minivie:end_point --task bbt --arm mpl_left")?;
        assert_eq!((config.method.to_string(), config.task.name.clone()), ("B".into(), "bbt".into()));
        assert_eq!(config.arm.name, "mpl_left");
        for (words, part) in
            [("demo --like nothing", "minivie"), ("demo --like vie:nothing", "end_point, joints")]
        {
            let error = parse(words).map(|_| ()).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
        Ok(())
    }
}
