//! One shard: a safetensors file with consecutive trajectories.
//!
//! | tensor | shape | dtype | content |
//! |---|---|---|---|
//! | `qpos` | (N, S) | f32 | state joints, rad or m |
//! | `qvel` | (N, S) | f32 | their velocities, per second |
//! | `ctrl` | (N, A) | f32 | action in [-1, 1] held during the frame |
//! | `self_contact` | (N) | u8 | 1 where two links of the robot touch as the frame ends |
//! | `episode_offsets` | (E + 1) | i64 | first frame of each trajectory, then N |
//! | `episode_snapshot` | (E) | i64 | environment steps behind the acting agent |
//! | `episode_seed` | (E) | i64 | seed of the trajectory's own draws |
//!
//! The header's string metadata has one key, `robert`, with [`ShardHeader`] as JSON. There is only
//! one key because the file must have the same bytes every time, and the writer keeps metadata in a
//! hash map.
//!
//! Reading maps the file. Measured on 512 random windows of 51 frames from the page cache,
//! one thread: mapping 8-13 GB/s; positioned reads (one system call a window and tensor,
//! about 0.55 us each) .75 GB/s for 2 columns, 1.7 for 5, 5.2 for 22, so they miss 2 GB/s on small
//! robots. Mapping has a price: if another process truncates a file *while it is mapped*, the
//! process ends with SIGBUS, where a read would return an error. Shards are written once, published
//! by rename and never changed in place. Sizes and hashes are checked before mapping, and a shared
//! advisory lock is held. So only deliberate damage has this effect.
//! `mmap-guard` keeps the one unsafe call (to memmap2) out of this crate; `vmap` was
//! dormant, `mmap-io` fixed use-after-free in its safe API one release ago.

#![warn(clippy::indexing_slicing)]

use std::collections::HashMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

use mmap_guard::FileData;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};

use super::error::Error;
use super::manifest::{Episode, Manifest, ShardEntry};
use super::robot::Robot;
use robert_base::fsio;
use robert_base::limits;

/// Format name of this version.
const FORMAT: &str = "robert-shard/1";
/// Key of the header's metadata.
const KEY: &str = "robert";

/// The header of a shard.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShardHeader {
    /// `robert-shard/1`.
    pub format: String,
    /// Robot id.
    pub robot: String,
    /// Sha-256 of the robot's MJCF.
    pub model_sha256: String,
    /// Sha-256 of the collection spec.
    pub spec_sha256: String,
    /// Index within the spec.
    pub index: u64,
    /// The agents, one name per trajectory.
    pub agents: Vec<String>,
    /// Trajectories dropped because the simulation diverged.
    pub dropped_broken: u64,
    /// Trajectories dropped because they were too short.
    pub dropped_short: u64,
}

/// The origin of a trajectory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EpisodeMeta {
    /// The agent that acted.
    pub agent: String,
    /// Environment steps of the agent's training.
    pub snapshot_step: u64,
    /// Seed of the trajectory's random choices.
    pub seed: u64,
}

impl Manifest {
    /// Adds a shard with all of its trajectories.
    pub fn add(&mut self, entry: ShardEntry, shard: &Shard) {
        let at = self.shards.len();
        self.episodes.extend(shard.episodes().map(|(start, length, meta)| Episode {
            shard: at,
            start,
            length,
            agent: meta.agent,
            snapshot_step: meta.snapshot_step,
            seed: meta.seed,
            part: None,
        }));
        self.shards.push(entry);
    }
}

/// Collects trajectories and writes them as one file.
#[derive(Clone, Debug)]
pub struct ShardBuilder {
    header: ShardHeader,
    qpos_dim: usize,
    ctrl_dim: usize,
    qpos: Vec<f32>,
    qvel: Vec<f32>,
    ctrl: Vec<f32>,
    contact: Vec<u8>,
    offsets: Vec<i64>,
    snapshots: Vec<i64>,
    seeds: Vec<i64>,
}

impl ShardBuilder {
    /// An empty shard `index` of the spec with this hash.
    pub fn new(robot: &Robot, spec_sha256: &str, index: u64) -> Self {
        ShardBuilder {
            header: ShardHeader {
                format: FORMAT.to_owned(),
                robot: robot.id.clone(),
                model_sha256: robot.model_sha256.clone(),
                spec_sha256: spec_sha256.to_owned(),
                index,
                agents: Vec::new(),
                dropped_broken: 0,
                dropped_short: 0,
            },
            qpos_dim: robot.joints.len(),
            ctrl_dim: robot.actuators.len(),
            qpos: Vec::new(),
            qvel: Vec::new(),
            ctrl: Vec::new(),
            contact: Vec::new(),
            offsets: vec![0],
            snapshots: Vec::new(),
            seeds: Vec::new(),
        }
    }

    /// Frames so far.
    pub fn frames(&self) -> usize {
        self.contact.len()
    }

    /// Counts a trajectory whose simulation diverged.
    pub fn drop_broken(&mut self) {
        self.header.dropped_broken += 1;
    }

    /// Counts a trajectory too short for a window.
    pub fn drop_short(&mut self) {
        self.header.dropped_short += 1;
    }

    /// Appends a trajectory of n frames: `qpos` and `qvel` (n, S), `ctrl` (n, A) in [-1, 1],
    /// `contact` (n) of 0 and 1.
    ///
    /// # Errors
    /// [`Error::Trajectory`] for lengths that do not fit or a value that is not finite.
    pub fn push(
        &mut self,
        meta: &EpisodeMeta,
        qpos: &[f32],
        qvel: &[f32],
        ctrl: &[f32],
        contact: &[u8],
    ) -> Result<(), Error> {
        let n = contact.len();
        let fits = qpos.len() == n * self.qpos_dim
            && qvel.len() == n * self.qpos_dim
            && ctrl.len() == n * self.ctrl_dim;
        if n == 0 || !fits {
            return Err(Error::Trajectory(format!(
                "{n} frames with {}, {}, {} values",
                qpos.len(),
                qvel.len(),
                ctrl.len()
            )));
        }
        if let Some(what) = bad_value(qpos, qvel, ctrl) {
            return Err(Error::Trajectory(what));
        }
        self.qpos.extend_from_slice(qpos);
        self.qvel.extend_from_slice(qvel);
        self.ctrl.extend_from_slice(ctrl);
        self.contact.extend_from_slice(contact);
        self.offsets.push(self.contact.len() as i64);
        self.header.agents.push(meta.agent.clone());
        self.snapshots.push(meta.snapshot_step as i64);
        self.seeds.push(meta.seed as i64);
        Ok(())
    }

    /// Writes the shard atomically at `dir/file`; the same trajectories give the same bytes.
    ///
    /// # Errors
    /// [`Error::File`], [`Error::Trajectory`] when the shard is empty.
    pub fn write(&self, dir: &Path, file: &Path) -> Result<ShardEntry, Error> {
        let bytes = self.bytes()?;
        let entry = ShardEntry {
            file: file.to_owned(),
            sha256: fsio::sha256_hex(&bytes),
            bytes: bytes.len() as u64,
            spec_sha256: self.header.spec_sha256.clone(),
            index: self.header.index,
            frames: self.frames() as u64,
            episodes: self.seeds.len() as u64,
            dropped_broken: self.header.dropped_broken,
            dropped_short: self.header.dropped_short,
        };
        fsio::write_atomic(&dir.join(file), &bytes)?;
        Ok(entry)
    }

    fn bytes(&self) -> Result<Vec<u8>, Error> {
        let fail = |e: &dyn std::fmt::Display| Error::Trajectory(e.to_string());
        let (n, s, a, e) = (self.frames(), self.qpos_dim, self.ctrl_dim, self.seeds.len());
        let json = serde_json::to_string(&self.header).map_err(|e| fail(&e))?;
        let tensors: [(&str, Dtype, Vec<usize>, &[u8]); 7] = [
            ("qpos", Dtype::F32, vec![n, s], bytemuck::cast_slice(&self.qpos)),
            ("qvel", Dtype::F32, vec![n, s], bytemuck::cast_slice(&self.qvel)),
            ("ctrl", Dtype::F32, vec![n, a], bytemuck::cast_slice(&self.ctrl)),
            ("self_contact", Dtype::U8, vec![n], &self.contact),
            ("episode_offsets", Dtype::I64, vec![e + 1], bytemuck::cast_slice(&self.offsets)),
            ("episode_snapshot", Dtype::I64, vec![e], bytemuck::cast_slice(&self.snapshots)),
            ("episode_seed", Dtype::I64, vec![e], bytemuck::cast_slice(&self.seeds)),
        ];
        let mut views = Vec::with_capacity(tensors.len());
        for (name, dtype, shape, data) in tensors {
            views.push((name, TensorView::new(dtype, shape, data).map_err(|e| fail(&e))?));
        }
        safetensors::serialize(views, Some(HashMap::from([(KEY.to_owned(), json)])))
            .map_err(|e| fail(&e))
    }
}

fn bad_value(qpos: &[f32], qvel: &[f32], ctrl: &[f32]) -> Option<String> {
    for (name, values) in [("qpos", qpos), ("qvel", qvel), ("ctrl", ctrl)] {
        if let Some(at) = values.iter().position(|v| !v.is_finite()) {
            return Some(format!("{name} contains a value that is not finite (at {at})"));
        }
    }
    let at = ctrl.iter().position(|v| v.abs() > 1.0)?;
    Some(format!("ctrl is outside [-1, 1] (at {at})"))
}

/// A shard, mapped and checked; frames are read in place.
#[derive(Debug)]
pub struct Shard {
    data: FileData,
    header: ShardHeader,
    frames: usize,
    qpos_dim: usize,
    ctrl_dim: usize,
    qpos: Range<usize>,
    qvel: Range<usize>,
    ctrl: Range<usize>,
    contact: Range<usize>,
    offsets: Vec<u64>,
    snapshots: Vec<u64>,
    seeds: Vec<u64>,
    path: PathBuf,
}

impl Shard {
    /// Maps the shard and checks its structure (not its sha256: see [`Shard::verify`]).
    /// `expect_bytes` is the size that the manifest names, if there is one.
    ///
    /// # Errors
    /// What is wrong, as text that follows "shard 3 ".
    pub fn open(
        path: &Path,
        qpos_dim: usize,
        ctrl_dim: usize,
        expect_bytes: Option<u64>,
    ) -> Result<Self, String> {
        let meta = std::fs::metadata(path).map_err(|e| match e.kind() {
            std::io::ErrorKind::NotFound => "is missing".to_owned(),
            _ => format!("cannot be read ({e})"),
        })?;
        if !meta.is_file() {
            return Err("is not a file".to_owned());
        }
        if let Some(bytes) = expect_bytes.filter(|&b| b != meta.len()) {
            return Err(format!("has {} bytes instead of {bytes}", meta.len()));
        }
        if meta.len() > limits::SHARD_BYTES {
            return Err(format!("is larger than {} bytes", limits::SHARD_BYTES));
        }
        let data = mmap_guard::map_file(path).map_err(|e| format!("cannot be mapped ({e})"))?;
        Self::parse(data, qpos_dim, ctrl_dim, path)
    }

    fn parse(data: FileData, s: usize, a: usize, path: &Path) -> Result<Self, String> {
        let bytes: &[u8] = &data;
        let (header_len, meta) = SafeTensors::read_metadata(bytes)
            .map_err(|e| format!("is not a safetensors file ({e})"))?;
        let json = meta
            .metadata()
            .as_ref()
            .and_then(|m| m.get(KEY))
            .ok_or("has no \"robert\" entry in its header")?;
        let header: ShardHeader =
            serde_json::from_str(json).map_err(|e| format!("has a bad header ({e})"))?;
        if header.format != FORMAT {
            return Err(format!("is of format \"{}\", not \"{FORMAT}\"", header.format));
        }
        let body = 8 + header_len;
        let find = |name: &str, dtype: Dtype| {
            let t = meta.info(name).ok_or(format!("has no tensor \"{name}\""))?;
            if t.dtype != dtype {
                return Err(format!("has \"{name}\" as {:?} instead of {dtype:?}", t.dtype));
            }
            Ok((t.shape.clone(), body + t.data_offsets.0..body + t.data_offsets.1))
        };
        let (shape, contact) = find("self_contact", Dtype::U8)?;
        let &[frames] = shape.as_slice() else {
            return Err(format!("has \"self_contact\" of shape {shape:?}"));
        };
        let matrix = |name: &str, cols: usize| {
            let (shape, range) = find(name, Dtype::F32)?;
            if shape != [frames, cols] {
                return Err(format!(
                    "has \"{name}\" of shape {shape:?} instead of [{frames}, {cols}]"
                ));
            }
            if range.start % size_of::<f32>() != 0 {
                return Err(format!("has \"{name}\" at byte {}, not a multiple of 4", range.start));
            }
            Ok(range)
        };
        let (qpos, qvel, ctrl) = (matrix("qpos", s)?, matrix("qvel", s)?, matrix("ctrl", a)?);
        let episodes = header.agents.len();
        let vector = |name: &str, len: usize| {
            let (shape, range) = find(name, Dtype::I64)?;
            if shape != [len] {
                return Err(format!("has \"{name}\" of shape {shape:?} instead of [{len}]"));
            }
            checked(bytes, range)
                .chunks_exact(8)
                .map(|c| {
                    let value = c.try_into().map_or(-1, i64::from_le_bytes);
                    u64::try_from(value).map_err(|e| format!("has a bad entry in \"{name}\" ({e})"))
                })
                .collect::<Result<Vec<u64>, String>>()
        };
        let offsets = vector("episode_offsets", episodes + 1)?;
        let ordered = offsets.windows(2).all(|w| matches!(w, [lo, hi] if lo < hi));
        if offsets.first() != Some(&0) || offsets.last() != Some(&(frames as u64)) || !ordered {
            return Err("has episode_offsets that do not cover its frames".to_owned());
        }
        let (snapshots, seeds) =
            (vector("episode_snapshot", episodes)?, vector("episode_seed", episodes)?);
        let shard = Shard {
            frames,
            qpos_dim: s,
            ctrl_dim: a,
            qpos,
            qvel,
            ctrl,
            contact,
            offsets,
            snapshots,
            seeds,
            header,
            path: path.to_owned(),
            data,
        };
        // Our writer aligns the body to 8 bytes. A foreign writer may not, and then no slice of f32
        // can be returned.
        if shard.qpos().is_empty() || shard.ctrl().is_empty() || shard.qvel().is_empty() {
            return Err("has tensors that are empty or not aligned to 4 bytes".to_owned());
        }
        Ok(shard)
    }

    /// Checks sha256 and every value: finite, actions in [-1, 1].
    ///
    /// # Errors
    /// What is wrong, as text.
    pub fn verify(&self, sha256: &str) -> Result<(), String> {
        if fsio::sha256_hex(&self.data) != sha256 {
            return Err("differs from its sha256: it was altered or damaged".to_owned());
        }
        match bad_value(self.qpos(), self.qvel(), self.ctrl()) {
            Some(what) => Err(format!("is invalid: {what}")),
            None => Ok(()),
        }
    }

    /// The shard's header.
    pub fn header(&self) -> &ShardHeader {
        &self.header
    }

    /// Number of frames N.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// (N, S) positions.
    pub fn qpos(&self) -> &[f32] {
        self.floats(&self.qpos)
    }

    /// (N, S) velocities.
    pub fn qvel(&self) -> &[f32] {
        self.floats(&self.qvel)
    }

    /// (N, A) actions in [-1, 1].
    pub fn ctrl(&self) -> &[f32] {
        self.floats(&self.ctrl)
    }

    /// (N) flags of self-contact.
    pub fn self_contact(&self) -> &[u8] {
        checked(&self.data, self.contact.clone())
    }

    /// Frames `start .. start + count` of `qpos`, (count, S).
    pub fn qpos_rows(&self, start: usize, count: usize) -> &[f32] {
        rows(self.qpos(), self.qpos_dim, start, count)
    }

    /// Frames `start .. start + count` of `qvel`, (count, S).
    pub fn qvel_rows(&self, start: usize, count: usize) -> &[f32] {
        rows(self.qvel(), self.qpos_dim, start, count)
    }

    /// Frames `start .. start + count` of `ctrl`, (count, A).
    pub fn ctrl_rows(&self, start: usize, count: usize) -> &[f32] {
        rows(self.ctrl(), self.ctrl_dim, start, count)
    }

    /// (start, length, origin) of each trajectory.
    pub fn episodes(&self) -> impl Iterator<Item = (u64, u64, EpisodeMeta)> + '_ {
        let spans = self.offsets.windows(2).filter_map(|w| match w {
            [lo, hi] => Some((*lo, hi - lo)),
            _ => None,
        });
        spans.zip(&self.header.agents).zip(self.snapshots.iter().zip(&self.seeds)).map(
            |(((start, length), agent), (&snapshot_step, &seed))| {
                (start, length, EpisodeMeta { agent: agent.clone(), snapshot_step, seed })
            },
        )
    }

    /// Whether a trajectory of a manifest is a complete trajectory of this shard with the same
    /// origin.
    pub(super) fn holds(&self, e: &Episode) -> bool {
        let Ok(at) = self.offsets.binary_search(&e.start) else { return false };
        let end = self.offsets.get(at + 1);
        end.is_some_and(|end| end - e.start == e.length)
            && self.header.agents.get(at) == Some(&e.agent)
            && self.snapshots.get(at) == Some(&e.snapshot_step)
            && self.seeds.get(at) == Some(&e.seed)
    }

    fn floats(&self, range: &Range<usize>) -> &[f32] {
        bytemuck::cast_slice(checked(&self.data, range.clone()))
    }
}

fn rows(matrix: &[f32], cols: usize, start: usize, count: usize) -> &[f32] {
    checked(matrix, start * cols..(start + count) * cols)
}

/// Takes a range that was checked when the file was opened. If it is out of bounds, that is a
/// mistake of this program, so it panics.
#[allow(clippy::indexing_slicing)]
pub(super) fn checked<T>(all: &[T], range: Range<usize>) -> &[T] {
    &all[range]
}

// Files are little-endian; slices of them are returned as f32.
const _: () = assert!(cfg!(target_endian = "little"));

#[cfg(test)]
pub(super) mod tests {
    use super::super::manifest::tests::robot;
    use super::*;

    /// A trajectory of `n` frames whose values encode their place.
    pub(crate) fn push(b: &mut ShardBuilder, agent: &str, seed: u64, n: usize) {
        let qpos: Vec<f32> = (0..n * 2).map(|i| seed as f32 + i as f32 * 1e-3).collect();
        let ctrl: Vec<f32> = (0..n).map(|i| (i as f32 * 0.1 + seed as f32).sin()).collect();
        let meta = EpisodeMeta { agent: agent.to_owned(), snapshot_step: 5, seed };
        b.push(&meta, &qpos, &qpos, &ctrl, &vec![0; n]).unwrap();
    }

    #[test]
    fn a_shard_that_is_too_large_is_not_mapped() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let open = |bytes: u64| {
            file.as_file().set_len(bytes).unwrap(); // sparse
            Shard::open(file.path(), 2, 1, Some(bytes)).unwrap_err()
        };
        assert!(open(limits::SHARD_BYTES + 1).contains("is larger than 8589934592 bytes"));
        assert!(!open(limits::SHARD_BYTES).contains("is larger"), "it is read, and is no shard");
    }

    #[test]
    fn same_trajectories_same_bytes() {
        let make = || {
            let mut b = ShardBuilder::new(&robot(), "spec", 7);
            push(&mut b, "rnd", 1, 60);
            push(&mut b, "icm", 2, 55);
            b.drop_broken();
            b.bytes().unwrap()
        };
        assert_eq!(make(), make());
    }

    #[test]
    fn reads_back_what_was_written() {
        let dir = tempfile::tempdir().unwrap();
        let mut b = ShardBuilder::new(&robot(), "spec", 7);
        push(&mut b, "rnd", 1, 60);
        push(&mut b, "icm", 2, 55);
        let entry = b.write(dir.path(), Path::new("a.safetensors")).unwrap();
        let path = dir.path().join("a.safetensors");
        let shard = Shard::open(&path, 2, 1, Some(entry.bytes)).unwrap();
        shard.verify(&entry.sha256).unwrap();
        assert_eq!(shard.frames(), 115);
        assert_eq!(shard.qpos(), b.qpos);
        assert_eq!(shard.ctrl_rows(60, 55), &b.ctrl[60..]);
        let e: Vec<_> = shard.episodes().collect();
        assert_eq!((e[1].0, e[1].1, e[1].2.agent.as_str(), e[1].2.seed), (60, 55, "icm", 2));
        assert!(Shard::open(&path, 3, 1, None).unwrap_err().contains("shape"));
    }

    #[test]
    fn every_truncation_and_flip_is_found() {
        let dir = tempfile::tempdir().unwrap();
        let mut b = ShardBuilder::new(&robot(), "spec", 0);
        push(&mut b, "rnd", 1, 51);
        let entry = b.write(dir.path(), Path::new("a")).unwrap();
        let good = std::fs::read(dir.path().join("a")).unwrap();
        let path = dir.path().join("b");
        let bad = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            Shard::open(&path, 2, 1, None).and_then(|s| s.verify(&entry.sha256)).is_err()
        };
        assert!(!bad(&good));
        for cut in 0..good.len() {
            assert!(bad(&good[..cut]), "cut at {cut}");
        }
        for at in 0..good.len() {
            let mut flipped = good.clone();
            flipped[at] ^= 1 << (at % 8);
            assert!(bad(&flipped), "flip at {at}");
        }
    }

    #[test]
    fn bad_values_never_enter() {
        let mut b = ShardBuilder::new(&robot(), "spec", 0);
        let meta = EpisodeMeta { agent: "x".to_owned(), snapshot_step: 0, seed: 0 };
        assert!(b.push(&meta, &[0.0, f32::NAN], &[0.0; 2], &[0.0], &[0]).is_err());
        assert!(b.push(&meta, &[0.0; 2], &[0.0; 2], &[1.5], &[0]).is_err());
        assert!(b.push(&meta, &[0.0; 3], &[0.0; 2], &[0.0], &[0]).is_err());
        assert_eq!(b.frames(), 0);
    }
}
