//! Tasks: what stands where, what counts, and when it is over.
//!
//! Pure: geometry and rules as functions of simulated time and block poses. Depends on the vocabulary alone.
//!
//! ```
//! use proact_tasks::{Arrangement, BoxAndBlocks};
//! assert_eq!(Arrangement::all().count(), 24);
//! let task = BoxAndBlocks::new(Arrangement::numbered(1).expect("1 to 24"));
//! assert_eq!(task.scene().blocks.len(), 4);
//! ```

mod arrangement;
mod box_and_blocks;
mod geometry;
mod outcome;

pub use arrangement::{Arrangement, ArrangementError};
pub use box_and_blocks::{BoxAndBlocks, TaskState, TaskStep};
pub use geometry::{PlaceRegion, TABLE_TOP, fixed_objects, region_centre};
pub use outcome::{BlockResult, Outcome, TARGET_RADIUS};
