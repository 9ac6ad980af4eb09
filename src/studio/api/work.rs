//! Work that takes a while: exports, imports, training, and what it leaves in the folder.

use std::path::Path;
use std::sync::Arc;

use axum::extract::{Path as UrlPath, State};
use axum::http::StatusCode;
use axum::response::Response;
use serde::Deserialize;

use super::PathBody;
use super::answer::{Answer, Json, Query, Refused, Shared, apart, download, whole_body};
use crate::studio::error::Error;
use crate::studio::exchange::{Beside, ExportRequest, Scene, Second};
use crate::studio::jobs::{Extra, JobKind, JobRequest, JobView};
use crate::studio::session::Ask;
use crate::studio::shelf::{self, Shelf};
use crate::studio::{exchange, export};
use crate::{fsio, limits};

/// `POST /api/exports`.
pub(in crate::studio) async fn start_export(
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
pub(in crate::studio) async fn job_file(
    State(app): Shared,
    UrlPath(id): UrlPath<u64>,
) -> Result<Response, Refused> {
    let path = app.jobs.file(id)?;
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let read = move || fsio::read_capped(&path, limits::UPLOAD_BYTES);
    let bytes = apart("the file was not read", read).await?;
    let bytes = bytes.map_err(Error::from)?;
    Ok(download(&name, export::media_type(&name), bytes))
}

/// `GET /api/shelf`.
pub(in crate::studio) async fn shelf(State(app): Shared) -> Result<Json<Shelf>, Refused> {
    let folder = app.folder.clone();
    Ok(Json(apart("the folder was not read", move || shelf::list(&folder)).await?))
}

/// `GET /api/curves?path=RUN`.
pub(in crate::studio) async fn curves(
    State(app): Shared,
    Query(body): Query<PathBody>,
) -> Answer<Vec<serde_json::Value>> {
    let dir = app.path(&body.path)?;
    Ok(Json(apart("the run was not read", move || shelf::curves(&dir)).await?))
}

/// Query of `PUT /api/upload`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(in crate::studio) struct UploadQuery {
    path: String,
    #[serde(default)]
    first: bool,
}

/// `PUT /api/upload`: one file of a robot's folder; the first one empties it.
pub(in crate::studio) async fn upload(
    State(app): Shared,
    Query(query): Query<UploadQuery>,
    request: axum::extract::Request,
) -> Result<StatusCode, Refused> {
    let bytes = whole_body(request, limits::PROJECT_BYTES as usize).await?;
    let uploads = Arc::clone(&app.uploads);
    let put = move || uploads.put(&query.path, query.first, &bytes);
    apart("the file was not kept", put).await??;
    Ok(StatusCode::NO_CONTENT)
}

/// Body of `POST /api/import`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(in crate::studio) struct ImportBody {
    /// The URDF or MJCF: among the uploaded files, or on this machine.
    file: String,
    #[serde(default)]
    uploaded: bool,
    id: String,
    #[serde(default)]
    fixed_base: bool,
}

/// `POST /api/import`: a job that makes a robot in the studio's folder.
pub(in crate::studio) async fn import(
    State(app): Shared,
    Json(body): Json<ImportBody>,
) -> Answer<JobView> {
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
pub(in crate::studio) async fn jobs(State(app): Shared) -> Json<Vec<JobView>> {
    Json(app.jobs.list())
}

/// `POST /api/jobs`.
pub(in crate::studio) async fn start_job(
    State(app): Shared,
    Json(body): Json<JobRequest>,
) -> Answer<JobView> {
    Ok(Json(app.jobs.start(body, &app.folder)?))
}

/// Query of `GET /api/jobs/{id}`.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(in crate::studio) struct LinesFrom {
    from: usize,
}

/// `GET /api/jobs/{id}`.
pub(in crate::studio) async fn job(
    State(app): Shared,
    UrlPath(id): UrlPath<u64>,
    Query(query): Query<LinesFrom>,
) -> Answer<JobView> {
    Ok(Json(app.jobs.view(id, query.from)?))
}

/// `POST /api/jobs/{id}/cancel`.
pub(in crate::studio) async fn cancel_job(
    State(app): Shared,
    UrlPath(id): UrlPath<u64>,
) -> Answer<JobView> {
    Ok(Json(app.jobs.cancel(id)?))
}

/// `POST /api/jobs/{id}/resume`.
pub(in crate::studio) async fn resume_job(
    State(app): Shared,
    UrlPath(id): UrlPath<u64>,
) -> Answer<JobView> {
    Ok(Json(app.jobs.resume(id, &app.folder)?))
}
