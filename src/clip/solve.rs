//! Joint values for end-effector goals, along a clip.
//!
//! Keys are solved in order of time. Each search starts at the values of the key or frame before,
//! so that the arm does not jump to another solution. It prefers solutions near a posture: the
//! key's own values if it has some, else the line between the neighbouring keys with joint values.
//! Between two keys with goals for the same points, a `linear` or `cubic` fill is a path of the
//! points. The path is straight or smooth, with the shortest rotation between orientations, and
//! every frame of it is solved. A key between them cuts the path if it moves a joint that moves the points.
//! All other fills go from a joint's value in one key to its value in the next.
//!
//! This needs the robot's [`Kinematics`], not its simulator. Rejected: storing the joint values in
//! the key. They would be wrong as soon as a neighbouring key, the posture or the model changes.

use std::cell::Cell;
use std::collections::BTreeMap;

use robert_kinematics::{IkConfig, IkResult, Kinematics, Target};

use super::document::{Clip, Goal, Key, Row, Start};
use super::flaw::{Flaw, Invalid, hint, some};
use super::grid::round;
use super::joints::JointTable;
use super::path::{Path, Paths};
use super::reach::{Reach, Reached};
use super::tracks::Tracks;

/// Distance that counts as reached, m.
const TOLERANCE_M: f64 = 1e-4;

/// Iterations of a search; each begins near its goal.
const ITERATIONS: u32 = 40;

/// The work that one clip may take: iterations times (20 + the number of joints). A clip that
/// reaches its goals needs a few iterations per frame; a clip with goals out of reach needs all of
/// them.
const WORK: usize = 2_000_000;

/// Searches from elsewhere for a goal that seems out of reach.
const RESTARTS: u32 = 8;

/// A joint that goes farther than this from one frame of a path to the next jumps to another solution, rad or m.
const JUMP: f64 = 0.5;

/// Iterations of each search after that work is used up. A path is still followed from frame to
/// frame.
const LATE_ITERATIONS: u32 = 4;

/// The result of the search.
#[derive(Clone, Debug, Default)]
pub(super) struct Solved {
    /// Values of each key with end-effector goals, by index; `None` for other keys.
    pub(super) rows: Vec<Option<Row>>,
    /// Values of frames on the path of a point: joints by index.
    pub(super) frames: Vec<(u32, Vec<(usize, f64)>)>,
    /// How closely the points meet their goals.
    pub(super) reached: Vec<Reached>,
}

/// Solves all end-effector goals of a valid clip; its keys are in order.
///
/// # Errors
/// [`Flaw::NeedsRobot`], [`Flaw::UnknownPoint`].
pub(super) fn solve(clip: &Clip, table: Option<&JointTable>) -> Result<Solved, Invalid> {
    let Some(first) = clip.keys.iter().position(|k| !k.reach.is_empty()) else {
        return Ok(Solved::default());
    };
    let Some((table, tree)) = table.and_then(|t| Some((t, t.kinematics.as_ref()?))) else {
        let flaw = Flaw::NeedsRobot { robot: clip.robot.id.clone() };
        return Err(Invalid { pointer: format!("/keys/{first}/reach"), flaw });
    };
    check_points(clip, tree)?;
    Ok(Solver::new(clip, table, tree).run())
}

/// Every point is one that the robot has.
fn check_points(clip: &Clip, tree: &Kinematics) -> Result<(), Invalid> {
    for (i, key) in clip.keys.iter().enumerate() {
        for (n, reach) in key.reach.iter().enumerate() {
            let Err(unknown) = tree.point(&reach.point) else { continue };
            let names: Vec<&str> = match unknown.kind {
                "site" => tree.sites.iter().map(|s| s.name.as_str()).collect(),
                _ => tree.links.iter().map(|l| l.name.as_str()).collect(),
            };
            let kind = unknown.kind;
            let mut hint = hint(&unknown.name, names.iter().copied());
            if hint.is_empty() && !names.is_empty() {
                hint = format!("; it has {}", some(names));
            }
            let flaw = Flaw::UnknownPoint { kind, name: unknown.name, hint };
            return Err(Invalid { pointer: format!("/keys/{i}/reach/{n}/{kind}"), flaw });
        }
    }
    Ok(())
}

struct Solver<'a> {
    clip: &'a Clip,
    tree: &'a Kinematics,
    /// For each joint of the clip, its joint in the tree of bodies.
    to_state: Vec<Option<usize>>,
    /// Joints of the tree that the clip does not have; they do not move.
    locked: Vec<usize>,
    /// The state before the clip, which is also the value of joints that the clip does not have.
    rest: Vec<f64>,
    /// By key, the joints of the tree that move the points that it places.
    movers: Vec<Vec<usize>>,
    /// The keys that give each joint of the clip a value, of their own or by their goals.
    tracks: Tracks,
    /// For each joint of the clip, the keys that have a value of their own for it: first frame, last frame,
    /// value.
    known: Vec<Vec<(u32, u32, f64)>>,
    /// What is left of [`WORK`].
    left: Cell<usize>,
    found: Solved,
}

impl<'a> Solver<'a> {
    fn new(clip: &'a Clip, table: &JointTable, tree: &'a Kinematics) -> Self {
        let index = |name: &String| table.joints.iter().position(|j| &j.name == name);
        let to_state: Vec<Option<usize>> = clip.robot.joints.iter().map(index).collect();
        let locked = (0..tree.joints.len()).filter(|i| !to_state.contains(&Some(*i))).collect();
        let mut rest = table.rest.clone();
        rest.resize(tree.joints.len(), 0.0);
        let start: Row = match &clip.start {
            Some(Start::Q(q)) => q.iter().copied().map(Some).collect(),
            Some(Start::Pose(pose)) => clip.poses.get(pose).cloned().unwrap_or_default(),
            None => Vec::new(),
        };
        for (at, value) in to_state.iter().zip(&start) {
            if let (Some(at), Some(value)) = (at, value) {
                rest[*at] = *value;
            }
        }
        let points = |key: &Key| key.reach.iter().map(|r| r.point.clone()).collect::<Vec<_>>();
        let places = |key: &Key| tree.movers(&points(key)).unwrap_or_default();
        let movers: Vec<Vec<usize>> = clip
            .keys
            .iter()
            .map(|key| if key.reach.is_empty() { Vec::new() } else { places(key) })
            .collect();
        let tracks = Tracks::of(clip.keys.len(), clip.dim(), |i, j| {
            let key = &clip.keys[i];
            let is_solved = |at: usize| key.goal == Goal::Open || movers[i].contains(&at);
            to_state[j].is_some_and(is_solved) && !key.reach.is_empty()
                || clip.row(key).is_some_and(|row| row[j].is_some())
        });
        let mut known = vec![Vec::new(); clip.dim()];
        for (i, key) in clip.keys.iter().enumerate() {
            let row = clip.row(key).into_iter().flatten();
            for (j, (list, value)) in known.iter_mut().zip(row).enumerate() {
                let last = || tracks.hold_end(clip, i, j).saturating_sub(1).max(key.frame);
                list.extend(value.map(|v| (key.frame, last(), v)));
            }
        }
        let rows = vec![None; clip.keys.len()];
        let found = Solved { rows, ..Solved::default() };
        let left = Cell::new(WORK);
        Solver { clip, tree, to_state, locked, rest, movers, tracks, known, left, found }
    }

    /// The paths of points.
    fn paths(&self) -> Paths {
        Paths::of(self.clip, |i| {
            let moved = (0..self.clip.dim()).filter(|j| self.moves(i, *j));
            moved.filter_map(|j| self.tracks.next(i, j)).min()
        })
    }

    /// Whether a joint of the clip moves the points that key `i` places.
    fn moves(&self, i: usize, joint: usize) -> bool {
        self.to_state[joint].is_some_and(|at| self.movers[i].contains(&at))
    }

    fn run(mut self) -> Solved {
        let paths = self.paths();
        let mut before: Option<Vec<f64>> = None;
        // By key, the state at the beginning of the path that ends there.
        let mut begun: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
        for (i, key) in self.clip.keys.iter().enumerate() {
            let posture = self.posture(key.frame);
            if !key.reach.is_empty() {
                let path = paths.before(self.clip, i).zip(begun.remove(&i));
                let mut found = if let Some((path, from)) = path {
                    // The key is the last frame of the way to it.
                    let last = self.along(&path, from);
                    let near = drawn(&last, &posture);
                    self.search(&[&last], &near, &targets(&key.reach), RESTARTS)
                } else {
                    // If the motion so far leads nowhere: the posture, and the start of the clip.
                    let start = before.as_ref().unwrap_or(&posture);
                    let starts = [start.as_slice(), &posture, &self.rest];
                    self.search(&starts, &posture, &targets(&key.reach), RESTARTS)
                };
                // Joints that do not move the points have the posture's values.
                let others = self.to_state.iter().flatten();
                for &at in
                    others.filter(|at| key.goal == Goal::Open && !self.movers[i].contains(at))
                {
                    found.state[at] = posture[at];
                }
                self.note(i, key.frame, &key.reach, &found);
                self.found.rows[i] = Some(self.row(i, key, &found.state));
                if let Some(path) = paths.after(self.clip, i) {
                    begun.insert(path.to, found.state.clone());
                }
                before = Some(found.state);
            } else if let Some(row) = self.clip.row(key) {
                let mut state = posture;
                for (j, (at, value)) in self.to_state.iter().zip(row).enumerate() {
                    let Some(at) = *at else { continue };
                    let solved = |b: &usize| !self.clip.keys[*b].reach.is_empty();
                    let kept = || self.tracks.before(i, j).filter(solved).and(before.as_ref());
                    // A joint without a value stays where goals led it.
                    if let Some(value) = value.or_else(|| Some(kept()?[at])) {
                        state[at] = value;
                    }
                }
                before = Some(state);
            }
        }
        self.found
    }

    /// Solves the frames on a path, and returns the last state.
    fn along(&mut self, path: &Path<'_>, mut state: Vec<f64>) -> Vec<f64> {
        let moved: Vec<(usize, usize)> = self
            .to_state
            .iter()
            .enumerate()
            .filter(|(j, _)| self.moves(path.key, *j))
            .filter_map(|(j, at)| at.map(|at| (j, at)))
            .collect();
        let mut worst: Option<(u32, Vec<Reach>, IkResult)> = None;
        let mut restarts = RESTARTS;
        for frame in path.first..path.last {
            let goals = path.goals(frame);
            // On its way a point does not jump to another solution.
            let near = drawn(&state, &self.posture(frame));
            let mut found = self.search(&[&state], &near, &targets(&goals), 0);
            if !found.reached && restarts > 0 {
                let other = self.search(&[&state], &near, &targets(&goals), restarts);
                let way = state.iter().zip(&other.state).map(|(a, b)| (a - b).abs());
                if other.reached && way.fold(0.0, f64::max) < JUMP {
                    found = other;
                }
            }
            // Where a goal is out of reach, the next one probably is, too.
            restarts = if found.reached { RESTARTS } else { 0 };
            let values = moved.iter().map(|&(j, at)| (j, found.state[at])).collect();
            self.found.frames.push((frame, values));
            state.clone_from(&found.state);
            let far = |r: &IkResult| r.distance_m + 0.1 * r.angle_rad;
            if !found.reached && worst.as_ref().is_none_or(|w| far(&found) > far(&w.2)) {
                worst = Some((frame, goals, found));
            }
        }
        if let Some((frame, goals, found)) = worst {
            self.note(path.key, frame, &goals, &found);
        }
        state
    }

    /// Searches from each of these starts in turn, until one search reaches the goals; at last from elsewhere.
    fn search(
        &self,
        starts: &[&[f64]],
        posture: &[f64],
        targets: &[Target],
        restarts: u32,
    ) -> IkResult {
        let spent = self.left.get() == 0;
        let config = IkConfig {
            near: Some(posture.to_vec()),
            locked: self.locked.clone(),
            tolerance_m: TOLERANCE_M,
            iterations: if spent { LATE_ITERATIONS } else { ITERATIONS },
            ..IkConfig::default()
        };
        let mut best: Option<IkResult> = None;
        let starts = &starts[..if spent { 1 } else { starts.len() }];
        for (i, start) in starts.iter().enumerate() {
            let is_last = i + 1 == starts.len() && !spent;
            let config =
                IkConfig { restarts: if is_last { restarts } else { 0 }, ..config.clone() };
            // All points were found before the search.
            let Ok(found) = self.tree.ik(start, targets, &config) else { continue };
            let work = found.iterations as usize * (20 + self.tree.joints.len());
            self.left.set(self.left.get().saturating_sub(work));
            if found.reached {
                return found;
            }
            let far = |r: &IkResult| r.distance_m + config.rad_in_m * r.angle_rad;
            // Another start must pay: a jump to a solution that is as far off only disturbs.
            if best.as_ref().is_none_or(|b| far(&found) < 0.9 * far(b)) {
                best = Some(found);
            }
        }
        best.unwrap_or_else(|| unreachable!("every point was looked up before"))
    }

    /// The joint values at a frame without end-effector goals: on the line between the keys around
    /// it, and before the first key those of the start.
    fn posture(&self, frame: u32) -> Vec<f64> {
        let mut state = self.rest.clone();
        for (known, at) in self.known.iter().zip(&self.to_state) {
            let Some(at) = *at else { continue };
            let next = known.partition_point(|k| k.0 <= frame);
            let (before, after) = (next.checked_sub(1).map(|b| known[b]), known.get(next));
            state[at] = match (before, after) {
                (Some((_, last, a)), Some(&(to, _, b))) if frame > last => {
                    a + (b - a) * f64::from(frame - last) / f64::from(to - last)
                }
                (Some((_, _, a)), _) => a,
                // Before the first key with values there is the start, if the clip has one.
                (None, Some(&(_, _, b))) if self.clip.start.is_none() => b,
                (None, Some(&(to, _, b))) if to > 0 => {
                    let a = state[at];
                    a + (b - a) * f64::from(frame) / f64::from(to)
                }
                (None, _) => state[at],
            };
        }
        state
    }

    /// The values of a key: all solved ones if it has none of its own, otherwise its own and the
    /// solved ones of the other joints.
    fn row(&self, i: usize, key: &Key, state: &[f64]) -> Row {
        let movers = &self.movers[i];
        let own = self.clip.row(key);
        let value = |(j, at): (usize, &Option<usize>)| {
            let held = own.map(|row| row.get(j).copied().flatten());
            match (held, *at) {
                (Some(held), Some(at)) if !movers.contains(&at) => held,
                (_, Some(at)) => Some(round(state[at])),
                (held, None) => held.flatten(),
            }
        };
        self.to_state.iter().enumerate().map(value).collect()
    }

    fn note(&mut self, key: usize, frame: u32, goals: &[Reach], found: &IkResult) {
        for (goal, reach) in goals.iter().enumerate() {
            let movers = self.tree.movers(std::slice::from_ref(&reach.point)).unwrap_or_default();
            let names = self.to_state.iter().zip(&self.clip.robot.joints);
            let joints = names.filter(|(at, _)| at.is_some_and(|at| movers.contains(&at)));
            let Ok(id) = self.tree.point(&reach.point) else { continue };
            let place = self.tree.place(&found.state, &id);
            let quat = reach.quat.map(|_| place.quat);
            let instead = Reach { point: reach.point.clone(), pos: place.pos, quat }.normal();
            let (distance_m, angle_rad) = (found.distances_m[goal], found.angles_rad[goal]);
            self.found.reached.push(Reached {
                key,
                frame,
                goal,
                distance_m,
                angle_rad,
                instead,
                joints: joints.map(|(_, name)| name.clone()).collect(),
                reached: distance_m <= TOLERANCE_M && angle_rad * 0.1 <= TOLERANCE_M,
            });
        }
    }
}

/// The posture near which a frame on a path is solved: the state of the frame before, moved a
/// little toward the posture of the keys. The best solution of one frame may be far from that of
/// the next, so the robot approaches that posture gradually.
fn drawn(state: &[f64], posture: &[f64]) -> Vec<f64> {
    const SHARE: f64 = 0.2;
    state.iter().zip(posture).map(|(q, p)| q + SHARE * (p - q)).collect()
}

fn targets(goals: &[Reach]) -> Vec<Target> {
    goals.iter().map(|r| Target { point: r.point.clone(), pos: r.pos, quat: r.quat }).collect()
}
