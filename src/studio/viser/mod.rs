//! The 3D viewport: our side of the viser 1.1.1 protocol.

use std::sync::Arc;

use axum::extract::State;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::response::{IntoResponse, Response};

use super::error::Error;
use super::pages;
use super::protocol::StudioOp;
use super::server::App;

/// The client's page, or its socket: it derives the address of one from the other.
pub async fn route(
    State(_app): State<Arc<App>>,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    match upgrade {
        Ok(_upgrade) => axum::http::StatusCode::NOT_IMPLEMENTED.into_response(),
        Err(_page) => pages::viser().await,
    }
}

/// A request about what the viewport shows.
///
/// # Errors
/// [`Error::NotFound`] for unknown joints and the like.
pub async fn view_op(_app: &App, _op: StudioOp) -> Result<(), Error> {
    Ok(())
}
