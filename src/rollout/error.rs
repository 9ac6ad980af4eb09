//! What can go wrong between a clip and its motion.

use crate::exit::{Exit, HasExit};

/// A rollout error.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The simulator failed or diverged; the frame tells where.
    #[error("frame {frame}: {source}")]
    Simulation {
        /// The frame whose action was applied.
        frame: usize,
        /// What the simulator said.
        source: crate::mujoco::Error,
    },
    /// The simulator refused before the first frame.
    #[error(transparent)]
    Setup(#[from] crate::mujoco::Error),
    /// The robot could not be read or changed.
    #[error(transparent)]
    Robot(#[from] crate::robot::Error),
    /// A dataset could not be read, or has no trajectory that is long enough.
    #[error(transparent)]
    Dataset(#[from] crate::dataset::Error),
    /// A policy gave something that is no number.
    #[error("frame {frame}: policy {policy} gave {value} for actuator {actuator}")]
    BadAction {
        /// The frame.
        frame: usize,
        /// The policy.
        policy: String,
        /// The actuator.
        actuator: usize,
        /// What it gave.
        value: f64,
    },
    /// The table of floors in the program does not read.
    #[error("assets/floors/{path}: {message}")]
    Floors {
        /// What is wrong.
        message: String,
        /// The file inside the folder.
        path: String,
    },
    /// The clip is for another robot, or has another number of joints.
    #[error("the clip has {got} joints, but robot {robot} has {want}: {hint}")]
    Joints {
        /// The robot.
        robot: String,
        /// Joints of the clip.
        got: usize,
        /// Joints of the robot.
        want: usize,
        /// How to mend it.
        hint: &'static str,
    },
    /// The clip has no frame to roll out.
    #[error("the clip has {frames} frames; a rollout needs at least 2")]
    TooShort {
        /// Its length.
        frames: usize,
    },
    /// The timestep of the model does not divide the control step.
    #[error("a control step of 0.05 s is not a multiple of the timestep {timestep_secs} s")]
    Timestep {
        /// The timestep, seconds.
        timestep_secs: f64,
    },
    /// No such policy.
    #[error("there is no policy {name:?}; use {known}")]
    UnknownPolicy {
        /// What was asked for.
        name: String,
        /// What there is.
        known: String,
    },
    /// The policy needs something that was not given (a model file, a fit, a dataset).
    #[error("policy {policy} needs {needs}")]
    Needs {
        /// The policy.
        policy: String,
        /// What is missing and where it comes from.
        needs: String,
    },
    /// The policy takes a file, and none was named.
    #[error("policy {policy} needs {needs}")]
    Unnamed {
        /// The policy.
        policy: String,
        /// What to name, and what makes it.
        needs: String,
    },
    /// No file, run or model of this name.
    #[error("there is no model {name} for {robot}; there are {known}; a model file also works")]
    UnknownModel {
        /// The robot.
        robot: String,
        /// What was asked for.
        name: String,
        /// What there is.
        known: String,
    },
    /// A model file, or the network in it.
    #[error(transparent)]
    Model(#[from] crate::net::Error),
    /// Stopped on request.
    #[error("stopped at frame {frame}")]
    Cancelled {
        /// Frames simulated so far.
        frame: usize,
    },
}

impl HasExit for Error {
    fn exit(&self) -> Exit {
        match self {
            Error::Simulation { .. } | Error::BadAction { .. } | Error::Floors { .. } => {
                Exit::Failed
            }
            Error::Setup(e) => e.exit(),
            Error::Robot(e) => e.exit(),
            Error::Model(e) => e.exit(),
            Error::Dataset(e) => e.exit(),
            Error::UnknownPolicy { .. } | Error::Unnamed { .. } => Exit::Usage,
            Error::Needs { .. } => Exit::Missing,
            Error::Cancelled { .. } => Exit::Interrupted,
            _ => Exit::Invalid,
        }
    }
}
