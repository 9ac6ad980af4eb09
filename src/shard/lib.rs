//! Work in shards: a plan cuts a large job into cells, any machine performs any of them, and a
//! merge puts the results together.
//!
//! A shard is a pure function of (plan, index). It writes files and a manifest with their sha256 to
//! a temporary folder, which is renamed when all of it is on disk. So it may be killed, repeated,
//! or run twice at once, and a scheduler only needs a command with an index. The files alone decide
//! whether a shard is done. Queues are never asked: in our tests one of them reported finished jobs
//! as stuck.
//!
//! | file | noun |
//! |---|---|
//! | [`Spec`] | the file that a person writes |
//! | [`Plan`] | all cells, checked, with the hashes of what they read |
//! | [`Cell`] | the work of one shard |
//! | [`Runner`] | performs cells in this process |
//! | [`survey`] | which shards are done, missing, corrupt or foreign |
//! | [`merge`] | the results together |
//! | [`Pool`] | performs shards in child processes of this machine |
//! | [`slurm`], [`kubernetes`] | scripts for clusters |

mod cell;
mod checkpoints;
mod collecting;
mod context;
mod draft;
mod error;
mod evaluating;
mod folder;
pub mod kubernetes;
mod machine;
mod manifest;
mod merge;
mod plan;
mod planning;
mod pool;
mod ranges;
mod runner;
pub mod slurm;
mod spec;
mod survey;
mod tables;
mod training;

pub use cell::Cell;
pub use error::Error;
pub use machine::Machine;
pub use manifest::{FileEntry, Manifest};
pub use merge::{Merged, merge};
pub use plan::{Accept, Plan};
pub use planning::make;
pub use pool::{Answer, Pool, Pooled};
pub use ranges::ranges;
pub use runner::{Done, Runner};
pub use spec::Spec;
pub use survey::{State, Survey, survey};
