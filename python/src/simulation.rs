//! The simulated robot, a control step at a time.

use std::sync::{Arc, Mutex, PoisonError};

use numpy::{IntoPyArray as _, PyArray1};
use pyo3::prelude::*;
use robert::mujoco::Data;
use robert::robot::{PlantConfig, Robot as LibRobot};
use robert::units::{CTRL_DT, SIM_DT, SUBSTEPS};

use crate::error::raise;
use crate::robot::Robot;

/// One robot in one simulation. An action is held for 50 ms.
#[pyclass(frozen)]
pub(crate) struct Simulation {
    robot: Arc<LibRobot>,
    data: Mutex<Data>,
}

#[pymethods]
impl Simulation {
    #[new]
    #[pyo3(signature = (robot, plant=None))]
    fn new(robot: &Robot, plant: Option<&str>) -> PyResult<Simulation> {
        let plant: PlantConfig =
            plant.map_or_else(|| Ok(PlantConfig::default()), str::parse).map_err(raise)?;
        let model = plant.model(&robot.inner).map_err(raise)?;
        let data = Mutex::new(Data::new(&model).map_err(raise)?);
        Ok(Simulation { robot: Arc::clone(&robot.inner), data })
    }

    /// At rest in this state; (S).
    fn reset(&self, state: Vec<f64>) -> PyResult<()> {
        let mut data = self.data.lock().unwrap_or_else(PoisonError::into_inner);
        data.reset().map_err(raise)?;
        self.robot.write_state(&mut data, &state).map_err(raise)
    }

    /// One control step with an action of -1 to 1; (A).
    fn step(&self, py: Python<'_>, action: Vec<f64>) -> PyResult<()> {
        py.detach(|| {
            let mut data = self.data.lock().unwrap_or_else(PoisonError::into_inner);
            self.robot.apply_action(&mut data, &action).map_err(raise)?;
            let substeps = (CTRL_DT / data.model().timestep()).round() as usize;
            debug_assert!(substeps == SUBSTEPS || data.model().timestep() != SIM_DT);
            data.step(substeps).map_err(raise)
        })
    }

    fn state<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let data = self.data.lock().unwrap_or_else(PoisonError::into_inner);
        self.robot.state(&data).into_pyarray(py)
    }

    fn velocity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let data = self.data.lock().unwrap_or_else(PoisonError::into_inner);
        self.robot.velocity(&data).into_pyarray(py)
    }
}
