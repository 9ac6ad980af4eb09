//! Curious agents: motion without reward, label or demonstration.

mod aps;
mod apt;
mod batch;
mod ddpg;
mod icm;
mod kernel;
mod mlp;
mod particle;
mod proto;
mod replay;
mod rnd;
mod state;
