use crate::{
    ConfigError, FeedbackMapping, LinkImpairment, MotionConfig, PhysicsConfig, PinnedContent, PlannerOptions,
};
use proact_arm::{ArmModel, Side};
use proact_control::{EXTERNAL_METHOD_NAME, MethodEntry, MethodProgram, MethodRegistry, Profile};
use proact_emg::{Classifier, EmgConfig};
use proact_intent::{IntentModelName, IntentOptions, IntentProgram};
use proact_participants::{Body, ParticipantOptions};
use proact_tasks::{DEFAULT_TASK, Task, TaskSpec, UserProfile};
use proact_types::{
    CommandMap, CommandMapError, Gesture, format_number,
    renamed_keys::{ConfigFile, DuplicateKey, RenamedKey, rename_assignment, rename_keys_in_toml},
    shorten_numbers,
};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// Gestures are given directly, until a source of them is named.
const GESTURE_SOURCE_KEYS: &str = "keys";

/// Most words of a key of the configuration; there are four in `profile.end_effector_jog.inverse.kind`.
const MAX_KEY_DEPTH: usize = 8;

/// Where the blocks start: the key of the modified box-and-blocks test, and that of older configurations.
const ARRANGEMENT_KEY: &str = "arrangement";
const TASK_ARRANGEMENT_KEY: &str = "task.arrangement";

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
        if let Some(stand) = &model.settings.fixed_base {
            self.body = self.body.for_fixed_base(stand.xyz);
        }
        self
    }
}

fn default_true() -> bool {
    true
}

fn default_failed_plans_limit() -> u32 {
    10
}

fn is_default_failed_plans_limit(limit: &u32) -> bool {
    *limit == default_failed_plans_limit()
}

fn is_standard_feedback(feedback: &[FeedbackMapping]) -> bool {
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
    #[serde(default = "default_true", skip_serializing_if = "Clone::clone")]
    pub gaze: bool,
    /// Zero level of each EMG channel, subtracted before anything else; empty for a stream that is centred.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub emg_dc_offset: Vec<f64>,
    /// Faults of the EMG recordings, of the trial or of its model, that were accepted, one sentence each.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub emg_accepted_faults: Vec<String>,
    /// How is inferred what the person means: the paper's product of gaze and task, or another model.
    #[serde(default)]
    pub intent_model: IntentModelName,
    /// The arm.
    #[serde(default = "TrialConfig::default_arm")]
    pub arm: PinnedContent,
    /// The task.
    #[serde(default = "TrialConfig::default_task")]
    pub task: TaskSpec,
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
    #[serde(default = "FeedbackMapping::standard", skip_serializing_if = "is_standard_feedback")]
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
    /// A part in another process that misses this many answers in the whole trial, in a row or not, ends the trial. Default: 20
    /// where each answer is waited for, 200 s of waiting; no limit in a live trial, in which no step waits.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub missed_answers_in_trial_limit: Option<u32>,
    /// This many failed plans in a row are a fault of the trial, told at its end.
    #[serde(default = "default_failed_plans_limit", skip_serializing_if = "is_default_failed_plans_limit")]
    pub failed_plans_limit: u32,
    /// Age and sex of whoever wears the arm, by which norms are shown beside the score; none where nobody told them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub user_profile: Option<UserProfile>,
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
            gesture_source: GESTURE_SOURCE_KEYS.to_owned(),
            gaze: true,
            emg_dc_offset: Vec::new(),
            emg_accepted_faults: Vec::new(),
            intent_model: IntentModelName::default(),
            arm: Self::default_arm(),
            task: TaskSpec::named(DEFAULT_TASK, seed).expect("ships with the program and is tested there"),
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
            missed_answers_in_trial_limit: None,
            failed_plans_limit: default_failed_plans_limit(),
            user_profile: None,
        }
    }

    /// The same with the arm `model`, which is called `arm`, and the set-up for it.
    pub fn with_arm(mut self, arm: PinnedContent, model: &ArmModel) -> Self {
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
        Err(ConfigError::SideMismatch { arm, side, got })
    }

    /// The name of the arm unless another one is asked for.
    pub const DEFAULT_ARM: &str = "mpl_right";

    fn default_arm() -> PinnedContent {
        PinnedContent::named(Self::DEFAULT_ARM)
    }

    /// A configuration that says nothing of its task: the modified test, in its first arrangement.
    fn default_task() -> TaskSpec {
        let mut task = TaskSpec::named(DEFAULT_TASK, 0).expect("ships with the program and is tested there");
        task.arrangement = None;
        task
    }

    /// The same with another task, whose limit it takes.
    ///
    /// # Errors
    /// [`ConfigError::Task`].
    pub fn with_task(mut self, task: TaskSpec) -> Result<Self, ConfigError> {
        self.limit_secs = task.limit_secs()?;
        self.task = task;
        Ok(self)
    }

    /// The task, for the arm `model`.
    ///
    /// # Errors
    /// [`ConfigError::Task`].
    pub fn build_task(&self, model: &ArmModel) -> Result<Box<dyn Task>, ConfigError> {
        let mut task = self.task.build_with_limit(model.side == Side::Left, Some(self.limit_secs))?;
        let limits = |joint: &usize| [model.joints[*joint].limits.lower, model.joints[*joint].limits.upper];
        task.check_arm(&model.arm.iter().map(limits).collect::<Vec<_>>())?;
        Ok(task)
    }

    /// Takes `arm` for the arm, and the task as it is here.
    ///
    /// # Errors
    /// [`ConfigError::NameMismatch`], [`ConfigError::ContentMismatch`].
    pub(crate) fn pin_contents(&mut self, arm: &PinnedContent) -> Result<(), ConfigError> {
        self.arm.check_and_adopt("arm", arm)?;
        let mut task = PinnedContent { name: self.task.name.clone(), hash: self.task.hash.take() };
        task.pin_content("task", &self.task.name, &self.task.task_file()?)?;
        self.task.hash = task.hash;
        Ok(())
    }

    /// The same for a trial that goes by the clock: a late plan acts when it comes, and none may be later than
    /// [`TrialConfig::LIVE_DEADLINE_SECS`] unless the planner has another deadline.
    pub fn for_live_trial(mut self) -> Self {
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
    pub fn set_emg_dc_offset(&mut self, levels: Vec<f64>) -> Result<(), ConfigError> {
        if !self.emg_dc_offset.is_empty() && self.emg_dc_offset != levels {
            return Err(ConfigError::Value {
                key: "emg_dc_offset",
                got: format!("{:?}", self.emg_dc_offset),
                expected: "none: they come with the stream, or with the model that was trained on it",
            });
        }
        self.emg_dc_offset = levels;
        Ok(())
    }

    /// The faults of recordings that were accepted, which belong to them.
    ///
    /// # Errors
    /// [`ConfigError::Value`] if the configuration has others.
    pub fn accept_faults(&mut self, faults: Vec<String>) -> Result<(), ConfigError> {
        if !self.emg_accepted_faults.is_empty() && self.emg_accepted_faults != faults {
            return Err(ConfigError::Value {
                key: "emg_accepted_faults",
                got: format!("{:?}", self.emg_accepted_faults),
                expected: "none: they come with the recordings or the model, and --accept-faults",
            });
        }
        self.emg_accepted_faults = faults;
        Ok(())
    }

    /// What the gestures of `classifier`, of which `rest` is that of a relaxed hand, are to the method.
    ///
    /// # Errors
    /// A table of the profile that does not fit them.
    pub fn command_map(&self, rest: Gesture, classifier: &Classifier) -> Result<CommandMap, CommandMapError> {
        CommandMap::new(classifier.gestures(), rest, &self.profile.gestures)
    }

    /// Where the gestures of the trial come from, as shown.
    ///
    /// # Errors
    /// [`ConfigError::Value`] if the configuration names another source.
    pub fn set_gesture_source(&mut self, source: &str) -> Result<(), ConfigError> {
        if self.gesture_source != source && self.gesture_source != GESTURE_SOURCE_KEYS {
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
            self.intent.gaze_sigma = 0.1;
            self.intent.context_changes_at_grasp = true;
            self.physics = PhysicsConfig::ORIGINAL;
        }
        Ok(self)
    }

    /// Reads and checks a configuration. Keys may have the names that they had before.
    ///
    /// # Errors
    /// Unreadable text, unknown keys, a key by its old and its new name, values out of range.
    pub fn from_toml(text: &str) -> Result<Self, ConfigError> {
        Self::from_toml_noting(text, &mut Vec::new())
    }

    /// As [`TrialConfig::from_toml`], for a text that people write: `renamed` gets the keys that have another name now.
    ///
    /// # Errors
    /// As [`TrialConfig::from_toml`].
    pub fn from_toml_noting(text: &str, renamed: &mut Vec<&'static RenamedKey>) -> Result<Self, ConfigError> {
        let (named, used) = rename_keys_in_toml(text, ConfigFile::Trial, "")?;
        renamed.extend(used);
        let read = move_arrangement_into_task(&named);
        let is_as_written = matches!((&named, &read), (Cow::Borrowed(_), Cow::Borrowed(_)));
        let config: Self = toml::from_str(&read).map_err(|error| {
            let start = error.span().map_or(0, |span| span.start);
            let number = read[..start].matches('\n').count();
            // Lines of a text that was put in order are numbered otherwise than those of the file.
            let location = match is_as_written {
                true => format!("line {}", number + 1),
                false => read.lines().nth(number).unwrap_or_default().trim().to_owned(),
            };
            ConfigError::Text(format!("{location}: {}", shorten_numbers(error.message()).replace('`', "")))
        })?;
        config.check()?;
        Ok(config)
    }

    /// The same with other values, each as `key=value`: the key as in the text of the configuration, with a dot for
    /// each table, the value as there; a word needs no quotes, and no value leaves the key out.
    ///
    /// # Errors
    /// [`ConfigError::InvalidAssignment`] for what is no assignment, otherwise as [`TrialConfig::from_toml`].
    pub fn with_overrides<S: AsRef<str>>(&self, assignments: &[S]) -> Result<Self, ConfigError> {
        self.with_overrides_noting(assignments, &mut Vec::new())
    }

    /// As [`TrialConfig::with_overrides`], for assignments that people write: `renamed` gets the keys that have another name now.
    ///
    /// # Errors
    /// As [`TrialConfig::with_overrides`].
    pub fn with_overrides_noting<S: AsRef<str>>(
        &self,
        assignments: &[S],
        renamed: &mut Vec<&'static RenamedKey>,
    ) -> Result<Self, ConfigError> {
        self.read_overrides(assignments, renamed).map_err(|error| {
            let ConfigError::RefusedAssignment { reason, .. } = error else { return error };
            // With the assignments up to the one to blame the same is wrong, and without that one it is not. Halving finds it
            // in few readings, however many there are.
            let is_wrong_already = |count: usize| {
                let before = self.read_overrides(&assignments[..count], &mut Vec::new());
                matches!(before, Err(ConfigError::RefusedAssignment { reason: other, .. }) if other == reason)
            };
            let (mut right, mut wrong) = (0, assignments.len());
            while wrong - right > 1 {
                let middle = usize::midpoint(right, wrong);
                if is_wrong_already(middle) { wrong = middle } else { right = middle }
            }
            let got =
                assignments.get(right).map_or_else(String::new, |assignment| assignment.as_ref().to_owned());
            ConfigError::RefusedAssignment { got, reason }
        })
    }

    /// As [`TrialConfig::with_overrides_noting`]; which assignment is refused, where the text as a whole is, is not told.
    fn read_overrides<S: AsRef<str>>(
        &self,
        assignments: &[S],
        renamed: &mut Vec<&'static RenamedKey>,
    ) -> Result<Self, ConfigError> {
        let mut present_names = PresentNames::default();
        let mut whole: toml::Table =
            toml::from_str(&self.to_toml()?).map_err(|e| ConfigError::Text(e.to_string()))?;
        // A text that gave way to a table, as `mass_set` to `mass_set.scaled`: whether it may, the reading below decides.
        let mut gave_way = None;
        for assignment in assignments.iter().map(AsRef::as_ref) {
            let wrong = || ConfigError::InvalidAssignment { got: assignment.to_owned() };
            let (key, value) = assignment.split_once('=').ok_or_else(wrong)?;
            let (key, value_text) = (key.trim(), value.trim());
            let key = if key == ARRANGEMENT_KEY { TASK_ARRANGEMENT_KEY } else { key };
            if key.split('.').count() > MAX_KEY_DEPTH {
                return Err(wrong());
            }
            // A bare word is text; anything else is what TOML says.
            let read = |text: &str| toml::from_str::<toml::Table>(&format!("value = {text}")).ok();
            let value = read(value_text).and_then(|mut table| table.remove("value"));
            let value = value.unwrap_or_else(|| toml::Value::String(value_text.to_owned()));
            let (key, value) = present_names.of(key, value, renamed)?;
            let (tables, name) =
                key.rsplit_once('.').map_or((None, &*key), |(tables, name)| (Some(tables), name));
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
                return ConfigError::InvalidAssignment { got: assignment.to_owned() };
            }
            // Where it stands in a text that nobody has seen tells nothing; which assignment it is does.
            let reason = shorten_numbers(error.message()).replace('`', "");
            ConfigError::RefusedAssignment { got: String::new(), reason }
        })?;
        config.check()?;
        Ok(config)
    }

    /// Takes the method that `entry` is.
    #[must_use]
    pub fn with_method(self, entry: &MethodEntry) -> Self {
        Self { method: entry.info().name.clone(), method_process: entry.program().cloned(), ..self }
    }

    /// The control method of the trial, among `methods` or as the configuration itself describes it.
    ///
    /// # Errors
    /// No such method; one that needs what the trial has not.
    pub fn method_entry(&self, methods: &MethodRegistry) -> Result<MethodEntry, ConfigError> {
        let entry = methods.resolve(&self.method, self.method_process.as_ref())?;
        if entry.needs().gaze && !self.gaze {
            return Err(ConfigError::NoGaze { method: self.method.clone() });
        }
        Ok(entry)
    }

    /// What the method is called in results and records.
    pub fn method_label(&self) -> String {
        match &self.method_process {
            Some(MethodProgram { info: None, .. }) => EXTERNAL_METHOD_NAME.to_owned(),
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
        if !(0.001..=3600.0).contains(&self.limit_secs) {
            return bad("limit_secs", format_number(self.limit_secs), "0.001 to 3600");
        }
        if !(1..=10_000).contains(&self.plan_latency_ms) {
            return bad("plan_latency_ms", self.plan_latency_ms.to_string(), "1 to 10000");
        }
        if self.place_filter_ms > 10_000 {
            return bad("place_filter_ms", self.place_filter_ms.to_string(), "0 to 10000");
        }
        for (key, limit) in [
            ("missed_answers_limit", self.missed_answers_limit.unwrap_or(1)),
            ("missed_answers_in_trial_limit", self.missed_answers_in_trial_limit.unwrap_or(1)),
            ("failed_plans_limit", self.failed_plans_limit),
        ] {
            if !(1..=100_000).contains(&limit) {
                return bad(key, limit.to_string(), "1 to 100000");
            }
        }
        self.task.build_with_limit(false, Some(self.limit_secs))?;
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
        if let Some(level) = self.emg_dc_offset.iter().find(|level| !level.is_finite()) {
            return bad("emg_dc_offset", level.to_string(), "finite numbers");
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

/// The keys of assignments by their present names.
#[derive(Default)]
struct PresentNames {
    /// Keys that were assigned to by an old name.
    renamed: Vec<(String, DuplicateKey)>,
    /// The others.
    as_written: Vec<String>,
}

impl PresentNames {
    /// The key and the value of an assignment by present names; `renamed` gets those that had others.
    ///
    /// # Errors
    /// A key by its old and its new name, in this assignment or in one before.
    fn of(
        &mut self,
        key: &str,
        value: toml::Value,
        renamed: &mut Vec<&'static RenamedKey>,
    ) -> Result<(String, toml::Value), ConfigError> {
        let (name, value, used) = rename_assignment(key, value, ConfigFile::Trial)?;
        renamed.extend(&used);
        if name == key {
            if let Some((_, twice)) = self.renamed.iter().find(|(other, _)| *other == name) {
                return Err(twice.clone().into());
            }
            self.as_written.push(name.clone());
        } else {
            let twice = DuplicateKey { old: key.to_owned(), new: name.clone() };
            if self.as_written.contains(&name) {
                return Err(twice.into());
            }
            self.renamed.push((name.clone(), twice));
        }
        Ok((name, value))
    }
}

/// `text` with a key `arrangement` at its top, as older configurations have it, as that of the task.
fn move_arrangement_into_task(text: &str) -> Cow<'_, str> {
    let Ok(mut table) = toml::from_str::<toml::Table>(text) else { return Cow::Borrowed(text) };
    let Some(arrangement) = table.remove(ARRANGEMENT_KEY) else { return Cow::Borrowed(text) };
    let task = table.entry("task").or_insert_with(|| toml::Value::Table(toml::Table::new()));
    let Some(task) = task.as_table_mut() else { return Cow::Borrowed(text) };
    task.entry("name").or_insert_with(|| toml::Value::String(DEFAULT_TASK.to_owned()));
    task.insert(ARRANGEMENT_KEY.to_owned(), arrangement);
    Cow::Owned(table.to_string())
}

#[cfg(test)]
mod tests;
