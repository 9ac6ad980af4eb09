//! The rollout and its takes.

use axum::extract::{Path as UrlPath, State};

use super::answer::{Answer, Json, Shared};
use crate::protocol::{Error, RolloutView, TakeFrames, TakesView};

/// `GET /api/rollout`.
pub(crate) async fn rollout(State(app): Shared) -> Json<RolloutView> {
    Json(app.simulation.rollout.view())
}

/// `GET /api/takes`.
pub(crate) async fn takes(State(app): Shared) -> Json<TakesView> {
    Json(app.simulation.rollout.takes())
}

/// `GET /api/takes/{id}`: its motion.
pub(crate) async fn take(State(app): Shared, UrlPath(id): UrlPath<u64>) -> Answer<TakeFrames> {
    let missing = || Error::NotFound { what: format!("take {id}") };
    Ok(Json(app.simulation.rollout.take_frames(id).ok_or_else(missing)?))
}
