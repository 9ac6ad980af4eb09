//! Runs one kind of work on several threads.

use super::error::Error;

/// Runs `work` on `threads` threads, including this one, and concatenates their results in no
/// particular order. The first error is returned, and is not hidden by a cancellation that it
/// caused elsewhere.
pub(super) fn for_each<T: Send>(
    threads: usize,
    work: impl Fn() -> Result<Vec<T>, Error> + Sync,
) -> Result<Vec<T>, Error> {
    let results: Vec<Result<Vec<T>, Error>> = std::thread::scope(|scope| {
        let handles: Vec<_> = (1..threads).map(|_| scope.spawn(&work)).collect();
        let mut results = vec![work()];
        for handle in handles {
            match handle.join() {
                Ok(result) => results.push(result),
                Err(panic) => std::panic::resume_unwind(panic),
            }
        }
        results
    });
    let mut all = Vec::new();
    let mut failed = None;
    for result in results {
        match (result, &failed) {
            (Ok(items), _) => all.extend(items),
            (Err(e), None | Some(Error::Cancelled { .. })) => failed = Some(e),
            (Err(_), Some(_)) => {}
        }
    }
    failed.map_or(Ok(all), Err)
}
