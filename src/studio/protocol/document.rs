//! The open document as clients see it.

use std::path::PathBuf;

use serde::Serialize;
use serde_json::Value;

use super::policy::PolicyCard;
use robert_clip::{Blind, Delta, Granularity, JointTable, Lint, Span};

/// The effect of an edit.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Edited {
    /// Version afterwards.
    pub rev: u64,
    /// Unsaved edits exist.
    pub dirty: bool,
    /// The changes, step by step; empty if nothing changed.
    pub patches: Vec<Delta>,
    /// Labels and position.
    pub history: History,
    /// Problems that are known without simulation.
    pub lints: Vec<Lint>,
}

/// The named history.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct History {
    /// The names of the last edits, oldest first (at most 100).
    pub labels: Vec<String>,
    /// Number of the first label, from 0.
    pub first: usize,
    /// The number of edits that are done; the rest can be redone.
    pub done: usize,
    /// The number of edits.
    pub len: usize,
}

/// The open document.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct DocumentView {
    /// Increases with every document that is opened. Choices of a page in one document (range,
    /// selection, takes) have no meaning in the next.
    pub opened: u64,
    /// Version.
    pub rev: u64,
    /// `robert-clip/1` as a JSON value.
    #[cfg_attr(test, schemars(with = "robert_clip::ClipShape"))]
    pub clip: Value,
    /// Its file.
    pub path: Option<String>,
    /// Unsaved edits exist.
    pub dirty: bool,
    /// History.
    pub history: History,
    /// Facts about its robot that the timeline needs; joints in the order of the clip.
    pub table: JointTable,
    /// Unsaved edits that came back and that nobody expects: show the banner.
    pub restored: Option<Restored>,
    /// Problems and timeline.
    pub findings: Findings,
    /// Policies as its robot can have them.
    pub policies: Vec<PolicyCard>,
}

/// Problems and the compiled timeline.
#[derive(Clone, Debug, Default, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Findings {
    /// The version they are about.
    pub rev: u64,
    /// Problems, worst first, each with its fixes (ready-made `op`s).
    pub lints: Vec<Lint>,
    /// Spans of frames of one kind, without gaps from the first frame to the last.
    pub spans: Vec<Span>,
    /// Runs of frames without any goal in the window.
    pub blind: Vec<Blind>,
    /// Whether simulation has judged every pose. It judges the first 4,000 different poses of a clip.
    pub simulated: bool,
    /// The masks that the policy in use accepts.
    pub granularity: Granularity,
}

/// `POST /api/save`.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Saved {
    /// The file.
    pub path: String,
    /// Version that it holds.
    pub rev: u64,
}

/// A clip that was never saved.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Draft {
    /// For `POST /api/drafts/{number}`.
    pub number: u32,
    /// Title of the clip.
    pub name: String,
    /// Robot.
    pub robot: String,
    /// Keys.
    pub keys: usize,
    /// Seconds since 1970 of its last edit.
    pub changed_secs: u64,
    /// Whether the studio was killed with it open, and it has not been opened since.
    pub abandoned: bool,
}

/// What came back when a clip was opened: its studio was killed, another program has changed its file since
/// it was closed, or its journal is damaged.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Restored {
    /// Edits that are not saved; what had been undone is none.
    pub edits: usize,
    /// Bytes of an unfinished record at the end that were dropped; it was never acknowledged.
    pub torn_bytes: u64,
    /// Damaged parts that could not be recovered, in words.
    pub lost: Vec<String>,
    /// The path where the damaged journal is kept.
    pub kept: Option<PathBuf>,
    /// Whether another program has changed the file since then, so that saving would overwrite that
    /// change.
    pub file_changed: bool,
}
