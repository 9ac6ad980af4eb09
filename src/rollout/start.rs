//! How a rollout begins: at the start pose of its clip, or in the middle of a recorded motion.

use super::error::Error;
use super::goals::Goals;
use robert_clip::Command;
use robert_robot::Robot;

/// The start of a rollout.
#[derive(Clone, Debug, PartialEq)]
pub enum Start {
    /// At the clip's start pose, at rest, as if it had been held for 30 frames. Parts that overlap in it begin where
    /// contact pushes them apart ([`Robot::apart`]).
    Pose,
    /// In the middle of a recorded motion.
    Recorded {
        /// States of the 30 frames before; (30, S).
        history: Vec<f64>,
        /// State of frame 0; (S).
        state: Vec<f64>,
        /// True joint velocities of frame 0; (S).
        velocity: Vec<f64>,
    },
}

impl Start {
    /// The goals of a clip that begins so.
    pub(super) fn goals(&self, command: &Command) -> Goals {
        match self {
            Start::Pose => Goals::new(command),
            Start::Recorded { history, state, .. } => {
                Goals::after(command, &[&history[..], state].concat())
            }
        }
    }
}

/// The state at frame 0 of a rollout from this pose; (S).
pub(super) fn first_state(robot: &Robot, start_pose: &[f64]) -> Result<Vec<f64>, Error> {
    Ok(robot.apart(start_pose)?.unwrap_or_else(|| start_pose.to_vec()))
}
