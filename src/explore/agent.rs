//! Training of one exploring agent: environments, replay, intrinsic reward, DDPG, checkpoints.
//!
//! One iteration steps all environments once, then takes the updates that are due. Nothing depends
//! on the number of threads that step the environments. All episodes end at every snapshot, so a
//! checkpoint needs no simulator state, and a resumed run equals an uninterrupted one.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::action_noise::ActionNoise;
use super::aps::{self, Aps, SKILL, SKILL_STEPS};
use super::apt::Apt;
use super::batch::Batch;
use super::ddpg::Ddpg;
use super::describe::describe;
use super::env::{Env, Step};
use super::error::Error;
use super::icm::Icm;
use super::mlp::Tape;
use super::policy::{Snapshot, SnapshotHeader};
use super::preset::Preset;
use super::proto::Proto;
use super::replay::{Replay, Scale};
use super::rnd::Rnd;
use super::state::{Field, Keep};
use robert_base::rng::{Rng, Stream, draw};
use robert_dataset::{Coverage, Robot as Described};
use robert_robot::Robot;

/// Lengths of training episodes, frames.
const EPISODE_FRAMES: [u64; 2] = [200, 500];
/// An action of the policy whose magnitude is beyond this counts as saturated.
const SATURATED: f64 = 0.95;

/// The kind of a collector.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AgentKind {
    /// Random network distillation.
    Rnd,
    /// Intrinsic curiosity module.
    Icm,
    /// Active pre-training (particle entropy).
    Apt,
    /// Active pre-training with successor features.
    Aps,
    /// Prototypical representations.
    Proto,
    /// Smooth noise, no learning.
    Noise,
    /// Random references behind weak servos, no learning.
    Babble,
    /// Uniform random torque, no learning: the naive baseline.
    Uniform,
}

impl AgentKind {
    /// All kinds, in the order of lists.
    pub const ALL: [AgentKind; 8] = [
        AgentKind::Rnd,
        AgentKind::Icm,
        AgentKind::Apt,
        AgentKind::Aps,
        AgentKind::Proto,
        AgentKind::Noise,
        AgentKind::Babble,
        AgentKind::Uniform,
    ];

    /// Name on the command line and in manifests.
    pub fn name(self) -> &'static str {
        match self {
            AgentKind::Rnd => "rnd",
            AgentKind::Icm => "icm",
            AgentKind::Apt => "apt",
            AgentKind::Aps => "aps",
            AgentKind::Proto => "proto",
            AgentKind::Noise => "noise",
            AgentKind::Babble => "babble",
            AgentKind::Uniform => "uniform",
        }
    }

    /// Whether it learns before it collects.
    pub fn learns(self) -> bool {
        !matches!(self, AgentKind::Noise | AgentKind::Babble | AgentKind::Uniform)
    }
}

impl std::str::FromStr for AgentKind {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self, Error> {
        Self::ALL.into_iter().find(|k| k.name() == name).ok_or_else(|| Error::Argument {
            name: "agent",
            must: Self::ALL.map(AgentKind::name).join(", "),
            got: name.to_owned(),
        })
    }
}

/// The intrinsic reward of an agent.
#[derive(Clone, Debug)]
pub(super) enum Curiosity {
    Rnd(Rnd<f32>),
    Icm(Icm<f32>),
    Apt(Box<Apt<f32>>),
    Aps(Box<Aps<f32>>),
    Proto(Box<Proto<f32>>),
}

impl Curiosity {
    pub(super) fn new(
        kind: AgentKind,
        obs: usize,
        act: usize,
        h: usize,
        seed: u64,
    ) -> Option<Self> {
        Some(match kind {
            AgentKind::Rnd => Curiosity::Rnd(Rnd::new(obs, h, seed)),
            AgentKind::Icm => Curiosity::Icm(Icm::new(obs, act, h, seed)),
            AgentKind::Apt => Curiosity::Apt(Box::new(Apt::new(obs, act, h, seed))),
            AgentKind::Aps => Curiosity::Aps(Box::new(Aps::new(obs, h, seed))),
            AgentKind::Proto => Curiosity::Proto(Box::new(Proto::new(obs, seed))),
            AgentKind::Noise | AgentKind::Babble | AgentKind::Uniform => return None,
        })
    }

    /// Takes one training step of the curiosity module, and returns the reward of the same batch.
    pub(super) fn update(
        &mut self,
        b: &Batch<f32>,
        lr: f64,
        seed: u64,
        index: u64,
        out: &mut Vec<f32>,
    ) -> f64 {
        match self {
            Curiosity::Rnd(m) => {
                let loss = m.update(b, lr);
                m.reward(b, out);
                loss
            }
            Curiosity::Icm(m) => {
                let loss = m.update(b, lr);
                m.reward(b, out);
                loss
            }
            Curiosity::Apt(m) => {
                let loss = m.update(b, lr);
                m.reward(b, out);
                loss
            }
            Curiosity::Aps(m) => {
                let loss = m.update(b, lr);
                m.reward(b, out);
                loss
            }
            Curiosity::Proto(m) => {
                let loss = m.update(b, lr);
                m.reward(b, seed, index, out);
                loss
            }
        }
    }

    fn keep(&mut self, visit: &mut dyn FnMut(&str, Field<'_, f32>)) {
        match self {
            Curiosity::Rnd(m) => m.keep(visit),
            Curiosity::Icm(m) => m.keep(visit),
            Curiosity::Apt(m) => m.keep(visit),
            Curiosity::Aps(m) => m.keep(visit),
            Curiosity::Proto(m) => m.keep(visit),
        }
    }
}

/// Figures at one snapshot.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Environment steps so far.
    pub step: u64,
    /// Mean intrinsic reward of the updates since the last point.
    pub reward: f64,
    /// Mean loss of the curiosity module since the last point.
    pub loss: f64,
    /// Mean Q of the actor's own actions since the last point.
    pub value: f64,
    /// Mean |action| of the policy since the last point, without exploration noise.
    pub action: f64,
    /// Share of those actions whose magnitude is beyond .95, where tanh hardly lets a gradient
    /// through.
    pub saturated: f64,
    /// Share of coarse cells visited so far.
    pub coverage: f64,
    /// Share of frames since the last point with this joint near a stop, (S).
    pub near_limit: Vec<f64>,
    /// Share of frames since the last point in which the robot touched itself.
    pub self_contact: f64,
    /// Trajectories whose simulation diverged so far.
    pub broken: u64,
}

/// The sums behind a point of the curve.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sums {
    reward: f64,
    loss: f64,
    value: f64,
    updates: f64,
    action: f64,
    saturated: f64,
    actions: f64,
    frames: f64,
    contacts: f64,
    near_limit: Vec<f64>,
}

impl Point {
    /// Share of frames in which the worst joint stood at a stop.
    pub fn pinned(&self) -> f64 {
        worst(&self.near_limit)
    }
}

fn worst(shares: &[f64]) -> f64 {
    shares.iter().copied().fold(0.0, f64::max)
}

impl Sums {
    /// Counts a frame: positions (S) and whether the robot touches itself.
    pub(crate) fn add_frame(&mut self, robot: &Described, qpos: &[f32], contact: bool) {
        self.frames += 1.0;
        self.contacts += f64::from(u8::from(contact));
        self.near_limit.resize(qpos.len(), 0.0);
        for j in robot.near_limits(qpos) {
            self.near_limit[j] += 1.0;
        }
    }

    /// The means.
    pub(crate) fn point(&self, step: u64, coverage: f64, broken: u64) -> Point {
        let (updates, frames) = (self.updates.max(1.0), self.frames.max(1.0));
        Point {
            step,
            reward: self.reward / updates,
            loss: self.loss / updates,
            value: self.value / updates,
            action: self.action / self.actions.max(1.0),
            saturated: self.saturated / self.actions.max(1.0),
            coverage,
            near_limit: self.near_limit.iter().map(|n| n / frames).collect(),
            self_contact: self.contacts / frames,
            broken,
        }
    }
}

/// Counters and curve: the part of a checkpoint besides the numbers.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Ledger {
    pub(crate) step: u64,
    pub(crate) updates: u64,
    pub(crate) episodes: u64,
    pub(crate) broken: u64,
    /// Replay files written so far.
    pub(crate) chunks: u64,
    /// How many of the newest written episodes are in the replay memory.
    #[serde(default)]
    pub(crate) remembered: Option<usize>,
    /// Sha-256 of each snapshot's file, by its step.
    #[serde(default)]
    pub(crate) snapshots: BTreeMap<u64, String>,
    pub(crate) curve: Vec<Point>,
}

/// One environment in training.
#[derive(Debug)]
struct EnvSlot {
    env: Env,
    obs: Vec<f32>,
    action: Vec<f32>,
    skill: Vec<f32>,
    /// Exploration noise of the running episode.
    noise: ActionNoise,
    /// Handle in the replay memory; `None` before the first reset.
    episode: Option<usize>,
    age: u64,
    length: u64,
    result: Step,
}

/// An agent in training.
#[derive(Debug)]
pub(crate) struct Agent {
    pub(crate) kind: AgentKind,
    pub(crate) preset: Preset,
    pub(crate) ledger: Ledger,
    pub(crate) replay: Replay,
    /// Replay episodes that are on disk already.
    pub(crate) saved: usize,
    header: SnapshotHeader,
    seed: u64,
    ddpg: Ddpg<f32>,
    curiosity: Curiosity,
    scale: Scale,
    slots: Vec<EnvSlot>,
    pub(crate) coverage: Coverage,
    described: Described,
    /// Since the last point of the curve.
    sums: Sums,
    batch: Batch<f32>,
    reward: Vec<f32>,
    tape: Tape<f32>,
}

impl Agent {
    /// An untrained agent; `None` for kinds that do not learn.
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub(crate) fn new(
        robot: &Arc<Robot>,
        kind: AgentKind,
        preset: &Preset,
        seed: u64,
    ) -> Result<Option<Self>, Error> {
        let (s, a) = (robot.state_dim(), robot.action_dim());
        let skill = if kind == AgentKind::Aps { SKILL } else { 0 };
        // The five agents of one collection must not share random numbers.
        let seed = draw(seed, Stream::Init, kind as u64);
        let Some(curiosity) = Curiosity::new(kind, 2 * s, a, preset.hidden, seed) else {
            return Ok(None);
        };
        let described = describe(robot);
        let slot = || {
            Ok(EnvSlot {
                env: Env::new(robot)?,
                obs: vec![0.0; 2 * s],
                action: vec![0.0; a],
                skill: vec![0.0; skill],
                noise: ActionNoise::new(&preset.spread, a, Rng::new(seed, Stream::Noise, 0)),
                episode: None,
                age: 0,
                length: 0,
                result: Step::Ok,
            })
        };
        Ok(Some(Agent {
            kind,
            header: SnapshotHeader::new(robot, kind.name(), skill, preset.hidden),
            ledger: Ledger::default(),
            replay: Replay::new(2 * s, a, skill, preset.capacity),
            saved: 0,
            seed,
            ddpg: Ddpg::new(2 * s, a, skill, preset.hidden, seed),
            curiosity,
            scale: Scale::new(2 * s, preset.scale_obs),
            slots: (0..preset.envs.max(1)).map(|_| slot()).collect::<Result<_, Error>>()?,
            coverage: Coverage::new(&described),
            described,
            sums: Sums::default(),
            preset: preset.clone(),
            batch: Batch::default(),
            reward: Vec::new(),
            tape: Tape::default(),
        }))
    }

    /// Steps every environment once and takes the updates due; `threads` step environments.
    ///
    /// # Errors
    /// [`Error::Simulator`] when a reset fails.
    pub(crate) fn iterate(&mut self, threads: usize) -> Result<(), Error> {
        self.begin_episodes()?;
        self.choose_actions();
        step_all(&mut self.slots, threads);
        self.record();
        self.ledger.step += self.slots.len() as u64;
        let learning = self.ledger.step.saturating_sub(self.preset.seed_steps);
        let due = learning / self.preset.update_every.max(1);
        if self.replay.is_ready() && self.ledger.updates < due {
            self.scale.refresh();
            while self.ledger.updates < due {
                self.update();
            }
            self.replay.trim();
        }
        Ok(())
    }

    fn begin_episodes(&mut self) -> Result<(), Error> {
        for slot in &mut self.slots {
            if slot.episode.is_some() && slot.age < slot.length && slot.result == Step::Ok {
                continue;
            }
            let mut rng = Rng::new(self.seed, Stream::Reset, self.ledger.episodes);
            self.ledger.episodes += 1;
            let [lo, hi] = EPISODE_FRAMES;
            slot.length = lo + rng.below(hi - lo + 1);
            slot.age = 0;
            slot.result = Step::Ok;
            let noise = Rng::new(self.seed, Stream::Noise, self.ledger.episodes);
            slot.noise = ActionNoise::new(&self.preset.spread, self.header.act, noise);
            slot.env.reset(&mut rng)?;
            let (q, v) = slot.obs.split_at_mut(slot.env.state_dim());
            slot.env.observe(q, v);
            self.scale.add(&slot.obs);
            slot.episode = Some(self.replay.begin(&slot.obs));
        }
        Ok(())
    }

    fn choose_actions(&mut self) {
        let learned = self.ledger.updates > 0;
        let a = self.header.act;
        let mut x = Vec::new();
        for (index, slot) in (self.ledger.step..).zip(&mut self.slots) {
            if !slot.skill.is_empty() && slot.age % SKILL_STEPS == 0 {
                let w = aps::skill(&mut Rng::new(self.seed, Stream::Skill, index));
                slot.skill.iter_mut().zip(w).for_each(|(s, w)| *s = w as f32);
            }
            self.scale.apply(&slot.obs, &mut x);
            x.extend_from_slice(&slot.skill);
        }
        let rows = self.slots.len();
        let means = self.ddpg.actor.forward(&x, rows, &mut self.tape);
        for (slot, mean) in self.slots.iter_mut().zip(means.chunks_exact(a)) {
            if learned {
                slot.noise.act(mean, &mut slot.action);
                for m in mean.iter().map(|m| f64::from(m.abs())) {
                    self.sums.action += m;
                    self.sums.saturated += f64::from(u8::from(m > SATURATED));
                    self.sums.actions += 1.0;
                }
            } else {
                slot.noise.uniform(&mut slot.action);
            }
        }
    }

    fn record(&mut self) {
        for slot in &mut self.slots {
            let Some(episode) = slot.episode else { continue };
            match slot.result {
                Step::Ok => {
                    self.replay.push(episode, &slot.action, &slot.skill, &slot.obs);
                    self.scale.add(&slot.obs);
                    let (q, v) = slot.obs.split_at(slot.env.state_dim());
                    self.coverage.add(q, v);
                    self.sums.add_frame(&self.described, q, slot.env.self_contact());
                    let most = self.preset.pinned_frames;
                    if most > 0 && slot.env.pinned_frames() >= most {
                        slot.length = 0;
                    }
                }
                Step::Implausible => {}
                Step::Broken => {
                    self.replay.void(episode);
                    self.ledger.broken += 1;
                }
            }
            slot.age += 1;
        }
    }

    fn update(&mut self) {
        let (rows, index) = (self.preset.batch, self.ledger.updates);
        self.replay.sample(rows, self.seed, index, &self.scale, &mut self.batch);
        let lr = self.preset.lr;
        let loss = self.curiosity.update(&self.batch, lr, self.seed, index, &mut self.reward);
        // Episodes draw from the same stream at small indices.
        let noise = (1 << 48) + index;
        let (_, actor_loss) = self.ddpg.update(&self.batch, &self.reward, lr, self.seed, noise);
        self.ledger.updates += 1;
        let mean = self.reward.iter().map(|&r| f64::from(r)).sum::<f64>() / rows.max(1) as f64;
        self.sums.reward += mean;
        self.sums.loss += loss;
        self.sums.value -= actor_loss;
        self.sums.updates += 1.0;
    }

    /// Mean intrinsic reward since the last point.
    pub(crate) fn recent_reward(&self) -> f64 {
        self.sums.reward / self.sums.updates.max(1.0)
    }

    /// Share of frames since the last point in which the worst joint stood at a stop.
    pub(crate) fn recent_pinned(&self) -> f64 {
        worst(&self.sums.near_limit) / self.sums.frames.max(1.0)
    }

    /// Ends all episodes, adds a point to the curve and returns the actor as it is now.
    pub(crate) fn snapshot(&mut self, nominal: u64) -> Snapshot {
        for slot in &mut self.slots {
            slot.episode = None;
        }
        // A restored agent has the episodes of this moment, so an uninterrupted one must continue
        // with the same.
        self.replay.trim();
        self.ledger.remembered = Some(self.replay.remembered());
        // The values in use must be those that a restore computes from the running sums.
        self.restored();
        let point = self.sums.point(nominal, self.coverage.share(), self.ledger.broken);
        self.ledger.curve.push(point);
        self.sums = Sums::default();
        let (mean, inv) = self.scale.in_use();
        Snapshot {
            header: SnapshotHeader { step: nominal, ..self.header.clone() },
            actor: self.ddpg.actor.params.clone(),
            mean: mean.to_vec(),
            inv: inv.to_vec(),
        }
    }

    /// Visits all numbers of a checkpoint.
    pub(crate) fn keep(&mut self, visit: &mut dyn FnMut(&str, Field<'_, f32>)) {
        self.ddpg.keep(visit);
        self.curiosity.keep(visit);
        visit("scale", Field::Doubles(&mut self.scale.state));
    }

    /// Recomputes derived numbers after a restore.
    pub(crate) fn restored(&mut self) {
        if self.ledger.updates > 0 {
            self.scale.refresh();
        }
    }

    /// File of a snapshot within an agent's folder.
    pub(crate) fn snapshot_file(dir: &Path, step: u64) -> std::path::PathBuf {
        dir.join(format!("snapshot-{step:09}.safetensors"))
    }
}

/// Steps all slots. Slots are independent, so the result does not depend on the threads.
fn step_all(slots: &mut [EnvSlot], threads: usize) {
    let work = |slots: &mut [EnvSlot]| {
        for slot in slots {
            slot.result = slot.env.step(&slot.action);
            let (q, v) = slot.obs.split_at_mut(slot.env.state_dim());
            slot.env.observe(q, v);
        }
    };
    if threads < 2 || slots.len() < 2 {
        return work(slots);
    }
    let share = slots.len().div_ceil(threads);
    std::thread::scope(|scope| {
        let mut chunks = slots.chunks_mut(share);
        let mine = chunks.next();
        for chunk in chunks {
            scope.spawn(|| work(chunk));
        }
        if let Some(chunk) = mine {
            work(chunk);
        }
    });
}
