//! Proportional-derivative control with gains from the mass matrix and gravity compensation, the
//! usual first controller without planner or data. The gains are those of
//! [`Robot::tracking_servos`]; gains and gravity come from the nominal model. If the robot has
//! position servos of its own, the action is that of [`PositionServo::action`].

use std::sync::Arc;

use super::actuation::Actuation;
use super::error::Error;
use super::nominal_model::NominalModel;
use super::policy::{Policy, View};
use robert_robot::{Gravity, PositionServo, Robot, Servo};

/// Share of the remaining distance that a position servo alone would cover in a frame.
const SHARE: f64 = 0.9;

/// PD on a straight reference, joint by joint.
#[derive(Debug)]
pub(super) struct Pd {
    robot: Arc<Robot>,
    actuation: Actuation,
    /// By state joint.
    servos: Vec<Servo>,
    /// By actuator.
    positions: Vec<Option<PositionServo>>,
    /// None where nothing pulls at the robot.
    gravity: Option<Gravity>,
    torque: Vec<f64>,
    /// All zero, because the damping of velocity servos is already part of the gains.
    still: Vec<f64>,
}

impl Pd {
    /// Tunes the gains at the home pose.
    ///
    /// # Errors
    /// [`Error::Setup`].
    pub(super) fn new(robot: &Arc<Robot>) -> Result<Pd, Error> {
        let mut nominal = NominalModel::new(robot)?;
        robot.write_state(&mut nominal.data, &robot.home())?;
        let actuation = Actuation::new(robot, &mut nominal.data)?;
        Ok(Pd {
            robot: Arc::clone(robot),
            actuation,
            servos: robot.tracking_servos()?,
            positions: robot.position_servos(&[SHARE])?,
            gravity: Gravity::of(robot)?,
            still: vec![0.0; robot.model().nv()],
            torque: vec![0.0; robot.model().nv()],
        })
    }

    /// Writes the action that drives joints at `current`, of a robot at `qpos` (nq) moving at
    /// `qvel` (nv), to `target`; both (S).
    ///
    /// # Errors
    /// [`Error::Setup`] from the nominal model.
    pub(super) fn drive(
        &mut self,
        (current, target): (&[f64], &[f64]),
        qpos: &[f64],
        qvel: &[f64],
        action: &mut [f64],
    ) -> Result<(), Error> {
        self.torque.fill(0.0);
        if let Some(gravity) = &mut self.gravity {
            self.torque.copy_from_slice(gravity.at(qpos)?);
        }
        let weight: Vec<f64> = match &self.gravity {
            Some(_) => self.robot.joints().iter().map(|j| self.torque[j.dofadr]).collect(),
            None => Vec::new(),
        };
        let ways = target.iter().zip(current).map(|(r, q)| r - q);
        for ((joint, servo), way) in self.robot.joints().iter().zip(&self.servos).zip(ways) {
            self.torque[joint.dofadr] += servo.kp * way - servo.kd * qvel[joint.dofadr];
        }
        self.actuation.action(&self.torque, qpos, &self.still, action);
        if self.positions.iter().any(Option::is_some) {
            let speed: Vec<f64> = self.robot.joints().iter().map(|j| qvel[j.dofadr]).collect();
            for (to, servo) in action.iter_mut().zip(&self.positions) {
                if let Some(servo) = servo {
                    *to = servo.action(SHARE, current, &speed, target, &weight);
                }
            }
        }
        Ok(())
    }
}

impl Policy for Pd {
    fn name(&self) -> String {
        "pd".into()
    }

    fn reset(&mut self, _seed: u64) {}

    fn act(&mut self, view: &View<'_>, action: &mut [f64]) -> Result<(), Error> {
        let window = view.window;
        let target: Vec<f64> = (0..window.dim()).map(|k| window.next_target(k)).collect();
        let state = view.state;
        self.drive((&window.current, &target), &state.qpos, &state.qvel, action)
    }
}
