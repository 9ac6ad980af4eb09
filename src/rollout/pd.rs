//! Proportional-derivative control with gains from the mass matrix: what a roboticist
//! tries first, without planner or data.
//!
//! Each joint is taken for itself: inertia M and damping c give its answer to a torque
//! held for one frame T. With tau = M/c and g = tau (1 - e^(-T/tau)), a joint at speed v
//! moves by g v on its own and by b = (T - g)/c per unit of torque, so
//! u = alpha (r - q - g v)/b would reach the target r in one frame at alpha = 1.

use std::sync::Arc;

use super::actuation::Actuation;
use super::error::Error;
use super::plant::Belief;
use super::policy::{Policy, View};
use crate::robot::Robot;
use crate::units::CTRL_DT;

/// Share of the remaining way that one frame aims at. Full deadbeat (1) rings with the
/// coupling between joints that the diagonal gains ignore.
const ALPHA: f64 = 0.9;

/// PD on a straight reference, joint by joint.
#[derive(Debug)]
pub(super) struct Pd {
    robot: Arc<Robot>,
    actuation: Actuation,
    /// Torque per rad of error and per rad/s, by state joint.
    gains: Vec<(f64, f64)>,
    torque: Vec<f64>,
}

impl Pd {
    /// Tunes the gains at the home pose.
    ///
    /// # Errors
    /// [`Error::Setup`].
    pub(super) fn new(robot: &Arc<Robot>) -> Result<Pd, Error> {
        let mut belief = Belief::new(robot)?;
        robot.write_state(&mut belief.data, &robot.home())?;
        let actuation = Actuation::new(robot, &mut belief.data)?;
        let nv = robot.model().nv();
        let mut mass = vec![0.0; nv * nv];
        belief.data.full_mass(&mut mass)?;
        let gains = robot
            .joints()
            .iter()
            .map(|j| {
                let inertia = mass[j.dofadr * nv + j.dofadr].max(1e-9);
                let damping = robot.model().dof_damping()[j.dofadr];
                gains(inertia, damping)
            })
            .collect();
        Ok(Pd { robot: Arc::clone(robot), actuation, gains, torque: vec![0.0; nv] })
    }

    /// Writes the action that drives joints at `current`, moving at `qvel` (nv), to `target`;
    /// both (S).
    pub(super) fn drive(
        &mut self,
        current: &[f64],
        target: &[f64],
        qvel: &[f64],
        action: &mut [f64],
    ) {
        self.torque.fill(0.0);
        let ways = target.iter().zip(current).map(|(r, q)| r - q);
        for ((joint, (kp, kd)), way) in self.robot.joints().iter().zip(&self.gains).zip(ways) {
            self.torque[joint.dofadr] = kp * way - kd * qvel[joint.dofadr];
        }
        self.actuation.action(&self.torque, action);
    }
}

/// (kp, kd) for one joint; the undamped limit is b = T^2/(2M), g = T.
fn gains(inertia: f64, damping: f64) -> (f64, f64) {
    let (b, g) = if damping * CTRL_DT < 1e-6 * inertia {
        (CTRL_DT * CTRL_DT / (2.0 * inertia), CTRL_DT)
    } else {
        let tau = inertia / damping;
        let g = tau * (1.0 - (-CTRL_DT / tau).exp());
        ((CTRL_DT - g) / damping, g)
    };
    (ALPHA / b, ALPHA * g / b)
}

impl Policy for Pd {
    fn name(&self) -> String {
        "pd".into()
    }

    fn reset(&mut self, _seed: u64) {}

    fn act(&mut self, view: &View<'_>, action: &mut [f64]) -> Result<(), Error> {
        let window = view.window;
        let target: Vec<f64> = (0..window.dim()).map(|k| window.next_target(k)).collect();
        self.drive(&window.current, &target, &view.state.qvel, action);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gains_reach_the_target_of_a_single_joint() {
        for (inertia, damping) in [(3.0, 100.0), (0.0003, 0.05), (4.0, 0.0), (0.3, 3.0)] {
            let (kp, kd) = gains(inertia, damping);
            let (mut q, mut v, dt) = (0.0, 0.4, CTRL_DT / 1000.0);
            let u = (kp * (1.0 - q) - kd * v) / ALPHA;
            for _ in 0..1000 {
                v += dt * (u - damping * v) / inertia;
                q += dt * v;
            }
            assert!((q - 1.0_f64).abs() < 2e-2, "M {inertia}, c {damping}: reached {q}");
        }
    }
}
