//! The same work in several threads, until all is done or one of them fails.

use std::{
    error::Error,
    sync::atomic::{AtomicBool, Ordering},
    thread,
};

/// Runs `work` in `jobs` threads, at least one, and waits for all. `failed` is set as soon as one of them fails: the others look at it
/// and come to an end.
///
/// # Errors
/// What went wrong, of several the one of the first thread; a panic is one.
pub(crate) fn run_in_threads(
    jobs: usize,
    failed: &AtomicBool,
    work: impl Fn() -> Result<(), Box<dyn Error>> + Sync,
) -> Result<(), String> {
    let run = || {
        let done = work();
        failed.fetch_or(done.is_err(), Ordering::Relaxed);
        done.map_err(|error| error.to_string())
    };
    thread::scope(|scope| {
        let threads: Vec<_> = (0..jobs.max(1)).map(|_| scope.spawn(run)).collect();
        // All are waited for before any is judged.
        let ends: Vec<_> = threads.into_iter().map(thread::ScopedJoinHandle::join).collect();
        ends.into_iter().try_for_each(|end| end.unwrap_or_else(|_| Err("a thread panicked".to_owned())))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicUsize;

    #[test]
    fn a_failure_ends_the_others_and_is_what_is_told() {
        let (next, failed) = (AtomicUsize::new(0), AtomicBool::new(false));
        let work = || {
            while !failed.load(Ordering::Relaxed) {
                if next.fetch_add(1, Ordering::Relaxed) == 40 {
                    return Err("the fortieth".into());
                }
                thread::yield_now();
            }
            Ok(())
        };
        // Without the flag the other three would never end.
        assert_eq!(run_in_threads(4, &failed, work), Err("the fortieth".to_owned()));
        assert_eq!(run_in_threads(0, &AtomicBool::new(false), || Ok(())), Ok(()));
    }
}
