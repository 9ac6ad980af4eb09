//! One simulated robot as an environment: reset, act, observe.
//!
//! An episode is a function of its seed and its actions alone. It does not depend on the simulation
//! that it runs in, or on earlier episodes there. If plants vary, each episode has its own, and a
//! policy can recognise it only by past motion.

use std::sync::Arc;

use super::describe::describe;
use super::error::Error;
use robert_base::rng::Rng;
use robert_base::units::SUBSTEPS;
use robert_dataset::Robot as Described;
use robert_mujoco::Data;
use robert_robot::{Coupling, Gravity, PlantRange, Robot};

/// The distance beyond a stop, in the joint's unit, from which a frame is implausible.
const OVERSHOOT: f64 = 0.3;
/// Coordinates and speeds with a magnitude beyond this are implausible for any robot.
const WILD: f64 = 50.0;
const WILD_SPEED: f64 = 200.0;
/// Depth of self-contact that a start pose may have, m.
const PENETRATION: f64 = 0.002;
/// Frames without torque in which contact may separate the links of a start pose.
const PASSIVE_FRAMES: usize = 3;
/// Number of start poses to try; the last one is used in any case.
const TRIES: usize = 20;

/// The distribution of start poses.
#[derive(Clone, Debug)]
enum Start {
    /// Centre plus or minus a half width, joint by joint.
    Around(Vec<f64>, Vec<f64>),
    /// From home toward a uniform pose in range, by a random share.
    Toward,
    /// Fingers open, curled, or each in between (robots with tendons).
    Hand,
}

/// The result of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Step {
    /// The step succeeded.
    Ok,
    /// The state is implausible for a real joint; the episode ends before this frame.
    Implausible,
    /// The simulation diverged and reset itself; the whole episode is discarded.
    Broken,
}

/// One robot in one simulation.
#[derive(Debug)]
pub(crate) struct Env {
    robot: Arc<Robot>,
    data: Data,
    /// The range of the plants of episodes; `None` for the robot's own.
    plants: Option<PlantRange>,
    start: Start,
    home: Vec<f64>,
    /// Centre and half span of each control range.
    span: Vec<(f64, f64)>,
    ctrl: Vec<f64>,
    /// Geoms that belong to the robot (not to the world).
    own: Vec<bool>,
    /// Frames for which each joint has stood at a stop; `None` while it has been there from the
    /// start.
    pinned: Vec<Option<u64>>,
    described: Described,
}

impl Env {
    /// A simulation of the robot of the file.
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub(crate) fn new(robot: &Arc<Robot>) -> Result<Self, Error> {
        Env::varied(robot, None)
    }

    /// As [`Env::new`], with another plant for each episode.
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub(crate) fn varied(robot: &Arc<Robot>, plants: Option<PlantRange>) -> Result<Self, Error> {
        let data = Data::new(robot.model())?;
        let span: Vec<(f64, f64)> = robot
            .actuators()
            .iter()
            .map(|a| {
                (0.5 * (a.ctrlrange[0] + a.ctrlrange[1]), 0.5 * (a.ctrlrange[1] - a.ctrlrange[0]))
            })
            .collect();
        Ok(Env {
            start: start_of(robot),
            home: robot.home(),
            ctrl: vec![0.0; span.len()],
            span,
            own: robot.model().geom_bodyid().iter().map(|&b| b != 0).collect(),
            pinned: vec![None; robot.state_dim()],
            described: describe(robot),
            robot: Arc::clone(robot),
            data,
            plants,
        })
    }

    /// State joints S.
    pub(crate) fn state_dim(&self) -> usize {
        self.robot.state_dim()
    }

    /// Puts the robot at rest in a start pose drawn from `rng`. If links overlap, contact gets a
    /// few frames to separate them, or the pose is drawn again.
    ///
    /// # Errors
    /// [`Error::Simulator`], [`Error::Robot`].
    pub(crate) fn reset(&mut self, rng: &mut Rng) -> Result<(), Error> {
        if let Some(plants) = &self.plants {
            let plant = plants.draw(rng.next_u64());
            self.data = Data::new(&plant.model(&self.robot)?)?;
        }
        for _ in 0..TRIES {
            let pose = self.draw(rng);
            self.place(&pose)?;
            self.data.forward()?;
            if self.depth() > PENETRATION {
                self.ctrl.iter_mut().zip(&self.span).for_each(|(c, (mid, _))| *c = *mid);
                self.data.set_ctrl(&self.ctrl)?;
                if self.data.step(PASSIVE_FRAMES * SUBSTEPS).is_err() || self.depth() > PENETRATION
                {
                    continue;
                }
                let apart = self.robot.state(&self.data);
                if self.is_wild() {
                    continue;
                }
                self.place(&apart)?;
            }
            return Ok(());
        }
        let home = self.home.clone();
        self.place(&home)
    }

    fn place(&mut self, pose: &[f64]) -> Result<(), Error> {
        self.data.reset()?;
        self.robot.write_state(&mut self.data, pose)?;
        for (j, (pinned, q)) in self.pinned.iter_mut().zip(pose).enumerate() {
            *pinned = (!self.described.is_near_limit(j, *q)).then_some(0);
        }
        Ok(())
    }

    fn count_pinned(&mut self) {
        let qpos = self.data.qpos();
        for ((j, joint), pinned) in self.robot.joints().iter().enumerate().zip(&mut self.pinned) {
            let near = self.described.is_near_limit(j, qpos[joint.qposadr]);
            *pinned = if near { pinned.map(|n| n + 1) } else { Some(0) };
        }
    }

    /// Frames for which some joint has stood at a stop that it did not start at.
    pub(crate) fn pinned_frames(&self) -> u64 {
        self.pinned.iter().flatten().copied().max().unwrap_or(0)
    }

    fn draw(&self, rng: &mut Rng) -> Vec<f64> {
        let joints = self.robot.joints();
        let inside = |j: usize, q: f64| {
            joints
                .get(j)
                .map_or(q, |s| if s.unbounded { q } else { q.clamp(s.range[0], s.range[1]) })
        };
        // Range of a joint; 1 rad or m around home if it has no stops.
        let range = |j: usize| {
            let s = &joints[j];
            if s.unbounded { [self.home[j] - 1.0, self.home[j] + 1.0] } else { s.range }
        };
        match &self.start {
            Start::Around(centre, half) => centre
                .iter()
                .zip(half)
                .enumerate()
                .map(|(j, (c, h))| inside(j, c + h * rng.range(-1.0, 1.0)))
                .collect(),
            Start::Toward => {
                let share = rng.uniform();
                (0..joints.len())
                    .map(|j| {
                        let [lo, hi] = range(j);
                        let u = rng.range(lo, hi);
                        self.home[j] + share * (u - self.home[j])
                    })
                    .collect()
            }
            Start::Hand => {
                let kind = rng.below(4);
                let whole = rng.uniform();
                let curls: Vec<f64> =
                    self.robot.profile().groups.iter().map(|_| rng.uniform()).collect();
                let jitter = 0.6 * rng.uniform();
                (0..joints.len())
                    .map(|j| {
                        let [lo, hi] = range(j);
                        let group = self
                            .robot
                            .profile()
                            .groups
                            .iter()
                            .position(|g| g.joints.contains(&joints[j].name));
                        let finger = group.map_or(0.0, |g| curls[g]);
                        let share = match kind {
                            0 => 0.0,
                            1 => 1.0,
                            2 => finger,
                            _ => whole,
                        };
                        // Only joints that bend one way curl; spreading ones stay near home.
                        let one_way = self.home[j] - lo < 0.25 * (hi - lo);
                        let goal = if one_way { hi } else { self.home[j] };
                        let u = rng.range(lo, hi);
                        let curled = self.home[j] + 0.95 * share * (goal - self.home[j]);
                        inside(j, curled + jitter * (u - curled))
                    })
                    .collect()
            }
        }
    }

    /// Holds this action in [-1, 1] for one frame.
    pub(crate) fn step(&mut self, action: &[f32]) -> Step {
        for ((c, (mid, half)), a) in self.ctrl.iter_mut().zip(&self.span).zip(action) {
            *c = mid + half * f64::from(*a).clamp(-1.0, 1.0);
        }
        if self.data.set_ctrl(&self.ctrl).is_err() || self.data.step(SUBSTEPS).is_err() {
            return Step::Broken;
        }
        if self.is_wild() {
            return Step::Implausible;
        }
        self.count_pinned();
        Step::Ok
    }

    fn is_wild(&self) -> bool {
        let (qpos, qvel) = (self.data.qpos(), self.data.qvel());
        self.robot.joints().iter().any(|j| {
            let q = qpos[j.qposadr];
            let v = qvel[j.dofadr];
            let beyond = !j.unbounded && (q < j.range[0] - OVERSHOOT || q > j.range[1] + OVERSHOOT);
            // Written so that NaN counts as implausible.
            beyond || !(q.abs() <= WILD && v.abs() <= WILD_SPEED)
        })
    }

    /// Copies the state joints' positions and velocities, (S) each.
    pub(crate) fn observe(&self, qpos: &mut [f32], qvel: &mut [f32]) {
        let (q, v) = (self.data.qpos(), self.data.qvel());
        for ((j, to_q), to_v) in self.robot.joints().iter().zip(qpos).zip(qvel) {
            *to_q = q.get(j.qposadr).map_or(f32::NAN, |&x| x as f32);
            *to_v = v.get(j.dofadr).map_or(f32::NAN, |&x| x as f32);
        }
    }

    /// Torque that holds the pose against gravity and springs, (S).
    ///
    /// # Errors
    /// [`Error::Robot`].
    pub(crate) fn weight(&self, gravity: &mut Gravity) -> Result<Vec<f64>, Error> {
        let force = gravity.at(self.data.qpos())?;
        Ok(self.robot.joints().iter().map(|j| force[j.dofadr]).collect())
    }

    /// All coordinates, (nq).
    pub(crate) fn qpos(&self) -> Vec<f64> {
        self.data.qpos().to_vec()
    }

    /// Whether two links of the robot touch.
    pub(crate) fn self_contact(&self) -> bool {
        self.data.touches_itself()
    }

    fn is_own(&self, geoms: [usize; 2]) -> bool {
        geoms.iter().all(|&g| self.own[g])
    }

    /// Deepest self-contact, m.
    fn depth(&self) -> f64 {
        let own = self.data.contacts().filter(|c| self.is_own(c.geoms));
        own.map(|c| -c.dist).fold(0.0, f64::max)
    }
}

/// The start poses of this robot: tested rules for the built-in robots, else derived from the
/// profile.
fn start_of(robot: &Robot) -> Start {
    match robot.id() {
        "pointmass" => Start::Around(vec![0.0; 2], vec![1.0; 2]),
        "ur5e" | "ur5e_light" => {
            let up = -std::f64::consts::FRAC_PI_2;
            Start::Around(vec![0.0, up, 0.0, up, 0.0], vec![2.2, 1.6, 2.2, 1.8, 2.2])
        }
        _ if has_tendons(robot) => Start::Hand,
        _ => Start::Toward,
    }
}

/// Whether a tendon couples joints, as in fingers.
pub(super) fn has_tendons(robot: &Robot) -> bool {
    robot.profile().couplings.iter().any(|c| matches!(c, Coupling::Tendon { .. }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use robert_base::rng::Stream;

    #[test]
    fn an_episode_depends_on_its_seed_only() {
        for id in ["pointmass", "ur5e", "shadow_hand"] {
            let robot = Arc::new(Robot::builtin(id).unwrap());
            let (mut fresh, mut used) = (Env::new(&robot).unwrap(), Env::new(&robot).unwrap());
            let s = fresh.state_dim();
            let run = |env: &mut Env, seed: u64| {
                let mut rng = Rng::new(seed, Stream::Test, 0);
                env.reset(&mut rng).unwrap();
                let mut out = vec![0.0; 2 * s];
                for _ in 0..20 {
                    let a: Vec<f32> =
                        env.span.iter().map(|_| rng.range(-1.0, 1.0) as f32).collect();
                    assert_eq!(env.step(&a), Step::Ok, "{id}");
                }
                let (q, v) = out.split_at_mut(s);
                env.observe(q, v);
                out
            };
            run(&mut used, 1);
            run(&mut used, 2);
            assert_eq!(run(&mut fresh, 3), run(&mut used, 3), "{id}");
        }
    }

    #[test]
    fn a_joint_at_a_stop_is_counted_unless_it_started_there() {
        let robot = Arc::new(Robot::builtin("ur5e").unwrap());
        let mut env = Env::new(&robot).unwrap();
        let top = robot.joints()[4].range[1];
        let mut pose = robot.home();
        pose[4] = top - 1.0;
        env.place(&pose).unwrap();
        let push = [0.0, 0.0, 0.0, 0.0, 1.0];
        let counts: Vec<u64> = (0..60)
            .map(|_| {
                assert_eq!(env.step(&push), Step::Ok);
                env.pinned_frames()
            })
            .collect();
        assert_eq!(counts[0], 0);
        assert!(counts[59] > 20, "{counts:?}");
        assert!(counts.windows(2).all(|w| w[1] == 0 || w[1] == w[0] + 1));
        pose[4] = top - 0.01;
        env.place(&pose).unwrap();
        assert_eq!((env.step(&push), env.pinned_frames()), (Step::Ok, 0));
    }

    #[test]
    fn starts_are_in_range_and_apart() {
        for id in ["ur5e", "shadow_hand"] {
            let robot = Arc::new(Robot::builtin(id).unwrap());
            let mut env = Env::new(&robot).unwrap();
            let mut deep = 0;
            for i in 0..40 {
                env.reset(&mut Rng::new(5, Stream::Test, i)).unwrap();
                env.data.forward().unwrap();
                deep += u32::from(env.depth() > 0.004);
                for (q, j) in robot.state(&env.data).iter().zip(robot.joints()) {
                    assert!(*q > j.range[0] - 0.25 && *q < j.range[1] + 0.25, "{id} {}", j.name);
                }
            }
            assert!(deep < 4, "{id}: {deep} of 40 starts overlap");
        }
    }
}
