//! Errors of robots, profiles and foreign models.

use std::path::PathBuf;

use robert_base::exit::{Exit, HasExit};
use robert_base::fsio;
use robert_mujoco as mujoco;

/// An error of this module.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// There is neither a robot nor a folder of that name.
    #[error("there is no robot \"{name}\"{hint}; use {known}, or a folder that contains robot.xml")]
    Unknown {
        /// The requested name.
        name: String,
        /// " (did you mean …?)" or empty.
        hint: String,
        /// The known robots.
        known: String,
    },
    /// A pose that the profile does not have.
    #[error("{robot} has no pose \"{pose}\"; it has: {known}")]
    UnknownPose {
        /// The robot.
        robot: String,
        /// The requested name.
        pose: String,
        /// The poses that it has.
        known: String,
    },
    /// A joint that the robot does not have.
    #[error("{robot} has no joint \"{joint}\"; its joints: {known}")]
    UnknownJoint {
        /// The robot.
        robot: String,
        /// The requested name.
        joint: String,
        /// The joints that it has.
        known: String,
    },
    /// A site or body that the model does not have.
    #[error("{robot} has no site or body \"{name}\"; it has: {known}")]
    UnknownPoint {
        /// The robot.
        robot: String,
        /// The requested name.
        name: String,
        /// The names that it has.
        known: String,
    },
    /// The robot has no mirror image.
    #[error("{robot} cannot be mirrored: {reason}")]
    NoMirror {
        /// The robot.
        robot: String,
        /// Why.
        reason: String,
    },
    /// A plant description is wrong.
    #[error("plant {text:?}: {problem}; an example is mass=1.25,damping=0.5..2,gear=0.85")]
    Plant {
        /// The given text.
        text: String,
        /// The problem, in words.
        problem: String,
    },
    /// A value that should be a number is not, or a vector has the wrong length.
    #[error("{what} has {got} values, but {robot} needs {want}")]
    Length {
        /// The robot.
        robot: String,
        /// The name of the vector.
        what: &'static str,
        /// Its length.
        got: usize,
        /// The length of the robot.
        want: usize,
    },
    /// The profile is not valid TOML or breaks its schema.
    #[error("{place}: {message}", place = place(path, *line, *column))]
    Profile {
        /// The problem, and how to fix it.
        message: String,
        /// Line, from 1.
        line: u32,
        /// Column, from 1.
        column: u32,
        /// The profile.
        path: PathBuf,
    },
    /// The profile contradicts its model.
    #[error("{path}: {message}", path = path.display())]
    Mismatch {
        /// The difference, and how to fix it.
        message: String,
        /// The profile.
        path: PathBuf,
    },
    /// A foreign file was refused before the simulator read it.
    #[error("{place}: {message}", place = place(path, *line, *column))]
    Refused {
        /// The problem, and how to fix it.
        message: String,
        /// Line, from 1; 0 for the whole file.
        line: u32,
        /// Column, from 1.
        column: u32,
        /// The file.
        path: PathBuf,
    },
    /// The model is valid but cannot be driven.
    #[error("{path}: {message}", path = path.display())]
    Unfit {
        /// The reason, and what would help.
        message: String,
        /// The file.
        path: PathBuf,
    },
    /// The child process that compiles foreign models was stopped by its limits.
    #[error("{path}: the model was refused: compiling it {what}", path = path.display())]
    Exhausted {
        /// "took more than 20 s", "took more than 4 GB", "crashed the library (signal 11)".
        what: String,
        /// The model.
        path: PathBuf,
    },
    /// The child process refused the model, with the simulator's message.
    #[error("{message}")]
    Checked {
        /// Message with place.
        message: String,
        /// Class of the refusal, as in [`crate::check::Verdict`].
        class: String,
        /// The model.
        path: PathBuf,
    },
    /// The child process could not be started.
    #[error("cannot check a foreign model: {message}")]
    NoChecker {
        /// Why.
        message: String,
    },
    /// The equality constraints or moment arms of a pose are not finite.
    #[error(
        "the equality constraints of this pose have no finite directions; check the <equality> of the model"
    )]
    Loops,
    /// An error of the simulator.
    #[error(transparent)]
    Simulator(#[from] mujoco::Error),
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] fsio::Error),
}

impl HasExit for Error {
    fn exit(&self) -> Exit {
        match self {
            Error::Simulator(e) => e.exit(),
            Error::File(e) => e.exit(),
            Error::Length { .. } => Exit::Failed,
            Error::Plant { .. } => Exit::Usage,
            Error::NoChecker { .. } => Exit::Missing,
            _ => Exit::Invalid,
        }
    }
}

fn place(path: &std::path::Path, line: u32, column: u32) -> String {
    if line == 0 {
        path.display().to_string()
    } else {
        format!("{}:{line}:{column}", path.display())
    }
}

/// Line and column (from 1) of a byte offset.
pub(super) fn line_column(text: &str, at: usize) -> (u32, u32) {
    let before = text.get(..at.min(text.len())).unwrap_or(text);
    let line = before.bytes().filter(|b| *b == b'\n').count() + 1;
    let column = before.rsplit('\n').next().map_or(0, |l| l.chars().count()) + 1;
    (line as u32, column as u32)
}
