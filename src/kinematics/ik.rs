//! Inverse kinematics: joint values that bring points to their targets.
//!
//! If there is a posture to stay near, a first search weighs it against the targets. A second
//! search without it then removes the small distance that is left, in the shortest steps. Rejected:
//! one search in the null space of the targets, because its rank is uncertain when an arm is nearly
//! stretched.
//!
//! Joints on one tendon move alike. Letting them move apart where targets are out of reach otherwise led to
//! poses that no tendon holds: the fingertip then was as far off in simulation, and the joints missed as well.
//!
//! The ends of closed loops ([`super::tree::Closure`]) are drawn together during the search with more weight than
//! the targets have. Where these are out of reach, a last search closes the loops alone.

use nalgebra::{Isometry3, Quaternion, UnitQuaternion};

use super::loops::Loops;
use super::place::{PointId, UnknownPoint};
use super::search::{Goal, IkConfig, Pull, Search};
use super::tree::{Kinematics, Point, Share};

/// A point and its goal.
#[derive(Clone, Debug, PartialEq)]
pub struct Target {
    /// The point that is moved.
    pub point: Point,
    /// Goal in the world, m.
    pub pos: [f64; 3],
    /// Goal orientation in the world, w x y z; `None` leaves it free.
    pub quat: Option<[f64; 4]>,
}

/// Result of the search.
#[derive(Clone, Debug, PartialEq)]
pub struct IkResult {
    /// Joint values, inside all limits; (joints).
    pub state: Vec<f64>,
    /// Distance of each point from its goal, m; in order of the targets.
    pub distances_m: Vec<f64>,
    /// Orientation error of each point, rad; 0 if no orientation was requested.
    pub angles_rad: Vec<f64>,
    /// Greatest distance of a point from its goal, m.
    pub distance_m: f64,
    /// Greatest orientation error, rad; 0 if no orientation was requested.
    pub angle_rad: f64,
    /// Whether every target was reached, with closed loops.
    pub reached: bool,
    /// Iterations used.
    pub iterations: u32,
}

impl Kinematics {
    /// Joints that move one of these points, and those that move along with them: where loops are closed, on one
    /// tendon, or because they follow. Sorted state indices.
    ///
    /// # Errors
    /// [`UnknownPoint`].
    pub fn movers(&self, points: &[Point]) -> Result<Vec<usize>, UnknownPoint> {
        let ids = points.iter().map(|p| self.point(p)).collect::<Result<Vec<_>, _>>()?;
        let free = self.free_joints(&IkConfig::default());
        let moves = |i: &usize| ids.iter().any(|id| self.reaches(*i, id));
        let own = free.iter().copied().filter(moves).collect();
        let mut movers = Loops::new(self).along(own, &free).0;
        let led = |i: &usize| self.led(*i).is_some_and(|f| movers.binary_search(&f.leader).is_ok());
        let followers: Vec<usize> = (0..self.joints.len()).filter(led).collect();
        movers.extend(followers);
        movers.sort_unstable();
        Ok(movers)
    }

    /// Moves joints so that the targets are met as well as limits and locks allow. The search
    /// begins at `start` (joints) and stays near it, or near a posture.
    ///
    /// # Errors
    /// [`UnknownPoint`].
    pub fn ik(
        &self,
        start: &[f64],
        targets: &[Target],
        config: &IkConfig,
    ) -> Result<IkResult, UnknownPoint> {
        self.ik_meeting(start, targets, &[], config)
    }

    /// As [`Kinematics::ik`]. In addition, the two points of each pair are brought together; where
    /// they meet is not given. In the result pairs come after the targets.
    ///
    /// # Errors
    /// [`UnknownPoint`].
    pub fn ik_meeting(
        &self,
        start: &[f64],
        targets: &[Target],
        pairs: &[(Point, Point)],
        config: &IkConfig,
    ) -> Result<IkResult, UnknownPoint> {
        let (mut best, searched) = self.ik_from(start, targets, pairs, config)?;
        for restart in 0..config.restarts {
            if best.reached {
                break;
            }
            let elsewhere = self.elsewhere(start, restart, &searched);
            let (found, _) = self.ik_from(&elsewhere, targets, pairs, config)?;
            let used = best.iterations + found.iterations;
            // A solution that is as far off would only be a jump.
            if found.reached {
                best = found;
            }
            best.iterations = used;
        }
        Ok(best)
    }

    /// A place to search from, farther from `start` with every second restart: the `searched` joints are part of the
    /// way to random values within their ranges.
    fn elsewhere(&self, start: &[f64], restart: u32, searched: &[usize]) -> Vec<f64> {
        let share = 0.15 * f64::from(1 + restart / 2);
        let mut state = start.to_vec();
        for &i in searched {
            let [lo, hi] = self.joints[i].range.unwrap_or([start[i] - 1.5, start[i] + 1.5]);
            let goal = lo + (hi - lo) * fraction(u64::from(restart) << 32 | i as u64);
            state[i] += share.min(1.0) * (goal - state[i]);
        }
        state
    }

    /// One search; also the joints that it moved, sorted.
    fn ik_from(
        &self,
        start: &[f64],
        targets: &[Target],
        pairs: &[(Point, Point)],
        config: &IkConfig,
    ) -> Result<(IkResult, Vec<usize>), UnknownPoint> {
        let mut pulls = targets.iter().map(|t| self.pull(t)).collect::<Result<Vec<_>, _>>()?;
        for (a, b) in pairs {
            let (id, goal) = (self.point(a)?, Goal::Point(self.point(b)?));
            pulls.push(Pull { id, goal, turns: false, weight: 1.0 });
        }
        let may = self.free_joints(config);
        let mut state = start.to_vec();
        for &i in &may {
            if let Some([lo, hi]) = self.joints[i].range {
                state[i] = state[i].clamp(lo, hi);
            }
        }
        self.follow(&mut state, &may);
        let moves = |i: &usize| pulls.iter().any(|p| p.points().any(|id| self.reaches(*i, id)));
        let own = may.iter().copied().filter(moves).collect();
        let (free, closures) = Loops::new(self).along(own, &may);
        let pulled =
            |tendon: &&Vec<Share>| tendon.iter().any(|s| free.binary_search(&s.joint).is_ok());
        let tendons: Vec<Vec<Share>> = self.tendons.iter().filter(pulled).cloned().collect();
        let wanted = pulls.len();
        pulls.extend(&closures);
        let searched = free.clone();
        let mut search = Search::new(self, &pulls, free, config);
        search.tendons = &tendons;
        let mut used = 0;
        if let Some(near) = &config.near {
            search.near = Some(near);
            let stalled = search.stalled();
            used += search.descend(&mut state, |error, before| {
                before - error.norm() < stalled || error.norm() < 1e-9
            });
            search.near = None;
        }
        used += search.closest(&mut state);
        search.tendons = &[];
        search.pulls = &closures;
        used += search.closest(&mut state);
        let is_closed = search.is_reached(&search.error(&self.world(&state), &state), 1.0);
        search.pulls = &pulls[..wanted];
        let error = search.error(&self.world(&state), &state);
        let (distances_m, angles_rad) = search.measure(&error);
        let most = |v: &[f64]| v.iter().copied().fold(0.0, f64::max);
        let result = IkResult {
            reached: search.is_reached(&error, 1.0) && is_closed,
            distance_m: most(&distances_m),
            angle_rad: most(&angles_rad),
            state,
            distances_m,
            angles_rad,
            iterations: used,
        };
        Ok((result, searched))
    }

    fn pull(&self, t: &Target) -> Result<Pull, UnknownPoint> {
        let [w, x, y, z] = t.quat.unwrap_or([1.0, 0.0, 0.0, 0.0]);
        let turn = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-9).unwrap_or_default();
        let goal = Isometry3::from_parts(t.pos.into(), turn);
        let (id, turns) = (self.point(&t.point)?, t.quat.is_some());
        Ok(Pull { id, goal: Goal::Place(goal), turns, weight: 1.0 })
    }

    fn reaches(&self, joint: usize, id: &PointId) -> bool {
        self.columns(joint).any(|(i, _)| self.moves(i, id))
    }
}

/// A number from 0 to 1 that looks random, the same on every machine: splitmix64 (Steele, Lea and Flood 2014).
fn fraction(seed: u64) -> f64 {
    let mut z = seed.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}
