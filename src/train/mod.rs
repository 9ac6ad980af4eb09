//! Training: settings, preparation of data and linear fit, the loop, resuming.
//!
//! [`config`] is what a person chooses, [`prepare`] what follows from the data,
//! [`run`] the loop, [`record`] what a run directory tells, [`sweep`] grids of runs. A run is a function of the data and the settings: thread count, kills
//! and resumes change nothing in its weights.

pub mod config;
pub mod curves;
mod error;
pub mod evaluator;
pub mod fit;
pub mod hindsight;
pub mod prepare;
pub mod record;
pub mod run;
mod source;
pub mod sweep;
#[cfg(test)]
mod tests;

pub use config::{ContactTarget, PRESETS, TrainConfig};
pub use error::Error;
pub use run::{Evaluate, Evaluation, Finished, HeldOut, Options, train};
