//! Runs one kind of work on several threads.

use super::error::Error;
use robert_base::parallel;

/// Runs `work` on `threads` threads, including this one, and concatenates their results in no
/// particular order. The first error is returned, and is not hidden by a cancellation that it
/// caused elsewhere.
pub(super) fn for_each<T: Send>(
    threads: usize,
    work: impl Fn() -> Result<Vec<T>, Error> + Sync,
) -> Result<Vec<T>, Error> {
    let mut all = Vec::new();
    let mut failed = None;
    for result in parallel::on_threads(threads, work) {
        match (result, &failed) {
            (Ok(items), _) => all.extend(items),
            (Err(e), None | Some(Error::Cancelled { .. })) => failed = Some(e),
            (Err(_), Some(_)) => {}
        }
    }
    failed.map_or(Ok(all), Err)
}
