//! How long work reports that it is alive, and how it is asked to stop.
//!
//! The library never prints. Whoever starts a job hands it a [`Progress`]; the command
//! line draws a bar, the studio sends a message, tests pass [`Silent`].

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Receives the state of a long job. Called often; must be cheap.
pub trait Progress: Send + Sync {
    /// `done` of `total` units are finished; `note` holds the figures of the moment.
    fn tick(&self, done: u64, total: u64, note: &str);

    /// From now on `done` and `total` count `unit`s of this part of the job.
    fn phase(&self, _what: &str, _unit: &str) {}

    /// A line worth keeping (a warning, a checkpoint).
    fn log(&self, line: &str);

    /// Figures for curves: an object with a `step`. Most listeners draw none.
    fn figures(&self, _point: &serde_json::Value) {}
}

/// Nobody listens.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Progress for Silent {
    fn tick(&self, _done: u64, _total: u64, _note: &str) {}
    fn log(&self, _line: &str) {}
}

/// A flag that asks a job to stop at the next safe point. Clones share the flag.
#[derive(Clone, Debug, Default)]
pub struct Cancel(Arc<AtomicBool>);

impl Cancel {
    /// Asks for the stop.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether a stop was asked for.
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
