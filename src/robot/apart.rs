//! The pose near one in which parts overlap.
//!
//! A person draws a thumb into a finger, or an arm into the floor. If a rollout began so, contact would throw them apart
//! within a frame, and where they land is chance. Here contact pushes them apart slowly: after each step of the simulator
//! every speed is taken away. The motors only carry the weight of the robot and the springs of its joints, as far as they
//! can.

use super::settle::Drive;
use super::{Error, Robot};
use robert_mujoco::Data;

/// Parts that overlap by less begin without a jolt, m. Contact is soft: parts that rest on each other overlap a little.
const DEEP: f64 = 1e-3;
/// The largest number of steps.
const MOST: usize = 200;

impl Robot {
    /// The pose, (`state_dim`), to which contact pushes the robot from `pose`: nothing overlaps by a millimetre in it, or
    /// less in all than before after 200 steps. `None` if nothing overlaps by a millimetre in `pose`, or if contact does
    /// not take it apart.
    ///
    /// # Errors
    /// [`Error::Length`], [`Error::Simulator`] when no simulation can be made.
    pub fn apart(&self, pose: &[f64]) -> Result<Option<Vec<f64>>, Error> {
        let mut data = Data::new(self.model())?;
        self.write_state(&mut data, pose)?;
        data.forward()?;
        if deepest(&data) <= DEEP {
            return Ok(None);
        }
        // A pose may be so far off that the simulation diverges.
        Ok(self.push_apart(&mut data).ok().flatten())
    }

    fn push_apart(&self, data: &mut Data) -> Result<Option<Vec<f64>>, Error> {
        let still = vec![0.0; self.model().nv()];
        let (here, before) = (self.state(data), overlap(data));
        let mut drive = Drive::new(self, &here, &here)?;
        for _ in 0..MOST {
            drive.hold(&self.state(data));
            let transmission = drive.transmission(data)?;
            let ctrl = drive.ctrl(self, data, transmission.as_ref())?;
            data.set_ctrl(&ctrl)?;
            data.step(1)?;
            data.set_qvel(&still)?;
            data.forward()?;
            if deepest(data) <= DEEP {
                break;
            }
        }
        let better = deepest(data) <= DEEP || overlap(data) < before;
        Ok(better.then(|| self.state(data)))
    }
}

/// By how much two parts overlap at most, m.
fn deepest(data: &Data) -> f64 {
    depths(data).fold(0.0, f64::max)
}

/// By how much all parts overlap together, m.
fn overlap(data: &Data) -> f64 {
    depths(data).sum()
}

/// By how much the parts overlap at each point of contact, m.
fn depths(data: &Data) -> impl Iterator<Item = f64> {
    data.contacts().map(|contact| (-contact.dist).max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thumb_in_a_finger_comes_out_and_nothing_else_moves() {
        let robot = Robot::builtin("shadow_hand").unwrap();
        let home = robot.home();
        assert_eq!(robot.apart(&home).unwrap(), None);
        let mut fist = home.clone();
        for (joint, value) in
            [("FFJ3", 1.4), ("FFJ2", 1.2), ("FFJ1", 1.2), ("THJ5", 0.5), ("THJ4", 1.2)]
        {
            fist[robot.joint_index(joint).unwrap()] = value;
        }
        let apart = robot.apart(&fist).unwrap().expect("they overlap");
        let mut data = Data::new(robot.model()).unwrap();
        robot.write_state(&mut data, &apart).unwrap();
        data.forward().unwrap();
        assert!(deepest(&data) <= 1.1 * DEEP, "{}", deepest(&data));
        let moved = |name: &str| {
            let j = robot.joint_index(name).unwrap();
            (apart[j] - fist[j]).abs()
        };
        assert!(moved("THJ4") + moved("FFJ3") > 0.01);
        let others = robot
            .joints()
            .iter()
            .filter(|j| !j.name.starts_with("FF") && !j.name.starts_with("TH"));
        let most = others.map(|j| moved(&j.name)).fold(0.0, f64::max);
        assert!(most < 1e-3, "{most}");
        assert!(robot.apart(&[0.0]).is_err());
    }
}
