//! Clips that come as files: from the page's picker or a drop, or from a folder.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use axum::extract::State;
use serde::Deserialize;

use super::api::{Answer, Json, Query, Shared, apart, whole_body};
use super::error::Error;
use super::folders::{self, Kind, Listing};
use super::protocol::DocumentView;
use super::server::App;
use super::session::{Ask, reference};
use super::worker::{Report, Request};
use crate::clip::formats::{from_command_json, from_csv, from_mjcf, from_ros};
use crate::clip::{self, Clip, ClipError, Fill, RobotRef};
use crate::{fsio, limits};

/// Query of `GET /api/files`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct FilesQuery {
    /// A folder that the user typed; the studio's without it.
    #[serde(default)]
    root: String,
    /// Below it.
    #[serde(default)]
    dir: String,
}

/// `GET /api/files`: what could be opened in a folder.
pub(super) async fn files(State(app): Shared, Query(query): Query<FilesQuery>) -> Answer<Listing> {
    let root = if query.root.is_empty() { app.folder.clone() } else { app.path(&query.root)? };
    let list = move || folders::list(&root, &query.dir);
    Ok(Json(apart("the folder was not read", list).await??))
}

/// Query of `POST /api/clips`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct ClipQuery {
    /// The file that is in the body; its ending tells the format.
    #[serde(default)]
    name: String,
    /// A file of this machine instead of a body.
    #[serde(default)]
    path: String,
    /// Robot, for formats that do not name theirs; that of the open document without it.
    #[serde(default)]
    robot: String,
}

/// `POST /api/clips`: starts a clip from a file of any format that can be read.
pub(super) async fn clips(
    State(app): Shared,
    Query(query): Query<ClipQuery>,
    request: axum::extract::Request,
) -> Answer<DocumentView> {
    let (named, bytes) = if query.path.is_empty() {
        let bytes = whole_body(request, limits::CLIP_BYTES as usize).await?;
        // Only its last part: it is a name, not a place.
        let name = query.name.rsplit(['/', '\\']).next().unwrap_or_default();
        (PathBuf::from(name), bytes.to_vec())
    } else {
        let path = app.path(&query.path)?;
        let from = path.clone();
        let read = move || fsio::read_capped(&from, limits::CLIP_BYTES);
        let bytes = apart("the file was not read", read).await?;
        (path, bytes.map_err(Error::from)?)
    };
    let name = named.file_name().and_then(|n| n.to_str()).unwrap_or_default().to_owned();
    let kind = Kind::of(&name).ok_or_else(|| {
        Error::request(format!("{name:?} ends in none of .clip.json .csv .xml .yaml .json"))
    })?;
    let robot = match kind {
        Kind::Clip => None,
        _ => Some(robot(&app, query.robot).await?),
    };
    let make = move || {
        let mut clip = read(kind, bytes, robot.as_ref()).map_err(|e| e.in_file(&named))?;
        if clip.name.is_empty() {
            clip.name = stem(&named);
        }
        Ok::<Clip, ClipError>(clip)
    };
    let made = apart("the file could not be read", make).await?;
    let clip = made.map_err(Error::from)?;
    Ok(Json(app.session.ask(|r| Ask::New(Box::new(clip), r)).await?))
}

/// The robot that was named, else the open document's.
async fn robot(app: &Arc<App>, named: String) -> Result<RobotRef, Error> {
    if named.is_empty() {
        let facts = app.live.facts().ok_or_else(|| {
            Error::request("this file does not say which robot it is for: choose one")
        })?;
        return Ok(reference(&facts.table));
    }
    let source = app.robot_source(named);
    app.session.ask(|r| Ask::Know(source.clone(), r)).await?;
    match app.worker.ask(Request::Facts { robot: source }).await? {
        Report::Facts(facts) => Ok(reference(&facts.table)),
        _ => Err(Error::Worker { reason: "it gave an answer that fits no question".into() }),
    }
}

/// A clip of any format. Between imported keys there is no goal, as with `robert clip convert`.
///
/// # Errors
/// [`ClipError`] with line and column.
fn read(kind: Kind, bytes: Vec<u8>, robot: Option<&RobotRef>) -> Result<Clip, ClipError> {
    let nobody = RobotRef::default();
    let known = robot.unwrap_or(&nobody);
    let text = |bytes: Vec<u8>| {
        String::from_utf8(bytes).map_err(|e| {
            let good = e.as_bytes().get(..e.utf8_error().valid_up_to()).unwrap_or_default();
            let line = good.split(|b| *b == b'\n').count();
            let col = good.iter().rev().take_while(|b| **b != b'\n').count() + 1;
            ClipError::at("this is not UTF-8 text", line, col)
        })
    };
    match kind {
        Kind::Csv => from_csv(&bytes, robot, Fill::Mask),
        Kind::Mjcf => from_mjcf(&text(bytes)?, known, Fill::Mask),
        Kind::Ros => from_ros(&text(bytes)?, robot, Fill::Mask),
        Kind::Clip if is_command(&bytes) => from_command_json(&text(bytes)?, None, Fill::Mask),
        Kind::Clip => clip::parse_bytes(bytes).map(|p| p.clip),
    }
}

/// Whether this is a dense command (`robert-command/1`).
fn is_command(bytes: &[u8]) -> bool {
    #[derive(Deserialize)]
    struct Heading {
        format: String,
    }
    let found = serde_json::from_slice::<Heading>(bytes);
    found.is_ok_and(|h| h.format.starts_with("robert-command/"))
}

/// The name without its ending.
fn stem(path: &Path) -> String {
    let name = path.file_name().and_then(|n| n.to_str()).unwrap_or_default();
    name.split('.').next().unwrap_or_default().chars().take(80).collect()
}
