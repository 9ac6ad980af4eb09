//! Arguments of the edits of keys.

use std::collections::BTreeMap;

use serde::{Deserialize, Deserializer, Serialize};

use super::document::{Fill, Key};
use super::reach::Reach;

/// Arguments of `keys.add`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct KeysAdd {
    /// The keys.
    pub keys: Vec<Key>,
    /// Replace existing keys.
    #[serde(default)]
    pub replace: bool,
}

/// Arguments of `keys.set`: absent parts do not change.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct KeysSet {
    /// The key's frame.
    pub frame: u32,
    /// All values.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub q: Option<Vec<Option<f64>>>,
    /// A named pose instead of values.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose: Option<String>,
    /// All end-effector goals; an empty list removes them and keeps the joint values.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reach: Option<Vec<Reach>>,
    /// Single joints by name; null takes away the key's value for a joint.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub values: BTreeMap<String, Option<f64>>,
    /// Hold, frames; the next key with a value for a joint ends it for this joint.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hold: Option<u32>,
    #[allow(clippy::option_option)]
    /// Fill; null = the clip's.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "present")]
    #[schemars(extend("x-null" = true))]
    pub fill: Option<Option<Fill>>,
    /// Remark.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

/// Arguments of `keys.move`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct KeysMove {
    /// The frames of the keys.
    pub frames: Vec<u32>,
    /// By how many frames.
    pub df: i64,
    /// Move later keys along, to keep distances. The clip grows if necessary.
    #[serde(default)]
    pub ripple: bool,
    /// Replace existing keys. Joints that a new key has no value for keep theirs.
    #[serde(default)]
    pub replace: bool,
    /// Keep the originals.
    #[serde(default)]
    pub copy: bool,
}

/// Arguments of `keys.scale`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct KeysScale {
    /// The frames of the keys.
    pub frames: Vec<u32>,
    /// The frame that does not move.
    pub pivot: u32,
    /// New distance divided by the old one, above 0. Frames are rounded, holds are scaled too.
    pub factor: f64,
    /// Replace existing keys. Joints that a new key has no value for keep theirs.
    #[serde(default)]
    pub replace: bool,
}

/// Keys or markers by frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct KeysFrames {
    /// Their frames.
    pub frames: Vec<u32>,
}

/// Arguments of `keys.paste`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct KeysPaste {
    /// The frame of the first pasted key.
    pub at: u32,
    /// The keys; only their distances matter.
    pub keys: Vec<Key>,
    /// Replace existing keys. Joints that a new key has no value for keep theirs.
    #[serde(default)]
    pub replace: bool,
    /// Paste their mirror images.
    #[serde(default)]
    pub mirrored: bool,
    /// Only these joints; absent = all. The others keep their command there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joints: Option<Vec<String>>,
}

/// Arguments of `keys.hold`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct KeysHold {
    /// The frames of the keys.
    pub frames: Vec<u32>,
    /// For how many frames, at least 1; the next key with a value for a joint ends the hold of this joint.
    pub hold: u32,
}

/// Arguments of `keys.sparsify`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct KeysSparsify {
    /// The frames of the keys that may be removed. The ends of each unbroken run of them stay, and
    /// so do keys with a hold, a remark or a named pose.
    pub frames: Vec<u32>,
    /// Allowed distance between a joint of a removed key and the line, rad or m.
    pub tolerance: f64,
}

#[allow(clippy::option_option)] // absent, null and a value are three things in an edit
/// Distinguishes `"fill": null` from an absent `fill`.
fn present<'de, D: Deserializer<'de>>(d: D) -> Result<Option<Option<Fill>>, D::Error> {
    Option::<Fill>::deserialize(d).map(Some)
}
