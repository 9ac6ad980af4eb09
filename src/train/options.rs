//! Options of a run that do not change its result, the evaluator interface, and the outcome.

use std::path::PathBuf;

use serde::Serialize;

use super::fitted_ridge::FittedRidge;
use super::hindsight::Perform;
use super::metrics::{Evaluation, HeldOut};
use robert_base::progress::{Cancel, Progress};
use robert_net::{Engines, Model};

/// Evaluates a network by rollouts instead of by its loss.
pub trait Evaluate {
    /// Rolls the network out; `None` if a stop was requested meanwhile.
    ///
    /// # Errors
    /// A message; the run stops with it.
    fn evaluate(&mut self, model: &Model, cancel: &Cancel) -> Result<Option<Evaluation>, String>;

    /// As [`Evaluate::evaluate`], for the linear prediction alone. It equals an untrained network
    /// with a skip, so the network need not be computed.
    ///
    /// # Errors
    /// As [`Evaluate::evaluate`].
    fn evaluate_linear(
        &mut self,
        model: &Model,
        cancel: &Cancel,
    ) -> Result<Option<Evaluation>, String> {
        self.evaluate(model, cancel)
    }
}

/// Options of a run; none of them changes its bits, except that a graphics card rounds otherwise.
pub struct Options<'a> {
    /// Run directory.
    pub dir: PathBuf,
    /// Threads.
    pub threads: usize,
    /// Seconds between checkpoints.
    pub checkpoint_secs: f64,
    /// Evaluations in a run, spread evenly; the last is at the end.
    pub evaluations: u64,
    /// A run ends early after this many evaluations in a row that are each much worse than the
    /// best, unless the last of them is clearly better than the others; 0 for never.
    pub patience: u64,
    /// Receives the progress.
    pub progress: &'a dyn Progress,
    /// Asks for a stop.
    pub cancel: &'a Cancel,
    /// Closed-loop evaluator; without one only the last model is kept.
    pub evaluator: Option<&'a mut dyn Evaluate>,
    /// Performs tasks for self-correction; needed if the settings enable it.
    pub perform: Option<&'a mut dyn Perform>,
    /// Opens the engine that computes the steps; without it the processor does.
    pub engines: Option<&'a dyn Engines>,
    /// A linear prediction that may be the one that the run would fit.
    pub linear: Option<&'a FittedRidge>,
    /// Further content of meta.json (version, host, command line).
    pub meta: serde_json::Value,
}

impl std::fmt::Debug for Options<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Options").field("dir", &self.dir).finish_non_exhaustive()
    }
}

/// The outcome of a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finished {
    /// Steps done.
    pub step: u64,
    /// Steps in all.
    pub steps: u64,
    /// Whether a stop was requested before the end.
    pub interrupted: bool,
    /// Whether it ended early because the closed loop got worse.
    pub worsened: bool,
    /// Steps that were skipped because their loss or gradient was not finite, over all sessions.
    pub skipped: u64,
    /// Best step and its Precision; step 0 is the linear prediction that a skip starts from.
    pub best: Option<(u64, f64)>,
    /// Precision of that linear prediction.
    pub linear: Option<f64>,
    /// Held-out error, last measured.
    pub held_out: Option<HeldOut>,
    /// Seconds of this session.
    pub secs: f64,
    /// Training windows per second in this session.
    pub windows_per_sec: f64,
    /// The graphics card, if one computed the steps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub device: Option<String>,
    /// The model to use.
    pub model: PathBuf,
}
