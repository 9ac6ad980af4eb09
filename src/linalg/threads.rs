//! Distributes work over threads. Each thread takes the next job of a queue.

use std::sync::{Mutex, PoisonError};

/// Runs `work(thread)` on this many threads, the caller's included.
pub fn on_threads(threads: usize, work: impl Fn(usize) + Sync) {
    std::thread::scope(|scope| {
        for t in 1..threads {
            let work = &work;
            scope.spawn(move || work(t));
        }
        work(0);
    });
}

/// The next job of a shared queue.
pub fn next_of<I: Iterator>(queue: &Mutex<I>) -> Option<I::Item> {
    queue.lock().unwrap_or_else(PoisonError::into_inner).next()
}
