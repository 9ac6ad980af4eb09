//! The result of one point of a sweep.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::value::Combination;

/// Results of sweeps without evaluations do not mention them.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
pub(super) fn none(evaluations: &u64) -> bool {
    *evaluations == 0
}

/// The result of one point.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reached {
    /// Values of this point.
    pub values: Combination,
    /// Seed.
    pub seed: u64,
    /// Sha-256 of the data's manifest.
    pub dataset_sha256: String,
    /// Windows learned from.
    pub windows: u64,
    /// Evaluations of which the best model was chosen; with 0 it is the last.
    #[serde(default, skip_serializing_if = "none")]
    pub evaluations: u64,
    /// Mean Precision by suite; `None` if a rollout diverged.
    pub suites: BTreeMap<String, Option<f64>>,
    /// Held-out action error, next frame known and away from stops and contact.
    pub nmse_clear: Option<f64>,
    /// Seconds of the last session; a shard leaves them out, so that its bits do not depend on the
    /// machine's speed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub secs: Option<f64>,
}
