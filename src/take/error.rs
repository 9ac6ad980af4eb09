//! What can go wrong with a take.

use std::fmt;
use std::path::{Path, PathBuf};

use crate::exit::{Exit, HasExit};

/// Where a take file stops making sense, and why.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Damage {
    /// Byte of the file at which the bad record begins.
    pub offset: u64,
    /// What is wrong with it.
    pub problem: String,
}

impl Damage {
    /// Damage at this byte.
    pub(super) fn at(offset: usize, problem: impl Into<String>) -> Damage {
        Damage { offset: offset as u64, problem: problem.into() }
    }
}

impl fmt::Display for Damage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "byte {}: {}", self.offset, self.problem)
    }
}

/// A take error.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The file could not be read or written.
    #[error(transparent)]
    File(#[from] crate::fsio::Error),
    /// The file is damaged or cut short.
    #[error("{}{damage}; {}", prefix(.path.as_deref()), whole(*.frames))]
    Damaged {
        /// Where and what.
        damage: Damage,
        /// Frames before the damage that can be recovered.
        frames: usize,
        /// The file, where there is one.
        path: Option<PathBuf>,
    },
    /// The file is well formed, but no take of ours.
    #[error("{}{problem}", prefix(.path.as_deref()))]
    Foreign {
        /// What it lacks.
        problem: String,
        /// The file, where there is one.
        path: Option<PathBuf>,
    },
    /// The take was made with another robot model than the one given.
    #[error(
        "the take is from robot {take_robot} (model {take_sha256:.12}), not from {robot} (model {sha256:.12}); name its own with --robot"
    )]
    OtherRobot {
        /// Robot of the take.
        take_robot: String,
        /// Its model.
        take_sha256: String,
        /// The robot that was given.
        robot: String,
        /// Its model.
        sha256: String,
    },
    /// The robot has more bodies than a take holds.
    #[error("robot {robot} has {bodies} bodies; a take can contain at most {cap}")]
    Bodies {
        /// The robot.
        robot: String,
        /// Its bodies.
        bodies: usize,
        /// The cap.
        cap: usize,
    },
    /// The robot could not be read.
    #[error(transparent)]
    Robot(#[from] crate::robot::Error),
    /// The simulator refused.
    #[error(transparent)]
    Simulator(#[from] crate::mujoco::Error),
    /// The robot cannot be drawn.
    #[error(transparent)]
    Render(#[from] crate::render::Error),
    /// The command does not fit the format.
    #[error(transparent)]
    Export(#[from] crate::clip::formats::ExportError),
    /// The encoder failed.
    #[error("cannot encode {what}: {problem}")]
    Encode {
        /// What was encoded.
        what: &'static str,
        /// What the encoder said.
        problem: String,
    },
    /// The page that plays recordings is not in this program.
    #[error(
        "this build does not contain the viser client; script/bootstrap fetches it; then build again"
    )]
    NoClient,
}

impl Error {
    /// The same error, said of this file.
    #[must_use]
    pub fn in_file(mut self, file: &Path) -> Error {
        match &mut self {
            Error::Damaged { path, .. } | Error::Foreign { path, .. } => {
                *path = Some(file.to_owned());
            }
            _ => {}
        }
        self
    }

    pub(super) fn foreign(problem: impl Into<String>) -> Error {
        Error::Foreign { problem: problem.into(), path: None }
    }
}

impl HasExit for Error {
    fn exit(&self) -> Exit {
        match self {
            Error::File(e) => e.exit(),
            Error::Robot(e) => e.exit(),
            Error::Simulator(e) => e.exit(),
            Error::Render(e) => e.exit(),
            Error::Export(e) => e.exit(),
            Error::Encode { .. } => Exit::Failed,
            Error::NoClient => Exit::Missing,
            _ => Exit::Invalid,
        }
    }
}

fn prefix(path: Option<&Path>) -> String {
    path.map(|p| format!("{}: ", p.display())).unwrap_or_default()
}

fn whole(frames: usize) -> String {
    match frames {
        0 => "nothing can be recovered".to_owned(),
        1 => "1 frame before it is intact (--recover saves it)".to_owned(),
        n => format!("{n} frames before it are intact (--recover saves them)"),
    }
}
