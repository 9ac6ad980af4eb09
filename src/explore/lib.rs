//! Collectors: they record motion without task reward, label or demonstration.
//!
//! Five agents learn from an intrinsic reward alone (`rnd`, `icm`, `apt`, `aps`, `proto`: one file
//! each, with a common `ddpg` backbone). Smooth `noise` and `babble` need no learning. [`collect`]
//! is the procedure: train, keep snapshots, roll the snapshots out, merge in equal parts.
//!
//! Everything is a function of the options and one seed: environments, updates and shards are the
//! same on one thread or many, and after any number of kills.
//!
//! Sources: URLB (Laskin et al. 2021) for sizes and losses; the papers named in each file.

mod action_noise;
mod agent;
mod aps;
mod apt;
mod babble;
mod batch;
mod bench;
mod checkpoint;
mod collect;
mod ddpg;
mod describe;
mod env;
mod env_batch;
mod error;
mod icm;
mod learning_curves;
mod mlp;
mod noise;
mod parallel;
mod particle;
mod policy;
mod preset;
mod proto;
mod replay;
mod request;
mod rnd;
mod state;
mod update_bench;
pub use action_noise::NoiseBounds;
pub use agent::{AgentKind, Point};
pub use bench::RolloutBench;
pub use collect::{AgentSummary, Collected, collect};
pub use describe::describe;
pub use error::Error;
pub use learning_curves::learning_curves;
pub use mlp::Adam;
pub use mlp::{Layer, Mlp, Tape};
pub use preset::Preset;
pub use request::{Begun, CollectConfig, begun, share};
pub use update_bench::UpdateBench;
