//! Checks what a URDF says: names, a tree of links, and numbers that a robot can have.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use roxmltree::Document;

use super::description::{Description, Geometry, Joint, JointType, Link};
use crate::{Error, preparse};

/// Checks names, parents and numbers, and returns the root link.
pub(super) fn check_tree<'a>(
    robot: &'a Description,
    doc: &Document<'_>,
    path: &Path,
) -> Result<&'a Link, Error> {
    let named = |tag: &str, name: &str| {
        doc.root_element()
            .children()
            .rfind(|n| n.has_tag_name(tag) && n.attribute("name") == Some(name))
            .unwrap_or_else(|| doc.root_element())
    };
    let refuse =
        |tag: &str, name: &str, message: String| preparse::refuse(named(tag, name), path, message);
    let mut links = BTreeSet::new();
    for l in &robot.links {
        if l.name.is_empty() || !links.insert(l.name.as_str()) {
            return Err(refuse("link", &l.name, format!("two links are called \"{}\"", l.name)));
        }
    }
    let mut joints = BTreeSet::new();
    let mut parent: BTreeMap<&str, &str> = BTreeMap::new();
    for j in &robot.joints {
        let bad = |message: String| Err(refuse("joint", &j.name, message));
        if j.name.is_empty() || !joints.insert(j.name.as_str()) {
            return bad(format!("two joints are called \"{}\"", j.name));
        }
        for end in [&j.parent, &j.child] {
            if !links.contains(end.as_str()) {
                return bad(format!(
                    "joint \"{}\" names link \"{end}\", which is not there",
                    j.name
                ));
            }
        }
        if let Some(other) = parent.insert(&j.child, &j.parent) {
            return bad(format!(
                "link \"{}\" has two parents, \"{other}\" and \"{}\"; a robot is a tree",
                j.child, j.parent
            ));
        }
        check_joint(j).map_err(|m| refuse("joint", &j.name, m))?;
    }
    for j in &robot.joints {
        if let Some(m) = &j.mimic
            && (!joints.contains(m.joint.as_str()) || m.joint == j.name)
        {
            let message =
                format!("joint \"{}\" mimics \"{}\", which is not another joint", j.name, m.joint);
            return Err(refuse("joint", &j.name, message));
        }
    }
    for l in &robot.links {
        check_link(l).map_err(|m| refuse("link", &l.name, format!("link \"{}\": {m}", l.name)))?;
    }
    let roots: Vec<&Link> =
        robot.links.iter().filter(|l| !parent.contains_key(l.name.as_str())).collect();
    match roots.as_slice() {
        [root] => {
            let reached = reach(robot, &root.name);
            match robot.links.iter().find(|l| !reached.contains(l.name.as_str())) {
                Some(l) => Err(refuse(
                    "link",
                    &l.name,
                    format!(
                        "link \"{}\" hangs on a loop of joints, not on \"{}\"",
                        l.name, root.name
                    ),
                )),
                None => Ok(root),
            }
        }
        [] => Err(preparse::refuse(
            doc.root_element(),
            path,
            "every link has a parent: the joints form a loop",
        )),
        [a, b, ..] => Err(refuse(
            "link",
            &b.name,
            format!(
                "links \"{}\" and \"{}\" both have no parent; a robot has one root",
                a.name, b.name
            ),
        )),
    }
}

fn reach<'a>(robot: &'a Description, root: &'a str) -> BTreeSet<&'a str> {
    let mut seen = BTreeSet::from([root]);
    let mut todo = vec![root];
    while let Some(link) = todo.pop() {
        for j in robot.joints.iter().filter(|j| j.parent == link) {
            if seen.insert(&j.child) {
                todo.push(&j.child);
            }
        }
    }
    seen
}

fn check_joint(j: &Joint) -> Result<(), String> {
    let l = &j.limit;
    let dynamics = j.dynamics.as_ref().map_or([0.0; 2], |d| [d.damping, d.friction]);
    let mut all = vec![l.effort, l.velocity];
    // A continuous joint has no stops, whatever its limits say.
    let stops = j.joint_type != JointType::Continuous;
    all.extend([l.lower, l.upper].into_iter().filter(|_| stops));
    all.extend(j.mimic.iter().flat_map(|m| [m.multiplier, m.offset]).flatten());
    all.extend(dynamics);
    all.extend(j.axis);
    all.extend(j.origin.xyz);
    all.extend(j.origin.rpy);
    if let Some(v) = all.iter().find(|v| !v.is_finite() || v.abs() > 1e9) {
        return Err(format!("joint \"{}\" holds {v}, beyond any physical joint", j.name));
    }
    if stops && l.lower > l.upper {
        return Err(format!(
            "joint \"{}\": lower limit {} is above upper limit {}",
            j.name, l.lower, l.upper
        ));
    }
    let [damping, friction] = dynamics;
    let signs = [
        ("effort", l.effort),
        ("velocity", l.velocity),
        ("damping", damping),
        ("friction", friction),
    ];
    // Some tools write -1 where there is no limit.
    let absent = |name: &str, v: f64| v == -1.0 && ["effort", "velocity"].contains(&name);
    if let Some((name, v)) = signs.into_iter().find(|(name, v)| *v < 0.0 && !absent(name, *v)) {
        return Err(format!("joint \"{}\": {name} {v} is negative", j.name));
    }
    let moves = !matches!(j.joint_type, JointType::Fixed | JointType::Floating);
    if moves && j.axis.iter().map(|v| v * v).sum::<f64>() < 1e-12 {
        return Err(format!("joint \"{}\": the axis is 0 0 0", j.name));
    }
    Ok(())
}

fn check_link(l: &Link) -> Result<(), String> {
    let i = &l.inertial.inertia;
    let mut all = vec![l.inertial.mass, i.ixx, i.iyy, i.izz, i.ixy, i.ixz, i.iyz];
    all.extend(l.inertial.origin.xyz);
    all.extend(l.inertial.origin.rpy);
    for (origin, geometry) in l
        .visual
        .iter()
        .map(|v| (&v.origin, &v.geometry))
        .chain(l.collision.iter().map(|c| (&c.origin, &c.geometry)))
    {
        all.extend(origin.xyz);
        all.extend(origin.rpy);
        let sizes: Vec<f64> = match geometry {
            Geometry::Box { size } => size.to_vec(),
            Geometry::Cylinder { radius, length } | Geometry::Capsule { radius, length } => {
                vec![*radius, *length]
            }
            Geometry::Sphere { radius } => vec![*radius],
            Geometry::Mesh { scale, .. } => scale.map_or_else(Vec::new, |s| s.to_vec()),
        };
        // A mesh may be mirrored, but not flat; other shapes of size 0 are left out later.
        let good = |v: f64| match geometry {
            Geometry::Mesh { .. } => v != 0.0,
            _ => v >= 0.0,
        };
        if let Some(v) = sizes.iter().find(|v| !(v.is_finite() && good(**v))) {
            return Err(format!("a shape has size {v}; sizes are positive"));
        }
    }
    if let Some(v) = all.iter().find(|v| !v.is_finite() || v.abs() > 1e9) {
        return Err(format!("it holds {v}, beyond any physical body"));
    }
    if l.inertial.mass < 0.0 {
        return Err("its mass is negative".into());
    }
    Ok(())
}
