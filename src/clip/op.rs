//! All edits of a clip, as values.
//!
//! `{"op": "keys.move", "args": {"frames": [20], "df": 5}}`: the studio, scripts and `robert clip
//! apply` use the same operations, and undo is one of them ([`Delta`]). A key is identified by its
//! frame. A clip has at most one key per frame, so the file needs no ids.

use serde::{Deserialize, Serialize};

use super::delta::Delta;
use super::document::{Fill, Marker, Start};
pub use super::op_keys::{
    KeysAdd, KeysFrames, KeysHold, KeysMove, KeysPaste, KeysScale, KeysSet, KeysSparsify,
};
pub use super::op_layers::{
    BlocksDelete, BlocksInsert, BlocksOrder, BlocksRepeat, OffsetsMove, OffsetsSet,
};
use super::tangent::Tangent;

/// An edit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "op", content = "args", deny_unknown_fields)]
#[non_exhaustive]
#[derive(schemars::JsonSchema)]
pub enum Op {
    /// Adds keys.
    #[serde(rename = "keys.add")]
    KeysAdd(KeysAdd),
    /// Changes parts of one key.
    #[serde(rename = "keys.set")]
    KeysSet(KeysSet),
    /// Shifts keys in time, or copies them there.
    #[serde(rename = "keys.move")]
    KeysMove(KeysMove),
    /// Scales the times of keys about a pivot.
    #[serde(rename = "keys.scale")]
    KeysScale(KeysScale),
    /// Removes keys.
    #[serde(rename = "keys.delete")]
    KeysDelete(KeysFrames),
    /// Inserts keys from a clipboard, the first of them at `at`.
    #[serde(rename = "keys.paste")]
    KeysPaste(KeysPaste),
    /// Replaces keys by their mirror images.
    #[serde(rename = "keys.mirror")]
    KeysMirror(KeysFrames),
    /// Sets how long keys are held.
    #[serde(rename = "keys.hold")]
    KeysHold(KeysHold),
    /// Gives keys with end-effector goals the joint values that reach them, in place of the goals.
    #[serde(rename = "keys.bake")]
    KeysBake(KeysFrames),
    /// Removes keys that lie on the straight line between the others.
    #[serde(rename = "keys.sparsify")]
    KeysSparsify(KeysSparsify),
    /// Masks or unmasks a span.
    #[serde(rename = "mask.set")]
    MaskSet(MaskSet),
    /// Sets the fill after keys, or the clip's default.
    #[serde(rename = "fill.set")]
    FillSet(FillSet),
    /// Sets the slopes of cubic curves at keys.
    #[serde(rename = "tangent.set")]
    TangentSet(TangentSet),
    /// Makes or changes the offset at a frame.
    #[serde(rename = "offsets.set")]
    OffsetsSet(OffsetsSet),
    /// Shifts offsets in time, or copies them there.
    #[serde(rename = "offsets.move")]
    OffsetsMove(OffsetsMove),
    /// Removes offsets.
    #[serde(rename = "offsets.delete")]
    OffsetsDelete(KeysFrames),
    /// Adds offsets to the keys for good.
    #[serde(rename = "offsets.bake")]
    OffsetsBake(KeysFrames),
    /// Inserts a motion as a block, and blends it with what is around it.
    #[serde(rename = "blocks.insert")]
    BlocksInsert(BlocksInsert),
    /// Puts blocks in another order.
    #[serde(rename = "blocks.order")]
    BlocksOrder(BlocksOrder),
    /// Inserts a copy of a block after it.
    #[serde(rename = "blocks.repeat")]
    BlocksRepeat(BlocksRepeat),
    /// Removes a block with its frames.
    #[serde(rename = "blocks.delete")]
    BlocksDelete(BlocksDelete),
    /// Inserts empty frames and shifts everything after them.
    #[serde(rename = "time.insert")]
    TimeInsert(TimeInsert),
    /// Removes frames with their keys and closes the gap.
    #[serde(rename = "time.delete")]
    TimeDelete(TimeDelete),
    /// Stores a named pose.
    #[serde(rename = "pose.save")]
    PoseSave(PoseSave),
    /// Applies a pose to frames.
    #[serde(rename = "pose.apply")]
    PoseApply(PoseApply),
    /// Renames a pose everywhere.
    #[serde(rename = "pose.rename")]
    PoseRename(PoseRename),
    /// Deletes a pose; keys that used it keep its values.
    #[serde(rename = "pose.delete")]
    PoseDelete(PoseDelete),
    /// Adds a marker.
    #[serde(rename = "markers.add")]
    MarkersAdd(Marker),
    /// Renames the marker at a frame, or sets where its block ends.
    #[serde(rename = "markers.set")]
    MarkersSet(Marker),
    /// Moves a marker.
    #[serde(rename = "markers.move")]
    MarkersMove(MarkersMove),
    /// Removes markers.
    #[serde(rename = "markers.delete")]
    MarkersDelete(KeysFrames),
    /// Sets the title.
    #[serde(rename = "clip.rename")]
    ClipRename(ClipRename),
    /// Sets the remarks.
    #[serde(rename = "clip.notes")]
    ClipNotes(ClipNotes),
    /// Sets the length.
    #[serde(rename = "clip.length")]
    ClipLength(ClipLength),
    /// Sets the state before frame 0.
    #[serde(rename = "clip.start")]
    ClipStart(ClipStart),
    /// Several edits that count as one; either all are applied or none.
    #[serde(rename = "batch")]
    Batch(Batch),
    /// A difference between two versions, used for undo.
    #[serde(rename = "patch")]
    Patch(Box<Delta>),
}

/// Arguments of `mask.set`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct MaskSet {
    /// First frame.
    pub from: u32,
    /// Frame after the last.
    pub to: u32,
    /// The joints; absent = all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joints: Option<Vec<String>>,
    /// Hide (true) or show (false).
    pub masked: bool,
}

/// Arguments of `fill.set`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct FillSet {
    /// The keys after which the fill is set, for each of their joints up to its next key; absent = the clip's
    /// default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frames: Option<Vec<u32>>,
    /// The fill; null = the clip's default (`mask` for the default itself).
    #[schemars(extend("x-null" = true))]
    pub fill: Option<Fill>,
}

/// Arguments of `tangent.set`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct TangentSet {
    /// At which keys.
    pub frames: Vec<u32>,
    /// Of which joints; absent = all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joints: Option<Vec<String>>,
    /// The slope; null = automatic.
    #[schemars(extend("x-null" = true))]
    pub tangent: Option<Tangent>,
}

/// Arguments of `time.insert`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct TimeInsert {
    /// The frame before which frames are inserted; the clip's length appends.
    pub at: u32,
    /// The number of frames.
    pub frames: u32,
}

/// Arguments of `time.delete`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct TimeDelete {
    /// First frame.
    pub from: u32,
    /// Frame after the last.
    pub to: u32,
}

/// Arguments of `pose.save`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct PoseSave {
    /// Its name.
    pub name: String,
    /// Its values.
    pub q: Vec<Option<f64>>,
    /// Overwrite one of that name.
    #[serde(default)]
    pub replace: bool,
}

/// Arguments of `pose.apply`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct PoseApply {
    /// The pose's name.
    pub name: String,
    /// The frames that are changed; a frame without a key gets one.
    pub frames: Vec<u32>,
    /// 0 = the current values, 1 = the pose.
    #[serde(default = "whole")]
    pub blend: f64,
    /// The pose's mirror image.
    #[serde(default)]
    pub mirrored: bool,
    /// Only these joints; absent = all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joints: Option<Vec<String>>,
}

/// Arguments of `pose.rename`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct PoseRename {
    /// Its name.
    pub name: String,
    /// Its new name.
    pub to: String,
}

/// Arguments of `pose.delete`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct PoseDelete {
    /// Its name.
    pub name: String,
}

/// Arguments of `markers.move`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct MarkersMove {
    /// The marker's frame.
    pub frame: u32,
    /// Its new frame.
    pub to: u32,
}

/// Arguments of `clip.rename`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct ClipRename {
    /// The title.
    pub name: String,
}

/// Arguments of `clip.notes`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct ClipNotes {
    /// The remarks.
    pub notes: String,
}

/// Arguments of `clip.length`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct ClipLength {
    /// Frames.
    pub length: u32,
    /// Remove keys, offsets and markers beyond the new end; otherwise the edit is refused. Masks and blocks
    /// that go on beyond it end there.
    #[serde(default)]
    pub cut: bool,
}

/// Arguments of `clip.start`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct ClipStart {
    /// The start; null = the first key's values.
    #[schemars(extend("x-null" = true))]
    pub start: Option<Start>,
}

/// Arguments of `batch`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[derive(schemars::JsonSchema)]
pub struct Batch {
    /// The name of this edit in the history.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub label: String,
    /// The edits, in order.
    pub ops: Vec<Op>,
}

fn whole() -> f64 {
    1.0
}

impl Op {
    /// The name in JSON.
    pub fn name(&self) -> &'static str {
        match self {
            Op::KeysAdd(_) => "keys.add",
            Op::KeysSet(_) => "keys.set",
            Op::KeysMove(_) => "keys.move",
            Op::KeysScale(_) => "keys.scale",
            Op::KeysDelete(_) => "keys.delete",
            Op::KeysPaste(_) => "keys.paste",
            Op::KeysMirror(_) => "keys.mirror",
            Op::KeysHold(_) => "keys.hold",
            Op::KeysBake(_) => "keys.bake",
            Op::KeysSparsify(_) => "keys.sparsify",
            Op::MaskSet(_) => "mask.set",
            Op::FillSet(_) => "fill.set",
            Op::TangentSet(_) => "tangent.set",
            Op::OffsetsSet(_) => "offsets.set",
            Op::OffsetsMove(_) => "offsets.move",
            Op::OffsetsDelete(_) => "offsets.delete",
            Op::OffsetsBake(_) => "offsets.bake",
            Op::BlocksInsert(_) => "blocks.insert",
            Op::BlocksOrder(_) => "blocks.order",
            Op::BlocksRepeat(_) => "blocks.repeat",
            Op::BlocksDelete(_) => "blocks.delete",
            Op::TimeInsert(_) => "time.insert",
            Op::TimeDelete(_) => "time.delete",
            Op::PoseSave(_) => "pose.save",
            Op::PoseApply(_) => "pose.apply",
            Op::PoseRename(_) => "pose.rename",
            Op::PoseDelete(_) => "pose.delete",
            Op::MarkersAdd(_) => "markers.add",
            Op::MarkersSet(_) => "markers.set",
            Op::MarkersMove(_) => "markers.move",
            Op::MarkersDelete(_) => "markers.delete",
            Op::ClipRename(_) => "clip.rename",
            Op::ClipNotes(_) => "clip.notes",
            Op::ClipLength(_) => "clip.length",
            Op::ClipStart(_) => "clip.start",
            Op::Batch(_) => "batch",
            Op::Patch(_) => "patch",
        }
    }

    /// The name of this operation in the history.
    pub fn label(&self) -> String {
        let some = |n: usize, what: &str| match n {
            1 => what.to_owned(),
            n => format!("{n} {what}s"),
        };
        let keys = |n: usize| some(n, "key");
        let offsets = |n: usize| some(n, "offset");
        match self {
            Op::KeysAdd(a) => format!("Add {}", keys(a.keys.len())),
            Op::KeysSet(a) => format!("Change key at {}", a.frame),
            Op::KeysMove(a) if a.copy => format!("Copy {}", keys(a.frames.len())),
            Op::KeysMove(a) => format!("Move {} by {:+}", keys(a.frames.len()), a.df),
            Op::KeysScale(a) => format!("Retime {}", keys(a.frames.len())),
            Op::KeysDelete(a) => format!("Delete {}", keys(a.frames.len())),
            Op::KeysPaste(a) => format!("Paste {} at {}", keys(a.keys.len()), a.at),
            Op::KeysMirror(a) => format!("Mirror {}", keys(a.frames.len())),
            Op::KeysHold(a) => format!("Hold {} for {} frames", keys(a.frames.len()), a.hold),
            Op::KeysBake(a) => format!("Make {} hold joint values", keys(a.frames.len())),
            Op::KeysSparsify(a) => format!("Thin out {}", keys(a.frames.len())),
            Op::MaskSet(a) if a.masked => format!("Mask {}..{}", a.from, a.to),
            Op::MaskSet(a) => format!("Unmask {}..{}", a.from, a.to),
            Op::FillSet(a) => format!("Fill {}", a.fill.map_or("as the clip", Fill::word)),
            Op::TangentSet(a) => format!("Shape the curve at {}", keys(a.frames.len())),
            Op::OffsetsSet(a) => format!("Shape the motion around {}", a.frame),
            Op::OffsetsMove(a) if a.copy => format!("Copy {}", offsets(a.frames.len())),
            Op::OffsetsMove(a) => format!("Move {} by {:+}", offsets(a.frames.len()), a.df),
            Op::OffsetsDelete(a) => format!("Delete {}", offsets(a.frames.len())),
            Op::OffsetsBake(a) => format!("Add {} to the keys", offsets(a.frames.len())),
            Op::BlocksInsert(a) => format!("Insert {}", a.name),
            Op::BlocksOrder(_) => "Order the blocks".to_owned(),
            Op::BlocksRepeat(a) => format!("Repeat the block at {}", a.frame),
            Op::BlocksDelete(a) => format!("Delete the block at {}", a.frame),
            Op::TimeInsert(a) => format!("Insert {} frames at {}", a.frames, a.at),
            Op::TimeDelete(a) => format!("Delete frames {}..{}", a.from, a.to),
            Op::PoseSave(a) => format!("Save pose {}", a.name),
            Op::PoseApply(a) => format!("Apply pose {}", a.name),
            Op::PoseRename(a) => format!("Rename pose {} to {}", a.name, a.to),
            Op::PoseDelete(a) => format!("Delete pose {}", a.name),
            Op::MarkersAdd(a) => format!("Add marker {}", a.name),
            Op::MarkersSet(a) => format!("Rename marker to {}", a.name),
            Op::MarkersMove(a) => format!("Move marker to {}", a.to),
            Op::MarkersDelete(_) => "Delete markers".to_owned(),
            Op::ClipRename(a) => format!("Rename clip to {}", a.name),
            Op::ClipNotes(_) => "Edit notes".to_owned(),
            Op::ClipLength(a) => format!("Set length to {} frames", a.length),
            Op::ClipStart(_) => "Set start".to_owned(),
            Op::Batch(a) if a.label.is_empty() => format!("{} edits", a.ops.len()),
            Op::Batch(a) => a.label.clone(),
            Op::Patch(_) => "Patch".to_owned(),
        }
    }
}
