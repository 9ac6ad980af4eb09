//! Computed torque: inverse dynamics of the true model on one-step velocity targets.
//!
//! The acceleration asked for, qacc = ((r - q)/T - v)/T, brings the joint onto the straight
//! line to the next target within one frame T. Tracking a minimum-jerk curve with a
//! second-order law instead (wn = 15) measured ten times worse on every robot.

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
    qacc: Vec<f64>,
    torque: Vec<f64>,
}

impl ComputedTorque {
    /// Prepares the model.
    ///
    /// # Errors
    /// [`Error::Setup`].
    pub fn new(robot: &Arc<Robot>) -> Result<ComputedTorque, Error> {
        let mut belief = Belief::new(robot)?;
        let actuation = Actuation::new(robot, &mut belief.data)?;
        let nv = robot.model().nv();
        Ok(ComputedTorque { belief, actuation, qacc: vec![0.0; nv], torque: vec![0.0; nv] })
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
            let target = view.window.next_target(k);
            let speed = (target - view.window.current[k]) / CTRL_DT;
            self.qacc[joint.dofadr] = (speed - view.state.qvel[joint.dofadr]) / CTRL_DT;
        }
        data.set_qacc(&self.qacc)?;
        data.inverse()?;
        self.torque.copy_from_slice(data.qfrc_inverse());
        self.actuation.action(&self.torque, action);
        Ok(())
    }
}
