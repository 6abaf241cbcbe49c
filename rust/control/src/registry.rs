use crate::ports::{MethodProcess, NoProcess};
use crate::{
    ControlError, ControlMethod, EndEffectorJog, ExternalMethod, GazeAssisted, GazeAssistedProfile,
    GazeToggled, JointJog, JointSubset, Profile, build::with_safeguards,
};
use proact_arm::ArmModel;
use proact_types::{
    MAX_METHOD_NAME_BYTES, MAX_METHOD_TEXT_BYTES, MethodHelp, MethodInfo, MethodNeeds, MethodStyle,
};
use serde::{Deserialize, Serialize};
use std::{fmt, sync::Arc};

/// What an outside method is called that has no name of its own.
pub const EXTERNAL_METHOD_NAME: &str = "outside";

/// Makes a method as a profile describes it, for an arm, over the joints that it drives.
pub type MethodFactory =
    dyn Fn(&Profile, &ArmModel, &JointSubset) -> Result<Box<dyn ControlMethod>, ControlError> + Send + Sync;

/// A program in the place of a method, which reads and writes JSON lines (`docs/methods`).
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MethodProgram {
    /// The program and its arguments. A trial that is run starts it; a replay does not.
    pub command: Vec<String>,
    /// A live step without an answer after this time holds the arm, milliseconds. A batch waits for each answer.
    #[serde(default = "MethodProgram::default_deadline_ms")]
    pub deadline_ms: u64,
    /// What is told of the method; none if it only stands in the place of one that the registry has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub info: Option<MethodInfo>,
}

impl MethodProgram {
    /// `command` with the default deadline, in the place of a method of the registry.
    pub fn new(command: Vec<String>) -> Self {
        Self { command, deadline_ms: Self::default_deadline_ms(), info: None }
    }

    /// A control step is due every 10 ms; the rest of the tick needs its time too.
    fn default_deadline_ms() -> u64 {
        5
    }

    /// Checks ranges.
    ///
    /// # Errors
    /// [`ControlError::Program`] naming the first key that is out of range, [`ControlError::MethodText`].
    pub fn check(&self) -> Result<(), ControlError> {
        let bad = |key, got, expected| Err(ControlError::Program { key, got, expected });
        if self.command.first().is_none_or(|program| program.is_empty()) {
            return bad("command", format!("{:?}", self.command), "a program's name first");
        }
        if !(1..=1000).contains(&self.deadline_ms) {
            return bad("deadline_ms", self.deadline_ms.to_string(), "1 to 1000");
        }
        self.info.as_ref().map_or(Ok(()), check_info)
    }
}

/// The file of an outside method.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MethodFile {
    name: String,
    title: String,
    #[serde(default)]
    needs: MethodNeeds,
    #[serde(default)]
    style: MethodStyle,
    #[serde(default)]
    help: MethodHelp,
    command: Vec<String>,
    #[serde(default = "MethodProgram::default_deadline_ms")]
    deadline_ms: u64,
}

/// A method that can be chosen: what is told of it, and how it is made.
#[derive(Clone)]
pub struct MethodEntry {
    info: MethodInfo,
    constructor: MethodConstructor,
    single_joints: bool,
    arm_check: Option<ArmCheck>,
}

/// Why a method cannot drive an arm, if it cannot: the reason goes on after the method's name.
type ArmCheck = fn(&ArmModel) -> Result<(), &'static str>;

#[derive(Clone)]
enum MethodConstructor {
    Native(Arc<MethodFactory>),
    External(MethodProgram),
}

impl fmt::Debug for MethodEntry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("MethodEntry").field("info", &self.info).field("program", &self.program()).finish()
    }
}

impl MethodEntry {
    /// The method that `make` makes.
    pub fn new(
        info: MethodInfo,
        make: impl Fn(&Profile, &ArmModel, &JointSubset) -> Result<Box<dyn ControlMethod>, ControlError>
        + Send
        + Sync
        + 'static,
    ) -> Self {
        Self {
            info,
            constructor: MethodConstructor::Native(Arc::new(make)),
            single_joints: false,
            arm_check: None,
        }
    }

    /// The method that `program` is, as `info` tells of it.
    pub fn external(info: MethodInfo, program: MethodProgram) -> Self {
        Self {
            info,
            constructor: MethodConstructor::External(program),
            single_joints: false,
            arm_check: None,
        }
    }

    /// The outside method of a file (TOML): `name`, `title`, `needs`, `style`, `help`, `command`, `deadline_ms`.
    ///
    /// # Errors
    /// [`ControlError::MethodFile`] for unreadable text and unknown keys; a name or text that cannot be.
    pub fn from_toml(text: &str) -> Result<Self, ControlError> {
        let file: MethodFile = toml::from_str(text).map_err(|error| {
            let line = error.span().map_or(1, |span| text[..span.start].matches('\n').count() + 1);
            ControlError::MethodFile(format!("line {line}: {}", error.message().replace('`', "")))
        })?;
        let MethodFile { name, title, needs, style, help, command, deadline_ms } = file;
        let info = MethodInfo { name, title, needs, style, help };
        let program = MethodProgram { command, deadline_ms, info: Some(info.clone()) };
        program.check()?;
        Ok(Self::external(info, program))
    }

    /// The same for a method that moves one joint at a time: on a ROS graph it commands the controllers of single joints.
    #[must_use]
    pub fn with_single_joint_control(self) -> Self {
        Self { single_joints: true, ..self }
    }

    /// The same for a method that drives only the arms of which `fits` has nothing to say.
    #[must_use]
    pub fn with_arm_check(self, fits: ArmCheck) -> Self {
        Self { arm_check: Some(fits), ..self }
    }

    /// What is told of it.
    pub fn info(&self) -> &MethodInfo {
        &self.info
    }

    /// What it cannot do without.
    pub fn needs(&self) -> MethodNeeds {
        self.info.needs
    }

    /// It moves one joint at a time.
    pub fn single_joints(&self) -> bool {
        self.single_joints
    }

    /// The program that it is; none for a method in Rust.
    pub fn program(&self) -> Option<&MethodProgram> {
        match &self.constructor {
            MethodConstructor::Native(_) => None,
            MethodConstructor::External(program) => Some(program),
        }
    }

    /// The method as `profile` describes it, for the arm `model`, with the profile's safeguards around it: an assistant
    /// that shares the speeds, dead man, limiter, and the joints of the person's own limb. `process` answers for an
    /// outside method; others leave it alone.
    ///
    /// # Errors
    /// A profile that does not fit the arm, or what the method needs.
    pub fn build(
        &self,
        profile: &Profile,
        model: &ArmModel,
        process: impl MethodProcess + 'static,
    ) -> Result<Box<dyn ControlMethod>, ControlError> {
        profile.check()?;
        let subset = JointSubset::for_style(self.info.style, profile, model)?;
        self.check_profile(profile, &subset)?;
        if let Some(Err(reason)) = self.arm_check.map(|fits| fits(model)) {
            return Err(ControlError::Unsupported { method: self.info.name.clone(), reason });
        }
        let built = match &self.constructor {
            MethodConstructor::Native(make) => make(profile, model, &subset)?,
            MethodConstructor::External(_) => Box::new(ExternalMethod::new(process)),
        };
        Ok(with_safeguards(built, profile, subset, model))
    }

    fn check_profile(&self, profile: &Profile, subset: &JointSubset) -> Result<(), ControlError> {
        let refuse = |reason| Err(ControlError::Unsupported { method: self.info.name.clone(), reason });
        let needs = self.info.needs;
        if needs.whole_arm && !subset.is_whole() {
            return refuse("drives the whole arm: choose level = \"shoulder\", or another method");
        }
        if needs.limb && subset.is_whole() {
            return refuse(
                "needs the person's own limb: choose a level that leaves joints to it, such as above_elbow (--set profile.level=above_elbow)",
            );
        }
        if needs.plans && profile.blend.is_some() {
            return refuse(
                "plans its motions, there is no speed to blend: leave profile.blend out, or use method A or B",
            );
        }
        if needs.plans && profile.jog.simultaneous().is_some() {
            return refuse(
                "plans its motions, a regressor has nothing to drive: leave profile.jog.simultaneous out, or use method A or B",
            );
        }
        Ok(())
    }
}

/// The methods that can be chosen: a value, which whoever offers a choice is given.
#[derive(Clone, Debug)]
pub struct MethodRegistry {
    entries: Vec<MethodEntry>,
}

impl Default for MethodRegistry {
    fn default() -> Self {
        Self::standard()
    }
}

impl MethodRegistry {
    /// The methods that ship with the program: A, B, C and D.
    pub fn standard() -> Self {
        let info = |name: &str, title: &str, needs, style, help| MethodInfo {
            name: name.to_owned(),
            title: title.to_owned(),
            needs,
            style,
            help,
        };
        let gaze = MethodNeeds { gaze: true, plans: true, ..MethodNeeds::default() };
        let jogs = |summary: &str, thing: &str| MethodHelp {
            summary: summary.to_owned(),
            hand_close: "close / open".to_owned(),
            hand_open: format!("next {thing}"),
            wrist_extension: "move +".to_owned(),
            wrist_flexion: "move \u{2212}".to_owned(),
        };
        let selects = |summary: &str| MethodHelp {
            summary: summary.to_owned(),
            hand_close: "close hand".to_owned(),
            hand_open: "open hand".to_owned(),
            wrist_extension: "move (hold)".to_owned(),
            wrist_flexion: "lock".to_owned(),
        };
        let a = MethodEntry::new(
            info(
                "A",
                "Joint control",
                MethodNeeds::default(),
                MethodStyle::Jogging,
                jogs("One joint after the other; hand open goes to the next.", "joint"),
            ),
            |profile, model, subset| Ok(Box::new(JointJog::new(profile, model, subset)?)),
        );
        let b = MethodEntry::new(
            info(
                "B",
                "End-effector control",
                MethodNeeds::default(),
                MethodStyle::Jogging,
                jogs(
                    "The hand along, or about, one axis after the other; hand open goes to the next.",
                    "axis",
                ),
            ),
            |profile, model, subset| Ok(Box::new(EndEffectorJog::new(profile, model, subset)?)),
        );
        let c = MethodEntry::new(
            info(
                "C",
                "Gaze",
                gaze,
                MethodStyle::Selecting,
                selects("Look at what you mean; the arm plans its own way there."),
            ),
            gaze_method,
        );
        let d = MethodEntry::new(
            info(
                "D",
                "Gaze and task context",
                MethodNeeds { prior: true, ..gaze },
                MethodStyle::Selecting,
                selects("Look at what you mean; what the task asks for next counts too."),
            ),
            gaze_method,
        );
        Self { entries: vec![a.with_single_joint_control(), b, c, d] }
    }

    /// The same with one more.
    ///
    /// # Errors
    /// [`ControlError::DuplicateMethod`] if there is one of its name, [`ControlError::MethodText`] for a name or text that
    /// cannot be.
    pub fn with(mut self, entry: MethodEntry) -> Result<Self, ControlError> {
        check_info(&entry.info)?;
        if self.entries.iter().any(|known| known.info.name == entry.info.name) {
            let known = self.names().join(", ");
            return Err(ControlError::DuplicateMethod { got: entry.info.name, known });
        }
        self.entries.push(entry);
        Ok(self)
    }

    /// All of them, in their order.
    pub fn entries(&self) -> &[MethodEntry] {
        &self.entries
    }

    /// Their names.
    pub fn names(&self) -> Vec<&str> {
        self.entries.iter().map(|entry| entry.info.name.as_str()).collect()
    }

    /// What is told of those that `profile` and `model` allow.
    pub fn compatible_methods(&self, profile: &Profile, model: &ArmModel) -> Vec<MethodInfo> {
        let fits = |entry: &&MethodEntry| entry.build(profile, model, NoProcess).is_ok();
        self.entries.iter().filter(fits).map(|entry| entry.info.clone()).collect()
    }

    /// The method called `name`.
    ///
    /// # Errors
    /// [`ControlError::Method`] with the names there are.
    pub fn get(&self, name: &str) -> Result<&MethodEntry, ControlError> {
        let found = self.entries.iter().find(|entry| entry.info.name == name);
        found.ok_or_else(|| ControlError::Method { got: name.to_owned(), known: self.names().join(", ") })
    }

    /// The method of a trial whose configuration names `name`, and `program` if it is an outside one. A program without a
    /// name of its own stands in the place of the method `name`, which says no more than what the posterior knows and how
    /// the method is driven.
    ///
    /// # Errors
    /// [`ControlError::Method`]; a program of another name.
    pub fn resolve(&self, name: &str, program: Option<&MethodProgram>) -> Result<MethodEntry, ControlError> {
        let Some(program) = program else { return self.get(name).cloned() };
        let info = match &program.info {
            Some(info) if info.name != name => {
                return Err(ControlError::ProgramMismatch {
                    method: name.to_owned(),
                    program: info.name.clone(),
                });
            }
            Some(info) => info.clone(),
            None => {
                let existing = self.get(name)?.info();
                let needs = MethodNeeds { plans: false, whole_arm: false, ..existing.needs };
                MethodInfo { name: EXTERNAL_METHOD_NAME.to_owned(), needs, ..existing.clone() }
            }
        };
        Ok(MethodEntry::external(info, program.clone()))
    }
}

fn gaze_method(
    profile: &Profile,
    model: &ArmModel,
    subset: &JointSubset,
) -> Result<Box<dyn ControlMethod>, ControlError> {
    match profile.gaze_assisted {
        GazeAssistedProfile::LockOnce(rules) => {
            Ok(Box::new(GazeAssisted::new(rules).with_residual_limb(subset, model)))
        }
        GazeAssistedProfile::ToggleLocks(_) if !subset.is_whole() => Err(ControlError::Unsupported {
            method: "of the profile original".to_owned(),
            reason: "asks for whole poses of the hand, as the original does, which part of an arm cannot reach: choose \
                     level = \"shoulder\", method A or B, or the default profile",
        }),
        GazeAssistedProfile::ToggleLocks(rules) => Ok(Box::new(GazeToggled::new(rules, model))),
    }
}

fn check_info(info: &MethodInfo) -> Result<(), ControlError> {
    let name = &info.name;
    let word = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    if name.is_empty()
        || name.len() > MAX_METHOD_NAME_BYTES
        || !name.chars().all(word)
        || name == EXTERNAL_METHOD_NAME
    {
        return Err(ControlError::MethodText {
            key: "name",
            got: name.clone(),
            expected: "1 to 32 letters, digits, _ and -, other than outside",
        });
    }
    let texts = std::iter::once(("title", info.title.as_str())).chain(info.help.texts());
    for (key, text) in texts {
        let empty = key == "title" && text.trim().is_empty();
        if empty || text.len() > MAX_METHOD_TEXT_BYTES || text.chars().any(char::is_control) {
            return Err(ControlError::MethodText {
                key,
                got: text.to_owned(),
                expected: "a line of text of at most 400 bytes; the title must not be empty",
            });
        }
    }
    Ok(())
}
