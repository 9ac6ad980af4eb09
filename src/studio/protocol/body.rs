//! Bodies and queries of requests over HTTP.

use serde::Deserialize;

use robert_clip::Op;

/// Body of `POST /api/ops`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct OpsRequest {
    /// The edits, in order; they count as one for undo.
    pub ops: Vec<Op>,
    /// The name of the edits in the history; if empty, the name of the first edit.
    #[serde(default)]
    pub label: String,
}

/// Body with a path.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct PathBody {
    pub path: String,
}

/// Body of `POST /api/new`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct NewBody {
    #[serde(default)]
    pub robot: Option<String>,
    #[serde(default)]
    pub length: Option<u32>,
    #[serde(default)]
    pub name: String,
    #[serde(default)]
    pub text: Option<String>,
}

/// Body of `POST /api/save`.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct SaveBody {
    pub path: Option<String>,
    /// Whether another file of that name is to be replaced.
    pub replace: bool,
}

/// Body of `POST /api/kinematics`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Poses {
    pub q: Vec<Vec<f64>>,
}

/// Body of `POST /api/settle`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Pose {
    pub q: Vec<f64>,
}

/// Query of `GET /api/export`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ExportQuery {
    pub format: String,
}

/// Query of `GET /api/files`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct FilesQuery {
    /// A folder that the user typed; the studio's folder if it is absent.
    #[serde(default)]
    pub root: String,
    /// Below it.
    #[serde(default)]
    pub dir: String,
}

/// Query of `POST /api/clips`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ClipQuery {
    /// The name of the file in the body; its suffix determines the format.
    #[serde(default)]
    pub name: String,
    /// A file of this machine instead of a body.
    #[serde(default)]
    pub path: String,
    /// The robot, for formats that do not name theirs; if absent, that of the open document.
    #[serde(default)]
    pub robot: String,
    /// Rows per second, for LAFAN files, which do not contain it.
    #[serde(default = "lafan_rate")]
    pub rate: f64,
}

fn lafan_rate() -> f64 {
    30.0
}

/// Query of `POST /api/insert`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct InsertQuery {
    /// The name of the file in the body; its suffix determines the format.
    #[serde(default)]
    pub name: String,
    /// A file of this machine instead of a body.
    #[serde(default)]
    pub path: String,
    /// Rows per second, for LAFAN files, which do not contain it.
    #[serde(default = "lafan_rate")]
    pub rate: f64,
    /// The frame before which it is inserted.
    pub at: u32,
    /// Frames of the smooth curves that lead to the block and from it.
    #[serde(default)]
    pub blend: u32,
}

/// Query of `GET /api/still.jpg`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct StillQuery {
    #[serde(default)]
    pub frame: usize,
    #[serde(default = "still_width")]
    pub w: u32,
    #[serde(default = "still_height")]
    pub h: u32,
    #[serde(default)]
    pub draft: bool,
    #[serde(default = "yes")]
    pub achieved: bool,
    #[serde(default = "yes")]
    pub command: bool,
    #[serde(default)]
    pub ghosts: bool,
    /// Numbers separated by commas: a pose that is shown instead of the reached one.
    pub pose: Option<String>,
    /// Not read. It changes the address when the picture has changed, so that the browser fetches
    /// it again.
    #[serde(default, rename = "v")]
    _version: String,
}

fn yes() -> bool {
    true
}

fn still_width() -> u32 {
    640
}

fn still_height() -> u32 {
    480
}

/// Query of `GET /api/still-body`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct StillBodyQuery {
    pub frame: usize,
    pub w: u32,
    pub h: u32,
    /// From the left edge, 0 to 1.
    pub x: f32,
    /// From the top edge, 0 to 1.
    pub y: f32,
}

/// Query of `GET /api/hover`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct HoverQuery {
    pub tab: String,
    pub x: f64,
    pub y: f64,
}

/// Query of `GET /api/pose.jpg`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct PoseQuery {
    pub pose: String,
    /// Not read: see [`StillQuery`].
    #[serde(default, rename = "v")]
    _version: String,
}

/// Query of `GET /api/thumbnail.jpg`: either `path` or `take`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ThumbnailQuery {
    /// A clip's file.
    #[serde(default)]
    pub path: Option<String>,
    /// A take of the open robot.
    #[serde(default)]
    pub take: Option<u64>,
}

/// Query of `GET /api/gallery-picture.jpg` and `/api/gallery-error`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ExampleQuery {
    pub id: String,
}

/// Query of `PUT /api/upload`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct UploadQuery {
    pub path: String,
    #[serde(default)]
    pub first: bool,
}

/// Body of `POST /api/import`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ImportBody {
    /// The URDF or MJCF: among the uploaded files, or on this machine.
    pub file: String,
    #[serde(default)]
    pub uploaded: bool,
    pub id: String,
    #[serde(default)]
    pub fixed_base: bool,
    /// Bodies to leave out, with their children.
    #[serde(default)]
    pub without: Vec<String>,
    /// As `robert import --actuators` has it.
    #[serde(default)]
    pub actuators: Option<String>,
    /// As `robert import --drives` has it.
    #[serde(default)]
    pub drives: Option<String>,
}

/// Query of `GET /api/jobs/{id}`.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct LinesFrom {
    pub from: usize,
}
