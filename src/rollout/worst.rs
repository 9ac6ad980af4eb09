//! The worst case of a figure.

use serde::{Deserialize, Serialize};

/// A figure and where it was found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Worst {
    /// The figure.
    pub value: f64,
    /// The joint that contributes most.
    pub joint: String,
    /// Where: the last frame with a goal before a gap, or the first one of a hold.
    pub frame: usize,
}
