//! From joint torques to actions: u = pinv(moment^T) tau, scaled to the control range.
//!
//! With tendons that pull several joints this is a least-squares solution: a torque that would move
//! two coupled joints apart has no actuator and is lost.

use std::sync::Arc;

use nalgebra::DMatrix;

use super::error::Error;
use crate::mujoco::Data;
use crate::robot::Robot;

/// The map from joint torques (nv) to actions (A) of a robot whose transmissions are
/// constant (joints and fixed tendons; ours all are).
#[derive(Clone, Debug)]
pub(super) struct Actuation {
    /// (nu, nv).
    inverse: DMatrix<f64>,
    /// (nu).
    scale: Vec<Scale>,
}

/// Action -1..1 covers this control range.
#[derive(Clone, Copy, Debug)]
struct Scale {
    middle: f64,
    half: f64,
}

impl Scale {
    fn of([lo, hi]: [f64; 2]) -> Scale {
        Scale { middle: 0.5 * (lo + hi), half: 0.5 * (hi - lo) }
    }
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
        let scale = robot.actuators().iter().map(|a| Scale::of(a.ctrlrange)).collect();
        Ok(Actuation { inverse, scale })
    }

    /// Writes the action that is closest to these joint torques, clamped to [-1, 1].
    pub(super) fn action(&self, torque: &[f64], action: &mut [f64]) {
        let nv = self.inverse.ncols();
        for (i, out) in action.iter_mut().enumerate() {
            let force: f64 = (0..nv).map(|k| self.inverse[(i, k)] * torque[k]).sum();
            let Scale { middle, half } = self.scale[i];
            *out = if half > 0.0 { ((force - middle) / half).clamp(-1.0, 1.0) } else { 0.0 };
        }
    }
}
