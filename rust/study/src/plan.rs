use crate::{Arrangements, ConditionOrder, PlannedTrial, Schedule, StudyPlanError};
use proact_types::{
    Instruction, format_number,
    renamed_keys::{ConfigFile, RenamedKey, rename_keys_in_toml},
};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// The plans that ship with the program, by name. A set-up that is like another system's is a file in `data/peers` and a line
/// here: `proact study new --template` copies it, `proact demo --like` shows its first condition.
pub const SHIPPED_PLANS: &[(&str, &str)] = &[
    ("study1", include_str!("../data/study1.toml")),
    ("study2", include_str!("../data/study2.toml")),
    ("empty", include_str!("../data/empty.toml")),
    ("minivie", include_str!("../data/peers/minivie.toml")),
    ("vie", include_str!("../data/peers/vie.toml")),
    ("armsym", include_str!("../data/peers/armsym.toml")),
    ("holopham", include_str!("../data/peers/holopham.toml")),
    ("virtual-bbt", include_str!("../data/peers/virtual-bbt.toml")),
];

/// Most people, conditions, and trials in a row that a plan may ask for: more is most likely a slip.
const MAX_PARTICIPANTS: usize = 10_000;
pub(crate) const MAX_CONDITIONS: usize = 12;
const MAX_TRIALS: usize = 1000;
/// Longest time that a step may take, minutes.
const MAX_STEP_MINUTES: f64 = 480.0;

/// The limit of a trial whose plan says nothing, seconds: that of the modified box-and-blocks test.
pub const DEFAULT_LIMIT_SECS: f64 = 300.0;

/// A study, as a person writes it down.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StudyPlan {
    /// Short, of letters, digits, `-` and `_`: part of the names of files.
    pub name: String,
    /// For people.
    #[serde(default)]
    pub title: String,
    /// How many people take part.
    pub participants: usize,
    /// Of all that is drawn at random.
    #[serde(default = "one")]
    pub seed: u64,
    /// What all trials have in common.
    #[serde(default)]
    pub trial: TrialOptions,
    /// What is compared.
    pub conditions: Vec<Condition>,
    /// In which order each participant meets the conditions.
    pub order: ConditionOrder,
    /// Where the blocks stand, for a task that has arrangements.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub arrangements: Option<Arrangements>,
    /// When what happens, in their order.
    pub sessions: Vec<PlannedSession>,
    /// What the experimenter says, by key.
    #[serde(default)]
    pub texts: BTreeMap<String, String>,
}

fn one() -> u64 {
    1
}

/// What a trial is, by names; what is left out is as in the plan's `[trial]`, or as the program has it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrialOptions {
    /// Control method: a name, or the file of an outside one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub method: Option<String>,
    /// Task: a name or a file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub task: Option<String>,
    /// Arm: a name or a folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub arm: Option<String>,
    /// Where person and box are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub setup: Option<String>,
    /// How the methods behave.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub profile: Option<String>,
    /// When a trial ends at the latest, seconds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit_secs: Option<f64>,
    /// What a participant is told to do with the body; `free` if left out. A person hears it from the experimenter, in the
    /// plan's own words; a simulated one follows it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub instruction: Option<Instruction>,
    /// Other values of a trial's configuration, as `profile.level=below_elbow`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub set: Vec<String>,
}

impl TrialOptions {
    /// These choices, and those of `common` where these say nothing; what both set, these set.
    pub fn with_defaults_from(&self, common: &Self) -> Self {
        let or = |own: &Option<String>, common: &Option<String>| own.clone().or_else(|| common.clone());
        Self {
            method: or(&self.method, &common.method),
            task: or(&self.task, &common.task),
            arm: or(&self.arm, &common.arm),
            setup: or(&self.setup, &common.setup),
            profile: or(&self.profile, &common.profile),
            limit_secs: self.limit_secs.or(common.limit_secs),
            instruction: self.instruction.or(common.instruction),
            set: common.set.iter().chain(&self.set).cloned().collect(),
        }
    }
}

/// One of the things that a study compares.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Condition {
    /// In the tables.
    pub name: String,
    /// What its trials are.
    #[serde(default)]
    pub trial: TrialOptions,
    /// What happens before its first trial.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub begin: Vec<ProtocolStep>,
    /// What happens after its last trial.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub end: Vec<ProtocolStep>,
}

/// One visit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlannedSession {
    /// In the tables.
    pub name: String,
    /// Days since the session before, fewest and most; none for the first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub days_after: Option<[u32; 2]>,
    /// Which of a participant's conditions it has, by their place in the participant's order from 1; all if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub condition_positions: Option<Vec<usize>>,
    /// Trials of each of them.
    #[serde(default)]
    pub trials: usize,
    /// What happens first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub begin: Vec<ProtocolStep>,
    /// What happens before the first trial of each condition.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub before_condition: Vec<ProtocolStep>,
    /// What happens after the last trial of each condition.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub after_condition: Vec<ProtocolStep>,
    /// What happens last.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub end: Vec<ProtocolStep>,
    /// Breaks between trials of a condition.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub breaks: Vec<PlannedBreak>,
    /// What happens after some trials of each condition, before a break there.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub inter_trial_steps: Vec<InterTrialSteps>,
    /// From the end of a trial to the next, minutes.
    #[serde(default = "one_minute")]
    pub between_trials_minutes: f64,
    /// The participant sees how much time is left.
    #[serde(default = "yes")]
    pub countdown: bool,
}

fn one_minute() -> f64 {
    1.0
}

fn yes() -> bool {
    true
}

/// A break within the trials of a condition.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlannedBreak {
    /// After this trial of the condition, from 1.
    pub after_trial: usize,
    /// How long.
    pub minutes: f64,
}

/// What happens after some of a condition's trials, such as a questionnaire.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InterTrialSteps {
    /// After these trials of the condition, from 1.
    pub after_trials: Vec<usize>,
    /// What happens.
    pub steps: Vec<ProtocolStep>,
}

/// Something that happens beside the trials.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
pub enum ProtocolStep {
    /// The experimenter says one of the plan's texts.
    Say {
        /// Its key.
        text: String,
        /// How long that takes.
        minutes: f64,
    },
    /// A questionnaire is answered.
    Form {
        /// Its name.
        form: String,
        /// How long that takes.
        minutes: f64,
    },
    /// The gestures are trained, then tested.
    Train {
        /// How often each gesture is held.
        repetitions: usize,
        /// How long each time, seconds.
        hold_secs: f64,
        /// How often in a row all gestures must be made in the prescribed sequence without a wrong one; without it the
        /// experimenter judges.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        consecutive_correct_runs: Option<usize>,
        /// How long all of it takes.
        minutes: f64,
    },
    /// The gaze is calibrated.
    CalibrateGaze {
        /// How long that takes.
        minutes: f64,
    },
    /// The method is shown and tried.
    Demonstrate {
        /// How long that takes.
        minutes: f64,
    },
    /// Objects are carried that do not count.
    #[serde(rename = "practise")]
    Practice {
        /// How many.
        transfers: usize,
        /// How long that takes.
        minutes: f64,
    },
    /// A break.
    #[serde(rename = "rest")]
    Break {
        /// How long.
        minutes: f64,
    },
}

impl ProtocolStep {
    /// How long it takes.
    pub fn minutes(&self) -> f64 {
        match self {
            ProtocolStep::Say { minutes, .. }
            | ProtocolStep::Form { minutes, .. }
            | ProtocolStep::Train { minutes, .. }
            | ProtocolStep::CalibrateGaze { minutes }
            | ProtocolStep::Demonstrate { minutes }
            | ProtocolStep::Practice { minutes, .. }
            | ProtocolStep::Break { minutes } => *minutes,
        }
    }
}

impl StudyPlan {
    /// Reads a plan and checks all of it that can be checked without knowing methods, tasks, arms and forms. Keys may have the names
    /// that they had before.
    ///
    /// # Errors
    /// [`StudyPlanError`].
    pub fn from_text(text: &str) -> Result<Self, StudyPlanError> {
        Self::from_text_noting(text, &mut Vec::new())
    }

    /// As [`StudyPlan::from_text`], for a text that people write: `renamed` gets the keys that have another name now.
    ///
    /// # Errors
    /// [`StudyPlanError`].
    pub fn from_text_noting(
        text: &str,
        renamed: &mut Vec<&'static RenamedKey>,
    ) -> Result<Self, StudyPlanError> {
        let (text, used) = rename_keys_in_toml(text, ConfigFile::StudyPlan, "")
            .map_err(|error| StudyPlanError::Text(error.to_string()))?;
        renamed.extend(used);
        let plan: Self = toml::from_str(&text).map_err(|error| StudyPlanError::Text(error.to_string()))?;
        plan.check()?;
        Ok(plan)
    }

    /// The same plan for so many people, drawn from `seed`. Rows of its tables take turns.
    ///
    /// # Errors
    /// A number of people that no plan has.
    pub fn with_participants(mut self, participants: usize, seed: u64) -> Result<Self, StudyPlanError> {
        if participants != self.participants {
            let count = participants.min(MAX_PARTICIPANTS);
            let in_turn =
                |rows: &mut Vec<Vec<String>>| *rows = rows.iter().cycle().take(count).cloned().collect();
            if let ConditionOrder::Table { rows } = &mut self.order {
                in_turn(rows);
            }
            match &mut self.arrangements {
                Some(Arrangements::Table { rows }) if rows.len() > 1 => in_turn(rows),
                _ => {}
            }
        }
        let plan = Self { participants, seed, ..self };
        plan.check()?;
        Ok(plan)
    }

    /// Who does what. `arrangements` are the names of all that the task has; none for a task without.
    ///
    /// # Errors
    /// Constraints that no order keeps, arrangements that the task does not have.
    pub fn schedule(&self, arrangements: &[String]) -> Result<Schedule, StudyPlanError> {
        Schedule::of(self, arrangements)
    }

    /// Trials of each condition, over all sessions.
    pub fn trials_per_condition(&self) -> usize {
        self.sessions.iter().map(|session| session.trials).max().unwrap_or(0)
    }

    /// What the trials of a condition are.
    pub fn trial_options(&self, condition: usize) -> TrialOptions {
        self.conditions[condition].trial.with_defaults_from(&self.trial)
    }

    /// When a trial ends at the latest, seconds.
    pub fn limit_secs(&self, trial: &PlannedTrial) -> f64 {
        let condition = self.conditions.iter().position(|own| own.name == trial.condition);
        condition.and_then(|condition| self.trial_options(condition).limit_secs).unwrap_or(DEFAULT_LIMIT_SECS)
    }

    pub(crate) fn condition_names(&self) -> String {
        self.conditions.iter().map(|condition| condition.name.as_str()).collect::<Vec<_>>().join(", ")
    }

    /// The place of the condition called `name`, of which `location` speaks.
    pub(crate) fn condition_index(&self, location: &str, name: &str) -> Result<usize, StudyPlanError> {
        self.conditions.iter().position(|condition| condition.name == name).ok_or_else(|| {
            StudyPlanError::Unknown {
                location: location.to_owned(),
                what: "condition",
                got: name.to_owned(),
                known: self.condition_names(),
            }
        })
    }

    fn check(&self) -> Result<(), StudyPlanError> {
        let plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if self.name.is_empty() || self.name.len() > 64 || !self.name.chars().all(plain) {
            let expected = "1 to 64 letters, digits, - and _";
            return Err(StudyPlanError::value("name", format!("{:?}", self.name), expected));
        }
        in_range("participants", self.participants, MAX_PARTICIPANTS)?;
        in_range("the number of conditions", self.conditions.len(), MAX_CONDITIONS)?;
        distinct("condition", self.conditions.iter().map(|condition| &condition.name))?;
        distinct("session", self.sessions.iter().map(|session| &session.name))?;
        self.check_trial_options("trial", &self.trial)?;
        for condition in &self.conditions {
            let location = format!("conditions.{}", condition.name);
            self.check_trial_options(&location, &condition.trial)?;
            if condition.trial.method.is_none() && self.trial.method.is_none() {
                return Err(StudyPlanError::value(format!("{location}.trial.method"), "nothing", "a method"));
            }
            self.check_steps(&location, condition.begin.iter().chain(&condition.end))?;
        }
        self.order.check(self)?;
        self.check_sessions()?;
        self.arrangements.as_ref().map_or(Ok(()), |arrangements| arrangements.check(self))
    }

    fn check_trial_options(&self, location: &str, choice: &TrialOptions) -> Result<(), StudyPlanError> {
        match choice.limit_secs {
            Some(limit) if !(0.001..=60.0 * MAX_STEP_MINUTES).contains(&limit) => Err(StudyPlanError::value(
                format!("{location}.limit_secs"),
                format_number(limit),
                format!("0.001 to {}", 60.0 * MAX_STEP_MINUTES),
            )),
            _ => Ok(()),
        }
    }

    fn check_steps<'a>(
        &self,
        location: &str,
        steps: impl Iterator<Item = &'a ProtocolStep>,
    ) -> Result<(), StudyPlanError> {
        for step in steps {
            minutes(location, step.minutes())?;
            match step {
                ProtocolStep::Say { text, .. } if !self.texts.contains_key(text) => {
                    return Err(StudyPlanError::Unknown {
                        location: location.to_owned(),
                        what: "text",
                        got: text.clone(),
                        known: self.texts.keys().cloned().collect::<Vec<_>>().join(", "),
                    });
                }
                ProtocolStep::Train {
                    repetitions, hold_secs, consecutive_correct_runs: pass_runs, ..
                } => {
                    in_range(&format!("repetitions of a training in {location}"), *repetitions, 100)?;
                    in_range(
                        &format!("consecutive_correct_runs of a training in {location}"),
                        pass_runs.unwrap_or(1),
                        100,
                    )?;
                    if !(*hold_secs >= 0.5 && *hold_secs <= 60.0) {
                        let key = format!("hold_secs of a training in {location}");
                        return Err(StudyPlanError::value(key, hold_secs, "0.5 to 60"));
                    }
                }
                ProtocolStep::Practice { transfers, .. } => {
                    in_range(&format!("transfers of a practice in {location}"), *transfers, 100)?;
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn check_sessions(&self) -> Result<(), StudyPlanError> {
        let mut used = BTreeSet::new();
        for (index, session) in self.sessions.iter().enumerate() {
            let location = format!("sessions.{}", session.name);
            match session.days_after {
                Some(_) if index == 0 => {
                    let key = format!("{location}.days_after");
                    return Err(StudyPlanError::value(key, "given", "nothing: it is the first session"));
                }
                Some([fewest, latest]) if fewest > latest => {
                    let (key, got) = (format!("{location}.days_after"), format!("{fewest} to {latest}"));
                    return Err(StudyPlanError::value(key, got, "the fewest first"));
                }
                _ => {}
            }
            if session.trials > MAX_TRIALS {
                let expected = format!("at most {MAX_TRIALS}");
                return Err(StudyPlanError::value(format!("{location}.trials"), session.trials, expected));
            }
            for position in self.positions(session) {
                if position < 1 || position > self.conditions.len() || !used.insert(position) {
                    let expected = format!("1 to {}, each in one session", self.conditions.len());
                    return Err(StudyPlanError::value(
                        format!("{location}.condition_positions"),
                        position,
                        expected,
                    ));
                }
                if session.trials == 0 {
                    let expected = "at least 1; a session without trials has condition_positions = []";
                    return Err(StudyPlanError::value(format!("{location}.trials"), 0, expected));
                }
            }
            minutes(&format!("{location}.between_trials_minutes"), session.between_trials_minutes)?;
            for rest in &session.breaks {
                minutes(&format!("{location}.breaks"), rest.minutes)?;
                if rest.after_trial < 1 || rest.after_trial >= session.trials {
                    let expected = format!("1 to {}, so that a trial follows", session.trials.max(1) - 1);
                    return Err(StudyPlanError::value(
                        format!("{location}.breaks.after_trial"),
                        rest.after_trial,
                        expected,
                    ));
                }
            }
            for within in &session.inter_trial_steps {
                let mut trials = within.after_trials.iter();
                if let Some(trial) = trials.find(|trial| !(1..=session.trials).contains(*trial)) {
                    let expected = format!("1 to {}", session.trials);
                    return Err(StudyPlanError::value(
                        format!("{location}.inter_trial_steps.after_trials"),
                        trial,
                        expected,
                    ));
                }
            }
            let steps = [&session.begin, &session.before_condition, &session.after_condition, &session.end];
            let steps = steps.into_iter().chain(session.inter_trial_steps.iter().map(|within| &within.steps));
            self.check_steps(&location, steps.flatten())?;
        }
        if used.len() < self.conditions.len() {
            let left = (1..=self.conditions.len()).find(|position| !used.contains(position)).unwrap_or(0);
            let got = format!("without place {left} of the order");
            return Err(StudyPlanError::value("sessions", got, "each place of the order in one of them"));
        }
        Ok(())
    }

    /// Places in a participant's order that a session has, from 1.
    pub(crate) fn positions(&self, session: &PlannedSession) -> Vec<usize> {
        session.condition_positions.clone().unwrap_or_else(|| (1..=self.conditions.len()).collect())
    }
}

fn in_range(key: &str, got: usize, max: usize) -> Result<(), StudyPlanError> {
    if (1..=max).contains(&got) {
        return Ok(());
    }
    Err(StudyPlanError::value(key, got, format!("1 to {max}")))
}

fn minutes(key: &str, got: f64) -> Result<(), StudyPlanError> {
    if (0.0..=MAX_STEP_MINUTES).contains(&got) {
        return Ok(());
    }
    Err(StudyPlanError::value(format!("minutes in {key}"), got, format!("0 to {MAX_STEP_MINUTES}")))
}

fn distinct<'a>(what: &'static str, names: impl Iterator<Item = &'a String>) -> Result<(), StudyPlanError> {
    let mut seen = BTreeSet::new();
    for name in names {
        if name.trim().is_empty() {
            return Err(StudyPlanError::value(format!("the name of a {what}"), "empty", "a name"));
        }
        if !seen.insert(name) {
            return Err(StudyPlanError::Duplicate { what, name: name.clone() });
        }
    }
    Ok(())
}
