//! Requests on the socket that are no clip edits.

use serde::{Deserialize, Serialize};

use super::robot::Pin;
use super::rollout::RolloutSettings;
use robert_clip::Op;

/// Requests on the socket that are not clip edits.
#[derive(Clone, Debug, Deserialize)]
#[serde(tag = "op", content = "args", deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum StudioOp {
    /// Takes the last edit back.
    #[serde(rename = "undo")]
    Undo {},
    /// Does it again.
    #[serde(rename = "redo")]
    Redo {},
    /// Undoes or redoes until `done` edits are done.
    #[serde(rename = "history.goto")]
    HistoryGoto {
        /// The number of edits that are done afterwards.
        done: usize,
    },
    /// Previews an edit: it is rolled out, but not stored. Send it during a drag; the newest one
    /// replaces the others. The reply's `demand` is the [`robert_clip::Demand`] of the edit, or
    /// null.
    #[serde(rename = "preview")]
    Preview {
        /// The edit.
        op: Box<Op>,
    },
    /// Back to the document.
    #[serde(rename = "preview.end")]
    PreviewEnd {},
    /// Changes how rollouts are made; absent fields get their defaults.
    #[serde(rename = "rollout.set")]
    RolloutSet(RolloutSettings),
    /// Rolls out now (when `auto` is off).
    #[serde(rename = "rollout.run")]
    RolloutRun {},
    /// Stops it; frames so far stay.
    #[serde(rename = "rollout.cancel")]
    RolloutCancel {},
    /// Starts the simulation again after it has failed too often.
    #[serde(rename = "worker.restart")]
    WorkerRestart {},
    /// Pins a take, which is then kept until it is removed, or unpins it.
    #[serde(rename = "take.pin")]
    TakePin {
        /// The take's id.
        id: u64,
        /// Whether.
        pinned: bool,
    },
    /// Names a take and pins it.
    #[serde(rename = "take.name")]
    TakeName {
        /// The take's id.
        id: u64,
        /// The new name.
        name: String,
    },
    /// Draws these takes beside the current motion; the last one also in the viewport.
    #[serde(rename = "take.compare")]
    TakeCompare {
        /// The ids of the takes to compare; an empty list ends the comparison.
        ids: Vec<u64>,
    },
    /// Forgets a take.
    #[serde(rename = "take.remove")]
    TakeRemove {
        /// The take's id.
        id: u64,
    },
    /// Shows this frame in the viewport (also while scrubbing).
    #[serde(rename = "view.frame")]
    ViewFrame {
        /// The frame; fractions are interpolated.
        frame: f64,
    },
    /// Plays in the viewport, at `speed` from `frame` on; the page runs its own clock in the same
    /// way.
    #[serde(rename = "view.play")]
    ViewPlay {
        /// The frame at which playback begins.
        frame: f64,
        /// Frames of the loop, `[from, to)`; absent = the clip, once.
        #[serde(default)]
        range: Option<[u32; 2]>,
        /// Times real time; 0 stops.
        speed: f64,
    },
    /// The parts that the viewport shows; absent fields keep their value.
    #[serde(rename = "view.show")]
    ViewShow(ViewShow),
    /// Selects a joint or a body, or nothing.
    #[serde(rename = "view.select")]
    ViewSelect(Selection),
    /// Joints that stay fixed in the viewport, in drags and in inverse kinematics.
    #[serde(rename = "view.lock")]
    ViewLock {
        /// All fixed joints; an empty list frees every joint.
        joints: Vec<String>,
    },
    /// Sites that inverse kinematics keeps in place, in every request.
    #[serde(rename = "view.pins")]
    ViewPins {
        /// All pinned sites; an empty list frees every site.
        pins: Vec<Pin>,
    },
    /// Cancels the current drag in the viewport.
    #[serde(rename = "view.cancel")]
    ViewCancel {},
    /// Frames the camera: `home`, `fit`, `front`, `side`, `top`, `selection`.
    #[serde(rename = "view.camera")]
    ViewCamera {
        /// The name of the preset.
        preset: String,
    },
    /// Shows a pose that is not in the clip (a floating pose); null ends it.
    #[serde(rename = "view.pose")]
    ViewPose {
        /// One value per state joint.
        #[cfg_attr(test, schemars(extend("x-null" = true)))]
        q: Option<Vec<f64>>,
    },
}

/// The names of [`StudioOp`]; any other is a clip operation.
pub const STUDIO_OPS: [&str; 23] = [
    "undo",
    "redo",
    "history.goto",
    "preview",
    "preview.end",
    "rollout.set",
    "rollout.run",
    "rollout.cancel",
    "worker.restart",
    "take.pin",
    "take.name",
    "take.compare",
    "take.remove",
    "view.frame",
    "view.play",
    "view.show",
    "view.select",
    "view.lock",
    "view.pins",
    "view.cancel",
    "view.camera",
    "view.pose",
    "ping",
];

/// Parts of the viewport.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ViewShow {
    /// The achieved motion, solid.
    #[serde(default)]
    pub achieved: Option<bool>,
    /// The command, translucent.
    #[serde(default)]
    pub command: Option<bool>,
    /// Poses of the neighbouring keys.
    #[serde(default)]
    pub ghosts: Option<bool>,
    /// The path of what is selected.
    #[serde(default)]
    pub path: Option<bool>,
    /// The pose that the robot can reach at the playhead, where it cannot reach the commanded one.
    #[serde(default)]
    pub reachable: Option<bool>,
    /// Dark background.
    #[serde(default)]
    pub dark: Option<bool>,
    /// Whether the robot casts a shadow on the ground.
    #[serde(default)]
    pub shadows: Option<bool>,
}

/// The selection; shared by all clients.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Selection {
    /// A state joint.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joint: Option<String>,
    /// A body.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub body: Option<String>,
    /// A site to drag by inverse kinematics.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub site: Option<String>,
}
