//! The content of the studio's folder: examples, recent files, clips, runs and data.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// One example.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct GalleryItem {
    /// For `POST /api/gallery/{id}`.
    pub id: String,
    /// Title.
    pub name: String,
    /// Robot.
    pub robot: String,
    /// Frames.
    pub length: u32,
    /// Keys.
    pub keys: usize,
    /// Whether it is one of the few examples that the start page shows large.
    pub featured: bool,
}

/// One recent file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RecentFile {
    /// Path.
    pub path: String,
    /// Title of the clip.
    pub name: String,
    /// Robot.
    pub robot: String,
    /// When it was last opened here, seconds since 1970.
    pub opened_secs: u64,
    /// Whether it is still there.
    #[serde(default, skip_deserializing)]
    pub exists: bool,
}

/// A training run on disk.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RunCard {
    /// Folder, relative to the studio's.
    pub path: String,
    /// Robot, once there is a model.
    pub robot: Option<String>,
    /// Preset it began with.
    pub preset: String,
    /// Steps done.
    pub step: u64,
    /// Steps wanted.
    pub steps: u64,
    /// Best Precision by suite, if it was measured.
    pub precision: Option<BTreeMap<String, f64>>,
    /// The model of the run, once it exists.
    pub model: Option<String>,
    /// The data of the run, once it has a model.
    pub dataset_sha256: Option<String>,
    /// Seconds since 1970 of the last change.
    pub changed_secs: u64,
}

/// Collected data on disk.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct DataCard {
    /// Folder, relative to the studio's.
    pub path: String,
    /// Robot.
    pub robot: String,
    /// Transitions.
    pub frames: u64,
    /// Trajectories.
    pub episodes: u64,
    /// The hash by which model cards name it.
    pub sha256: String,
}

/// A collection that was begun and is not complete yet.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct BegunCard {
    /// Folder, relative to the studio's.
    pub path: String,
    /// Robot.
    pub robot: String,
    /// The agents that collect.
    pub agents: Vec<String>,
    /// Frames that are wanted.
    pub transitions: u64,
}

/// The answer of `GET /api/shelf`.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Shelf {
    /// Runs, the newest first.
    pub runs: Vec<RunCard>,
    /// Data, by path.
    pub data: Vec<DataCard>,
    /// Data that is not complete yet, by path.
    pub begun: Vec<BegunCard>,
    /// Presets of training, each with a sentence.
    pub presets: Vec<(&'static str, &'static str)>,
}

/// The kind of a file, judged by its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum FileKind {
    /// `robert-clip/1`.
    Clip,
    /// Frames and joints as a table.
    Csv,
    /// Keys of an MJCF.
    Mjcf,
    /// A ROS 2 JointTrajectory.
    Ros,
    /// LAFAN rows: recorded motion without header or rate.
    Lafan,
    /// A take: the motion that it reached.
    Take,
}

/// A summary of a clip file.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Peek {
    /// Title.
    pub name: String,
    /// Robot.
    pub robot: String,
    /// Frames.
    pub length: u32,
    /// Keys.
    pub keys: usize,
}

/// A file that can be opened.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct FileCard {
    /// Its name.
    pub name: String,
    /// The kind of the file, judged by its name.
    pub kind: FileKind,
    /// Bytes.
    pub bytes: u64,
    /// Seconds since 1970 of its last change.
    pub changed_secs: u64,
    /// A summary; for clips of a moderate size.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clip: Option<Peek>,
    /// Why it cannot be opened.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub why: Option<String>,
}

/// A folder as the Open dialog shows it.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Listing {
    /// The full path of the folder.
    pub root: String,
    /// The folder below it; empty for itself.
    pub dir: String,
    /// Folders in it.
    pub folders: Vec<String>,
    /// Files in it, by name.
    pub files: Vec<FileCard>,
    /// Entries with hidden or odd names, links that lead outside, other kinds of files.
    pub left_out: usize,
    /// There are more than are listed.
    pub more: bool,
}
