//! `/api/...`: thin handlers that turn requests into questions and answers into JSON.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;

use axum::body::Bytes;
use axum::extract::{FromRequest, FromRequestParts, Path as UrlPath, State};
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::document::{Document, Edit};
use super::error::Error;
use super::exchange::{Beside, ExportRequest, Scene, Second};
use super::jobs::{Extra, JobKind, JobRequest, JobView};
use super::pictures::Shown;
use super::protocol::{
    Code, DocumentView, Draft, Edited, ErrorBody, GalleryItem, IkRequest, OpsRequest, RecentFile,
    RobotCard, RolloutView, Saved, StudioOp,
};
use super::server::App;
use super::session::{Ask, Author};
use super::shelf::{self, Shelf};
use super::takes::{TakeFrames, TakesView};
use super::viser::Hovered;
use super::worker::{Geometry, IkAnswer, MeanError, Report, Request, RobotFacts, SettleAnswer};
use super::{exchange, export, gallery, pages, protocol};
use crate::clip::{self, Batch, Op};
use crate::{fsio, limits};

/// A refusal as a response.
#[derive(Debug)]
pub(super) struct Refused(ErrorBody);

impl From<Error> for Refused {
    fn from(e: Error) -> Refused {
        Refused(ErrorBody::from(&e))
    }
}

impl IntoResponse for Refused {
    fn into_response(self) -> Response {
        let status = StatusCode::from_u16(self.0.status());
        (status.unwrap_or(StatusCode::INTERNAL_SERVER_ERROR), axum::Json(self.0)).into_response()
    }
}

/// JSON bodies and answers, with our refusals.
#[derive(Debug)]
pub(super) struct Json<T>(pub T);

impl<T: Serialize> IntoResponse for Json<T> {
    fn into_response(self) -> Response {
        axum::Json(self.0).into_response()
    }
}

impl<T: DeserializeOwned, S: Send + Sync> FromRequest<S> for Json<T> {
    type Rejection = Response;

    async fn from_request(request: axum::extract::Request, state: &S) -> Result<Self, Response> {
        match axum::Json::<T>::from_request(request, state).await {
            Ok(axum::Json(body)) => Ok(Json(body)),
            Err(e) => {
                let body = ErrorBody::new(Code::Request, e.body_text());
                Err((e.status(), axum::Json(body)).into_response())
            }
        }
    }
}

/// Queries, with our refusals.
#[derive(Debug)]
pub(super) struct Query<T>(pub T);

impl<T: DeserializeOwned, S: Send + Sync> FromRequestParts<S> for Query<T> {
    type Rejection = Refused;

    async fn from_request_parts(head: &mut Parts, state: &S) -> Result<Self, Refused> {
        match axum::extract::Query::<T>::from_request_parts(head, state).await {
            Ok(axum::extract::Query(query)) => Ok(Query(query)),
            Err(e) => Err(Refused(ErrorBody::new(Code::Request, e.body_text()))),
        }
    }
}

pub(super) type Answer<T> = Result<Json<T>, Refused>;
pub(super) type Shared = State<Arc<App>>;

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

pub(super) async fn whole_body(
    request: axum::extract::Request,
    cap: usize,
) -> Result<Bytes, Refused> {
    axum::body::to_bytes(request.into_body(), cap).await.map_err(|_too_large| {
        Refused(ErrorBody::new(Code::Full, format!("the body has more than {cap} bytes")))
    })
}

fn text_of(bytes: &[u8]) -> Result<String, Refused> {
    // The reader of files says where bytes stop being text; here the text is enough.
    String::from_utf8(bytes.to_vec()).map_err(|e| {
        let at = e.utf8_error().valid_up_to();
        Refused(ErrorBody::new(Code::Invalid, format!("byte {at} is not UTF-8 text")))
    })
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
    let found = tokio::task::spawn_blocking(move || Document::drafts(&dir)).await;
    Ok(Json(found.map_err(|_panicked| Error::request("the journals were not read"))?))
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
    let gone = tokio::task::spawn_blocking(move || Document::drop_draft(&dir, number)).await;
    gone.map_err(|_panicked| Error::request("the journal was not removed"))??;
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

fn download(name: &str, media_type: &'static str, bytes: Vec<u8>) -> Response {
    let mut headers = HeaderMap::new();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(media_type));
    let plain: String = name.chars().filter(|c| !matches!(c, '"' | '\\') && c.is_ascii()).collect();
    if let Ok(value) = format!("attachment; filename=\"{plain}\"").parse() {
        headers.insert(header::CONTENT_DISPOSITION, value);
    }
    (headers, bytes).into_response()
}

/// Query of `GET /api/still.jpg`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StillQuery {
    #[serde(default)]
    frame: usize,
    #[serde(default = "still_width")]
    w: u32,
    #[serde(default = "still_height")]
    h: u32,
    #[serde(default)]
    draft: bool,
    #[serde(default = "yes")]
    achieved: bool,
    #[serde(default = "yes")]
    command: bool,
    #[serde(default)]
    ghosts: bool,
    /// Numbers with commas between them: a pose in the place of what was achieved.
    pose: Option<String>,
    /// Not read: makes the address of a newer picture another one.
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

fn picture(jpeg: Bytes) -> Response {
    ([(header::CONTENT_TYPE, "image/jpeg")], jpeg).into_response()
}

/// `GET /api/still.jpg`.
pub(super) async fn still(
    State(app): Shared,
    Query(q): Query<StillQuery>,
) -> Result<Response, Refused> {
    let parse = |text: &String| text.split(',').map(|v| v.trim().parse::<f64>()).collect();
    let pose: Option<Result<Vec<f64>, _>> = q.pose.as_ref().map(parse);
    let pose = match pose {
        Some(Ok(q)) => {
            check_pose(&app, &q)?;
            Some(q.into_iter().map(|v| v as f32).collect())
        }
        Some(Err(e)) => return Err(Error::request(format!("pose: {e}")).into()),
        None => None,
    };
    let shown = Shown { achieved: q.achieved, command: q.command, ghosts: q.ghosts, pose };
    let size = (q.w, q.h);
    Ok(picture(app.pictures.still(&app.live, q.frame, size, q.draft, &shown).await?))
}

/// Query of `GET /api/still-body`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StillBodyQuery {
    frame: usize,
    w: u32,
    h: u32,
    /// From the left edge, 0 to 1.
    x: f32,
    /// From the top edge, 0 to 1.
    y: f32,
}

/// `GET /api/still-body`: the body at a point of a draft still, or null.
pub(super) async fn still_body(
    State(app): Shared,
    Query(q): Query<StillBodyQuery>,
) -> Answer<Option<String>> {
    let inside = 0.0..=1.0;
    if !inside.contains(&q.x) || !inside.contains(&q.y) {
        return Err(Error::request("x and y go from 0 to 1").into());
    }
    Ok(Json(app.pictures.body_at(&app.live, q.frame, (q.w, q.h), (q.x, q.y)).await?))
}

/// Query of `GET /api/hover`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct HoverQuery {
    tab: String,
    x: f64,
    y: f64,
}

/// `GET /api/hover`: what a page's pointer is over in its 3D view.
pub(super) async fn hover(
    State(app): Shared,
    Query(q): Query<HoverQuery>,
) -> Answer<Option<Hovered>> {
    let inside = 0.0..=1.0;
    if !inside.contains(&q.x) || !inside.contains(&q.y) {
        return Err(Error::request("x and y go from 0 to 1").into());
    }
    Ok(Json(app.viewport.under(&q.tab, [q.x, q.y]).await))
}

/// Query of `GET /api/pose.jpg`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PoseQuery {
    pose: String,
    /// Not read: see [`StillQuery`].
    #[serde(default, rename = "v")]
    _version: String,
}

/// `GET /api/pose.jpg`: a pose of the clip, or of its robot.
pub(super) async fn pose_picture(
    State(app): Shared,
    Query(query): Query<PoseQuery>,
) -> Result<Response, Refused> {
    let (clip, _) = app.session.ask(Ask::Content).await?;
    let facts = app.live.facts().ok_or(Error::NoDocument)?;
    let missing = || Error::NotFound { what: format!("pose {:?}", query.pose) };
    let rest = &facts.table.rest;
    let q = match clip.poses.get(&query.pose) {
        // A pose may leave joints open; they are shown at rest.
        Some(values) => facts
            .table
            .joints
            .iter()
            .zip(rest)
            .map(|(j, rest)| {
                let at = clip.robot.joints.iter().position(|n| *n == j.name);
                at.and_then(|i| values.get(i).copied().flatten()).unwrap_or(*rest)
            })
            .collect(),
        None => facts.poses.iter().find(|p| p.name == query.pose).ok_or_else(missing)?.q.clone(),
    };
    Ok(picture(app.pictures.pose(facts.source.clone(), q).await?))
}

/// Query of `GET /api/gallery-picture.jpg` and `/api/gallery-error`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ExampleQuery {
    id: String,
}

/// `GET /api/gallery-picture.jpg`.
pub(super) async fn example_picture(
    State(app): Shared,
    Query(query): Query<ExampleQuery>,
) -> Result<Response, Refused> {
    Ok(picture(app.pictures.example(&query.id).await?))
}

/// `GET /api/gallery-error`.
pub(super) async fn example_error(
    State(app): Shared,
    Query(query): Query<ExampleQuery>,
) -> Answer<Option<MeanError>> {
    Ok(Json(app.pictures.example_error(&query.id).await?))
}

/// `POST /api/exports`.
pub(super) async fn start_export(
    State(app): Shared,
    Json(body): Json<ExportRequest>,
) -> Answer<JobView> {
    let (clip, _) = app.session.ask(Ask::Content).await?;
    let facts = app.live.facts().ok_or(Error::NoDocument)?;
    let settings = app.live.settings();
    let beside = match &body.compare {
        Some(Beside::Take(id)) => {
            let missing = || Error::NotFound { what: format!("take {id}") };
            let (clip, settings) = app.live.take_source(*id).ok_or_else(missing)?;
            Some(Second::Take(clip, settings))
        }
        Some(Beside::File(path)) => Some(Second::File(app.path(path)?)),
        None => None,
    };
    let scene = Scene { clip: &clip, robot: &facts.source, settings: &settings, beside };
    let (request, extra) = exchange::job(&body, &scene, &app.folder)?;
    Ok(Json(app.jobs.start_with(request, extra, &app.folder)?))
}

/// `GET /api/jobs/{id}/file`.
pub(super) async fn job_file(
    State(app): Shared,
    UrlPath(id): UrlPath<u64>,
) -> Result<Response, Refused> {
    let path = app.jobs.file(id)?;
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let read = tokio::task::spawn_blocking(move || fsio::read_capped(&path, limits::UPLOAD_BYTES));
    let bytes = read.await.map_err(|_panicked| Error::request("the file was not read"))?;
    let bytes = bytes.map_err(Error::from)?;
    Ok(download(&name, export::media_type(&name), bytes))
}

/// `GET /api/shelf`.
pub(super) async fn shelf(State(app): Shared) -> Result<Json<Shelf>, Refused> {
    let folder = app.folder.clone();
    let found = tokio::task::spawn_blocking(move || shelf::list(&folder)).await;
    Ok(Json(found.map_err(|_panicked| Error::request("the folder was not read"))?))
}

/// `GET /api/curves?path=RUN`.
pub(super) async fn curves(
    State(app): Shared,
    Query(body): Query<PathBody>,
) -> Answer<Vec<serde_json::Value>> {
    let dir = app.path(&body.path)?;
    let found = tokio::task::spawn_blocking(move || shelf::curves(&dir)).await;
    Ok(Json(found.map_err(|_panicked| Error::request("the run was not read"))?))
}

/// Query of `PUT /api/upload`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct UploadQuery {
    path: String,
    #[serde(default)]
    first: bool,
}

/// `PUT /api/upload`: one file of a robot's folder; the first one empties it.
pub(super) async fn upload(
    State(app): Shared,
    Query(query): Query<UploadQuery>,
    request: axum::extract::Request,
) -> Result<StatusCode, Refused> {
    let bytes = whole_body(request, limits::PROJECT_BYTES as usize).await?;
    let uploads = Arc::clone(&app.uploads);
    let put = move || uploads.put(&query.path, query.first, &bytes);
    let done = tokio::task::spawn_blocking(put).await;
    done.map_err(|_panicked| Error::request("the file was not kept"))??;
    Ok(StatusCode::NO_CONTENT)
}

/// Body of `POST /api/import`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ImportBody {
    /// The URDF or MJCF: among the uploaded files, or on this machine.
    file: String,
    #[serde(default)]
    uploaded: bool,
    id: String,
    #[serde(default)]
    fixed_base: bool,
}

/// `POST /api/import`: a job that makes a robot in the studio's folder.
pub(super) async fn import(State(app): Shared, Json(body): Json<ImportBody>) -> Answer<JobView> {
    if !crate::robot::valid_id(&body.id) {
        return Err(Error::request(format!(
            "{:?} cannot be a robot's name: lower-case letters, digits, '_' and '-'",
            body.id
        ))
        .into());
    }
    if shelf::is_builtin(&body.id) {
        return Err(Error::request(format!("{} is a robot of the program", body.id)).into());
    }
    let file = if body.uploaded {
        exchange::upload_path(app.uploads.folder(), &body.file)?
    } else {
        app.path(&body.file)?
    };
    let out = app.folder.join("robots").join(&body.id);
    let mut args: Vec<String> = [file.as_path(), Path::new("--out"), &out, Path::new("--id")]
        .iter()
        .map(|p| p.display().to_string())
        .collect();
    args.push(body.id.clone());
    if body.uploaded {
        args.extend(["--root".to_owned(), app.uploads.folder().display().to_string()]);
    }
    if body.fixed_base {
        args.push("--fixed-base".into());
    }
    let extra = Extra { title: format!("Import {}", body.id), ..Extra::default() };
    let request = JobRequest { kind: JobKind::Import, args };
    Ok(Json(app.jobs.start_with(request, extra, &app.folder)?))
}

/// `GET /api/jobs`.
pub(super) async fn jobs(State(app): Shared) -> Json<Vec<JobView>> {
    Json(app.jobs.list())
}

/// `POST /api/jobs`.
pub(super) async fn start_job(State(app): Shared, Json(body): Json<JobRequest>) -> Answer<JobView> {
    Ok(Json(app.jobs.start(body, &app.folder)?))
}

/// Query of `GET /api/jobs/{id}`.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct LinesFrom {
    from: usize,
}

/// `GET /api/jobs/{id}`.
pub(super) async fn job(
    State(app): Shared,
    UrlPath(id): UrlPath<u64>,
    Query(query): Query<LinesFrom>,
) -> Answer<JobView> {
    Ok(Json(app.jobs.view(id, query.from)?))
}

/// `POST /api/jobs/{id}/cancel`.
pub(super) async fn cancel_job(State(app): Shared, UrlPath(id): UrlPath<u64>) -> Answer<JobView> {
    Ok(Json(app.jobs.cancel(id)?))
}

/// `POST /api/jobs/{id}/resume`.
pub(super) async fn resume_job(State(app): Shared, UrlPath(id): UrlPath<u64>) -> Answer<JobView> {
    Ok(Json(app.jobs.resume(id, &app.folder)?))
}

/// A request on the socket that is no edit; what it is answered with.
///
/// # Errors
/// Whatever it says.
pub(super) async fn studio_op(app: &App, op: StudioOp) -> Result<serde_json::Value, Error> {
    let nothing = serde_json::Value::Null;
    match op {
        StudioOp::Undo {} | StudioOp::Redo {} | StudioOp::HistoryGoto { .. } => {}
        StudioOp::Preview { op } => {
            let demand = app.session.ask(|r| Ask::Preview(op, r)).await?;
            return Ok(serde_json::json!({"demand": demand}));
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
    Ok(nothing)
}
