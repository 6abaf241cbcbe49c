//! Tasks: what stands where, what a person is told, what counts, and when it is over.
//!
//! Pure: geometry and rules as functions of simulated time and the poses of objects. A task is text: those that ship
//! with the program are files in `data/` (the modified box-and-blocks test also has an arrangement), and a lab's own is
//! another such file ([`TaskFile`]). The rules by which a task counts are types that implement [`Task`].
//!
//! ```
//! use proact_tasks::{Task, TaskSpec};
//! let task = TaskSpec::named("modified_bbt", 1)?.build(false)?;
//! assert_eq!(task.scene().objects.len(), 4);
//! # Ok::<(), proact_tasks::TaskError>(())
//! ```

mod arrangement;
mod goal_attempt;
mod goal_files;
mod goals;
mod grid;
mod heap;
mod modified_bbt;
mod moves;
mod norms;
mod outcome;
mod partition_crossing;
mod result_check;
mod result_schemas;
mod scene;
mod target_placement;
mod task;
mod task_file;
mod task_spec;
mod throughput;

pub use arrangement::{Arrangement, ArrangementError};
pub use goal_files::{MoveFile, PostureJoint, PosturesFile, ReachesFile};
pub use goals::GoalSequence;
pub use grid::{GridCount, GridSpacing, GridSpec};
pub use heap::{HeapFile, HeapSpec};
pub use modified_bbt::ModifiedBbt;
pub use moves::ObjectMoves;
pub use norms::{NormativeScore, Sex, UserProfile, norms};
pub use outcome::{ObjectResult, Outcome};
pub use partition_crossing::PartitionCrossing;
pub use result_check::{ResultError, check_legacy_fields, check_result, norms_in_result, object_results};
pub use scene::SceneFile;
pub use target_placement::TargetPlacement;
pub use task::{Task, TaskInput, TaskResult, TaskState};
pub use task_file::{TaskError, TaskFile, TaskRules};
pub use task_spec::{BUILT_IN_TASKS, DEFAULT_TASK, TaskSpec};
