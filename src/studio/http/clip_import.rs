//! Clips from files: uploaded by the page's picker or a drop, or read from a folder.

use std::path::PathBuf;
use std::sync::Arc;

use axum::extract::State;

use super::answer::{Answer, Json, Query, Refused, Shared, apart, whole_body};
use crate::document::Edit;
use crate::protocol::{
    ClipQuery, DocumentView, Edited, Error, FileKind, FilesQuery, InsertQuery, Listing,
};
use crate::session::{Author, Write, reference};
use crate::simulation::worker::DescribeRobot;
use crate::state::App;
use crate::workspace::{clip_import, folders};
use robert_base::fsio;
use robert_base::limits;
use robert_clip::{BlocksInsert, Clip, Op, Part, RobotRef};

/// `GET /api/files`: the clips that can be opened in a folder.
pub(crate) async fn files(State(app): Shared, Query(query): Query<FilesQuery>) -> Answer<Listing> {
    let root = if query.root.is_empty() {
        app.workspace.folder.clone()
    } else {
        app.workspace.path(&query.root)?
    };
    let list = move || folders::list(&root, &query.dir);
    Ok(Json(apart("the folder was not read", list).await??))
}

/// A file that is read: its name, and its robot if it does not name one.
struct Incoming {
    name: String,
    path: String,
    robot: String,
    rate: f64,
}

/// `POST /api/clips`: starts a clip from a file of any format that can be read.
pub(crate) async fn clips(
    State(app): Shared,
    Query(query): Query<ClipQuery>,
    request: axum::extract::Request,
) -> Answer<DocumentView> {
    let ClipQuery { name, path, robot, rate } = query;
    let clip = incoming(&app, Incoming { name, path, robot, rate }, request).await?;
    Ok(Json(app.session.write(|r| Write::New(Box::new(clip), r)).await?))
}

/// `POST /api/insert`: such a file becomes a block of the open clip.
pub(crate) async fn insert(
    State(app): Shared,
    Query(query): Query<InsertQuery>,
    request: axum::extract::Request,
) -> Answer<Edited> {
    let InsertQuery { name, path, rate, at, blend } = query;
    let file = Incoming { name, path, robot: String::new(), rate };
    let clip = incoming(&app, file, request).await?;
    let part = Part::of(&clip);
    let op = Op::BlocksInsert(BlocksInsert { at, name: clip.name, part, blend });
    let edit = Edit::Op(Box::new(op));
    Ok(Json(app.session.write(|r| Write::Edit(Author::default(), edit, r)).await?))
}

/// The clip in a file, with a name.
async fn incoming(
    app: &Arc<App>,
    file: Incoming,
    request: axum::extract::Request,
) -> Result<Clip, Refused> {
    let (named, bytes) = if file.path.is_empty() {
        let bytes = whole_body(request, limits::CLIP_BYTES as usize).await?;
        // Only its last part: it is a name, not a place.
        let name = file.name.rsplit(['/', '\\']).next().unwrap_or_default();
        (PathBuf::from(name), bytes.to_vec())
    } else {
        let path = app.workspace.path(&file.path)?;
        let from = path.clone();
        let read = move || fsio::read_capped(&from, limits::CLIP_BYTES);
        let bytes = apart("the file was not read", read).await?;
        (path, bytes.map_err(Error::from)?)
    };
    let name = named.file_name().and_then(|n| n.to_str()).unwrap_or_default().to_owned();
    let kind = FileKind::of(&name).ok_or_else(|| {
        let known = ".clip.json .csv .lafan.csv .xml .yaml .json .mcap";
        Error::request(format!("{name:?} ends in none of {known}"))
    })?;
    let robot = match kind {
        FileKind::Clip | FileKind::Take => None,
        _ => Some(robot(app, file.robot).await?),
    };
    let make = move || {
        let mut clip = clip_import::read(kind, bytes, robot.as_ref(), file.rate, &named)?;
        if clip.name.is_empty() {
            clip.name = clip_import::stem(&named);
        }
        Ok::<Clip, Error>(clip)
    };
    Ok(apart("the file could not be read", make).await??)
}

/// The robot that was named, else the open document's.
async fn robot(app: &Arc<App>, named: String) -> Result<RobotRef, Error> {
    if named.is_empty() {
        let facts = app.simulation.robot().ok_or_else(|| {
            Error::request("this file does not say which robot it is for: choose one")
        })?;
        return Ok(reference(&facts.table));
    }
    let source = app.robot_source(named);
    app.session.write(|r| Write::Know(source.clone(), r)).await?;
    let facts = app.simulation.ask(DescribeRobot { robot: source }).await?;
    Ok(reference(&facts.table))
}
