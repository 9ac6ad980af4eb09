//! The network: masked action-inverse inference.
//!
//! A window of 51 frames goes in, the action of each frame comes out. [`model`] is the
//! transformer itself, [`head`] its action head, [`step`] one optimiser step on all cores;
//! everything stands on [`crate::linalg`]. The module knows nothing of clips, takes or simulators.

mod action_history;
mod adaptive_threads;
pub mod batch;
#[cfg(test)]
mod check;
pub mod checkpoint;
pub mod config;
pub mod encode;
mod error;
pub mod exchange;
pub mod head;
mod helper_thread;
pub mod infer;
pub mod kmeans;
pub mod mask;
pub mod model;
pub mod params;
pub mod reach;
pub mod ridge;
mod single;
pub mod step;
pub mod tensors;
pub mod token;

pub use batch::{Batch, Place};
pub use checkpoint::{Card, Model, RobotCard};
pub use config::{
    COMMAND, CURRENT, HISTORY, MaskGranularity, Mixing, NetConfig, SkipKind, TokenKind, WINDOW,
};
pub use encode::Encoder;
pub use error::Error;
pub use infer::{NetPolicy, NetPolicyConfig, Threads};
pub use model::Net;
pub use ridge::{Episodes, Ridge};
pub use step::{AdamConfig, Learner};
pub use token::{Facts, JointFacts, Normaliser, TokenConfig, Tokeniser};
