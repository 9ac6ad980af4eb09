//! The server: one loopback port, a router, an end.
//!
//! `axum::serve` has no time limit for a request's head, so the accept loop is our own: head
//! of 16 KiB within 5 s, a bounded number of connections, and the guard before every route.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicUsize;
use std::time::Duration;

use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::http::StatusCode;
use axum::routing::{get, post, put};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Semaphore, watch};
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::timeout::TimeoutLayer;

use super::error::Error;
use super::exchange::Uploads;
use super::guard::{self, Guard};
use super::hub::Hub;
use super::jobs::Jobs;
use super::live::Live;
use super::pictures::Pictures;
use super::recent::Recent;
use super::session::Session;
use super::viser::Viewport;
use super::worker::WorkerHandle;
use super::{api, intake, pages, socket};
use crate::limits;

/// Everything that requests share.
#[derive(Debug)]
pub struct App {
    /// The checks.
    pub guard: Arc<Guard>,
    /// The events.
    pub hub: Hub,
    /// The rollout.
    pub live: Arc<Live>,
    /// The simulation.
    pub worker: WorkerHandle,
    /// The document.
    pub session: Session,
    /// Recent files.
    pub recent: Arc<Recent>,
    /// The 3D viewport.
    pub viewport: Arc<Viewport>,
    /// Long jobs.
    pub jobs: Jobs,
    /// Pictures.
    pub pictures: Pictures,
    /// Files that a page has sent.
    pub uploads: Arc<Uploads>,
    /// Journals of unsaved clips, recent files, kept pictures.
    pub state_dir: PathBuf,
    /// Where relative paths start.
    pub folder: PathBuf,
    /// Editor clients now.
    pub clients: AtomicUsize,
    /// Number of the next client.
    pub next_client: AtomicUsize,
    /// Turns true at the end.
    pub ending: watch::Receiver<bool>,
}

/// Binds the port; 0 takes any.
///
/// # Errors
/// [`Error::Bind`].
pub async fn bind(port: u16) -> Result<(TcpListener, u16), Error> {
    let fail = |source| Error::Bind { port, source };
    let address = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
    let listener = TcpListener::bind(address).await.map_err(fail)?;
    let port = listener.local_addr().map_err(fail)?.port();
    Ok((listener, port))
}

/// All routes behind the guard.
pub fn router(app: Arc<App>) -> Router {
    let timed = Router::new()
        .route("/", get(pages::index))
        .route("/ui/{*file}", get(pages::bundle))
        .route("/favicon.ico", get(api::favicon))
        .route("/api/session", post(api::session))
        .route("/api/state", get(api::state))
        .route("/api/clip", get(api::clip).put(api::put_clip))
        .route("/api/ops", post(api::ops))
        .route("/api/undo", post(api::undo))
        .route("/api/redo", post(api::redo))
        .route("/api/discard", post(api::discard))
        .route("/api/open", post(api::open))
        .route("/api/new", post(api::new))
        .route("/api/save", post(api::save))
        .route("/api/close", post(api::close))
        .route("/api/files", get(intake::files))
        .route("/api/clips", post(intake::clips))
        .route("/api/gallery", get(api::gallery))
        .route("/api/gallery/{*id}", post(api::open_example))
        .route("/api/recent", get(api::recent))
        .route("/api/drafts", get(api::drafts))
        .route("/api/drafts/{number}", post(api::open_draft))
        .route("/api/drafts/{number}/discard", post(api::discard_draft))
        .route("/api/robots", get(api::robots))
        .route("/api/robot/{id}", get(api::robot))
        .route("/api/robot/{id}/geometry", get(api::geometry))
        .route("/api/kinematics", post(api::kinematics))
        .route("/api/ik", post(api::ik))
        .route("/api/settle", post(api::settle))
        .route("/api/rollout", get(api::rollout))
        .route("/api/takes", get(api::takes))
        .route("/api/takes/{id}", get(api::take))
        .route("/api/export", get(api::export))
        .route("/api/exports", post(api::start_export))
        .route("/api/shelf", get(api::shelf))
        .route("/api/curves", get(api::curves))
        .route("/api/upload", put(api::upload))
        .route("/api/import", post(api::import))
        .route("/api/jobs", get(api::jobs).post(api::start_job))
        .route("/api/jobs/{id}", get(api::job))
        .route("/api/jobs/{id}/file", get(api::job_file))
        .route("/api/jobs/{id}/cancel", post(api::cancel_job))
        .route("/api/jobs/{id}/resume", post(api::resume_job))
        .layer(TimeoutLayer::with_status_code(
            StatusCode::REQUEST_TIMEOUT,
            Duration::from_secs(limits::BODY_SECS),
        ));
    // Six examples that are performed and painted for the first time stand in line: who is last
    // may wait longer than a request's body may take. The painter has a patience of its own.
    let painted = Router::new()
        .route("/api/still.jpg", get(api::still))
        .route("/api/hover", get(api::hover))
        .route("/api/still-body", get(api::still_body))
        .route("/api/pose.jpg", get(api::pose_picture))
        .route("/api/gallery-picture.jpg", get(api::example_picture))
        .route("/api/gallery-error", get(api::example_error));
    Router::new()
        .merge(timed)
        .merge(painted)
        .route("/api/ws", get(socket::editor))
        .route("/viser", get(super::viser::route))
        .route("/viser/", get(super::viser::route))
        .fallback(api::not_found)
        .method_not_allowed_fallback(api::bad_method)
        .layer(DefaultBodyLimit::max(limits::REQUEST_BYTES))
        .layer(CatchPanicLayer::new())
        .layer(axum::middleware::from_fn_with_state(Arc::clone(&app.guard), guard::layer))
        .with_state(app)
}

/// Serves until `ending` turns true.
pub async fn serve(listener: TcpListener, router: Router, mut ending: watch::Receiver<bool>) {
    let room = Arc::new(Semaphore::new(limits::CONNECTIONS));
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            () = ended(&mut ending) => return,
        };
        let Ok((stream, _)) = accepted else {
            // Out of file descriptors, say: others will close theirs.
            tokio::time::sleep(Duration::from_millis(20)).await;
            continue;
        };
        let Ok(permit) = Arc::clone(&room).try_acquire_owned() else { continue };
        stream.set_nodelay(true).ok();
        let router = router.clone();
        let mut ending = ending.clone();
        tokio::spawn(async move {
            tokio::select! {
                () = connection(stream, router) => {}
                () = ended(&mut ending) => {}
            }
            drop(permit);
        });
    }
}

/// Returns when the studio ends.
pub async fn ended(ending: &mut watch::Receiver<bool>) {
    ending.wait_for(|end| *end).await.ok();
}

async fn connection(stream: TcpStream, router: Router) {
    let result = hyper::server::conn::http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(Duration::from_secs(limits::HEAD_SECS))
        .max_buf_size(limits::HEAD_BYTES)
        .serve_connection(TokioIo::new(stream), TowerToHyperService::new(router))
        .with_upgrades()
        .await;
    if let Err(e) = result {
        tracing::debug!("a connection ended: {e}");
    }
}
