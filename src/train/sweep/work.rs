//! The options of a sweep.

use std::path::PathBuf;

use robert_base::progress::{Cancel, Progress};
use robert_net::engine::Engines;

/// Options of a sweep.
pub struct Work<'a> {
    /// Dataset folder.
    pub data: PathBuf,
    /// Folder for points, table and charts.
    pub out: PathBuf,
    /// Threads.
    pub threads: usize,
    /// Seconds between checkpoints.
    pub checkpoint_secs: f64,
    /// Opens the engine that computes the steps; without it the processor does.
    pub engines: Option<&'a dyn Engines>,
    /// Receives the progress, in points.
    pub progress: &'a dyn Progress,
    /// Asks for a stop; finished points are kept.
    pub cancel: &'a Cancel,
    /// Further content of the meta.json of each run.
    pub meta: serde_json::Value,
}

impl std::fmt::Debug for Work<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Work").field("out", &self.out).finish_non_exhaustive()
    }
}
