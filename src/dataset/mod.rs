//! Trajectories on disk: what the collectors fill and what training reads.
//!
//! A dataset is a folder with `manifest.json` and safetensors shards. The manifest lists
//! every trajectory (shard, start, length, who made it); a shard is a pure function of
//! (spec, index), so completion is judged from files and their sha256, never from a queue
//! or a log. There is no reward, label or demonstration in it.
//!
//! Splitting, shrinking and corrupting a dataset are views: another manifest over the same
//! shard files. Copying gigabytes to study a tenth of them was the rejected choice.
//!
//! What is stored per frame t: `qpos` (state joints), `qvel` (for exact resets), `ctrl` =
//! the action in [-1, 1] that was held during frame t and took the state to t+1 (the
//! simulator got `ctrl * ctrlrange`), and `self_contact`, which is of the end of frame t (the
//! simulator step before state t+1), as `ctrl` and not `qpos` is.

mod coverage;
mod error;
mod manifest;
mod merge;
mod open;
mod robot;
mod shard;
mod statistics;
mod stats;
mod view;
mod windows;

/// Frames of the shortest trajectory worth keeping: one window of the network.
pub const SHORTEST: usize = 51;

pub use coverage::Coverage;
pub use error::Error;
pub use manifest::{Episode, FORMAT, Manifest, Part, Physics, ShardEntry, Totals, View};
pub use merge::merge;
pub use open::{Dataset, Problem, Verify};
pub use robot::Robot;
pub use shard::{EpisodeMeta, Shard, ShardBuilder, ShardHeader};
pub use statistics::Statistics;
pub use stats::{Moments, Normaliser, usual};
pub use view::{Corruption, corrupt, pick, rebase, shrink, split};
pub use windows::{Window, Windows};
