//! A dataset, opened: manifest checked against its shards, frames mapped.

#![warn(clippy::indexing_slicing)]

use std::path::{Path, PathBuf};

use super::error::Error;
use super::manifest::{Episode, Manifest, Part};
use super::shard::Shard;
use super::stats::Statistics;
use crate::robot::Robot;

/// How much is checked before a dataset is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verify {
    /// Sizes, shapes, trajectory bounds; the frames are not touched.
    Structure,
    /// Also the sha256 of every shard, and that every value is finite and in range.
    Full,
}

/// One thing wrong with one shard.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Problem {
    /// Its position in the manifest.
    pub shard: usize,
    /// Index within its spec: what has to be made again.
    pub index: u64,
    /// The file.
    pub path: PathBuf,
    /// What is wrong.
    pub message: String,
}

/// A dataset whose shards are mapped.
#[derive(Debug)]
pub struct Dataset {
    manifest: Manifest,
    path: PathBuf,
    shards: Vec<Shard>,
}

impl Dataset {
    /// Opens the dataset at `path` (its folder or manifest).
    ///
    /// # Errors
    /// Those of [`Manifest::load`]; [`Error::Shard`] for one bad shard, [`Error::Incomplete`]
    /// for several.
    pub fn open(path: &Path, verify: Verify) -> Result<Self, Error> {
        Self::of(Manifest::load(path)?, Manifest::path_of(path), verify)
    }

    /// Counts, measures and writes a manifest to the folder `dir`, where its shards can be
    /// reached.
    ///
    /// # Errors
    /// Those of [`Dataset::open`] and [`Manifest::save`].
    pub fn publish(mut manifest: Manifest, dir: &Path) -> Result<Manifest, Error> {
        manifest.count();
        let mut data = Self::of(manifest, dir.join("manifest.json"), Verify::Structure)?;
        data.manifest.statistics = data.statistics();
        data.manifest.save(dir)?;
        Ok(data.manifest)
    }

    fn of(manifest: Manifest, path: PathBuf, verify: Verify) -> Result<Self, Error> {
        let (shards, mut problems) = inspect(&manifest, &path, verify);
        match (problems.len(), problems.pop()) {
            (0, _) | (_, None) => Ok(Dataset { manifest, path, shards }),
            (1, Some(p)) => Err(Error::Shard { index: p.shard, message: p.message, path: p.path }),
            (_, Some(last)) => {
                let indices: Vec<usize> =
                    problems.iter().map(|p| p.shard).chain([last.shard]).collect();
                let first = problems.first().unwrap_or(&last);
                Err(Error::Incomplete {
                    first: format!("{} {}", first.path.display(), first.message),
                    total: manifest.shards.len(),
                    indices,
                })
            }
        }
    }

    /// Every problem of every shard, fully verified.
    ///
    /// # Errors
    /// Those of [`Manifest::load`].
    pub fn check(path: &Path) -> Result<Vec<Problem>, Error> {
        let manifest = Manifest::load(path)?;
        Ok(inspect(&manifest, &Manifest::path_of(path), Verify::Full).1)
    }

    /// Refuses data of another robot, or of another version of its model.
    ///
    /// # Errors
    /// [`Error::OtherRobot`].
    pub fn must_be_of(&self, robot: &Robot) -> Result<(), Error> {
        let of = &self.manifest.robot;
        if of.model_sha256 == robot.model_sha256() {
            return Ok(());
        }
        Err(Error::OtherRobot {
            of: of.id.clone(),
            of_model: of.model_sha256.clone(),
            robot: robot.id().to_owned(),
            model: robot.model_sha256().to_owned(),
            path: self.path.clone(),
        })
    }

    /// The manifest.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Where the manifest lies.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The mapped shards, in manifest order.
    pub fn shards(&self) -> &[Shard] {
        &self.shards
    }

    /// The trajectories, in manifest order.
    pub fn episodes(&self) -> &[Episode] {
        &self.manifest.episodes
    }

    /// Frames of a trajectory: qpos (n, S), qvel (n, S), ctrl (n, A).
    pub fn frames(&self, e: &Episode) -> (&[f32], &[f32], &[f32]) {
        let (start, n) = (e.start as usize, e.length as usize);
        match self.shards.get(e.shard) {
            Some(s) => (s.qpos_rows(start, n), s.qvel_rows(start, n), s.ctrl_rows(start, n)),
            None => (&[], &[], &[]),
        }
    }

    /// Self-contact flags of a trajectory, (n).
    pub fn self_contact(&self, e: &Episode) -> &[u8] {
        let span = e.start as usize..(e.start + e.length) as usize;
        self.shards.get(e.shard).and_then(|s| s.self_contact().get(span)).unwrap_or_default()
    }

    /// Positions in [`Dataset::episodes`] of one part. A split fixed in the manifest is
    /// obeyed; otherwise 5 % are held out by `seed` (see [`super::split`]).
    pub fn part(&self, part: Part, seed: u64) -> Vec<usize> {
        super::view::part(&self.manifest, part, seed)
    }

    /// Hygiene and spread of all listed frames.
    pub fn statistics(&self) -> Statistics {
        Statistics::compute(self)
    }
}

/// Opens all shards of a manifest at `path`; two at a time when hashing.
fn inspect(manifest: &Manifest, path: &Path, verify: Verify) -> (Vec<Shard>, Vec<Problem>) {
    raise_file_limit(manifest.shards.len());
    let dir = path.parent().unwrap_or(Path::new("."));
    let count = manifest.shards.len();
    let workers = std::thread::available_parallelism().map_or(1, usize::from).min(count.max(1));
    let next = std::sync::atomic::AtomicUsize::new(0);
    let mut results: Vec<(usize, Result<Shard, Problem>)> =
        std::thread::scope(|scope| {
            let work =
                || {
                    let mut mine = Vec::new();
                    loop {
                        let i = next.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                        let Some(entry) = manifest.shards.get(i) else { return mine };
                        let file = dir.join(&entry.file);
                        let found = open_one(manifest, i, &file, verify).map_err(|message| {
                            Problem { shard: i, index: entry.index, path: file, message }
                        });
                        mine.push((i, found));
                    }
                };
            let handles: Vec<_> = (1..workers).map(|_| scope.spawn(work)).collect();
            let mut all = work();
            for handle in handles {
                all.extend(handle.join().unwrap_or_default());
            }
            all
        });
    results.sort_by_key(|(i, _)| *i);
    let mut shards = Vec::with_capacity(count);
    let mut problems = Vec::new();
    for (_, result) in results {
        match result {
            Ok(shard) => shards.push(shard),
            Err(problem) => problems.push(problem),
        }
    }
    (shards, problems)
}

fn open_one(m: &Manifest, i: usize, file: &Path, verify: Verify) -> Result<Shard, String> {
    let Some(entry) = m.shards.get(i) else { return Err("is not listed".to_owned()) };
    let shard = Shard::open(file, m.qpos_dim(), m.ctrl_dim(), Some(entry.bytes))?;
    let h = shard.header();
    if h.robot != m.robot.id || h.model_sha256 != m.robot.model_sha256 {
        return Err(format!(
            "is of robot {} (model {:.12}), the manifest of {} (model {:.12})",
            h.robot, h.model_sha256, m.robot.id, m.robot.model_sha256
        ));
    }
    if shard.frames() as u64 != entry.frames
        || h.index != entry.index
        || h.spec_sha256 != entry.spec_sha256
    {
        return Err("is another shard than the manifest lists".to_owned());
    }
    if verify == Verify::Full {
        shard.verify(&entry.sha256)?;
    }
    Ok(shard)
}

/// A mapped shard keeps its file open (for the lock); the usual soft limit of 1024 open
/// files is then too low for datasets of the paper's size. The hard limit is left alone.
fn raise_file_limit(shards: usize) {
    use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
    let want = shards as u64 + 256;
    let now = getrlimit(Resource::Nofile);
    if now.current.is_some_and(|c| c < want) {
        let current = Some(now.maximum.map_or(want, |m| m.min(want)));
        // Failing here shows up as "cannot be mapped (too many open files)", with the shard.
        setrlimit(Resource::Nofile, Rlimit { current, maximum: now.maximum }).ok();
    }
}
