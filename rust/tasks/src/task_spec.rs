use crate::{Arrangement, GridSpec, HeapFile, HeapSpec, ModifiedBbt, Task, TaskError, TaskFile};
use serde::{Deserialize, Serialize};

/// The tasks that ship with the program: name, and one line about each.
pub const BUILT_IN_TASKS: [(&str, &str); 10] = [
    (ModifiedBbt::NAME, "four blocks, each to its target, in order (paper)"),
    ("targeted_bbt", "sixteen cubes of 25 mm to their mirrored places, in order, timed"),
    ("bbt", "as many cubes of 25 mm over the partition as possible in a minute"),
    ("bbt_heap", "the same with a heap of 150 cubes, each trial's fallen as its seed says"),
    ("pasta_box", "a box from the side to two shelves and back (sizes assumed)"),
    ("cup_transfer", "two cups over a partition and back (sizes assumed)"),
    ("clothespins", "two pins to an upright rod and back (on ledges, not clipped)"),
    ("frame_transfer", "three objects between bars and shelves of a frame (all assumed)"),
    ("target_achievement", "eight postures of the arm, each kept for two seconds (TAC)"),
    ("reaching", "the hand into balls on rings in space (Fitts)"),
];

/// Texts of those that are files alone.
const FILES: [(&str, &str); 9] = [
    ("targeted_bbt", include_str!("../data/targeted_bbt.toml")),
    ("bbt", include_str!("../data/bbt.toml")),
    ("bbt_heap", include_str!("../data/bbt_heap.toml")),
    ("pasta_box", include_str!("../data/pasta_box.toml")),
    ("cup_transfer", include_str!("../data/cup_transfer.toml")),
    ("clothespins", include_str!("../data/clothespins.toml")),
    ("frame_transfer", include_str!("../data/frame_transfer.toml")),
    ("target_achievement", include_str!("../data/target_achievement.toml")),
    ("reaching", include_str!("../data/reaching.toml")),
];

/// The task of a trial unless another one is asked for.
pub const DEFAULT_TASK: &str = ModifiedBbt::NAME;

/// Which task, as a configuration says it: one that ships with the program, or a lab's own with its text.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TaskSpec {
    /// By which it is found, or which its text has.
    pub name: String,
    /// BLAKE3 of its content, 64 hexadecimal digits; none before the trial is put together.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hash: Option<String>,
    /// Where the blocks of the modified test stand at the start: red 1, red 2, blue 1, blue 2 in FL, FM, NL, NM.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub arrangement: Option<Arrangement>,
    /// How many objects stand in the task's grid, how far apart and how wide; as its text says where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub grid: Option<GridSpec>,
    /// How many objects lie in the task's heap, and how.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heap: Option<HeapSpec>,
    /// The text of a lab's own task.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub text: Option<String>,
}

impl TaskSpec {
    /// The task called `name` of those that ship with the program; `seed` chooses what it leaves to chance.
    ///
    /// # Errors
    /// [`TaskError::Unknown`] with those that there are.
    pub fn named(name: &str, seed: u64) -> Result<Self, TaskError> {
        if !BUILT_IN_TASKS.iter().any(|(known, _)| *known == name) {
            return Err(TaskError::Unknown { got: name.to_owned(), known: Self::known_names() });
        }
        let arrangement = (name == ModifiedBbt::NAME).then(|| Arrangement::by_seed(seed));
        Ok(Self { name: name.to_owned(), hash: None, arrangement, grid: None, heap: None, text: None })
    }

    /// A lab's own task.
    ///
    /// # Errors
    /// [`TaskError`]: a text that is no task, or a task that cannot be.
    pub fn from_text(text: String) -> Result<Self, TaskError> {
        let file = TaskFile::read(&text)?;
        if BUILT_IN_TASKS.iter().any(|(known, _)| *known == file.name) {
            let reason = format!("{:?} ships with the program; expected a name of its own", file.name);
            return Err(TaskError::Rule { key: "name", reason });
        }
        file.build(false)?;
        Ok(Self { name: file.name, hash: None, arrangement: None, grid: None, heap: None, text: Some(text) })
    }

    /// Another arrangement, such as `FL,NM,NL,FM`.
    ///
    /// # Errors
    /// [`TaskError`]: a text that is none, or a task that has none.
    pub fn set_arrangement(&mut self, arrangement: &str) -> Result<(), TaskError> {
        self.arrangement = Some(arrangement.parse()?);
        self.build(false).map(|_| ())
    }

    /// Names of all the ways in which the task's objects can stand at the start, as [`TaskSpec::set_arrangement`] takes them; none where
    /// there is one way.
    pub fn arrangements(&self) -> Vec<String> {
        let any = self.arrangement.is_some();
        Arrangement::all().filter(|_| any).map(|arrangement| arrangement.to_string()).collect()
    }

    /// Names of the tasks that ship with the program.
    pub fn known_names() -> String {
        BUILT_IN_TASKS.map(|(name, _)| name).join(", ")
    }

    /// The file of the task as it is without options: what a record is compared with.
    ///
    /// # Errors
    /// [`TaskError`].
    pub fn task_file(&self) -> Result<TaskFile, TaskError> {
        let first = Arrangement::numbered(1)?;
        match (&self.text, &*self.name) {
            (Some(text), _) => {
                let file = TaskFile::read(text)?;
                if file.name != self.name {
                    let reason = format!("{:?} in the text, {:?} in the configuration", file.name, self.name);
                    return Err(TaskError::Rule { key: "name", reason });
                }
                Ok(file)
            }
            (None, ModifiedBbt::NAME) => ModifiedBbt::file(first),
            (None, name) => match FILES.iter().find(|(shipped, _)| *shipped == name) {
                Some((_, text)) => TaskFile::read(text),
                None => Err(TaskError::Unknown { got: name.to_owned(), known: Self::known_names() }),
            },
        }
    }

    /// The task; `left`: mirrored, for the left hand.
    ///
    /// # Errors
    /// [`TaskError`]: no such task, a text that is none, an option that the task does not have.
    pub fn build(&self, left: bool) -> Result<Box<dyn Task>, TaskError> {
        self.build_with_limit(left, None)
    }

    /// [`TaskSpec::build`] with another limit of the trial, seconds.
    ///
    /// # Errors
    /// As [`TaskSpec::build`], and for a limit that is none.
    pub fn build_with_limit(&self, left: bool, limit_secs: Option<f64>) -> Result<Box<dyn Task>, TaskError> {
        let modified = self.text.is_none() && self.name == ModifiedBbt::NAME;
        let limit = |mut file: TaskFile| {
            file.briefing.limit_secs = limit_secs.unwrap_or(file.briefing.limit_secs);
            file
        };
        if modified {
            let arrangement = self.arrangement.map_or_else(|| Arrangement::numbered(1), Ok)?;
            let mut file = limit(ModifiedBbt::file(arrangement)?);
            self.apply_options(&mut file)?;
            return Ok(Box::new(ModifiedBbt::new(&file, arrangement, left)?));
        }
        if let Some(arrangement) = &self.arrangement {
            let (task, got) = (self.name.clone(), format!("arrangement = {arrangement}"));
            return Err(TaskError::Option { task, got, known: "no arrangement: that is modified_bbt's" });
        }
        let mut file = limit(self.task_file()?);
        self.apply_options(&mut file)?;
        file.build(left)
    }

    /// The heap that physics has yet to let fall before the trial begins; none where there is no heap, or it lies.
    ///
    /// # Errors
    /// As [`TaskSpec::task_file`], and for options of a heap that there is not.
    pub fn unsettled_heap(&self) -> Result<Option<HeapFile>, TaskError> {
        let mut file = self.task_file()?;
        self.apply_options(&mut file)?;
        Ok(file.scene.heap.filter(|heap| heap.resting_poses.is_empty() && heap.count > 0))
    }

    /// Gives grid and heap of the task as many objects as was asked for, as far apart, as wide and lying as they do, and its highest
    /// score.
    fn apply_options(&self, file: &mut TaskFile) -> Result<(), TaskError> {
        let before = file.scene.object_count();
        if let Some(grid) = &self.grid {
            grid.apply(&self.name, &mut file.scene)?;
        }
        if let Some(choice) = &self.heap {
            let Some(heap) = &mut file.scene.heap else {
                let (task, got) = (self.name.clone(), "heap".to_owned());
                return Err(TaskError::Option { task, got, known: "no heap: bbt_heap has one" });
            };
            heap.apply(choice);
        }
        // A score of which all objects are the most goes along; any other is not ours to change.
        if file.briefing.max_score == u32::try_from(before).ok() {
            file.briefing.max_score = u32::try_from(file.scene.object_count()).ok();
        }
        Ok(())
    }

    /// Seconds after which a trial ends unless it is told otherwise.
    ///
    /// # Errors
    /// As [`TaskSpec::task_file`].
    pub fn limit_secs(&self) -> Result<f64, TaskError> {
        Ok(self.task_file()?.briefing.limit_secs)
    }
}
