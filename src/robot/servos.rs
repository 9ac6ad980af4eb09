//! Gains of the servos of a robot, from inertia, damping and the length of a frame.
//!
//! A torque u held for one frame T moves a joint at speed v by g v + b u, so u = share (r - q - g
//! v)/b would reach the target r in one frame at share = 1. The values of b and g depend on the
//! other joints: [`Robot::servos`] assumes that they stand still, [`Robot::tracking_servos`] that
//! they move freely, as when all are driven at once.

use nalgebra::DMatrix;

use super::golden::spread;
use super::position_servo::PositionServo;
use super::response::Response;
use super::servo::Servo;
use super::{Error, Robot};
use robert_base::units::CTRL_DT;
use robert_mujoco::{Data, Transmission};

/// Share of the remaining distance that tracking covers per frame if the joints do not affect each
/// other. With a share of 1, an undamped joint alternates between two torques.
const SHARE: f64 = 0.97;
/// The factor by which a disturbance may change in a frame: at most 1, so that it does not grow.
const LASTING: f64 = 1.0;
/// The number of poses besides home at which this is checked.
const POSES: usize = 16;
/// Range of an unbounded joint: rad or m to either side of home.
const UNBOUNDED: f64 = 1.5;
/// Shares are tried from [`SHARE`] down in these steps, to no less than a hundredth.
const SOFTER: f64 = 0.97;
const SOFTEST: f64 = 0.01;

impl Robot {
    /// A servo for each state joint, tuned at the home pose with the others fixed; (S).
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub fn servos(&self, share: f64) -> Result<Vec<Servo>, Error> {
        let mass = self.inertia(&mut Data::new(self.model())?, &self.home())?;
        let joints = self.state_damping().into_iter().enumerate();
        Ok(joints.map(|(k, c)| Servo::tuned(mass[(k, k)], c, share)).collect())
    }

    /// Servos that drive all state joints at once, as stiff as the coupling of the joints allows;
    /// (S). A torque moves light links behind heavy ones several times as far as it would move them
    /// alone. Gains that ignore this make the robot alternate between full torques. So the share is
    /// lowered until every disturbance shrinks within a frame, at home and at some poses spread
    /// over the ranges.
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub fn tracking_servos(&self) -> Result<Vec<Servo>, Error> {
        if let Some(found) = self.tracking.get() {
            return Ok(found.clone());
        }
        let found = self.find_tracking_servos()?;
        Ok(self.tracking.get_or_init(|| found).clone())
    }

    fn find_tracking_servos(&self) -> Result<Vec<Servo>, Error> {
        let damping = self.state_damping();
        let dt = self.model().timestep();
        let substeps = (CTRL_DT / dt).round().max(1.0) as usize;
        let mut data = Data::new(self.model())?;
        let mut response = |pose: &[f64]| -> Result<Option<Response>, Error> {
            Ok(Response::new(&self.inertia(&mut data, pose)?, &damping, dt, substeps))
        };
        let Some(home) = response(&self.home())? else { return self.servos(SOFTEST) };
        let mut all = vec![home.clone()];
        for k in 0..POSES {
            all.extend(response(&self.spread_pose(k))?);
        }
        let servos = |share: f64| -> Vec<Servo> {
            let own = |k| Servo::covering(share, home.way[(k, k)], home.coast[(k, k)]);
            (0..damping.len()).map(own).collect()
        };
        let mut share = SHARE;
        while share > SOFTEST && lasting(&all, &servos(share)) > LASTING {
            share *= SOFTER;
        }
        Ok(servos(share))
    }

    /// Inertia of the state joints at a pose, (S, S); other joints are fixed.
    fn inertia(&self, data: &mut Data, pose: &[f64]) -> Result<DMatrix<f64>, Error> {
        self.write_state(data, pose)?;
        data.forward()?;
        let nv = self.model().nv();
        let mut mass = vec![0.0; nv * nv];
        data.full_mass(&mut mass)?;
        let mass = DMatrix::from_row_slice(nv, nv, &mass);
        let dof: Vec<usize> = self.joints().iter().map(|j| j.dofadr).collect();
        Ok(DMatrix::from_fn(dof.len(), dof.len(), |r, c| {
            let m = mass[(dof[r], dof[c])];
            if r == c { m.max(1e-9) } else { m }
        }))
    }

    /// Whether an actuator drives a joint without any damping. Its speed then tells little about
    /// the last action, so a policy needs more than the last frames.
    pub fn drives_undamped_joints(&self) -> bool {
        let model = self.model();
        let driven = |dof: usize| {
            (0..model.nu()).any(|a| {
                let Some(Transmission::Joint(j)) = model.transmission(a) else { return false };
                model.jnt_dofadr()[j] as usize == dof
            })
        };
        let mut joints = self.joints().iter().zip(self.state_damping());
        joints.any(|(joint, damping)| damping == 0.0 && driven(joint.dofadr))
    }

    /// Damping of the state joints, including that of velocity servos; (S).
    fn state_damping(&self) -> Vec<f64> {
        let model = self.model();
        let mut damping = model.dof_damping().to_vec();
        for (a, actuator) in self.actuators().iter().enumerate() {
            if let (Some(law), Some(Transmission::Joint(j))) = (actuator.law, model.transmission(a))
            {
                let gear = model.actuator_gear()[6 * a];
                damping[model.jnt_dofadr()[j] as usize] -= gear * gear * law.bias[2];
            }
        }
        self.joints().iter().map(|j| damping[j.dofadr]).collect()
    }

    /// The position servos among the actuators, at the home pose, for a controller that covers
    /// one of these shares of the distance per frame; (A).
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub fn position_servos(&self, shares: &[f64]) -> Result<Vec<Option<PositionServo>>, Error> {
        if !self.actuators().iter().any(|a| a.law.is_some_and(|l| l.is_position())) {
            return Ok(vec![None; self.action_dim()]);
        }
        let home = self.home();
        let mut data = Data::new(self.model())?;
        let mut inertias = Vec::new();
        for k in 0..POSES {
            inertias.push(self.inertia(&mut data, &self.spread_pose(k))?);
        }
        // Last, because the servos are read at home.
        inertias.push(self.inertia(&mut data, &home)?);
        let own: Vec<f64> = inertias[POSES].diagonal().iter().copied().collect();
        let dofs: Vec<usize> = self.joints().iter().map(|j| j.dofadr).collect();
        let mut servos: Vec<Option<PositionServo>> = (0..self.action_dim())
            .map(|a| PositionServo::of(&data, a, &home, &dofs, &own))
            .collect();
        let damping: Vec<f64> = dofs.iter().map(|d| self.model().dof_damping()[*d]).collect();
        PositionServo::share_weights(&mut servos);
        PositionServo::calm(&mut servos, shares, &inertias, &damping);
        Ok(servos)
    }

    /// Pose `k` of a set that covers the ranges evenly.
    pub(super) fn spread_pose(&self, k: usize) -> Vec<f64> {
        let joints = self.joints().iter().zip(self.home()).enumerate();
        joints
            .map(|(j, (joint, home))| {
                let range = match joint.range {
                    _ if joint.unbounded => [home - UNBOUNDED, home + UNBOUNDED],
                    range => range,
                };
                spread(j, k, range)
            })
            .collect()
    }
}

/// The factor by which a disturbance changes in a frame, at the worst of these poses.
fn lasting(responses: &[Response], servos: &[Servo]) -> f64 {
    let (kp, kd): (Vec<f64>, Vec<f64>) = servos.iter().map(|s| (s.kp, s.kd)).unzip();
    responses.iter().map(|r| r.lasting(&kp, &kd)).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use robert_base::units::{SIM_DT, SUBSTEPS};

    /// Tuned joint by joint, the light arm alternates between full torques. Tuned together, every
    /// disturbance decays, and weakly coupled joints lose no stiffness.
    #[test]
    fn tracking_servos_come_to_rest() {
        for id in Robot::builtin_ids() {
            let robot = Robot::builtin(id).unwrap();
            let mut data = Data::new(robot.model()).unwrap();
            let mut lasts = |pose: &[f64], servos: &[Servo]| {
                let mass = robot.inertia(&mut data, pose).unwrap();
                let r = Response::new(&mass, &robot.state_damping(), SIM_DT, SUBSTEPS).unwrap();
                lasting(&[r], servos)
            };
            let (alone, all) = (robot.servos(0.9).unwrap(), robot.tracking_servos().unwrap());
            let rings = id == "ur5e_light";
            let home = robot.home();
            assert_eq!(lasts(&home, &alone) > 1.5, rings, "{id}: {}", lasts(&home, &alone));
            for k in 0..2 * POSES {
                // Half of these poses were not used for the tuning.
                let worst = lasts(&robot.spread_pose(k), &all);
                assert!(worst < 1.1, "{id}, pose {k}: {worst}");
            }
            let softest = all.iter().zip(&alone).map(|(t, s)| t.kp / s.kp);
            let softest = softest.fold(f64::INFINITY, f64::min);
            assert!(softest > if rings { 0.2 } else { 0.85 }, "{id}: {softest}");
        }
    }
}
