//! The search for joint values that bring points together, and its options.
//!
//! Damped least squares (Wampler 1986; Nakamura and Hanafusa 1986) with all targets stacked. A joint
//! that a step would move past its limit is held at the limit, and the step is solved again without
//! it, so that the others take over. Rejected: clipping the step, which stalls before reachable
//! targets. The damping grows when a step does not help and shrinks when it does
//! (Levenberg-Marquardt).

use nalgebra::{DMatrix, DVector, Isometry3, Vector3};

use super::place::{PointId, World};
use super::tree::{Anchor, Closure, Follow, JointMotion, Kinematics, Share};

/// The cost of a radian away from the posture in the first search, as metres away from a target.
const NEAR_WEIGHT: f64 = 0.01;

/// The cost of a radian between joints on one tendon, as metres away from a target.
const APART_WEIGHT: f64 = 0.3;
/// Joints on one tendon that are nearer to each other than this move alike, rad.
const ALIKE: f64 = 1e-3;

/// The cost of a metre between the ends of a loop, as metres away from a target.
const CLOSURE_WEIGHT: f64 = 10.0;

/// Options of the search.
#[derive(Clone, Debug, PartialEq)]
pub struct IkConfig {
    /// State indices of joints that may move; `None` for all joints except those that follow
    /// another one without a motor.
    pub joints: Option<Vec<usize>>,
    /// State indices of joints that must not move; they override the above.
    pub locked: Vec<usize>,
    /// The posture near which the solution should be; `None` = near the start. (joints)
    pub near: Option<Vec<f64>>,
    /// Greatest number of iterations of one search.
    pub iterations: u32,
    /// Searches from elsewhere if the first reaches no solution. A stretched leg, or a joint at its stop, can keep a
    /// search where it began although the goal is within reach.
    pub restarts: u32,
    /// Distance that counts as reached, m.
    pub tolerance_m: f64,
    /// Weight of a radian of orientation error in metres.
    pub rad_in_m: f64,
    /// Greatest change of a joint in one iteration, rad or m.
    pub step_limit: f64,
}

impl Default for IkConfig {
    fn default() -> Self {
        IkConfig {
            joints: None,
            locked: Vec::new(),
            near: None,
            iterations: 100,
            restarts: 0,
            tolerance_m: 1e-4,
            rad_in_m: 0.1,
            step_limit: 0.3,
        }
    }
}

/// A target with its points looked up.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pull {
    pub(super) id: PointId,
    pub(super) goal: Goal,
    /// Whether the orientation counts.
    pub(super) turns: bool,
    /// Weight of its errors.
    pub(super) weight: f64,
}

#[derive(Clone, Copy, Debug)]
pub(super) enum Goal {
    /// A place in the world.
    Place(Isometry3<f64>),
    /// Another point of the robot, which may move as well.
    Point(PointId),
}

impl Kinematics {
    pub(super) fn free_joints(&self, config: &IkConfig) -> Vec<usize> {
        let mut free: Vec<usize> = match &config.joints {
            Some(list) => list.clone(),
            None => (0..self.joints.len()).collect(),
        };
        let moves = |i: usize| self.joints.get(i).is_some_and(|j| j.follows.is_none());
        free.retain(|i| moves(*i) && !config.locked.contains(i));
        free.sort_unstable();
        free.dedup();
        free
    }

    /// The joint and its followers, with their factors.
    pub(super) fn columns(&self, joint: usize) -> impl Iterator<Item = (usize, f64)> {
        let followers = (0..self.joints.len()).filter_map(move |i| {
            self.led(i).filter(|f| f.leader == joint).map(|f| (i, f.multiplier))
        });
        std::iter::once((joint, 1.0)).chain(followers)
    }

    /// How a follower depends on a joint that follows none: through its leader, or through the leaders of that.
    pub(super) fn led(&self, joint: usize) -> Option<Follow> {
        let mut all = self.joints[joint].follows?;
        // A chain is at most as long as the robot.
        for _ in 0..self.joints.len() {
            let Some(next) = self.joints[all.leader].follows else { return Some(all) };
            let (offset, multiplier) = (all.offset, all.multiplier);
            all = Follow {
                leader: next.leader,
                offset: offset + multiplier * next.offset,
                multiplier: multiplier * next.multiplier,
            };
        }
        None
    }

    /// Moves followers along with leaders that may move.
    pub(super) fn follow(&self, state: &mut [f64], free: &[usize]) {
        for i in 0..self.joints.len() {
            if let Some(f) = self.led(i).filter(|f| free.contains(&f.leader)) {
                state[i] = f.offset + f.multiplier * state[f.leader];
            }
        }
    }
}

pub(super) struct Search<'a> {
    tree: &'a Kinematics,
    pub(super) pulls: &'a [Pull],
    pub(super) free: Vec<usize>,
    /// For each free joint itself and its followers, with their factors.
    columns: Vec<Vec<(usize, f64)>>,
    config: &'a IkConfig,
    pub(super) near: Option<&'a [f64]>,
    /// Tendons whose joints move alike.
    pub(super) tendons: &'a [Vec<Share>],
}

impl<'a> Search<'a> {
    pub(super) fn new(
        tree: &'a Kinematics,
        pulls: &'a [Pull],
        free: Vec<usize>,
        config: &'a IkConfig,
    ) -> Search<'a> {
        let columns = free.iter().map(|&i| tree.columns(i).collect()).collect();
        Search { tree, pulls, free, columns, config, near: None, tendons: &[] }
    }

    /// A step that gains less than this leads nowhere: the goal is out of reach.
    pub(super) fn stalled(&self) -> f64 {
        0.01 * self.config.tolerance_m
    }

    /// Improves the state until the goals are met, or until it no longer comes nearer; the number of iterations.
    pub(super) fn closest(&self, state: &mut Vec<f64>) -> u32 {
        self.descend(state, |error, before| {
            let arrived = self.is_reached(error, 0.01) && self.is_alike(error);
            arrived || before - error.norm() < self.stalled()
        })
    }

    /// Improves the state until `done` (of the error and of the norm before the last step) or until
    /// no step helps; the number of iterations.
    pub(super) fn descend(
        &self,
        state: &mut Vec<f64>,
        done: impl Fn(&DVector<f64>, f64) -> bool,
    ) -> u32 {
        let mut damping = 1e-4_f64;
        let mut world = self.tree.world(state);
        let mut error = self.error(&world, state);
        let mut before = f64::INFINITY;
        let mut used = 0;
        while used < self.config.iterations && !self.free.is_empty() && !done(&error, before) {
            used += 1;
            let jacobian = self.jacobian(&world);
            let mut improved = false;
            for _ in 0..6 {
                let step = self.step(&jacobian, &error, state, damping);
                let mut next = state.clone();
                for (k, &i) in self.free.iter().enumerate() {
                    let [lo, hi] = self.range(i);
                    next[i] = (next[i] + step[k]).clamp(lo, hi);
                }
                self.tree.follow(&mut next, &self.free);
                let next_world = self.tree.world(&next);
                let next_error = self.error(&next_world, &next);
                if next_error.norm() < error.norm() * (1.0 - 1e-9) {
                    before = error.norm();
                    (*state, world, error) = (next, next_world, next_error);
                    damping = (damping * 0.3).max(1e-8);
                    improved = true;
                    break;
                }
                damping = (damping * 8.0).min(1e4);
            }
            if !improved {
                break;
            }
        }
        used
    }

    /// The range of a joint; infinite if it has none.
    fn range(&self, joint: usize) -> [f64; 2] {
        self.tree.joints[joint].range.unwrap_or([f64::NEG_INFINITY, f64::INFINITY])
    }

    fn target_rows(&self) -> usize {
        self.pulls.iter().map(Pull::rows).sum()
    }

    /// Stacked errors, metres: three rows per position, three more per orientation, one per free
    /// joint if there is a posture.
    pub(super) fn error(&self, world: &World, state: &[f64]) -> DVector<f64> {
        let mut rows = Vec::with_capacity(self.target_rows() + self.free.len());
        for p in self.pulls {
            let at = world.point(&p.id);
            let goal = match &p.goal {
                Goal::Place(place) => *place,
                Goal::Point(other) => world.point(other),
            };
            let way = goal.translation.vector - at.translation.vector;
            rows.extend((way * p.weight).iter());
            if p.turns {
                let turn = (goal.rotation * at.rotation.inverse()).scaled_axis();
                rows.extend((turn * self.config.rad_in_m * p.weight).iter());
            }
        }
        if let Some(near) = self.near {
            rows.extend(self.free.iter().map(|&i| NEAR_WEIGHT * (near[i] - state[i])));
        }
        let apart = |(a, b): (Share, Share)| state[b.joint] / b.factor - state[a.joint] / a.factor;
        rows.extend(self.neighbours().map(|pair| APART_WEIGHT * apart(pair)));
        DVector::from_vec(rows)
    }

    /// Pairs of joints on one tendon.
    fn neighbours(&self) -> impl Iterator<Item = (Share, Share)> {
        let pairs = |tendon: &'a Vec<Share>| tendon.windows(2).map(|pair| (pair[0], pair[1]));
        self.tendons.iter().flat_map(pairs)
    }

    /// Whether joints on one tendon are where they belong; the end of the stacked errors says it.
    fn is_alike(&self, error: &DVector<f64>) -> bool {
        let pairs = self.neighbours().count();
        error.rows(error.len() - pairs, pairs).amax() <= APART_WEIGHT * ALIKE
    }

    /// Change of the points (and of the posture) with the free joints: (rows of `error`, free).
    pub(super) fn jacobian(&self, world: &World) -> DMatrix<f64> {
        let targets = self.target_rows();
        let extra = if self.near.is_some() { self.free.len() } else { 0 };
        let pairs = self.neighbours().count();
        let mut out = DMatrix::zeros(targets + extra + pairs, self.free.len());
        let mut top = 0;
        for p in self.pulls {
            for (k, columns) in self.columns.iter().enumerate() {
                for &(joint, factor) in columns {
                    let (mut along, mut about) = self.moved(world, joint, &p.id);
                    if let Goal::Point(other) = &p.goal {
                        // What counts is how the one moves against the other.
                        let others = self.moved(world, joint, other);
                        (along, about) = (along - others.0, about - others.1);
                    }
                    let factor = factor * p.weight;
                    for r in 0..3 {
                        out[(top + r, k)] += along[r] * factor;
                        if p.turns {
                            out[(top + 3 + r, k)] += about[r] * factor * self.config.rad_in_m;
                        }
                    }
                }
            }
            top += p.rows();
        }
        for k in 0..extra {
            out[(targets + k, k)] = NEAR_WEIGHT;
        }
        for (row, (a, b)) in self.neighbours().enumerate() {
            for (share, sign) in [(a, 1.0), (b, -1.0)] {
                if let Ok(k) = self.free.binary_search(&share.joint) {
                    out[(targets + extra + row, k)] = sign * APART_WEIGHT / share.factor;
                }
            }
        }
        out
    }

    /// How a point shifts and turns with one joint, per rad or m.
    fn moved(&self, world: &World, joint: usize, id: &PointId) -> (Vector3<f64>, Vector3<f64>) {
        if !self.tree.moves(joint, id) {
            return (Vector3::zeros(), Vector3::zeros());
        }
        let (anchor, axis) = world.axes[joint];
        match self.tree.joints[joint].motion {
            JointMotion::Hinge => {
                let arm = world.point(id).translation.vector - anchor.coords;
                (axis.cross(&arm), axis)
            }
            JointMotion::Slide => (axis, Vector3::zeros()),
        }
    }

    /// One damped step over the free joints. Joints that would leave their range move to the limit,
    /// and the others are solved again for the rest.
    fn step(
        &self,
        jacobian: &DMatrix<f64>,
        error: &DVector<f64>,
        state: &[f64],
        damping: f64,
    ) -> DVector<f64> {
        let n = self.free.len();
        let mut step: DVector<f64> = DVector::zeros(n);
        let mut held = vec![false; n];
        for _ in 0..=n {
            let open: Vec<usize> = (0..n).filter(|k| !held[*k]).collect();
            if open.is_empty() {
                break;
            }
            let mut left = error.clone();
            for k in (0..n).filter(|k| held[*k]) {
                left -= jacobian.column(k) * step[k];
            }
            let j = jacobian.select_columns(&open);
            let normal = j.transpose() * &j + DMatrix::identity(open.len(), open.len()) * damping;
            let Some(solved) = normal.cholesky().map(|c| c.solve(&(j.transpose() * left))) else {
                break;
            };
            let biggest = solved.amax();
            let limit = self.config.step_limit;
            let scale = if biggest > limit { limit / biggest } else { 1.0 };
            let mut newly = false;
            for (o, &k) in open.iter().enumerate() {
                let change = solved[o] * scale;
                let (range, q) = (self.range(self.free[k]), state[self.free[k]]);
                let room = [range[0] - q, range[1] - q];
                let fits = change >= room[0] && change <= room[1];
                if !fits {
                    held[k] = true;
                    newly = true;
                }
                step[k] = change.clamp(room[0].min(0.0), room[1].max(0.0));
            }
            if !newly {
                break;
            }
        }
        step
    }

    /// Distance, m, and angle, rad, of each target in stacked errors.
    pub(super) fn measure(&self, error: &DVector<f64>) -> (Vec<f64>, Vec<f64>) {
        let norm = |at: usize| error.rows(at, 3).norm();
        let (mut distances, mut angles, mut top) = (Vec::new(), Vec::new(), 0);
        for p in self.pulls {
            distances.push(norm(top) / p.weight);
            let angle = || norm(top + 3) / (self.config.rad_in_m * p.weight);
            angles.push(if p.turns { angle() } else { 0.0 });
            top += p.rows();
        }
        (distances, angles)
    }

    /// Whether all errors are within this share of the tolerance.
    pub(super) fn is_reached(&self, error: &DVector<f64>, share: f64) -> bool {
        let most = self.config.tolerance_m * share;
        let (distances, angles) = self.measure(error);
        distances.iter().all(|d| *d <= most)
            && angles.iter().all(|a| a * self.config.rad_in_m <= most)
    }
}

impl Pull {
    /// What keeps a loop closed.
    pub(super) fn closing(closure: &Closure) -> Pull {
        let [a, b] = closure.ends.each_ref().map(Anchor::id);
        Pull { id: a, goal: Goal::Point(b), turns: closure.turns, weight: CLOSURE_WEIGHT }
    }

    pub(super) fn rows(&self) -> usize {
        if self.turns { 6 } else { 3 }
    }

    pub(super) fn points(&self) -> impl Iterator<Item = &PointId> {
        let other = match &self.goal {
            Goal::Point(other) => Some(other),
            Goal::Place(_) => None,
        };
        std::iter::once(&self.id).chain(other)
    }
}
