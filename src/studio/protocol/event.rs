//! Events that the server sends on the socket.

use std::collections::BTreeMap;

use serde::Serialize;

use super::document::{DocumentView, Findings, History};
use super::job::JobView;
use super::op::Selection;
use super::refusal::ErrorBody;
use super::robot::Pin;
use super::rollout::{RolloutSettings, RolloutState, TakesView, WorkerState};
use super::state::State;
use robert_clip::{Delta, Demand, Level};

/// The answer to a request that changed nothing.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum Outcome {
    /// The request was carried out; there is no result.
    Done,
    /// The document is as it was.
    Unchanged {
        /// Its version.
        rev: u64,
    },
    /// An edit is previewed.
    Previewed {
        /// The joint speeds that the edit asks for, if they are known.
        demand: Option<Demand>,
    },
}

/// Server → client on the socket.
#[derive(Clone, Debug, Serialize)]
#[serde(tag = "event")]
#[allow(clippy::large_enum_variant)] // built, written out as JSON, dropped
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum Event {
    /// First of all.
    #[serde(rename = "hello")]
    Hello {
        /// Your number.
        client: u64,
        /// Everything.
        state: Box<State>,
    },
    /// A change of the document.
    #[serde(rename = "edit")]
    Edit {
        /// Its author's number.
        by: u64,
        /// The author's request.
        #[serde(skip_serializing_if = "Option::is_none")]
        id: Option<u64>,
        /// Version afterwards.
        rev: u64,
        /// In words.
        label: String,
        /// The difference.
        patch: Delta,
        /// Unsaved edits exist.
        dirty: bool,
        /// History.
        history: History,
        /// First compiled frame that differs.
        first_changed_frame: Option<u32>,
        /// First rollout step whose goals differ; the plan through a gap may change before.
        first_changed_step: Option<u32>,
    },
    /// The answer to a request that is not an edit, or that was refused.
    #[serde(rename = "reply")]
    Reply {
        /// The request.
        id: u64,
        /// Its result.
        #[serde(skip_serializing_if = "Option::is_none")]
        result: Option<Outcome>,
        /// Why not.
        #[serde(skip_serializing_if = "Option::is_none")]
        error: Option<ErrorBody>,
    },
    /// Another document, or this one afresh.
    #[serde(rename = "document")]
    Document {
        /// It; null when none is open.
        document: Option<Box<DocumentView>>,
    },
    /// Saved.
    #[serde(rename = "saved")]
    Saved {
        /// The file.
        path: String,
        /// Version that it holds.
        rev: u64,
    },
    /// Problems and timeline.
    #[serde(rename = "findings")]
    Findings(Findings),
    /// Rollout settings changed.
    #[serde(rename = "rollout.settings")]
    RolloutSettings(RolloutSettings),
    /// New frames.
    #[serde(rename = "rollout.frames")]
    RolloutFrames {
        /// The generation of the rollout.
        #[serde(rename = "gen")]
        generation: u64,
        /// First frame here.
        from: usize,
        /// Achieved states.
        q: Vec<Vec<f32>>,
        /// Mean absolute error by frame, null where masked.
        error: Vec<Option<f64>>,
    },
    /// The progress of the rollout.
    #[serde(rename = "rollout.state")]
    RolloutState(RolloutState),
    /// Takes, and which are compared.
    #[serde(rename = "takes")]
    Takes(TakesView),
    /// State of the simulation.
    #[serde(rename = "worker")]
    Worker(WorkerState),
    /// State of a job.
    #[serde(rename = "job")]
    Job(Box<JobView>),
    /// Something was selected.
    #[serde(rename = "select")]
    Select(Selection),
    /// A person turns a joint in the viewport. If `done` is true the mouse was released, and the
    /// page makes the edit.
    #[serde(rename = "joint")]
    Joint {
        /// New values by joint.
        values: BTreeMap<String, f64>,
        /// Whether the mouse was released.
        done: bool,
        /// The page whose 3D view it happens in (`tab` in the query of its socket); only this page
        /// makes the edit. If it is absent, any page does.
        #[serde(skip_serializing_if = "Option::is_none")]
        tab: Option<String>,
    },
    /// The drag in the viewport was cancelled, so the page makes no edit.
    #[serde(rename = "joint.cancelled")]
    JointCancelled {
        /// See [`Event::Joint`].
        #[serde(skip_serializing_if = "Option::is_none")]
        tab: Option<String>,
    },
    /// Joints that are locked: no drag moves them.
    #[serde(rename = "locked")]
    Locked {
        /// All of them.
        joints: Vec<String>,
    },
    /// Sites that inverse kinematics keeps in place.
    #[serde(rename = "pinned")]
    Pinned {
        /// All of them.
        pins: Vec<Pin>,
    },
    /// A point of the drawn path was clicked or dragged: the playhead goes to its frame.
    #[serde(rename = "path.point")]
    PathPoint {
        /// The frame.
        frame: u32,
        /// Joint values for a key that was requested at that frame; absent if the frame has a key.
        /// Absent: it has one.
        values: Option<BTreeMap<String, f64>>,
        /// See [`Event::Joint`].
        #[serde(skip_serializing_if = "Option::is_none")]
        tab: Option<String>,
    },
    /// A sentence for a banner.
    #[serde(rename = "notice")]
    Notice {
        /// The importance of the notice.
        level: Level,
        /// It.
        message: String,
    },
}
