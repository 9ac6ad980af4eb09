//! Long work beside the interpreter: Ctrl-C stops it, a callable hears how far it is.

use std::sync::Mutex;
use std::time::{Duration, Instant};

use pyo3::prelude::*;
use robert::progress::{Cancel, Progress};

/// Time between two looks at the interpreter.
const LOOK: Duration = Duration::from_millis(50);

/// Forwards progress to a callable `(done, total, note)` and asks for a stop on Ctrl-C, or
/// where the callable raised.
pub(crate) struct Listener {
    callable: Option<Py<PyAny>>,
    cancel: Cancel,
    state: Mutex<State>,
}

struct State {
    looked: Instant,
    raised: Option<PyErr>,
}

impl Listener {
    pub(crate) fn new(callable: Option<Py<PyAny>>, cancel: &Cancel) -> Listener {
        let state = Mutex::new(State { looked: Instant::now(), raised: None });
        Listener { callable, cancel: cancel.clone(), state }
    }

    /// What stopped the work, where the interpreter did.
    pub(crate) fn raised(self) -> Option<PyErr> {
        self.state.into_inner().ok().and_then(|s| s.raised)
    }

    fn look(&self, done: u64, total: u64, note: &str) {
        // A thread that finds another one here has nothing to add.
        let Ok(mut state) = self.state.try_lock() else { return };
        if state.raised.is_some() || (state.looked.elapsed() < LOOK && done < total) {
            return;
        }
        state.looked = Instant::now();
        let heard = Python::attach(|py| {
            if let Some(callable) = &self.callable {
                callable.call1(py, (done, total, note))?;
            }
            py.check_signals()
        });
        if let Err(e) = heard {
            state.raised = Some(e);
            self.cancel.cancel();
        }
    }
}

impl Progress for Listener {
    fn tick(&self, done: u64, total: u64, note: &str) {
        self.look(done, total, note);
    }

    fn log(&self, _line: &str) {}
}
