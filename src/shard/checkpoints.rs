//! Checkpoints of a training shard, where every node finds them.
//!
//! A run trains in the temporary folder of its process, so that two processes never write the same
//! file. From time to time a copy of the run is published here under the next number, and a process
//! that begins the shard continues from the highest number. All runs of a shard pass through the
//! same weights, so any checkpoint is correct; an older one only costs time.

use std::fs;
use std::path::{Path, PathBuf};

use robert_train::paths;

use super::error::write_error;
use super::{Error, folder};

/// The number of checkpoints that are kept: the newest may be the incomplete copy of a process that
/// is being killed.
const KEPT: usize = 2;

/// The checkpoints of one shard.
#[derive(Debug)]
pub(super) struct Checkpoints {
    dir: PathBuf,
}

impl Checkpoints {
    pub(super) fn new(plan: &Path, name: &str) -> Self {
        Checkpoints { dir: plan.join("checkpoints").join(name) }
    }

    /// All of them, oldest first, with their numbers.
    fn all(&self) -> Vec<(u64, PathBuf)> {
        let entries = fs::read_dir(&self.dir).into_iter().flatten().flatten();
        let numbered = entries.filter_map(|e| {
            let number = e.file_name().to_string_lossy().split('-').next()?.parse().ok()?;
            Some((number, e.path()))
        });
        let mut all: Vec<(u64, PathBuf)> = numbered.collect();
        all.sort();
        all
    }

    /// Copies the newest checkpoint into `run`; false if there is none.
    pub(super) fn restore(&self, run: &Path) -> bool {
        for (_, path) in self.all().into_iter().rev() {
            if paths::last(&path).is_file() && folder::copy(&path, run).is_ok() {
                return true;
            }
            // Another process may have removed it meanwhile.
            fs::remove_dir_all(run).ok();
        }
        false
    }

    /// Publishes the state of a run. The run may continue meanwhile, because it replaces whole
    /// files. The weights are copied first; metrics and models newer than them are computed again.
    ///
    /// Another process that has finished the shard removes this folder, perhaps just now: then it is
    /// made again.
    pub(super) fn publish(&self, run: &Path) -> Result<(), Error> {
        self.try_publish(run).or_else(|_| self.try_publish(run)).or_else(|_| self.try_publish(run))
    }

    fn try_publish(&self, run: &Path) -> Result<(), Error> {
        fs::create_dir_all(&self.dir).map_err(write_error(&self.dir))?;
        let all = self.all();
        let number = all.last().map_or(0, |(n, _)| n + 1);
        let own = format!("{number:06}-{}-{}", folder::host(), std::process::id());
        let temporary = tempfile::Builder::new()
            .prefix(".tmp-")
            .tempdir_in(&self.dir)
            .map_err(write_error(&self.dir))?;
        let made = temporary.path().join("run");
        let (from, to) = (paths::last(run), paths::last(&made));
        if let Some(parent) = to.parent() {
            fs::create_dir_all(parent).map_err(write_error(parent))?;
        }
        fs::copy(&from, &to).map_err(write_error(&to))?;
        rest(run, &made, &from)?;
        folder::sync(&made).map_err(write_error(&made))?;
        let target = self.dir.join(own);
        fs::rename(&made, &target).map_err(write_error(&target))?;
        let spare = (all.len() + 1).saturating_sub(KEPT);
        for (_, old) in all.iter().take(spare) {
            fs::remove_dir_all(old).ok();
        }
        Ok(())
    }

    /// Removes them all.
    pub(super) fn clear(&self) {
        fs::remove_dir_all(&self.dir).ok();
    }
}

/// Copies everything but `done` and temporary files.
fn rest(from: &Path, to: &Path, done: &Path) -> Result<(), Error> {
    fs::create_dir_all(to).map_err(write_error(to))?;
    for entry in fs::read_dir(from).into_iter().flatten().flatten() {
        let (a, b) = (entry.path(), to.join(entry.file_name()));
        let hidden = entry.file_name().to_string_lossy().starts_with('.');
        if a == done || hidden {
            continue;
        }
        if a.is_dir() {
            rest(&a, &b, done)?;
        } else {
            fs::copy(&a, &b).map_err(write_error(&b))?;
        }
    }
    Ok(())
}
