//! Recorded trajectories on disk: collectors write them, training reads them.
//!
//! A dataset is a folder with `manifest.json` and safetensors shards. The manifest lists every
//! trajectory (shard, start, length, agent). A shard is a pure function of (spec, index), so
//! completion is determined by files and their sha256, never by a queue or a log. A dataset
//! contains no reward, label or demonstration.
//!
//! Splitting, shrinking and corrupting a dataset make views: another manifest over the same shard
//! files. Rejected: copying gigabytes to study a tenth of them.
//!
//! Each frame t has `qpos` (state joints), `qvel` (for exact resets), `ctrl` (the action in [-1, 1]
//! that was held during frame t and led to state t+1; the simulator got `ctrl * ctrlrange`), and
//! `self_contact`, which like `ctrl` belongs to the end of frame t (the simulator step before state
//! t+1).

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
