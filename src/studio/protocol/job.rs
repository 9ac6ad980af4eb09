//! Jobs: the commands that the studio starts as children, as clients see them.

use serde::{Deserialize, Serialize};

use robert_base::progress::{JobEvent, JobProgress};

/// A kind of job.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum JobKind {
    /// Gather motion without reward.
    Collect,
    /// Train a network.
    Train,
    /// Measure policies.
    Eval,
    /// Render a picture or a film.
    Render,
    /// Write a take in another format.
    Export,
    /// Makes a robot's folder from a model file.
    Import,
}

/// `POST /api/jobs`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct JobRequest {
    /// The kind of job.
    pub kind: JobKind,
    /// Arguments as on the command line, without `--jsonl`.
    pub args: Vec<String>,
}

/// The state of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum JobPhase {
    /// It runs.
    Running,
    /// It was asked to stop.
    Cancelling,
    /// It ended well.
    Done,
    /// The job ended after a request to stop, with a checkpoint.
    Interrupted,
    /// It ended badly.
    Failed,
}

/// A job as the page sees it.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct JobView {
    /// Number.
    pub id: u64,
    /// The kind of job.
    pub kind: JobKind,
    /// Its arguments.
    pub args: Vec<String>,
    /// The purpose of the job, in words.
    pub title: String,
    /// The state of the job.
    pub phase: JobPhase,
    /// Exit code, when it has ended.
    pub exit: Option<i32>,
    /// The progress of the job: the newest `progress` event.
    pub progress: Option<JobProgress>,
    /// The newest other event.
    pub last: Option<JobEvent>,
    /// The name of the file that it makes, for `GET /api/jobs/{id}/file`; available when the job is
    /// done.
    pub file: Option<String>,
    /// Other events so far.
    pub events: usize,
    /// Number of the first event in `lines`.
    pub first: usize,
    /// Events, in `GET /api/jobs/{id}` only.
    pub lines: Vec<JobEvent>,
    /// The last lines of its log.
    pub log: Vec<String>,
    /// Seconds it has run.
    pub secs: f64,
}

/// What becomes of an export.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum ExportKind {
    /// A film of the performed clip.
    Film,
    /// A picture of it.
    Picture,
    /// A file of the motion.
    Take,
    /// A folder, which is written on the studio's disk and cannot be downloaded.
    Folder,
    /// Made from the clip alone, at once and without performing it.
    Clip,
}

/// A format of `GET /api/formats`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ExportFormat {
    /// For [`ExportRequest`].
    pub format: &'static str,
    /// What people call it.
    pub title: &'static str,
    /// What is in it, and for whom.
    pub about: &'static str,
    /// Ending of its file.
    pub ending: &'static str,
    /// What becomes of it.
    pub kind: ExportKind,
    /// Why the robot of the open clip cannot have it; `None` if it can.
    pub why: Option<String>,
}

/// Body of `POST /api/exports`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ExportRequest {
    /// One of `GET /api/formats`.
    pub format: String,
    /// The file to write, relative to the studio's folder; without it the result is fetched
    /// from the job.
    #[serde(default)]
    pub path: Option<String>,
    /// Whether another file of that name is to be replaced.
    #[serde(default)]
    pub replace: bool,
    /// Pixels, for pictures and films.
    #[serde(default)]
    pub size: Option<[u32; 2]>,
    /// Frames `[from, to)`, for films; the frame `from`, for a picture.
    #[serde(default)]
    pub frames: Option<[u32; 2]>,
    /// The robot that is laid over the picture.
    #[serde(default)]
    pub overlay: Option<String>,
    /// fit, fixed, top, orbit, or a camera of the model.
    #[serde(default)]
    pub camera: Option<String>,
    /// Moments of a strip.
    #[serde(default)]
    pub moments: Option<u32>,
    /// The chart that is drawn beside it.
    #[serde(default)]
    pub compare: Option<Beside>,
}

/// The panels beside the clip in a picture or film.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum Beside {
    /// The number of a take, which is performed again: the same clip, policy and seed give the same
    /// bits.
    Take(u64),
    /// Another clip, performed by the same policy, or a take in a file; relative to the
    /// studio's folder.
    File(String),
}
