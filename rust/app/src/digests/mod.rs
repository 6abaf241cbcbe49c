//! Committed digests: sixteen short trials whose field hashes lie in `tests/digests`, one file a platform, so that a
//! change of the arithmetic is noticed and named. `proact update-digests` writes them.

mod changelog;
mod compare;
mod files;
mod platform;
mod trials;
mod update;

pub use changelog::add_digest_line;
pub use compare::{DigestDifference, StageDifferenceCounts, digest_differences, outcome_violations};
pub use files::{DigestError, DigestStore};
pub use platform::Platform;
pub use trials::{BlockOutcome, TrialDigest, TrialEntry, TrialOutcome};
pub use update::{DigestUpdate, update_digests};
