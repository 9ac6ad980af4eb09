//! Clips from files: uploaded by the page's picker or a drop, or read from a folder.

use std::path::PathBuf;
use std::sync::Arc;

use axum::extract::State;

use super::answer::{Answer, Json, Query, Shared, apart, whole_body};
use crate::protocol::{ClipQuery, DocumentView, Error, FileKind, FilesQuery, Listing};
use crate::session::{SessionCommand, reference};
use crate::simulation::worker::DescribeRobot;
use crate::state::App;
use crate::workspace::{clip_import, folders};
use robert_base::fsio;
use robert_base::limits;
use robert_clip::{Clip, ClipError, RobotRef};

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

/// `POST /api/clips`: starts a clip from a file of any format that can be read.
pub(crate) async fn clips(
    State(app): Shared,
    Query(query): Query<ClipQuery>,
    request: axum::extract::Request,
) -> Answer<DocumentView> {
    let (named, bytes) = if query.path.is_empty() {
        let bytes = whole_body(request, limits::CLIP_BYTES as usize).await?;
        // Only the last part of the path is used, since it is a name, not a place.
        let name = query.name.rsplit(['/', '\\']).next().unwrap_or_default();
        (PathBuf::from(name), bytes.to_vec())
    } else {
        let path = app.workspace.path(&query.path)?;
        let from = path.clone();
        let read = move || fsio::read_capped(&from, limits::CLIP_BYTES);
        let bytes = apart("the file was not read", read).await?;
        (path, bytes.map_err(Error::from)?)
    };
    let name = named.file_name().and_then(|n| n.to_str()).unwrap_or_default().to_owned();
    let kind = FileKind::of(&name).ok_or_else(|| {
        Error::request(format!("{name:?} ends in none of .clip.json .csv .xml .yaml .json"))
    })?;
    let robot = match kind {
        FileKind::Clip => None,
        _ => Some(robot(&app, query.robot).await?),
    };
    let make = move || {
        let mut clip =
            clip_import::read(kind, bytes, robot.as_ref()).map_err(|e| e.in_file(&named))?;
        if clip.name.is_empty() {
            clip.name = clip_import::stem(&named);
        }
        Ok::<Clip, ClipError>(clip)
    };
    let made = apart("the file could not be read", make).await?;
    let clip = made.map_err(Error::from)?;
    Ok(Json(app.session.ask(|r| SessionCommand::New(Box::new(clip), r)).await?))
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
    app.session.ask(|r| SessionCommand::Know(source.clone(), r)).await?;
    let facts = app.simulation.ask(DescribeRobot { robot: source }).await?;
    Ok(reference(&facts.table))
}
