//! Gains of a servo for each joint, from inertia, damping and the length of a frame.
//!
//! A torque u held for one frame T moves a joint at speed v by g v + b u, so
//! u = share (r - q - g v)/b would reach the target r in one frame at share = 1. What b and
//! g are depends on what the other joints do meanwhile: [`Robot::servos`] holds them still,
//! [`Robot::tracking_servos`] lets them go, as they do when all are driven at once.

use nalgebra::DMatrix;

use super::response::Response;
use super::{Error, Robot};
use crate::mujoco::Data;
use crate::units::CTRL_DT;

/// Share of the remaining way that tracking aims at where the joints leave each other alone.
/// Full deadbeat (1) alternates between two torques on an undamped joint.
const SHARE: f64 = 0.9;
/// What may be left of a disturbance after a frame.
const LASTING: f64 = 0.9;
/// Shares are tried from [`SHARE`] down in these steps, to no less than a hundredth.
const SOFTER: f64 = 0.95;
const SOFTEST: f64 = 0.01;

/// Torque per rad (or m) of error and per rad/s (or m/s) of speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Servo {
    /// N m/rad or N/m.
    pub kp: f64,
    /// N m s/rad or N s/m.
    pub kd: f64,
}

impl Servo {
    /// The servo of a joint that is alone with its inertia and damping: with tau = M/c,
    /// g = tau (1 - e^(-T/tau)) and b = (T - g)/c; undamped, b = T^2/(2M) and g = T.
    pub fn tuned(inertia: f64, damping: f64, share: f64) -> Servo {
        let (b, g) = if damping * CTRL_DT < 1e-6 * inertia {
            (CTRL_DT * CTRL_DT / (2.0 * inertia), CTRL_DT)
        } else {
            let tau = inertia / damping;
            let g = tau * (1.0 - (-CTRL_DT / tau).exp());
            ((CTRL_DT - g) / damping, g)
        };
        Servo::covering(share, b, g)
    }

    fn covering(share: f64, b: f64, g: f64) -> Servo {
        Servo { kp: share / b, kd: share * g / b }
    }
}

impl Robot {
    /// A servo for each state joint, tuned at the home pose as if the others stood still; (S).
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub fn servos(&self, share: f64) -> Result<Vec<Servo>, Error> {
        let (mass, damping) = self.home_inertia()?;
        let joints = damping.iter().enumerate();
        Ok(joints.map(|(k, c)| Servo::tuned(mass[(k, k)], *c, share)).collect())
    }

    /// Servos that drive all state joints at once, as stiff as the coupling of the joints
    /// allows; (S). Light links behind heavy ones answer a torque several times as strongly
    /// as they would alone, and gains that ignore it chatter between full torques. The
    /// share is lowered until the frame of the home pose, inertia, damping and the held
    /// torque included, leaves nine tenths of any disturbance or less.
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub fn tracking_servos(&self) -> Result<Vec<Servo>, Error> {
        let (mass, damping) = self.home_inertia()?;
        let dt = self.model().timestep();
        let substeps = (CTRL_DT / dt).round().max(1.0) as usize;
        let Some(response) = Response::new(&mass, &damping, dt, substeps) else {
            return self.servos(SOFTEST);
        };
        let servos = |share: f64| -> Vec<Servo> {
            let joints = 0..damping.len();
            let own = |k| Servo::covering(share, response.way[(k, k)], response.coast[(k, k)]);
            joints.map(own).collect()
        };
        let lasting = |servos: &[Servo]| {
            let (kp, kd): (Vec<f64>, Vec<f64>) = servos.iter().map(|s| (s.kp, s.kd)).unzip();
            response.lasting(&kp, &kd)
        };
        let mut share = SHARE;
        while share > SOFTEST && lasting(&servos(share)) > LASTING {
            share *= SOFTER;
        }
        Ok(servos(share))
    }

    /// Inertia (S, S) and damping (S) of the state joints at home, other joints held.
    fn home_inertia(&self) -> Result<(DMatrix<f64>, Vec<f64>), Error> {
        let mut data = Data::new(self.model())?;
        self.write_state(&mut data, &self.home())?;
        data.forward()?;
        let nv = self.model().nv();
        let mut mass = vec![0.0; nv * nv];
        data.full_mass(&mut mass)?;
        let dofs: Vec<usize> = self.joints().iter().map(|j| j.dofadr).collect();
        let mass = DMatrix::from_fn(dofs.len(), dofs.len(), |r, c| {
            let m = mass.get(dofs[r] * nv + dofs[c]).copied().unwrap_or(0.0);
            if r == c { m.max(1e-9) } else { m }
        });
        let damping = self.model().dof_damping();
        let damping = dofs.iter().map(|d| damping.get(*d).copied().unwrap_or(0.0)).collect();
        Ok((mass, damping))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gains_reach_the_target_of_a_single_joint() {
        for (inertia, damping) in [(3.0, 100.0), (0.0003, 0.05), (4.0, 0.0), (0.3, 3.0)] {
            let servo = Servo::tuned(inertia, damping, 1.0);
            let (mut q, mut v, dt) = (0.0, 0.4, CTRL_DT / 1000.0);
            let u = servo.kp * (1.0 - q) - servo.kd * v;
            for _ in 0..1000 {
                v += dt * (u - damping * v) / inertia;
                q += dt * v;
            }
            assert!((q - 1.0_f64).abs() < 2e-2, "M {inertia}, c {damping}: reached {q}");
        }
    }

    /// Each robot starts off its home pose and is driven back, all joints at once, without
    /// gravity: what is left must die away, on the light arm, too, where gains that take
    /// each joint for itself end between full torques.
    #[test]
    fn tracking_servos_come_to_rest() {
        for id in Robot::builtin_ids() {
            let robot = Robot::builtin(id).unwrap();
            let stiff = robot.servos(SHARE).unwrap();
            let tracking = robot.tracking_servos().unwrap();
            let (mass, damping) = robot.home_inertia().unwrap();
            let r = Response::new(&mass, &damping, robot.model().timestep(), 10).unwrap();
            let lasting = |s: &[Servo]| {
                let (kp, kd): (Vec<f64>, Vec<f64>) = s.iter().map(|s| (s.kp, s.kd)).unzip();
                r.lasting(&kp, &kd)
            };
            assert!(lasting(&tracking) <= LASTING, "{id}: {}", lasting(&tracking));
            assert_eq!(lasting(&stiff) > 1.0, id == "ur5e_light", "{id}: {}", lasting(&stiff));
            // No softer than needed: where the joints hardly touch each other, as stiff.
            let softest = tracking.iter().zip(&stiff).map(|(t, s)| t.kp / s.kp);
            let softest = softest.fold(f64::INFINITY, f64::min);
            assert!(softest > if id == "ur5e_light" { 0.2 } else { 0.9 }, "{id}: {softest}");
        }
    }
}
