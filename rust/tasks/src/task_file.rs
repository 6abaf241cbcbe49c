use crate::{
    ArrangementError, GoalSequence, ObjectMoves, PartitionCrossing, SceneFile, TargetPlacement, Task,
    goal_files::{MoveFile, PosturesFile, ReachesFile},
    heap::HEAP_KEYS,
    partition_crossing::HeapRefill,
};
use proact_types::{
    Briefing, Destination, MAX_OBJECTS, ObjectId, Order, Scene, format_number, shorten_numbers,
};
use serde::{Deserialize, Serialize};

/// Why there is no task.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TaskError {
    /// Neither a task that ships with the program nor a file.
    #[error("task {got:?} is unknown; expected {known}, or a TOML file that describes one")]
    Unknown {
        /// What was asked for.
        got: String,
        /// What there is.
        known: String,
    },
    /// The text is not a task.
    #[error("the task is unreadable: {}", shorten_numbers(.0))]
    Text(String),
    /// The scene cannot be.
    #[error("the task's scene: {}", shorten_numbers(.0))]
    Scene(String),
    /// The rules cannot be.
    #[error("the task's {key}: {}", shorten_numbers(reason))]
    Rule {
        /// Such as `order`.
        key: &'static str,
        /// What was got and expected.
        reason: String,
    },
    /// An option that the task does not have.
    #[error("task {task:?} has no option {got:?}; expected {known}")]
    Option {
        /// The task's name.
        task: String,
        /// What was given.
        got: String,
        /// What there is.
        known: &'static str,
    },
    /// The arrangement of the modified box-and-blocks test.
    #[error(transparent)]
    Arrangement(#[from] ArrangementError),
}

/// By which rules a task counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TaskRules {
    /// Objects that rest on their targets: [`TargetPlacement`].
    Targets,
    /// Objects whose carrier's fingertips crossed the partition: [`PartitionCrossing`].
    Across,
    /// Objects that come to rest at one place after the other: [`ObjectMoves`].
    Moves,
    /// The hand in one ball after the other: [`GoalSequence`].
    Reaches,
    /// The arm's joints in one posture after the other: [`GoalSequence`].
    Postures,
}

impl TaskRules {
    /// Whether the display shows what is asked for, and the file says it in a part of its own.
    fn displays_goal(self) -> bool {
        matches!(self, Self::Moves | Self::Reaches | Self::Postures)
    }
}

/// What tells which object is due, for the prior of method D.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ExpectedObject {
    /// Nothing: any object may be.
    #[default]
    Any,
    /// The next one of the order.
    Next,
    /// Those of another colour than the one released last; before that, those of the first of the order (paper).
    #[serde(rename = "other_colour")]
    OtherColor,
}

/// A task as text (TOML). Docs: `docs/extending.md`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TaskFile {
    /// By which it is called in configurations and results.
    pub name: String,
    /// How it counts.
    pub rules: TaskRules,
    /// What tells which object is due.
    #[serde(default)]
    #[serde(rename = "due")]
    pub expected_object: ExpectedObject,
    /// The prescribed order, by name; that of the scene where it is empty.
    #[serde(default)]
    pub order: Vec<String>,
    /// Of the rules `across`: when fewer objects than this are left to take, those that are across fall back to where they began.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refill_below: Option<usize>,
    /// What a person is told.
    pub briefing: Briefing,
    /// What stands where.
    pub scene: SceneFile,
    /// Of the rules `moves`: what goes where, in this order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub moves: Vec<MoveFile>,
    /// Of the rules `reaches`: where the hand goes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reaches: Option<ReachesFile>,
    /// Of the rules `postures`: how the joints are to stand.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub postures: Option<PosturesFile>,
}

/// What all objects of a kind have in common, an object's own keys, and a grid's.
const KIND_KEYS: [&str; 7] =
    ["colour", "shape", "mass", "friction", "friction_finger", "loose", "target_radius"];
const OBJECT_KEYS: [&str; 6] = ["name", "label", "ros_name", "at", "stands_at", "target"];
const GRID_KEYS: [&str; 7] =
    ["name", "count", "pitch", "middle", "mirrored_targets", "target_pitch", "chequered"];

/// Objects and grids share keys, which are read from within them: so that unknown ones are refused here.
fn check_keys(text: &str) -> Result<(), TaskError> {
    // What is no TOML is told with its line by who reads it.
    let Ok(table) = toml::from_str::<toml::Table>(text) else { return Ok(()) };
    let lists = [
        ("objects", OBJECT_KEYS.as_slice()),
        ("grids", GRID_KEYS.as_slice()),
        ("heap", HEAP_KEYS.as_slice()),
    ];
    for (list, own) in lists {
        let value = table.get("scene").and_then(|scene| scene.get(list));
        let entries = value.and_then(toml::Value::as_array).into_iter().flatten().chain(value);
        for entry in entries.filter_map(toml::Value::as_table) {
            let known = || KIND_KEYS.iter().chain(own);
            if let Some(key) = entry.keys().find(|key| !known().any(|known| known == key)) {
                let expected: Vec<&str> = known().copied().collect();
                return Err(TaskError::Text(format!(
                    "scene.{list}: unknown field {key}, expected one of {}",
                    expected.join(", ")
                )));
            }
        }
    }
    Ok(())
}

fn missing(key: &'static str) -> TaskError {
    TaskError::Rule { key, reason: format!("not given, and the rules are \"{key}\"; expected that part") }
}

impl TaskFile {
    /// Reads a task.
    ///
    /// # Errors
    /// [`TaskError::Text`] with the line.
    pub fn read(text: &str) -> Result<Self, TaskError> {
        check_keys(text)?;
        let file: Self = toml::from_str(text).map_err(|error| {
            let line = error.span().map_or(1, |span| text[..span.start].matches('\n').count() + 1);
            TaskError::Text(format!("line {line}: {}", error.message().replace('`', "")))
        })?;
        if file.name.is_empty() || file.name.len() > 64 || file.name.chars().any(char::is_control) {
            let reason = format!("{:?}, expected 1 to 64 printable bytes", file.name);
            return Err(TaskError::Rule { key: "name", reason });
        }
        Ok(file)
    }

    /// The task; `left`: mirrored, for the left hand.
    ///
    /// # Errors
    /// [`TaskError`]: a scene that cannot be, an order that names no object or one twice, times that are no times, an
    /// object without the target that it needs.
    pub fn build(&self, left: bool) -> Result<Box<dyn Task>, TaskError> {
        let (scene, order) = self.checked_scene(left)?;
        Ok(match self.rules {
            TaskRules::Targets => {
                Box::new(TargetPlacement::new(self.briefing.clone(), scene, order, self.expected_object))
            }
            TaskRules::Across => {
                let refills = self.refill_below.zip(self.scene.heap.clone());
                let refill = refills.map(|(below, heap)| HeapRefill::new(below, heap));
                Box::new(PartitionCrossing::new(self.briefing.clone(), scene, refill))
            }
            TaskRules::Moves => {
                let (scene, moves) = MoveFile::to_moves(&self.moves, scene, left)?;
                Box::new(ObjectMoves::new(self.briefing.clone(), scene, moves))
            }
            TaskRules::Reaches => {
                let file = self.reaches.as_ref().ok_or_else(|| missing("reaches"))?;
                let (dwell, limit) = (file.dwell_secs, file.limit_secs);
                Box::new(GoalSequence::new(self.briefing.clone(), scene, file.goals(left)?, dwell, limit))
            }
            TaskRules::Postures => {
                let file = self.postures.as_ref().ok_or_else(|| missing("postures"))?;
                let (dwell, limit) = (file.dwell_secs, file.limit_secs);
                Box::new(GoalSequence::new(self.briefing.clone(), scene, file.goals()?, dwell, limit))
            }
        })
    }

    /// The parts of the file are those of its rules.
    fn check_sections(&self) -> Result<(), TaskError> {
        let parts = [
            ("moves", !self.moves.is_empty(), TaskRules::Moves),
            ("reaches", self.reaches.is_some(), TaskRules::Reaches),
            ("postures", self.postures.is_some(), TaskRules::Postures),
        ];
        for (key, given, rules) in parts {
            if given && self.rules != rules {
                let reason = format!("given, and the rules are not \"{key}\"; expected one of the two");
                return Err(TaskError::Rule { key, reason });
            }
            if !given && self.rules == rules {
                return Err(missing(key));
            }
        }
        Ok(())
    }

    /// The scene, and its objects in the prescribed order.
    pub(crate) fn checked_scene(&self, left: bool) -> Result<(Scene, Vec<ObjectId>), TaskError> {
        let wrong = |key, reason| Err(TaskError::Rule { key, reason });
        let scene = self.scene.scene(left)?;
        let goals = matches!(self.rules, TaskRules::Reaches | TaskRules::Postures);
        if scene.objects.is_empty() && !goals {
            return Err(TaskError::Scene(format!("0 objects, expected 1 to {MAX_OBJECTS}")));
        }
        self.check_sections()?;
        let Briefing { practice_secs, limit_secs, order, destination, .. } = &self.briefing;
        if !(0.001..=3600.0).contains(limit_secs) {
            let got = format_number(*limit_secs);
            return wrong("briefing.limit_secs", format!("{got}, expected 0.001 to 3600"));
        }
        if !(0.0..*limit_secs).contains(practice_secs) {
            let reason =
                format!("{practice_secs}, expected at least 0 and less than limit_secs, {limit_secs}");
            return wrong("briefing.practice_secs", reason);
        }
        let fitting = match self.rules {
            TaskRules::Targets => Destination::OwnTarget,
            TaskRules::Across => Destination::Across,
            TaskRules::Moves | TaskRules::Reaches | TaskRules::Postures => Destination::Displayed,
        };
        if *destination != fitting {
            let [got, expected] = [*destination, fitting].map(file_word);
            let reason = format!("{got:?}, expected {expected:?}: that is what these rules count");
            return wrong("briefing.destination", reason);
        }
        if self.rules == TaskRules::Across
            && (*order != Order::Any || self.expected_object != ExpectedObject::Any || !self.order.is_empty())
        {
            let reason =
                "the rules \"across\" know no order; leave order and due out, briefing.order is \"any\"";
            return wrong("order", reason.to_owned());
        }
        if self.refill_below.is_some() && (self.rules != TaskRules::Across || self.scene.heap.is_none()) {
            let reason = "objects fall back into a heap with the rules \"across\" alone; leave it out";
            return wrong("refill_below", reason.to_owned());
        }
        if self.rules.displays_goal() && (*order != Order::Prescribed || !self.order.is_empty()) {
            let reason =
                "these rules have an order of their own; leave it out, briefing.order is \"prescribed\"";
            return wrong("order", reason.to_owned());
        }
        if self.rules != TaskRules::Across && *practice_secs > 0.0 {
            let rules = serde_json::to_string(&self.rules).unwrap_or_default();
            return wrong(
                "briefing.practice_secs",
                format!("{practice_secs}, the rules {rules} have no practice"),
            );
        }
        if let Some(object) =
            scene.ids().find(|id| self.rules == TaskRules::Targets && scene.target(*id).is_none())
        {
            return wrong(
                "scene",
                format!("{:?} has no target, and the rules count targets", scene.name(object)),
            );
        }
        let mut ids = Vec::new();
        for name in &self.order {
            let Some(id) = scene.find_object(name) else {
                let known: Vec<&str> = scene.objects.iter().map(|object| &*object.name).collect();
                return wrong("order", format!("{name:?} is no object; expected {}", known.join(", ")));
            };
            if ids.contains(&id) {
                return wrong("order", format!("{name:?} stands there twice"));
            }
            ids.push(id);
        }
        if ids.is_empty() {
            ids = scene.ids().collect();
        } else if ids.len() != scene.objects.len() {
            let (got, expected) = (ids.len(), scene.objects.len());
            return wrong("order", format!("{got} names, expected all {expected} objects, or none"));
        }
        Ok((scene, ids))
    }
}

/// The value of `briefing.destination` in a task file.
fn file_word(destination: Destination) -> &'static str {
    match destination {
        Destination::OwnTarget => "own_target",
        Destination::Across => "across",
        Destination::Displayed => "shown",
    }
}
