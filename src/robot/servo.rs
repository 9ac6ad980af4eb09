//! Gains of a servo for each joint, from its inertia and damping.
//!
//! Each joint is taken for itself: inertia M and damping c give its answer to a torque held
//! for one frame T. With tau = M/c and g = tau (1 - e^(-T/tau)), a joint at speed v moves by
//! g v on its own and by b = (T - g)/c per unit of torque, so u = share (r - q - g v)/b
//! would reach the target r in one frame at share = 1.

use super::{Error, Robot};
use crate::mujoco::Data;
use crate::units::CTRL_DT;

/// Torque per rad (or m) of error and per rad/s (or m/s) of speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Servo {
    /// N m/rad or N/m.
    pub kp: f64,
    /// N m s/rad or N s/m.
    pub kd: f64,
}

impl Servo {
    /// The servo that covers this share of the remaining way in one frame; the undamped
    /// limit is b = T^2/(2M), g = T.
    pub fn tuned(inertia: f64, damping: f64, share: f64) -> Servo {
        let (b, g) = if damping * CTRL_DT < 1e-6 * inertia {
            (CTRL_DT * CTRL_DT / (2.0 * inertia), CTRL_DT)
        } else {
            let tau = inertia / damping;
            let g = tau * (1.0 - (-CTRL_DT / tau).exp());
            ((CTRL_DT - g) / damping, g)
        };
        Servo { kp: share / b, kd: share * g / b }
    }
}

impl Robot {
    /// A servo for each state joint, tuned at the home pose; (S).
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub fn servos(&self, share: f64) -> Result<Vec<Servo>, Error> {
        let mut data = Data::new(self.model())?;
        self.write_state(&mut data, &self.home())?;
        data.forward()?;
        let nv = self.model().nv();
        let mut mass = vec![0.0; nv * nv];
        data.full_mass(&mut mass)?;
        let damping = self.model().dof_damping();
        let servo = |dof: usize| {
            let inertia = mass.get(dof * nv + dof).map_or(1e-9, |m| m.max(1e-9));
            Servo::tuned(inertia, damping.get(dof).copied().unwrap_or(0.0), share)
        };
        Ok(self.joints().iter().map(|j| servo(j.dofadr)).collect())
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
}
