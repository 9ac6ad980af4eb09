//! An open dataset: the manifest is checked against its shards, and frames are mapped.

#![warn(clippy::indexing_slicing)]

use robert_base::json;
use std::path::{Path, PathBuf};

use super::error::Error;
use super::manifest::{Episode, Manifest, Part};
use super::shard::{Shard, checked};
use robert_base::{fsio, parallel};
use robert_robot::Robot;

/// The checks that are made before a dataset is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verify {
    /// Sizes, shapes, and that each trajectory is in its shard; the frames are not read.
    Structure,
    /// Also the sha256 of every shard, and that every value is finite and in range.
    Full,
}

/// One thing wrong with one shard.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Problem {
    /// Its position in the manifest.
    pub shard: usize,
    /// Index within its spec, to make it again.
    pub index: u64,
    /// The file.
    pub path: PathBuf,
    /// The problem, in words.
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

    /// Computes totals and statistics of a manifest and writes it to the folder `dir` (created if
    /// needed), from where its shards can be reached.
    ///
    /// # Errors
    /// Those of [`Dataset::open`] and [`Manifest::save`]; created folders are then removed again.
    pub fn publish(manifest: Manifest, dir: &Path) -> Result<Manifest, Error> {
        let missing = |d: &&Path| !d.as_os_str().is_empty() && !d.exists();
        let made: Vec<&Path> = dir.ancestors().take_while(missing).collect();
        // The shards' paths lead through the folder, so it must exist to check them.
        std::fs::create_dir_all(dir)
            .map_err(|source| fsio::Error::Write { source, path: dir.to_owned() })?;
        let published = Self::measure(manifest, dir);
        if published.is_err() {
            // Only empty folders are removed; a folder that cannot be removed does no harm.
            for d in made {
                std::fs::remove_dir(d).ok();
            }
        }
        published
    }

    fn measure(mut manifest: Manifest, dir: &Path) -> Result<Manifest, Error> {
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

    /// Every problem of every shard, fully verified. If there is none, the manifest's totals and
    /// statistics are recomputed too.
    ///
    /// # Errors
    /// Those of [`Manifest::load`]; [`Error::Manifest`] when totals or statistics do not agree with
    /// the trajectories.
    pub fn check(path: &Path) -> Result<Vec<Problem>, Error> {
        let manifest = Manifest::load(path)?;
        let path = Manifest::path_of(path);
        let (shards, problems) = inspect(&manifest, &path, Verify::Full);
        if problems.is_empty() {
            Dataset { manifest, path, shards }.must_add_up()?;
        }
        Ok(problems)
    }

    fn must_add_up(&self) -> Result<(), Error> {
        // Compared as JSON, so that no field can be forgotten here.
        fn written(x: &impl serde::Serialize) -> serde_json::Value {
            json::value(x)
        }
        let m = &self.manifest;
        let pairs = [
            ("totals", written(&m.totals), written(&m.counted())),
            ("statistics", written(&m.statistics), written(&self.statistics())),
        ];
        for (name, listed, found) in &pairs {
            let mut fields = listed.as_object().into_iter().flatten();
            if let Some((field, _)) = fields.find(|(k, v)| found.get(k) != Some(*v)) {
                return Err(Error::Manifest {
                    message: format!(
                        "{name}.{field} does not agree with the trajectories; the manifest was altered"
                    ),
                    path: self.path.clone(),
                });
            }
        }
        Ok(())
    }

    /// Refuses data from another robot, or from another version of its model.
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

    /// Path of the manifest.
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
        let s = self.shard(e);
        (s.qpos_rows(start, n), s.qvel_rows(start, n), s.ctrl_rows(start, n))
    }

    /// The shard of a trajectory of this dataset, which was checked when it was opened.
    #[allow(clippy::indexing_slicing)]
    fn shard(&self, e: &Episode) -> &Shard {
        &self.shards[e.shard]
    }

    /// Self-contact flags of a trajectory, (n).
    pub fn self_contact(&self, e: &Episode) -> &[u8] {
        let span = e.start as usize..(e.start + e.length) as usize;
        checked(self.shard(e).self_contact(), span)
    }

    /// Positions in [`Dataset::episodes`] of one part. A split in the manifest is used; otherwise 5
    /// % are held out by `seed` (see [`super::split`]).
    pub fn part(&self, part: Part, seed: u64) -> Vec<usize> {
        super::view::part(&self.manifest, part, seed)
    }
}

/// Opens all shards of a manifest at `path`; on all cores when hashing.
fn inspect(manifest: &Manifest, path: &Path, verify: Verify) -> (Vec<Shard>, Vec<Problem>) {
    raise_file_limit(manifest.shards.len());
    let dir = path.parent().unwrap_or(Path::new("."));
    let count = manifest.shards.len();
    // Counting the cores reads files of the system, which takes longer than to open one shard.
    let workers = if count > 1 { parallel::cores() } else { 1 };
    let mut results = parallel::each(workers, &manifest.shards, |i, entry| {
        let path = dir.join(&entry.file);
        open_one(manifest, i, &path, verify).map_err(|message| Problem {
            shard: i,
            index: entry.index,
            path,
            message,
        })
    });
    for (k, e) in manifest.episodes.iter().enumerate() {
        let Some(result) = results.get_mut(e.shard) else { continue };
        let Some(entry) = manifest.shards.get(e.shard) else { continue };
        if result.as_ref().is_ok_and(|shard| !shard.holds(e)) {
            let message = format!(
                "has no trajectory as episodes[{k}] lists it: frames {}+{} by {} at {} with seed {}",
                e.start, e.length, e.agent, e.snapshot_step, e.seed
            );
            let path = dir.join(&entry.file);
            *result = Err(Problem { shard: e.shard, index: entry.index, path, message });
        }
    }
    let mut shards = Vec::with_capacity(count);
    let mut problems = Vec::new();
    for result in results {
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
        return Err("is not the shard that the manifest lists".to_owned());
    }
    if verify == Verify::Full {
        shard.verify(&entry.sha256)?;
    }
    Ok(shard)
}

/// A mapped shard keeps its file open (for the lock), and the usual soft limit of 1024 open files
/// is too low for datasets of the paper's size. The hard limit is not changed.
fn raise_file_limit(shards: usize) {
    use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
    let want = shards as u64 + 256;
    let now = getrlimit(Resource::Nofile);
    if now.current.is_some_and(|c| c < want) {
        let current = Some(now.maximum.map_or(want, |m| m.min(want)));
        // A failure here appears as "cannot be mapped (too many open files)", with the shard.
        setrlimit(Resource::Nofile, Rlimit { current, maximum: now.maximum }).ok();
    }
}

#[cfg(test)]
mod tests {
    use super::super::view::tests::dataset;
    use super::*;

    #[test]
    fn a_manifest_that_does_not_fit_its_shards_is_found() {
        let dir = tempfile::tempdir().unwrap();
        let m = dataset(dir.path(), 6, 1);
        let good = Dataset::publish(m, dir.path()).unwrap();
        assert_eq!(Dataset::check(dir.path()).unwrap(), []);
        let hurt = |change: &dyn Fn(&mut Manifest)| {
            let mut m = good.clone();
            change(&mut m);
            m.save(dir.path()).unwrap();
            match Dataset::check(dir.path()) {
                Ok(problems) => problems.into_iter().map(|p| p.message).collect::<String>(),
                Err(e) => e.to_string(),
            }
        };
        // Across the border of two trajectories, in the middle of one, by another, of another.
        for change in [
            |m: &mut Manifest| m.episodes[1].start -= 10,
            |m: &mut Manifest| m.episodes[1].length -= 1,
            |m: &mut Manifest| m.episodes[1].agent = "b".to_owned(),
            |m: &mut Manifest| m.episodes[1].snapshot_step += 1,
            |m: &mut Manifest| m.episodes[1].seed += 1,
        ] {
            assert!(hurt(&change).contains("episodes[1]"));
            let e = Dataset::open(dir.path(), Verify::Structure).unwrap_err().to_string();
            assert!(e.contains("shard 0 ") && e.contains("1-0.safetensors"), "{e}");
        }
        assert!(hurt(&|m| m.totals.frames = 0).contains("totals.frames"));
        assert!(hurt(&|m| m.statistics.agents.clear()).contains("statistics.agents"));
        assert!(hurt(&|m| m.statistics.qpos_mean[1] += 1e-6).contains("statistics.qpos_mean"));
        assert_eq!(hurt(&|_| ()), "");
    }

    #[test]
    fn nothing_is_left_of_a_manifest_that_could_not_be_published() {
        let dir = tempfile::tempdir().unwrap();
        let mut m = dataset(dir.path(), 6, 1);
        m.shards[1].file = "gone".into();
        assert!(Dataset::publish(m, &dir.path().join("new/deep")).is_err());
        assert!(!dir.path().join("new").exists());
    }
}
