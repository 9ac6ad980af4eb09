//! Progress reports of jobs, and how a job is asked to stop.
//!
//! The library never prints. The caller of a job passes a [`Progress`]: the command line draws a
//! bar, the studio sends a message, tests pass [`Silent`].

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use serde::{Deserialize, Serialize};
use serde_json::Value;

/// One line that a command writes with `--jsonl`, for the program that started it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "lowercase")]
#[derive(schemars::JsonSchema)]
pub enum JobEvent {
    /// A report of progress.
    Progress(JobProgress),
    /// Figures for curves, with the `step` that they belong to.
    Figures {
        /// Values by name.
        #[schemars(with = "serde_json::Map<String, Value>")]
        figures: Value,
    },
    /// A line worth keeping.
    Log {
        /// The line.
        line: String,
    },
    /// The last event: the document that the command prints with `--json`.
    Result {
        /// The document.
        result: Value,
    },
}

/// The progress of a job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct JobProgress {
    /// The part of the job that runs.
    pub what: String,
    /// The unit that is counted, such as `steps`.
    pub unit: String,
    /// Units finished.
    pub done: u64,
    /// Units in this part.
    pub total: u64,
    /// Seconds since this part began.
    pub secs: f64,
    /// Current figures.
    pub note: String,
}

/// Receives the state of a long job. Called often; must be cheap.
pub trait Progress: Send + Sync {
    /// `done` of `total` units are finished; `note` contains the current figures.
    fn tick(&self, done: u64, total: u64, note: &str);

    /// From now on `done` and `total` count `unit`s of this part of the job.
    fn phase(&self, _what: &str, _unit: &str) {}

    /// A line worth keeping (a warning, a checkpoint).
    fn log(&self, line: &str);

    /// Figures for curves: an object with a `step`. Most listeners ignore them.
    fn figures(&self, _point: &Value) {}
}

/// Ignores all progress.
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
