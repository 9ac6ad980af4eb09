//! Errors of takes.

use std::fmt;
use std::path::{Path, PathBuf};

use robert_base::exit::{Exit, HasExit};

/// The place where a take file is damaged, and the problem.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Damage {
    /// Byte of the file at which the bad record begins.
    pub offset: u64,
    /// The problem, in words.
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
    File(#[from] robert_base::fsio::Error),
    /// The file is damaged or truncated.
    #[error("{}{damage}; {}", prefix(.path.as_deref()), whole(*.frames))]
    Damaged {
        /// Place and problem.
        damage: Damage,
        /// Frames before the damage that can be recovered.
        frames: usize,
        /// The file, if there is one.
        path: Option<PathBuf>,
    },
    /// The file is well formed, but not a take of this program.
    #[error("{}{problem}", prefix(.path.as_deref()))]
    Foreign {
        /// The missing part.
        problem: String,
        /// The file, if there is one.
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
        /// The given robot.
        robot: String,
        /// Its model.
        sha256: String,
    },
    /// The robot has more bodies than a take can contain.
    #[error("robot {robot} has {bodies} bodies; a take can contain at most {cap}")]
    Bodies {
        /// The robot.
        robot: String,
        /// Its bodies.
        bodies: usize,
        /// The limit.
        cap: usize,
    },
    /// The robot could not be read.
    #[error(transparent)]
    Robot(#[from] robert_robot::Error),
    /// An error of the simulator.
    #[error(transparent)]
    Simulator(#[from] robert_mujoco::Error),
    /// The robot cannot be drawn.
    #[error(transparent)]
    Render(#[from] robert_render::Error),
    /// The command does not fit the format.
    #[error(transparent)]
    Export(#[from] robert_clip::formats::ExportError),
    /// The motion or the robot does not fit the format.
    #[error("{format} cannot hold this motion: {problem}")]
    Unfit {
        /// The format.
        format: &'static str,
        /// Why.
        problem: String,
    },
    /// The folder contains something other than an earlier export.
    #[error(
        "the folder has no {marker}, so no earlier export made what is in it; give an empty or a new one: {}",
        .path.display()
    )]
    Occupied {
        /// A file that every export leaves there.
        marker: &'static str,
        /// The folder.
        path: PathBuf,
    },
    /// The encoder failed.
    #[error("cannot encode {what}: {problem}")]
    Encode {
        /// The picture or film.
        what: &'static str,
        /// The encoder's error.
        problem: String,
    },
    /// This build does not contain the page that plays recordings.
    #[error(
        "this build does not contain the viser client; script/bootstrap fetches it; then build again"
    )]
    NoClient,
}

impl Error {
    /// The same error with the name of the file.
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
            Error::Occupied { .. } => Exit::Usage,
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
