//! The network: masked action-inverse inference.
//!
//! A window of 51 frames goes in, the action of each frame comes out. [`model`] is the
//! transformer itself, [`head`] its action head, [`step`] one optimiser step on all cores;
//! everything stands on [`mat`], the one place that multiplies matrices, and [`simd`], the
//! elementwise rest. The module knows nothing of clips, takes or simulators.

#[cfg(test)]
mod check;
pub mod config;
mod error;
pub mod head;
pub mod mat;
pub mod model;
pub mod params;
pub mod real;
pub mod simd;
pub mod step;

pub use config::{
    COMMAND, CURRENT, HISTORY, MaskGranularity, NetConfig, SkipKind, TokenKind, WINDOW,
};
pub use error::Error;
pub use model::{Batch, Net};
pub use step::{AdamConfig, Learner};
