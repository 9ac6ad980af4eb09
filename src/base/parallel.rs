//! Runs one kind of work on several threads.

use std::sync::atomic::{AtomicUsize, Ordering};

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

/// The results of `each` for 0 to `count`, in order. A free thread takes the next number.
pub fn each<T: Send>(threads: usize, count: usize, each: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let next = AtomicUsize::new(0);
    let work = || {
        let numbers = std::iter::repeat_with(|| next.fetch_add(1, Ordering::Relaxed));
        numbers.take_while(|n| *n < count).map(|n| (n, each(n))).collect::<Vec<_>>()
    };
    let mut all: Vec<(usize, T)> =
        on_threads(threads.min(count), work).into_iter().flatten().collect();
    all.sort_by_key(|(n, _)| *n);
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
            assert_eq!(each(threads, 10, |n| n * n), [0, 1, 4, 9, 16, 25, 36, 49, 64, 81]);
        }
        assert!(each(4, 0, |n| n).is_empty());
    }

    #[test]
    fn a_panic_of_one_goes_on_here() {
        let ran = std::panic::catch_unwind(|| each(2, 4, |n| assert_ne!(n, 3, "third")));
        let message = ran.unwrap_err();
        assert!(message.downcast_ref::<String>().is_some_and(|m| m.contains("third")));
    }
}
