//! A robot.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use pyo3::prelude::*;
use robert::robot::import::{Drives, ImportConfig, Servos, import};
use robert::robot::{self as lib, check};

use crate::error::{raise, wrong};

/// A robot of the program (its id) or of a folder.
#[pyclass(frozen)]
pub(crate) struct Robot {
    pub(crate) inner: Arc<lib::Robot>,
}

#[pymethods]
impl Robot {
    #[new]
    fn new(id: &str) -> PyResult<Robot> {
        Ok(Robot { inner: Arc::new(lib::Robot::load(id).map_err(raise)?) })
    }

    #[staticmethod]
    fn builtin() -> Vec<&'static str> {
        lib::Robot::builtin_ids().collect()
    }

    #[getter]
    fn id(&self) -> &str {
        self.inner.id()
    }

    #[getter]
    fn model_sha256(&self) -> &str {
        self.inner.model_sha256()
    }

    #[getter]
    fn mjcf(&self) -> &str {
        self.inner.mjcf()
    }

    #[getter]
    fn joints(&self) -> Vec<String> {
        self.inner.joints().iter().map(|j| j.name.clone()).collect()
    }

    #[getter]
    fn units(&self) -> Vec<&'static str> {
        self.inner.joints().iter().map(|j| j.unit.symbol()).collect()
    }

    #[getter]
    fn ranges(&self) -> Vec<[f64; 2]> {
        self.inner.joints().iter().map(|j| j.range).collect()
    }

    #[getter]
    fn actuators(&self) -> Vec<String> {
        self.inner.actuators().iter().map(|a| a.name.clone()).collect()
    }

    #[getter]
    fn ctrl_ranges(&self) -> Vec<[f64; 2]> {
        self.inner.actuators().iter().map(|a| a.ctrlrange).collect()
    }

    fn home(&self) -> Vec<f64> {
        self.inner.home()
    }

    fn pose_names(&self) -> Vec<String> {
        self.inner.pose_names().map(str::to_owned).collect()
    }

    fn pose(&self, name: &str) -> PyResult<Vec<f64>> {
        self.inner.pose(name).map_err(raise)
    }

    /// Policies of this robot: name, model (or none), what it suits, whether it is the default.
    fn policies(&self) -> Vec<(String, Option<String>, String, bool)> {
        let offers = robert::rollout::offers(&self.inner).into_iter();
        offers.map(|o| (o.name.as_str().to_owned(), o.model, o.suits, o.default)).collect()
    }
}

/// Makes a robot's folder out of a URDF or MJCF; JSON of what was assumed.
#[pyfunction]
#[pyo3(signature = (source, out, id=None, root=None, packages=BTreeMap::new(), fixed_base=false, base_height=0.0, effort=None, weld=Vec::new(), without=Vec::new(), without_meshes=false, torque=false, drives="modelled"))]
pub(crate) fn import_robot(
    py: Python<'_>,
    source: PathBuf,
    out: PathBuf,
    id: Option<String>,
    root: Option<PathBuf>,
    packages: BTreeMap<String, PathBuf>,
    fixed_base: bool,
    base_height: f64,
    effort: Option<f64>,
    weld: Vec<String>,
    without: Vec<String>,
    without_meshes: bool,
    torque: bool,
    drives: &str,
) -> PyResult<String> {
    let drives = match drives {
        "modelled" => Drives::Modelled,
        "file" => Drives::File,
        other => return Err(wrong(format!("drives is modelled or file, not {other:?}"))),
    };
    let config = ImportConfig {
        root,
        packages,
        id,
        fixed_base,
        base_height_m: base_height,
        effort,
        weld,
        without,
        without_meshes,
        drives,
        servos: if torque { Servos::Torque } else { Servos::Keep },
        ..ImportConfig::new(source, out, check::executable().map_err(raise)?)
    };
    let report = py.detach(|| import(&config)).map_err(raise)?;
    serde_json::to_string(&report).map_err(|e| wrong(e.to_string()))
}
