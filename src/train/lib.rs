//! Training: settings, preparation of data and linear fit, the loop, resuming.
//!
//! [`config`] contains the settings, [`prepare`] everything derived from the data, [`run`] the
//! loop, [`metrics`] its figures, [`record`] the reader of run directories, [`sweep`] grids of
//! runs. A run is a function of the data and the settings; thread count, kills and resumes do not
//! change its weights.

pub mod config;
pub mod curves;
mod error;
mod evaluation;
pub mod evaluator;
pub mod fit;
pub mod fitted_ridge;
pub mod hindsight;
pub mod metrics;
mod options;
pub mod paths;
pub mod penalty;
pub mod points;
pub mod prepare;
mod pressing;
pub mod record;
pub mod run;
mod source;
mod state;
pub mod sweep;
#[cfg(test)]
mod tests;

pub use config::{ContactTarget, PRESETS, Select, SlideUnit, TrainConfig};
pub use error::Error;
pub use metrics::{Evaluation, HeldOut};
pub use options::{Evaluate, Finished, Options};
pub use paths::read_config;
pub use record::{began_with, began_with_evaluations};
pub use run::train;
