//! Curious agents: motion without reward, label or demonstration.
//!
//! Five agents learn on an intrinsic reward alone ([`rnd`], [`icm`], [`apt`], [`aps`],
//! [`proto`]: one file each, over one [`ddpg`] backbone); smooth [`noise`] needs no learning
//! and is what they are judged against. [`collect`] is the procedure: train, keep snapshots,
//! roll the snapshots out, merge in equal parts.
//!
//! Everything is a function of the options and one seed: environments, updates and shards
//! come out the same on one thread or many, and after any number of kills.
//!
//! Sources: URLB (Laskin et al. 2021) for sizes and losses; the papers named in each file.

mod agent;
mod aps;
mod apt;
mod babble;
mod batch;
mod bench;
mod checkpoint;
mod collect;
mod crew;
mod ddpg;
mod env;
mod error;
mod fill;
mod icm;
mod mlp;
mod noise;
mod particle;
mod policy;
mod preset;
mod proto;
mod replay;
mod request;
mod rnd;
mod state;
mod survey;
mod wander;
pub use agent::{AgentKind, Point, UpdateBench};
pub use bench::RolloutBench;
pub use collect::{AgentSummary, Collected, collect};
pub use error::Error;
pub use fill::describe;
pub(crate) use mlp::{Adam, Layer, Mlp, Tape};
pub use preset::Preset;
pub use request::{Begun, CollectConfig, begun};
pub use survey::survey;
pub use wander::Spread;
