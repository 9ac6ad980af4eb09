//! The request of a collection, its validation, and the file that stores it.

use robert_base::json;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::agent::AgentKind;
use super::babble::BabbleRule;
use super::error::Error;
use super::preset::Preset;
use robert_base::fsio;
use robert_base::limits;
use robert_dataset::SHORTEST;
use robert_robot::{PlantRange, Robot};

/// Frames of the largest shard, so that a kill costs at most half a minute.
pub(super) const SHARD_FRAMES: usize = 50_000;
/// The most bytes of a trajectory in the manifest.
const EPISODE_BYTES: u64 = 144;
/// The most snapshots of an agent; all of them are in memory during the roll-outs.
const SNAPSHOTS: u64 = 2000;

/// A request to collect data.
///
/// ```
/// use robert_dataset::{Dataset, Verify};
/// use robert_explore::{CollectConfig, collect};
/// use robert_base::progress::{Cancel, Silent};
/// use robert_robot::Robot;
///
/// let robot = std::sync::Arc::new(Robot::builtin("pointmass")?);
/// let config = CollectConfig { transitions: 500, ..CollectConfig::new(&robot) };
/// let folder = tempfile::tempdir()?;
/// collect(&robot, &config, folder.path(), false, 1, &Silent, &Cancel::default())?;
/// let data = Dataset::open(folder.path(), Verify::Structure)?;
/// assert!(data.manifest().totals.frames >= 500);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CollectConfig {
    /// The collectors; each contributes an equal part.
    pub agents: Vec<AgentKind>,
    /// Settings of the agents.
    pub preset: Preset,
    /// Total frames to record.
    pub transitions: u64,
    /// Seed of all random choices.
    pub seed: u64,
    /// Frames of a recorded episode.
    pub episode_frames: u64,
    /// Only snapshots up to this share of the training are rolled out: agents that drift to
    /// extremes (`UR5e`) are stopped early.
    pub snapshots_until: f64,
    /// The range of the plants of recorded episodes; `None` for the robot's own. Agents are trained
    /// on the robot's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plants: Option<PlantRange>,
    /// The folder of another collection, whose trained agents are used if robot, preset and seed
    /// are the same. It changes only the time.
    #[serde(skip)]
    pub agents_from: Option<PathBuf>,
}

/// The collector that needs no training and no tuning for this robot: tested noise for a built-in
/// robot, babbling if motors act on joints, otherwise noise.
fn unlearned(robot: &Robot) -> AgentKind {
    let tried = Robot::builtin_ids().any(|id| id == robot.id());
    if !tried && BabbleRule::of(robot).is_ok() { AgentKind::Babble } else { AgentKind::Noise }
}

impl CollectConfig {
    /// Defaults for a robot: a collector without training; episodes of 250 frames; the first
    /// half of the snapshots for the UR5e, all of them otherwise.
    pub fn new(robot: &Robot) -> Self {
        let early = robot.id().starts_with("ur5e");
        CollectConfig {
            agents: vec![unlearned(robot)],
            preset: Preset::url_fast(),
            transitions: 400_000,
            seed: 0,
            episode_frames: 250,
            snapshots_until: if early { 0.5 } else { 1.0 },
            plants: None,
            agents_from: None,
        }
    }

    /// Refuses a request that cannot be fulfilled, before any work.
    ///
    /// # Errors
    /// [`Error::Argument`] with the value and its limits.
    pub fn check(&self) -> Result<(), Error> {
        let bad = |name, must: &str, got: String| {
            Err(Error::Argument { name, must: must.to_owned(), got })
        };
        if self.agents.is_empty() {
            return bad("agents", "one or more", "none".to_owned());
        }
        let mut sorted = self.agents.clone();
        sorted.sort_unstable();
        sorted.dedup();
        if sorted.len() != self.agents.len() {
            let names: Vec<&str> = self.agents.iter().map(|a| a.name()).collect();
            return bad("agents", "different from each other", names.join(", "));
        }
        if !(SHORTEST as u64..=100_000).contains(&self.episode_frames) {
            return bad("episode frames", "51 to 100000", self.episode_frames.to_string());
        }
        if !(self.snapshots_until > 0.0 && self.snapshots_until <= 1.0) {
            return bad("snapshots until", "above 0, at most 1", self.snapshots_until.to_string());
        }
        let learns = self.agents.iter().any(|a| a.learns());
        if learns && !(100..=1_000_000_000).contains(&self.preset.steps) {
            return bad("agent steps", "100 to 1000000000", self.preset.steps.to_string());
        }
        let snapshots = self.preset.steps.checked_div(self.preset.snapshot_every).unwrap_or(0);
        if learns && snapshots > SNAPSHOTS {
            let must = format!(
                "at least {} (for {SNAPSHOTS} snapshots at most)",
                self.preset.steps.div_ceil(SNAPSHOTS)
            );
            return bad("snapshot_every", &must, self.preset.snapshot_every.to_string());
        }
        let least = self.agents.iter().map(|&a| self.used_snapshots(a).len().max(1)).max();
        let least = (least.unwrap_or(1) * self.agents.len() * SHORTEST) as u64;
        if self.transitions < least {
            return bad(
                "transitions",
                &format!("{least} or more (one window for each agent and snapshot)"),
                self.transitions.to_string(),
            );
        }
        // A collection that could not be read back must not begin.
        let pinned = learns && self.preset.pinned_frames > 0;
        let shortest = if pinned { SHORTEST as u64 } else { self.episode_frames };
        let episodes = (limits::EPISODES as u64).min(limits::MANIFEST_BYTES / EPISODE_BYTES);
        let most = (episodes * shortest).min((limits::SHARDS / 2 * SHARD_FRAMES) as u64);
        if self.transitions > most || self.shards() > limits::SHARDS as u64 {
            return bad("transitions", &format!("{most} or less"), self.transitions.to_string());
        }
        Ok(())
    }

    /// Refuses agents of another training.
    pub(super) fn check_agents_from(&self, robot: &Robot) -> Result<(), Error> {
        let Some(from) =
            self.agents_from.as_ref().filter(|_| self.agents.iter().any(|a| a.learns()))
        else {
            return Ok(());
        };
        let found = read_request(&from.join("collect.json"))?;
        let wanted = json::value(Request::of(robot, self));
        let same = ["/robot", "/model_sha256", "/config/seed", "/config/preset"];
        let pick = |v: &serde_json::Value, at: &str| v.pointer(at).cloned().unwrap_or_default();
        let differs = same.iter().find_map(|at| {
            let name = at.rsplit('/').next().unwrap_or(at);
            difference(name, &pick(&wanted, at), &pick(&found, at))
        });
        let Some((what, want, have)) = differs else { return Ok(()) };
        let message = format!(
            "its agents were trained with {what} {have}, but the request is for {want}; train new ones without --agents-from"
        );
        Err(Error::Folder { message, path: from.clone() })
    }

    /// Shards of all agents.
    fn shards(&self) -> u64 {
        let agents = self.agents.len() as u64;
        let of = |(i, &kind): (u64, &AgentKind)| {
            let frames = share(self.transitions, agents, i);
            let n = self.used_snapshots(kind).len().max(1) as u64;
            (0..n).map(|j| pieces(share(frames, n, j))).sum::<u64>()
        };
        (0..).zip(&self.agents).map(of).sum()
    }

    /// Steps of the snapshots that are rolled out.
    pub(super) fn used_snapshots(&self, kind: AgentKind) -> Vec<u64> {
        if !kind.learns() {
            return Vec::new();
        }
        let until = self.snapshots_until * self.preset.steps as f64;
        let all = self.preset.snapshots();
        let mut used: Vec<u64> = all.iter().copied().filter(|&s| s as f64 <= until).collect();
        if used.is_empty() {
            used.extend(all.first());
        }
        used
    }
}

/// The content of `collect.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Request {
    format: String,
    robot: String,
    model_sha256: String,
    #[serde(flatten)]
    config: Flat,
}

/// `flatten` and `deny_unknown_fields` exclude each other on one level; a newtype separates them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Flat {
    config: CollectConfig,
}

impl Request {
    fn of(robot: &Robot, config: &CollectConfig) -> Self {
        Request {
            format: "robert-collect/1".to_owned(),
            robot: robot.id().to_owned(),
            model_sha256: robot.model_sha256().to_owned(),
            config: Flat { config: config.clone() },
        }
    }
}

fn read_request(path: &Path) -> Result<serde_json::Value, Error> {
    let bytes = fsio::read_capped(path, limits::CLIP_BYTES)?;
    serde_json::from_slice(&bytes)
        .map_err(|e| Error::Checkpoint { message: e.to_string(), path: path.to_owned() })
}

/// The stored request of a collection.
#[derive(Clone, Debug, PartialEq)]
pub struct Begun {
    /// Its robot.
    pub robot: String,
    /// Everything else.
    pub config: CollectConfig,
}

/// The request of the collection in a folder, complete or not; `None` if there is none.
///
/// # Errors
/// [`Error::File`], [`Error::Checkpoint`] for a request that cannot be read.
pub fn begun(out: &Path) -> Result<Option<Begun>, Error> {
    let path = out.join("collect.json");
    if !path.is_file() {
        return Ok(None);
    }
    let request: Request = serde_json::from_value(read_request(&path)?)
        .map_err(|e| Error::Checkpoint { message: e.to_string(), path })?;
    Ok(Some(Begun { robot: request.robot, config: request.config.config }))
}

/// Begins a collection in the folder, or checks that it is ours.
pub(super) fn claim(
    robot: &Robot,
    config: &CollectConfig,
    out: &Path,
    resume: bool,
) -> Result<(), Error> {
    let path = out.join("collect.json");
    let request = Request::of(robot, config);
    let folder = |message: String| Err(Error::Folder { message, path: out.to_owned() });
    if path.exists() {
        if !resume {
            return folder(
                "the folder already holds a collection; continue it with --resume, or choose another folder".to_owned(),
            );
        }
        let found = read_request(&path)?;
        let wanted = json::value(&request);
        return match difference("", &wanted, &found) {
            None => Ok(()),
            Some((what, want, have)) => folder(format!(
                "the folder was begun with {what} {have}, but the request is for {want}; use the same options, or another --out"
            )),
        };
    }
    let foreign = out.join("manifest.json").exists() || out.join("shards").exists();
    if foreign {
        return folder("the folder contains data that this command did not begin".to_owned());
    }
    let text = json::pretty(&request) + "\n";
    Ok(fsio::write_atomic(&path, text.as_bytes())?)
}

/// First place where two documents differ: its name and both values. A different robot is reported
/// before the settings that follow from it.
fn difference(
    at: &str,
    a: &serde_json::Value,
    b: &serde_json::Value,
) -> Option<(String, String, String)> {
    if let (Some(x), Some(y)) = (a.as_object(), b.as_object()) {
        let null = serde_json::Value::Null;
        let mut keys: Vec<&String> = x.keys().chain(y.keys()).collect();
        keys.sort_by_key(|k| (*k != "robot", *k));
        return keys.into_iter().find_map(|k| {
            let (x, y) = (x.get(k).unwrap_or(&null), y.get(k).unwrap_or(&null));
            difference(k, x, y)
        });
    }
    (a != b).then(|| (at.to_owned(), a.to_string(), b.to_string()))
}

/// Part `i` of `n` nearly equal parts of `total`.
pub fn share(total: u64, n: u64, i: u64) -> u64 {
    let upto = |i: u64| (u128::from(total) * u128::from(i) / u128::from(n)) as u64;
    upto(i + 1) - upto(i)
}

/// Number of shards for this many frames of one snapshot.
pub(super) fn pieces(frames: u64) -> u64 {
    frames.div_ceil(SHARD_FRAMES as u64).max(1)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Two small learners and noise, trained in a second.
    pub(crate) fn config(robot: &Robot) -> CollectConfig {
        let preset = Preset { hidden: 16, batch: 32, envs: 6, ..Preset::url_fast() };
        CollectConfig {
            agents: vec![AgentKind::Rnd, AgentKind::Aps, AgentKind::Noise],
            preset: preset.lasting(1000),
            transitions: 3000,
            seed: 3,
            ..CollectConfig::new(robot)
        }
    }

    #[test]
    fn impossible_requests_are_named() {
        let robot = Robot::builtin("pointmass").unwrap();
        let bad = |change: &dyn Fn(&mut CollectConfig)| {
            let mut c = config(&robot);
            change(&mut c);
            c.check().unwrap_err().to_string()
        };
        assert!(bad(&|c| c.transitions = 100).contains("306 or more"));
        assert!(bad(&|c| c.agents = vec![]).contains("one or more"));
        let twice = bad(&|c| c.agents = vec![AgentKind::Rnd; 2]);
        assert!(twice.contains("got rnd, rnd"), "{twice}");
        assert!(bad(&|c| c.transitions = u64::MAX).contains("transitions must be"));
        assert!(
            bad(&|c| (c.preset.steps, c.preset.snapshot_every) = (1_000_000_000, 1))
                .contains("snapshot_every")
        );
        assert!(bad(&|c| c.episode_frames = 50).contains("51"));
        assert!(bad(&|c| c.snapshots_until = 0.0).contains("above 0"));
    }

    #[test]
    fn the_largest_request_can_be_read_back() {
        let robot = Robot::builtin("pointmass").unwrap();
        let mut c = config(&robot);
        for (episode_frames, pinned_frames) in [(250, 0), (51, 0), (250, 20), (100_000, 0)] {
            (c.episode_frames, c.preset.pinned_frames) = (episode_frames, pinned_frames);
            c.transitions = u64::MAX;
            let e = c.check().unwrap_err().to_string();
            let most = e.split(' ').find_map(|word| word.parse::<u64>().ok()).unwrap();
            c.transitions = most + 1;
            assert!(c.check().is_err());
            c.transitions = most;
            c.check().unwrap();
            let shortest = if pinned_frames > 0 { 51 } else { episode_frames };
            assert!(most / shortest <= limits::EPISODES as u64);
            assert!(most / shortest * EPISODE_BYTES <= limits::MANIFEST_BYTES);
            assert!(c.shards() <= limits::SHARDS as u64);
        }
        let parts: u64 = (0..7).map(|i| share(u64::MAX, 7, i)).sum();
        assert_eq!(parts, u64::MAX);
    }
}
