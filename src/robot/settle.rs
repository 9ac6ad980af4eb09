//! Drives to a pose in simulation and reports where the robot comes to rest.
//!
//! A drawn pose may be unreachable: fingers touch the palm, and tendons couple joints. Commands
//! should contain the *settled* pose, so that the error of a policy is not the error of the
//! drawing. The drive is proportional with damping, in joint space, and compensates the model's
//! gravity and Coriolis forces at every simulator step; position servos are led at the speed of the
//! joints, and slowed down like motors, because a servo with little damping would swing for longer
//! than the drive lasts. A stiff hold at 20 Hz would ring on the finger joints, whose time constant
//! is 6 ms.

use super::{Error, Law, Loops, Robot, Transmission};
use robert_base::units::{CTRL_DT, FPS, SUBSTEPS};
use robert_mujoco::{Data, Model};

use nalgebra::{DMatrix, DVector};

/// A pose after settling.
#[derive(Clone, Debug, PartialEq)]
pub struct Settled {
    /// The commanded pose; (`state_dim`).
    pub target: Vec<f64>,
    /// The reached pose; (`state_dim`).
    pub reached: Vec<f64>,
    /// Distance between the two by joint; (`state_dim`).
    pub residual: Vec<f64>,
    /// The greatest residual.
    pub worst: f64,
    /// Index of the joint that has it.
    pub worst_joint: usize,
    /// Whether every residual is within the profile's tolerance.
    pub within: bool,
    /// Greatest joint speed at the end, rad/s or m/s.
    pub speed: f64,
    /// Whether joints that are not at their goals stand still; if not, more time would change the pose.
    pub rests: bool,
}

/// How long a joint that is not at its goal may go on moving, as a multiple of the profile's time.
const LONGEST: u32 = 20;
/// Share of the tolerance by which a joint moves in a second if it does not stand still.
const STILL: f64 = 0.2;

impl Robot {
    /// Drives from the home pose to `target` for the profile's time, or longer if a joint that is not at
    /// its goal still moves.
    ///
    /// # Errors
    /// [`Error::Length`]; [`Error::Simulator`] if the simulation diverges.
    pub fn settle(&self, target: &[f64]) -> Result<Settled, Error> {
        self.settle_for(&self.home(), target, LONGEST)
    }

    /// Drives from `start`, at rest, to `target` for the profile's time.
    ///
    /// # Errors
    /// As [`Robot::settle`].
    pub fn settle_from(&self, start: &[f64], target: &[f64]) -> Result<Settled, Error> {
        self.settle_for(start, target, 1)
    }

    /// Drives for the profile's time, and at most for `longest` times as long.
    fn settle_for(&self, start: &[f64], target: &[f64], longest: u32) -> Result<Settled, Error> {
        self.check_len("pose", target.len(), self.state_dim())?;
        let mut data = Data::new(self.model())?;
        self.write_state(&mut data, start)?;
        data.forward()?;
        let mut drive = Drive::new(self, start, target)?;
        let mut steps = |data: &mut Data, frames: u32| -> Result<(), Error> {
            for _ in 0..frames {
                // It takes a singular value decomposition, and hardly changes within a frame.
                let transmission = drive.transmission(data)?;
                for _ in 0..SUBSTEPS {
                    let ctrl = drive.ctrl(self, data, transmission.as_ref())?;
                    data.set_ctrl(&ctrl)?;
                    data.step(1)?;
                }
            }
            Ok(())
        };
        let settle = &self.profile().settle;
        steps(&mut data, settle.frames)?;
        // How far a joint comes in a second tells whether it rests.
        let still = STILL * settle.tolerance;
        let is_off = |j: usize, q: &[f64]| (q[j] - target[j]).abs() > settle.tolerance;
        let mut reached = self.state(&data);
        let mut rests = !(0..reached.len()).any(|j| is_off(j, &reached));
        for _ in 0..((longest - 1) * settle.frames).div_ceil(FPS) {
            if rests {
                break;
            }
            steps(&mut data, FPS)?;
            let before = std::mem::replace(&mut reached, self.state(&data));
            let moved = |j: usize| (reached[j] - before[j]).abs() > still;
            rests = !(0..reached.len()).any(|j| is_off(j, &reached) && moved(j));
        }
        let residual: Vec<f64> = reached.iter().zip(target).map(|(a, b)| (a - b).abs()).collect();
        let (worst_joint, worst) = residual
            .iter()
            .copied()
            .enumerate()
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .unwrap_or((0, 0.0));
        let speed = self.velocity(&data).iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        Ok(Settled {
            target: target.to_vec(),
            reached,
            within: worst <= self.profile().settle.tolerance,
            residual,
            worst,
            worst_joint,
            speed,
            rests,
        })
    }
}

/// The drive, and how far it has led the joints.
pub(super) struct Drive {
    target: Vec<f64>,
    /// The place of each joint on its way to the target. A position servo without a force limit
    /// would throw a light finger to a distant target.
    place: Vec<f64>,
    /// The way of each joint in a step: at its speed limit, or faster if it would not be there after
    /// half of the time.
    pace: Vec<f64>,
    /// The law of each actuator. An actuator without one gets its length at the joints'
    /// places as its control.
    laws: Vec<Option<Law>>,
    limit: Vec<[f64; 2]>,
    loops: Option<Loops>,
    /// Whether it also carries the springs of joints.
    holds: bool,
}

impl Drive {
    pub(super) fn new(robot: &Robot, start: &[f64], target: &[f64]) -> Result<Drive, Error> {
        let laws = robot.actuators().iter().map(|a| a.law).collect();
        let limit = robot.actuators().iter().map(|a| a.ctrlrange).collect();
        let half = 0.5 * f64::from(robot.profile().settle.frames) * CTRL_DT;
        let ways = target.iter().zip(start).map(|(to, from)| (to - from).abs());
        let pace = ways
            .zip(robot.joints())
            .map(|(way, joint)| joint.speed_limit.max(way / half) * robot.model().timestep())
            .collect();
        let loops = Loops::of(robot)?;
        let (target, place) = (target.to_vec(), start.to_vec());
        Ok(Drive { target, place, pace, laws, limit, loops, holds: false })
    }

    /// Holds the robot in this pose from now on, also against the springs of its joints.
    pub(super) fn hold(&mut self, pose: &[f64]) {
        self.target.copy_from_slice(pose);
        self.place.copy_from_slice(pose);
        self.holds = true;
    }

    /// What loops transmit at this pose; `None` without loops.
    pub(super) fn transmission(&mut self, data: &Data) -> Result<Option<Transmission>, Error> {
        self.loops.as_mut().map(|loops| loops.at(data.qpos())).transpose()
    }

    /// The controls whose joint forces are nearest (least squares) to the wanted ones. A position
    /// servo is commanded to the length that it has at the joints' places on the way, corrected for
    /// the deflection by its load.
    pub(super) fn ctrl(
        &mut self,
        robot: &Robot,
        data: &Data,
        transmission: Option<&Transmission>,
    ) -> Result<Vec<f64>, Error> {
        let model: &Model = robot.model();
        let (nu, nv) = (model.nu(), model.nv());
        let settle = &robot.profile().settle;
        let mut load = DVector::from_column_slice(data.qfrc_bias());
        if self.holds {
            load -= DVector::from_column_slice(data.qfrc_passive());
        }
        // What is wanted beside the load, and what slows a servo down that would swing.
        let (mut pull, mut brake) = (DVector::zeros(nv), DVector::zeros(nv));
        let mut ahead = DVector::zeros(nv);
        let speed = DVector::from_column_slice(data.qvel());
        for (i, joint) in robot.joints().iter().enumerate() {
            let (q, v) = (data.qpos()[joint.qposadr], data.qvel()[joint.dofadr]);
            let most = self.pace[i];
            self.place[i] += (self.target[i] - self.place[i]).clamp(-most, most);
            ahead[joint.dofadr] = self.place[i] - q;
            brake[joint.dofadr] = -settle.kd[i] * v;
            pull[joint.dofadr] = settle.kp[i] * (self.target[i] - q) + brake[joint.dofadr];
        }
        if let Some(transmission) = transmission {
            for torque in [&mut load, &mut pull, &mut brake] {
                transmission.apply(torque.as_mut_slice());
            }
        }
        let moment = DMatrix::from_row_slice(nu, nv, data.actuator_moment());
        let gram = &moment * moment.transpose() + DMatrix::identity(nu, nu) * 1e-12;
        let factor = gram.cholesky().ok_or(Error::Loops)?;
        let forces = |joint: &DVector<f64>| factor.solve(&(&moment * joint));
        let (force, held) = (forces(&(&load + pull)), forces(&(load + brake)));
        let (length, speed) = (&moment * &ahead, &moment * &speed);
        let one = |a: usize| {
            let at = data.actuator_length()[a] + length[a];
            let raw = match self.laws[a] {
                None => at,
                Some(Law { gain, bias: [b0, b1, _] }) if b1 < 0.0 => {
                    (held[a] - b1 * at - b0) / gain
                }
                Some(Law { gain, bias: [b0, _, b2] }) => (force[a] - b0 - b2 * speed[a]) / gain,
            };
            let [lo, hi] = self.limit[a];
            raw.clamp(lo, hi)
        };
        Ok((0..nu).map(one).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_named_pose_of_every_robot_settles() {
        for id in Robot::builtin_ids() {
            let robot = Robot::builtin(id).unwrap();
            for name in robot.pose_names() {
                let s = robot.settle(&robot.pose(name).unwrap()).unwrap();
                let joint = &robot.joints()[s.worst_joint].name;
                eprintln!("{id} {name}: {:.4} at {joint}, speed {:.4}", s.worst, s.speed);
                assert!(s.within, "{id} {name}: {:.3} at {joint}", s.worst);
            }
        }
    }

    #[test]
    fn a_pose_out_of_reach_says_so() {
        let robot = Robot::builtin("shadow_hand").unwrap();
        // One tendon bends both outer joints, so 1.2 and 0 cannot both be reached.
        let mut target = robot.home();
        let i = robot.joint_index("FFJ2").unwrap();
        target[i] = 1.2;
        let s = robot.settle(&target).unwrap();
        assert!(!s.within && s.worst > 0.3, "{}", s.worst);
        assert!(robot.settle(&[0.0]).is_err());
    }
}
