use crate::{ConfigError, MotionConfig, PhysicsConfig, Pinned, PlannerOptions};
use proact_arm::ArmModel;
use proact_control::{OUTSIDE, Profile};
use proact_emg::EmgConfig;
use proact_intent::{IntentModelName, IntentOptions};
use proact_participants::{Body, ParticipantOptions};
use proact_tasks::{Arrangement, BoxAndBlocks};
use serde::{Deserialize, Serialize};
use std::{fmt, str::FromStr};

/// Gestures are given directly, until a source of them is named.
const KEYS: &str = "keys";

/// Most words of a key of the configuration; there are four in `profile.end_effector_jog.inverse.kind`.
const DEEPEST_KEY: usize = 8;

/// The control methods there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum MethodName {
    /// Joint by joint.
    A,
    /// End-effector, axis by axis.
    B,
    /// Gaze-selected targets with motion planning.
    C,
    /// The same with the task's order as context.
    D,
}

impl MethodName {
    /// All of them.
    pub const ALL: [MethodName; 4] = [MethodName::A, MethodName::B, MethodName::C, MethodName::D];

    pub(crate) fn known() -> String {
        Self::ALL.map(|m| m.to_string()).join(", ")
    }
}

impl fmt::Display for MethodName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{self:?}")
    }
}

impl FromStr for MethodName {
    type Err = ConfigError;

    fn from_str(text: &str) -> Result<Self, ConfigError> {
        Self::ALL
            .into_iter()
            .find(|m| m.to_string() == text)
            .ok_or_else(|| ConfigError::Method { got: text.to_owned() })
    }
}

/// Where person and box are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Setup {
    /// Shown on the page and written to the result.
    pub name: String,
    /// The person.
    pub body: Body,
}

impl Setup {
    /// The set-up called `name`: `seated` or `still`.
    ///
    /// # Errors
    /// [`ConfigError::Setup`] for any other name.
    pub fn named(name: &str) -> Result<Self, ConfigError> {
        let text = match name {
            "seated" => include_str!("../data/setups/seated.toml"),
            "still" => include_str!("../data/setups/still.toml"),
            _ => return Err(ConfigError::Setup { got: name.to_owned() }),
        };
        toml::from_str(text).map_err(|e| ConfigError::Text(e.to_string()))
    }
}

/// A control method in another process, which speaks JSON lines (`docs/methods`).
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MethodProcessConfig {
    /// The program and its arguments. A trial that is run starts it; a replay does not.
    pub command: Vec<String>,
    /// A live step without an answer after this time holds the arm, milliseconds. A batch waits for each answer.
    #[serde(default = "MethodProcessConfig::default_deadline")]
    pub deadline_ms: u64,
}

impl MethodProcessConfig {
    /// `command` with the default deadline.
    pub fn new(command: Vec<String>) -> Self {
        Self { command, deadline_ms: Self::default_deadline() }
    }

    /// A control step is due every 10 ms; the rest of the tick needs its time too.
    fn default_deadline() -> u64 {
        5
    }
}

/// Everything that a trial depends on, apart from its inputs. Written to the trial directory as `config.toml`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrialConfig {
    /// Control method.
    pub method: MethodName,
    /// Every random stream of the trial is derived from it.
    pub seed: u64,
    /// Where the blocks stand at the start.
    pub arrangement: Arrangement,
    /// Time limit, seconds (paper: 300).
    pub limit_secs: f64,
    /// From a plan request to its effect, milliseconds.
    pub plan_latency_ms: u64,
    /// True in batch: the tick at which a plan is due waits for it. False live: a late plan acts when it comes.
    pub wait_for_plans: bool,
    /// Time constant of the filter on the place marker, milliseconds.
    pub place_filter_ms: u64,
    /// Where the gestures come from, as shown: `recording`, `synthetic`, `keys`.
    pub gesture_source: String,
    /// Zero level of each EMG channel, subtracted before anything else; empty for a stream that is centred.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub emg_centring: Vec<f64>,
    /// How is inferred what the person means: the paper's product of gaze and task, or another model.
    #[serde(default)]
    pub intent_model: IntentModelName,
    /// The arm.
    #[serde(default = "TrialConfig::default_arm")]
    pub arm: Pinned,
    /// The task.
    #[serde(default = "TrialConfig::default_task")]
    pub task: Pinned,
    /// The arm's weight, its control, and the grasp rule.
    #[serde(default)]
    pub physics: PhysicsConfig,
    /// How fast hand, shoulder and limb follow.
    #[serde(default)]
    pub motion: MotionConfig,
    /// The planner of methods C and D.
    #[serde(default)]
    pub planner: PlannerOptions,
    /// Where person and box are.
    pub setup: Setup,
    /// Another process drives the arm in the place of `method`, which says no more than what the posterior knows and
    /// how a simulated participant acts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub method_process: Option<MethodProcessConfig>,
    /// How the methods behave.
    pub profile: Profile,
    /// Inference of what the person means.
    pub intent: IntentOptions,
    /// The EMG stage; none when gestures come from keys.
    pub emg: Option<EmgConfig>,
    /// The simulated participant; none when a person drives.
    pub participant: Option<ParticipantOptions>,
}

impl TrialConfig {
    /// The default configuration for `method`, `seed` and `setup`; the arrangement follows from the seed.
    pub fn new(method: MethodName, seed: u64, setup: Setup) -> Self {
        // SplitMix64's finaliser spreads neighbouring seeds over the 24 arrangements.
        let mut z = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        let number = ((z ^ (z >> 31)) % 24) as usize + 1;
        let profile = Profile::named("default").expect("ships with the program and is tested there");
        Self {
            method,
            seed,
            profile,
            arrangement: Arrangement::numbered(number).expect("a number from 1 to 24"),
            limit_secs: 300.0,
            plan_latency_ms: 50,
            wait_for_plans: true,
            place_filter_ms: 150,
            gesture_source: KEYS.to_owned(),
            emg_centring: Vec::new(),
            intent_model: IntentModelName::default(),
            arm: Self::default_arm(),
            task: Self::default_task(),
            physics: PhysicsConfig::default(),
            motion: MotionConfig::default(),
            planner: PlannerOptions::default(),
            setup,
            method_process: None,
            intent: IntentOptions::default(),
            emg: None,
            participant: None,
        }
    }

    /// The name of the arm unless another one is asked for.
    pub const DEFAULT_ARM: &str = "mpl_right_arm";

    fn default_arm() -> Pinned {
        Pinned::named(Self::DEFAULT_ARM)
    }

    fn default_task() -> Pinned {
        Pinned::named(BoxAndBlocks::NAME)
    }

    /// Takes `model` for the arm, and the task that there is.
    ///
    /// # Errors
    /// [`ConfigError::OtherName`], [`ConfigError::OtherContent`].
    pub(crate) fn pin(&mut self, model: &ArmModel) -> Result<(), ConfigError> {
        self.arm.pin("arm", &model.name, model)?;
        self.task.pin("task", BoxAndBlocks::NAME, &BoxAndBlocks::content())
    }

    /// The same for a trial that goes by the clock: a late plan acts when it comes, and none may be later than
    /// [`TrialConfig::LIVE_DEADLINE_SECS`] unless the planner has another deadline.
    pub fn live(mut self) -> Self {
        self.wait_for_plans = false;
        self.planner.deadline_secs.get_or_insert(Self::LIVE_DEADLINE_SECS);
        self
    }

    /// Time within which a plan is there while a person waits, seconds: twice what the original gave one attempt.
    pub const LIVE_DEADLINE_SECS: f64 = 1.0;

    /// The zero levels of the EMG stream, which belong to it.
    ///
    /// # Errors
    /// [`ConfigError::Value`] if the configuration has others.
    pub fn centred_by(&mut self, levels: Vec<f64>) -> Result<(), ConfigError> {
        if !self.emg_centring.is_empty() && self.emg_centring != levels {
            return Err(ConfigError::Value {
                key: "emg_centring",
                got: format!("{:?}", self.emg_centring),
                expected: "none: they come with the stream, or with the model that was trained on it",
            });
        }
        self.emg_centring = levels;
        Ok(())
    }

    /// Where the gestures of the trial come from, as shown.
    ///
    /// # Errors
    /// [`ConfigError::Value`] if the configuration names another source.
    pub fn gestures_from(&mut self, source: &str) -> Result<(), ConfigError> {
        if self.gesture_source != source && self.gesture_source != KEYS {
            return Err(ConfigError::Value {
                key: "gesture_source",
                got: format!("{:?}", self.gesture_source),
                expected: "none: the trial says itself where its gestures come from",
            });
        }
        self.gesture_source = source.to_owned();
        Ok(())
    }

    /// The same with the profile called `name`: `default`, or `original`, which brings the original's spread of
    /// gaze, its change of colour, its engine, its joint controllers and its grasp rule along.
    ///
    /// # Errors
    /// [`ConfigError::Control`] for any other name.
    pub fn with_profile(mut self, name: &str) -> Result<Self, ConfigError> {
        self.profile = Profile::named(name)?;
        if name == "original" {
            self.intent.sigma = 0.1;
            self.intent.changes_at_grasp = true;
            self.physics = PhysicsConfig::ORIGINAL;
        }
        Ok(self)
    }

    /// Reads and checks a configuration.
    ///
    /// # Errors
    /// Unreadable text, unknown keys, values out of range.
    pub fn from_toml(text: &str) -> Result<Self, ConfigError> {
        let config: Self = toml::from_str(text).map_err(|error| {
            let line = error.span().map_or(1, |span| text[..span.start].matches('\n').count() + 1);
            ConfigError::Text(format!("line {line}: {}", error.message().replace('`', "")))
        })?;
        config.check()?;
        Ok(config)
    }

    /// The same with other values, each as `key=value`: the key as in the text of the configuration, with a dot for
    /// each table, the value as there; a word needs no quotes, and no value leaves the key out.
    ///
    /// # Errors
    /// [`ConfigError::Assignment`] for what is no assignment, otherwise as [`TrialConfig::from_toml`].
    pub fn with_values<S: AsRef<str>>(&self, assignments: &[S]) -> Result<Self, ConfigError> {
        let mut whole: toml::Table =
            toml::from_str(&self.to_toml()?).map_err(|e| ConfigError::Text(e.to_string()))?;
        for assignment in assignments.iter().map(AsRef::as_ref) {
            let wrong = || ConfigError::Assignment { got: assignment.to_owned() };
            let (key, value) = assignment.split_once('=').ok_or_else(wrong)?;
            let (key, value_text) = (key.trim(), value.trim());
            if key.split('.').count() > DEEPEST_KEY {
                return Err(wrong());
            }
            // A bare word is text; anything else is what TOML says.
            let read = |text: &str| toml::from_str::<toml::Table>(&format!("value = {text}")).ok();
            let value = read(value_text).and_then(|mut table| table.remove("value"));
            let value = value.unwrap_or_else(|| toml::Value::String(value_text.to_owned()));
            let (tables, name) =
                key.rsplit_once('.').map_or((None, key), |(tables, name)| (Some(tables), name));
            let mut table = &mut whole;
            for step in tables.into_iter().flat_map(|tables| tables.split('.')) {
                let inner = table.entry(step).or_insert_with(|| toml::Value::Table(toml::Table::new()));
                table = inner.as_table_mut().ok_or_else(wrong)?;
            }
            if value_text.is_empty() {
                table.remove(name);
            } else {
                table.insert(name.to_owned(), value);
            }
        }
        let text = whole.to_string();
        let config: Self = toml::from_str(&text).map_err(|error| {
            // Where it stands in a text that nobody has seen tells nothing; which assignment it is does.
            let reason = error.message().replace('`', "");
            let given = assignments.iter().map(AsRef::as_ref);
            ConfigError::Assigned { got: given.collect::<Vec<&str>>().join(", "), reason }
        })?;
        config.check()?;
        Ok(config)
    }

    /// Options of the intent model. Methods but D leave the task out.
    pub fn intent_options(&self) -> IntentOptions {
        let weight_other = if self.method == MethodName::D { self.intent.weight_other } else { 0.25 };
        IntentOptions { weight_other, ..self.intent }
    }

    /// What the method is called in results and records.
    pub fn method_label(&self) -> String {
        if self.method_process.is_some() { OUTSIDE.to_owned() } else { self.method.to_string() }
    }

    /// The text that [`TrialConfig::from_toml`] reads.
    ///
    /// # Errors
    /// A seed above 2^63 - 1, the largest integer that TOML holds.
    pub fn to_toml(&self) -> Result<String, ConfigError> {
        toml::to_string_pretty(self).map_err(|e| ConfigError::Text(e.to_string()))
    }

    /// Checks ranges.
    ///
    /// # Errors
    /// [`ConfigError::Value`] naming the first key that is out of range.
    pub fn check(&self) -> Result<(), ConfigError> {
        let bad = |key, got: String, expected| Err(ConfigError::Value { key, got, expected });
        if !(self.limit_secs > 0.0 && self.limit_secs <= 3600.0) {
            return bad("limit_secs", self.limit_secs.to_string(), "more than 0 and at most 3600");
        }
        if !(1..=10_000).contains(&self.plan_latency_ms) {
            return bad("plan_latency_ms", self.plan_latency_ms.to_string(), "1 to 10000");
        }
        if self.place_filter_ms > 10_000 {
            return bad("place_filter_ms", self.place_filter_ms.to_string(), "0 to 10000");
        }
        self.physics.check()?;
        self.motion.check()?;
        self.planner.check()?;
        if let Some(process) = &self.method_process {
            if process.command.first().is_none_or(|program| program.is_empty()) {
                return bad(
                    "method_process.command",
                    format!("{:?}", process.command),
                    "a program's name first",
                );
            }
            if !(1..=1000).contains(&process.deadline_ms) {
                return bad("method_process.deadline_ms", process.deadline_ms.to_string(), "1 to 1000");
            }
        }
        self.profile.check()?;
        self.intent.check()?;
        self.setup.body.check()?;
        if let Some(level) = self.emg_centring.iter().find(|level| !level.is_finite()) {
            return bad("emg_centring", level.to_string(), "finite numbers");
        }
        if let Some(emg) = &self.emg {
            emg.check()?;
        }
        if let Some(participant) = &self.participant {
            participant.check()?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Engine, MassSet};

    fn config() -> TrialConfig {
        TrialConfig::new(MethodName::D, 3, Setup::named("seated").expect("ships"))
    }

    #[test]
    fn a_configuration_survives_its_text() {
        for name in ["seated", "still"] {
            let config = TrialConfig { setup: Setup::named(name).expect("ships"), ..config() };
            assert_eq!(TrialConfig::from_toml(&config.to_toml().expect("writes")), Ok(config));
        }
    }

    #[test]
    fn the_intent_model_is_part_of_the_configuration_and_older_ones_mean_the_product() {
        let text = config().to_toml().expect("writes");
        let line = "intent_model = \"product\"\n";
        assert_eq!(TrialConfig::from_toml(&text.replace(line, "")), Ok(config()));
        let filtered = TrialConfig::from_toml(&text.replace(line, "intent_model = \"filtered\"\n"));
        assert_eq!(filtered.expect("reads").intent_model, IntentModelName::Filtered);
        assert!(TrialConfig::from_toml(&text.replace(line, "intent_model = \"guess\"\n")).is_err());
        assert_eq!(config().intent_options(), config().intent);
        let c = TrialConfig { method: MethodName::C, ..config() };
        assert_eq!(c.intent_options().weight_other, 0.25, "C knows nothing of the task");
    }

    #[test]
    fn the_physics_is_part_of_the_text_and_a_text_without_it_means_the_default() {
        for mass_set in [MassSet::Description, MassSet::RealLimb, MassSet::Scaled(2.5)] {
            let physics = PhysicsConfig { mass_set, ..PhysicsConfig::ORIGINAL };
            let config = TrialConfig { physics, ..config() };
            let text = config.to_toml().expect("writes");
            assert!(text.contains("[physics") && text.contains("original_gains"), "{text}");
            assert_eq!(TrialConfig::from_toml(&text), Ok(config));
        }
        let text = config().to_toml().expect("writes");
        let (before, after) = text.split_once("[physics]").expect("is written");
        let (_, after) = after.split_once("\n[").expect("a section follows");
        assert_eq!(TrialConfig::from_toml(&format!("{before}[{after}")), Ok(config()));
        for factor in [0.0, -1.0, f64::NAN, 1000.0] {
            let physics = PhysicsConfig { mass_set: MassSet::Scaled(factor), ..PhysicsConfig::default() };
            let refused = TrialConfig { physics, ..config() }.check().expect_err("out of range");
            assert!(refused.to_string().contains("mass_set.scaled"), "{refused}");
        }
        let original = config().with_profile("original").expect("ships");
        assert_eq!(original.physics, PhysicsConfig::ORIGINAL);
        assert!(original.intent.sigma == 0.1 && original.intent.changes_at_grasp);
    }

    #[test]
    fn the_engine_is_part_of_the_text_and_an_unknown_one_is_told_with_those_that_there_are() {
        let text = config().to_toml().expect("writes");
        assert!(text.contains("engine = \"reduced\""), "{text}");
        let ode = config().with_values(&["physics.engine=ode"]).expect("is known");
        assert_eq!(ode.physics.engine, Engine::Ode);
        assert_eq!(TrialConfig::from_toml(&ode.to_toml().expect("writes")), Ok(ode));
        assert_eq!(config().with_values(&["physics.engine=reduced"]), Ok(config()));
        let refused = config().with_values(&["physics.engine=bullet"]).expect_err("unknown").to_string();
        assert!(refused.contains("unknown variant bullet, expected reduced or ode"), "{refused}");
    }

    #[test]
    fn unknown_names_and_keys_and_values_out_of_range_are_refused_with_what_is_expected() {
        let error = "E".parse::<MethodName>().expect_err("no method E");
        assert_eq!(error.to_string(), "method \"E\" is unknown; expected one of A, B, C, D");
        assert!(Setup::named("standing").is_err());
        let text = config().to_toml().expect("writes");
        let error = TrialConfig::from_toml(&format!("colour = 3\n{text}")).expect_err("an unknown key");
        let expected =
            "the trial configuration is unreadable: line 1: unknown field colour, expected one of method, ";
        assert!(error.to_string().starts_with(expected), "{error}");
        assert!(!error.to_string().contains('\n'), "{error}");
        let other =
            config().with_values(&["planner.parameters.range=0.4"]).expect("a number is text to OMPL");
        assert_eq!(other.planner.parameters["range"], "0.4");
        let deep = format!("setup{}=1", ".body".repeat(20_000));
        let error = config().with_values(&[deep]).expect_err("no such key").to_string();
        assert!(error.contains("sets nothing"), "{error}");
        let emg = TrialConfig { emg: Some(EmgConfig::default()), ..config() };
        for assignment in ["emg_centring=[nan]", "emg.rate_hz=nan", "emg.liveness.noise_floors=[nan]"] {
            assert!(
                emg.with_values(&[assignment]).is_err(),
                "{assignment} makes a configuration that equals no other"
            );
        }
        let error = config().with_values(&["planner.nme=PRM"]).expect_err("an unknown key").to_string();
        assert!(
            error.starts_with("cannot set planner.nme=PRM: unknown field nme, expected one of "),
            "{error}"
        );
        assert!(!error.contains('\n'), "{error}");
        let error = TrialConfig::from_toml(&text.replace("limit_secs = 300.0", "limit_secs = -1.0"));
        assert!(matches!(error, Err(ConfigError::Value { key: "limit_secs", .. })), "{error:?}");
    }

    #[test]
    fn seeds_spread_over_the_arrangements() {
        let used: std::collections::HashSet<_> =
            (0..200).map(|seed| TrialConfig::new(MethodName::D, seed, config().setup).arrangement).collect();
        assert_eq!(used.len(), 24);
    }
}
