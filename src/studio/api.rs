//! `/api/...`: thin handlers that turn requests into questions and answers into JSON.

mod answer;
mod look;
mod work;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;

use axum::extract::{Path as UrlPath, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;

pub(super) use answer::{Answer, Json, Query, Refused, Shared, apart, whole_body};
use answer::{download, text_of};
pub(super) use look::*;
pub(super) use work::*;

use super::document::{Document, Edit};
use super::error::Error;
use super::protocol::{
    Code, DocumentView, Draft, Edited, ErrorBody, GalleryItem, IkRequest, OpsRequest, Outcome,
    RecentFile, RobotCard, RolloutView, Saved, StudioOp,
};
use super::server::App;
use super::session::{Ask, Author};
use super::shelf;
use super::takes::{TakeFrames, TakesView};
use super::worker::{Geometry, IkAnswer, Report, Request, RobotFacts, SettleAnswer};
use super::{export, gallery, pages, protocol};
use crate::clip::{self, Batch, Op};
use crate::limits;

/// No icon is no error.
pub(super) async fn favicon() -> StatusCode {
    StatusCode::NO_CONTENT
}

/// Nothing here.
pub(super) async fn not_found() -> Refused {
    Refused::from(Error::NotFound { what: "such address".into() })
}

/// Not this way.
pub(super) async fn bad_method() -> Response {
    let body = ErrorBody::new(Code::Request, "this address does not take that method");
    (StatusCode::METHOD_NOT_ALLOWED, axum::Json(body)).into_response()
}

/// Token for cookie. The guard has seen the token already.
pub(super) async fn session(State(app): Shared) -> Response {
    (StatusCode::NO_CONTENT, [(header::SET_COOKIE, app.guard.set_cookie())]).into_response()
}

/// The open document, if any.
pub(super) async fn current_view(app: &App) -> Option<Box<DocumentView>> {
    app.session.ask(Ask::View).await.ok().flatten()
}

/// Everything that a fresh page needs.
pub(super) async fn current_state(app: &App) -> protocol::State {
    protocol::State {
        version: env!("CARGO_PKG_VERSION"),
        document: current_view(app).await.map(|d| *d),
        rollout: app.live.settings(),
        policies: app.live.facts().map(|f| protocol::policies(&f.offers)).unwrap_or_default(),
        worker: app.live.worker_state(),
        viser: pages::has_viser(),
        clients: app.clients.load(Ordering::SeqCst),
        folder: app.folder.display().to_string(),
        locked: app.live.locked(),
        takes: app.live.takes(),
    }
}

/// `GET /api/state`.
pub(super) async fn state(State(app): Shared) -> Json<protocol::State> {
    Json(current_state(&app).await)
}

/// `GET /api/clip`.
pub(super) async fn clip(State(app): Shared) -> Result<Response, Refused> {
    let text = app.session.ask(Ask::Text).await?;
    Ok(([(header::CONTENT_TYPE, "application/json")], text).into_response())
}

/// `PUT /api/clip`.
pub(super) async fn put_clip(
    State(app): Shared,
    request: axum::extract::Request,
) -> Answer<Edited> {
    let bytes = whole_body(request, limits::CLIP_BYTES as usize).await?;
    let text = text_of(&bytes)?;
    let edited = app.session.ask(|r| Ask::Put(Author::default(), text, r)).await?;
    Ok(Json(edited))
}

/// `POST /api/ops`.
pub(super) async fn ops(State(app): Shared, Json(body): Json<OpsRequest>) -> Answer<Edited> {
    let mut ops = body.ops;
    let op = if ops.len() == 1 && body.label.is_empty() {
        ops.remove(0)
    } else {
        let label = if body.label.is_empty() {
            ops.first().map(Op::label).unwrap_or_default()
        } else {
            body.label
        };
        Op::Batch(Batch { label, ops })
    };
    edit(&app, Edit::Op(Box::new(op))).await
}

async fn edit(app: &App, edit: Edit) -> Answer<Edited> {
    Ok(Json(app.session.ask(|r| Ask::Edit(Author::default(), edit, r)).await?))
}

/// `POST /api/undo`.
pub(super) async fn undo(State(app): Shared) -> Answer<Edited> {
    edit(&app, Edit::Undo).await
}

/// `POST /api/redo`.
pub(super) async fn redo(State(app): Shared) -> Answer<Edited> {
    edit(&app, Edit::Redo).await
}

/// `POST /api/discard`.
pub(super) async fn discard(State(app): Shared) -> Answer<Edited> {
    Ok(Json(app.session.ask(|r| Ask::Discard(Author::default(), r)).await?))
}

/// Body with a path.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct PathBody {
    path: String,
}

impl App {
    /// A path as the user typed it.
    pub(super) fn path(&self, typed: &str) -> Result<PathBuf, Error> {
        if typed.is_empty() || typed.contains('\0') {
            return Err(Error::request("this is no path"));
        }
        Ok(self.folder.join(Path::new(typed)))
    }
}

/// `POST /api/open`.
pub(super) async fn open(State(app): Shared, Json(body): Json<PathBody>) -> Answer<DocumentView> {
    let path = app.path(&body.path)?;
    Ok(Json(app.session.ask(|r| Ask::Open(path, r)).await?))
}

/// Body of `POST /api/new`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct NewBody {
    #[serde(default)]
    robot: Option<String>,
    #[serde(default)]
    length: Option<u32>,
    #[serde(default)]
    name: String,
    #[serde(default)]
    text: Option<String>,
}

/// Frames of a new clip that says nothing else: 5 s.
const NEW_LENGTH: u32 = 100;

/// `POST /api/new`.
pub(super) async fn new(State(app): Shared, Json(body): Json<NewBody>) -> Answer<DocumentView> {
    let view = match (body.robot, body.text) {
        (_, Some(text)) => {
            let clip = clip::parse(text).map_err(Error::from)?.clip;
            app.session.ask(|r| Ask::New(Box::new(clip), r)).await?
        }
        (Some(robot), None) => {
            let (length, name) = (body.length.unwrap_or(NEW_LENGTH), body.name);
            app.session.ask(|reply| Ask::Blank { robot, length, name, reply }).await?
        }
        (None, None) => return Err(Error::request("say `robot` or `text`").into()),
    };
    Ok(Json(view))
}

/// Body of `POST /api/save`.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct SaveBody {
    path: Option<String>,
    /// Whether another file of that name is to be replaced.
    replace: bool,
}

/// `POST /api/save`.
pub(super) async fn save(State(app): Shared, Json(body): Json<SaveBody>) -> Answer<Saved> {
    let path = body.path.map(|p| app.path(&p)).transpose()?;
    Ok(Json(app.session.ask(|reply| Ask::Save { path, replace: body.replace, reply }).await?))
}

/// `POST /api/close`.
pub(super) async fn close(State(app): Shared) -> Result<StatusCode, Refused> {
    app.session.ask(Ask::Close).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// `GET /api/gallery`.
pub(super) async fn gallery() -> Json<Vec<GalleryItem>> {
    Json(gallery::list())
}

/// `POST /api/gallery/{id}`.
pub(super) async fn open_example(
    State(app): Shared,
    UrlPath(id): UrlPath<String>,
) -> Answer<DocumentView> {
    let clip = gallery::open(&id)?;
    Ok(Json(app.session.ask(|r| Ask::New(Box::new(clip), r)).await?))
}

/// `GET /api/recent`.
pub(super) async fn recent(State(app): Shared) -> Json<Vec<RecentFile>> {
    Json(app.recent.list())
}

/// `GET /api/drafts`.
pub(super) async fn drafts(State(app): Shared) -> Answer<Vec<Draft>> {
    let dir = app.state_dir.clone();
    Ok(Json(apart("the journals were not read", move || Document::drafts(&dir)).await?))
}

/// `POST /api/drafts/{number}`.
pub(super) async fn open_draft(
    State(app): Shared,
    UrlPath(number): UrlPath<u32>,
) -> Answer<DocumentView> {
    Ok(Json(app.session.ask(|r| Ask::Draft(number, r)).await?))
}

/// `POST /api/drafts/{number}/discard`.
pub(super) async fn discard_draft(
    State(app): Shared,
    UrlPath(number): UrlPath<u32>,
) -> Result<StatusCode, Refused> {
    let dir = app.state_dir.clone();
    let remove = move || Document::drop_draft(&dir, number);
    apart("the journal was not removed", remove).await??;
    Ok(StatusCode::NO_CONTENT)
}

/// `GET /api/robots`.
pub(super) async fn robots(State(app): Shared) -> Json<Vec<RobotCard>> {
    Json(shelf::robots(&app.folder, &app.state_dir))
}

impl App {
    /// Where a robot is loaded from: as the open document has it, else the program or a
    /// folder beside us; else as it was said.
    pub(super) fn robot_source(&self, id: String) -> String {
        match self.live.facts() {
            Some(facts) if facts.id == id => facts.source.clone(),
            _ => shelf::source(&id, &self.folder, &self.state_dir).unwrap_or(id),
        }
    }
}

/// `GET /api/robot/{id}`.
pub(super) async fn robot(
    State(app): Shared,
    UrlPath(robot): UrlPath<String>,
) -> Answer<RobotFacts> {
    let robot = app.robot_source(robot);
    match app.worker.ask(Request::Facts { robot }).await? {
        Report::Facts(facts) => Ok(Json(*facts)),
        _ => Err(odd()),
    }
}

/// `GET /api/robot/{id}/geometry`.
pub(super) async fn geometry(
    State(app): Shared,
    UrlPath(robot): UrlPath<String>,
) -> Answer<Geometry> {
    let robot = app.robot_source(robot);
    match app.worker.ask(Request::Geometry { robot }).await? {
        Report::Geometry(geometry) => Ok(Json(*geometry)),
        _ => Err(odd()),
    }
}

fn odd() -> Refused {
    Error::Worker { reason: "it gave an answer that fits no question".into() }.into()
}

/// Body of `POST /api/kinematics`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct Poses {
    q: Vec<Vec<f64>>,
}

/// A pose of the open robot: as many numbers as joints, and none beyond all reason.
fn check_pose(app: &App, q: &[f64]) -> Result<Arc<RobotFacts>, Error> {
    let facts = app.live.facts().ok_or(Error::NoDocument)?;
    let joints = facts.table.joints.len();
    if q.len() != joints {
        let id = &facts.id;
        let got = q.len();
        return Err(Error::request(format!("{got} values for the {joints} joints of {id}")));
    }
    check_numbers(q.iter())?;
    Ok(facts)
}

fn check_numbers<'a>(mut values: impl Iterator<Item = &'a f64>) -> Result<(), Error> {
    let sane = |v: &f64| v.is_finite() && v.abs() <= limits::CLIP_VALUE_MAX;
    match values.find(|v| !sane(v)) {
        Some(v) => Err(Error::request(format!("{v:e} is no position of any joint or point"))),
        None => Ok(()),
    }
}

/// Poses in one question.
const POSES: usize = 1_000;

/// `POST /api/kinematics`.
pub(super) async fn kinematics(
    State(app): Shared,
    Json(body): Json<Poses>,
) -> Answer<Vec<Vec<f32>>> {
    if body.q.len() > POSES {
        return Err(Error::Full { what: "poses in one question", cap: POSES }.into());
    }
    for q in &body.q {
        check_pose(&app, q)?;
    }
    match app.worker.ask(Request::Kinematics { poses: body.q }).await? {
        Report::Bodies(bodies) => Ok(Json(bodies)),
        _ => Err(odd()),
    }
}

/// `POST /api/ik`.
pub(super) async fn ik(State(app): Shared, Json(body): Json<IkRequest>) -> Answer<IkAnswer> {
    check_pose(&app, &body.q)?;
    let offset = body.body.iter().flat_map(|(_, offset)| offset);
    check_numbers(body.pos.iter().chain(body.quat.iter().flatten()).chain(offset))?;
    match app.worker.ask(Request::Ik(body)).await? {
        Report::Ik(answer) => Ok(Json(answer)),
        _ => Err(odd()),
    }
}

/// Body of `POST /api/settle`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct Pose {
    q: Vec<f64>,
}

/// `POST /api/settle`.
pub(super) async fn settle(State(app): Shared, Json(body): Json<Pose>) -> Answer<SettleAnswer> {
    let facts = check_pose(&app, &body.q)?;
    let request = Request::Settle { robot: facts.source.clone(), q: body.q };
    match app.worker.ask(request).await? {
        Report::Settled(answer) => Ok(Json(answer)),
        _ => Err(odd()),
    }
}

/// `GET /api/rollout`.
pub(super) async fn rollout(State(app): Shared) -> Json<RolloutView> {
    Json(app.live.view())
}

/// `GET /api/takes`.
pub(super) async fn takes(State(app): Shared) -> Json<TakesView> {
    Json(app.live.takes())
}

/// `GET /api/takes/{id}`: its motion.
pub(super) async fn take(State(app): Shared, UrlPath(id): UrlPath<u64>) -> Answer<TakeFrames> {
    let missing = || Error::NotFound { what: format!("take {id}") };
    Ok(Json(app.live.take_frames(id).ok_or_else(missing)?))
}

/// Query of `GET /api/export`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct ExportQuery {
    format: String,
}

/// `GET /api/export`.
pub(super) async fn export(
    State(app): Shared,
    Query(query): Query<ExportQuery>,
) -> Result<Response, Refused> {
    let (clip, command) = app.session.ask(Ask::Content).await?;
    let file = export::file(&query.format, &clip, &command, &app.live)?;
    Ok(download(&file.name, file.media_type, file.bytes))
}

/// A request on the socket that is no edit; what it is answered with.
///
/// # Errors
/// Whatever it says.
pub(super) async fn studio_op(app: &App, op: StudioOp) -> Result<Outcome, Error> {
    match op {
        StudioOp::Undo {} | StudioOp::Redo {} | StudioOp::HistoryGoto { .. } => {}
        StudioOp::Preview { op } => {
            let demand = app.session.ask(|r| Ask::Preview(op, r)).await?;
            return Ok(Outcome::Previewed { demand });
        }
        StudioOp::PreviewEnd {} => app.session.ask(Ask::PreviewEnd).await?,
        StudioOp::RolloutSet(settings) => app.session.ask(|r| Ask::Settings(settings, r)).await?,
        StudioOp::RolloutRun {} => app.session.ask(Ask::Run).await?,
        StudioOp::RolloutCancel {} => app.live.cancel(&app.worker),
        StudioOp::WorkerRestart {} => app.worker.restart(),
        StudioOp::TakePin { id, pinned } => app.live.change_takes(|t| t.pin(id, pinned))?,
        StudioOp::TakeName { id, name } => app.live.change_takes(|t| t.name(id, &name))?,
        StudioOp::TakeCompare { ids } => app.live.change_takes(|t| t.compare(&ids))?,
        StudioOp::TakeRemove { id } => app.live.change_takes(|t| t.remove(id))?,
        view => super::viser::view_op(app, view)?,
    }
    Ok(Outcome::Done)
}
