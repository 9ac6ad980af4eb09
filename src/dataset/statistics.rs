//! Quality and spread of a dataset, as stored in its manifest.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// Quality and spread of the listed frames.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Statistics {
    /// Share of frames with this joint near a stop, (S). Torque cannot be inferred from positions
    /// there, which is the main problem of inverse-dynamics data.
    pub near_limit: Vec<f64>,
    /// Share of frames with any joint near a stop.
    pub near_limit_any: f64,
    /// Share of frames with this action saturated, (A).
    pub saturated: Vec<f64>,
    /// Share of frames in which the robot touches itself.
    pub self_contact: f64,
    /// Mean of each joint, (S).
    pub qpos_mean: Vec<f64>,
    /// Standard deviation, (S).
    pub qpos_std: Vec<f64>,
    /// Smallest, (S).
    pub qpos_min: Vec<f64>,
    /// Largest, (S).
    pub qpos_max: Vec<f64>,
    /// Standard deviation of velocity, (S).
    pub qvel_std: Vec<f64>,
    /// Mean share of coarse cells visited ([`super::Coverage`]).
    pub coverage: f64,
    /// Frames by agent.
    pub agents: BTreeMap<String, u64>,
    /// Trajectories by snapshot step.
    pub snapshots: BTreeMap<u64, u64>,
}
