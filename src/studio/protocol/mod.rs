//! The protocol between the studio and its clients.
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
//! | `GET /api/files?root=P&dir=D` | [`Listing`]: what could be opened in a folder |
//! | `POST /api/clips?name=N&robot=R`, or `?path=P` | body = a file of any format that can be read: [`DocumentView`] of a new clip |
//! | `POST /api/insert?at=F&blend=N&name=N`, or `&path=P` | body = such a file: it becomes a block of the open clip, as one edit; [`Edited`] |
//! | `POST /api/save` `{path?, replace?}` | [`Saved`]; 409 where another file of that name is, or another program has changed this one, unless `replace` |
//! | `POST /api/reload` | [`Edited`]: the content of the file as it is now, as an edit |
//! | `POST /api/close` | 204; unsaved edits stay in the journal |
//! | `POST /api/discard` | [`Edited`]: back to the saved content, as an edit |
//! | `GET /api/thumbnail.jpg?path=P`, or `?take=N` | a picture of the middle of a clip's file or a take |
//! | `GET /api/formats` | list of [`ExportFormat`], each with why the open clip's robot cannot have it, if so |
//! | `GET /api/gallery` | list of [`GalleryItem`] |
//! | `POST /api/gallery/{id}` | opens a copy: [`DocumentView`] |
//! | `GET /api/recent` | list of [`RecentFile`] |
//! | `GET /api/drafts` | list of [`Draft`]: clips that were never saved and are not open |
//! | `POST /api/drafts/{number}` | opens it: [`DocumentView`] |
//! | `POST /api/drafts/{number}/discard` | 204; it is gone |
//! | `GET /api/robots` | list of [`RobotCard`] |
//! | `GET /api/robot/{id}` | [`RobotFacts`] |
//! | `GET /api/robot/{id}/geometry` | [`Geometry`] |
//! | `POST /api/kinematics` `{q: [[..]]}` | body transforms by pose |
//! | `POST /api/ik` [`IkRequest`] | [`IkAnswer`] |
//! | `POST /api/draw` [`DrawRequest`] | [`DrawAnswer`]: a line over a page's 3D view as keys |
//! | `GET /api/hover?tab=T&x=X&y=Y` | body and joint under a point (0 to 1 from the top left) of a page's 3D view, or null; T as in the query of the view's socket |
//! | `POST /api/settle` `{q}` | [`SettleAnswer`] |
//! | `GET /api/rollout` | [`RolloutView`] with all frames |
//! | `GET /api/takes`, `/api/takes/{id}` | [`TakesView`]: finished rollouts of the open robot; the motion of one |
//! | `GET /api/export?format=F` | bytes; F = json, csv, mjcf, ros, command (clip) or achieved-csv (rollout) |
//! | `POST /api/exports` `{format, path?, replace?, size?, frames?, overlay?, camera?, moments?}` | `JobView`; 409 where a file of that name is, unless `replace`. It performs the clip as it is and writes mp4, gif, apng, png, strip, mcap, csv, json, mjcf, ros, viser or html |
//! | `GET /api/still-body?frame=N&w=W&h=H&x=X&y=Y` | name of the body that the draft still shows at X, Y (0 to 1 from the top left), or null |
//! | `GET /api/still.jpg?frame=N&w=W&h=H&draft=B&achieved=B&command=B&ghosts=B&pose=Q,..` | the rollout at a frame, or a pose in its place, rendered here; 500 with what to install where no driver is |
//! | `GET /api/pose.jpg?pose=NAME`, `/api/gallery-picture.jpg?id=ID` | a pose; an example, performed |
//! | `GET /api/gallery-error?id=ID` | [`MeanError`] of that performance, or null |
//! | `GET /api/shelf` | [`Shelf`]: runs, data, presets in the studio's folder |
//! | `GET /api/curves?path=RUN` | metrics of a training run, thinned |
//! | `PUT /api/upload?path=NAME&first=B` | 204; body = one file of a robot to import |
//! | `POST /api/import` `{file, uploaded?, id, fixed_base?, without?, actuators?, drives?}` | `JobView`: makes `robots/ID` |
//! | `GET /api/jobs` | list of [`JobView`] |
//! | `POST /api/jobs` [`JobRequest`] | `JobView` |
//! | `GET /api/jobs/{id}` | `JobView` with its lines; `?from=N` skips the first N |
//! | `GET /api/jobs/{id}/file` | what an export made, when it is done |
//! | `POST /api/jobs/{id}/cancel`, `/resume` | `JobView` |
//!
//! Every refusal is an [`ErrorBody`] with a fitting status.
//!
//! # Socket `/api/ws`
//!
//! Client → server: one JSON text message each, `{"id": N, "op": NAME, "args": {..}}`. NAME is a
//! clip operation (`keys.add`, ..., see [`robert_clip::Op`]) or one of [`StudioOp`]. `id` is chosen by the
//! client and comes back; a client has one request under way at a time, later ones wait in
//! its own socket.
//!
//! Server → client: [`Event`], `{"event": NAME, ...}`:
//!
//! * `hello` comes first: the client's number, then the whole [`State`]. Skip an `edit` whose
//!   `rev` is not above that of the document you have.
//! * `edit`: a change, in order of `rev`, sent to every client *including its author*
//!   (`by` = author's client number, `id` = its request). It is the acknowledgement: the change is
//!   on disk. Apply `patch` (see [`robert_clip::Delta`]) to your copy. The journal's
//!   restored or discarded edits have `by` 0.
//! * `reply`: answers a request that changed nothing or is not an edit; `result` or `error`.
//! * `document`: replaces your copy (after open, new or close, or if you were so slow that edits
//!   were skipped; the requests that these would have acknowledged get a `reply`).
//! * `findings`: problems and timeline of a `rev`; follow every change, later once more with
//!   what simulation found.
//! * `rollout.frames`: frames `from..from+q.len()` of rollout `gen`. Throw away what you have
//!   from `from` on. Frames before `from` stay valid even when `gen` is new: they are the
//!   frames that an edit could not change. A slow client gets fewer, larger events.
//! * `rollout.state`: waiting, running, done, failed, off; `cached_to`, MAE, milliseconds a frame.
//! * `worker`: the simulation's state, for a banner.
//! * `job`: a job's new state (latest only).
//! * `select`, `joint`, `joint.cancelled`, `locked`, `pinned`, `path.point`: events in the viewport.
//!   In this order: a link was clicked, joints are being dragged, the drag was cancelled, the set of
//!   locked joints or of pinned sites has changed, a point of the drawn path was clicked.
//! * `notice`: a sentence for a banner.

mod body;
mod document;
mod error;
mod event;
mod hub;
mod job;
mod op;
mod policy;
mod refusal;
mod robot;
mod rollout;
mod state;
#[cfg(test)]
mod typescript;
mod workspace;

pub use body::{
    ClipQuery, ExampleQuery, ExportQuery, FilesQuery, HoverQuery, ImportBody, InsertQuery,
    LinesFrom, NewBody, OpsRequest, PathBody, Pose, PoseQuery, Poses, SaveBody, StillBodyQuery,
    StillQuery, ThumbnailQuery, UploadQuery,
};
pub use document::{DocumentView, Draft, Edited, Findings, History, Restored, Saved};
pub use error::Error;
pub use event::{Event, Outcome};
pub use hub::{Hub, Sent, text};
pub use job::{
    Beside, ExportFormat, ExportKind, ExportRequest, JobKind, JobPhase, JobRequest, JobView,
};
pub use op::{STUDIO_OPS, Selection, StudioOp, ViewShow};
pub use policy::{PolicyCard, policies};
pub use refusal::{Code, ErrorBody, Place};
pub use robot::{
    AxisFacts, BodyFacts, DrawAnswer, DrawRequest, DrawnKey, Geometry, Hovered, IkAnswer,
    IkRequest, MeanError, MeshFacts, Pin, Plane, PoseFacts, RobotCard, RobotFacts, SettleAnswer,
    SiteFacts,
};
pub use rollout::{
    Phase, RolloutSettings, RolloutState, RolloutView, TakeCard, TakeFrames, TakesView,
    WorkerPhase, WorkerState,
};
pub use state::State;
pub use workspace::{
    BegunCard, DataCard, FileCard, FileKind, GalleryItem, Listing, Peek, RecentFile, RunCard, Shelf,
};
