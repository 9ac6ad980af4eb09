//! The half of `robert_studio` that is Rust: thin classes around the library's values. Arrays go
//! to Python flat and get their shapes there; long work runs without the interpreter's lock,
//! looks for Ctrl-C and reports how far it is.

// Python's keyword arguments are a function's parameters here.
#![allow(clippy::too_many_arguments)]

mod clip;
mod error;
mod export;
mod jobs;
mod learn;
mod policy;
mod robot;
mod simulation;
mod take;

#[pyo3::pymodule]
mod _native {
    #[pymodule_export]
    use super::clip::Clip;
    #[pymodule_export]
    use super::error::{InvalidInput, MissingDependency, RobertError};
    #[pymodule_export]
    use super::export::export;
    #[pymodule_export]
    use super::learn::{collect, dataset, evaluate, fit, train};
    #[pymodule_export]
    use super::policy::Policy;
    #[pymodule_export]
    use super::robot::{Robot, import_robot};
    #[pymodule_export]
    use super::simulation::Simulation;
    #[pymodule_export]
    use super::take::{Take, rollout};

    use pyo3::prelude::*;

    /// The command line, in this process; the exit code.
    #[pyfunction]
    fn main(py: Python<'_>, args: Vec<String>) -> u8 {
        py.detach(|| robert::cli::call(args.into_iter().map(Into::into)).code())
    }

    /// The command `robert`, which compiles foreign models in a process of its own.
    #[pyfunction]
    fn set_executable(robert: std::path::PathBuf) {
        robert::robot::check::set_executable(robert);
    }

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
