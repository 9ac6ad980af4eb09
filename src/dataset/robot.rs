//! The robot whose motion a dataset contains.

use serde::{Deserialize, Serialize};

use robert_base::units::Unit;

/// The robot whose motion is recorded.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Robot {
    /// Profile id.
    pub id: String,
    /// Sha-256 of the robot's MJCF.
    pub model_sha256: String,
    /// State joints, in the column order of `qpos` and `qvel`.
    pub joints: Vec<String>,
    /// Unit of each joint.
    pub units: Vec<Unit>,
    /// Stops of each joint in its unit; `None` for unlimited joints.
    pub ranges: Vec<Option<[f64; 2]>>,
    /// A joint nearer than this to a stop counts as pinned, in its unit; (S).
    pub near_limit: Vec<f64>,
    /// Actuators, in the column order of `ctrl`.
    pub actuators: Vec<String>,
    /// Control of each actuator at actions -1 and +1.
    pub ctrlranges: Vec<[f64; 2]>,
}

impl Robot {
    /// Whether joint `j` at `x` is within its threshold of a stop.
    pub fn is_near_limit(&self, j: usize, x: f64) -> bool {
        match (self.ranges.get(j), self.near_limit.get(j)) {
            (Some(Some([lo, hi])), Some(near)) => x < lo + near || x > hi - near,
            _ => false,
        }
    }

    /// Joints of one frame (S) that are near a stop.
    pub fn near_limits(&self, qpos: &[f32]) -> impl Iterator<Item = usize> {
        let near = |(j, x): (usize, &f32)| self.is_near_limit(j, f64::from(*x)).then_some(j);
        qpos.iter().enumerate().filter_map(near)
    }
}
