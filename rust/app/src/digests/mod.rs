//! Committed digests: a dozen short trials whose field hashes lie in `tests/digests`, one file a platform, so that a
//! change of the arithmetic is noticed and named. `proact bless` writes them.

mod bless;
mod changelog;
mod compare;
mod files;
mod platform;
mod trials;

pub use bless::{Blessed, bless};
pub use changelog::with_line;
pub use compare::{Difference, Tally, differences, outcome_complaints};
pub use files::{DigestError, Store};
pub use platform::Platform;
pub use trials::{BlockEnd, TrialDigest, TrialEntry, TrialOutcome};
