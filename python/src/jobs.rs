//! Long work beside the interpreter: Ctrl-C stops it, a callable hears how far it is.

use std::sync::Mutex;
use std::thread::{park_timeout, scope};
use std::time::{Duration, Instant};

use pyo3::prelude::*;
use robert::progress::{Cancel, Progress};

/// Time between two looks at the interpreter.
const LOOK: Duration = Duration::from_millis(50);

/// Forwards progress to a callable `(done, total, note)`; a callable that raises stops the work.
pub(crate) struct Listener {
    callable: Option<Py<PyAny>>,
    cancel: Cancel,
    state: Mutex<State>,
}

struct State {
    told: Instant,
    raised: Option<PyErr>,
}

impl Listener {
    /// Stops the work, for this reason.
    fn stop(&self, reason: PyErr) {
        if let Ok(mut state) = self.state.lock() {
            state.raised.get_or_insert(reason);
        }
        self.cancel.cancel();
    }
}

impl Progress for Listener {
    fn tick(&self, done: u64, total: u64, note: &str) {
        let Some(callable) = &self.callable else { return };
        {
            // A thread that finds another one here has nothing to add.
            let Ok(mut state) = self.state.try_lock() else { return };
            if state.raised.is_some() || (state.told.elapsed() < LOOK && done < total) {
                return;
            }
            state.told = Instant::now();
        }
        let heard = Python::attach(|py| callable.call1(py, (done, total, note)).map(drop));
        if let Err(e) = heard {
            self.stop(e);
        }
    }

    fn log(&self, _line: &str) {}
}

/// Does the work on a thread of its own without the interpreter's lock, while this thread looks
/// for Ctrl-C: only the main one is told of it.
pub(crate) fn listened<T: Send>(
    py: Python<'_>,
    progress: Option<Py<PyAny>>,
    work: impl FnOnce(&Listener, &Cancel) -> PyResult<T> + Send,
) -> PyResult<T> {
    let cancel = Cancel::default();
    let state = Mutex::new(State { told: Instant::now(), raised: None });
    let listener = Listener { callable: progress, cancel: cancel.clone(), state };
    let done = py.detach(|| {
        scope(|s| {
            let waiting = std::thread::current();
            let (listener, cancel) = (&listener, &cancel);
            let handle = s.spawn(move || {
                let done = work(listener, cancel);
                waiting.unpark();
                done
            });
            while !handle.is_finished() {
                park_timeout(LOOK);
                if let Err(e) = Python::attach(|py| py.check_signals()) {
                    listener.stop(e);
                }
            }
            handle.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        })
    });
    match listener.state.into_inner().ok().and_then(|s| s.raised) {
        Some(raised) => Err(raised),
        None => done,
    }
}
