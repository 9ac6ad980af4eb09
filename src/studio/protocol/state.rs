//! The complete state that a fresh page needs.

use super::document::DocumentView;
use super::policy::PolicyCard;
use super::robot::Pin;
use super::rollout::{RolloutSettings, TakesView, WorkerState};
use serde::Serialize;

/// Everything a fresh page needs.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct State {
    /// Version of the program.
    pub version: &'static str,
    /// The document, if one is open.
    pub document: Option<DocumentView>,
    /// Rollout settings.
    pub rollout: RolloutSettings,
    /// Policies that can be chosen.
    pub policies: Vec<PolicyCard>,
    /// The simulation.
    pub worker: WorkerState,
    /// Whether the 3D client is available; if not, the viewport shows stills.
    pub viser: bool,
    /// Editor clients connected.
    pub clients: usize,
    /// The folder where relative paths start.
    pub folder: String,
    /// Joints that are locked: no drag moves them.
    pub locked: Vec<String>,
    /// Sites that inverse kinematics keeps in place.
    pub pins: Vec<Pin>,
    /// Takes of the open robot.
    pub takes: TakesView,
}
