//! Questions about a robot that the child answers without a rollout.

use std::sync::Arc;

use super::{
    BodyFacts, Checked, GeomFacts, Geometry, IkAnswer, MeshFacts, PoseFacts, Report, RobotFacts,
    SettleAnswer, Shape,
};
use crate::clip::{self, CouplingMember, Granularity, JointFacts, JointTable, Mirror};
use crate::exit::HasExit;
use crate::mujoco::{Data, Geom, Kind, Model};
use crate::robot::{self, Coupling, IkConfig, Point, Robot, Target};
use crate::studio::protocol::IkRequest;

/// Geoms of this group and above are for collision only.
const COLLISION_GROUP: i32 = 3;
/// Disagreement of coupled joints that is no fault, rad or m.
const COUPLING_TOLERANCE: f64 = 0.02;
/// Depth of a touch that lints mention, m.
const TOUCH_M: f64 = 5e-4;

/// A robot by builtin id.
pub(super) fn resolve(robot: &str) -> Result<Arc<Robot>, robot::Error> {
    Robot::builtin(robot).map(Arc::new)
}

/// An error as the parent gets it.
pub(super) fn refused(e: &impl HasExit) -> Report {
    Report::Refused { message: e.to_string(), exit: e.exit().code() }
}

/// What clips need to know about a robot.
pub(super) fn table(robot: &Robot) -> JointTable {
    let profile = robot.profile();
    let joints = robot
        .joints()
        .iter()
        .map(|j| JointFacts {
            name: j.name.clone(),
            unit: j.unit,
            range: (!j.unbounded).then_some(j.range),
            speed_max: j.speed_limit.is_finite().then_some(j.speed_limit),
        })
        .collect();
    let mirror = match robot.mirror_reason() {
        Some(reason) => Mirror::None(reason.to_owned()),
        None => Mirror::Table(
            profile
                .mirror
                .table
                .iter()
                .map(|r| clip::MirrorRow {
                    target: r.target.clone(),
                    source: r.source.clone(),
                    sign: r.sign,
                    offset: r.offset,
                })
                .collect(),
        ),
    };
    // A tendon shares a force and leaves the difference free; only a mimic binds values.
    let couplings = profile
        .couplings
        .iter()
        .filter_map(|c| match c {
            Coupling::Tendon { .. } => None,
            Coupling::Mimic { follower, leader, offset, multiplier } => Some(clip::Coupling {
                name: leader.clone(),
                members: vec![
                    CouplingMember { joint: leader.clone(), coef: 1.0, offset: 0.0 },
                    CouplingMember { joint: follower.clone(), coef: *multiplier, offset: *offset },
                ],
                tolerance: COUPLING_TOLERANCE,
            }),
        })
        .collect();
    JointTable {
        robot: robot.id().to_owned(),
        model_sha256: Some(robot.model_sha256().to_owned()),
        joints,
        rest: robot.home(),
        mirror,
        couplings,
        granularity: Granularity::State,
    }
}

/// Everything a page needs to know.
pub(super) fn facts(robot: &Robot) -> RobotFacts {
    let profile = robot.profile();
    let model = robot.model();
    let mut poses: Vec<PoseFacts> = robot
        .pose_names()
        .filter_map(|name| Some(PoseFacts { name: name.to_owned(), q: robot.pose(name).ok()? }))
        .collect();
    poses.sort_by_key(|p| p.name != profile.home);
    RobotFacts {
        id: robot.id().to_owned(),
        title: profile.title.clone(),
        about: profile.about.clone(),
        licence: profile.licence.clone(),
        table: table(robot),
        groups: profile.groups.clone(),
        actuators: robot.actuators().iter().map(|a| a.name.clone()).collect(),
        poses,
        ik_sites: profile.ik_sites.clone(),
        camera: profile.camera,
        bodies: bodies(robot, model),
        settle_tolerance: profile.settle.tolerance,
    }
}

fn bodies(robot: &Robot, model: &Model) -> Vec<BodyFacts> {
    (0..model.nbody())
        .map(|b| BodyFacts {
            name: body_name(model, b),
            parent: index(model.body_parentid(), b),
            joints: robot
                .joints()
                .iter()
                .enumerate()
                .filter(|(_, j)| index(model.jnt_bodyid(), j.id) == b)
                .map(|(i, _)| i)
                .collect(),
        })
        .collect()
}

fn body_name(model: &Model, body: usize) -> String {
    model.name(Kind::Body, body).map_or_else(|| format!("body {body}"), str::to_owned)
}

fn index(ids: &[i32], at: usize) -> usize {
    ids.get(at).and_then(|v| usize::try_from(*v).ok()).unwrap_or(0)
}

/// What a robot looks like: its visual geoms, or all where it has no other.
pub(super) fn geometry(robot: &Robot) -> Result<Geometry, robot::Error> {
    let model = robot.scene_model()?;
    let visible = |i: usize| model.geom_color(i).is_some_and(|c| c[3] > 0.0);
    let visual = |i: usize| model.geom_group().get(i).is_some_and(|g| *g < COLLISION_GROUP);
    let solid = |i: usize| model.geom_kind(i) != Some(Geom::Plane);
    let any = (0..model.ngeom()).any(|i| visible(i) && visual(i) && solid(i));
    let geoms = (0..model.ngeom())
        .filter(|&i| visible(i) && (visual(i) || !any))
        .filter_map(|i| geom(model, i))
        .collect();
    Ok(Geometry {
        bodies: (0..model.nbody()).map(|b| body_name(model, b)).collect(),
        geoms,
        meshes: (0..model.nmesh()).map(|i| mesh(model, i)).collect(),
    })
}

fn geom(model: &Model, i: usize) -> Option<GeomFacts> {
    let f = |a: &[f64], k: usize| a.get(k).copied().unwrap_or(0.0) as f32;
    let size = |k: usize| f(model.geom_size(), 3 * i + k);
    let shape = match model.geom_kind(i)? {
        Geom::Plane => Shape::Plane([size(0), size(1)]),
        Geom::Sphere => Shape::Sphere(size(0)),
        Geom::Capsule => Shape::Capsule(size(0), size(1)),
        Geom::Ellipsoid => Shape::Ellipsoid([size(0), size(1), size(2)]),
        Geom::Cylinder => Shape::Cylinder(size(0), size(1)),
        Geom::Box => Shape::Box([size(0), size(1), size(2)]),
        Geom::Mesh => Shape::Mesh(index(model.geom_dataid(), i)),
        Geom::HField => return None,
    };
    Some(GeomFacts {
        body: index(model.geom_bodyid(), i),
        shape,
        pos: [0, 1, 2].map(|k| f(model.geom_pos(), 3 * i + k)),
        quat: [0, 1, 2, 3].map(|k| f(model.geom_quat(), 4 * i + k)),
        rgba: model.geom_color(i)?,
    })
}

fn mesh(model: &Model, i: usize) -> MeshFacts {
    let part = |adr: &[i32], num: &[i32]| {
        let from = 3 * index(adr, i);
        from..from + 3 * index(num, i)
    };
    let vertices = part(model.mesh_vertadr(), model.mesh_vertnum());
    let faces = part(model.mesh_faceadr(), model.mesh_facenum());
    MeshFacts {
        vertices: model.mesh_vert().get(vertices).unwrap_or_default().to_vec(),
        faces: model
            .mesh_face()
            .get(faces)
            .unwrap_or_default()
            .iter()
            .map(|v| u32::try_from(*v).unwrap_or(0))
            .collect(),
    }
}

/// Body transforms at a state; (nbody, 7).
pub(super) fn transforms(
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

/// Inverse kinematics.
pub(super) fn ik(
    robot: &Robot,
    data: &mut Data,
    request: &IkRequest,
) -> Result<IkAnswer, robot::Error> {
    let locked =
        request.locked.iter().map(|j| robot.joint_index(j)).collect::<Result<Vec<_>, _>>()?;
    let target =
        Target { point: Point::Site(request.site.clone()), pos: request.pos, quat: request.quat };
    let config = IkConfig { locked, ..IkConfig::default() };
    let found = robot.ik(data, &request.q, &[target], &config)?;
    Ok(IkAnswer { q: found.state, distance_m: found.distance_m, reached: found.reached })
}

/// Where a pose settles.
pub(super) fn settle(robot: &Robot, q: &[f64]) -> Result<SettleAnswer, robot::Error> {
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
pub(super) fn check(robot: &Robot, q: &[f64]) -> Result<Checked, robot::Error> {
    let mut data = Data::new(robot.model())?;
    robot.write_state(&mut data, q)?;
    data.forward()?;
    let model = robot.model();
    let body = |geom: usize| body_name(model, index(model.geom_bodyid(), geom));
    let mut contacts: Vec<(String, String, f64)> = data
        .contacts()
        .filter(|c| c.dist < -TOUCH_M)
        .map(|c| (body(c.geoms[0]), body(c.geoms[1]), -c.dist))
        .collect();
    contacts.sort_by(|a, b| b.2.total_cmp(&a.2).then_with(|| a.0.cmp(&b.0)));
    contacts.dedup_by(|a, b| (&a.0, &a.1) == (&b.0, &b.1));
    let settled = robot.settle(q).ok().map(|s| s.reached);
    Ok(Checked { contacts, settled })
}
