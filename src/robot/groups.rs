//! Groups of a compiled model: the branches of its body tree.

use super::profile::{Group, JointSpec};
use robert_mujoco::{Kind, Model, index};

/// Branches of the body tree. A body with two or more moving branches ends one group and starts
/// others.
pub(super) fn groups(model: &Model, joints: &[JointSpec]) -> Vec<Group> {
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

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::derive::derive;

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
}
