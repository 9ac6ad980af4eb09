//! Errors of networks, their files and their data.

use std::path::PathBuf;

use robert_base::exit::{Exit, HasExit};

/// An error of this module.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A size or switch is invalid.
    #[error("network setting {field}: {why}")]
    Config {
        /// Name of the field.
        field: &'static str,
        /// The problem, and what would be right.
        why: String,
    },
    /// A list of numbers has the wrong length.
    #[error("{what}: {got} numbers instead of {want}")]
    Shape {
        /// The name of the numbers.
        what: &'static str,
        /// The expected length.
        want: usize,
        /// The actual length.
        got: usize,
    },
    /// The normal equations of a fit have no stable solution.
    #[error(
        "{what}: the fit is singular at row {row}; more varied data or a larger lambda is needed"
    )]
    Singular {
        /// The name of the fit.
        what: String,
        /// Pivot that was not positive.
        row: usize,
    },
    /// A fit was stopped before its end; nothing was written.
    #[error("the fit was stopped; nothing was written")]
    Stopped,
    /// A model file is damaged or not one.
    #[error("{why} in model file {path}", path = path.display())]
    File {
        /// The problem, in words.
        why: String,
        /// The file.
        path: PathBuf,
    },
    /// A model file was trained for another robot.
    #[error("model was trained for {trained}, this is {given}: {path}; train it for this robot, or use the robot that it was trained for", path = path.display())]
    Robot {
        /// The robot of the card.
        trained: String,
        /// The requested robot.
        given: String,
        /// The file.
        path: PathBuf,
    },
    /// A folder without a model.
    #[error(
        "no model in {path}: a run has ckpt/best.safetensors or model.safetensors, a dataset \
         ridge.safetensors once it is fitted (robert fit ridge --data {path})",
        path = path.display()
    )]
    NoModel {
        /// The folder.
        path: PathBuf,
    },
    /// The graphics card that was training is gone: reset, out of memory, driver broken.
    #[error("{device} stopped working: {why}")]
    Lost {
        /// Its name.
        device: String,
        /// The driver's words.
        why: String,
    },
    /// Reading or writing failed.
    #[error(transparent)]
    Files(#[from] robert_base::fsio::Error),
}

impl HasExit for Error {
    fn exit(&self) -> Exit {
        match self {
            Error::Files(e) => e.exit(),
            Error::NoModel { .. } => Exit::Missing,
            Error::Stopped => Exit::Interrupted,
            Error::Shape { .. } | Error::Singular { .. } | Error::Lost { .. } => Exit::Failed,
            _ => Exit::Invalid,
        }
    }
}
