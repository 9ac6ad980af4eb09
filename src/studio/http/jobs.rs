//! Long work: exports, imports, training, and the results in the folder.

use std::path::Path;
use std::sync::Arc;

use axum::extract::{Path as UrlPath, State};
use axum::http::StatusCode;
use axum::response::Response;

use super::answer::{Answer, Json, Query, Refused, Shared, apart, download, whole_body};
use crate::jobs::Extra;
use crate::protocol::{
    Beside, Error, ExportFormat, ExportRequest, ImportBody, JobKind, JobRequest, JobView,
    LinesFrom, UploadQuery,
};
use crate::workspace::transfer::{Scene, Second};
use crate::workspace::{export, formats, robot_folders, transfer, upload_path};
use robert_base::fsio;
use robert_base::limits;

/// `POST /api/exports`.
pub(crate) async fn start_export(
    State(app): Shared,
    Json(body): Json<ExportRequest>,
) -> Answer<JobView> {
    let (clip, _) = app.session.content().await?;
    let robot = app.simulation.robot().ok_or(Error::NoDocument)?;
    let settings = app.simulation.rollout.settings();
    let beside = match &body.compare {
        Some(Beside::Take(id)) => {
            let missing = || Error::NotFound { what: format!("take {id}") };
            let (clip, settings) = app.simulation.rollout.take_source(*id).ok_or_else(missing)?;
            Some(Second::Take(clip, settings))
        }
        Some(Beside::File(path)) => Some(Second::File(app.workspace.path(path)?)),
        None => None,
    };
    let target = transfer::target(&body, &app.workspace.folder)?;
    let scene = Scene { clip: &clip, robot: &robot.source, settings: &settings, beside };
    let (request, extra) = transfer::job(&body, &scene, target.clone())?;
    if let Some(path) = target.filter(|_| !body.replace) {
        let exists = move || path.exists().then_some(path);
        if let Some(path) = apart("the file was not looked for", exists).await? {
            return Err(Error::Exists { path }.into());
        }
    }
    Ok(Json(app.jobs.start_with(request, extra, &app.workspace.folder)?))
}

/// `GET /api/jobs/{id}/file`.
pub(crate) async fn job_file(
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

/// `PUT /api/upload`: one file of a robot's folder; the first one empties it.
pub(crate) async fn upload(
    State(app): Shared,
    Query(query): Query<UploadQuery>,
    request: axum::extract::Request,
) -> Result<StatusCode, Refused> {
    let bytes = whole_body(request, limits::PROJECT_BYTES as usize).await?;
    let workspace = Arc::clone(&app.workspace);
    let put = move || workspace.uploads.put(&query.path, query.first, &bytes);
    apart("the file was not kept", put).await??;
    Ok(StatusCode::NO_CONTENT)
}

/// `POST /api/import`: a job that makes a robot in the studio's folder.
pub(crate) async fn import(State(app): Shared, Json(body): Json<ImportBody>) -> Answer<JobView> {
    if !robert_robot::valid_id(&body.id) {
        return Err(Error::request(format!(
            "{:?} cannot be a robot's name: lower-case letters, digits, '_' and '-'",
            body.id
        ))
        .into());
    }
    if robot_folders::is_builtin(&body.id) {
        return Err(Error::request(format!("{} is a robot of the program", body.id)).into());
    }
    let uploads = body.uploaded.then(|| app.workspace.uploads.folder());
    let file = if let Some(uploads) = &uploads {
        upload_path(uploads.path(), &body.file)?
    } else {
        app.workspace.path(&body.file)?
    };
    let out = app.workspace.folder.join("robots").join(&body.id);
    let mut args: Vec<String> = [file.as_path(), Path::new("--out"), &out, Path::new("--id")]
        .iter()
        .map(|p| p.display().to_string())
        .collect();
    args.push(body.id.clone());
    if let Some(uploads) = &uploads {
        args.extend(["--root".to_owned(), uploads.path().display().to_string()]);
    }
    for body in body.without {
        // One argument each: a name that begins with a dash is still a name.
        args.push(format!("--without={body}"));
    }
    if let Some(servos) = body.actuators {
        args.push(format!("--actuators={servos}"));
    }
    if let Some(drives) = body.drives {
        args.push(format!("--drives={drives}"));
    }
    if body.fixed_base {
        args.push("--fixed-base".into());
    }
    let title = format!("Import {}", body.id);
    let extra = Extra { title, scratch: uploads, ..Extra::default() };
    let request = JobRequest { kind: JobKind::Import, args };
    Ok(Json(app.jobs.start_with(request, extra, &app.workspace.folder)?))
}

/// `GET /api/formats`.
pub(crate) async fn formats(State(app): Shared) -> Json<Vec<ExportFormat>> {
    Json(formats::offered(app.simulation.robot().as_deref()))
}

/// `GET /api/jobs`.
pub(crate) async fn jobs(State(app): Shared) -> Json<Vec<JobView>> {
    Json(app.jobs.list())
}

/// `POST /api/jobs`.
pub(crate) async fn start_job(State(app): Shared, Json(body): Json<JobRequest>) -> Answer<JobView> {
    Ok(Json(app.jobs.start(body, &app.workspace.folder)?))
}

/// `GET /api/jobs/{id}`.
pub(crate) async fn job(
    State(app): Shared,
    UrlPath(id): UrlPath<u64>,
    Query(query): Query<LinesFrom>,
) -> Answer<JobView> {
    Ok(Json(app.jobs.view(id, query.from)?))
}

/// `POST /api/jobs/{id}/cancel`.
pub(crate) async fn cancel_job(State(app): Shared, UrlPath(id): UrlPath<u64>) -> Answer<JobView> {
    Ok(Json(app.jobs.cancel(id)?))
}

/// `POST /api/jobs/{id}/resume`.
pub(crate) async fn resume_job(State(app): Shared, UrlPath(id): UrlPath<u64>) -> Answer<JobView> {
    Ok(Json(app.jobs.resume(id, &app.workspace.folder)?))
}
