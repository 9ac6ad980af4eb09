//! Which of two ways to do the same has been faster lately.
//!
//! Whether a second thread helps depends on what else the machine does, which changes while a
//! policy runs. So both are timed: the slower one is tried now and then, ever more seldom
//! while it keeps losing, and the smallest of its last few times counts, since a single one
//! says more of the scheduler than of the way.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Times kept of each way.
const KEPT: u64 = 4;
/// Uses between tries of the slower way: first, and at most.
const SELDOM: [u64; 2] = [32, 1024];

/// Clones of a policy share one, so that it learns from all of them. Relaxed throughout: a
/// time lost in a race is a time lost.
#[derive(Debug)]
pub(super) struct AdaptiveThreads {
    uses: AtomicU64,
    /// Uses left before the slower way is tried again, and the number it starts from.
    left: AtomicU64,
    seldom: AtomicU64,
    /// The last times of each way, ns, and how many there have been.
    times: [[AtomicU64; KEPT as usize]; 2],
    counts: [AtomicU64; 2],
}

impl Default for AdaptiveThreads {
    fn default() -> Self {
        AdaptiveThreads {
            uses: AtomicU64::new(0),
            left: AtomicU64::new(SELDOM[0]),
            seldom: AtomicU64::new(SELDOM[0]),
            times: Default::default(),
            counts: Default::default(),
        }
    }
}

impl AdaptiveThreads {
    /// The way to take now, 0 or 1.
    pub(super) fn choose(&self) -> usize {
        let get = |x: &AtomicU64| x.load(Ordering::Relaxed);
        let uses = self.uses.fetch_add(1, Ordering::Relaxed);
        if uses < 2 * KEPT {
            return (uses % 2) as usize;
        }
        let faster = self.faster();
        let left = get(&self.left);
        // The last uses of a period are the tries.
        if left <= KEPT {
            if left <= 1 {
                self.left.store(get(&self.seldom), Ordering::Relaxed);
                let next = (2 * get(&self.seldom)).min(SELDOM[1]);
                self.seldom.store(next, Ordering::Relaxed);
            } else {
                self.left.store(left - 1, Ordering::Relaxed);
            }
            return 1 - faster;
        }
        self.left.store(left - 1, Ordering::Relaxed);
        faster
    }

    /// Notes the time of one use.
    pub(super) fn took(&self, way: usize, time: Duration) {
        let before = self.faster();
        let at = self.counts[way].fetch_add(1, Ordering::Relaxed) % KEPT;
        let ns = u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
        self.times[way][at as usize].store(ns, Ordering::Relaxed);
        if self.faster() != before {
            // Things have changed: look more often again.
            self.seldom.store(SELDOM[0], Ordering::Relaxed);
            self.left.store(SELDOM[0], Ordering::Relaxed);
        }
    }

    fn faster(&self) -> usize {
        let [one, two] = [0, 1].map(|way: usize| {
            self.times[way].iter().map(|t| t.load(Ordering::Relaxed)).min().unwrap_or(0)
        });
        usize::from(two < one)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Share of the second way in `n` uses when the ways take these times.
    fn share(threads: &AdaptiveThreads, times: [u64; 2], n: u64) -> f64 {
        let mut second = 0;
        for _ in 0..n {
            let way = threads.choose();
            second += way as u64;
            threads.took(way, Duration::from_nanos(times[way]));
        }
        second as f64 / n as f64
    }

    #[test]
    fn takes_the_faster_way_and_notices_a_change() {
        let threads = AdaptiveThreads::default();
        assert!(share(&threads, [100, 60], 1000) > 0.9);
        assert!(share(&threads, [100, 400], 2000) < 0.05);
        assert!(share(&threads, [100, 400], 4000) < 0.02, "tried ever more seldom");
        assert!(share(&threads, [100, 60], 4000) > 0.7, "and found again");
    }
}
