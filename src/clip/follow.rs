//! Values of keys that follow from others: of joints that follow another one, and of joints that a closed loop
//! carries along.
//!
//! A goal of one joint then is a goal of the others. Without it these would have a gap there, and the straight line
//! through their gap would lead them away from where the robot must be.

use std::collections::BTreeSet;

use super::document::{Clip, Row};
use super::grid::round;
use super::joints::{CouplingKind, JointTable};
use robert_kinematics::Kinematics;

/// The work that one clip may take, as iterations times (20 + the number of joints). Keys after that are left as
/// they are.
const WORK: usize = 2_000_000;
/// Iterations as which a key counts beside its own.
const EACH: usize = 3;

/// The values of the keys in which others follow; `None` for keys that need no more values. Keys are in order.
pub(super) fn completed(clip: &Clip, table: &JointTable) -> Vec<Option<Row>> {
    let ties = ties(clip, table);
    let mut loops = table.kinematics.as_ref().and_then(|tree| Loops::new(clip, table, tree));
    if ties.is_empty() && loops.is_none() {
        return Vec::new();
    }
    let mut complete = |row: &Row| {
        let mut new = row.clone();
        follow(&mut new, &ties);
        if let Some(loops) = &mut loops {
            loops.close(&mut new);
            follow(&mut new, &ties);
        }
        (new != *row).then_some(new)
    };
    clip.keys.iter().map(|key| complete(clip.row(key)?)).collect()
}

/// Joints that one value decides: the place in the clip, the offset and the factor of each.
type Tie = Vec<(usize, f64, f64)>;

fn ties(clip: &Clip, table: &JointTable) -> Vec<Tie> {
    let place = |name: &String| clip.robot.joints.iter().position(|j| j == name);
    let mimics = table.couplings.iter().filter(|c| c.kind == CouplingKind::Mimic);
    let tie = mimics.map(|c| {
        c.members
            .iter()
            .map(|m| Some((place(&m.joint)?, m.offset, m.coef)))
            .collect::<Option<Tie>>()
    });
    tie.flatten().collect()
}

fn follow(row: &mut Row, ties: &[Tie]) {
    // A follower may be followed by another joint.
    for _ in 0..ties.len() {
        for tie in ties {
            let value = |&(j, offset, coef): &(usize, f64, f64)| {
                let q = row.get(j).copied().flatten()?;
                (coef != 0.0).then(|| (q - offset) / coef)
            };
            let Some(common) = tie.iter().find_map(value) else { continue };
            for &(j, offset, coef) in tie {
                if let Some(slot) = row.get_mut(j) {
                    slot.get_or_insert_with(|| round(offset + coef * common));
                }
            }
        }
    }
}

/// The closed loops along a clip.
struct Loops<'a> {
    tree: &'a Kinematics,
    /// For each joint of the clip, its joint in the tree of bodies.
    to_state: Vec<Option<usize>>,
    /// The state at the last key; (joints of the tree).
    state: Vec<f64>,
    /// What is left of [`WORK`].
    left: usize,
}

impl<'a> Loops<'a> {
    fn new(clip: &Clip, table: &JointTable, tree: &'a Kinematics) -> Option<Loops<'a>> {
        if tree.closures.is_empty() {
            return None;
        }
        let index = |name: &String| table.joints.iter().position(|j| &j.name == name);
        let to_state = clip.robot.joints.iter().map(index).collect();
        let mut state = table.rest.clone();
        state.resize(tree.joints.len(), 0.0);
        Some(Loops { tree, to_state, state, left: WORK })
    }

    /// Gives values to joints without one whose place the others determine.
    fn close(&mut self, row: &mut Row) {
        let mut known = BTreeSet::new();
        for (at, value) in self.to_state.iter().zip(row.iter()) {
            if let (Some(at), Some(value)) = (at, value) {
                self.state[*at] = *value;
                known.insert(*at);
            }
        }
        if self.left == 0 || known.is_empty() {
            return;
        }
        let known: Vec<usize> = known.into_iter().collect();
        let found = self.tree.carried(&self.state, &known);
        let iterations = found.as_ref().map_or(0, |found| found.iterations as usize);
        self.left = self.left.saturating_sub((iterations + EACH) * (20 + self.tree.joints.len()));
        let Some(found) = found else { return };
        for (at, slot) in self.to_state.iter().zip(row.iter_mut()) {
            if let Some(at) = at.filter(|at| found.joints.binary_search(at).is_ok()) {
                slot.get_or_insert_with(|| round(found.state[at]));
            }
        }
        self.state = found.state;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::joints::{Coupling, CouplingMember};
    use crate::{Key, RobotRef, compile_for};

    #[test]
    fn a_goal_of_a_joint_is_one_of_those_that_follow_it() {
        let joints = ["jaw", "knuckle", "tip", "wrist"].map(str::to_owned).to_vec();
        let mut clip = Clip::new(RobotRef { id: "r".into(), joints, ..RobotRef::default() }, 30);
        let key = |frame, q: [Option<f64>; 4]| Key {
            goal: crate::Goal::Q(q.to_vec()),
            ..Key::new(frame, &[])
        };
        clip.keys = vec![
            key(0, [Some(0.0); 4]),
            key(10, [Some(0.2), None, None, None]),
            key(20, [None, None, Some(-0.5), None]),
        ];
        let mut table = JointTable::from_clip(&clip);
        let mimic = |leader: &str, follower: &str, coef, offset| Coupling {
            kind: CouplingKind::Mimic,
            name: leader.into(),
            members: vec![
                CouplingMember { joint: leader.into(), coef: 1.0, offset: 0.0 },
                CouplingMember { joint: follower.into(), coef, offset },
            ],
            tolerance: 1e-3,
        };
        table.couplings =
            vec![mimic("knuckle", "tip", -1.0, 0.1), mimic("jaw", "knuckle", 2.0, 0.0)];
        let command = compile_for(&clip, Some(&table)).unwrap();
        let row = |f: u32| -> Vec<Option<f32>> {
            (0..4).map(|j| command.sees(f, j).then(|| command.row(f)[j])).collect()
        };
        // What the key says stays, even if it does not fit.
        assert_eq!(row(0), [Some(0.0); 4]);
        assert_eq!(row(10), [Some(0.2), Some(0.4), Some(-0.3), None]);
        assert_eq!(row(20), [Some(0.3), Some(0.6), Some(-0.5), None]);
        let alone = compile_for(&clip, Some(&JointTable::from_clip(&clip))).unwrap();
        assert!(!alone.sees(10, 1));
    }
}
