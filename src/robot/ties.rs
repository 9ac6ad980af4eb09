//! Joints that an equality of the model ties to another: directly, or by a tendon that keeps its length.

use super::tendons::tendon_joints;
use robert_mujoco::{Model, Transmission};

/// `mjEQ_JOINT`.
const EQ_JOINT: i32 = 2;
/// `mjEQ_TENDON`.
const EQ_TENDON: i32 = 3;

/// A joint that follows another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Tie {
    /// Joint number of the follower.
    pub(super) follower: usize,
    /// Joint number of the one that leads it.
    pub(super) leader: usize,
    /// The follower's distance from its zero, rad or m, by powers 0 to 4 of the leader's.
    pub(super) polynomial: [f64; 5],
}

impl Tie {
    /// Whether the follower moves in proportion, so that it can also lead.
    pub(super) fn is_straight(&self) -> bool {
        let [_, slope, curve @ ..] = self.polynomial;
        slope != 0.0 && curve == [0.0; 3]
    }
}

/// The ties of a model that are active.
pub(super) fn ties(model: &Model) -> Vec<Tie> {
    let active = |e: &usize| model.eq_active()[*e] != 0;
    let tie = |e: usize| match model.eq_type()[e] {
        EQ_JOINT => by_equality(model, e),
        EQ_TENDON => by_tendon(model, e),
        _ => None,
    };
    (0..model.neq()).filter(active).filter_map(tie).collect()
}

/// The ties that an equality makes between two joints directly.
pub(super) fn joint_ties(model: &Model) -> Vec<Tie> {
    between_joints(model).filter_map(|e| by_equality(model, e)).collect()
}

/// Joints that an equality holds where they are.
pub(super) fn held(model: &Model) -> Vec<usize> {
    let alone = between_joints(model).filter(|e| model.eq_obj2id()[*e] < 0);
    alone.filter_map(|e| model.eq_obj1id()[e].try_into().ok()).collect()
}

fn between_joints(model: &Model) -> impl Iterator<Item = usize> {
    let is = |e: &usize| model.eq_type()[*e] == EQ_JOINT && model.eq_active()[*e] != 0;
    (0..model.neq()).filter(is)
}

fn by_equality(model: &Model, e: usize) -> Option<Tie> {
    let [follower, leader] = [model.eq_obj1id()[e], model.eq_obj2id()[e]];
    let polynomial = model.eq_data()[11 * e..11 * e + 5].try_into().ok()?;
    // A joint that an equality holds where it is has no leader.
    let (follower, leader) = (follower.try_into().ok()?, leader.try_into().ok()?);
    Some(Tie { follower, leader, polynomial })
}

/// Two joints of a tendon that keeps its length. The one with a motor leads, or else the first in the model.
fn by_tendon(model: &Model, e: usize) -> Option<Tie> {
    let (tendon, other) = (model.eq_obj1id()[e], model.eq_obj2id()[e]);
    let members = tendon_joints(model, tendon.try_into().ok()?);
    let [mut lead, mut follow] = members.try_into().ok()?;
    if other >= 0 || lead.0 == follow.0 || lead.1 == 0.0 || follow.1 == 0.0 {
        return None;
    }
    let has_motor = |joint: usize| {
        (0..model.nu()).any(|a| model.transmission(a) == Some(Transmission::Joint(joint)))
    };
    let rank = |joint: usize| (!has_motor(joint), joint);
    if rank(follow.0) < rank(lead.0) {
        std::mem::swap(&mut lead, &mut follow);
    }
    // The lengths of tendons are zero where the coordinates of their joints are.
    let longer = model.eq_data()[11 * e];
    let polynomial = [longer / follow.1, -lead.1 / follow.1, 0.0, 0.0, 0.0];
    Some(Tie { follower: follow.0, leader: lead.0, polynomial })
}

/// The joints that move with `joint` by ties, also through others: joint number, and how far it moves
/// per unit of `joint` about its zero.
pub(super) fn carried(ties: &[Tie], joint: usize) -> Vec<(usize, f64)> {
    let mut all = vec![(joint, 1.0)];
    let mut next = 0;
    while let Some(&(here, slope)) = all.get(next) {
        next += 1;
        for tie in ties.iter().filter(|tie| tie.leader == here) {
            if all.iter().all(|(j, _)| *j != tie.follower) {
                all.push((tie.follower, slope * tie.polynomial[1]));
            }
        }
        // A motor may also act on the follower of a straight tie.
        for tie in ties.iter().filter(|tie| tie.follower == here && tie.is_straight()) {
            if all.iter().all(|(j, _)| *j != tie.leader) {
                all.push((tie.leader, slope / tie.polynomial[1]));
            }
        }
    }
    all.remove(0);
    all
}

/// Puts the joints that move with `joint` where it leads them; `qpos` is (nq).
pub(super) fn place(model: &Model, joint: usize, qpos: &mut [f64]) {
    let all = ties(model);
    let at = |j: usize| model.jnt_qposadr()[j] as usize;
    let (mut seen, mut next) = (vec![joint], 0);
    while let Some(&here) = seen.get(next) {
        next += 1;
        let way = qpos[at(here)] - model.qpos0()[at(here)];
        for tie in &all {
            let (other, led) = if tie.leader == here {
                (tie.follower, tie.polynomial.iter().rev().fold(0.0, |sum, c| sum * way + c))
            } else if tie.follower == here && tie.is_straight() {
                (tie.leader, (way - tie.polynomial[0]) / tie.polynomial[1])
            } else {
                continue;
            };
            if !seen.contains(&other) {
                qpos[at(other)] = model.qpos0()[at(other)] + led;
                seen.push(other);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tendon_that_keeps_its_length_ties_its_joints() {
        let joint = |name: &str| {
            format!("<body><joint name=\"{name}\" axis=\"0 1 0\"/><geom size=\".1\"/></body>")
        };
        let bodies: String = ["a", "b", "c"].map(joint).concat();
        let model = Model::from_xml(&format!(
            r#"<mujoco><worldbody>{bodies}</worldbody>
            <tendon><fixed name="held"><joint joint="b" coef=".02"/><joint joint="c" coef="-.01"/></fixed>
              <fixed name="free"><joint joint="a" coef="1"/><joint joint="b" coef="1"/></fixed></tendon>
            <equality><tendon tendon1="held"/></equality><actuator><motor joint="c"/></actuator></mujoco>"#
        ))
        .unwrap();
        // The motor's joint leads, and b moves half as far in the same direction.
        let [Tie { follower: 1, leader: 2, polynomial }] = ties(&model)[..] else {
            panic!("{:?}", ties(&model));
        };
        assert_eq!(polynomial, [0.0, 0.5, 0.0, 0.0, 0.0]);
        assert!(joint_ties(&model).is_empty());
    }

    #[test]
    fn chains_of_ties_move_together_from_either_end() {
        // The third joint follows the second, which follows the first.
        let joint = |name: &str| {
            format!(
                "<body><joint name=\"{name}\" type=\"slide\" axis=\"0 0 1\"/><geom size=\".1\"/></body>"
            )
        };
        let bodies: String = ["a", "b", "c"].map(joint).concat();
        let model = Model::from_xml(&format!(
            r#"<mujoco><worldbody>{bodies}</worldbody><equality>
            <joint joint1="c" joint2="b" polycoef=".1 2 0 0 0"/><joint joint1="b" joint2="a" polycoef="0 .5 0 0 0"/>
            <joint joint1="a" joint2="c" polycoef="0 9 0 0 0" active="false"/></equality></mujoco>"#
        ))
        .unwrap();
        let all = ties(&model);
        assert_eq!(carried(&all, 0), [(1, 0.5), (2, 1.0)]);
        assert_eq!(carried(&all, 2), [(1, 0.5), (0, 1.0)]);
        let placed = |joint: usize, q: f64| {
            let mut qpos = vec![0.0; 3];
            qpos[joint] = q;
            place(&model, joint, &mut qpos);
            qpos
        };
        let near = |found: Vec<f64>| {
            assert!(
                found.iter().zip([0.4, 0.2, 0.5]).all(|(a, b)| (a - b).abs() < 1e-12),
                "{found:?}"
            );
        };
        near(placed(0, 0.4));
        near(placed(2, 0.5));
    }
}
