//! The network: masked action-inverse inference.
//!
//! Its input is a window of 51 frames, its output the action of each frame. [`model`] is the
//! transformer, [`head`] its action head, [`step`] one optimiser step on all cores. Everything uses
//! [`robert_linalg`]. The module does not depend on clips, takes or simulators.

pub mod action_history;
mod adaptive_threads;
pub mod batch;
mod card;
#[cfg(test)]
mod check;
pub mod checkpoint;
pub mod config;
pub mod encode;
pub mod engine;
mod error;
pub mod exchange;
pub mod forward;
pub mod head;
mod helper_thread;
pub mod infer;
pub mod kmeans;
pub mod mask;
pub mod model;
pub mod observer;
mod optimiser_state;
pub mod params;
pub mod reach;
pub mod ridge;
mod single;
pub mod step;
pub mod tensors;
pub mod token;

pub use action_history::ActionHistory;
pub use batch::{Batch, Place};
pub use checkpoint::{Card, Model, RobotCard};
pub use config::{
    COMMAND, CURRENT, HISTORY, MaskGranularity, Mixing, NetConfig, SkipKind, TokenKind, WINDOW,
};
pub use encode::Encoder;
pub use engine::{CpuEngine, Engine, Engines, Setup};
pub use error::Error;
pub use infer::{NetPolicy, NetPolicyConfig, Threads};
pub use model::Net;
pub use observer::Observer;
pub use ridge::{Episodes, Ridge};
pub use step::{AdamConfig, Learner};
pub use token::{Facts, JointFacts, Normaliser, TokenConfig, Tokeniser};
