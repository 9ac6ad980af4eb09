//! Questions about a robot that the child answers without a rollout.

use std::sync::Arc;

use super::message::{Checked, Refusal};
use crate::protocol::{
    AxisFacts, BodyFacts, Geometry, IkAnswer, IkRequest, MeshFacts, Pin, PoseFacts, RobotFacts,
    SettleAnswer, SiteFacts,
};

use robert_clip::JointTable;
use robert_mujoco::{Data, Kind, Model, index};
use robert_robot as robot;
use robert_robot::{IkConfig, Point, Robot, Target};
use robert_rollout::{ClipFacts as _, Settler};

/// A point in the world, m.
type V3 = [f64; 3];

/// The depth of contact from which a dragged pose shows it, m.
const TOUCH_M: f64 = 5e-4;

/// A robot by builtin id or folder.
pub(crate) fn resolve(robot: &str) -> Result<Arc<Robot>, robot::Error> {
    Robot::load(robot).map(Arc::new)
}

/// Adds facts from the data of the robot's own model.
fn learned(mut table: JointTable, robot: &Robot) -> JointTable {
    use robert_rollout::shipped;
    let Ok(Some(model)) = shipped::get(robot, shipped::DEFAULT) else { return table };
    let usual = model.card.usual();
    for (name, usual) in model.card.robot.joints.iter().zip(usual) {
        let Some(joint) = table.joints.iter_mut().find(|j| &j.name == name) else { continue };
        let [low, high] = joint.range.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
        let band = [usual.low.max(low), usual.high.min(high)];
        joint.band = (band[0] < band[1]).then_some(band);
        joint.speed_usual = (usual.speed > 0.0).then_some(usual.speed);
    }
    table
}

/// Everything a page needs to know.
pub(crate) fn facts(robot: &Robot, source: &str) -> RobotFacts {
    let profile = robot.profile();
    let model = robot.model();
    let mut poses: Vec<PoseFacts> = robot
        .pose_names()
        .filter_map(|name| Some(PoseFacts { name: name.to_owned(), q: robot.pose(name).ok()? }))
        .collect();
    poses.sort_by_key(|p| p.name != profile.home);
    RobotFacts {
        id: robot.id().to_owned(),
        source: source.to_owned(),
        title: profile.title.clone(),
        about: profile.about.clone(),
        licence: profile.licence.clone(),
        table: learned(robot.joint_table(), robot),
        groups: profile.groups.clone(),
        actuators: robot.actuators().iter().map(|a| a.name.clone()).collect(),
        poses,
        ik_sites: profile.ik_sites.iter().filter_map(|s| site(model, s)).collect(),
        axes: robot.joints().iter().map(|j| axis(model, j.id)).collect(),
        camera: profile.camera,
        bodies: bodies(robot, model),
        settle_tolerance: profile.settle.tolerance,
        offers: robert_rollout::offers(robot),
    }
}

fn bodies(robot: &Robot, model: &Model) -> Vec<BodyFacts> {
    (0..model.nbody())
        .map(|b| BodyFacts {
            name: body_name(model, b),
            parent: index(model.body_parentid()[b]),
            joints: robot
                .joints()
                .iter()
                .enumerate()
                .filter(|(_, j)| index(model.jnt_bodyid()[j.id]) == b)
                .map(|(i, _)| i)
                .collect(),
        })
        .collect()
}

fn body_name(model: &Model, body: usize) -> String {
    model.name(Kind::Body, body).map_or_else(|| format!("body {body}"), str::to_owned)
}

/// The geometry of a robot.
pub(crate) fn geometry(robot: &Arc<Robot>) -> Result<Geometry, Refusal> {
    let model = robot.model();
    let meshes = robert_take::body_meshes(robot)?;
    let mut data = Data::new(model)?;
    let home = transforms(robot, &mut data, &robot.home())?;
    Ok(Geometry {
        robot: robot.id().to_owned(),
        bodies: (0..model.nbody()).map(|b| body_name(model, b)).collect(),
        meshes: meshes
            .into_iter()
            .map(|m| MeshFacts {
                body: m.body,
                rgba: m.rgba,
                vertices: m.vertices.into_flattened(),
                faces: m.faces.into_flattened(),
            })
            .collect(),
        home,
    })
}

fn axis(model: &Model, joint: usize) -> AxisFacts {
    let at = |a: &[f64], k: usize| a[3 * joint + k];
    AxisFacts {
        body: index(model.jnt_bodyid()[joint]),
        pos: [0, 1, 2].map(|k| at(model.jnt_pos(), k)),
        axis: [0, 1, 2].map(|k| at(model.jnt_axis(), k)),
    }
}

fn site(model: &Model, name: &str) -> Option<SiteFacts> {
    let id = model.id(Kind::Site, name)?;
    let body = index(model.site_bodyid()[id]);
    let pos = model.site_pos().as_chunks::<3>().0[id];
    let quat = model.site_quat().as_chunks::<4>().0[id];
    Some(SiteFacts { name: name.to_owned(), body, pos, quat })
}

/// Body transforms at a state; (nbody, 7).
pub(crate) fn transforms(
    robot: &Robot,
    data: &mut Data,
    state: &[f64],
) -> Result<Vec<f32>, robot::Error> {
    robot.write_state(data, state)?;
    data.kinematics()?;
    let mut out = Vec::with_capacity(7 * robot.model().nbody());
    for (p, q) in data.xpos().chunks_exact(3).zip(data.xquat().chunks_exact(4)) {
        out.extend(p.iter().chain(q).map(|v| *v as f32));
    }
    Ok(out)
}

/// Searches from elsewhere while a point is dragged; few, because each answer is waited for.
const RESTARTS: u32 = 2;

/// Inverse kinematics.
pub(crate) fn ik(
    robot: &Robot,
    data: &mut Data,
    request: &IkRequest,
) -> Result<IkAnswer, robot::Error> {
    let locked =
        request.locked.iter().map(|j| robot.joint_index(j)).collect::<Result<Vec<_>, _>>()?;
    let point = match request.body.clone() {
        Some((body, offset)) => Point::Body { body, offset },
        None => Point::Site(request.site.clone()),
    };
    let mut targets: Vec<Target> =
        request.pos.map(|pos| Target { point, pos, quat: request.quat }).into_iter().collect();
    let mut pairs = Vec::new();
    for pin in &request.pins {
        let point = Point::Site(pin.site.clone());
        match (&pin.to, pin.pos) {
            (Some(to), _) => pairs.push((point, Point::Site(to.clone()))),
            (None, Some(pos)) => targets.push(Target { point, pos, quat: pin.quat }),
            (None, None) => {}
        }
    }
    let config = IkConfig { locked, restarts: RESTARTS, ..IkConfig::default() };
    let found = robot.ik_meeting(data, &request.q, &targets, &pairs, &config)?;
    data.forward()?;
    let at = |name: &str| -> Result<V3, robot::Error> {
        Ok(data.site_xpos().as_chunks::<3>().0[robot.site(name)?])
    };
    let pin = |pin: &Pin| match (&pin.to, pin.pos) {
        (Some(to), _) => Ok(apart(at(&pin.site)?, at(to)?)),
        (None, Some(pos)) => Ok(apart(at(&pin.site)?, pos)),
        (None, None) => Ok(0.0),
    };
    let pins_m = request.pins.iter().map(pin).collect::<Result<Vec<f64>, robot::Error>>()?;
    let distance_m = match (&request.body, request.pos) {
        (None, Some(pos)) => apart(at(&request.site)?, pos),
        (Some(_), Some(_)) => found.distance_m,
        (_, None) => 0.0,
    };
    let contacts = touching(robot.model(), data);
    Ok(IkAnswer { q: found.state, distance_m, reached: found.reached, pins_m, contacts })
}

fn apart(a: V3, b: V3) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// Bodies that touch, and the depth, m; the deepest first.
fn touching(model: &Model, data: &Data) -> Vec<(String, String, f64)> {
    let body = |geom: usize| body_name(model, index(model.geom_bodyid()[geom]));
    let mut contacts: Vec<(String, String, f64)> = data
        .contacts()
        .filter(|c| c.dist < -TOUCH_M)
        .map(|c| (body(c.geoms[0]), body(c.geoms[1]), -c.dist))
        .collect();
    contacts.sort_by(|a, b| (&a.0, &a.1).cmp(&(&b.0, &b.1)).then(b.2.total_cmp(&a.2)));
    contacts.dedup_by(|later, first| (&later.0, &later.1) == (&first.0, &first.1));
    contacts.sort_by(|a, b| b.2.total_cmp(&a.2));
    contacts
}

/// The pose that settles from `q`.
pub(crate) fn settle(robot: &Robot, q: &[f64]) -> Result<SettleAnswer, robot::Error> {
    let settled = robot.settle(q)?;
    Ok(SettleAnswer {
        q: settled.reached,
        residual: settled.residual,
        worst: settled.worst,
        worst_joint: settled.worst_joint,
        within: settled.within,
    })
}

/// Contacts and residual of a pose.
pub(crate) fn check(robot: &Robot, q: &[f64]) -> Result<Checked, robot::Error> {
    let found = Settler::new(robot)?.examine(q)?;
    Ok(Checked { contacts: found.contacts, settled: found.settled })
}
