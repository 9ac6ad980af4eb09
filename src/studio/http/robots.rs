//! Robots, and questions about their poses.

use std::sync::Arc;

use axum::extract::{Path as UrlPath, State};

use super::answer::{Answer, Json, Shared};
use crate::protocol::{
    Error, Geometry, IkAnswer, IkRequest, Pose, Poses, RobotCard, RobotFacts, SettleAnswer,
};
use crate::simulation::RobotContext;
use crate::simulation::worker::{DescribeRobot, Kinematics, LookAtRobot, Settle};
use crate::state::App;
use crate::workspace::robot_folders;
use robert_base::limits;

/// `GET /api/robots`.
pub(crate) async fn robots(State(app): Shared) -> Json<Vec<RobotCard>> {
    Json(robot_folders::cards(&app.workspace.folder, &app.workspace.state_dir))
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

/// A pose of the open robot: as many numbers as joints, and none beyond all reason.
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
    check_numbers(body.pos.iter().chain(body.quat.iter().flatten()).chain(offset))?;
    Ok(Json(app.simulation.ask(body).await?))
}

/// `POST /api/settle`.
pub(crate) async fn settle(State(app): Shared, Json(body): Json<Pose>) -> Answer<SettleAnswer> {
    let robot = check_pose(&app, &body.q)?;
    let question = Settle { robot: robot.source.clone(), q: body.q };
    Ok(Json(app.simulation.ask(question).await?))
}
