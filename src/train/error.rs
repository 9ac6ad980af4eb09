//! Errors of training.

use std::path::PathBuf;

use robert_base::exit::{Exit, HasExit};
use robert_base::fsio;
use robert_dataset as dataset;
use robert_net as net;

/// Failures of a training run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// No such preset.
    #[error("there is no preset {name:?}; use {known}")]
    Preset {
        /// The requested name.
        name: String,
        /// All presets.
        known: String,
    },
    /// A setting that does not exist or has a wrong value.
    #[error("setting {setting}: {why}")]
    Setting {
        /// The setting.
        setting: String,
        /// The problem, and what would be right.
        why: String,
    },
    /// A run directory that cannot be used.
    #[error("{why}: {path}", path = path.display())]
    Run {
        /// The problem, in words.
        why: String,
        /// The directory or file.
        path: PathBuf,
    },
    /// A sweep file, or a folder of points, that cannot be used.
    #[error("{why}: {path}", path = path.display())]
    Sweep {
        /// The problem, in words.
        why: String,
        /// The file or folder.
        path: PathBuf,
    },
    /// Too many steps had a loss or gradient that was not finite, or the end result was not finite.
    #[error(
        "training diverged by step {step}: loss or gradient was not finite, and {skipped} steps were skipped. The last good checkpoint is {path}. A run keeps its settings, so begin a new one with a smaller lr: --set lr=... and another --out",
        path = path.display()
    )]
    Diverged {
        /// Steps skipped.
        skipped: u64,
        /// Step at which training stopped.
        step: u64,
        /// The kept checkpoint; the step after it is finite.
        path: PathBuf,
    },
    /// The graphics card of a run is gone; the run keeps its last checkpoint.
    #[error("{why}. Continue from the last checkpoint with --resume, on the processor with --device cpu: {path}", path = path.display())]
    Lost {
        /// The card, and the driver's words.
        why: String,
        /// The run.
        path: PathBuf,
    },
    /// A fit was stopped before its end; nothing was written.
    #[error("stopped at step {step} of {steps}; nothing was written")]
    Stopped {
        /// Steps done.
        step: u64,
        /// Requested steps.
        steps: u64,
    },
    /// The evaluation failed.
    #[error("evaluation at step {step}: {why}")]
    Evaluation {
        /// Step of the weights.
        step: u64,
        /// The problem, in words.
        why: String,
    },
    /// Data.
    #[error(transparent)]
    Data(#[from] dataset::Error),
    /// Network or its file.
    #[error(transparent)]
    Net(#[from] net::Error),
    /// Files.
    #[error(transparent)]
    Files(#[from] fsio::Error),
}

impl HasExit for Error {
    fn exit(&self) -> Exit {
        match self {
            Error::Preset { .. } | Error::Setting { .. } => Exit::Usage,
            Error::Run { .. } | Error::Sweep { .. } => Exit::Invalid,
            Error::Diverged { .. } | Error::Lost { .. } | Error::Evaluation { .. } => Exit::Failed,
            Error::Stopped { .. } => Exit::Interrupted,
            Error::Data(e) => e.exit(),
            Error::Net(e) => e.exit(),
            Error::Files(e) => e.exit(),
        }
    }
}
