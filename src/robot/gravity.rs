//! The torque that holds a pose against gravity and springs, from the nominal model.

use std::sync::Arc;

use super::loops::{has_loops, transmission};
use super::{Error, Robot};
use robert_mujoco::Data;

/// The torque that compensates the robot's weight.
#[derive(Debug)]
pub struct Gravity {
    /// The nominal model without contacts.
    data: Data,
    force: Vec<f64>,
    /// Whether constraints transmit the weight of joints without actuators.
    loops: bool,
}

impl Gravity {
    /// The gravity of a robot; `None` if no joint has weight to hold.
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub fn of(robot: &Robot) -> Result<Option<Gravity>, Error> {
        let model = robot.model();
        let springs = model.jnt_stiffness().iter().any(|k| *k != 0.0);
        if *model.gravity() == [0.0; 3] && !springs {
            return Ok(None);
        }
        let loops = has_loops(model);
        let mut model = model.duplicate()?;
        model.set_contacts(false);
        model.set_dense_jacobians();
        let data = Data::new(&Arc::new(model))?;
        let force = vec![0.0; robot.model().nv()];
        Ok(Some(Gravity { data, force, loops }))
    }

    /// Joint forces that hold this pose still, N m or N; (nv). `qpos` is (nq). In a robot with
    /// equality constraints they are those of the actuators alone.
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub fn at(&mut self, qpos: &[f64]) -> Result<&[f64], Error> {
        self.data.set_qpos(qpos)?;
        self.data.forward()?;
        let forces = self.data.qfrc_bias().iter().zip(self.data.qfrc_passive());
        self.force.iter_mut().zip(forces).for_each(|(to, (bias, passive))| *to = bias - passive);
        if self.loops {
            transmission(&self.data)?.apply(&mut self.force);
        }
        Ok(&self.force)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pose_under_its_gravity_torque_stays() {
        let arm = Robot::builtin("ur5e_light").unwrap();
        let mut gravity = Gravity::of(&arm).unwrap().unwrap();
        let mut data = Data::new(arm.model()).unwrap();
        arm.write_state(&mut data, &[0.3, -0.8, 1.1, -0.4, 0.2]).unwrap();
        let before = arm.state(&data);
        let force = gravity.at(data.qpos()).unwrap().to_vec();
        assert!(force.iter().any(|f| f.abs() > 5.0), "{force:?}");
        data.set_qfrc_applied(&force).unwrap();
        data.step(100).unwrap();
        let after = arm.state(&data);
        let moved = after.iter().zip(&before).map(|(a, b)| (a - b).abs());
        assert!(moved.fold(0.0, f64::max) < 1e-6);
        assert!(Gravity::of(&Robot::builtin("shadow_hand").unwrap()).unwrap().is_none());
    }
}
