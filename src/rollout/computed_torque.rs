//! Computed torque: inverse dynamics of the true model on one-step velocity targets.
//!
//! The torque is held for a frame T, during which a damped joint (inertia M, damping c,
//! tau = M/c) does not keep the acceleration it starts with. With e = exp(-T/tau) and
//! g = tau (1 - e), the acceleration at the start of the frame that reaches the target r at
//! its end is
//!
//!     qacc = (r - q - T v) / ((T - g) tau)
//!
//! and inverse dynamics turns it into a torque. The velocity left over alternates with the
//! ratio z = -(g - T e)/(T - g) (the sampling zero of the plant). Where that hardly decays
//! (light damping, |z| near 1) the law aims at the velocity of the straight line instead,
//! qacc = ((r - q)/T - v)/g, which never rings. Both tend to the textbook laws for c -> 0.
//!
//! Tracking a minimum-jerk curve with a second-order law (wn = 15) measured ten times worse.

use std::sync::Arc;

use super::actuation::Actuation;
use super::error::Error;
use super::plant::Belief;
use super::policy::{Policy, View};
use crate::robot::Robot;
use crate::units::CTRL_DT;

/// Inverse dynamics with the model as the robot's file says.
#[derive(Debug)]
pub struct ComputedTorque {
    belief: Belief,
    actuation: Actuation,
    /// Acceleration per unit of r - q - T v, by state joint, 1/s^2.
    laws: Vec<f64>,
    qacc: Vec<f64>,
    torque: Vec<f64>,
}

/// Sampling zeros beyond this ring visibly before they decay.
const RINGING: f64 = 0.75;

/// Acceleration per unit of r - q - T v for a joint; see the module's head.
fn law(inertia: f64, damping: f64) -> f64 {
    let t = CTRL_DT;
    if damping * t < 1e-6 * inertia {
        return 1.0 / (t * t);
    }
    let tau = inertia / damping;
    let e = (-t / tau).exp();
    let g = tau * (1.0 - e);
    let zero = (g - t * e) / (t - g);
    if zero < RINGING { 1.0 / ((t - g) * tau) } else { 1.0 / (t * g) }
}

impl ComputedTorque {
    /// Prepares the model.
    ///
    /// # Errors
    /// [`Error::Setup`].
    pub fn new(robot: &Arc<Robot>) -> Result<ComputedTorque, Error> {
        let mut belief = Belief::new(robot)?;
        let actuation = Actuation::new(robot, &mut belief.data)?;
        let model = robot.model();
        let nv = model.nv();
        robot.write_state(&mut belief.data, &robot.home())?;
        belief.data.forward()?;
        let mut mass = vec![0.0; nv * nv];
        belief.data.full_mass(&mut mass)?;
        let laws = robot
            .joints()
            .iter()
            .map(|j| law(mass[j.dofadr * nv + j.dofadr].max(1e-9), model.dof_damping()[j.dofadr]))
            .collect();
        Ok(ComputedTorque { belief, actuation, laws, qacc: vec![0.0; nv], torque: vec![0.0; nv] })
    }
}

impl Policy for ComputedTorque {
    fn name(&self) -> String {
        "computed-torque".into()
    }

    fn uses_model(&self) -> bool {
        true
    }

    fn reset(&mut self, _seed: u64) {}

    fn act(&mut self, view: &View<'_>, action: &mut [f64]) -> Result<(), Error> {
        let data = &mut self.belief.data;
        data.restore(view.state)?;
        self.qacc.fill(0.0);
        for (k, joint) in self.belief.robot.joints().iter().enumerate() {
            let way = view.window.next_target(k) - view.window.current[k];
            let v = view.state.qvel[joint.dofadr];
            self.qacc[joint.dofadr] = self.laws[k] * (way - CTRL_DT * v);
        }
        data.set_qacc(&self.qacc)?;
        data.inverse()?;
        self.torque.copy_from_slice(data.qfrc_inverse());
        self.actuation.action(&self.torque, action);
        Ok(())
    }
}
