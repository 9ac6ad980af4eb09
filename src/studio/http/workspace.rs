//! Examples, recent files, drafts, and the content of the folder.

use std::sync::Arc;

use axum::extract::{Path as UrlPath, State};
use axum::http::StatusCode;

use super::answer::{Answer, Json, Query, Refused, Shared, apart};
use crate::document::Document;
use crate::protocol::{DocumentView, Draft, GalleryItem, PathBody, RecentFile, Shelf};
use crate::session::Write;
use crate::workspace::{gallery, runs};

/// `GET /api/gallery`.
pub(crate) async fn gallery() -> Json<Vec<GalleryItem>> {
    Json(gallery::list())
}

/// `POST /api/gallery/{id}`.
pub(crate) async fn open_example(
    State(app): Shared,
    UrlPath(id): UrlPath<String>,
) -> Answer<DocumentView> {
    let clip = gallery::open(&id)?;
    Ok(Json(app.session.write(|r| Write::New(Box::new(clip), r)).await?))
}

/// `GET /api/recent`.
pub(crate) async fn recent(State(app): Shared) -> Answer<Vec<RecentFile>> {
    let workspace = Arc::clone(&app.workspace);
    Ok(Json(apart("the recent files were not read", move || workspace.recent.list()).await?))
}

/// `GET /api/drafts`.
pub(crate) async fn drafts(State(app): Shared) -> Answer<Vec<Draft>> {
    let dir = app.workspace.state_dir.clone();
    Ok(Json(apart("the journals were not read", move || Document::drafts(&dir)).await?))
}

/// `POST /api/drafts/{number}`.
pub(crate) async fn open_draft(
    State(app): Shared,
    UrlPath(number): UrlPath<u32>,
) -> Answer<DocumentView> {
    Ok(Json(app.session.write(|r| Write::Draft(number, r)).await?))
}

/// `POST /api/drafts/{number}/discard`.
pub(crate) async fn discard_draft(
    State(app): Shared,
    UrlPath(number): UrlPath<u32>,
) -> Result<StatusCode, Refused> {
    let dir = app.workspace.state_dir.clone();
    let remove = move || Document::drop_draft(&dir, number);
    apart("the journal was not removed", remove).await??;
    Ok(StatusCode::NO_CONTENT)
}

/// `GET /api/shelf`.
pub(crate) async fn shelf(State(app): Shared) -> Result<Json<Shelf>, Refused> {
    let folder = app.workspace.folder.clone();
    Ok(Json(apart("the folder was not read", move || runs::list(&folder)).await?))
}

/// `GET /api/curves?path=RUN`.
pub(crate) async fn curves(
    State(app): Shared,
    Query(body): Query<PathBody>,
) -> Answer<Vec<serde_json::Value>> {
    let dir = app.workspace.path(&body.path)?;
    Ok(Json(apart("the run was not read", move || runs::curves(&dir)).await?))
}
