//! Proportional-derivative control with gains from the mass matrix: what a roboticist
//! tries first, without planner or data. The gains are those of [`crate::robot::Servo`].

use std::sync::Arc;

use super::actuation::Actuation;
use super::error::Error;
use super::plant::Belief;
use super::policy::{Policy, View};
use crate::robot::{Robot, Servo};

/// Share of the remaining way that one frame aims at. Full deadbeat (1) rings with the
/// coupling between joints that the diagonal gains ignore.
const SHARE: f64 = 0.9;

/// PD on a straight reference, joint by joint.
#[derive(Debug)]
pub(super) struct Pd {
    robot: Arc<Robot>,
    actuation: Actuation,
    /// By state joint.
    servos: Vec<Servo>,
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
        Ok(Pd {
            robot: Arc::clone(robot),
            actuation,
            servos: robot.servos(SHARE)?,
            torque: vec![0.0; robot.model().nv()],
        })
    }
}

impl Policy for Pd {
    fn name(&self) -> String {
        "pd".into()
    }

    fn reset(&mut self, _seed: u64) {}

    fn act(&mut self, view: &View<'_>, action: &mut [f64]) -> Result<(), Error> {
        self.torque.fill(0.0);
        for (k, (joint, servo)) in self.robot.joints().iter().zip(&self.servos).enumerate() {
            let error = view.window.next_target(k) - view.window.current[k];
            let speed = view.state.qvel[joint.dofadr];
            self.torque[joint.dofadr] = servo.kp * error - servo.kd * speed;
        }
        self.actuation.action(&self.torque, action);
        Ok(())
    }
}
