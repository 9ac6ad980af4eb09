//! Measures two equivalent methods, and uses the one that has recently been faster.
//!
//! Whether a second thread helps depends on the other load of the machine, which changes while a
//! policy runs. So both methods are timed. The slower one is tried now and then, and less often the
//! longer it stays slower. Each method is judged by the shortest of its last few times, since a
//! single time depends mostly on the scheduler.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Number of times kept per method.
const KEPT: u64 = 4;
/// Uses between trials of the slower method: at first, and at most.
const SELDOM: [u64; 2] = [32, 1024];

/// Clones of a policy share one, so that it learns from all of them. Relaxed ordering is enough,
/// since losing a time in a race does no harm.
#[derive(Debug)]
pub(super) struct AdaptiveThreads {
    uses: AtomicU64,
    /// Uses left before the next trial of the slower method, and the number that it starts from.
    left: AtomicU64,
    seldom: AtomicU64,
    /// The last times of each method, ns, and their total number.
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
    /// The method to use now, 0 or 1.
    pub(super) fn choose(&self) -> usize {
        let get = |x: &AtomicU64| x.load(Ordering::Relaxed);
        let uses = self.uses.fetch_add(1, Ordering::Relaxed);
        if uses < 2 * KEPT {
            return (uses % 2) as usize;
        }
        let faster = self.faster();
        let left = get(&self.left);
        // The last uses of a period are the trials.
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

    /// Records the time of one use.
    pub(super) fn took(&self, way: usize, time: Duration) {
        let before = self.faster();
        let at = self.counts[way].fetch_add(1, Ordering::Relaxed) % KEPT;
        let ns = u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
        self.times[way][at as usize].store(ns, Ordering::Relaxed);
        if self.faster() != before {
            // Conditions have changed, so try more often again.
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

    /// Share of the second method in `n` uses if the methods take these times.
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
