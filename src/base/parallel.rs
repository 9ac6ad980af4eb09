//! Runs one kind of work on several threads.

use std::sync::{Mutex, PoisonError};

/// Runs `work` on this many threads, the caller's included, and returns the result of each, the
/// caller's first. A panic on one of them goes on here.
pub fn on_threads<T: Send>(threads: usize, work: impl Fn() -> T + Sync) -> Vec<T> {
    std::thread::scope(|scope| {
        let others: Vec<_> = (1..threads).map(|_| scope.spawn(&work)).collect();
        let mut all = vec![work()];
        all.extend(
            others
                .into_iter()
                .map(|other| other.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))),
        );
        all
    })
}

/// The results of `each` for these items and their indices, in order. A free thread takes the next
/// item.
pub fn each<I: Sync, T: Send>(
    threads: usize,
    items: &[I],
    each: impl Fn(usize, &I) -> T + Sync,
) -> Vec<T> {
    let queue = Mutex::new(items.iter().enumerate());
    let next = || queue.lock().unwrap_or_else(PoisonError::into_inner).next();
    let work = || std::iter::from_fn(next).map(|(i, item)| (i, each(i, item))).collect::<Vec<_>>();
    let mut all: Vec<(usize, T)> =
        on_threads(threads.min(items.len()), work).into_iter().flatten().collect();
    all.sort_by_key(|(i, _)| *i);
    all.into_iter().map(|(_, result)| result).collect()
}

/// The cores of this machine that this process may use.
pub fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_in_order_whatever_the_threads() {
        for threads in [1, 3, 64] {
            assert_eq!(each(threads, &[5, 7, 9], |i, x| i * x), [0, 7, 18]);
        }
        assert!(each(4, &[0; 0], |_, x| *x).is_empty());
    }

    #[test]
    fn a_panic_of_one_goes_on_here() {
        let ran = std::panic::catch_unwind(|| {
            each(2, &[1, 2, 3], |_, x| assert_ne!(*x, 3, "third"));
        });
        let message = ran.unwrap_err();
        assert!(message.downcast_ref::<String>().is_some_and(|m| m.contains("third")));
    }
}
