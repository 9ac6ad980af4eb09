//! Pictures of poses, moments and examples, and what is under a point of one.

use axum::body::Bytes;
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use serde::Deserialize;

use super::answer::{Answer, Json, Query, Refused, Shared};
use super::check_pose;
use crate::studio::error::Error;
use crate::studio::pictures::Shown;
use crate::studio::session::Ask;
use crate::studio::viser::Hovered;
use crate::studio::worker::MeanError;

/// Query of `GET /api/still.jpg`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(in crate::studio) struct StillQuery {
    #[serde(default)]
    frame: usize,
    #[serde(default = "still_width")]
    w: u32,
    #[serde(default = "still_height")]
    h: u32,
    #[serde(default)]
    draft: bool,
    #[serde(default = "yes")]
    achieved: bool,
    #[serde(default = "yes")]
    command: bool,
    #[serde(default)]
    ghosts: bool,
    /// Numbers with commas between them: a pose in the place of what was achieved.
    pose: Option<String>,
    /// Not read: makes the address of a newer picture another one.
    #[serde(default, rename = "v")]
    _version: String,
}

fn yes() -> bool {
    true
}

fn still_width() -> u32 {
    640
}

fn still_height() -> u32 {
    480
}

fn picture(jpeg: Bytes) -> Response {
    ([(header::CONTENT_TYPE, "image/jpeg")], jpeg).into_response()
}

/// `GET /api/still.jpg`.
pub(in crate::studio) async fn still(
    State(app): Shared,
    Query(q): Query<StillQuery>,
) -> Result<Response, Refused> {
    let parse = |text: &String| text.split(',').map(|v| v.trim().parse::<f64>()).collect();
    let pose: Option<Result<Vec<f64>, _>> = q.pose.as_ref().map(parse);
    let pose = match pose {
        Some(Ok(q)) => {
            check_pose(&app, &q)?;
            Some(q.into_iter().map(|v| v as f32).collect())
        }
        Some(Err(e)) => return Err(Error::request(format!("pose: {e}")).into()),
        None => None,
    };
    let shown = Shown { achieved: q.achieved, command: q.command, ghosts: q.ghosts, pose };
    let size = (q.w, q.h);
    Ok(picture(app.pictures.still(&app.live, q.frame, size, q.draft, &shown).await?))
}

fn on_picture(x: f64, y: f64) -> Result<(), Error> {
    let inside = 0.0..=1.0;
    if inside.contains(&x) && inside.contains(&y) {
        Ok(())
    } else {
        Err(Error::request("x and y go from 0 to 1"))
    }
}

/// Query of `GET /api/still-body`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(in crate::studio) struct StillBodyQuery {
    frame: usize,
    w: u32,
    h: u32,
    /// From the left edge, 0 to 1.
    x: f32,
    /// From the top edge, 0 to 1.
    y: f32,
}

/// `GET /api/still-body`: the body at a point of a draft still, or null.
pub(in crate::studio) async fn still_body(
    State(app): Shared,
    Query(q): Query<StillBodyQuery>,
) -> Answer<Option<String>> {
    on_picture(q.x.into(), q.y.into())?;
    Ok(Json(app.pictures.body_at(&app.live, q.frame, (q.w, q.h), (q.x, q.y)).await?))
}

/// Query of `GET /api/hover`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(in crate::studio) struct HoverQuery {
    tab: String,
    x: f64,
    y: f64,
}

/// `GET /api/hover`: what a page's pointer is over in its 3D view.
pub(in crate::studio) async fn hover(
    State(app): Shared,
    Query(q): Query<HoverQuery>,
) -> Answer<Option<Hovered>> {
    on_picture(q.x, q.y)?;
    Ok(Json(app.viewport.under(&q.tab, [q.x, q.y]).await))
}

/// Query of `GET /api/pose.jpg`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(in crate::studio) struct PoseQuery {
    pose: String,
    /// Not read: see [`StillQuery`].
    #[serde(default, rename = "v")]
    _version: String,
}

/// `GET /api/pose.jpg`: a pose of the clip, or of its robot.
pub(in crate::studio) async fn pose_picture(
    State(app): Shared,
    Query(query): Query<PoseQuery>,
) -> Result<Response, Refused> {
    let (clip, _) = app.session.ask(Ask::Content).await?;
    let facts = app.live.facts().ok_or(Error::NoDocument)?;
    let missing = || Error::NotFound { what: format!("pose {:?}", query.pose) };
    let rest = &facts.table.rest;
    let q = match clip.poses.get(&query.pose) {
        // A pose may leave joints open; they are shown at rest.
        Some(values) => facts
            .table
            .joints
            .iter()
            .zip(rest)
            .map(|(j, rest)| {
                let at = clip.robot.joints.iter().position(|n| *n == j.name);
                at.and_then(|i| values.get(i).copied().flatten()).unwrap_or(*rest)
            })
            .collect(),
        None => facts.poses.iter().find(|p| p.name == query.pose).ok_or_else(missing)?.q.clone(),
    };
    Ok(picture(app.pictures.pose(facts.source.clone(), q).await?))
}

/// Query of `GET /api/gallery-picture.jpg` and `/api/gallery-error`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(in crate::studio) struct ExampleQuery {
    id: String,
}

/// `GET /api/gallery-picture.jpg`.
pub(in crate::studio) async fn example_picture(
    State(app): Shared,
    Query(query): Query<ExampleQuery>,
) -> Result<Response, Refused> {
    Ok(picture(app.pictures.example(&query.id).await?))
}

/// `GET /api/gallery-error`.
pub(in crate::studio) async fn example_error(
    State(app): Shared,
    Query(query): Query<ExampleQuery>,
) -> Answer<Option<MeanError>> {
    Ok(Json(app.pictures.example_error(&query.id).await?))
}
