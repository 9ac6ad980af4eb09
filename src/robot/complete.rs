//! Completes a written profile with what its model implies, and checks one against the other.

use std::collections::BTreeMap;
use std::path::Path;

use super::couplings::older;
use super::derive::{SETTLE_FRAMES, SETTLE_TOLERANCE, derive};
use super::error::Error;
use super::profile::{
    ActuatorSpec, Camera, FORMAT, JointSpec, MirrorSpec, NEAR_LIMIT, OneOrMany, PoseSpec, Profile,
    SettleSpec, Written,
};
use robert_base::limits;
use robert_mujoco::{Kind, Model};

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
        && !older(model)?.contains(list)
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
