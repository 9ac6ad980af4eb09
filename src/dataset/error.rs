//! Errors of datasets.

use std::path::PathBuf;

use robert_base::exit::{Exit, HasExit};
use robert_base::fsio;

/// Why a dataset cannot be read, written or combined.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] fsio::Error),
    /// The manifest is not JSON of the right form.
    #[error("{path}:{line}:{column}: {message}", path = path.display())]
    ManifestText {
        /// The problem, in words.
        message: String,
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// The manifest.
        path: PathBuf,
    },
    /// The manifest contradicts itself or is of a newer format.
    #[error("{message}: {path}", path = path.display())]
    Manifest {
        /// The problem, and how to fix it.
        message: String,
        /// The manifest.
        path: PathBuf,
    },
    /// A shard is missing, truncated, altered, or another one than the manifest names.
    #[error("shard {index} {message}: {path}", path = path.display())]
    Shard {
        /// Its index in the manifest.
        index: usize,
        /// The problem, in words.
        message: String,
        /// The shard file.
        path: PathBuf,
    },
    /// Several shards are bad.
    #[error(
        "{count} of {total} shards are missing or damaged (first: {first}); robert dataset check lists all",
        count = indices.len()
    )]
    Incomplete {
        /// Indices in the manifest.
        indices: Vec<usize>,
        /// All shards.
        total: usize,
        /// The first problem as text.
        first: String,
    },
    /// The datasets come from different robots, models or physics.
    #[error("{field} differs: {left} and {right}: {path}", path = path.display())]
    Mismatch {
        /// The field that differs.
        field: &'static str,
        /// The first dataset's value.
        left: String,
        /// The other's.
        right: String,
        /// The other manifest.
        path: PathBuf,
    },
    /// The data come from another robot, or from another version of its model.
    #[error(
        "the data are of {of} (model {of_model:.12}), not of {robot} (model {model:.12}): {path}",
        path = path.display()
    )]
    OtherRobot {
        /// The robot of the data.
        of: String,
        /// Sha-256 of that robot's model.
        of_model: String,
        /// The requested robot.
        robot: String,
        /// Sha-256 of its model.
        model: String,
        /// The dataset.
        path: PathBuf,
    },
    /// Nothing is left to read.
    #[error("there is no trajectory of at least {frames} frames in the {part} part of {path}", path = path.display())]
    Empty {
        /// Frames that a window needs.
        frames: usize,
        /// The requested part.
        part: &'static str,
        /// The manifest.
        path: PathBuf,
    },
    /// A trajectory does not fit the shard builder.
    #[error("trajectory does not fit the shard: {0}")]
    Trajectory(String),
    /// An option is outside its range.
    #[error("{name} must be {must}, got {got}")]
    Argument {
        /// The option.
        name: &'static str,
        /// The allowed values.
        must: &'static str,
        /// The given value.
        got: String,
    },
}

impl HasExit for Error {
    fn exit(&self) -> Exit {
        match self {
            Error::File(e) => e.exit(),
            Error::Argument { .. } => Exit::Usage,
            Error::Trajectory(_) => Exit::Failed,
            _ => Exit::Invalid,
        }
    }
}
