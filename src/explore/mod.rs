//! Curious agents: motion without reward, label or demonstration.

mod agent;
mod aps;
mod apt;
mod batch;
mod checkpoint;
mod collect;
mod ddpg;
mod env;
mod error;
mod fill;
mod icm;
mod kernel;
mod mlp;
mod noise;
mod particle;
mod policy;
mod preset;
mod proto;
mod replay;
mod rnd;
mod state;
pub use agent::{AgentKind, Point, UpdateBench};
pub use collect::{AgentSummary, CollectConfig, Collected, collect};
pub use error::Error;
pub use fill::describe;
pub use preset::Preset;
