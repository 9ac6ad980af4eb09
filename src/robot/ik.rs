//! Inverse kinematics: joint values that bring sites or body points to their targets.
//!
//! Damped least squares (Wampler 1986; Nakamura and Hanafusa 1986) on the Jacobians of the
//! simulator, with all targets stacked. A joint that a step would move past its limit is held at
//! the limit, and the step is solved again without it, so that the others take over. Rejected:
//! clipping the step, which stalls before reachable targets. The damping grows when a step does not
//! help and shrinks when it does (Levenberg-Marquardt).

use nalgebra::{DMatrix, DVector};

use super::{Error, Robot};
use robert_mujoco::{Data, Kind};

/// The point that is moved.
#[derive(Clone, Debug, PartialEq)]
pub enum Point {
    /// A site, by name.
    Site(String),
    /// A point fixed in a body's frame, m.
    Body {
        /// The body's name.
        body: String,
        /// The point in its frame, m.
        offset: [f64; 3],
    },
}

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

/// Options of the search.
#[derive(Clone, Debug, PartialEq)]
pub struct IkConfig {
    /// State indices of joints that may move; `None` for all joints that do not follow another one
    /// without a motor.
    pub joints: Option<Vec<usize>>,
    /// State indices of joints that must not move; they override the above.
    pub locked: Vec<usize>,
    /// Greatest number of iterations.
    pub iterations: u32,
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
            iterations: 100,
            tolerance_m: 1e-4,
            rad_in_m: 0.1,
            step_limit: 0.3,
        }
    }
}

/// Result of the search.
#[derive(Clone, Debug, PartialEq)]
pub struct IkResult {
    /// Joint values, inside all limits; (`state_dim`).
    pub state: Vec<f64>,
    /// Greatest distance of a point from its goal, m.
    pub distance_m: f64,
    /// Greatest orientation error, rad; 0 if no orientation was requested.
    pub angle_rad: f64,
    /// Whether every target was reached.
    pub reached: bool,
    /// Iterations used.
    pub iterations: u32,
}

/// A target with its ids looked up.
struct Pull {
    id: PointId,
    pos: [f64; 3],
    quat: Option<[f64; 4]>,
}

enum PointId {
    Site(usize),
    Body(usize, [f64; 3]),
}

impl Robot {
    /// Moves joints so that the targets are met as well as limits and locks allow. It begins at
    /// `start` and stays near it. `data` is work space of this robot's model.
    ///
    /// # Errors
    /// [`Error::UnknownPoint`], [`Error::Length`], [`Error::Simulator`].
    pub fn ik(
        &self,
        data: &mut Data,
        start: &[f64],
        targets: &[Target],
        config: &IkConfig,
    ) -> Result<IkResult, Error> {
        self.check_len("start", start.len(), self.state_dim())?;
        let pulls = targets.iter().map(|t| self.pull(t)).collect::<Result<Vec<_>, _>>()?;
        let free = self.free_joints(config);
        let mut state: Vec<f64> = start
            .iter()
            .zip(self.joints())
            .enumerate()
            .map(|(i, (v, j))| if free.contains(&i) { v.clamp(j.range[0], j.range[1]) } else { *v })
            .collect();
        self.follow(&mut state, &free);
        let mut damping = 1e-4_f64;
        let mut error = self.ik_error(data, &state, &pulls, config)?;
        let mut used = 0;
        while used < config.iterations && !reached(&pulls, &error, config) && !free.is_empty() {
            used += 1;
            let jacobian = self.ik_jacobian(data, &pulls, &free, config)?;
            let mut improved = false;
            for _ in 0..6 {
                let step = self.ik_step(&jacobian, &error, &state, &free, damping, config);
                let mut next = state.clone();
                for (k, &i) in free.iter().enumerate() {
                    let [lo, hi] = self.joints()[i].range;
                    next[i] = (next[i] + step[k]).clamp(lo, hi);
                }
                self.follow(&mut next, &free);
                let next_error = self.ik_error(data, &next, &pulls, config)?;
                if next_error.norm() < error.norm() * (1.0 - 1e-9) {
                    (state, error) = (next, next_error);
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
        // The work space is at the last trial; set it to the result.
        error = self.ik_error(data, &state, &pulls, config)?;
        let (distance_m, angle_rad) = measure(&pulls, &error, config);
        Ok(IkResult {
            reached: reached(&pulls, &error, config),
            state,
            distance_m,
            angle_rad,
            iterations: used,
        })
    }

    fn pull(&self, t: &Target) -> Result<Pull, Error> {
        let id = match &t.point {
            Point::Site(name) => PointId::Site(self.site(name)?),
            Point::Body { body, offset } => {
                let id = self.model().id(Kind::Body, body);
                PointId::Body(id.ok_or_else(|| self.unknown_point(body))?, *offset)
            }
        };
        Ok(Pull { id, pos: t.pos, quat: t.quat.map(unit) })
    }

    fn free_joints(&self, config: &IkConfig) -> Vec<usize> {
        let all: Vec<usize> = match &config.joints {
            Some(list) => list.clone(),
            None => (0..self.state_dim()).collect(),
        };
        let follows: Vec<usize> = self.mimics().into_iter().map(|m| m.0).collect();
        let mut free: Vec<usize> = all
            .into_iter()
            .filter(|i| *i < self.state_dim() && !config.locked.contains(i) && !follows.contains(i))
            .collect();
        free.sort_unstable();
        free.dedup();
        free
    }

    /// Followers, leaders, offsets and multipliers by state index.
    fn mimics(&self) -> Vec<(usize, usize, f64, f64)> {
        self.profile()
            .couplings
            .iter()
            .filter_map(|c| match c {
                super::Coupling::Mimic { follower, leader, offset, multiplier } => Some((
                    self.joint_index(follower).ok()?,
                    self.joint_index(leader).ok()?,
                    *offset,
                    *multiplier,
                )),
                super::Coupling::Tendon { .. } => None,
            })
            .collect()
    }

    /// Moves followers along with leaders that may move.
    fn follow(&self, state: &mut [f64], free: &[usize]) {
        for (follower, leader, offset, multiplier) in self.mimics() {
            if !free.contains(&leader) {
                continue;
            }
            let Some(&lead) = state.get(leader) else { continue };
            if let Some(q) = state.get_mut(follower) {
                *q = offset + multiplier * lead;
            }
        }
    }

    /// Stacked errors, metres: three rows per position, three more per orientation.
    fn ik_error(
        &self,
        data: &mut Data,
        state: &[f64],
        pulls: &[Pull],
        config: &IkConfig,
    ) -> Result<DVector<f64>, Error> {
        self.write_state(data, state)?;
        data.kinematics()?;
        let mut rows = Vec::with_capacity(6 * pulls.len());
        for p in pulls {
            let (pos, mat) = place(data, &p.id);
            rows.extend(p.pos.iter().zip(pos).map(|(goal, at)| goal - at));
            if let Some(goal) = p.quat {
                rows.extend(turn(goal, mat).map(|v| v * config.rad_in_m));
            }
        }
        Ok(DVector::from_vec(rows))
    }

    /// (rows of `ik_error`, free joints); followers count through their leaders.
    fn ik_jacobian(
        &self,
        data: &mut Data,
        pulls: &[Pull],
        free: &[usize],
        config: &IkConfig,
    ) -> Result<DMatrix<f64>, Error> {
        let nv = self.model().nv();
        let rows: usize = pulls.iter().map(|p| if p.quat.is_some() { 6 } else { 3 }).sum();
        let mut out = DMatrix::zeros(rows, free.len());
        let (mut jp, mut jr) = (vec![0.0; 3 * nv], vec![0.0; 3 * nv]);
        let mimics = self.mimics();
        let mut top = 0;
        for p in pulls {
            match p.id {
                PointId::Site(s) => data.jac_site(s, &mut jp, &mut jr)?,
                PointId::Body(b, _) => {
                    let (pos, _) = place(data, &p.id);
                    data.jac_point(b, &pos, &mut jp, &mut jr)?;
                }
            }
            for (k, &i) in free.iter().enumerate() {
                let mut columns = vec![(i, 1.0)];
                columns.extend(mimics.iter().filter(|m| m.1 == i).map(|m| (m.0, m.3)));
                for (joint, factor) in columns {
                    let dof = self.joints()[joint].dofadr;
                    for r in 0..3 {
                        let at = r * nv + dof;
                        out[(top + r, k)] += jp[at] * factor;
                        if p.quat.is_some() {
                            out[(top + 3 + r, k)] += jr[at] * factor * config.rad_in_m;
                        }
                    }
                }
            }
            top += if p.quat.is_some() { 6 } else { 3 };
        }
        Ok(out)
    }

    /// One damped step over the free joints. Joints that would leave their range move to the limit,
    /// and the others are solved again for the rest.
    fn ik_step(
        &self,
        jacobian: &DMatrix<f64>,
        error: &DVector<f64>,
        state: &[f64],
        free: &[usize],
        damping: f64,
        config: &IkConfig,
    ) -> DVector<f64> {
        let n = free.len();
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
            let scale = if biggest > config.step_limit { config.step_limit / biggest } else { 1.0 };
            let mut newly = false;
            for (o, &k) in open.iter().enumerate() {
                let change = solved[o] * scale;
                let (joint, q) = (&self.joints()[free[k]], state[free[k]]);
                let room = [joint.range[0] - q, joint.range[1] - q];
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
}

/// World position and orientation (row-major) of a point.
fn place(data: &Data, id: &PointId) -> ([f64; 3], [f64; 9]) {
    let three = |v: &[f64], i: usize| v.as_chunks::<3>().0[i];
    let nine = |v: &[f64], i: usize| v.as_chunks::<9>().0[i];
    match id {
        PointId::Site(s) => (three(data.site_xpos(), *s), nine(data.site_xmat(), *s)),
        PointId::Body(b, offset) => {
            let (pos, m) = (three(data.xpos(), *b), nine(data.xmat(), *b));
            let [x, y, z] = offset;
            let along = |r: usize| m[3 * r] * x + m[3 * r + 1] * y + m[3 * r + 2] * z;
            ([pos[0] + along(0), pos[1] + along(1), pos[2] + along(2)], m)
        }
    }
}

/// Rotation vector in the world from orientation `m` to the goal quaternion, rad.
fn turn(goal: [f64; 4], m: [f64; 9]) -> [f64; 3] {
    use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion};
    let now = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(
        Matrix3::from_row_slice(&m),
    ));
    let [w, x, y, z] = goal;
    let goal = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    (goal * now.inverse()).scaled_axis().into()
}

fn unit(q: [f64; 4]) -> [f64; 4] {
    let n = q.iter().map(|v| v * v).sum::<f64>().sqrt();
    if n > 1e-9 { q.map(|v| v / n) } else { [1.0, 0.0, 0.0, 0.0] }
}

/// Greatest distance, m, and greatest angle, rad, in stacked errors.
fn measure(pulls: &[Pull], error: &DVector<f64>, config: &IkConfig) -> (f64, f64) {
    let norm = |at: usize| (at..at + 3).map(|r| error[r].powi(2)).sum::<f64>().sqrt();
    let (mut distance, mut angle, mut top) = (0.0_f64, 0.0_f64, 0);
    for p in pulls {
        distance = distance.max(norm(top));
        top += 3;
        if p.quat.is_some() {
            angle = angle.max(norm(top) / config.rad_in_m);
            top += 3;
        }
    }
    (distance, angle)
}

fn reached(pulls: &[Pull], error: &DVector<f64>, config: &IkConfig) -> bool {
    let (distance, angle) = measure(pulls, error, config);
    distance <= config.tolerance_m && angle * config.rad_in_m <= config.tolerance_m
}

#[cfg(test)]
mod tests {
    use super::*;
    use robert_base::rng::{Rng, Stream};

    fn site(robot: &Robot, data: &mut Data, state: &[f64], name: &str) -> [f64; 3] {
        robot.write_state(data, state).unwrap();
        data.kinematics().unwrap();
        place(data, &PointId::Site(robot.site(name).unwrap())).0
    }

    fn within_limits(robot: &Robot, state: &[f64]) -> bool {
        robot.joints().iter().zip(state).all(|(j, v)| *v >= j.range[0] && *v <= j.range[1])
    }

    #[test]
    fn every_fingertip_reaches_where_it_could_be() {
        let robot = Robot::builtin("shadow_hand").unwrap();
        let mut data = Data::new(robot.model()).unwrap();
        let mut missed = Vec::new();
        for (k, tip) in robot.profile().ik_sites.clone().iter().enumerate() {
            for trial in 0..20 {
                let mut rng = Rng::new(1, Stream::Test, 100 * k as u64 + trial);
                let goal_state: Vec<f64> =
                    robot.joints().iter().map(|j| rng.range(j.range[0], j.range[1])).collect();
                let goal = site(&robot, &mut data, &goal_state, tip);
                let target = Target { point: Point::Site(tip.clone()), pos: goal, quat: None };
                let r =
                    robot.ik(&mut data, &robot.home(), &[target], &IkConfig::default()).unwrap();
                assert!(within_limits(&robot, &r.state));
                if !r.reached {
                    missed.push((tip.clone(), trial, r.distance_m));
                }
            }
        }
        assert!(missed.len() <= 5, "{} of 100 missed: {missed:?}", missed.len());
    }

    #[test]
    fn locked_joints_stay_and_subsets_move_alone() {
        let robot = Robot::builtin("ur5e").unwrap();
        let mut data = Data::new(robot.model()).unwrap();
        let home = robot.home();
        let mut pos = site(&robot, &mut data, &home, "end_effector");
        pos[2] -= 0.15;
        let target = Target { point: Point::Site("end_effector".into()), pos, quat: None };
        let config = IkConfig { locked: vec![0, 3], ..IkConfig::default() };
        let r = robot.ik(&mut data, &home, std::slice::from_ref(&target), &config).unwrap();
        assert!(r.reached, "{r:?}");
        assert_eq!((r.state[0], r.state[3]), (home[0], home[3]));
        let config = IkConfig { joints: Some(vec![1]), ..IkConfig::default() };
        let r = robot.ik(&mut data, &home, &[target], &config).unwrap();
        assert!(!r.reached);
        assert_ne!(r.state[1], home[1]);
        assert_eq!(
            [r.state[0], r.state[2], r.state[3], r.state[4]],
            [home[0], home[2], home[3], home[4]]
        );
    }

    #[test]
    fn two_targets_and_a_body_point_at_once() {
        let robot = Robot::builtin("shadow_hand").unwrap();
        let mut data = Data::new(robot.model()).unwrap();
        let mut goal_state = robot.home();
        for (name, v) in [("FFJ3", 0.7), ("FFJ2", 0.6), ("MFJ3", 0.4), ("THJ4", 0.8), ("THJ1", 0.4)]
        {
            goal_state[robot.joint_index(name).unwrap()] = v;
        }
        let ff = site(&robot, &mut data, &goal_state, "fftip");
        let th = site(&robot, &mut data, &goal_state, "thtip");
        let body = robot.model().id(Kind::Body, "mfdistal").unwrap();
        let mf = place(&data, &PointId::Body(body, [0.0, 0.0, 0.02])).0;
        let targets = [
            Target { point: Point::Site("fftip".into()), pos: ff, quat: None },
            Target { point: Point::Site("thtip".into()), pos: th, quat: None },
            Target {
                point: Point::Body { body: "mfdistal".into(), offset: [0.0, 0.0, 0.02] },
                pos: mf,
                quat: None,
            },
        ];
        let r = robot.ik(&mut data, &robot.home(), &targets, &IkConfig::default()).unwrap();
        assert!(r.reached, "{r:?}");
        for name in ["RFJ3", "LFJ3", "LFJ5"] {
            let i = robot.joint_index(name).unwrap();
            assert_eq!(r.state[i], 0.0, "{name} has no part in it");
        }
    }

    #[test]
    fn orientation_is_met_and_far_goals_end_nearby() {
        let robot = Robot::builtin("ur5e").unwrap();
        let mut data = Data::new(robot.model()).unwrap();
        let goal_state = [0.3, -1.2, 1.4, -1.0, -1.3];
        let pos = site(&robot, &mut data, &goal_state, "end_effector");
        let s = robot.site("end_effector").unwrap();
        let m = place(&data, &PointId::Site(s)).1;
        let q = nalgebra::UnitQuaternion::from_rotation_matrix(
            &nalgebra::Rotation3::from_matrix_unchecked(nalgebra::Matrix3::from_row_slice(&m)),
        );
        let quat = Some([q.w, q.i, q.j, q.k]);
        let target = Target { point: Point::Site("end_effector".into()), pos, quat };
        let start = [0.1, -1.4, 1.2, -1.2, -1.5];
        let r = robot.ik(&mut data, &start, &[target], &IkConfig::default()).unwrap();
        assert!(r.reached && r.angle_rad < 1e-3, "{r:?}");
        let far =
            Target { point: Point::Site("end_effector".into()), pos: [0.0, 5.0, 1.6], quat: None };
        let r = robot.ik(&mut data, &start, &[far], &IkConfig::default()).unwrap();
        // Stretched out: the reach is 0.957 m minus the offset of the base.
        assert!(!r.reached && r.distance_m < 5.0 - 0.9, "{r:?}");
        let nobody = Target { point: Point::Site("nose".into()), pos: [0.0; 3], quat: None };
        assert!(robot.ik(&mut data, &start, &[nobody], &IkConfig::default()).is_err());
    }
}
