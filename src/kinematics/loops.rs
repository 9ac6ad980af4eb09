//! Closed loops: what moves along where bodies are held together.

use std::collections::BTreeMap;

use nalgebra::DMatrix;

use super::place::PointId;
use super::search::{IkConfig, Pull, Search};
use super::tree::Kinematics;

/// The smallest singular value of a loop's Jacobian, relative to the largest, that ties joints together.
const LEAST: f64 = 1e-4;
/// The share of a joint's motion that loops must determine.
const DETERMINED: f64 = 1.0 - 1e-4;
/// The largest loops that are closed, as rows times the square of the free joints: those of a Stewart platform
/// with ball joints have ten thousand.
const MOST: usize = 1_000_000;
/// Iterations that a search usually takes.
const ITERATIONS: usize = 8;
/// The work for a body in an iteration, relative to a multiplication.
const BODY: usize = 100;

/// Two points that are held together, and the joints that move one against the other.
#[derive(Debug)]
struct Ring {
    pull: Pull,
    /// State indices, sorted; those of followers are those of what they follow.
    joints: Vec<usize>,
}

/// The closed loops of a robot.
#[derive(Debug)]
pub struct Loops<'a> {
    tree: &'a Kinematics,
    rings: Vec<Ring>,
}

/// The result of [`Loops::carried`].
#[derive(Clone, Debug, PartialEq)]
pub struct Carried {
    /// All joint values, with closed loops where they can be closed; (joints).
    pub state: Vec<f64>,
    /// State indices of the joints that the known ones determine, sorted.
    pub joints: Vec<usize>,
}

impl<'a> Loops<'a> {
    /// The loops of a robot.
    pub fn new(tree: &'a Kinematics) -> Loops<'a> {
        let ring = |closure| {
            let pull = Pull::closing(closure);
            let joints = tree.openers(&pull);
            Ring { pull, joints }
        };
        Loops { tree, rings: tree.closures.iter().map(ring).collect() }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.rings.is_empty()
    }

    /// The joints of the loops that hang together: state indices, sorted.
    pub fn joints(&self) -> Vec<Vec<usize>> {
        let all: Vec<usize> = (0..self.tree.joints.len()).collect();
        self.parts(&all).into_iter().map(|part| part.1).collect()
    }

    /// The work of [`Loops::carried`] at most, roughly in multiplications.
    pub fn work(&self) -> usize {
        let all: Vec<usize> = (0..self.tree.joints.len()).collect();
        let parts = self.parts(&all);
        let each = |(rings, free): &(Vec<usize>, Vec<usize>)| {
            ITERATIONS * (3 * self.rows(rings) * free.len().pow(2) + BODY * self.tree.links.len())
        };
        parts.iter().map(each).sum()
    }

    /// These joints and those of `may` that move along with them, because of loops or on one tendon, sorted; and
    /// the loops.
    pub(super) fn along(&self, joints: Vec<usize>, may: &[usize]) -> (Vec<usize>, Vec<Pull>) {
        let mut at: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (r, ring) in self.rings.iter().enumerate() {
            ring.joints.iter().for_each(|j| at.entry(*j).or_default().push(r));
        }
        let count = self.tree.joints.len();
        let (mut moves, mut opened) = (vec![false; count], vec![false; self.rings.len()]);
        let (mut open, mut next, mut pulls) = (vec![false; count], joints, Vec::new());
        may.iter().for_each(|&j| open[j] = true);
        next.iter().for_each(|&j| moves[j] = true);
        while let Some(joint) = next.pop() {
            let mut others = Vec::new();
            for &r in at.get(&joint).into_iter().flatten() {
                if !std::mem::replace(&mut opened[r], true) {
                    pulls.push(self.rings[r].pull);
                    others.extend(&self.rings[r].joints);
                }
            }
            for tendon in &self.tree.tendons {
                if tendon.iter().any(|share| share.joint == joint) {
                    others.extend(tendon.iter().map(|share| share.joint));
                }
            }
            for other in others {
                if open[other] && !std::mem::replace(&mut moves[other], true) {
                    next.push(other);
                }
            }
        }
        ((0..count).filter(|j| moves[*j]).collect(), pulls)
    }

    /// Closes the loops of which some joints are known, from `start` (joints), which holds the values of the
    /// `known` ones (state indices, sorted). A loop that the known values do not let close stays as it is, and
    /// so does one that is too large. A rod between two ball joints, for example, may still turn about itself:
    /// that joint is not determined.
    pub fn carried(&self, start: &[f64], known: &[usize]) -> Carried {
        let config = IkConfig { locked: known.to_vec(), ..IkConfig::default() };
        let (mut state, mut joints) = (start.to_vec(), Vec::new());
        if self.rings.is_empty() {
            return Carried { state, joints };
        }
        for (rings, free) in self.parts(&self.tree.free_joints(&config)) {
            let is_known = |j: &usize| known.binary_search(j).is_ok();
            let knows = rings.iter().any(|r| self.rings[*r].joints.iter().any(is_known));
            if !knows || self.rows(&rings) * free.len().pow(2) > MOST {
                continue;
            }
            let pulls: Vec<Pull> = rings.iter().map(|r| self.rings[*r].pull).collect();
            let search = Search::new(self.tree, &pulls, free, &config);
            let mut closed = state.clone();
            search.closest(&mut closed);
            let world = self.tree.world(&closed);
            if search.is_reached(&search.error(&world, &closed), 1.0) {
                let determined = determined(&search.jacobian(&world));
                let found = search.free.iter().zip(determined);
                joints.extend(found.filter_map(|(joint, is)| is.then_some(*joint)));
                state = closed;
            }
        }
        joints.sort_unstable();
        Carried { state, joints }
    }

    /// The loops that hang together by joints of `may`, and these joints, sorted.
    fn parts(&self, may: &[usize]) -> Vec<(Vec<usize>, Vec<usize>)> {
        let mut parts: Vec<(Vec<usize>, Vec<usize>)> = Vec::new();
        for (r, ring) in self.rings.iter().enumerate() {
            let open = |j: &&usize| may.binary_search(j).is_ok();
            let free: Vec<usize> = ring.joints.iter().filter(open).copied().collect();
            if free.is_empty() {
                continue;
            }
            let touches = |part: &(Vec<usize>, Vec<usize>)| {
                free.iter().any(|j| part.1.binary_search(j).is_ok())
            };
            let (near, apart): (Vec<_>, Vec<_>) = parts.into_iter().partition(touches);
            let mut part = (vec![r], free);
            for (rings, joints) in near {
                part.0.extend(rings);
                part.1.extend(joints);
            }
            part.1.sort_unstable();
            part.1.dedup();
            parts = apart;
            parts.push(part);
        }
        parts
    }

    fn rows(&self, rings: &[usize]) -> usize {
        rings.iter().map(|r| self.rings[*r].pull.rows()).sum()
    }
}

impl Kinematics {
    /// The joints that move one of the points of a loop against the other, sorted; for followers the joint that
    /// they follow.
    fn openers(&self, closure: &Pull) -> Vec<usize> {
        let above = |id: &PointId| {
            let (mut joints, mut link) = (Vec::new(), id.link);
            while link != 0 {
                joints.extend(&self.links[link].joints);
                link = self.links[link].parent;
            }
            joints
        };
        let ends: Vec<Vec<usize>> = closure.points().map(above).collect();
        let [a, b] = &ends[..] else { return Vec::new() };
        let lone = a.iter().filter(|j| !b.contains(j)).chain(b.iter().filter(|j| !a.contains(j)));
        let mut joints: Vec<usize> =
            lone.map(|&j| self.led(j).map_or(j, |follow| follow.leader)).collect();
        joints.sort_unstable();
        joints.dedup();
        joints
    }
}

/// Which of the columns' variables are determined by all rows together.
fn determined(jacobian: &DMatrix<f64>) -> Vec<bool> {
    let svd = jacobian.clone().svd(false, true);
    let least = LEAST * svd.singular_values.max();
    let Some(v) = svd.v_t else { return vec![false; jacobian.ncols()] };
    let held = |column: usize| -> f64 {
        let rows = svd.singular_values.iter().enumerate().filter(|(_, s)| **s > least);
        rows.map(|(row, _)| v[(row, column)].powi(2)).sum()
    };
    (0..jacobian.ncols()).map(|column| held(column) > DETERMINED).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tree::{Anchor, Closure, JointAxis, JointMotion, LinkFrame};

    const UPRIGHT: [f64; 4] = [1.0, 0.0, 0.0, 0.0];

    /// Parallelograms with these first frames: the joints of each are two cranks, the rod between them, and a pin
    /// that turns about the rod's own line.
    fn parallelograms(at: &[f64]) -> Kinematics {
        let mut tree = Kinematics::default();
        let mut link = |parent, pos, axis: Option<[f64; 3]>| {
            let joints = axis.map(|axis| {
                let (motion, range) = (JointMotion::Hinge, Some([-2.0, 2.0]));
                tree.joints.push(JointAxis {
                    motion,
                    pos: [0.0; 3],
                    axis,
                    reference: 0.0,
                    range,
                    follows: None,
                });
                tree.joints.len() - 1
            });
            let joints = joints.into_iter().collect();
            tree.links.push(LinkFrame { name: String::new(), parent, pos, quat: UPRIGHT, joints });
            tree.links.len() - 1
        };
        let (x, y) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
        link(0, [0.0; 3], None);
        let mut closures = Vec::new();
        for &at in at {
            let left = link(0, [at, 0.0, 0.0], Some(y));
            let rod = link(left, [0.0, 0.0, 1.0], Some(y));
            let pin = link(rod, [0.0; 3], Some(x));
            let right = link(0, [at + 1.0, 0.0, 0.0], Some(y));
            let end = |link, pos| Anchor { link, pos, quat: UPRIGHT };
            let ends = [end(pin, [1.0, 0.0, 0.0]), end(right, [0.0, 0.0, 1.0])];
            closures.push(Closure { ends, turns: false });
        }
        tree.closures = closures;
        tree
    }

    #[test]
    fn a_crank_decides_about_its_own_loop_alone() {
        let tree = parallelograms(&[0.0, 5.0]);
        let loops = Loops::new(&tree);
        assert_eq!(loops.joints(), [vec![0, 1, 2, 3], vec![4, 5, 6, 7]]);
        let mut start = vec![0.0; 8];
        start[0] = 0.3;
        let found = loops.carried(&start, &[0]);
        // The pin may turn as it likes.
        assert_eq!(found.joints, [1, 3]);
        let expected = [0.3, -0.3, 0.0, 0.3, 0.0, 0.0, 0.0, 0.0];
        let near = |state: &[f64]| state.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-3);
        assert!(near(&found.state), "{found:?}");
        // In the second one the cranks cannot both be where they are said to be; the first one closes all the same.
        (start[4], start[7]) = (0.2, 0.6);
        let found = loops.carried(&start, &[0, 4, 7]);
        assert_eq!((found.joints, found.state[5]), (vec![1, 3], 0.0));
        assert_eq!(loops.carried(&start, &[]).joints, [0_usize; 0]);
    }

    #[test]
    fn a_limb_that_is_stretched_decides_nothing() {
        // The crank cannot go so far that the rod would have to be longer.
        let mut tree = parallelograms(&[0.0]);
        tree.joints[3].range = Some([0.0, 0.0]);
        let mut start = vec![0.0; 4];
        start[0] = 1.5;
        let found = Loops::new(&tree).carried(&start, &[0]);
        assert_eq!((found.joints.len(), found.state), (0, start));
    }

    #[test]
    fn many_loops_take_time_in_proportion() {
        let few = parallelograms(&[0.0; 2]);
        let many = parallelograms(&[0.0; 40]);
        assert!(Loops::new(&many).work() < 25 * 20 * Loops::new(&few).work());
        assert!(Loops::new(&few).work() > 0);
    }
}
