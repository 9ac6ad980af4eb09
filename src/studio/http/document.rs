//! The open document.

use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};

use super::answer::{Answer, Json, Query, Refused, Shared, apart, download, text_of, whole_body};
use crate::document::Edit;
use crate::protocol::{
    DocumentView, Edited, Error, ExportQuery, NewBody, OpsRequest, PathBody, SaveBody, Saved,
};
use crate::session::{Author, Write};
use crate::state::App;
use crate::workspace::export;
use robert_base::fsio;
use robert_base::limits;
use robert_clip as clip;
use robert_clip::{Batch, Op};

/// `GET /api/clip`.
pub(crate) async fn clip(State(app): Shared) -> Result<Response, Refused> {
    let text = app.session.text().await?;
    Ok(([(header::CONTENT_TYPE, "application/json")], text).into_response())
}

/// `PUT /api/clip`.
pub(crate) async fn put_clip(
    State(app): Shared,
    request: axum::extract::Request,
) -> Answer<Edited> {
    let bytes = whole_body(request, limits::CLIP_BYTES as usize).await?;
    let text = text_of(&bytes)?;
    let edited = app.session.write(|r| Write::Put(Author::default(), text, r)).await?;
    Ok(Json(edited))
}

/// `POST /api/ops`.
pub(crate) async fn ops(State(app): Shared, Json(body): Json<OpsRequest>) -> Answer<Edited> {
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
    Ok(Json(app.session.write(|r| Write::Edit(Author::default(), edit, r)).await?))
}

/// `POST /api/undo`.
pub(crate) async fn undo(State(app): Shared) -> Answer<Edited> {
    edit(&app, Edit::Undo).await
}

/// `POST /api/redo`.
pub(crate) async fn redo(State(app): Shared) -> Answer<Edited> {
    edit(&app, Edit::Redo).await
}

/// `POST /api/discard`.
pub(crate) async fn discard(State(app): Shared) -> Answer<Edited> {
    Ok(Json(app.session.write(|r| Write::Discard(Author::default(), r)).await?))
}

/// `POST /api/reload`.
pub(crate) async fn reload(State(app): Shared) -> Answer<Edited> {
    Ok(Json(app.session.write(|r| Write::Reload(Author::default(), r)).await?))
}

/// `POST /api/open`.
pub(crate) async fn open(State(app): Shared, Json(body): Json<PathBody>) -> Answer<DocumentView> {
    let path = app.workspace.path(&body.path)?;
    // A folder on another machine that does not answer delays only this request: the session reads the file when it has
    // been read here.
    let first = path.clone();
    let read = move || fsio::read_capped(&first, limits::CLIP_BYTES).is_ok();
    apart("the file was not read", read).await?;
    Ok(Json(app.session.write(|r| Write::Open(path, r)).await?))
}

/// The default length of a new clip, frames: 5 s.
const NEW_LENGTH: u32 = 100;

/// `POST /api/new`.
pub(crate) async fn new(State(app): Shared, Json(body): Json<NewBody>) -> Answer<DocumentView> {
    let view = match (body.robot, body.text) {
        (_, Some(text)) => {
            let clip = clip::parse(text).map_err(Error::from)?.clip;
            app.session.write(|r| Write::New(Box::new(clip), r)).await?
        }
        (Some(robot), None) => {
            let (length, name) = (body.length.unwrap_or(NEW_LENGTH), body.name);
            app.session.write(|reply| Write::Blank { robot, length, name, reply }).await?
        }
        (None, None) => return Err(Error::request("say `robot` or `text`").into()),
    };
    Ok(Json(view))
}

/// `POST /api/save`.
pub(crate) async fn save(State(app): Shared, Json(body): Json<SaveBody>) -> Answer<Saved> {
    let path = body.path.map(|p| app.workspace.path(&p)).transpose()?;
    Ok(Json(app.session.write(|reply| Write::Save { path, replace: body.replace, reply }).await?))
}

/// `POST /api/close`.
pub(crate) async fn close(State(app): Shared) -> Result<StatusCode, Refused> {
    app.session.write(Write::Close).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// `GET /api/export`.
pub(crate) async fn export(
    State(app): Shared,
    Query(query): Query<ExportQuery>,
) -> Result<Response, Refused> {
    let (clip, command) = app.session.content().await?;
    let file = export::file(&query.format, &clip, &command, &app.simulation.rollout)?;
    Ok(download(&file.name, file.media_type, file.bytes))
}
