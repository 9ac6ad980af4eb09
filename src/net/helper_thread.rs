//! A second thread that waits for work.
//!
//! A window takes half a millisecond, and one is computed after each simulated frame. Starting a
//! thread for each window would cost a twelfth of that. So this thread waits actively for a while
//! before it sleeps, and yields its core on demand.

use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Rounds of waiting before the thread yields its core.
const SPINS: u32 = 500;
/// The time of active waiting before the thread sleeps: longer than the simulation of a frame.
const PATIENCE: Duration = Duration::from_millis(2);

/// Waits until `ready`, first at full speed, then yielding.
pub(super) fn until(ready: impl Fn() -> bool) {
    let mut spins = 0;
    while !ready() {
        if spins < SPINS {
            spins += 1;
            std::hint::spin_loop();
        } else {
            thread::yield_now();
        }
    }
}

/// The state that the thread shares with its caller.
#[derive(Debug, Default)]
struct Signals {
    /// Number of calls.
    calls: AtomicU64,
    /// Whether it sleeps, or is about to.
    asleep: AtomicBool,
    /// Whether it should end.
    over: AtomicBool,
}

impl Signals {
    // SeqCst here and in `call`: either the caller sees that the thread is asleep, or the thread
    // sees the call before it sleeps.
    fn wait(&self, done: u64) {
        let begin = Instant::now();
        let news = || self.calls.load(Ordering::SeqCst) != done || self.over.load(Ordering::SeqCst);
        until(|| news() || begin.elapsed() > PATIENCE);
        while !news() {
            self.asleep.store(true, Ordering::SeqCst);
            if !news() {
                thread::park();
            }
            self.asleep.store(false, Ordering::SeqCst);
        }
    }
}

/// The thread; it ends when this is dropped.
#[derive(Debug)]
pub(super) struct HelperThread {
    signals: Arc<Signals>,
    thread: Option<JoinHandle<()>>,
}

impl HelperThread {
    /// Starts the thread; `work` runs once per call.
    ///
    /// # Errors
    /// When the system cannot start a thread.
    pub(super) fn start(work: impl Fn() + Send + 'static) -> io::Result<HelperThread> {
        let signals = Arc::new(Signals::default());
        let own = Arc::clone(&signals);
        let thread = thread::Builder::new().name("helper".into()).spawn(move || {
            let mut done = 0;
            loop {
                own.wait(done);
                if own.over.load(Ordering::SeqCst) {
                    return;
                }
                done += 1;
                // The panic message has been printed; the caller that waits for the work sees the
                // failure there.
                catch_unwind(AssertUnwindSafe(&work)).ok();
            }
        })?;
        Ok(HelperThread { signals, thread: Some(thread) })
    }

    /// Lets the thread do its work once, after all earlier calls.
    pub(super) fn call(&self) {
        self.signals.calls.fetch_add(1, Ordering::SeqCst);
        if let (true, Some(thread)) = (self.signals.asleep.load(Ordering::SeqCst), &self.thread) {
            thread.thread().unpark();
        }
    }
}

impl Drop for HelperThread {
    fn drop(&mut self) {
        self.signals.over.store(true, Ordering::SeqCst);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            // Its panics were caught.
            thread.join().ok();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn works_once_a_call_awake_and_asleep() {
        let count = Arc::new(AtomicU64::new(0));
        let seen = Arc::clone(&count);
        let helper = HelperThread::start(move || {
            seen.fetch_add(1, Ordering::SeqCst);
        })
        .unwrap();
        for turn in 1..=200 {
            helper.call();
            until(|| count.load(Ordering::SeqCst) == turn);
            if turn % 50 == 0 {
                until(|| helper.signals.asleep.load(Ordering::SeqCst));
            }
        }
        drop(helper);
        assert_eq!(count.load(Ordering::SeqCst), 200);
        assert_eq!(Arc::strong_count(&count), 1, "the thread has ended");
    }

    #[test]
    fn goes_on_after_a_panic() {
        let count = Arc::new(AtomicU64::new(0));
        let seen = Arc::clone(&count);
        let helper = HelperThread::start(move || {
            assert!(seen.fetch_add(1, Ordering::SeqCst) > 0, "the first work panics");
        })
        .unwrap();
        helper.call();
        helper.call();
        until(|| count.load(Ordering::SeqCst) == 2);
    }
}
