//! Tasks: what stands where, what a person is told, what counts, and when it is over.
//!
//! Pure: geometry and rules as functions of simulated time and the poses of objects. A task is text: those that ship
//! with the program are files in `data/` (the modified box-and-blocks test also has an arrangement), and a lab's own is
//! another such file ([`TaskFile`]). The rules by which a task counts are types that implement [`Task`].
//!
//! ```
//! use proact_tasks::{Task, TaskChoice};
//! let task = TaskChoice::named("modified_bbt", 1)?.build(false)?;
//! assert_eq!(task.scene().objects.len(), 4);
//! # Ok::<(), proact_tasks::TaskError>(())
//! ```

mod across;
mod arrangement;
mod choice;
mod file;
mod goal_files;
mod goals;
mod grid;
mod heap;
mod modified_bbt;
mod moves;
mod norms;
mod outcome;
mod pursuit;
mod result_keys;
mod result_shapes;
mod scene;
mod targets;
mod task;
mod throughput;

pub use across::Across;
pub use arrangement::{Arrangement, ArrangementError};
pub use choice::{DEFAULT_TASK, SHIPPED, TaskChoice};
pub use file::{Rules, TaskError, TaskFile};
pub use goal_files::{MoveFile, PostureJoint, PosturesFile, ReachesFile};
pub use goals::GoalSequence;
pub use grid::{GridChoice, GridCount, GridPitch};
pub use heap::{HeapChoice, HeapFile};
pub use modified_bbt::ModifiedBbt;
pub use moves::ObjectMoves;
pub use norms::{Norm, Sex, Wearer, norms};
pub use outcome::{ObjectResult, Outcome};
pub use result_keys::{ResultError, check_beside, check_result, norms_of, object_results};
pub use scene::SceneFile;
pub use targets::Targets;
pub use task::{Task, TaskInput, TaskResult, TaskState};
