//! The whole procedure: train each agent on its own reward, keep snapshots, roll them out, and
//! merge the results in equal parts.
//!
//! The replay memory is not the dataset. The dataset contains the motion of the snapshots, from
//! early to late ones. The folder:
//!
//! ```text
//! OUT/collect.json                        the request
//! OUT/agents/rnd/snapshot-*.safetensors   actors; curve.json: reward and coverage over steps
//! OUT/shards/rnd-00000.safetensors        trajectories
//! OUT/manifest.json                       written last: a folder with it is complete
//! ```
//!
//! Files show the progress: a finished shard has an entry beside it, and counts if its sha256 is
//! that of the entry. A kill costs only the shards and the snapshot interval in progress.

use robert_base::json;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use serde::Serialize;

use super::agent::{Agent, AgentKind, Ledger, Point};
use super::babble::BabbleRule;
use super::checkpoint;
use super::describe::describe;
use super::env_batch::{EnvBatch, Made, Plan};
use super::error::Error;
use super::noise::NoiseRule;
use super::parallel::for_each;
use super::policy::{Actor, ExplorePolicy, Snapshot};
use super::request::{CollectConfig, SHARD_FRAMES, claim, pieces, share};
use robert_base::fsio;
use robert_base::limits;
use robert_base::progress::{Cancel, Progress};
use robert_dataset::{Dataset, Manifest, Shard, ShardEntry};
use robert_robot::Robot;

/// Iterations between progress reports.
const REPORT_EVERY: u64 = 16;

/// The training of one agent.
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
    /// Trajectories that diverged in training.
    pub broken: u64,
}

/// The result of a collection.
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
    /// Frames recorded in this run, without shards that were already finished.
    pub rollout_frames: u64,
}

/// Collects into the folder `out`, on `threads` threads; the bits do not depend on them.
/// With `resume`, continues the collection in the folder.
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
    config.check_agents_from(robot)?;
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
    policy: Arc<ExplorePolicy>,
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
        if learners > 0 {
            self.progress.phase("train", "steps");
        }
        let (next, active) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let stop = AtomicBool::new(false);
        let board: Mutex<BTreeMap<AgentKind, (u64, String)>> = Mutex::default();
        let start = Instant::now();
        let fresh = AtomicU64::new(0);
        let report = |kind: AgentKind, agent: &Agent, new: u64| {
            let fresh = fresh.fetch_add(new, Ordering::Relaxed) + new;
            let note = format!(
                "{} {:.0}k reward {:.3} cover {:.1}% pinned {:.0}%{}",
                kind.name(),
                agent.ledger.step as f64 / 1e3,
                agent.recent_reward(),
                agent.coverage.share() * 100.0,
                agent.recent_pinned() * 100.0,
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
        let mut all = for_each(self.threads.min(learners), work)?;
        all.sort_by_key(|(i, _)| *i);
        Ok(all.into_iter().map(|(_, s)| s).collect())
    }

    /// Trains one agent to the end of its preset, from its newest checkpoint. `threads` returns how
    /// many threads may step environments now, 0 to stop.
    fn train(
        &self,
        kind: AgentKind,
        threads: &dyn Fn() -> usize,
        report: &dyn Fn(AgentKind, &Agent, u64),
    ) -> Result<AgentSummary, Error> {
        let preset = &self.config.preset;
        let empty = || AgentSummary { agent: kind, curve: vec![], steps: 0, updates: 0, broken: 0 };
        let dir = self.agent_dir(kind);
        let used = self.config.used_snapshots(kind);
        if let Some(done) = finished(&dir, &used) {
            return Ok(AgentSummary::of(kind, &done));
        }
        let Some(mut agent) = Agent::new(self.robot, kind, preset, self.config.seed)? else {
            return Ok(empty());
        };
        if let Some(done) = self.taken(kind, &used)? {
            return Ok(AgentSummary::of(kind, &done));
        }
        if dir.join("curve.json").exists() {
            let text = format!(
                "{}: files are damaged, so {} is trained again",
                dir.display(),
                kind.name()
            );
            self.progress.log(&text);
        }
        checkpoint::load(&mut agent, &dir).map_err(|e| checkpoint::curable(e, &dir))?;
        report(kind, &agent, 0);
        // Training after the last used snapshot would be useless.
        for nominal in used {
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
        let text = json::pretty(&agent.ledger) + "\n";
        fsio::write_atomic(&dir.join("curve.json"), text.as_bytes())?;
        checkpoint::clean(&dir, agent.ledger.chunks);
        Ok(AgentSummary::of(kind, &agent.ledger))
    }

    /// A copy of the agent of another collection, if it is the same and trained far enough.
    fn taken(&self, kind: AgentKind, used: &[u64]) -> Result<Option<Ledger>, Error> {
        let Some(from) = &self.config.agents_from else { return Ok(None) };
        let dir = from.join("agents").join(kind.name());
        let Some(ledger) = finished(&dir, used) else {
            let text = format!(
                "{}: not trained far enough, so {} is trained here",
                dir.display(),
                kind.name()
            );
            self.progress.log(&text);
            return Ok(None);
        };
        let to = self.agent_dir(kind);
        let files = used.iter().map(|&step| Agent::snapshot_file(Path::new(""), step));
        // The curve marks the agent as finished, so it is written last.
        for file in files.chain([PathBuf::from("curve.json")]) {
            let bytes = fsio::read_capped(&dir.join(&file), limits::TENSOR_HEADER_BYTES)?;
            fsio::write_atomic(&to.join(&file), &bytes)?;
        }
        Ok(Some(ledger))
    }

    /// All shards, finished and new; also the specs by their sha256 and the frames recorded in this
    /// run.
    fn roll_out(&self) -> Result<(Vec<ShardEntry>, Specs, u64), Error> {
        let (jobs, specs) = self.plan()?;
        let total: u64 = jobs.iter().map(|j| j.plan.frames as u64).sum();
        let (next, done, made) = (AtomicUsize::new(0), AtomicU64::new(0), AtomicU64::new(0));
        let start = Instant::now();
        self.progress.phase("roll out", "frames");
        let tally: Mutex<(Vec<u64>, u64)> = Mutex::new((vec![0; self.robot.state_dim()], 0));
        let tick = |new: &Made<'_>| {
            let made = made.fetch_add(new.frames, Ordering::Relaxed) + new.frames;
            let done = done.fetch_add(new.frames, Ordering::Relaxed) + new.frames;
            let rate = made as f64 / start.elapsed().as_secs_f64().max(1e-3);
            let mut tally = tally.lock().unwrap_or_else(PoisonError::into_inner);
            let (near, broken) = &mut *tally;
            near.iter_mut().zip(new.near_limit).for_each(|(n, more)| *n += more);
            *broken += u64::from(new.broken);
            let worst = near.iter().copied().max().unwrap_or(0) as f64 / made.max(1) as f64;
            let note = format!("{rate:.0}/s  pinned {:.0}%{}", worst * 100.0, broken_note(*broken));
            self.progress.tick(done, total, &note);
        };
        let stop = AtomicBool::new(false);
        let work = || -> Result<Vec<(usize, ShardEntry)>, Error> {
            let mut batch: Option<EnvBatch> = None;
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
                let batch = match &mut batch {
                    Some(w) => w,
                    none => none.insert(EnvBatch::new(self.robot, self.config.plants)?),
                };
                let target = (self.out, job.file.as_path());
                match batch.make(&job.plan, &job.policy, target, self.cancel, &tick) {
                    Ok(entry) => {
                        let text = json::line(&entry);
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
        let mut all = for_each(self.threads.min(jobs.len()), work)?;
        all.sort_by_key(|(i, _)| *i);
        Ok((all.into_iter().map(|(_, e)| e).collect(), specs, made.into_inner()))
    }

    fn entry_path(&self, job: &Job) -> PathBuf {
        self.out.join(&job.file).with_extension("json")
    }

    /// The entry of a shard that is on disk and intact.
    fn finished_shard(&self, job: &Job) -> Option<ShardEntry> {
        let bytes = fsio::read_capped(&self.entry_path(job), limits::CLIP_BYTES).ok()?;
        let entry: ShardEntry = serde_json::from_slice(&bytes).ok()?;
        let ours = entry.file == job.file
            && entry.index == job.plan.index
            && entry.spec_sha256 == job.plan.spec_sha256;
        let whole = || fsio::sha256_file(&self.out.join(&entry.file)).ok();
        (ours && whole().as_deref() == Some(entry.sha256.as_str())).then_some(entry)
    }

    /// Shards of all agents, with equal frames per agent and per snapshot.
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
                let pieces = pieces(mine as u64);
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

    /// The actors by snapshot step, and their descriptions in the spec.
    fn policies(&self, kind: AgentKind) -> Result<(Policies, Vec<serde_json::Value>), Error> {
        let plain = |policy| (vec![(0, Arc::new(policy))], Vec::new());
        match kind {
            AgentKind::Noise => Ok(plain(ExplorePolicy::Noise(NoiseRule::of(self.robot)))),
            AgentKind::Babble => Ok(plain(ExplorePolicy::Babble(BabbleRule::of(self.robot)?))),
            AgentKind::Uniform => Ok(plain(ExplorePolicy::Uniform)),
            _ => {
                let dir = self.agent_dir(kind);
                let (mut policies, mut listed) = (Vec::new(), Vec::new());
                for step in self.config.used_snapshots(kind) {
                    let path = Agent::snapshot_file(&dir, step);
                    let snapshot =
                        Snapshot::load(&path).map_err(|e| checkpoint::curable(e, &dir))?;
                    let h = &snapshot.header;
                    if h.model_sha256 != self.robot.model_sha256() || h.agent != kind.name() {
                        let message = format!("is of {} on {}", h.agent, h.robot);
                        return Err(checkpoint::curable(Error::Checkpoint { message, path }, &dir));
                    }
                    let sha256 = fsio::sha256_file(&path)?;
                    listed.push(serde_json::json!({ "step": step, "sha256": sha256 }));
                    let actor = Box::new(Actor::new(&snapshot));
                    let policy = ExplorePolicy::Actor(actor, self.config.preset.spread);
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
                .map_err(|message| robert_dataset::Error::Shard { index: at, message, path })?;
            m.add(entry, &shard);
        }
        Ok(Dataset::publish(m, self.out)?)
    }
}

type Specs = BTreeMap<String, serde_json::Value>;
type Policies = Vec<(u64, Arc<ExplorePolicy>)>;

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

/// The ledger of an agent whose training is complete; `None` if it is not, or if the ledger or a
/// needed snapshot was damaged.
fn finished(dir: &Path, used: &[u64]) -> Option<Ledger> {
    let bytes = fsio::read_capped(&dir.join("curve.json"), limits::CLIP_BYTES).ok()?;
    let ledger: Ledger = serde_json::from_slice(&bytes).ok()?;
    used.iter().all(|&step| checkpoint::is_whole(&ledger, dir, step)).then_some(ledger)
}

fn broken_note(broken: u64) -> String {
    if broken == 0 { String::new() } else { format!(" broken {broken}") }
}

#[cfg(test)]
mod tests {
    use super::super::request::tests::config;
    use super::*;
    use robert_base::progress::Silent;

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
        assert!(e.contains("seed 3, but the request is for 4"), "{e}");
        // The error names the other robot, not the settings that follow from it.
        let other = Arc::new(Robot::builtin("ur5e").unwrap());
        c.snapshots_until = 0.5;
        let e = collect(&other, &c, dir.path(), true, 1, &Silent, &Cancel::default()).unwrap_err();
        assert!(
            e.to_string().contains("robot \"pointmass\", but the request is for \"ur5e\""),
            "{e}"
        );
    }

    #[test]
    fn damaged_agents_are_trained_again() {
        let robot = Arc::new(Robot::builtin("pointmass").unwrap());
        let dir = tempfile::tempdir().unwrap();
        let c = CollectConfig { agents: vec![AgentKind::Rnd], ..config(&robot) };
        let go = |resume| collect(&robot, &c, dir.path(), resume, 2, &Silent, &Cancel::default());
        let first = go(false).unwrap();
        let agent = dir.path().join("agents/rnd");
        let snapshot = agent.join("snapshot-000000500.safetensors");
        let whole = std::fs::read(&snapshot).unwrap();
        let mut flipped = whole.clone();
        *flipped.last_mut().unwrap() ^= 1;
        for damage in [flipped.as_slice(), &whole[..whole.len() / 2]] {
            std::fs::write(&snapshot, damage).unwrap();
            assert_eq!(go(true).unwrap().manifest, first.manifest);
            assert!(std::fs::read(&snapshot).unwrap() == whole);
        }
        std::fs::remove_file(&snapshot).unwrap();
        assert_eq!(go(true).unwrap().agents, first.agents);
        std::fs::write(agent.join("curve.json"), "{").unwrap();
        let again = go(true).unwrap();
        assert_eq!((again.agents, again.manifest), (first.agents, first.manifest));
        assert_eq!(again.rollout_frames, 0);
    }

    #[test]
    fn agents_are_taken_from_where_they_are_the_same() {
        let robot = Arc::new(Robot::builtin("pointmass").unwrap());
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        let go = |c: &CollectConfig, name: &str| {
            collect(&robot, c, &at(name), false, 2, &Silent, &Cancel::default())
        };
        let small = CollectConfig { agents: vec![AgentKind::Rnd], ..config(&robot) };
        let first = go(&small, "first").unwrap();
        let large = CollectConfig { transitions: 6000, ..small.clone() };
        let alone = go(&large, "alone").unwrap();
        let taking = CollectConfig { agents_from: Some(at("first")), ..large };
        // A mark that no training writes, to recognise the copied files.
        let curve = at("first/agents/rnd/curve.json");
        let text =
            std::fs::read_to_string(&curve).unwrap().replace("\"broken\": 0", "\"broken\": 7");
        std::fs::write(&curve, text).unwrap();
        let taken = go(&taking, "taken").unwrap();
        assert_eq!(taken.manifest, alone.manifest);
        assert_eq!(taken.agents[0].broken, 7);
        assert_eq!(first.agents[0].broken, 0);
        // Only agents of the same kind are copied; missing ones are trained.
        let other = CollectConfig { seed: 4, ..taking.clone() };
        let e = go(&other, "other").unwrap_err().to_string();
        assert!(e.contains("seed 3, but the request is for 4") && e.contains("first"), "{e}");
        let preset = taking.preset.clone().lasting(700);
        let e = go(&CollectConfig { preset, ..taking.clone() }, "less").unwrap_err().to_string();
        assert!(e.contains("but the request is for"), "{e}");
        let more = CollectConfig { agents: vec![AgentKind::Icm, AgentKind::Rnd], ..taking };
        let both = go(&more, "both").unwrap();
        assert_eq!((both.agents[0].agent, both.agents[1].broken), (AgentKind::Icm, 7));
    }
}
