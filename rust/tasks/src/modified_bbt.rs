use crate::{
    Arrangement, TargetPlacement, Task, TaskError, TaskFile, TaskInput, TaskResult, TaskState,
    arrangement::Region,
};
use proact_types::{BodyState, Briefing, EventKind, ObjectId, Pose, Scene, SimTime};
use serde_json::json;

/// The task apart from where its blocks start.
const FILE: &str = include_str!("../data/modified_bbt.toml");

const X_FAR: f64 = 0.058;
const X_NEAR: f64 = -0.058;
const Y_LATERAL: f64 = 0.2083;
const Y_MEDIAL: f64 = 0.092;

/// The modified box-and-blocks task (paper): four numbered blocks, in order, over the partition, in five minutes. The
/// rules are those of [`TargetPlacement`]; an [`Arrangement`] says where the blocks start.
#[derive(Clone, Debug)]
pub struct ModifiedBbt {
    arrangement: Arrangement,
    task: TargetPlacement,
}

/// Centre of a region on the start side (`y < 0`); its target is the mirror image in y.
fn region_center(region: Region) -> [f64; 2] {
    let x = match region {
        Region::FL | Region::FM => X_FAR,
        Region::NL | Region::NM => X_NEAR,
    };
    let y = match region {
        Region::FL | Region::NL => Y_LATERAL,
        Region::FM | Region::NM => Y_MEDIAL,
    };
    [x, -y]
}

impl ModifiedBbt {
    /// What the task is called in configurations.
    pub const NAME: &str = "modified_bbt";

    /// The task's file, with its blocks in `arrangement`.
    ///
    /// # Errors
    /// [`TaskError`] only if the file that ships with the program is broken, which a test rules out.
    pub fn file(arrangement: Arrangement) -> Result<TaskFile, TaskError> {
        let mut file = TaskFile::read(FILE)?;
        for (object, region) in file.scene.objects.iter_mut().zip(arrangement.regions()) {
            object.position_m = region_center(region);
        }
        Ok(file)
    }

    /// The task of `file`, which [`ModifiedBbt::task_file`] made for `arrangement`.
    pub(crate) fn new(file: &TaskFile, arrangement: Arrangement, left: bool) -> Result<Self, TaskError> {
        let (scene, order) = file.checked_scene(left)?;
        Ok(Self {
            arrangement,
            task: TargetPlacement::new(file.briefing.clone(), scene, order, file.expected_object),
        })
    }
}

impl Task for ModifiedBbt {
    fn scene(&self) -> &Scene {
        self.task.scene()
    }

    fn briefing(&self) -> &Briefing {
        self.task.briefing()
    }

    fn state(&self) -> &TaskState {
        self.task.state()
    }

    fn step(&mut self, now: SimTime, seen: &TaskInput<'_>) -> Vec<EventKind> {
        self.task.step(now, seen)
    }

    fn set_start(&mut self, object: ObjectId, start: Pose) {
        self.task.set_start(object, start);
    }

    fn result(&self, objects: &[BodyState]) -> TaskResult {
        let mut result = self.task.result(objects);
        let outcomes = self.task.results(objects);
        for (key, value) in [
            ("arrangement", json!(self.arrangement)),
            ("on_target", json!(self.state().score)),
            ("outcomes", json!(outcomes)),
        ] {
            result.legacy_fields.insert(key.to_owned(), value);
        }
        result.result.insert("arrangement".to_owned(), json!(self.arrangement));
        result
    }
}
