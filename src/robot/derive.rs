//! Derives facts about a robot from its compiled model.
//!
//! State and action have the model's order. Speed limits are the terminal speeds of the motors
//! against the joints' damping. Groups are the branches of the body tree. Settling gains come from
//! the inertia at the default pose.

use std::collections::BTreeMap;
use std::path::Path;

use super::couplings::couplings;
use super::default_pose::default_pose;
use super::error::Error;
use super::groups::groups;
use super::motors::{ctrlrange, torque_limit};
use super::profile::{
    ActuatorSpec, Camera, Coupling, Drive, FORMAT, JointSpec, MODEL_FILE, MirrorSpec, NEAR_LIMIT,
    PoseSpec, Profile, SettleSpec,
};
use super::tendons::tendon_name;
use robert_base::limits;
use robert_base::units::Unit;
use robert_mujoco::{Joint, Kind, Model, Transmission, index};

/// The most keyframes that become poses.
const MOST_POSES: usize = 100;
/// Speed limit of a joint without one in the model, rad/s or m/s.
const SPEED_DEFAULT: f64 = 10.0;
/// Control steps to settle: three seconds.
pub(super) const SETTLE_FRAMES: u32 = 60;
/// Distance above which a pose counts as not reached, rad or m.
pub(super) const SETTLE_TOLERANCE: f64 = 0.05;
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

/// A sentence about keyframes that become no poses, if there are any.
pub(super) fn poses_left_out(model: &Model) -> Option<String> {
    let all = keys(model);
    (all > MOST_POSES).then(|| {
        format!("the first {MOST_POSES} of {all} keyframes become poses; the others are left out")
    })
}

/// The profile that the model alone implies.
///
/// # Errors
/// [`Error::Unfit`].
pub fn derive(model: &Model, id: &str, path: &Path) -> Result<Profile, Error> {
    let ids = state_joints(model, path)?;
    let actuators = actuators(model);
    let couplings = couplings(model)?;
    let joints = ids.iter().map(|&j| joint(model, j)).collect::<Vec<_>>();
    let mut poses = BTreeMap::new();
    let named = (1..keys(model).min(MOST_POSES))
        .filter_map(|key| Some((model.name(Kind::Key, key)?.to_owned(), key)));
    // A joint that a pose leaves out stands as at home, so zeros are written.
    poses.extend(named.map(|(name, key)| (name, spec(&joints, key_pose(model, &joints, key)))));
    let mut home = model.name(Kind::Key, 0).unwrap_or("rest").to_owned();
    while poses.contains_key(&home) {
        home.push('_');
    }
    let mut at_home = home_pose(model, &joints, &couplings);
    at_home.retain(|_, value| *value != 0.0);
    poses.insert(home.clone(), at_home);
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

/// The number of keyframes of the model.
fn keys(model: &Model) -> usize {
    model.key_qpos().len() / model.nq().max(1)
}

/// A keyframe of the model, moved into the limits; `None` for joints outside the state.
fn key_pose(model: &Model, joints: &[JointSpec], key: usize) -> Vec<Option<f64>> {
    values(model, joints, &model.key_qpos()[key * model.nq()..][..model.nq()])
}

/// Joint positions within the limits.
fn values(model: &Model, joints: &[JointSpec], qpos: &[f64]) -> Vec<Option<f64>> {
    let value =
        |(j, adr): (&JointSpec, &i32)| Some(within(j, *qpos.get(usize::try_from(*adr).ok()?)?));
    joints.iter().zip(model.jnt_qposadr()).map(value).collect()
}

fn within(j: &JointSpec, v: f64) -> f64 {
    j.range.map_or(v, |[lo, hi]| v.clamp(lo, hi))
}

/// A pose as a profile has it.
fn spec(joints: &[JointSpec], values: Vec<Option<f64>>) -> PoseSpec {
    let named = |(j, v): (&JointSpec, Option<f64>)| v.map(|v| (j.name.clone(), v));
    joints.iter().zip(values).filter_map(named).collect()
}

/// The first keyframe of the model, moved into the limits. Without a keyframe it is the model's
/// reference pose, with joints that follow others at the values that these give them.
fn home_pose(model: &Model, joints: &[JointSpec], couplings: &[Coupling]) -> PoseSpec {
    let mut home = values(model, joints, &default_pose(model));
    if keys(model) > 0 {
        return spec(joints, home);
    }
    let at = |name: &str| joints.iter().position(|j| j.name == name);
    // A chain of followers is at most as long as the robot.
    for _ in 0..joints.len() {
        for coupling in couplings {
            let Coupling::Mimic { follower, leader, offset, multiplier } = coupling else {
                continue;
            };
            if let (Some(f), Some(l)) = (at(follower), at(leader)) {
                home[f] = home[l].map(|v| within(&joints[f], offset + multiplier * v));
            }
        }
    }
    spec(joints, home)
}

#[cfg(test)]
mod tests {
    use super::*;

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
