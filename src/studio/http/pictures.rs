//! Pictures of poses, frames and examples, and the body at a point of such a picture.

use axum::body::Bytes;
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};

use super::answer::{Answer, Json, Query, Refused, Shared, apart};
use super::robots::check_pose;
use crate::protocol::{
    Error, ExampleQuery, HoverQuery, Hovered, MeanError, PoseQuery, StillBodyQuery, StillQuery,
    ThumbnailQuery,
};
use crate::simulation::worker::DescribeRobot;
use crate::workspace::Shown;
use robert_clip::{Clip, JointFacts, Key, Row};

fn picture(jpeg: Bytes) -> Response {
    ([(header::CONTENT_TYPE, "image/jpeg")], jpeg).into_response()
}

/// `GET /api/still.jpg`.
pub(crate) async fn still(
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
    Ok(picture(
        app.workspace
            .pictures
            .still(&app.simulation.rollout, q.frame, size, q.draft, &shown)
            .await?,
    ))
}

fn on_picture(x: f64, y: f64) -> Result<(), Error> {
    let inside = 0.0..=1.0;
    if inside.contains(&x) && inside.contains(&y) {
        Ok(())
    } else {
        Err(Error::request("x and y go from 0 to 1"))
    }
}

/// `GET /api/still-body`: the body at a point of a draft still, or null.
pub(crate) async fn still_body(
    State(app): Shared,
    Query(q): Query<StillBodyQuery>,
) -> Answer<Option<String>> {
    on_picture(q.x.into(), q.y.into())?;
    Ok(Json(
        app.workspace
            .pictures
            .body_at(&app.simulation.rollout, q.frame, (q.w, q.h), (q.x, q.y))
            .await?,
    ))
}

/// `GET /api/hover`: the body under a page's pointer in its 3D view.
pub(crate) async fn hover(
    State(app): Shared,
    Query(q): Query<HoverQuery>,
) -> Answer<Option<Hovered>> {
    on_picture(q.x, q.y)?;
    Ok(Json(app.viewport.under(&q.tab, [q.x, q.y]).await))
}

/// `GET /api/pose.jpg`: a pose of the clip, or of its robot.
pub(crate) async fn pose_picture(
    State(app): Shared,
    Query(query): Query<PoseQuery>,
) -> Result<Response, Refused> {
    let (clip, _) = app.session.content().await?;
    let robot = app.simulation.robot().ok_or(Error::NoDocument)?;
    let missing = || Error::NotFound { what: format!("pose {:?}", query.pose) };
    let rest = &robot.table.rest;
    let q = match clip.poses.get(&query.pose) {
        // Joints that a pose leaves open are shown at rest.
        Some(values) => robot
            .table
            .joints
            .iter()
            .zip(rest)
            .map(|(j, rest)| {
                let at = clip.robot.joints.iter().position(|n| *n == j.name);
                at.and_then(|i| values.get(i).copied().flatten()).unwrap_or(*rest)
            })
            .collect(),
        None => robot.poses.iter().find(|p| p.name == query.pose).ok_or_else(missing)?.q.clone(),
    };
    Ok(picture(app.workspace.pictures.pose(robot.source.clone(), q).await?))
}

/// `GET /api/thumbnail.jpg`: the middle of a clip's file, or of a take.
pub(crate) async fn thumbnail(
    State(app): Shared,
    Query(query): Query<ThumbnailQuery>,
) -> Result<Response, Refused> {
    let (source, names, row) = match (query.path, query.take) {
        (Some(path), None) => {
            let path = app.workspace.path(&path)?;
            let read = move || Clip::load(&path);
            let clip = apart("the file was not read", read).await?.map_err(Error::from)?;
            let row = middle(&clip).ok_or_else(|| Error::request("the clip shows no pose"))?;
            (app.robot_source(clip.robot.id.clone()), clip.robot.joints, row)
        }
        (None, Some(id)) => {
            let missing = || Error::NotFound { what: format!("take {id}") };
            let (clip, _) = app.simulation.rollout.take_source(id).ok_or_else(missing)?;
            let motion = app.simulation.rollout.take_frames(id).ok_or_else(missing)?;
            let row = motion.q.get(motion.q.len() / 2).ok_or_else(missing)?;
            let source = app.simulation.robot().ok_or(Error::NoDocument)?.source.clone();
            let row = row.iter().map(|v| Some(f64::from(*v))).collect();
            (source, clip.robot.joints.clone(), row)
        }
        _ => return Err(Error::request("say `path` or `take`").into()),
    };
    let facts = app.simulation.ask(DescribeRobot { robot: source.clone() }).await?;
    let joints = facts.table.joints.iter().zip(&facts.table.rest);
    let value = |(joint, rest): (&JointFacts, &f64)| {
        let at = names.iter().position(|n| *n == joint.name);
        at.and_then(|i| row.get(i).copied().flatten()).unwrap_or(*rest)
    };
    Ok(picture(app.workspace.pictures.pose(source, joints.map(value).collect()).await?))
}

/// The values of the key in the middle of a clip.
fn middle(clip: &Clip) -> Option<Row> {
    let keys: Vec<&Key> = clip.keys.iter().filter(|k| clip.row(k).is_some()).collect();
    clip.row(keys.get(keys.len() / 2)?).cloned()
}

/// `GET /api/gallery-picture.jpg`.
pub(crate) async fn example_picture(
    State(app): Shared,
    Query(query): Query<ExampleQuery>,
) -> Result<Response, Refused> {
    Ok(picture(app.workspace.pictures.example(&query.id).await?))
}

/// `GET /api/gallery-error`.
pub(crate) async fn example_error(
    State(app): Shared,
    Query(query): Query<ExampleQuery>,
) -> Answer<Option<MeanError>> {
    Ok(Json(app.workspace.pictures.example_error(&query.id).await?))
}
