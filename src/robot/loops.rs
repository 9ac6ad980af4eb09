//! Torques of a robot whose joints hang together by equality constraints: closed loops, welds, and
//! joints that follow others.
//!
//! A four-bar linkage has motors on some of its joints, and the others are carried by the loop. A
//! torque that is wanted on every joint is therefore not the torque of the motors: the constraints
//! transmit what falls on a joint without a motor. With the moment arms m (nu, nv) and the
//! constraints' Jacobian J (n, nv), the forces f of the actuators and those of the constraints, c,
//! solve mᵀ f + Jᵀ c = torque, by least squares of the smallest norm.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::{Error, Robot};
use robert_mujoco::{Data, Model};

/// The equality constraints of a robot.
#[derive(Debug)]
pub struct Loops {
    /// The nominal model without contacts.
    data: Data,
}

impl Loops {
    /// The constraints of a robot; `None` if it has none.
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub fn of(robot: &Robot) -> Result<Option<Loops>, Error> {
        Loops::on(robot.model())
    }

    /// The constraints of a model; `None` if it has none.
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub fn on(model: &Model) -> Result<Option<Loops>, Error> {
        if model.neq() == 0 {
            return Ok(None);
        }
        let mut model = model.duplicate()?;
        model.set_contacts(false);
        model.set_dense_jacobians();
        Ok(Some(Loops { data: Data::new(&Arc::new(model))? }))
    }

    /// Replaces joint torques, N m or N; (nv), by the part that the actuators exert when the
    /// constraints transmit the rest. `qpos` is (nq).
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub fn transmit(&mut self, qpos: &[f64], torque: &mut [f64]) -> Result<(), Error> {
        self.data.set_qpos(qpos)?;
        self.data.forward()?;
        let model = self.data.model();
        let (nu, nv) = (model.nu(), model.nv());
        let jacobian = self.data.equality_jacobian();
        let rows = jacobian.len() / nv.max(1);
        let moment = DMatrix::from_row_slice(nu, nv, self.data.actuator_moment());
        let mut all = DMatrix::zeros(nv, nu + rows);
        all.columns_mut(0, nu).copy_from(&moment.transpose());
        all.columns_mut(nu, rows)
            .copy_from(&DMatrix::from_row_slice(rows, nv, jacobian).transpose());
        // Relative to the largest entry; smaller values are not a transmission.
        let eps = 1e-9 * all.amax().max(1e-12);
        let Ok(inverse) = all.pseudo_inverse(eps) else { return Ok(()) };
        let force = inverse * DVector::from_column_slice(torque);
        let own = moment.transpose() * force.rows(0, nu);
        torque.copy_from_slice(own.as_slice());
        Ok(())
    }
}
