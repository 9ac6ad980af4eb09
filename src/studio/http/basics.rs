//! Sessions, the complete state, and the answer to unknown addresses.

use std::sync::atomic::Ordering;

use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};

use super::answer::{Json, Refused, Shared};
use super::pages;
use crate::protocol;
use crate::protocol::{Code, DocumentView, Error, ErrorBody};
use crate::state::App;

/// No icon is no error.
pub(crate) async fn favicon() -> StatusCode {
    StatusCode::NO_CONTENT
}

/// Nothing here.
pub(crate) async fn not_found() -> Refused {
    Refused::from(Error::NotFound { what: "such address".into() })
}

/// Refuses a method that the address does not have.
pub(crate) async fn bad_method() -> Response {
    let body = ErrorBody::new(Code::Request, "this address does not take that method");
    (StatusCode::METHOD_NOT_ALLOWED, axum::Json(body)).into_response()
}

/// Exchanges the token for a cookie. The guard has seen the token already.
pub(crate) async fn session(State(app): Shared) -> Response {
    (StatusCode::NO_CONTENT, [(header::SET_COOKIE, app.guard.set_cookie())]).into_response()
}

/// The open document, if any.
pub(crate) async fn current_view(app: &App) -> Option<Box<DocumentView>> {
    app.session.view().await.ok().flatten()
}

/// Everything that a fresh page needs.
pub(crate) async fn current_state(app: &App) -> protocol::State {
    protocol::State {
        version: env!("CARGO_PKG_VERSION"),
        document: current_view(app).await.map(|d| *d),
        rollout: app.simulation.rollout.settings(),
        policies: app.simulation.robot().map(|f| protocol::policies(&f.offers)).unwrap_or_default(),
        worker: app.simulation.rollout.worker_state(),
        viser: pages::has_viser(),
        clients: app.clients.now.load(Ordering::SeqCst),
        folder: app.workspace.folder.display().to_string(),
        locked: app.viewport.locked(),
        pins: app.viewport.pins(),
        takes: app.simulation.rollout.takes(),
    }
}

/// `GET /api/state`.
pub(crate) async fn state(State(app): Shared) -> Json<protocol::State> {
    Json(current_state(&app).await)
}
