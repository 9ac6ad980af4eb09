//! From joint torques to actions: u = pinv(moment^T) tau, scaled to the control range.
//!
//! With tendons that pull several joints this is a least-squares solution: a torque that would move
//! two coupled joints apart has no actuator and is lost.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::error::Error;
use robert_mujoco::Data;
use robert_robot::{Law, Robot};

/// The map from joint torques (nv) to actions (A) of a robot whose transmissions are
/// constant (joints and fixed tendons; ours all are).
#[derive(Clone, Debug)]
pub(super) struct Actuation {
    /// (nu, nv).
    inverse: DMatrix<f64>,
    /// Moment arms; (nu, nv).
    moment: DMatrix<f64>,
    /// (nu).
    scale: Vec<Scale>,
}

/// Action -1..1 covers this control range, by this law.
#[derive(Clone, Copy, Debug)]
struct Scale {
    middle: f64,
    half: f64,
    law: Law,
    /// Length where all coordinates are zero.
    length: f64,
}

impl Actuation {
    /// Reads the moment arms at the current pose of `data`.
    ///
    /// # Errors
    /// [`Error::Setup`] from the kinematics.
    pub(super) fn new(robot: &Arc<Robot>, data: &mut Data) -> Result<Actuation, Error> {
        data.forward()?;
        let model = data.model();
        let (nu, nv) = (model.nu(), model.nv());
        // actuator_moment already holds the gear.
        let moment = DMatrix::from_row_slice(nu, nv, data.actuator_moment());
        // The tolerance is relative to the largest moment arm; smaller values are not a
        // transmission.
        let eps = 1e-9 * moment.amax().max(1e-12);
        let inverse =
            moment.transpose().pseudo_inverse(eps).unwrap_or_else(|_| DMatrix::zeros(nu, nv));
        let qpos = DVector::from_row_slice(data.qpos());
        let along = &moment * qpos;
        let scale = robot
            .actuators()
            .iter()
            .enumerate()
            .map(|(k, a)| {
                let [lo, hi] = a.ctrlrange;
                // An actuator without a known law gets its control as if that were a force.
                let law = a.law.unwrap_or(Law { gain: 1.0, bias: [0.0; 3] });
                let length = data.actuator_length()[k] - along[k];
                Scale { middle: 0.5 * (lo + hi), half: 0.5 * (hi - lo), law, length }
            })
            .collect();
        Ok(Actuation { inverse, moment, scale })
    }

    /// Stiffness and damping, (nv, nv) each, by which the force of servos falls as the joints move;
    /// `None` if all actuators are motors.
    pub(super) fn servos(&self) -> Option<[DMatrix<f64>; 2]> {
        let of = |which: usize| {
            let each = self.scale.iter().map(|s| -s.law.bias[which]);
            let own = DMatrix::from_diagonal(&DVector::from_iterator(self.scale.len(), each));
            self.moment.transpose() * own * &self.moment
        };
        let is_servo = self.scale.iter().any(|s| !s.law.is_motor());
        is_servo.then(|| [of(1), of(2)])
    }

    /// Writes the action that comes nearest to these joint torques at coordinates `qpos` moving
    /// at `qvel`, (nv) each, clamped to [-1, 1].
    pub(super) fn action(&self, torque: &[f64], qpos: &[f64], qvel: &[f64], action: &mut [f64]) {
        let nv = self.inverse.ncols();
        for (i, out) in action.iter_mut().enumerate() {
            let force: f64 = (0..nv).map(|k| self.inverse[(i, k)] * torque[k]).sum();
            let Scale { middle, half, law: Law { gain, bias }, length } = self.scale[i];
            let own = if bias == [0.0; 3] {
                0.0
            } else {
                let along =
                    |x: &[f64]| -> f64 { (0..nv).map(|k| self.moment[(i, k)] * x[k]).sum() };
                bias[0] + bias[1] * (length + along(qpos)) + bias[2] * along(qvel)
            };
            let ctrl = (force - own) / gain;
            *out = if half > 0.0 { ((ctrl - middle) / half).clamp(-1.0, 1.0) } else { 0.0 };
        }
    }
}
