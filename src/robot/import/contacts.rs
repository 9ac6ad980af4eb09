//! Pairs of bodies that must not be tested against each other.
//!
//! `MuJoCo` tests no contacts between a body and its parent, except if the parent cannot move and
//! so counts as a part of the world. Parts of one arm that overlap by design would then push each
//! other apart until the solver diverges (observed on the Shadow Hand's fixed palm, within 0.2 s at
//! rest).

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::sync::Arc;

use super::draft::Draft;
use crate::default_pose::default_pose;
use crate::rings::{above, rings};
use crate::{Error, pairs, preparse, text};
use robert_base::rng::{Rng, Stream};
use robert_mujoco::{Data, Geom, Joint, Kind, Model, index};

/// Poses that are drawn to find pairs of bodies that touch in most of them.
const POSES: u64 = 120;
/// Pairs of geoms that are tested in these poses at most; a model with many pairs gets fewer poses.
const POSE_PAIRS: usize = 4_000_000;
/// Pairs that touch in a larger share of those poses than the second value are excluded, and none
/// that touch in a smaller share than the first. Bodies that meet so often touch only with the convex
/// hulls of their meshes, not with their surfaces. Fingers of a gripper are an example, because a
/// hull fills the hollow between them (seen at 0.8; fingers of hands stay below 0.2).
const MOSTLY: [f64; 2] = [0.6, 0.8];
/// Parts of different limbs have at least so many joints between them.
const LIMBS: usize = 4;
/// If they touch in a smaller share of those poses, they seldom overlap, and pass through each other once they are
/// excluded.
const SELDOM: f64 = 0.2;
/// The distance of joint anchors below which two joints count as one joint with several axes, m.
const SAME_PLACE: f64 = 1e-3;

/// Adds the necessary excludes and reports them.
pub(super) fn exclude(
    draft: &mut Draft,
    model: &Model,
    project: &preparse::Project,
) -> Result<(), Error> {
    let model = Arc::new(model.duplicate()?);
    let mut data = Data::new(&model)?;
    data.set_qpos(&default_pose(&model))?;
    data.forward()?;
    let old: BTreeSet<(usize, usize)> = excluded(&model);
    let mut found: BTreeSet<(usize, usize)> = BTreeSet::new();
    let mut reasons: Vec<String> = Vec::new();
    let mut add = |pair: (usize, usize), why: &str| {
        let pair = (pair.0.min(pair.1), pair.0.max(pair.1));
        let name = |b: usize| model.name(Kind::Body, b).map(str::to_owned);
        if pair.0 == pair.1 || old.contains(&pair) || found.contains(&pair) {
            return false;
        }
        let (Some(a), Some(b)) = (name(pair.0), name(pair.1)) else { return false };
        found.insert(pair);
        reasons.push(format!("{a} - {b} ({why})"));
        true
    };
    for pair in static_neighbours(&model) {
        add(pair, "next to a fixed part");
    }
    let mut at_default = touching(&model, &data);
    at_default.retain(|pair| add(*pair, "in contact at the default pose"));
    let shares = shares(&model, &mut data)?;
    for pair in mostly_touching(&shares) {
        add(pair, "in contact in most poses");
    }
    if found.is_empty() {
        return Ok(());
    }
    let name = |b: usize| model.name(Kind::Body, b).unwrap_or_default();
    let passing = passing(&model, &at_default, &shares).into_iter();
    let passing: Vec<String> = passing.map(|(a, b)| format!("{} - {}", name(a), name(b))).collect();
    if !passing.is_empty() {
        draft.warnings.push(format!(
            "parts of different limbs pass through each other: {}. They overlap at the default pose, so they never \
             collide here, although they are apart in most poses. To let them collide, change that pose in the file; \
             in an MJCF it is that of the first keyframe, if there is one",
            first(&passing, 12)
        ));
    }
    let mut section = String::from("<contact>");
    for (a, b) in &found {
        let name = |b: &usize| text::escape(model.name(Kind::Body, *b).unwrap_or_default());
        write!(section, "<exclude body1=\"{}\" body2=\"{}\"/>", name(a), name(b)).ok();
    }
    section.push_str("</contact>");
    draft.append(&section, &project.path)?;
    let shown = first(&reasons, 40);
    draft.assumed.push(format!("{} pairs of bodies never collide: {shown}", reasons.len()));
    Ok(())
}

/// The first ones of a list, and how many more there are.
fn first(list: &[String], count: usize) -> String {
    let shown = list[..count.min(list.len())].join(", ");
    match list.len().saturating_sub(count) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}

fn excluded(model: &Model) -> BTreeSet<(usize, usize)> {
    model
        .exclude_signature()
        .iter()
        .map(|s| {
            let (a, b) = ((s >> 16) as usize, (s & 0xffff) as usize);
            (a.min(b).saturating_sub(1), a.max(b).saturating_sub(1))
        })
        .collect()
}

fn id(v: &[i32], i: usize) -> usize {
    index(v[i])
}

/// Moving bodies whose joint is on a fixed body, with that body; joints at the same place count as
/// one. The world itself is a floor, not a part of the robot.
fn static_neighbours(model: &Model) -> Vec<(usize, usize)> {
    let fixed = |b: usize| id(model.body_weldid(), b) == 0;
    let mut pairs = Vec::new();
    for b in 1..model.nbody() {
        if fixed(b) {
            continue;
        }
        let mut up = b;
        loop {
            let pos = &model.body_pos()[3 * up..3 * up + 3];
            let far = pos.iter().map(|v| v * v).sum::<f64>().sqrt() > SAME_PLACE;
            up = id(model.body_parentid(), up);
            if fixed(up) {
                if up != 0 {
                    pairs.push((up, b));
                }
                break;
            }
            if far {
                break;
            }
        }
    }
    pairs
}

/// Pairs of bodies in contact now, floors and walls left out.
fn touching(model: &Model, data: &Data) -> Vec<(usize, usize)> {
    let ground = |g: usize| {
        id(model.geom_bodyid(), g) == 0
            && matches!(model.geom_kind(g), Some(Geom::Plane | Geom::HField))
    };
    let mut pairs: BTreeSet<(usize, usize)> = BTreeSet::new();
    for c in data.contacts() {
        if c.dist >= 0.0 || c.geoms.iter().any(|g| ground(*g)) {
            continue;
        }
        let [a, b] = c.geoms.map(|g| id(model.geom_bodyid(), g));
        pairs.insert((a.min(b), a.max(b)));
    }
    pairs.into_iter().collect()
}

/// The number of random poses for a model.
fn poses(model: &Model) -> u64 {
    POSES.min((POSE_PAIRS / pairs::count(model).max(1)) as u64)
}

/// In which share of random poses two bodies touch; no pair that never does.
fn shares(model: &Arc<Model>, data: &mut Data) -> Result<BTreeMap<(usize, usize), f64>, Error> {
    let mut hits: BTreeMap<(usize, usize), u64> = BTreeMap::new();
    let poses = poses(model);
    for k in 0..poses {
        let mut rng = Rng::new(0, Stream::Reset, k);
        let mut qpos = model.qpos0().to_vec();
        for j in 0..model.jnt_type().len() {
            let limited = model.jnt_limited()[j] != 0;
            let range = &model.jnt_range()[2 * j..2 * j + 2];
            let (lo, hi) = match range {
                [lo, hi] if limited => (*lo, *hi),
                _ => (-std::f64::consts::PI, std::f64::consts::PI),
            };
            if let Some(q) = qpos.get_mut(id(model.jnt_qposadr(), j)) {
                *q = rng.range(lo, hi);
            }
        }
        data.reset()?;
        data.set_qpos(&qpos)?;
        data.forward()?;
        for pair in touching(model, data) {
            *hits.entry(pair).or_default() += 1;
        }
    }
    Ok(hits.into_iter().map(|(pair, n)| (pair, n as f64 / poses.max(1) as f64)).collect())
}

fn mostly_touching(shares: &BTreeMap<(usize, usize), f64>) -> Vec<(usize, usize)> {
    let least = widest_gap(shares.values().copied());
    shares.iter().filter(|(_, share)| **share >= least).map(|(pair, _)| *pair).collect()
}

/// Parts of different limbs that overlap at the default pose, but in few others. `at_default` are pairs that were
/// excluded because of that pose; none is told if no other pose was looked at.
fn passing(
    model: &Model,
    at_default: &[(usize, usize)],
    shares: &BTreeMap<(usize, usize), f64>,
) -> Vec<(usize, usize)> {
    let (looked, loops) = (poses(model) > 0, rings(model));
    let seldom = |pair: &(usize, usize)| shares.get(pair).is_none_or(|share| *share < SELDOM);
    let limbs = |pair: &(usize, usize)| are_limbs(model, *pair, &loops);
    at_default.iter().copied().filter(|pair| looked && seldom(pair) && limbs(pair)).collect()
}

/// Whether two bodies are parts of different limbs: on the way from one to the other both move by joints of their
/// own, [`LIMBS`] in all. A loose object is no limb, and neither are two limbs of one of the closed `loops`, which are
/// open in random poses.
fn are_limbs(model: &Model, (a, b): (usize, usize), loops: &[Vec<usize>]) -> bool {
    let (a, b) = (above(model, a), above(model, b));
    let without = |one: &[usize], other: &[usize]| -> Vec<usize> {
        one.iter().copied().filter(|joint| !other.contains(joint)).collect()
    };
    let sides = [without(&a, &b), without(&b, &a)];
    let free = |joint: &usize| model.joint_type(*joint) == Some(Joint::Free);
    let both = |ring: &Vec<usize>| sides.iter().all(|s| s.iter().any(|joint| ring.contains(joint)));
    sides.iter().all(|side| !side.is_empty() && !side.iter().any(free))
        && sides.iter().map(Vec::len).sum::<usize>() >= LIMBS
        && !loops.iter().any(both)
}

/// The upper end of the widest gap between shares, within [`MOSTLY`]. Shares of a left and a right
/// pair differ by chance; a limit between them would exclude one of the two.
fn widest_gap(shares: impl Iterator<Item = f64>) -> f64 {
    let [low, high] = MOSTLY;
    let mut ends: Vec<f64> =
        shares.filter(|s| (low..high).contains(s)).chain([low, high]).collect();
    ends.sort_by(f64::total_cmp);
    let gaps = ends.windows(2).map(|w| (w[1] - w[0], w[1]));
    gaps.max_by(|a, b| a.0.total_cmp(&b.0)).map_or(high, |(_, upper)| upper)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two arms of two links, whose ends overlap if they are as near as .1 m.
    fn arms(apart: f64, more: &str) -> Vec<[Option<String>; 2]> {
        let arm = |side: &str, x: f64| {
            format!(
                r#"<body pos="{x} 0 0"><joint name="{side}1" axis="0 0 1"/><joint name="{side}2" axis="1 0 0"/><geom size=".01" pos="0 .5 0"/>
                <body name="{side}" pos="0 1 0"><joint name="{side}3" axis="0 0 1"/><geom name="{side}" size=".1" pos="0 .5 0"/></body></body>"#
            )
        };
        let both = [arm("left", -apart / 2.0), arm("right", apart / 2.0)].concat();
        let table = r#"<geom size=".05" pos="0 1.5 0"/>"#;
        let xml = format!("<mujoco><worldbody>{table}{both}</worldbody>{more}</mujoco>");
        let model = Arc::new(Model::from_xml(&xml).unwrap());
        let mut data = Data::new(&model).unwrap();
        data.set_qpos(&default_pose(&model)).unwrap();
        data.forward().unwrap();
        let at_default = touching(&model, &data);
        let shares = shares(&model, &mut data).unwrap();
        let names = |b| model.name(Kind::Body, b).map(str::to_owned);
        let pairs = passing(&model, &at_default, &shares);
        pairs.into_iter().map(|(a, b)| [names(a), names(b)]).collect()
    }

    #[test]
    fn arms_that_overlap_at_the_default_pose_are_found() {
        let ends = [Some("left".to_owned()), Some("right".to_owned())];
        assert_eq!(arms(0.1, ""), [ends], "and the world, which does not move, is no limb");
        assert!(arms(0.5, "").is_empty());
        // At the first keyframe they are apart.
        let key = r#"<keyframe><key qpos="1 0 0 -1 0 0"/></keyframe>"#;
        assert!(arms(0.1, key).is_empty());
        let tied = r#"<equality><connect body1="left" body2="right" anchor="0 .5 0"/></equality>"#;
        assert!(arms(0.1, tied).is_empty());
    }

    #[test]
    fn a_left_and_a_right_pair_are_on_the_same_side_of_the_limit() {
        assert_eq!(widest_gap([0.1, 0.95].into_iter()), 0.8, "nothing between");
        assert_eq!(widest_gap([0.1, 0.72, 0.74, 0.95].into_iter()), 0.72);
        assert_eq!(widest_gap([0.61, 0.63, 0.95].into_iter()), 0.8);
    }
}
