//! `manifest.json`: the robot, the shards and the trajectories of a dataset.
//!
//! It has one line per shard and per trajectory, so that a diff of two manifests shows the changes.
//! Unknown fields are refused, so that nothing is ignored silently.

#![warn(clippy::indexing_slicing)]

use robert_base::json;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::error::Error;
use super::robot::Robot;
use super::statistics::Statistics;
use robert_base::fsio;
use robert_base::limits;
use robert_base::units::{FPS, SIM_DT, SUBSTEPS};

/// Format name of this version.
pub const FORMAT: &str = "robert-dataset/1";
/// File name inside a dataset folder.
const FILE: &str = "manifest.json";

/// The clock of the simulation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Physics {
    /// Simulator step, seconds.
    pub sim_dt_secs: f64,
    /// Simulator steps in a frame, control held.
    pub substeps: usize,
}

impl Default for Physics {
    fn default() -> Self {
        Physics { sim_dt_secs: SIM_DT, substeps: SUBSTEPS }
    }
}

/// One shard file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShardEntry {
    /// Path relative to the manifest's folder.
    pub file: PathBuf,
    /// Sha-256 of the file.
    pub sha256: String,
    /// Size of the file.
    pub bytes: u64,
    /// Sha-256 of the collection spec; (spec, index) determines the shard.
    pub spec_sha256: String,
    /// Index within that spec.
    pub index: u64,
    /// Frames in it.
    pub frames: u64,
    /// Trajectories in it.
    pub episodes: u64,
    /// Trajectories dropped because the simulation diverged and reset itself. If a trajectory
    /// became implausible (NaN, far beyond a stop), the frames before that are kept.
    pub dropped_broken: u64,
    /// Trajectories dropped because fewer than 51 frames were left.
    pub dropped_short: u64,
}

/// The side of the train/test split.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Part {
    /// Learned from.
    Train,
    /// Held out.
    Test,
}

/// One trajectory: consecutive frames without a reset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Episode {
    /// Position in [`Manifest::shards`].
    pub shard: usize,
    /// First frame in the shard.
    pub start: u64,
    /// Frames.
    pub length: u64,
    /// The agent that acted.
    pub agent: String,
    /// Environment steps of that agent's training.
    pub snapshot_step: u64,
    /// Seed of this trajectory's random choices (below 2^53).
    pub seed: u64,
    /// Side of a fixed split; none until a split is made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part: Option<Part>,
}

/// Sums over all trajectories listed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Totals {
    /// Shards.
    pub shards: u64,
    /// Trajectories.
    pub episodes: u64,
    /// Frames (= transitions).
    pub frames: u64,
    /// Trajectories that were dropped because the simulation diverged.
    pub dropped_broken: u64,
    /// Trajectories that were dropped because they were too short for a window.
    pub dropped_short: u64,
}

/// An operation on the list of trajectories after collection.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "op", rename_all = "kebab-case", deny_unknown_fields)]
pub enum View {
    /// Part of each trajectory was fixed.
    Split {
        /// Seed of the split.
        seed: u64,
        /// Share held out.
        test_share: f64,
    },
    /// Only one part was kept.
    Only {
        /// The part.
        part: Part,
    },
    /// Only these agents' trajectories were kept, evenly thinned to a number of frames.
    Pick {
        /// The agents; empty for all.
        agents: Vec<String>,
        /// At most this many frames, if there is a limit.
        frames: Option<u64>,
    },
    /// Every k-th trajectory was kept.
    Shrink {
        /// k.
        k: u64,
    },
    /// A share of the train trajectories was replaced by copies.
    Corrupt {
        /// The share.
        share: f64,
        /// A fresh source for every slot instead of one for all.
        per_slot: bool,
        /// Seed of the choice.
        seed: u64,
    },
    /// Several datasets were joined.
    Merge {
        /// The number of inputs.
        inputs: u64,
        /// Whether every agent was reduced to the same number of frames.
        equal: bool,
        /// Earlier operations on the inputs, one list for each input with any; sorted.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        of: Vec<Vec<View>>,
    },
}

/// The whole manifest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// [`FORMAT`].
    pub format: String,
    /// The robot.
    pub robot: Robot,
    /// The clock.
    pub physics: Physics,
    /// Frames a second.
    pub fps: u32,
    /// How `ctrl` is stored: always `scaled`, the action in [-1, 1].
    pub ctrl: String,
    /// Collection specs by their sha256, as the collector wrote them.
    pub specs: BTreeMap<String, serde_json::Value>,
    /// The operations on the list of trajectories, in order.
    pub views: Vec<View>,
    /// Sums.
    pub totals: Totals,
    /// Hygiene and spread, computed from the frames listed.
    pub statistics: Statistics,
    /// Shard files.
    pub shards: Vec<ShardEntry>,
    /// Trajectories, in reading order.
    pub episodes: Vec<Episode>,
}

impl Manifest {
    /// An empty manifest for this robot.
    pub fn new(robot: Robot) -> Self {
        Manifest {
            format: FORMAT.to_owned(),
            robot,
            physics: Physics::default(),
            fps: FPS,
            ctrl: "scaled".to_owned(),
            specs: BTreeMap::new(),
            views: Vec::new(),
            totals: Totals::default(),
            statistics: Statistics::default(),
            shards: Vec::new(),
            episodes: Vec::new(),
        }
    }

    /// Path of the manifest of the dataset at `path` (a folder or the file itself).
    pub fn path_of(path: &Path) -> PathBuf {
        if path.is_dir() { path.join(FILE) } else { path.to_owned() }
    }

    /// Reads and checks a manifest; shards are not touched.
    ///
    /// # Errors
    /// [`Error::File`], [`Error::ManifestText`], [`Error::Manifest`].
    pub fn load(path: &Path) -> Result<Self, Error> {
        let path = Self::path_of(path);
        let bytes = fsio::read_capped(&path, limits::MANIFEST_BYTES)?;
        let manifest: Manifest =
            serde_json::from_slice(&bytes).map_err(|e| Error::ManifestText {
                message: strip_position(&e.to_string()),
                line: e.line(),
                column: e.column(),
                path: path.clone(),
            })?;
        manifest.check().map_err(|message| Error::Manifest { message, path })?;
        Ok(manifest)
    }

    /// Writes `dir/manifest.json` atomically.
    ///
    /// # Errors
    /// [`Error::File`].
    pub fn save(&self, dir: &Path) -> Result<(), Error> {
        Ok(fsio::write_atomic(&dir.join(FILE), self.text().as_bytes())?)
    }

    /// Recomputes [`Manifest::totals`] from the lists. Dropped counts are those of the shards that
    /// are still used.
    pub fn count(&mut self) {
        self.totals = self.counted();
    }

    /// The correct [`Manifest::totals`].
    pub(super) fn counted(&self) -> Totals {
        Totals {
            shards: self.shards.len() as u64,
            episodes: self.episodes.len() as u64,
            frames: self.episodes.iter().map(|e| e.length).sum(),
            dropped_broken: self.shards.iter().map(|s| s.dropped_broken).sum(),
            dropped_short: self.shards.iter().map(|s| s.dropped_short).sum(),
        }
    }

    /// State dimension S.
    pub fn qpos_dim(&self) -> usize {
        self.robot.joints.len()
    }

    /// Action dimension A.
    pub fn ctrl_dim(&self) -> usize {
        self.robot.actuators.len()
    }

    /// Sha-256 of the canonical text, which a model card records as its data.
    pub fn sha256(&self) -> String {
        fsio::sha256_hex(self.text().as_bytes())
    }

    fn text(&self) -> String {
        let head = Manifest { shards: Vec::new(), episodes: Vec::new(), ..self.clone() };
        let head = json::pretty(&head);
        head.replacen("\"shards\": []", &list("shards", &self.shards), 1).replacen(
            "\"episodes\": []",
            &list("episodes", &self.episodes),
            1,
        ) + "\n"
    }

    fn check(&self) -> Result<(), String> {
        if self.format != FORMAT {
            return Err(format!("format is \"{}\", this version reads \"{FORMAT}\"", self.format));
        }
        let (s, a) = (self.qpos_dim(), self.ctrl_dim());
        if s == 0 || s > limits::JOINTS || a == 0 || a > limits::JOINTS {
            return Err(format!(
                "{s} joints and {a} actuators; 1 to {} are allowed",
                limits::JOINTS
            ));
        }
        let r = &self.robot;
        if [r.units.len(), r.ranges.len(), r.near_limit.len()] != [s; 3] {
            return Err("robot.units, ranges and near_limit need one entry per joint".to_owned());
        }
        if self.robot.ctrlranges.len() != a {
            return Err("robot.ctrlranges needs one entry per actuator".to_owned());
        }
        self.check_numbers()?;
        if self.ctrl != "scaled" {
            return Err(format!("ctrl is \"{}\", only \"scaled\" is known", self.ctrl));
        }
        if self.fps != FPS || self.physics != Physics::default() {
            return Err(format!(
                "recorded at {} Hz with {} steps of {} s; only {FPS} Hz with {SUBSTEPS} steps of {SIM_DT} s is supported",
                self.fps, self.physics.substeps, self.physics.sim_dt_secs
            ));
        }
        if self.shards.len() > limits::SHARDS || self.episodes.len() > limits::EPISODES {
            return Err(format!(
                "{} shards and {} trajectories; at most {} and {} are read",
                self.shards.len(),
                self.episodes.len(),
                limits::SHARDS,
                limits::EPISODES
            ));
        }
        for (i, e) in self.episodes.iter().enumerate() {
            let Some(shard) = self.shards.get(e.shard) else {
                return Err(format!(
                    "episodes[{i}].shard is {}, but there are {} shards",
                    e.shard,
                    self.shards.len()
                ));
            };
            if e.length == 0 || e.start.checked_add(e.length).is_none_or(|end| end > shard.frames) {
                return Err(format!(
                    "episodes[{i}] covers frames {}+{} of a shard with {}",
                    e.start, e.length, shard.frames
                ));
            }
        }
        Ok(())
    }

    /// Checks that ranges are valid and that statistics have the right number of joints (or are
    /// empty).
    fn check_numbers(&self) -> Result<(), String> {
        let (r, t, most) = (&self.robot, &self.statistics, limits::CLIP_VALUE_MAX);
        let rises = |[lo, hi]: [f64; 2]| lo < hi && lo >= -most && hi <= most;
        if let Some(j) = r.ranges.iter().position(|x| !x.is_none_or(rises)) {
            return Err(format!("robot.ranges[{j}] must increase and be within -{most} to {most}"));
        }
        if let Some(j) = r.near_limit.iter().position(|x| !(0.0..=most).contains(x)) {
            return Err(format!("robot.near_limit[{j}] must be 0 to {most}"));
        }
        if let Some(k) = r.ctrlranges.iter().position(|[lo, hi]| lo > hi) {
            return Err(format!("robot.ctrlranges[{k}] must increase"));
        }
        let joints =
            [&t.near_limit, &t.qpos_mean, &t.qpos_std, &t.qpos_min, &t.qpos_max, &t.qvel_std];
        let joints = joints.iter().all(|v| v.len() == self.qpos_dim());
        if *t != Statistics::default() && !(joints && t.saturated.len() == self.ctrl_dim()) {
            return Err("statistics need one entry per joint and actuator".to_owned());
        }
        Ok(())
    }
}

/// `"name": [ with one compact element per line.
fn list<T: Serialize>(name: &str, items: &[T]) -> String {
    let lines: Vec<String> = items.iter().map(|i| format!("    {}", json::line(i))).collect();
    if lines.is_empty() {
        return format!("\"{name}\": []");
    }
    format!("\"{name}\": [\n{}\n  ]", lines.join(",\n"))
}

/// `serde_json` repeats the position at the end of its message; the error shows it first.
fn strip_position(message: &str) -> String {
    message.rsplit_once(" at line ").map_or(message, |(m, _)| m).to_owned()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use robert_base::units::Unit;

    /// A two-joint robot for tests.
    pub(crate) fn robot() -> Robot {
        Robot {
            id: "two".to_owned(),
            model_sha256: "0".repeat(64),
            joints: vec!["a".to_owned(), "b".to_owned()],
            units: vec![Unit::Rad; 2],
            ranges: vec![Some([-1.0, 1.0]), None],
            near_limit: vec![0.1; 2],
            actuators: vec!["u".to_owned()],
            ctrlranges: vec![[-3.0, 3.0]],
        }
    }

    #[test]
    fn text_round_trips_and_is_line_wise() {
        let mut m = Manifest::new(robot());
        m.shards.push(ShardEntry {
            file: "shards/a.safetensors".into(),
            sha256: "ab".to_owned(),
            bytes: 10,
            spec_sha256: "cd".to_owned(),
            index: 3,
            frames: 60,
            episodes: 1,
            dropped_broken: 2,
            dropped_short: 0,
        });
        m.episodes.push(Episode {
            shard: 0,
            start: 0,
            length: 60,
            agent: "noise".to_owned(),
            snapshot_step: 0,
            seed: (1 << 53) - 1,
            part: None,
        });
        m.count();
        let dir = tempfile::tempdir().unwrap();
        m.save(dir.path()).unwrap();
        assert_eq!(Manifest::load(dir.path()).unwrap(), m);
        let text = std::fs::read_to_string(dir.path().join(FILE)).unwrap();
        assert_eq!(text.lines().filter(|l| l.contains("snapshot_step")).count(), 1);
        assert!(text.ends_with("]\n}\n"), "{text}");
    }

    #[test]
    fn errors_name_the_place() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(FILE);
        std::fs::write(&path, "{\n  \"format\": 3\n}").unwrap();
        let e = Manifest::load(dir.path()).unwrap_err().to_string();
        assert!(e.contains("manifest.json:2:13"), "{e}");
        let mut m = Manifest::new(robot());
        m.fps = 50;
        m.save(dir.path()).unwrap();
        let e = Manifest::load(dir.path()).unwrap_err().to_string();
        assert!(e.contains("50 Hz"), "{e}");
        m.fps = 20;
        m.format = "robert-dataset/2".to_owned();
        m.save(dir.path()).unwrap();
        assert!(Manifest::load(dir.path()).is_err());
    }

    #[test]
    fn numbers_that_cannot_be_are_named() {
        let dir = tempfile::tempdir().unwrap();
        let bad = |change: &dyn Fn(&mut Manifest)| {
            let mut m = Manifest::new(robot());
            change(&mut m);
            m.save(dir.path()).unwrap();
            Manifest::load(dir.path()).map_or_else(|e| e.to_string(), |_| "fine".to_owned())
        };
        let most = limits::CLIP_VALUE_MAX;
        assert_eq!(bad(&|_| ()), "fine");
        assert_eq!(bad(&|m| m.robot.ranges[0] = Some([-most, most])), "fine");
        for range in [[5.0, -5.0], [1.0, 1.0], [0.0, 1e300], [-most * 1.01, 0.0]] {
            assert!(bad(&|m| m.robot.ranges[0] = Some(range)).contains("ranges[0]"), "{range:?}");
        }
        assert!(bad(&|m| m.robot.near_limit[1] = -0.1).contains("near_limit[1]"));
        assert!(bad(&|m| m.robot.ctrlranges[0] = [1.0, -1.0]).contains("ctrlranges[0]"));
        assert!(bad(&|m| m.statistics.qpos_mean = vec![0.0]).contains("statistics"));
        assert!(bad(&|m| m.statistics.coverage = 0.5).contains("statistics"));
    }
}
