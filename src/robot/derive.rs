//! Derives facts about a robot from its compiled model.
//!
//! State and action have the model's order. Speed limits are the terminal speeds of the motors
//! against the joints' damping. Groups are the branches of the body tree. Settling gains come from
//! the inertia at the default pose.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use nalgebra::DMatrix;

use super::error::Error;
use super::profile::{
    ActuatorSpec, Camera, Coupling, Drive, FORMAT, Group, JointSpec, MODEL_FILE, MirrorSpec,
    NEAR_LIMIT, OneOrMany, PoseSpec, Profile, SettleSpec, Written,
};
use super::ties::{Tie, ties};
use robert_base::limits;
use robert_base::units::Unit;
use robert_mujoco::{Data, Joint, Kind, Model, Transmission, index};

/// Speed limit of a joint without one in the model, rad/s or m/s.
const SPEED_DEFAULT: f64 = 10.0;
/// Control steps to settle: three seconds.
const SETTLE_FRAMES: u32 = 60;
/// Distance above which a pose counts as not reached, rad or m.
const SETTLE_TOLERANCE: f64 = 0.05;
/// Bandwidth of the settling drive, 1/s: slow compared with the 5 ms step, fast compared with the
/// three seconds of settling.
const SETTLE_RATE: f64 = 10.0;
/// Time constant of the settling drive on joints with dominant damping, seconds.
const SETTLE_TAU_SECS: f64 = 0.05;

/// Ids of the joints of the state.
///
/// # Errors
/// [`Error::Unfit`] for free and ball joints, joints without a name or with the same name, or no
/// joints.
pub(super) fn state_joints(model: &Model, path: &Path) -> Result<Vec<usize>, Error> {
    let unfit = |message: String| Err(Error::Unfit { message, path: path.to_owned() });
    let n = model.jnt_type().len();
    if n == 0 {
        return unfit("the model has no joints, so nothing can move".into());
    }
    if n > limits::JOINTS {
        return unfit(format!("{n} joints; at most {} are supported", limits::JOINTS));
    }
    for id in 0..n {
        let name = model.name(Kind::Joint, id);
        let called = || name.map_or_else(|| format!("joint {id}"), |n| format!("joint \"{n}\""));
        match model.joint_type(id) {
            Some(Joint::Hinge | Joint::Slide) => {}
            Some(Joint::Free) => {
                return unfit(format!(
                    "{} floats freely; the state takes hinge and slide joints only. \
                     To hold the base still: robert import --fixed-base",
                    called()
                ));
            }
            _ => {
                return unfit(format!(
                    "{} is a ball joint; the state takes hinge and slide joints only. \
                     Replace it by three hinges, or hold it still: --weld {}",
                    called(),
                    name.unwrap_or("JOINT")
                ));
            }
        }
        if name.is_none() {
            return unfit(format!(
                "joint {id} has no name; give every joint one (robert import does)"
            ));
        }
    }
    Ok((0..n).collect())
}

/// Completes the written profile with derived values, and checks one against the other.
pub(super) fn complete(
    written: Written,
    model: &Model,
    id: &str,
    path: &Path,
) -> Result<Profile, Error> {
    let derived = derive(model, id, path)?;
    let mismatch = |message: String| Error::Mismatch { message, path: path.to_owned() };
    let joints = match written.joints {
        None => derived.joints,
        Some(list) => join_joints(&list, derived.joints).map_err(mismatch)?,
    };
    if let Some(list) = &written.actuators
        && !same_actuators(list, &derived.actuators)
    {
        return Err(mismatch(format!(
            "the actuators differ from the model's: {}",
            first_difference(list, &derived.actuators)
        )));
    }
    if let Some(list) = &written.couplings
        && *list != derived.couplings
        // Older profiles list every tendon.
        && *list != couplings(model, false)?
    {
        return Err(mismatch(
            "the couplings differ from the tendons and equalities of the model; \
             leave them out to derive them"
                .into(),
        ));
    }
    let known = |name: &str| joints.iter().any(|j| j.name == name);
    let groups = written.groups.unwrap_or(derived.groups);
    for g in &groups {
        if let Some(j) = g.joints.iter().find(|j| !known(j)) {
            return Err(mismatch(format!(
                "group \"{}\" contains joint \"{j}\", which the model does not have",
                g.name
            )));
        }
    }
    let mirror = written.mirror.unwrap_or(derived.mirror);
    check_mirror(&mirror, &known).map_err(mismatch)?;
    let ik_sites = written.ik_sites.unwrap_or(derived.ik_sites);
    if let Some(s) = ik_sites.iter().find(|s| model.id(Kind::Site, s).is_none()) {
        return Err(mismatch(format!("ik_sites contains \"{s}\", which the model does not have")));
    }
    let mut poses = derived.poses;
    let own_home = written.home.is_some() || written.poses.contains_key(&derived.home);
    if own_home {
        poses.clear();
    }
    poses.extend(written.poses);
    let home = written.home.unwrap_or(derived.home);
    if !poses.contains_key(&home) {
        return Err(mismatch(format!("home is \"{home}\", but there is no such pose")));
    }
    check_poses(&poses, &joints).map_err(mismatch)?;
    let camera = written.camera.unwrap_or(derived.camera);
    check_camera(&camera).map_err(mismatch)?;
    let many = |value: Option<OneOrMany>, derived: Vec<f64>, what: &str| {
        let list = match value {
            None => derived,
            Some(OneOrMany::One(v)) => vec![v; joints.len()],
            Some(OneOrMany::Many(list)) => list,
        };
        if list.len() != joints.len() {
            return Err(mismatch(format!(
                "settle.{what} has {} values for {} joints",
                list.len(),
                joints.len()
            )));
        }
        match list.iter().find(|v| !(v.is_finite() && **v >= 0.0)) {
            Some(v) => Err(mismatch(format!(
                "settle.{what} contains {v}; gains must be finite and not negative"
            ))),
            None => Ok(list),
        }
    };
    let settle = SettleSpec {
        kp: many(written.settle.kp, derived.settle.kp, "kp")?,
        kd: many(written.settle.kd, derived.settle.kd, "kd")?,
        frames: written.settle.frames.unwrap_or(SETTLE_FRAMES).clamp(1, limits::CLIP_FRAMES),
        tolerance: written.settle.tolerance.unwrap_or(SETTLE_TOLERANCE),
    };
    Ok(Profile {
        format: FORMAT.to_owned(),
        id: written.id.map_or(derived.id, toml::Spanned::into_inner),
        title: written.title.unwrap_or(derived.title),
        about: written.about.unwrap_or(derived.about),
        licence: written.licence.unwrap_or(derived.licence),
        model: written.model.unwrap_or(derived.model),
        home,
        near_limit: written.near_limit.unwrap_or(NEAR_LIMIT),
        physics: written.physics,
        actuators: derived.actuators,
        couplings: derived.couplings,
        joints,
        groups,
        mirror,
        ik_sites,
        camera,
        settle,
        poses,
    })
}

/// The profile that the model alone implies.
///
/// # Errors
/// [`Error::Unfit`].
pub fn derive(model: &Model, id: &str, path: &Path) -> Result<Profile, Error> {
    let ids = state_joints(model, path)?;
    let actuators = actuators(model);
    let couplings = couplings(model, true)?;
    let joints = ids.iter().map(|&j| joint(model, j)).collect::<Vec<_>>();
    let mut poses = BTreeMap::new();
    let home = model.name(Kind::Key, 0).unwrap_or("rest").to_owned();
    poses.insert(home.clone(), home_pose(model, &joints, &couplings));
    Ok(Profile {
        format: FORMAT.to_owned(),
        id: id.to_owned(),
        title: id.to_owned(),
        about: String::new(),
        licence: String::new(),
        model: MODEL_FILE.to_owned(),
        home,
        near_limit: NEAR_LIMIT,
        physics: super::profile::Physics::default(),
        actuators,
        couplings,
        groups: groups(model, &joints),
        mirror: MirrorSpec {
            table: Vec::new(),
            none: "the profile has no mirror table".to_owned(),
        },
        ik_sites: ik_sites(model),
        camera: camera(model),
        settle: settle(model),
        joints,
        poses,
    })
}

fn joint(model: &Model, id: usize) -> JointSpec {
    let limited = model.jnt_limited().get(id).is_some_and(|l| *l != 0);
    let range = model.jnt_range().get(2 * id..2 * id + 2);
    JointSpec {
        name: model.name(Kind::Joint, id).unwrap_or_default().to_owned(),
        unit: if model.joint_type(id) == Some(Joint::Slide) { Unit::M } else { Unit::Rad },
        range: range.filter(|_| limited).and_then(|r| r.try_into().ok()),
        speed_limit: speed_limit(model, id),
        top_speed: None,
        acceleration_limit: None,
    }
}

/// Force of the motors of a joint divided by its damping: the speed at which the motor has no
/// torque left. Gravity is left out; an import measures the speed instead.
fn speed_limit(model: &Model, joint: usize) -> f64 {
    let damping = model.dof_damping()[model.jnt_dofadr()[joint] as usize];
    match torque_limit(model, joint) {
        Some(force) if damping > 0.0 && force > 0.0 => digits(force / damping, 6),
        _ => SPEED_DEFAULT,
    }
}

/// Rounds to `n` significant digits, which are enough for a limit.
pub(super) fn digits(v: f64, n: i32) -> f64 {
    if v <= 0.0 || !v.is_finite() {
        return 0.0;
    }
    let scale = 10_f64.powi(n - 1 - v.log10().floor() as i32);
    (v * scale).round() / scale
}

/// Greatest torque of the motors of a joint, N m or N; `None` if it has none.
pub(super) fn torque_limit(model: &Model, joint: usize) -> Option<f64> {
    let mut force = None;
    for a in 0..model.nu() {
        if !is_motor(model, a) {
            continue;
        }
        let lever = match model.transmission(a) {
            Some(Transmission::Joint(j)) if j == joint => 1.0,
            Some(Transmission::Tendon(t)) => tendon_joints(model, t)
                .into_iter()
                .find(|(j, _)| *j == joint)
                .map_or(0.0, |(_, c)| c.abs()),
            _ => continue,
        };
        let limit = ctrlrange(model, a).map_or(0.0, |[lo, hi]| lo.abs().max(hi.abs()));
        let gear = model.actuator_gear()[6 * a].abs();
        let gain = model.actuator_gainprm()[10 * a].abs();
        if lever > 0.0 {
            *force.get_or_insert(0.0) += limit * gear * gain * lever;
        }
    }
    force
}

/// Greatest torque of the motors of a joint in the weaker direction, N m or N; that of the other one for a
/// joint that is only pulled one way. `None` if it has no motor.
pub(super) fn weaker_torque(model: &Model, joint: usize) -> Option<f64> {
    let (mut down, mut up) = (0.0, 0.0);
    for a in (0..model.nu()).filter(|a| is_motor(model, *a)) {
        let lever = match model.transmission(a) {
            Some(Transmission::Joint(j)) if j == joint => 1.0,
            Some(Transmission::Tendon(t)) => {
                let own = tendon_joints(model, t).into_iter().find(|(j, _)| *j == joint);
                own.map_or(0.0, |(_, c)| c)
            }
            _ => continue,
        };
        let factor = lever * model.actuator_gear()[6 * a] * model.actuator_gainprm()[10 * a];
        let [lo, hi] = ctrlrange(model, a).unwrap_or_default().map(|c| c * factor);
        down += -lo.min(hi).min(0.0);
        up += lo.max(hi).max(0.0);
    }
    let (weaker, stronger) = (f64::min(down, up), f64::max(down, up));
    Some(if weaker > 0.0 { weaker } else { stronger }).filter(|t| *t > 0.0)
}

/// Whether an actuator's control is a force: fixed gain, no bias, no dynamics.
pub(super) fn is_motor(model: &Model, actuator: usize) -> bool {
    let zero = |v: &[i32]| v.get(actuator).is_some_and(|t| *t == 0);
    zero(model.actuator_gaintype())
        && zero(model.actuator_biastype())
        && zero(model.actuator_dyntype())
}

/// The control range of an actuator; `None` if the model sets no limit.
pub(super) fn ctrlrange(model: &Model, actuator: usize) -> Option<[f64; 2]> {
    let limited = model.actuator_ctrllimited().get(actuator).is_some_and(|l| *l != 0);
    let range = model.actuator_ctrlrange().get(2 * actuator..2 * actuator + 2)?;
    range.try_into().ok().filter(|_| limited)
}

fn actuators(model: &Model) -> Vec<ActuatorSpec> {
    (0..model.nu())
        .map(|a| {
            let drive = match model.transmission(a) {
                Some(Transmission::Joint(j)) => {
                    Drive::Joint(model.name(Kind::Joint, j).unwrap_or_default().to_owned())
                }
                Some(Transmission::Tendon(t)) => Drive::Tendon(tendon_name(model, t)),
                _ => Drive::Other("site or body".to_owned()),
            };
            let name = match (model.name(Kind::Actuator, a), &drive) {
                (Some(n), _) => n.to_owned(),
                (None, Drive::Joint(n) | Drive::Tendon(n)) => n.clone(),
                (None, Drive::Other(_)) => format!("actuator_{a}"),
            };
            ActuatorSpec { name, drive, ctrlrange: ctrlrange(model, a).unwrap_or([-1.0, 1.0]) }
        })
        .collect()
}

pub(super) fn tendon_name(model: &Model, t: usize) -> String {
    model.name(Kind::Tendon, t).map_or_else(|| format!("tendon_{t}"), str::to_owned)
}

/// Joints and coefficients of a fixed tendon; empty for spatial ones.
pub(super) fn tendon_joints(model: &Model, t: usize) -> Vec<(usize, f64)> {
    const WRAP_JOINT: i32 = 1; // mjWRAP_JOINT
    let (adr, num) = (index(model.tendon_adr()[t]), index(model.tendon_num()[t]));
    (adr..adr + num)
        .filter(|&w| model.wrap_type().get(w) == Some(&WRAP_JOINT))
        .filter_map(|w| {
            let joint = usize::try_from(*model.wrap_objid().get(w)?).ok()?;
            Some((joint, *model.wrap_prm().get(w)?))
        })
        .collect()
}

/// Joints that one actuator moves together: those of a tendon, and of an equality. With `only_tied`
/// tendons are left out whose joints other actuators set apart.
fn couplings(model: &Model, only_tied: bool) -> Result<Vec<Coupling>, Error> {
    let joint_name = |j: usize| model.name(Kind::Joint, j).unwrap_or_default().to_owned();
    let mut found = Vec::new();
    let arms = (only_tied && model.ntendon() > 0).then(|| MomentArms::of(model)).transpose()?;
    for t in 0..model.ntendon() {
        let members = tendon_joints(model, t);
        if members.len() < 2 || arms.as_ref().is_some_and(|a| a.moves_each(&members)) {
            continue;
        }
        let limited = model.tendon_limited().get(t).is_some_and(|l| *l != 0);
        let range = model.tendon_range().get(2 * t..2 * t + 2);
        found.push(Coupling::Tendon {
            name: tendon_name(model, t),
            joints: members.iter().map(|(j, _)| joint_name(*j)).collect(),
            coefs: members.iter().map(|(_, c)| *c).collect(),
            range: range.filter(|_| limited).and_then(|r| r.try_into().ok()),
        });
    }
    for Tie { follower, leader, polynomial: [offset, multiplier, curve @ ..] } in ties(model) {
        if curve == [0.0; 3] {
            found.push(Coupling::Mimic {
                follower: joint_name(follower),
                leader: joint_name(leader),
                offset,
                multiplier,
            });
        }
    }
    Ok(found)
}

/// How far the actuators pull at each joint in the model's first pose; (nu, nv).
struct MomentArms {
    moments: DMatrix<f64>,
    dofs: Vec<usize>,
}

impl MomentArms {
    /// The smallest singular value of normalised moments that counts as a direction of its own.
    const LEAST: f64 = 1e-3;

    fn of(model: &Model) -> Result<MomentArms, Error> {
        let mut data = Data::new(&Arc::new(model.duplicate()?))?;
        data.forward()?;
        let (nu, nv) = (model.nu(), model.nv());
        let mut moments = DMatrix::from_row_slice(nu, nv, data.actuator_moment());
        for mut row in moments.row_iter_mut() {
            let norm = row.norm();
            if norm > 0.0 {
                row /= norm;
            }
        }
        Ok(MomentArms { moments, dofs: model.jnt_dofadr().iter().map(|a| index(*a)).collect() })
    }

    /// Whether the actuators move each of these joints by itself, as the two motors of a differential
    /// do.
    fn moves_each(&self, members: &[(usize, f64)]) -> bool {
        if self.moments.nrows() < members.len() || !self.moments.iter().all(|m| m.is_finite()) {
            return false;
        }
        let columns = members.iter().map(|(j, _)| self.moments.column(self.dofs[*j]));
        let own = DMatrix::from_columns(&columns.collect::<Vec<_>>());
        own.rank(MomentArms::LEAST) == members.len()
    }
}

/// Branches of the body tree. A body with two or more moving branches ends one group and starts
/// others.
fn groups(model: &Model, joints: &[JointSpec]) -> Vec<Group> {
    let n = model.nbody();
    let parent = |b: usize| index(model.body_parentid()[b]);
    // Bodies are in depth-first order: children come after their parents.
    let mut moving = vec![false; n];
    let mut branches = vec![0_u32; n];
    for b in (1..n).rev() {
        if model.body_jntnum()[b] > 0 || moving[b] {
            moving[parent(b)] = true;
            branches[parent(b)] += 1;
        }
    }
    let mut root = vec![0_usize; n];
    for b in 1..n {
        let p = parent(b);
        root[b] = if branches[p] > 1 || root[p] == 0 { b } else { root[p] };
    }
    let mut found: Vec<(usize, Vec<String>)> = Vec::new();
    for (j, spec) in joints.iter().enumerate() {
        let limb = root[index(model.jnt_bodyid()[j])];
        match found.iter_mut().find(|(l, _)| *l == limb) {
            Some((_, list)) => list.push(spec.name.clone()),
            None => found.push((limb, vec![spec.name.clone()])),
        }
    }
    let mut groups: Vec<Group> = Vec::new();
    for (limb, joints) in found {
        let mut name = common_prefix(&joints);
        if name.is_empty() || groups.iter().any(|g| g.name == name) {
            model.name(Kind::Body, limb).unwrap_or("all").clone_into(&mut name);
        }
        if groups.iter().any(|g| g.name == name) {
            name = format!("{name}_{limb}");
        }
        groups.push(Group { title: name.clone(), name, joints });
    }
    groups
}

/// The common prefix of all names, without a trailing "J", separator or digit.
fn common_prefix(names: &[String]) -> String {
    let Some(first) = names.first() else { return String::new() };
    if names.len() == 1 {
        return first.clone();
    }
    let len = first
        .char_indices()
        .find(|(i, c)| names.iter().any(|n| n.get(*i..).and_then(|s| s.chars().next()) != Some(*c)))
        .map_or(first.len(), |(i, _)| i);
    let shared = first.get(..len).unwrap_or_default();
    let cut = shared.trim_end_matches(|c: char| c.is_ascii_digit() || "_-./".contains(c));
    let cut = if cut.len() > 2 { cut.strip_suffix('J').unwrap_or(cut) } else { cut };
    cut.trim_end_matches(['_', '-', '.', '/']).to_owned()
}

/// Sites at the far end of a branch (no moving body below them); all sites if there is none.
fn ik_sites(model: &Model) -> Vec<String> {
    let n = model.nbody();
    let mut inner = vec![false; n];
    for b in 1..n {
        let moves = model.body_jntnum()[b] > 0;
        let mut up = b;
        while moves && up != 0 {
            up = index(model.body_parentid()[up]);
            inner[up] = true;
        }
    }
    let named = |only_tips: bool| {
        (0..model.nsite())
            .filter(|&s| {
                let body = model.site_bodyid().get(s).and_then(|b| usize::try_from(*b).ok());
                !only_tips || body.and_then(|b| inner.get(b)).is_some_and(|i| !*i)
            })
            .filter_map(|s| model.name(Kind::Site, s).map(str::to_owned))
            .collect::<Vec<_>>()
    };
    let tips = named(true);
    if tips.is_empty() { named(false) } else { tips }
}

fn camera(model: &Model) -> Camera {
    Camera {
        lookat: model.center(),
        distance: (2.6 * model.extent()).clamp(0.05, 1e3),
        azimuth_rad: 2.4,
        elevation_rad: -0.35,
        fovy_rad: 0.785,
    }
}

fn settle(model: &Model) -> SettleSpec {
    let (mut kp, mut kd) = (Vec::new(), Vec::new());
    for dof in model.jnt_dofadr().iter().map(|d| *d as usize) {
        let inertia = model.dof_M0()[dof];
        let damping = model.dof_damping()[dof];
        let stiff = (SETTLE_RATE * SETTLE_RATE * inertia).max(damping / SETTLE_TAU_SECS);
        let own = (2.0 * (stiff * inertia).sqrt() - damping).max(0.0);
        kp.push(digits(stiff, 4));
        kd.push(digits(own, 4));
    }
    SettleSpec { kp, kd, frames: SETTLE_FRAMES, tolerance: SETTLE_TOLERANCE }
}

/// The first keyframe of the model, moved into the limits. Without a keyframe it is the model's
/// reference pose, with joints that follow others at the values that these give them.
fn home_pose(model: &Model, joints: &[JointSpec], couplings: &[Coupling]) -> PoseSpec {
    let key = model.key_qpos().get(..model.nq()).filter(|k| !k.is_empty());
    let qpos = key.unwrap_or_else(|| model.qpos0());
    let within = |j: &JointSpec, v: f64| j.range.map_or(v, |[lo, hi]| v.clamp(lo, hi));
    let value =
        |(j, adr): (&JointSpec, &i32)| Some(within(j, *qpos.get(usize::try_from(*adr).ok()?)?));
    let mut home: Vec<Option<f64>> = joints.iter().zip(model.jnt_qposadr()).map(value).collect();
    let at = |name: &str| joints.iter().position(|j| j.name == name);
    // A chain of followers is at most as long as the robot.
    for _ in 0..if key.is_none() { joints.len() } else { 0 } {
        for coupling in couplings {
            let Coupling::Mimic { follower, leader, offset, multiplier } = coupling else {
                continue;
            };
            if let (Some(f), Some(l)) = (at(follower), at(leader)) {
                home[f] = home[l].map(|v| within(&joints[f], offset + multiplier * v));
            }
        }
    }
    let named = |(j, v): (&JointSpec, Option<f64>)| v.map(|v| (j.name.clone(), v));
    joints.iter().zip(home).filter_map(named).filter(|(_, v)| *v != 0.0).collect()
}

fn join_joints(
    written: &[super::profile::WrittenJoint],
    derived: Vec<JointSpec>,
) -> Result<Vec<JointSpec>, String> {
    if written.len() != derived.len() {
        return Err(format!(
            "the profile lists {} joints, but the model has {}",
            written.len(),
            derived.len()
        ));
    }
    written
        .iter()
        .zip(derived)
        .map(|(w, d)| {
            if w.name != d.name {
                return Err(format!(
                    "joint \"{}\" is listed where the model has \"{}\"",
                    w.name, d.name
                ));
            }
            if w.unit.is_some_and(|u| u != d.unit) {
                return Err(format!(
                    "joint \"{}\" has unit {} in the model",
                    d.name,
                    d.unit.symbol()
                ));
            }
            if let Some(r) = w.range
                && !d.range.is_some_and(|m| close(m, r))
            {
                return Err(match d.range {
                    Some([lo, hi]) => {
                        format!("joint \"{}\" has range {lo} to {hi} in the model", d.name)
                    }
                    None => format!("joint \"{}\" has no limits in the model", d.name),
                });
            }
            for (what, v) in [
                ("speed_limit", w.speed_limit),
                ("top_speed", w.top_speed),
                ("acceleration_limit", w.acceleration_limit),
            ] {
                if let Some(v) = v.filter(|v| !(v.is_finite() && *v > 0.0)) {
                    return Err(format!(
                        "{what} of joint \"{}\" is {v}; it must be positive",
                        d.name
                    ));
                }
            }
            let speed_limit = w.speed_limit.unwrap_or(d.speed_limit);
            let (top_speed, acceleration_limit) = (w.top_speed, w.acceleration_limit);
            Ok(JointSpec { speed_limit, top_speed, acceleration_limit, ..d })
        })
        .collect()
}

fn close(a: [f64; 2], b: [f64; 2]) -> bool {
    a.iter().zip(&b).all(|(x, y)| (x - y).abs() <= 1e-9 * x.abs().max(1.0))
}

fn same_actuators(a: &[ActuatorSpec], b: &[ActuatorSpec]) -> bool {
    a.len() == b.len()
        && a.iter()
            .zip(b)
            .all(|(x, y)| x.name == y.name && x.drive == y.drive && close(x.ctrlrange, y.ctrlrange))
}

fn first_difference(a: &[ActuatorSpec], b: &[ActuatorSpec]) -> String {
    if a.len() != b.len() {
        return format!("{} listed, {} in the model", a.len(), b.len());
    }
    a.iter()
        .zip(b)
        .find(|(x, y)| !same_actuators(&[(*x).clone()], &[(*y).clone()]))
        .map_or_else(String::new, |(x, y)| format!("{x:?} listed, {y:?} in the model"))
}

fn check_mirror(mirror: &MirrorSpec, known: &dyn Fn(&str) -> bool) -> Result<(), String> {
    match (mirror.table.is_empty(), mirror.none.is_empty()) {
        (true, true) => return Err("mirror needs a table, or a reason in \"none\"".into()),
        (false, false) => return Err("mirror has both a table and a reason for none".into()),
        _ => {}
    }
    let mut seen = std::collections::BTreeSet::new();
    for row in &mirror.table {
        for name in [&row.target, &row.source] {
            if !known(name) {
                return Err(format!(
                    "mirror names joint \"{name}\", which the model does not have"
                ));
            }
        }
        if !seen.insert(&row.target) {
            return Err(format!("mirror sets joint \"{}\" twice", row.target));
        }
        if row.sign.abs() != 1.0 || !row.offset.is_finite() {
            return Err(format!(
                "mirror row of \"{}\": sign must be 1 or -1, and offset must be finite",
                row.target
            ));
        }
    }
    Ok(())
}

fn check_poses(poses: &BTreeMap<String, PoseSpec>, joints: &[JointSpec]) -> Result<(), String> {
    for (pose, values) in poses {
        for (name, value) in values {
            let Some(j) = joints.iter().find(|j| j.name == *name) else {
                return Err(format!(
                    "pose \"{pose}\" names joint \"{name}\", which the model does not have"
                ));
            };
            if !value.is_finite() {
                return Err(format!("pose \"{pose}\" has {value} for joint \"{name}\""));
            }
            if let Some([lo, hi]) = j.range
                && !(lo - 1e-9..=hi + 1e-9).contains(value)
            {
                return Err(format!(
                    "pose \"{pose}\" has joint \"{name}\" at {value}, outside {lo} to {hi}"
                ));
            }
        }
    }
    Ok(())
}

fn check_camera(c: &Camera) -> Result<(), String> {
    let all = [c.lookat[0], c.lookat[1], c.lookat[2], c.azimuth_rad, c.elevation_rad];
    let good = all.iter().all(|v| v.is_finite())
        && (1e-3..=1e4).contains(&c.distance)
        && (0.02..=3.0).contains(&c.fovy_rad);
    good.then_some(()).ok_or_else(|| {
        "camera: angles must be finite, distance 0.001 to 10000 m, fovy_rad 0.02 to 3".to_owned()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prefixes_read_like_names() {
        let p = |names: &[&str]| {
            common_prefix(&names.iter().map(|s| (*s).to_owned()).collect::<Vec<_>>())
        };
        assert_eq!(p(&["FFJ4", "FFJ3"]), "FF");
        assert_eq!(p(&["left_hip", "left_knee"]), "left");
        assert_eq!(p(&["a", "b"]), "");
        assert_eq!(p(&["solo"]), "solo");
    }

    #[test]
    fn branches_become_groups() {
        let m = Model::from_xml(
            r#"<mujoco><worldbody><body name="trunk"><joint name="waist"/><geom size=".1"/>
              <body name="arm"><joint name="l_a"/><geom size=".1"/><body><joint name="l_b"/><geom size=".1"/></body></body>
              <body name="leg"><joint name="x"/><geom size=".1"/><body><joint name="y"/><geom size=".1"/></body></body>
            </body></worldbody></mujoco>"#,
        )
        .unwrap();
        let p = derive(&m, "t", Path::new("t")).unwrap();
        let g: Vec<_> = p.groups.iter().map(|g| (g.name.as_str(), g.joints.len())).collect();
        assert_eq!(g, [("waist", 1), ("l", 2), ("leg", 2)]);
    }

    #[test]
    fn at_home_a_follower_stands_where_its_leader_puts_it() {
        let text = |key: &str| {
            format!(
                r#"<mujoco><compiler angle="radian"/><worldbody><body><joint name="a" range=".5 1" limited="true"/><geom size=".1"/>
              <body><joint name="b"/><geom size=".1"/><body><joint name="c"/><geom size=".1"/></body></body></body></worldbody>
              <equality><joint joint1="c" joint2="b" polycoef="0 2 0 0 0"/><joint joint1="b" joint2="a" polycoef=".7 1 0 0 0"/></equality>
              {key}</mujoco>"#
            )
        };
        let home = |key| {
            let model = Model::from_xml(&text(key)).unwrap();
            derive(&model, "t", Path::new("t")).unwrap().poses.into_values().next().unwrap()
        };
        let rest = home("");
        assert_eq!((rest["a"], rest["b"], rest["c"]), (0.5, 1.2, 2.4));
        let key = home(r#"<keyframe><key name="k" qpos=".6 .1 .2"/></keyframe>"#);
        assert_eq!((key["a"], key["b"], key["c"]), (0.6, 0.1, 0.2), "a keyframe is kept as it is");
    }
}
