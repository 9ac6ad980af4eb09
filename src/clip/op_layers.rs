//! Arguments of the edits of offsets and blocks.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::part::Part;

/// Arguments of `offsets.set`: absent parts do not change.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct OffsetsSet {
    /// At which frame.
    pub frame: u32,
    /// The values to add, by joint, rad or m; 0 or null removes a joint from the offset.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub add: BTreeMap<String, Option<f64>>,
    /// Over how many frames it grows.
    #[serde(default, skip_serializing_if = "Option::is_none", rename = "in")]
    pub fade_in: Option<u32>,
    /// The number of frames for which the values are added in full.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hold: Option<u32>,
    /// Over how many frames it fades.
    #[serde(default, skip_serializing_if = "Option::is_none", rename = "out")]
    pub fade_out: Option<u32>,
}

/// Arguments of `offsets.move`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct OffsetsMove {
    /// Which offsets.
    pub frames: Vec<u32>,
    /// By how many frames.
    pub df: i64,
    /// Keep the originals.
    #[serde(default)]
    pub copy: bool,
}

/// Arguments of `blocks.insert`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct BlocksInsert {
    /// The frame before which the block is inserted; the clip's length appends. If the frame is
    /// inside a block, the new one comes after that block.
    pub at: u32,
    /// Its name.
    pub name: String,
    /// The motion.
    pub part: Part,
    /// Frames of the smooth curves that lead to the block and from it.
    #[serde(default)]
    pub blend: u32,
}

/// Arguments of `blocks.order`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct BlocksOrder {
    /// The first frames of all blocks, in their new order.
    pub frames: Vec<u32>,
}

/// Arguments of `blocks.repeat`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct BlocksRepeat {
    /// The first frame of the block.
    pub frame: u32,
    /// Frames of the smooth curve from the block's end to its beginning.
    #[serde(default)]
    pub blend: u32,
}

/// Arguments of `blocks.delete`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct BlocksDelete {
    /// The first frame of the block.
    pub frame: u32,
}
