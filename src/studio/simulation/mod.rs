//! The simulation: a worker process, the rollout that it performs, and the takes that are kept.
//!
//! An edit goes one way: the session performs its document here, the worker simulates, the store
//! takes the frames, and sockets and viewport read the store.

mod frame_log;
mod handle;
mod kept_takes;
mod robot_context;
mod rollout_store;
mod take_files;
mod takes;
mod unreached;
pub(crate) mod worker;

pub(crate) use handle::Simulation;
pub(crate) use robot_context::RobotContext;
pub(crate) use rollout_store::RolloutStore;
pub(crate) use takes::Takes;
pub(crate) use unreached::Unreached;
pub use worker::run as run_worker;
