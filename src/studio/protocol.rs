//! What the studio and its clients say to each other, precisely.
//!
//! The browser page, `examples/` scripts and tests all use this one protocol: JSON over HTTP
//! and over one WebSocket. Values are rad, m, s and frames of 1/20 s. Every struct here
//! serialises to the JSON that is described; absent options are left out, unknown fields in
//! requests are refused.
//!
//! # Access
//!
//! `robert studio` prints `http://127.0.0.1:PORT/#token=HEX`. A page sends
//! `POST /api/session` with `Authorization: Bearer HEX` once, gets a cookie (`HttpOnly`,
//! `SameSite=Strict`) and drops the fragment. A script sends the Bearer header with every
//! request, and on the socket either that header or `?token=HEX`.
//!
//! # HTTP
//!
//! | request | answer |
//! |---|---|
//! | `POST /api/session` | 204 and the cookie |
//! | `GET /api/state` | [`State`] |
//! | `GET /api/clip` | the clip's canonical text (`robert-clip/1`); 404 without a document |
//! | `PUT /api/clip` | body = clip text: replaces the content as one edit; [`Edited`] |
//! | `POST /api/ops` | [`OpsRequest`] → [`Edited`]; all or none of them |
//! | `POST /api/undo`, `/api/redo` | [`Edited`] |
//! | `POST /api/open` `{path}` | [`DocumentView`]; 422 with the text that the command line prints |
//! | `POST /api/new` `{robot, length?, name?, text?}` | [`DocumentView`]; `text` imports a clip without a file |
//! | `GET /api/files?root=P&dir=D` | [`Listing`](super::folders::Listing): what could be opened in a folder |
//! | `POST /api/clips?name=N&robot=R`, or `?path=P` | body = a file of any format that can be read: [`DocumentView`] of a new clip |
//! | `POST /api/save` `{path?, replace?}` | [`Saved`]; 409 where another file of that name is, unless `replace` |
//! | `POST /api/close` | 204; unsaved edits stay in the journal |
//! | `POST /api/discard` | [`Edited`]: back to the saved content, as an edit |
//! | `GET /api/gallery` | list of [`GalleryItem`] |
//! | `POST /api/gallery/{id}` | opens a copy: [`DocumentView`] |
//! | `GET /api/recent` | list of [`RecentFile`] |
//! | `GET /api/drafts` | list of [`Draft`]: clips that were never saved and are not open |
//! | `POST /api/drafts/{number}` | opens it: [`DocumentView`] |
//! | `POST /api/drafts/{number}/discard` | 204; it is gone |
//! | `GET /api/robots` | list of [`RobotCard`] |
//! | `GET /api/robot/{id}` | [`RobotFacts`](super::worker::RobotFacts) |
//! | `GET /api/robot/{id}/geometry` | [`Geometry`](super::worker::Geometry) |
//! | `POST /api/kinematics` `{q: [[..]]}` | body transforms by pose |
//! | `POST /api/ik` [`IkRequest`] | [`IkAnswer`](super::worker::IkAnswer) |
//! | `GET /api/hover?tab=T&x=X&y=Y` | body and joint under a point (0 to 1 from the top left) of a page's 3D view, or null; T as in the query of the view's socket |
//! | `POST /api/settle` `{q}` | [`SettleAnswer`](super::worker::SettleAnswer) |
//! | `GET /api/rollout` | [`RolloutView`] with all frames |
//! | `GET /api/takes`, `/api/takes/{id}` | [`TakesView`]: finished rollouts of the open robot; the motion of one |
//! | `GET /api/export?format=F` | bytes; F = json, csv, mjcf, ros, command (clip) or achieved-csv (rollout) |
//! | `POST /api/exports` `{format, path?, size?, frames?, overlay?, camera?, moments?}` | `JobView`: performs the clip as it is and writes mp4, gif, apng, png, strip, mcap, csv, json, mjcf, ros, viser or html |
//! | `GET /api/still-body?frame=N&w=W&h=H&x=X&y=Y` | name of the body that the draft still shows at X, Y (0 to 1 from the top left), or null |
//! | `GET /api/still.jpg?frame=N&w=W&h=H&draft=B&achieved=B&command=B&ghosts=B&pose=Q,..` | the rollout at a frame, or a pose in its place, rendered here; 500 with what to install where no driver is |
//! | `GET /api/pose.jpg?pose=NAME`, `/api/gallery-picture.jpg?id=ID` | a pose; an example, performed |
//! | `GET /api/gallery-error?id=ID` | [`MeanError`](super::worker::MeanError) of that performance, or null |
//! | `GET /api/shelf` | [`Shelf`](super::shelf::Shelf): runs, data, presets in the studio's folder |
//! | `GET /api/curves?path=RUN` | metrics of a training run, thinned |
//! | `PUT /api/upload?path=NAME&first=B` | 204; body = one file of a robot to import |
//! | `POST /api/import` `{file, uploaded?, id, fixed_base?}` | `JobView`: makes `robots/ID` |
//! | `GET /api/jobs` | list of [`JobView`](super::jobs::JobView) |
//! | `POST /api/jobs` [`JobRequest`](super::jobs::JobRequest) | `JobView` |
//! | `GET /api/jobs/{id}` | `JobView` with its lines; `?from=N` skips the first N |
//! | `GET /api/jobs/{id}/file` | what an export made, when it is done |
//! | `POST /api/jobs/{id}/cancel`, `/resume` | `JobView` |
//!
//! Every refusal is an [`ErrorBody`] with a fitting status.
//!
//! # Socket `/api/ws`
//!
//! Client → server: one JSON text message each, `{"id": N, "op": NAME, "args": {..}}`. NAME is a
//! clip operation (`keys.add`, ..., see [`crate::clip::Op`]) or one of [`StudioOp`]. `id` is chosen by the
//! client and comes back; a client has one request under way at a time, later ones wait in
//! its own socket.
//!
//! Server → client: [`Event`], `{"event": NAME, ...}`:
//!
//! * `hello` comes first: the client's number, then the whole [`State`]. Skip an `edit` whose
//!   `rev` is not above that of the document you have.
//! * `edit`: a change, in order of `rev`, sent to every client *including its author*
//!   (`by` = author's client number, `id` = its request). It is the acknowledgement: the change is
//!   on disk. Apply `patch` (see [`crate::clip::Delta`]) to your copy. The journal's
//!   restored or discarded edits have `by` 0.
//! * `reply`: answers a request that changed nothing or is no edit; `result` or `error`.
//! * `document`: throw your copy away and take this one (open, new, close, or you were so
//!   slow that edits were skipped; what they would have acknowledged comes as `reply`).
//! * `findings`: problems and timeline of a `rev`; follow every change, later once more with
//!   what simulation found.
//! * `rollout.frames`: frames `from..from+q.len()` of rollout `gen`. Throw away what you have
//!   from `from` on. Frames before `from` stay valid even when `gen` is new: they are the
//!   frames that an edit could not change. A slow client gets fewer, larger events.
//! * `rollout.state`: waiting, running, done, failed, off; `cached_to`, MAE, milliseconds a frame.
//! * `worker`: the simulation's state, for a banner.
//! * `job`: a job's new state (latest only).
//! * `select`, `joint`, `joint.cancelled`, `locked`: what happens in the viewport: a link was
//!   clicked, a hand turns joints, gives up, or must leave some as they are.
//! * `notice`: a sentence for a banner.

mod event;
mod refusal;
mod request;
#[cfg(test)]
mod typescript;

use serde::{Deserialize, Serialize};
use serde_json::Value;

pub use event::{Event, Outcome};
pub use refusal::{Code, ErrorBody, Place};
pub use request::{IkRequest, OpsRequest, STUDIO_OPS, Selection, StudioOp, ViewShow};

use super::document::Restored;
use super::takes::TakesView;
use super::worker::WorkerState;
use crate::clip::{Blind, Delta, Granularity, JointTable, Lint, Span};
use crate::rollout::{Guide, Offer, PolicyConfig, PolicyName};

/// What an edit did.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Edited {
    /// Version afterwards.
    pub rev: u64,
    /// Unsaved edits exist.
    pub dirty: bool,
    /// What changed, step by step; empty when nothing did.
    pub patches: Vec<Delta>,
    /// Labels and position.
    pub history: History,
    /// Problems as far as they are known without simulation.
    pub lints: Vec<Lint>,
}

/// The named history.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct History {
    /// The last labels, oldest first (at most 100).
    pub labels: Vec<String>,
    /// Number of the first label, from 0.
    pub first: usize,
    /// How many edits are done; the rest can be redone.
    pub done: usize,
    /// How many there are.
    pub len: usize,
}

/// The open document.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct DocumentView {
    /// Rises with every document that is opened: what a page chose in one (range, selection,
    /// takes) means nothing in the next.
    pub opened: u64,
    /// Version.
    pub rev: u64,
    /// `robert-clip/1` as a JSON value.
    #[cfg_attr(test, schemars(with = "crate::clip::ClipShape"))]
    pub clip: Value,
    /// Its file.
    pub path: Option<String>,
    /// Unsaved edits exist.
    pub dirty: bool,
    /// History.
    pub history: History,
    /// Facts about its robot that the timeline needs.
    pub table: JointTable,
    /// Unsaved edits that a start brought back: show the banner.
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
    /// Problems, worst first, each with its mends (ready-made `op`s).
    pub lints: Vec<Lint>,
    /// What the frames are; tiles the clip.
    pub spans: Vec<Span>,
    /// Runs of steps without any goal in sight.
    pub blind: Vec<Blind>,
    /// Whether simulation has judged every pose.
    pub simulated: bool,
    /// What the policy in use can leave open.
    pub granularity: Granularity,
}

/// Everything a fresh page needs.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct State {
    /// Version of the program.
    pub version: &'static str,
    /// The document, if one is open.
    pub document: Option<DocumentView>,
    /// Rollout settings.
    pub rollout: RolloutSettings,
    /// Policies that can be chosen.
    pub policies: Vec<PolicyCard>,
    /// The simulation.
    pub worker: WorkerState,
    /// Whether the 3D client is there; otherwise the viewport is made of stills.
    pub viser: bool,
    /// Editor clients connected.
    pub clients: usize,
    /// Where relative paths start.
    pub folder: String,
    /// Joints that no hand moves.
    pub locked: Vec<String>,
    /// Takes of the open robot.
    pub takes: TakesView,
}

/// A policy to choose.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct PolicyCard {
    /// Name, as on the command line.
    pub name: PolicyName,
    /// Name of the model, where it is not the robot's default one: `model_path` of
    /// [`RolloutSettings`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model: Option<String>,
    /// The case that it is best for.
    pub suits: String,
    /// What should fill masked frames for it.
    pub guide: Guide,
    /// Whether it has the robot's own model to compute with.
    pub knows_model: bool,
    /// Whether it plans so long that a clip takes seconds.
    pub slow: bool,
    /// Whether it can be chosen for this robot without a model file of one's own.
    pub available: bool,
    /// What it needs, when it cannot.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub why: Option<String>,
    /// Whether it learned something, and so can have a model file of one's own.
    pub learned: bool,
    /// Who performs unless one is chosen.
    pub default: bool,
}

/// Every policy as this robot can have it.
pub fn policies(offers: &[Offer]) -> Vec<PolicyCard> {
    let card = |o: &Offer| PolicyCard {
        name: o.name,
        model: o.model.clone(),
        suits: o.suits.clone(),
        guide: o.guide,
        knows_model: o.knows_model,
        slow: o.slow,
        available: o.needs.is_none(),
        why: o.needs.clone(),
        learned: o.name.needs_model(),
        default: o.default,
    };
    offers.iter().map(card).collect()
}

/// How the live rollout is made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RolloutSettings {
    /// The policy.
    pub policy: PolicyName,
    /// Improve each action on the model.
    pub refine: bool,
    /// Virtual commands through masks.
    pub guide: Guide,
    /// Seed.
    pub seed: u64,
    /// Roll out after every edit.
    pub auto: bool,
    /// Model or fit file, for policies that learned something.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model_path: Option<String>,
}

impl RolloutSettings {
    /// The policy that they ask for, without its model.
    pub fn config(&self) -> PolicyConfig {
        let mut config = PolicyConfig::new(self.policy);
        config.refine = self.refine;
        config.guide = self.guide;
        config
    }

    /// What takes and pictures say who performed.
    pub fn label(&self) -> String {
        let model_path = self.model_path.as_ref().map(Into::into);
        PolicyConfig { model_path, ..self.config() }.label()
    }
}

impl Default for RolloutSettings {
    fn default() -> Self {
        RolloutSettings {
            policy: PolicyName::ComputedTorque,
            refine: false,
            guide: Guide::None,
            seed: 0,
            auto: true,
            model_path: None,
        }
    }
}

/// `GET /api/rollout`.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RolloutView {
    /// State.
    pub state: RolloutState,
    /// Achieved states; `q[f]` is frame f.
    pub q: Vec<Vec<f32>>,
    /// Mean absolute error by frame, null where masked.
    pub error: Vec<Option<f64>>,
    /// Full figures, when done.
    #[cfg_attr(test, schemars(with = "Option<crate::rollout::Precision>"))]
    pub precision: Option<Value>,
}

/// How far the rollout is.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RolloutState {
    /// Number of the rollout; rises with every restart.
    #[serde(rename = "gen")]
    pub generation: u64,
    /// Version of the document that it performs; 0 for a preview.
    pub rev: u64,
    /// What it is doing.
    pub phase: Phase,
    /// Frames `0..cached_to` are valid.
    pub cached_to: usize,
    /// Frames of the clip.
    pub frames: usize,
    /// The frame it was resumed from.
    pub resumed_at: usize,
    /// Mean absolute error so far, rad or m.
    pub mae: Option<f64>,
    /// Time a simulated frame takes, milliseconds.
    pub ms_per_frame: Option<f64>,
    /// Who performs it, such as `pd+refine`.
    pub policy: String,
    /// Why it failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
}

/// What a rollout is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum Phase {
    /// There is none.
    #[default]
    Off,
    /// Asked for, no frame yet.
    Waiting,
    /// Frames come.
    Running,
    /// All frames are there.
    Done,
    /// It broke; frames before stand.
    Failed,
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
    /// One of the few that the start page shows large.
    pub featured: bool,
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
    /// The studio was killed with it open, and nobody has looked at it since.
    pub abandoned: bool,
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
    /// Seconds since 1970 when it was last open here.
    pub opened_secs: u64,
    /// Whether it is still there.
    #[serde(default, skip_deserializing)]
    pub exists: bool,
}

/// One robot, in short.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RobotCard {
    /// Identifier.
    pub id: String,
    /// What it is loaded by: its id, or its folder.
    pub source: String,
    /// Whether it comes with the program.
    pub builtin: bool,
    /// Names of the trained models that it has.
    pub models: Vec<String>,
}
