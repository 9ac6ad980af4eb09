//! Joints that an equality of the model ties to another.

use robert_mujoco::Model;

/// `mjEQ_JOINT`.
pub(super) const EQ_JOINT: i32 = 2;

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
    let tie = |e: usize| {
        let [follower, leader] = [model.eq_obj1id()[e], model.eq_obj2id()[e]];
        let polynomial = model.eq_data()[11 * e..11 * e + 5].try_into().ok()?;
        // A joint that an equality holds where it is has no leader.
        let (follower, leader) = (follower.try_into().ok()?, leader.try_into().ok()?);
        Some(Tie { follower, leader, polynomial })
    };
    let is = |e: &usize| model.eq_type()[*e] == EQ_JOINT && model.eq_active()[*e] != 0;
    (0..model.neq()).filter(is).filter_map(tie).collect()
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
