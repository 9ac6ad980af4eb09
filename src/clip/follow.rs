//! Values of keys that follow from others: of joints that follow another one, and of joints that a closed loop
//! carries along.
//!
//! A goal of one joint then is a goal of the others. Without it these would have a gap there, and the straight line
//! through their gap would lead them away from where the robot must be. A goal that follows from others is hidden
//! wherever a mask hides one of those, or an offset moves one.

use super::document::{Clip, Row};
use super::grid::round;
use super::joints::{CouplingKind, JointTable};
use robert_kinematics::{Carried, Loops};

/// The work that the loops of one clip may take, in multiplications: about a second. In clips with more keys for
/// some joints only they are left as they are.
const WORK: usize = 300_000_000;

/// Values that follow from others.
#[derive(Debug, Default)]
pub(super) struct Completed {
    /// By key, its row with those values; `None` for keys that need none.
    pub(super) rows: Vec<Option<Row>>,
    /// For each joint of the clip, the joints that move with it, itself included.
    groups: Vec<Vec<usize>>,
    /// For each joint, whether it follows another one, or a loop determines its value in some key.
    follows: Vec<bool>,
    /// By key, for each joint whether a loop carries it there; empty where none does.
    carried: Vec<Vec<bool>>,
}

impl Completed {
    /// The values of the keys of a valid clip, in order. Keys with end-effector goals have the `solved` values.
    pub(super) fn of(clip: &Clip, solved: &[Option<Row>], table: &JointTable) -> Completed {
        let ties = ties(clip, table);
        let loops = table.kinematics.as_ref().map(Loops::new).filter(|loops| !loops.is_empty());
        if ties.is_empty() && loops.is_none() {
            return Completed::default();
        }
        let row = |i: usize| {
            let own = || clip.keys.get(i).and_then(|key| clip.row(key));
            solved.get(i).and_then(Option::as_ref).or_else(own)
        };
        let rows: Vec<Option<&Row>> = (0..clip.keys.len()).map(row).collect();
        let partly = rows.iter().flatten().filter(|row| row.contains(&None)).count();
        // The steps that each of these keys may take.
        let steps = |loops: &Loops<'_>| WORK / loops.work().saturating_mul(partly).max(1);
        let affordable = loops.map(|loops| (steps(&loops), loops)).filter(|(steps, _)| *steps > 0);
        let mut chain =
            affordable.map(|(steps, loops)| Chain::new(clip, table, loops, steps.min(STEPS)));
        let groups = groups(clip.dim(), &ties, chain.as_ref());
        let mut carried = vec![Vec::new(); rows.len()];
        let mut complete = |i: usize, row: &Row| {
            let mut new = row.clone();
            follow(&mut new, &ties);
            if let Some(chain) = &mut chain {
                let before = new.clone();
                chain.close(&mut new);
                follow(&mut new, &ties);
                carried[i] = new.iter().zip(&before).map(|(new, old)| new != old).collect();
            }
            (new != *row).then_some(new)
        };
        let new: Vec<Option<Row>> =
            rows.iter().enumerate().map(|(i, row)| complete(i, (*row)?)).collect();
        let mut follows = vec![false; clip.dim()];
        ties.iter().flat_map(|tie| &tie.joints).for_each(|(j, ..)| follows[*j] = true);
        for (old, new) in
            rows.iter().zip(&new).filter_map(|(old, new)| Some(((*old)?, new.as_ref()?)))
        {
            for (j, follows) in follows.iter_mut().enumerate() {
                *follows |= old[j] != new[j];
            }
        }
        Completed { rows: new, groups, follows, carried }
    }

    /// Whether a loop carries a joint to its value in a key. Between two keys it would leave a line.
    pub(super) fn carries(&self, key: usize, joint: usize) -> bool {
        self.carried.get(key).and_then(|joints| joints.get(joint)) == Some(&true)
    }

    /// Whether a key with these values opens a joint that it has no value for: one that follows others, which it
    /// moves. A line that passes the key would lead the joint away from where they carry it.
    pub(super) fn opens(&self, row: &Row, joint: usize) -> bool {
        self.follows.get(joint) == Some(&true)
            && self.groups[joint].iter().any(|mate| row[*mate].is_some())
    }

    /// Hides goals that follow from others where those are hidden, or where an offset moves one of them. All
    /// arguments are (frames, joints): which goals follow from others, which were visible before masks, the
    /// offsets, and which goals are visible.
    pub(super) fn hide(&self, derived: &[bool], before: &[bool], added: &[f64], seen: &mut [bool]) {
        let dim = self.groups.len();
        for at in (0..seen.len()).filter(|at| derived[*at]) {
            let first = at - at % dim;
            let group = || self.groups[at % dim].iter().map(|j| first + j);
            let own = || group().filter(|i| before[*i] && !derived[*i]);
            let moved = group().any(|i| added.get(i).is_some_and(|add| *add != 0.0));
            if moved || own().next().is_none() || own().any(|i| !seen[i]) {
                seen[at] = false;
            }
        }
    }
}

/// Joints that one value decides.
struct Tie {
    /// The place in the clip, the offset and the factor of each.
    joints: Vec<(usize, f64, f64)>,
    /// The range of each.
    ranges: Vec<Option<[f64; 2]>>,
}

fn ties(clip: &Clip, table: &JointTable) -> Vec<Tie> {
    let place = |name: &String| clip.robot.joints.iter().position(|j| j == name);
    let mimics = table.couplings.iter().filter(|c| c.kind == CouplingKind::Mimic);
    let tie = mimics.map(|c| {
        let joint = |m: &super::joints::CouplingMember| Some((place(&m.joint)?, m.offset, m.coef));
        let range = |m: &super::joints::CouplingMember| table.joint(&m.joint)?.range;
        let joints = c.members.iter().map(joint).collect::<Option<_>>()?;
        Some(Tie { joints, ranges: c.members.iter().map(range).collect() })
    });
    tie.flatten().collect()
}

/// Gives a value to joints that move with one that has a value, unless it is beyond their stops.
fn follow(row: &mut Row, ties: &[Tie]) {
    // A follower may be followed by another joint.
    for _ in 0..ties.len() {
        for Tie { joints, ranges } in ties {
            let value = |&(j, offset, coef): &(usize, f64, f64)| {
                let q = row.get(j).copied().flatten()?;
                (coef != 0.0).then(|| (q - offset) / coef)
            };
            let Some(common) = joints.iter().find_map(value) else { continue };
            for (&(j, offset, coef), range) in joints.iter().zip(ranges) {
                let q = round(offset + coef * common);
                let fits = range.is_none_or(|[lo, hi]| q >= lo - 1e-6 && q <= hi + 1e-6);
                if let Some(slot) = row.get_mut(j).filter(|_| fits) {
                    slot.get_or_insert(q);
                }
            }
        }
    }
}

/// For each joint of the clip, the joints that move with it.
fn groups(dim: usize, ties: &[Tie], chain: Option<&Chain<'_>>) -> Vec<Vec<usize>> {
    let mut name: Vec<usize> = (0..dim).collect();
    let tied = ties.iter().map(|tie| tie.joints.iter().map(|j| j.0).collect::<Vec<_>>());
    let closed = chain.into_iter().flat_map(|chain| {
        let place = |at: &usize| chain.to_state.iter().position(|s| *s == Some(*at));
        let parts = chain.loops.joints();
        parts.into_iter().map(move |part| part.iter().filter_map(place).collect::<Vec<_>>())
    });
    for part in tied.chain(closed.collect::<Vec<_>>()) {
        let Some(one) = part.first().map(|&j| name[j]) else { continue };
        let old: Vec<usize> = part.iter().map(|&j| name[j]).collect();
        name.iter_mut().filter(|n| old.contains(n)).for_each(|n| *n = one);
    }
    let same = |j: usize| (0..dim).filter(|k| name[*k] == name[j]).collect();
    (0..dim).map(same).collect()
}

/// The step in which known joints are led from key to key, rad or m. A loop can be closed in several ways, and from far
/// away the nearest one may not be the one to which the mechanism moves.
const STEP: f64 = 0.1;
/// The largest number of steps between two keys; the steps of a longer way are larger.
const STEPS: usize = 32;

/// The closed loops along the keys of a clip.
struct Chain<'a> {
    loops: Loops<'a>,
    /// For each joint of the clip, its joint in the tree of bodies.
    to_state: Vec<Option<usize>>,
    /// Whether a joint of the tree is part of a loop.
    moves: Vec<bool>,
    /// The largest number of steps from one key to the next.
    most: usize,
    /// The state at the last key; (joints of the tree).
    state: Vec<f64>,
}

impl<'a> Chain<'a> {
    fn new(clip: &Clip, table: &JointTable, loops: Loops<'a>, most: usize) -> Chain<'a> {
        let index = |name: &String| table.joints.iter().position(|j| &j.name == name);
        let to_state = clip.robot.joints.iter().map(index).collect();
        let mut state = table.rest.clone();
        state.resize(table.joints.len(), 0.0);
        let mut moves = vec![false; state.len()];
        for joint in loops.joints().into_iter().flatten() {
            moves[joint] = true;
        }
        Chain { loops, to_state, moves, most, state }
    }

    /// Gives values to joints without one whose place the others determine.
    fn close(&mut self, row: &mut Row) {
        let goals = || {
            let goals = self.to_state.iter().zip(row.iter());
            goals.filter_map(|(at, value)| Some(((*at)?, (*value)?)))
        };
        let mut known: Vec<usize> = goals().map(|goal| goal.0).collect();
        known.sort_unstable();
        let goals: Vec<(usize, f64)> = goals().collect();
        let before = self.state.clone();
        let far = |&(at, value): &(usize, f64)| {
            if self.moves[at] { (value - before[at]).abs() } else { 0.0 }
        };
        let way = goals.iter().map(far).fold(0.0, f64::max);
        let steps = ((way / STEP).ceil() as usize).clamp(1, self.most);
        let lead = |state: &mut [f64], step: usize| {
            for &(at, value) in &goals {
                state[at] = before[at] + (value - before[at]) * step as f64 / steps as f64;
            }
        };
        if known.len() == self.state.len() {
            return lead(&mut self.state, steps);
        }
        let mut found = Carried { state: before.clone(), joints: Vec::new() };
        for step in 1..=steps {
            lead(&mut found.state, step);
            found = self.loops.carried(&found.state, &known);
        }
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
        let seen = |clip: &Clip, table: &JointTable, f: u32| -> Vec<bool> {
            let command = compile_for(clip, Some(table)).unwrap();
            (0..4).map(|j| command.sees(f, j)).collect()
        };
        // A mask of what was keyed hides what follows, and an offset leaves it open.
        let mut masked = clip.clone();
        masked.masks = vec![crate::Mask { from: 10, to: 11, joints: Some(vec!["jaw".into()]) }];
        assert_eq!(seen(&masked, &table, 10), [false; 4]);
        let mut moved = clip.clone();
        moved.offsets = vec![crate::Offset {
            frame: 10,
            add: [("jaw".to_owned(), 0.1)].into(),
            fade_in: 0,
            hold: 1,
            fade_out: 0,
        }];
        assert_eq!(seen(&moved, &table, 10), [true, false, false, false]);
        // A key that moves what a joint follows opens it, also if no key determines it.
        let mut far = clip.clone();
        far.fill = crate::Fill::Linear;
        far.keys = vec![
            key(0, [Some(0.0); 4]),
            key(10, [Some(0.2), Some(0.4), None, None]),
            key(20, [Some(0.0); 4]),
        ];
        let mut stopped = table.clone();
        stopped.joints[2].range = Some([-0.1, 0.1]);
        assert_eq!(seen(&far, &stopped, 10), [true, true, false, true]);
        // Stops are kept.
        table.joints[1].range = Some([-0.3, 0.3]);
        assert_eq!(seen(&clip, &table, 10), [true, false, false, false]);
    }

    #[test]
    fn a_key_opens_what_follows_if_it_does_not_determine_it() {
        let joints = ["jaw", "tip", "wrist"].map(str::to_owned).to_vec();
        let mut clip = Clip::new(RobotRef { id: "r".into(), joints, ..RobotRef::default() }, 30);
        clip.fill = crate::Fill::Linear;
        let key = |frame, jaw: f64, wrist: Option<f64>| {
            Key::with(frame, crate::Goal::Q(vec![Some(jaw), None, wrist]))
        };
        // The stop of the tip is at .5: at frame 10 it cannot follow.
        clip.keys = vec![key(0, 0.1, Some(0.0)), key(10, 0.8, None), key(20, 0.2, Some(1.0))];
        let mut table = JointTable::from_clip(&clip);
        table.joints[1].range = Some([-0.5, 0.5]);
        let member = |joint: &str| CouplingMember { joint: joint.into(), coef: 1.0, offset: 0.0 };
        table.couplings = vec![Coupling {
            kind: CouplingKind::Mimic,
            name: "jaw".into(),
            members: vec![member("jaw"), member("tip")],
            tolerance: 1e-3,
        }];
        let command = compile_for(&clip, Some(&table)).unwrap();
        let seen = |j: usize| (0..21).filter(|f| command.sees(*f, j)).collect::<Vec<u32>>();
        assert_eq!(seen(0), (0..21).collect::<Vec<_>>());
        assert_eq!(seen(1), [0, 20], "no line passes a key that moves the jaw");
        assert_eq!(seen(2), (0..21).collect::<Vec<_>>(), "the wrist is led past that key");
    }
}
