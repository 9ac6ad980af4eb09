//! The work of one shard.

use std::fmt;

use robert_train::sweep::{Combination, slug};
use serde::{Deserialize, Serialize};

/// The work of one shard; everything else that decides its result is in the plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "work", rename_all = "lowercase", deny_unknown_fields)]
pub enum Cell {
    /// Records motion.
    Collect {
        /// Seed of the collection.
        seed: u64,
        /// Frames to record.
        transitions: u64,
    },
    /// Performs some tasks of a suite with one policy and one seed.
    Eval {
        /// The suite.
        suite: String,
        /// The policy as it is typed.
        policy: String,
        /// The seed, which also draws the plant.
        seed: u64,
        /// The names of the tasks.
        tasks: Vec<String>,
        /// Sha-256 of their clips.
        clips_sha256: String,
    },
    /// Trains a model and lets it perform the suites.
    Train {
        /// The settings that differ between shards.
        values: Combination,
        /// Seed of the run.
        seed: u64,
    },
}

impl fmt::Display for Cell {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Cell::Collect { seed, transitions } => {
                write!(f, "collect {transitions} frames, seed {seed}")
            }
            Cell::Eval { suite, policy, seed, tasks, .. } => {
                let first = tasks.first().map_or("", String::as_str);
                let more = match tasks.len() {
                    0 | 1 => String::new(),
                    n => format!(" and {} more", n - 1),
                };
                write!(f, "{policy} on {suite}: {first}{more}, seed {seed}")
            }
            Cell::Train { values, seed } if values.is_empty() => write!(f, "train, seed {seed}"),
            Cell::Train { values, seed } => write!(f, "train {}, seed {seed}", slug(values)),
        }
    }
}
