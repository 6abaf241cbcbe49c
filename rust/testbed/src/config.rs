use crate::{
    ConfigError, FeedbackMapping, LinkImpairment, MotionConfig, PhysicsConfig, Pinned, PlannerOptions,
};
use proact_arm::{ArmModel, Side};
use proact_control::{MethodEntry, MethodProgram, MethodRegistry, OUTSIDE, Profile};
use proact_emg::{Classifier, EmgConfig};
use proact_intent::{IntentModelName, IntentOptions, IntentProgram};
use proact_participants::{Body, ParticipantOptions};
use proact_tasks::{DEFAULT_TASK, Task, TaskChoice, Wearer};
use proact_types::{GestureCommands, GestureName, GestureTableError};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// Gestures are given directly, until a source of them is named.
const KEYS: &str = "keys";

/// Most words of a key of the configuration; there are four in `profile.end_effector_jog.inverse.kind`.
const DEEPEST_KEY: usize = 8;

/// Where the blocks start: the key of the modified box-and-blocks test, and that of older configurations.
const ARRANGEMENT: &str = "arrangement";
const ARRANGEMENT_IN_TASK: &str = "task.arrangement";

/// Where person and box are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Setup {
    /// Shown on the page and written to the result.
    pub name: String,
    /// The person.
    pub body: Body,
    /// The side that the person wears the arm on, and that the box is set up for.
    #[serde(default, skip_serializing_if = "is_right")]
    pub side: Side,
}

fn is_right(side: &Side) -> bool {
    *side == Side::Right
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

    /// The same for whoever uses the arm `model`: mirrored if it belongs to the other side, and with the base where the arm
    /// stands if nobody wears it.
    pub fn with_arm(mut self, model: &ArmModel) -> Self {
        if self.side != model.side {
            (self.side, self.body) = (model.side, self.body.mirrored());
        }
        if let Some(stand) = &model.settings.stand {
            self.body = self.body.beside(stand.xyz);
        }
        self
    }
}

fn yes() -> bool {
    true
}

fn ten() -> u32 {
    10
}

fn is_ten(limit: &u32) -> bool {
    *limit == ten()
}

fn is_standard(feedback: &[FeedbackMapping]) -> bool {
    feedback == FeedbackMapping::standard()
}

/// Everything that a trial depends on, apart from its inputs. Written to the trial directory as `config.toml`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrialConfig {
    /// Name of the control method, by which the registry has it.
    pub method: String,
    /// Every random stream of the trial is derived from it.
    pub seed: u64,
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
    /// Whether there is gaze in this trial. Without it no gaze enters, and a method that needs it is refused.
    #[serde(default = "yes", skip_serializing_if = "Clone::clone")]
    pub gaze: bool,
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
    pub task: TaskChoice,
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
    /// The program that is the method, if it is an outside one. One without `info` stands in the place of `method`, which
    /// then says no more than what the posterior knows and how a simulated participant acts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub method_process: Option<MethodProgram>,
    /// The program that says what the person means, in the place of `intent_model`; none if that does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub intent_process: Option<IntentProgram>,
    /// Delay, jitter and loss on the ways from the person and to the display.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub impairments: Vec<LinkImpairment>,
    /// From what happens to what the person is to hear and feel.
    #[serde(default = "FeedbackMapping::standard", skip_serializing_if = "is_standard")]
    pub feedback: Vec<FeedbackMapping>,
    /// How the methods behave.
    pub profile: Profile,
    /// Inference of what the person means.
    pub intent: IntentOptions,
    /// The EMG stage; none when gestures come from keys.
    pub emg: Option<EmgConfig>,
    /// The simulated participant; none when a person drives.
    pub participant: Option<ParticipantOptions>,
    /// A part in another process that misses this many answers in a row ends the trial: the method, the decoder of the EMG,
    /// or the intent model. Default: 3 where each answer is waited for, which takes at most 10 s each; 200 in a live trial.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub missed_answers_limit: Option<u32>,
    /// This many failed plans in a row are a fault of the trial, told at its end.
    #[serde(default = "ten", skip_serializing_if = "is_ten")]
    pub failed_plans_limit: u32,
    /// Age and sex of whoever wears the arm, by which norms are shown beside the score; none where nobody told them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wearer: Option<Wearer>,
}

impl TrialConfig {
    /// The default configuration for `method`, `seed` and `setup`; the arrangement follows from the seed.
    pub fn new(method: &str, seed: u64, setup: Setup) -> Self {
        let profile = Profile::named("default").expect("ships with the program and is tested there");
        Self {
            method: method.to_owned(),
            seed,
            profile,
            limit_secs: 300.0,
            plan_latency_ms: 50,
            wait_for_plans: true,
            place_filter_ms: 150,
            gesture_source: KEYS.to_owned(),
            gaze: true,
            emg_centring: Vec::new(),
            intent_model: IntentModelName::default(),
            arm: Self::default_arm(),
            task: TaskChoice::named(DEFAULT_TASK, seed).expect("ships with the program and is tested there"),
            physics: PhysicsConfig::default(),
            motion: MotionConfig::default(),
            planner: PlannerOptions::default(),
            setup,
            method_process: None,
            intent_process: None,
            impairments: Vec::new(),
            feedback: FeedbackMapping::standard(),
            intent: IntentOptions::default(),
            emg: None,
            participant: None,
            missed_answers_limit: None,
            failed_plans_limit: ten(),
            wearer: None,
        }
    }

    /// The same with the arm `model`, which is called `arm`, and the set-up for it.
    pub fn with_arm(mut self, arm: Pinned, model: &ArmModel) -> Self {
        self.setup = self.setup.with_arm(model);
        Self { arm, ..self }
    }

    /// Refuses an arm that the set-up is not for.
    ///
    /// # Errors
    /// [`ConfigError::Side`].
    pub(crate) fn check_side(&self, model: &ArmModel) -> Result<(), ConfigError> {
        if self.setup.side == model.side {
            return Ok(());
        }
        let word = |side| if side == Side::Right { "right" } else { "left" };
        let (arm, side, got) = (self.arm.name.clone(), word(model.side), word(self.setup.side));
        Err(ConfigError::Side { arm, side, got })
    }

    /// The name of the arm unless another one is asked for.
    pub const DEFAULT_ARM: &str = "mpl_right";

    fn default_arm() -> Pinned {
        Pinned::named(Self::DEFAULT_ARM)
    }

    /// A configuration that says nothing of its task: the modified test, in its first arrangement.
    fn default_task() -> TaskChoice {
        let mut task =
            TaskChoice::named(DEFAULT_TASK, 0).expect("ships with the program and is tested there");
        task.arrangement = None;
        task
    }

    /// The same with another task, whose limit it takes.
    ///
    /// # Errors
    /// [`ConfigError::Task`].
    pub fn with_task(mut self, task: TaskChoice) -> Result<Self, ConfigError> {
        self.limit_secs = task.limit_secs()?;
        self.task = task;
        Ok(self)
    }

    /// The task, for the arm `model`.
    ///
    /// # Errors
    /// [`ConfigError::Task`].
    pub fn build_task(&self, model: &ArmModel) -> Result<Box<dyn Task>, ConfigError> {
        let mut task = self.task.build_within(model.side == Side::Left, Some(self.limit_secs))?;
        let limits = |joint: &usize| [model.joints[*joint].limits.lower, model.joints[*joint].limits.upper];
        task.meet_arm(&model.arm.iter().map(limits).collect::<Vec<_>>())?;
        Ok(task)
    }

    /// Takes `arm` for the arm, and the task as it is here.
    ///
    /// # Errors
    /// [`ConfigError::OtherName`], [`ConfigError::OtherContent`].
    pub(crate) fn pin(&mut self, arm: &Pinned) -> Result<(), ConfigError> {
        self.arm.take("arm", arm)?;
        let mut task = Pinned { name: self.task.name.clone(), hash: self.task.hash.take() };
        task.pin("task", &self.task.name, &self.task.content()?)?;
        self.task.hash = task.hash;
        Ok(())
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

    /// What the gestures of `classifier`, of which `rest` is that of a relaxed hand, are to the method.
    ///
    /// # Errors
    /// A table of the profile that does not fit them.
    pub fn gesture_commands(
        &self,
        rest: GestureName,
        classifier: &Classifier,
    ) -> Result<GestureCommands, GestureTableError> {
        GestureCommands::new(classifier.gestures(), rest, &self.profile.gestures)
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
        let read = with_arrangement_in_task(text);
        let config: Self = toml::from_str(&read).map_err(|error| {
            let start = error.span().map_or(0, |span| span.start);
            let number = read[..start].matches('\n').count();
            // Lines of a text that was put in order are numbered otherwise than those of the file.
            let place = match &read {
                Cow::Borrowed(_) => format!("line {}", number + 1),
                Cow::Owned(read) => read.lines().nth(number).unwrap_or_default().trim().to_owned(),
            };
            ConfigError::Text(format!("{place}: {}", error.message().replace('`', "")))
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
        // A text that gave way to a table, as `mass_set` to `mass_set.scaled`: whether it may, the reading below decides.
        let mut gave_way = None;
        for assignment in assignments.iter().map(AsRef::as_ref) {
            let wrong = || ConfigError::Assignment { got: assignment.to_owned() };
            let (key, value) = assignment.split_once('=').ok_or_else(wrong)?;
            let (key, value_text) = (key.trim(), value.trim());
            let key = if key == ARRANGEMENT { ARRANGEMENT_IN_TASK } else { key };
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
                if inner.is_str() && !value_text.is_empty() {
                    *inner = toml::Value::Table(toml::Table::new());
                    gave_way = gave_way.or(Some(assignment));
                }
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
            if let Some(assignment) = gave_way {
                return ConfigError::Assignment { got: assignment.to_owned() };
            }
            // Where it stands in a text that nobody has seen tells nothing; which assignment it is does.
            let reason = error.message().replace('`', "");
            let given = assignments.iter().map(AsRef::as_ref);
            ConfigError::Assigned { got: given.collect::<Vec<&str>>().join(", "), reason }
        })?;
        config.check()?;
        Ok(config)
    }

    /// Takes the method that `entry` is.
    #[must_use]
    pub fn by(self, entry: &MethodEntry) -> Self {
        Self { method: entry.info().name.clone(), method_process: entry.program().cloned(), ..self }
    }

    /// The control method of the trial, among `methods` or as the configuration itself describes it.
    ///
    /// # Errors
    /// No such method; one that needs what the trial has not.
    pub fn method_entry(&self, methods: &MethodRegistry) -> Result<MethodEntry, ConfigError> {
        let entry = methods.of(&self.method, self.method_process.as_ref())?;
        if entry.needs().gaze && !self.gaze {
            return Err(ConfigError::NoGaze { method: self.method.clone() });
        }
        Ok(entry)
    }

    /// What the method is called in results and records.
    pub fn method_label(&self) -> String {
        match &self.method_process {
            Some(MethodProgram { info: None, .. }) => OUTSIDE.to_owned(),
            _ => self.method.clone(),
        }
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
        for (key, limit) in [
            ("missed_answers_limit", self.missed_answers_limit.unwrap_or(1)),
            ("failed_plans_limit", self.failed_plans_limit),
        ] {
            if !(1..=100_000).contains(&limit) {
                return bad(key, limit.to_string(), "1 to 100000");
            }
        }
        self.task.build_within(false, Some(self.limit_secs))?;
        self.physics.check()?;
        self.motion.check()?;
        self.planner.check()?;
        self.method_process.as_ref().map_or(Ok(()), MethodProgram::check)?;
        self.intent_process.as_ref().map_or(Ok(()), IntentProgram::check)?;
        LinkImpairment::check(&self.impairments)?;
        FeedbackMapping::check(&self.feedback)?;
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

/// `text` with a key `arrangement` at its top, as older configurations have it, as that of the task.
fn with_arrangement_in_task(text: &str) -> Cow<'_, str> {
    let Ok(mut table) = toml::from_str::<toml::Table>(text) else { return Cow::Borrowed(text) };
    let Some(arrangement) = table.remove(ARRANGEMENT) else { return Cow::Borrowed(text) };
    let task = table.entry("task").or_insert_with(|| toml::Value::Table(toml::Table::new()));
    let Some(task) = task.as_table_mut() else { return Cow::Borrowed(text) };
    task.entry("name").or_insert_with(|| toml::Value::String(DEFAULT_TASK.to_owned()));
    task.insert(ARRANGEMENT.to_owned(), arrangement);
    Cow::Owned(table.to_string())
}

#[cfg(test)]
mod tests;
