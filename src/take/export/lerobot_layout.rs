//! The layout of a LeRobot dataset: options and paths.

use std::collections::BTreeMap;

/// Files of one chunk.
pub(super) const CHUNK_FILES: usize = 1000;

/// Version of the layout.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LeRobotVersion {
    /// v3.0: several episodes a file.
    #[default]
    V3,
    /// v2.1: a file an episode.
    V2,
}

/// The content of the action column.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LeRobotAction {
    /// The position reached one frame later; the last one again.
    #[default]
    Position,
    /// The controls of the simulation, N m or N; the last one again.
    Torque,
}

/// Options of a dataset.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LeRobotOptions {
    /// Version of the layout.
    pub version: LeRobotVersion,
    /// The action.
    pub action: LeRobotAction,
    /// Angles in degrees instead of rad.
    pub degrees: bool,
    /// Other names for joints and actuators.
    pub rename: BTreeMap<String, String>,
    /// Whether a controller can command each joint, if this is known; (S). The others are observed only.
    pub motorised: Option<Vec<bool>>,
}

/// The place of a file of version 3.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    pub chunk: usize,
    pub file: usize,
}

impl Place {
    /// The place of the nth file.
    pub(super) fn nth(n: usize) -> Place {
        Place { chunk: n / CHUNK_FILES, file: n % CHUNK_FILES }
    }

    /// Its path.
    pub(super) fn path(self, folder: &str, ending: &str) -> String {
        format!("{folder}/chunk-{:03}/file-{:03}.{ending}", self.chunk, self.file)
    }
}
