//! The joints that the actuators can move.

use super::{Coupling, Error, Robot, tendons};
use robert_mujoco::Data;

impl Robot {
    /// The joints of a fixed tendon, by the name that its actuator gives; empty for a spatial one.
    pub fn tendon_joints(&self, tendon: &str) -> Vec<&str> {
        let model = self.model();
        let called = |t: &usize| tendons::tendon_name(model, *t) == tendon;
        let members = (0..model.ntendon()).find(called).map(|t| tendons::tendon_joints(model, t));
        let members = members.into_iter().flatten();
        members.map(|(j, _)| self.joints()[j].name.as_str()).collect()
    }

    /// For each state joint, whether an actuator pulls at it, alone or by a tendon; (S). These are the
    /// joints that a robot's controllers can command.
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub fn motorised(&self) -> Result<Vec<bool>, Error> {
        let mut data = Data::new(self.model())?;
        self.write_state(&mut data, &self.home())?;
        data.forward()?;
        let (nu, nv) = (self.model().nu(), self.model().nv());
        let moment = data.actuator_moment();
        let largest = moment.iter().fold(0.0, |a: f64, m| a.max(m.abs()));
        // Rounding is no lever.
        let pulled = |dof: usize| (0..nu).any(|a| moment[a * nv + dof].abs() > 1e-9 * largest);
        Ok(self.joints().iter().map(|j| pulled(j.dofadr)).collect())
    }

    /// For each state joint, whether an actuator moves it, directly or through a joint that it
    /// follows; (S). All other joints are passive.
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub fn driven(&self) -> Result<Vec<bool>, Error> {
        let mut driven = self.motorised()?;
        // A chain of followers is at most as long as the robot.
        for _ in 0..driven.len() {
            for coupling in &self.profile().couplings {
                let Coupling::Mimic { follower, leader, .. } = coupling else { continue };
                let (f, l) = (self.joint_index(follower)?, self.joint_index(leader)?);
                driven[f] = driven[f] || driven[l];
            }
        }
        Ok(driven)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_joints_of_the_robots_in_the_program_are_driven() {
        for id in Robot::builtin_ids() {
            assert!(Robot::builtin(id).unwrap().driven().unwrap().iter().all(|d| *d), "{id}");
        }
    }
}
