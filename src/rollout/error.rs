//! Errors of rollouts.

use robert_base::exit::{Exit, HasExit};

/// A rollout error.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The simulator failed or diverged at this frame.
    #[error("frame {frame}: {source}")]
    Simulation {
        /// The frame whose action was applied.
        frame: usize,
        /// The simulator's error.
        source: robert_mujoco::Error,
    },
    /// The simulator failed before the first frame.
    #[error(transparent)]
    Setup(#[from] robert_mujoco::Error),
    /// The robot could not be read or changed.
    #[error(transparent)]
    Robot(#[from] robert_robot::Error),
    /// A dataset could not be read, or has no trajectory that is long enough.
    #[error(transparent)]
    Dataset(#[from] robert_dataset::Error),
    /// A policy returned a value that is not a number.
    #[error("frame {frame}: policy {policy} gave {value} for actuator {actuator}")]
    BadAction {
        /// The frame.
        frame: usize,
        /// The policy.
        policy: String,
        /// The actuator.
        actuator: usize,
        /// The value.
        value: f64,
    },
    /// The built-in table of floors is damaged.
    #[error("assets/floors/{path}: {message}")]
    Floors {
        /// The problem, in words.
        message: String,
        /// The file.
        path: String,
    },
    /// The clip is for another robot, or has another number of joints.
    #[error("the clip ({got} joints) is not for robot {robot} ({want} joints): {hint}")]
    Joints {
        /// The robot.
        robot: String,
        /// Joints of the clip.
        got: usize,
        /// Joints of the robot.
        want: usize,
        /// A way to fix it.
        hint: String,
    },
    /// The clip has no frames to roll out.
    #[error("the clip has {frames} {}; a rollout needs at least 2", if *frames == 1 { "frame" } else { "frames" })]
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
        /// The requested name.
        name: String,
        /// The existing names.
        known: String,
    },
    /// A policy with an option that it does not have.
    #[error("policy {text:?}: {why}")]
    Notation {
        /// As it was typed.
        text: String,
        /// The problem, in words.
        why: String,
    },
    /// The policy needs a model file, a fit or a dataset.
    #[error("policy {policy} needs {needs}")]
    Needs {
        /// The policy.
        policy: String,
        /// The missing part, and how to get it.
        needs: String,
    },
    /// The policy needs a file, and none was named.
    #[error("policy {policy} needs {needs}")]
    Unnamed {
        /// The policy.
        policy: String,
        /// The kind of file, and the command that makes it.
        needs: String,
    },
    /// No file, run or model of this name.
    #[error("there is no model {name} for {robot}; there are {known}; a model file also works")]
    UnknownModel {
        /// The robot.
        robot: String,
        /// The requested name.
        name: String,
        /// The existing names.
        known: String,
    },
    /// A model file, or the network in it.
    #[error(transparent)]
    Model(#[from] robert_net::Error),
    /// Stopped on request.
    #[error("stopped{}", if *frame == 0 { String::new() } else { format!(" at frame {frame}") })]
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
            Error::UnknownPolicy { .. } | Error::Notation { .. } | Error::Unnamed { .. } => {
                Exit::Usage
            }
            Error::Needs { .. } => Exit::Missing,
            Error::Cancelled { .. } => Exit::Interrupted,
            _ => Exit::Invalid,
        }
    }
}
