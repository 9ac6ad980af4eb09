//! The nominal model: a planner simulates the robot of the file, whatever plant the rollout runs
//! on. A planner that identifies the plant simulates its own estimate.

use std::sync::Arc;

use super::error::Error;
use robert_mujoco::{Data, Model};
use robert_robot::Robot;

/// A planner's own simulation of the robot of the file.
#[derive(Debug)]
pub struct NominalModel {
    /// The robot.
    pub robot: Arc<Robot>,
    /// Work space on the robot's own model.
    pub data: Data,
    /// Simulator steps in one control step.
    pub substeps: usize,
}

impl NominalModel {
    /// A planner's simulation.
    ///
    /// # Errors
    /// [`Error::Setup`], [`Error::Timestep`].
    pub fn new(robot: &Arc<Robot>) -> Result<NominalModel, Error> {
        NominalModel::on(robot, robot.model())
    }

    /// A simulation of a model of the robot.
    ///
    /// # Errors
    /// As [`NominalModel::new`].
    pub fn on(robot: &Arc<Robot>, model: &Arc<Model>) -> Result<NominalModel, Error> {
        let data = Data::new(model)?;
        let substeps = substeps(robot.model())?;
        Ok(NominalModel { robot: Arc::clone(robot), data, substeps })
    }
}

/// Simulator steps that make up one control step exactly.
///
/// # Errors
/// [`Error::Timestep`] when 0.05 s is not a whole number of them, since the clock of the rollout
/// would drift against the clip.
pub(super) fn substeps(model: &Model) -> Result<usize, Error> {
    let dt = model.timestep();
    let n = (robert_base::units::CTRL_DT / dt).round();
    if n >= 1.0 && (n * dt - robert_base::units::CTRL_DT).abs() < 1e-9 {
        Ok(n as usize)
    } else {
        Err(Error::Timestep { timestep_secs: dt })
    }
}
