//! Errors of collecting.

use std::path::PathBuf;

use robert_base::exit::{Exit, HasExit};
use robert_base::fsio;
use robert_dataset as dataset;
use robert_dataset::SHORTEST;
use robert_mujoco as mujoco;
use robert_robot as robot;

/// Why a collection cannot start or continue.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The robot cannot be used.
    #[error(transparent)]
    Robot(#[from] robot::Error),
    /// The simulator failed.
    #[error(transparent)]
    Simulator(#[from] mujoco::Error),
    /// Shards or manifest failed.
    #[error(transparent)]
    Dataset(#[from] dataset::Error),
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] fsio::Error),
    /// An option is outside its range.
    #[error("{name} must be {must}, got {got}")]
    Argument {
        /// The option.
        name: &'static str,
        /// The allowed values.
        must: String,
        /// The given value.
        got: String,
    },
    /// The folder contains another collection, or one that may only continue with `--resume`.
    #[error("{message}: {path}", path = path.display())]
    Folder {
        /// The content of the folder, and the fix.
        message: String,
        /// The folder.
        path: PathBuf,
    },
    /// A checkpoint or snapshot is damaged.
    #[error("{message}: {path}", path = path.display())]
    Checkpoint {
        /// The problem, in words.
        message: String,
        /// The file.
        path: PathBuf,
    },
    /// The robot is unstable: too many trajectories diverge.
    #[error(
        "{broken} of {tried} trajectories of {agent} broke the simulation; check masses, limits and control ranges of {robot}"
    )]
    Unstable {
        /// The robot.
        robot: String,
        /// The agent.
        agent: String,
        /// Trajectories that diverged.
        broken: u64,
        /// All trajectories that were tried.
        tried: u64,
    },
    /// Too many trajectories end before they are long enough.
    #[error(
        "{short} of {tried} trajectories of {agent} ended before {least} frames; {cure}",
        least = SHORTEST,
        cure = cure(*pinned_frames, robot)
    )]
    TooShort {
        /// The robot.
        robot: String,
        /// The agent.
        agent: String,
        /// Trajectories that were too short.
        short: u64,
        /// All trajectories that were tried.
        tried: u64,
        /// Frames at a stop that end a trajectory; 0 for never.
        pinned_frames: u64,
    },
    /// Stopped by the user; `--resume` continues.
    #[error("stopped; continue with --resume: {path}", path = path.display())]
    Cancelled {
        /// The folder.
        path: PathBuf,
    },
}

fn cure(pinned_frames: u64, robot: &str) -> String {
    match pinned_frames {
        0 => format!(
            "{robot} soon reaches implausible states: check its masses, limits and control ranges"
        ),
        n => format!("raise pinned_frames (now {n}) or set it to 0"),
    }
}

impl HasExit for Error {
    fn exit(&self) -> Exit {
        match self {
            Error::Robot(e) => e.exit(),
            Error::Simulator(e) => e.exit(),
            Error::Dataset(e) => e.exit(),
            Error::File(e) => e.exit(),
            Error::Argument { .. } => Exit::Usage,
            Error::Folder { .. } | Error::Checkpoint { .. } => Exit::Invalid,
            Error::Unstable { .. } | Error::TooShort { .. } => Exit::Failed,
            Error::Cancelled { .. } => Exit::Interrupted,
        }
    }
}
