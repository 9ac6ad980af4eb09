//! Robots, and questions about their poses.

use std::sync::Arc;

use axum::extract::{Path as UrlPath, State};

use super::answer::{Answer, Json, Shared, apart};
use crate::protocol::{
    DrawAnswer, DrawRequest, Error, Geometry, IkAnswer, IkRequest, Pin, Pose, Poses, RobotCard,
    RobotFacts, SettleAnswer,
};
use crate::simulation::RobotContext;
use crate::simulation::worker::{DescribeRobot, Kinematics, LookAtRobot, Settle, Trace};
use crate::state::App;
use crate::workspace::robot_folders;
use robert_base::limits;
use robert_clip::JointFacts;

/// `GET /api/robots`.
pub(crate) async fn robots(State(app): Shared) -> Answer<Vec<RobotCard>> {
    let workspace = Arc::clone(&app.workspace);
    let read = move || robot_folders::cards(&workspace.folder, &workspace.state_dir);
    Ok(Json(apart("the robots' folders were not read", read).await?))
}

/// `GET /api/robot/{id}`.
pub(crate) async fn robot(
    State(app): Shared,
    UrlPath(robot): UrlPath<String>,
) -> Answer<RobotFacts> {
    let robot = app.robot_source(robot);
    Ok(Json(app.simulation.ask(DescribeRobot { robot }).await?))
}

/// `GET /api/robot/{id}/geometry`.
pub(crate) async fn geometry(
    State(app): Shared,
    UrlPath(robot): UrlPath<String>,
) -> Answer<Geometry> {
    let robot = app.robot_source(robot);
    Ok(Json(app.simulation.ask(LookAtRobot { robot }).await?))
}

/// A pose of the open robot: one number per joint, each of a plausible size.
pub(super) fn check_pose(app: &App, q: &[f64]) -> Result<Arc<RobotContext>, Error> {
    let facts = app.simulation.robot().ok_or(Error::NoDocument)?;
    let joints = facts.table.joints.len();
    if q.len() != joints {
        let id = &facts.id;
        let got = q.len();
        return Err(Error::request(format!("{got} values for the {joints} joints of {id}")));
    }
    check_numbers(q.iter())?;
    Ok(facts)
}

fn check_numbers<'a>(mut values: impl Iterator<Item = &'a f64>) -> Result<(), Error> {
    let sane = |v: &f64| v.is_finite() && v.abs() <= limits::CLIP_VALUE_MAX;
    match values.find(|v| !sane(v)) {
        Some(v) => Err(Error::request(format!("{v:e} is no position of any joint or point"))),
        None => Ok(()),
    }
}

/// Poses in one question.
const POSES: usize = 1_000;

/// `POST /api/kinematics`.
pub(crate) async fn kinematics(
    State(app): Shared,
    Json(body): Json<Poses>,
) -> Answer<Vec<Vec<f32>>> {
    if body.q.len() > POSES {
        return Err(Error::Full { what: "poses in one question", cap: POSES }.into());
    }
    for q in &body.q {
        check_pose(&app, q)?;
    }
    Ok(Json(app.simulation.ask(Kinematics { poses: body.q }).await?))
}

/// `POST /api/ik`.
pub(crate) async fn ik(State(app): Shared, Json(body): Json<IkRequest>) -> Answer<IkAnswer> {
    check_pose(&app, &body.q)?;
    let offset = body.body.iter().flat_map(|(_, offset)| offset);
    let own = body.pos.iter().flatten().chain(body.quat.iter().flatten()).chain(offset);
    let held = |p: &Pin| -> Vec<f64> {
        p.pos.iter().flatten().chain(p.quat.iter().flatten()).copied().collect()
    };
    let pins: Vec<f64> = body.pins.iter().flat_map(held).collect();
    check_numbers(own.chain(&pins))?;
    if body.pins.len() > limits::PINS {
        return Err(Error::Full { what: "pins", cap: limits::PINS }.into());
    }
    Ok(Json(app.simulation.ask(body).await?))
}

/// `POST /api/draw`.
pub(crate) async fn draw(State(app): Shared, Json(body): Json<DrawRequest>) -> Answer<DrawAnswer> {
    let facts = check_pose(&app, &body.q)?;
    check_numbers(body.points.iter().flatten())?;
    if body.points.len() > limits::DRAWN_POINTS {
        return Err(Error::Full { what: "points in a line", cap: limits::DRAWN_POINTS }.into());
    }
    let positive = |v: f64| v.is_finite() && v > 0.0;
    if !positive(body.tolerance_m) || !body.secs.is_none_or(|s| positive(s) && s < 600.0) {
        let what = "a tolerance is above 0 m, and a time above 0 s and below 600 s";
        return Err(Error::request(what).into());
    }
    let line = app.viewport.sketch(&body).await?;
    // The range of the policy's data, and never more than the joint can do.
    let speed = |j: &JointFacts| j.speed_usual.into_iter().chain(j.speed_max).reduce(f64::min);
    let speeds = facts.table.joints.iter().map(speed).collect();
    let DrawRequest { q, site, secs, tolerance_m, locked, .. } = body;
    let question = Trace { q, site, line, secs, tolerance_m, speeds, locked };
    Ok(Json(app.simulation.ask(question).await?))
}

/// `POST /api/settle`.
pub(crate) async fn settle(State(app): Shared, Json(body): Json<Pose>) -> Answer<SettleAnswer> {
    let robot = check_pose(&app, &body.q)?;
    let question = Settle { robot: robot.source.clone(), q: body.q };
    Ok(Json(app.simulation.ask(question).await?))
}
