//! The whole procedure: train each agent on its own reward, keep snapshots, roll all of them
//! out, merge in equal parts.
//!
//! The replay memory is not the dataset: what is recorded is what the snapshots do, from
//! early clumsiness to late habits. Folder:
//!
//! ```text
//! OUT/collect.json                        what was asked for
//! OUT/agents/rnd/snapshot-*.safetensors   actors; curve.json: reward and coverage over steps
//! OUT/shards/rnd-00000.safetensors        trajectories
//! OUT/manifest.json                       written last: a folder with it is complete
//! ```
//!
//! Progress is judged by files: a finished shard has its entry beside it, and counts when
//! its sha256 is the entry's. A kill costs the shards and the snapshot interval in progress.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::agent::{Agent, AgentKind, Ledger, Point};
use super::babble::BabbleRule;
use super::checkpoint;
use super::crew::spread;
use super::error::Error;
use super::fill::{MIN_FRAMES, Plan, Wave, describe};
use super::noise::NoiseRule;
use super::policy::{Actor, Policy, Snapshot};
use super::preset::Preset;
use crate::dataset::{Dataset, Manifest, Shard, ShardEntry};
use crate::progress::{Cancel, Progress};
use crate::robot::{PlantRange, Robot};
use crate::{fsio, limits};

/// Frames of the largest shard: what a kill can cost stays within half a minute.
const SHARD_FRAMES: usize = 50_000;
/// Iterations between progress reports.
const REPORT_EVERY: u64 = 16;

/// What to collect.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CollectConfig {
    /// Who collects; each contributes an equal part.
    pub agents: Vec<AgentKind>,
    /// How agents are trained.
    pub preset: Preset,
    /// Frames to record in all.
    pub transitions: u64,
    /// Seed of everything.
    pub seed: u64,
    /// Frames of a recorded episode.
    pub episode_frames: u64,
    /// Only snapshots up to this share of the training are rolled out: agents that drift to
    /// extremes (`UR5e`) are stopped early.
    pub snapshots_until: f64,
    /// Each recorded episode draws its plant from here; the robot's own if none. Agents are
    /// trained on the robot's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plants: Option<PlantRange>,
}

/// The collector that needs no training and no tuning on this robot: the tried noise of a
/// built-in one, babbling where motors sit at joints, else noise.
fn unlearned(robot: &Robot) -> AgentKind {
    let tried = Robot::builtin_ids().any(|id| id == robot.id());
    if !tried && BabbleRule::of(robot).is_ok() { AgentKind::Babble } else { AgentKind::Noise }
}

impl CollectConfig {
    /// Defaults for a robot: a collector without training; episodes of 250 frames; the first half of the snapshots for the
    /// `UR5e`, all of them otherwise.
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
        }
    }

    fn check(&self) -> Result<(), Error> {
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
            return bad("agents", "named once each", format!("{:?}", self.agents));
        }
        if !(MIN_FRAMES as u64..=100_000).contains(&self.episode_frames) {
            return bad("episode frames", "51 to 100000", self.episode_frames.to_string());
        }
        if !(self.snapshots_until > 0.0 && self.snapshots_until <= 1.0) {
            return bad("snapshots until", "above 0, at most 1", self.snapshots_until.to_string());
        }
        let learns = self.agents.iter().any(|a| a.learns());
        if learns && !(100..=1_000_000_000).contains(&self.preset.steps) {
            return bad("agent steps", "100 or more", self.preset.steps.to_string());
        }
        let least = self.agents.iter().map(|&a| self.used_snapshots(a).len().max(1)).max();
        let least = (least.unwrap_or(1) * self.agents.len() * MIN_FRAMES) as u64;
        if self.transitions < least {
            return bad(
                "transitions",
                &format!("{least} or more (one window for each agent and snapshot)"),
                self.transitions.to_string(),
            );
        }
        Ok(())
    }

    /// Steps of the snapshots that are rolled out.
    fn used_snapshots(&self, kind: AgentKind) -> Vec<u64> {
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

/// How one agent did.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AgentSummary {
    /// Name.
    pub agent: AgentKind,
    /// Reward and coverage at each snapshot; empty for collectors that do not learn.
    pub curve: Vec<Point>,
    /// Environment steps of training.
    pub steps: u64,
    /// Updates taken.
    pub updates: u64,
    /// Trajectories broken in training.
    pub broken: u64,
}

/// What a collection came to.
#[derive(Clone, Debug, Serialize)]
pub struct Collected {
    /// The manifest written.
    #[serde(skip)]
    pub manifest: Manifest,
    /// Each agent's training.
    pub agents: Vec<AgentSummary>,
    /// Wall-clock time of training in this run, seconds.
    pub train_secs: f64,
    /// Wall-clock time of the roll-outs in this run, seconds.
    pub rollout_secs: f64,
    /// Frames recorded in this run, without those found finished.
    pub rollout_frames: u64,
}

/// What stands in `collect.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Request {
    format: String,
    robot: String,
    model_sha256: String,
    #[serde(flatten)]
    config: Flat,
}

/// `flatten` and `deny_unknown_fields` exclude each other on one level; a newtype parts them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Flat {
    config: CollectConfig,
}

/// Collects into the folder `out`, on `threads` threads; the bits do not depend on them.
/// With `resume`, goes on with what the folder holds.
///
/// # Errors
/// [`Error`]: bad configuration, a folder in use, an unstable robot, cancellation.
pub fn collect(
    robot: &Arc<Robot>,
    config: &CollectConfig,
    out: &Path,
    resume: bool,
    threads: usize,
    progress: &dyn Progress,
    cancel: &Cancel,
) -> Result<Collected, Error> {
    config.check()?;
    claim(robot, config, out, resume)?;
    let run = Run { robot, config, out, threads: threads.max(1), progress, cancel };
    let start = Instant::now();
    let agents = run.train_all()?;
    let train_secs = start.elapsed().as_secs_f64();
    let start = Instant::now();
    let (entries, specs, rollout_frames) = run.roll_out()?;
    let rollout_secs = start.elapsed().as_secs_f64();
    let manifest = run.publish(entries, specs)?;
    Ok(Collected { manifest, agents, train_secs, rollout_secs, rollout_frames })
}

/// Makes the folder ours, or finds that it is.
fn claim(robot: &Robot, config: &CollectConfig, out: &Path, resume: bool) -> Result<(), Error> {
    let path = out.join("collect.json");
    let request = Request {
        format: "robert-collect/1".to_owned(),
        robot: robot.id().to_owned(),
        model_sha256: robot.model_sha256().to_owned(),
        config: Flat { config: config.clone() },
    };
    let folder = |message: String| Err(Error::Folder { message, path: out.to_owned() });
    if path.exists() {
        if !resume {
            return folder(
                "the folder holds a collection; go on with --resume or name another".to_owned(),
            );
        }
        let bytes = fsio::read_capped(&path, limits::CLIP_BYTES)?;
        let found: serde_json::Value = serde_json::from_slice(&bytes)
            .map_err(|e| Error::Checkpoint { message: e.to_string(), path: path.clone() })?;
        let wanted = serde_json::to_value(&request).unwrap_or_default();
        return match difference("", &wanted, &found) {
            None => Ok(()),
            Some((what, want, have)) => folder(format!(
                "the folder was begun with {what} {have}, now {want} is asked for; use the same options"
            )),
        };
    }
    let foreign = out.join("manifest.json").exists() || out.join("shards").exists();
    if foreign {
        return folder("the folder holds data that this command did not begin".to_owned());
    }
    let text = serde_json::to_string_pretty(&request).unwrap_or_default() + "\n";
    Ok(fsio::write_atomic(&path, text.as_bytes())?)
}

/// First place where two documents differ: its name and both values.
fn difference(
    at: &str,
    a: &serde_json::Value,
    b: &serde_json::Value,
) -> Option<(String, String, String)> {
    if let (Some(x), Some(y)) = (a.as_object(), b.as_object()) {
        let null = serde_json::Value::Null;
        let keys: std::collections::BTreeSet<&String> = x.keys().chain(y.keys()).collect();
        return keys.into_iter().find_map(|k| {
            let (x, y) = (x.get(k).unwrap_or(&null), y.get(k).unwrap_or(&null));
            difference(k, x, y)
        });
    }
    (a != b).then(|| (at.to_owned(), a.to_string(), b.to_string()))
}

struct Run<'a> {
    robot: &'a Arc<Robot>,
    config: &'a CollectConfig,
    out: &'a Path,
    threads: usize,
    progress: &'a dyn Progress,
    cancel: &'a Cancel,
}

/// One shard to make.
struct Job {
    plan: Plan,
    policy: Arc<Policy>,
    /// Relative to the dataset's folder.
    file: PathBuf,
}

impl Run<'_> {
    fn agent_dir(&self, kind: AgentKind) -> PathBuf {
        self.out.join("agents").join(kind.name())
    }

    /// Trains all agents that learn, several at a time.
    fn train_all(&self) -> Result<Vec<AgentSummary>, Error> {
        let kinds = &self.config.agents;
        let learners = kinds.iter().filter(|k| k.learns()).count();
        let steps =
            kinds.iter().filter_map(|&k| self.config.used_snapshots(k).last().copied()).max();
        let steps = steps.unwrap_or(0);
        let total = learners as u64 * steps;
        let (next, active) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let stop = AtomicBool::new(false);
        let board: Mutex<BTreeMap<AgentKind, (u64, String)>> = Mutex::default();
        let start = Instant::now();
        let fresh = AtomicU64::new(0);
        let report = |kind: AgentKind, agent: &Agent, new: u64| {
            let fresh = fresh.fetch_add(new, Ordering::Relaxed) + new;
            let note = format!(
                "{} {:.0}k reward {:.3} cover {:.1}%{}",
                kind.name(),
                agent.ledger.step as f64 / 1e3,
                agent.recent_reward(),
                agent.coverage.share() * 100.0,
                broken_note(agent.ledger.broken),
            );
            let mut board = board.lock().unwrap_or_else(PoisonError::into_inner);
            board.insert(kind, (agent.ledger.step.min(steps), note));
            let done = board.values().map(|(n, _)| n).sum();
            let rate = fresh as f64 / start.elapsed().as_secs_f64().max(1e-3);
            let running = board.values().filter(|(n, _)| *n < steps);
            let notes: Vec<&str> = running.map(|(_, s)| s.as_str()).collect();
            self.progress.tick(done, total, &format!("{rate:.0}/s  {}", notes.join("  ")));
        };
        let work = || -> Result<Vec<(usize, AgentSummary)>, Error> {
            let mut mine = Vec::new();
            loop {
                let i = next.fetch_add(1, Ordering::Relaxed);
                let Some(&kind) = kinds.get(i) else { return Ok(mine) };
                active.fetch_add(1, Ordering::Relaxed);
                let spare = || {
                    let busy = active.load(Ordering::Relaxed).max(1);
                    if stop.load(Ordering::Relaxed) { 0 } else { (self.threads / busy).max(1) }
                };
                let result = self.train(kind, &spare, &report);
                active.fetch_sub(1, Ordering::Relaxed);
                match result {
                    Ok(summary) => mine.push((i, summary)),
                    Err(e) => {
                        stop.store(true, Ordering::Relaxed);
                        return Err(e);
                    }
                }
            }
        };
        let mut all = spread(self.threads.min(learners), work)?;
        all.sort_by_key(|(i, _)| *i);
        Ok(all.into_iter().map(|(_, s)| s).collect())
    }

    /// Trains one agent to the end of its preset, from its newest checkpoint. `threads` says
    /// how many threads may step environments now, 0 to stop.
    fn train(
        &self,
        kind: AgentKind,
        threads: &dyn Fn() -> usize,
        report: &dyn Fn(AgentKind, &Agent, u64),
    ) -> Result<AgentSummary, Error> {
        let preset = &self.config.preset;
        let empty = || AgentSummary { agent: kind, curve: vec![], steps: 0, updates: 0, broken: 0 };
        let dir = self.agent_dir(kind);
        if let Some(done) = finished(&dir)? {
            return Ok(AgentSummary::of(kind, &done));
        }
        let Some(mut agent) = Agent::new(self.robot, kind, preset, self.config.seed)? else {
            return Ok(empty());
        };
        checkpoint::load(&mut agent, &dir)?;
        report(kind, &agent, 0);
        // What comes after the last snapshot that is rolled out would be trained for nothing.
        for nominal in self.config.used_snapshots(kind) {
            let mut reported = agent.ledger.step;
            let mut since = 0;
            while agent.ledger.step < nominal {
                let threads = threads();
                if threads == 0 || self.cancel.is_cancelled() {
                    return Err(Error::Cancelled { path: self.out.to_owned() });
                }
                agent.iterate(threads)?;
                since += 1;
                if since % REPORT_EVERY == 0 {
                    report(kind, &agent, agent.ledger.step - reported);
                    reported = agent.ledger.step;
                }
            }
            if agent.ledger.curve.last().is_none_or(|p| p.step < nominal) {
                checkpoint::save(&mut agent, &dir, nominal)?;
                if let Some(p) = agent.ledger.curve.last() {
                    let point = serde_json::json!({"step": p.step, "agent": kind.name(), "reward": p.reward, "coverage": p.coverage});
                    self.progress.figures(&point);
                }
            }
            report(kind, &agent, agent.ledger.step.saturating_sub(reported));
        }
        let text = serde_json::to_string_pretty(&agent.ledger).unwrap_or_default() + "\n";
        fsio::write_atomic(&dir.join("curve.json"), text.as_bytes())?;
        checkpoint::clean(&dir, agent.ledger.chunks);
        Ok(AgentSummary::of(kind, &agent.ledger))
    }

    /// All shards, from finished ones and new ones; also the specs by their sha256 and the
    /// frames made in this run.
    fn roll_out(&self) -> Result<(Vec<ShardEntry>, Specs, u64), Error> {
        let (jobs, specs) = self.plan()?;
        let total: u64 = jobs.iter().map(|j| j.plan.frames as u64).sum();
        let (next, done, made) = (AtomicUsize::new(0), AtomicU64::new(0), AtomicU64::new(0));
        let start = Instant::now();
        let tick = |new: u64| {
            let made = made.fetch_add(new, Ordering::Relaxed) + new;
            let done = done.fetch_add(new, Ordering::Relaxed) + new;
            let rate = made as f64 / start.elapsed().as_secs_f64().max(1e-3);
            self.progress.tick(done, total, &format!("{rate:.0} frames/s"));
        };
        let stop = AtomicBool::new(false);
        let work = || -> Result<Vec<(usize, ShardEntry)>, Error> {
            let mut wave: Option<Wave> = None;
            let mut mine = Vec::new();
            loop {
                let i = next.fetch_add(1, Ordering::Relaxed);
                let Some(job) = jobs.get(i) else { return Ok(mine) };
                if stop.load(Ordering::Relaxed) {
                    return Err(Error::Cancelled { path: self.out.to_owned() });
                }
                if let Some(entry) = self.finished_shard(job) {
                    done.fetch_add(entry.frames, Ordering::Relaxed);
                    mine.push((i, entry));
                    continue;
                }
                let wave = match &mut wave {
                    Some(w) => w,
                    none => none.insert(Wave::new(self.robot, self.config.plants)?),
                };
                let target = (self.out, job.file.as_path());
                match wave.make(&job.plan, &job.policy, target, self.cancel, &tick) {
                    Ok(entry) => {
                        let text = serde_json::to_string(&entry).unwrap_or_default();
                        fsio::write_atomic(&self.entry_path(job), text.as_bytes())?;
                        mine.push((i, entry));
                    }
                    Err(e) => {
                        stop.store(true, Ordering::Relaxed);
                        return Err(e);
                    }
                }
            }
        };
        let mut all = spread(self.threads.min(jobs.len()), work)?;
        all.sort_by_key(|(i, _)| *i);
        Ok((all.into_iter().map(|(_, e)| e).collect(), specs, made.into_inner()))
    }

    fn entry_path(&self, job: &Job) -> PathBuf {
        self.out.join(&job.file).with_extension("json")
    }

    /// The entry of a shard that is on disk and whole.
    fn finished_shard(&self, job: &Job) -> Option<ShardEntry> {
        let bytes = fsio::read_capped(&self.entry_path(job), limits::CLIP_BYTES).ok()?;
        let entry: ShardEntry = serde_json::from_slice(&bytes).ok()?;
        let ours = entry.file == job.file
            && entry.index == job.plan.index
            && entry.spec_sha256 == job.plan.spec_sha256;
        let whole = || fsio::sha256_file(&self.out.join(&entry.file)).ok();
        (ours && whole().as_deref() == Some(entry.sha256.as_str())).then_some(entry)
    }

    /// Shards of all agents: equal frames for each agent, within it for each snapshot.
    fn plan(&self) -> Result<(Vec<Job>, Specs), Error> {
        let agents = &self.config.agents;
        let mut jobs = Vec::new();
        let mut specs = Specs::new();
        for (i, &kind) in agents.iter().enumerate() {
            let frames = share(self.config.transitions, agents.len() as u64, i as u64);
            let (policies, snapshots) = self.policies(kind)?;
            let mut spec = serde_json::json!({
                "format": "robert-collect/1",
                "robot": self.robot.id(),
                "model_sha256": self.robot.model_sha256(),
                "agent": kind.name(),
                "seed": self.config.seed,
                "transitions": frames,
                "episode_frames": self.config.episode_frames,
                "shard_frames": SHARD_FRAMES,
                "training": kind.learns().then_some(&self.config.preset),
                "snapshots": snapshots,
            });
            if let Some(plants) = self.config.plants {
                spec["plants"] = plants.to_string().into();
            }
            let spec_sha256 = fsio::sha256_hex(spec.to_string().as_bytes());
            let mut index = 0;
            for (j, (step, policy)) in policies.iter().enumerate() {
                let mine = share(frames, policies.len() as u64, j as u64) as usize;
                let pieces = mine.div_ceil(SHARD_FRAMES).max(1) as u64;
                for piece in 0..pieces {
                    jobs.push(Job {
                        file: PathBuf::from("shards")
                            .join(format!("{}-{index:05}.safetensors", kind.name())),
                        policy: Arc::clone(policy),
                        plan: Plan {
                            agent: kind.name().to_owned(),
                            snapshot_step: *step,
                            index,
                            frames: share(mine as u64, pieces, piece) as usize,
                            episode_frames: self.config.episode_frames as usize,
                            pinned_frames: if kind.learns() {
                                self.config.preset.pinned_frames
                            } else {
                                0
                            },
                            seed: self.config.seed,
                            spec_sha256: spec_sha256.clone(),
                        },
                    });
                    index += 1;
                }
            }
            specs.insert(spec_sha256, spec);
        }
        Ok((jobs, specs))
    }

    /// Who acts, by snapshot step, and what the spec says of them.
    fn policies(&self, kind: AgentKind) -> Result<(Policies, Vec<serde_json::Value>), Error> {
        let plain = |policy| (vec![(0, Arc::new(policy))], Vec::new());
        match kind {
            AgentKind::Noise => Ok(plain(Policy::Noise(NoiseRule::of(self.robot)))),
            AgentKind::Babble => Ok(plain(Policy::Babble(BabbleRule::of(self.robot)?))),
            AgentKind::Uniform => Ok(plain(Policy::Uniform)),
            _ => {
                let dir = self.agent_dir(kind);
                let (mut policies, mut listed) = (Vec::new(), Vec::new());
                for step in self.config.used_snapshots(kind) {
                    let path = Agent::snapshot_file(&dir, step);
                    let snapshot = Snapshot::load(&path)?;
                    let h = &snapshot.header;
                    if h.model_sha256 != self.robot.model_sha256() || h.agent != kind.name() {
                        let message = format!("is of {} on {}", h.agent, h.robot);
                        return Err(Error::Checkpoint { message, path });
                    }
                    let sha256 = fsio::sha256_file(&path)?;
                    listed.push(serde_json::json!({ "step": step, "sha256": sha256 }));
                    let actor = Box::new(Actor::new(&snapshot));
                    let policy = Policy::Actor(actor, self.config.preset.spread);
                    policies.push((step, Arc::new(policy)));
                }
                Ok((policies, listed))
            }
        }
    }

    fn publish(&self, entries: Vec<ShardEntry>, specs: Specs) -> Result<Manifest, Error> {
        let mut m = Manifest::new(describe(self.robot));
        m.specs = specs;
        for (at, entry) in entries.into_iter().enumerate() {
            let path = self.out.join(&entry.file);
            let shard = Shard::open(&path, m.qpos_dim(), m.ctrl_dim(), Some(entry.bytes))
                .map_err(|message| crate::dataset::Error::Shard { index: at, message, path })?;
            m.add(entry, &shard);
        }
        Ok(Dataset::publish(m, self.out)?)
    }
}

type Specs = BTreeMap<String, serde_json::Value>;
type Policies = Vec<(u64, Arc<Policy>)>;

impl AgentSummary {
    fn of(agent: AgentKind, ledger: &Ledger) -> Self {
        AgentSummary {
            agent,
            curve: ledger.curve.clone(),
            steps: ledger.step,
            updates: ledger.updates,
            broken: ledger.broken,
        }
    }
}

/// The ledger of an agent whose training is over.
fn finished(dir: &Path) -> Result<Option<Ledger>, Error> {
    let path = dir.join("curve.json");
    if !path.exists() {
        return Ok(None);
    }
    let bytes = fsio::read_capped(&path, limits::CLIP_BYTES)?;
    serde_json::from_slice(&bytes)
        .map(Some)
        .map_err(|e| Error::Checkpoint { message: e.to_string(), path })
}

/// Part `i` of `n` nearly equal parts of `total`.
fn share(total: u64, n: u64, i: u64) -> u64 {
    total * (i + 1) / n - total * i / n
}

fn broken_note(broken: u64) -> String {
    if broken == 0 { String::new() } else { format!(" broken {broken}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;

    fn config(robot: &Robot) -> CollectConfig {
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
    fn the_same_bits_on_any_threads() {
        let robot = Arc::new(Robot::builtin("pointmass").unwrap());
        let dir = tempfile::tempdir().unwrap();
        let run = |name: &str, threads| {
            let out = dir.path().join(name);
            let c = config(&robot);
            collect(&robot, &c, &out, false, threads, &Silent, &Cancel::default()).unwrap()
        };
        let (a, b) = (run("a", 1), run("b", 3));
        assert_eq!(a.manifest, b.manifest);
        assert_eq!(a.manifest.totals.frames, 3000);
        assert_eq!(a.manifest.statistics.agents["rnd"], 1000);
        assert!(!dir.path().join("a/agents/rnd/state.safetensors").exists());
        assert!(Dataset::check(&dir.path().join("a")).unwrap().is_empty());
    }

    #[test]
    fn a_folder_goes_on_only_with_what_it_began() {
        let robot = Arc::new(Robot::builtin("pointmass").unwrap());
        let dir = tempfile::tempdir().unwrap();
        let mut c = config(&robot);
        c.agents = vec![AgentKind::Noise];
        let go = |c: &CollectConfig, resume| {
            collect(&robot, c, dir.path(), resume, 2, &Silent, &Cancel::default())
        };
        let first = go(&c, false).unwrap();
        assert!(matches!(go(&c, false), Err(Error::Folder { .. })));
        // A damaged and a missing shard are made again, to the same bits.
        std::fs::write(dir.path().join("shards/noise-00000.safetensors"), b"junk").unwrap();
        assert_eq!(go(&c, true).unwrap().manifest, first.manifest);
        c.seed = 4;
        let e = go(&c, true).unwrap_err().to_string();
        assert!(e.contains("seed 3, now 4"), "{e}");
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
        assert!(bad(&|c| c.agents = vec![AgentKind::Rnd; 2]).contains("once"));
        assert!(bad(&|c| c.episode_frames = 50).contains("51"));
        assert!(bad(&|c| c.snapshots_until = 0.0).contains("above 0"));
    }
}
