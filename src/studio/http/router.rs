//! All routes, behind the guard.

use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::http::StatusCode;
use axum::routing::{get, post, put};
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::timeout::TimeoutLayer;

use super::{
    basics, clip_import, document, guard, jobs, pages, pictures, robots, rollout, socket, viewport,
    workspace,
};
use crate::state::App;
use robert_base::limits;

/// All routes behind the guard.
pub(crate) fn router(app: Arc<App>) -> Router {
    let timed = Router::new()
        .route("/", get(pages::index))
        .route("/ui/{*file}", get(pages::bundle))
        .route("/favicon.ico", get(basics::favicon))
        .route("/api/session", post(basics::session))
        .route("/api/state", get(basics::state))
        .route("/api/clip", get(document::clip).put(document::put_clip))
        .route("/api/ops", post(document::ops))
        .route("/api/undo", post(document::undo))
        .route("/api/redo", post(document::redo))
        .route("/api/discard", post(document::discard))
        .route("/api/reload", post(document::reload))
        .route("/api/open", post(document::open))
        .route("/api/new", post(document::new))
        .route("/api/save", post(document::save))
        .route("/api/close", post(document::close))
        .route("/api/files", get(clip_import::files))
        .route("/api/clips", post(clip_import::clips))
        .route("/api/insert", post(clip_import::insert))
        .route("/api/gallery", get(workspace::gallery))
        .route("/api/gallery/{*id}", post(workspace::open_example))
        .route("/api/recent", get(workspace::recent))
        .route("/api/drafts", get(workspace::drafts))
        .route("/api/drafts/{number}", post(workspace::open_draft))
        .route("/api/drafts/{number}/discard", post(workspace::discard_draft))
        .route("/api/robots", get(robots::robots))
        .route("/api/robot/{id}", get(robots::robot))
        .route("/api/robot/{id}/geometry", get(robots::geometry))
        .route("/api/kinematics", post(robots::kinematics))
        .route("/api/ik", post(robots::ik))
        .route("/api/draw", post(robots::draw))
        .route("/api/settle", post(robots::settle))
        .route("/api/rollout", get(rollout::rollout))
        .route("/api/takes", get(rollout::takes))
        .route("/api/takes/{id}", get(rollout::take))
        .route("/api/export", get(document::export))
        .route("/api/formats", get(jobs::formats))
        .route("/api/exports", post(jobs::start_export))
        .route("/api/shelf", get(workspace::shelf))
        .route("/api/curves", get(workspace::curves))
        .route("/api/upload", put(jobs::upload))
        .route("/api/import", post(jobs::import))
        .route("/api/jobs", get(jobs::jobs).post(jobs::start_job))
        .route("/api/jobs/{id}", get(jobs::job))
        .route("/api/jobs/{id}/file", get(jobs::job_file))
        .route("/api/jobs/{id}/cancel", post(jobs::cancel_job))
        .route("/api/jobs/{id}/resume", post(jobs::resume_job))
        .layer(TimeoutLayer::with_status_code(
            StatusCode::REQUEST_TIMEOUT,
            Duration::from_secs(limits::BODY_SECS),
        ));
    // Six examples may be performed and drawn for the first time at once. The last of them may wait
    // longer than the time limit of a request's body, and the painter has a time limit of its own.
    let painted = Router::new()
        .route("/api/still.jpg", get(pictures::still))
        .route("/api/hover", get(pictures::hover))
        .route("/api/still-body", get(pictures::still_body))
        .route("/api/pose.jpg", get(pictures::pose_picture))
        .route("/api/thumbnail.jpg", get(pictures::thumbnail))
        .route("/api/gallery-picture.jpg", get(pictures::example_picture))
        .route("/api/gallery-error", get(pictures::example_error));
    Router::new()
        .merge(timed)
        .merge(painted)
        .route("/api/ws", get(socket::editor))
        .route("/viser", get(viewport::route))
        .route("/viser/", get(viewport::route))
        .fallback(basics::not_found)
        .method_not_allowed_fallback(basics::bad_method)
        .layer(DefaultBodyLimit::max(limits::REQUEST_BYTES))
        .layer(CatchPanicLayer::new())
        .layer(axum::middleware::from_fn_with_state(Arc::clone(&app.guard), guard::layer))
        .with_state(app)
}
