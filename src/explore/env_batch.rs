//! Roll-outs that are written to shards: the phase that records the data.
//!
//! A shard is a function of its plan: agent, snapshot, number of frames and seed. Episodes run in
//! batches, side by side in as many simulations, so that one product of the policy network serves
//! all of them. Each episode depends only on its own seed.

use std::path::Path;
use std::sync::Arc;

use super::describe::describe;
use super::env::{Env, Step};
use super::error::Error;
use super::policy::{ActorState, ExplorePolicy, Scratch};
use robert_base::progress::Cancel;
use robert_base::rng::{Rng, Stream, draw};
use robert_dataset::{EpisodeMeta, Robot as Described, SHORTEST, ShardBuilder, ShardEntry};
use robert_robot::{PlantRange, Robot};

/// Episodes side by side: enough rows for the policy's products, while the simulations' work spaces
/// still fit into the cache.
const ENVS: usize = 8;
/// Bits of the shard index in an episode's draw index.
const EPISODE_BITS: u32 = 24;

/// The plan of one shard.
#[derive(Clone, Debug)]
pub(crate) struct Plan {
    /// The actor.
    pub(crate) agent: String,
    /// Environment steps of its training.
    pub(crate) snapshot_step: u64,
    /// Index of the shard within its spec.
    pub(crate) index: u64,
    /// Requested frames; if episodes end early, up to a window more is stored.
    pub(crate) frames: usize,
    /// Frames of an episode.
    pub(crate) episode_frames: usize,
    /// An episode ends when a joint has stood at a stop for this many frames; 0 for never.
    pub(crate) pinned_frames: u64,
    /// Seed of the spec.
    pub(crate) seed: u64,
    /// Sha-256 of the spec.
    pub(crate) spec_sha256: String,
}

/// Simulations of one thread, reused from shard to shard.
#[derive(Debug)]
pub(crate) struct EnvBatch {
    robot: Arc<Robot>,
    described: Described,
    slots: Vec<EpisodeSlot>,
    scratch: Scratch,
}

#[derive(Debug)]
struct EpisodeSlot {
    env: Env,
    qpos: Vec<f32>,
    qvel: Vec<f32>,
    ctrl: Vec<f32>,
    contact: Vec<u8>,
}

/// The result of one trajectory, for progress reports.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Made<'a> {
    /// Frames recorded.
    pub(crate) frames: u64,
    /// Frames with each joint near a stop, (S); empty if nothing was recorded.
    pub(crate) near_limit: &'a [u64],
    /// Whether the simulation diverged.
    pub(crate) broken: bool,
}

/// The end of an episode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    Running,
    Whole,
    Cut,
    Broken,
}

impl EnvBatch {
    /// Simulations of this robot; with `plants`, of another plant in each episode.
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub(crate) fn new(robot: &Arc<Robot>, plants: Option<PlantRange>) -> Result<Self, Error> {
        let slot = || {
            let env = Env::varied(robot, plants)?;
            let (qpos, qvel, ctrl) = (Vec::new(), Vec::new(), Vec::new());
            Ok(EpisodeSlot { env, qpos, qvel, ctrl, contact: Vec::new() })
        };
        Ok(EnvBatch {
            robot: Arc::clone(robot),
            described: describe(robot),
            slots: (0..ENVS).map(|_| slot()).collect::<Result<_, Error>>()?,
            scratch: Scratch::default(),
        })
    }

    /// Makes the shard of this plan and writes it to `dir/file`. `tick` is called for each
    /// trajectory.
    ///
    /// # Errors
    /// [`Error::Unstable`] when most trajectories diverge, [`Error::TooShort`] when most end
    /// before a window's frames; [`Error::Cancelled`]; [`Error::Simulator`], [`Error::Dataset`].
    pub(crate) fn make(
        &mut self,
        plan: &Plan,
        policy: &ExplorePolicy,
        (dir, file): (&Path, &Path),
        cancel: &Cancel,
        tick: &dyn Fn(&Made<'_>),
    ) -> Result<ShardEntry, Error> {
        let mut shard = ShardBuilder::new(&self.described, &plan.spec_sha256, plan.index);
        let (mut tried, mut broken, mut short) = (0_u64, 0_u64, 0_u64);
        let most = 8 * plan.frames.div_ceil(SHORTEST) as u64 + 64;
        while shard.frames() < plan.frames {
            if cancel.is_cancelled() {
                return Err(Error::Cancelled { path: dir.to_owned() });
            }
            // Episodes that ended early may leave less than a window, but the requested frames are
            // always delivered.
            let mut left = (plan.frames - shard.frames()).max(SHORTEST);
            let mut lengths = Vec::with_capacity(ENVS);
            while lengths.len() < ENVS && left >= SHORTEST {
                let rest = left.saturating_sub(plan.episode_frames);
                // A remainder shorter than a window is added to the episode before it.
                let n = if rest < SHORTEST { left } else { plan.episode_frames };
                lengths.push(n);
                left -= n;
            }
            let seeds: Vec<u64> =
                (tried..tried + lengths.len() as u64).map(|e| episode_seed(plan, e)).collect();
            tried += lengths.len() as u64;
            let ends = self.run(policy, &seeds, &lengths, plan.pinned_frames)?;
            for ((slot, end), seed) in self.slots.iter().zip(ends).zip(seeds) {
                if end == End::Broken {
                    broken += 1;
                    shard.drop_broken();
                    tick(&Made { broken: true, ..Made::default() });
                } else if slot.contact.len() < SHORTEST {
                    short += 1;
                    shard.drop_short();
                } else {
                    let meta = EpisodeMeta {
                        agent: plan.agent.clone(),
                        snapshot_step: plan.snapshot_step,
                        seed,
                    };
                    shard.push(&meta, &slot.qpos, &slot.qvel, &slot.ctrl, &slot.contact)?;
                    let near_limit = near_limits(&self.described, &slot.qpos);
                    let frames = slot.contact.len() as u64;
                    tick(&Made { frames, near_limit: &near_limit, broken: false });
                }
            }
            let (robot, agent) = (self.robot.id().to_owned(), plan.agent.clone());
            if broken > 64 + 3 * (tried - broken) {
                return Err(Error::Unstable { robot, agent, broken, tried });
            }
            // Each of the others has at least a window, so most were useless.
            if tried > most {
                let pinned_frames = plan.pinned_frames;
                return Err(Error::TooShort { robot, agent, short, tried, pinned_frames });
            }
        }
        Ok(shard.write(dir, file)?)
    }

    /// Runs one episode per seed, side by side; frames are left in the slots.
    fn run(
        &mut self,
        policy: &ExplorePolicy,
        seeds: &[u64],
        lengths: &[usize],
        pinned_frames: u64,
    ) -> Result<Vec<End>, Error> {
        let (s, a, k) = (self.robot.state_dim(), self.robot.action_dim(), policy.skill());
        let n = seeds.len();
        let mut skills = vec![0.0; n * k];
        let mut actors: Vec<ActorState> = Vec::with_capacity(n);
        for (i, (&seed, slot)) in seeds.iter().zip(&mut self.slots).enumerate() {
            actors.push(policy.begin(seed, &mut skills[i * k..(i + 1) * k]));
            for v in [&mut slot.qpos, &mut slot.qvel, &mut slot.ctrl] {
                v.clear();
            }
            slot.contact.clear();
            slot.env.reset(&mut Rng::new(seed, Stream::Reset, 0))?;
        }
        let mut ends = vec![End::Running; n];
        let mut obs = vec![0.0; n * 2 * s];
        let mut action = vec![0.0; a];
        let mut gravity = policy.weight(&self.robot)?;
        while ends.contains(&End::Running) {
            for (slot, o) in self.slots.iter().zip(obs.chunks_exact_mut(2 * s)) {
                let (q, v) = o.split_at_mut(s);
                slot.env.observe(q, v);
            }
            let means = policy.think(&obs, &skills, n, &mut self.scratch);
            for (i, (slot, actor)) in self.slots.iter_mut().zip(&mut actors).enumerate() {
                if ends[i] != End::Running {
                    continue;
                }
                let o = &obs[i * 2 * s..(i + 1) * 2 * s];
                let weight = match &mut gravity {
                    Some(gravity) => slot.env.weight(gravity)?,
                    None => Vec::new(),
                };
                // Only a network has mean actions.
                let mean = means.get(i * a..(i + 1) * a).unwrap_or_default();
                actor.act(o, &weight, mean, &mut action);
                match slot.env.step(&action) {
                    Step::Ok => {
                        slot.qpos.extend_from_slice(&o[..s]);
                        slot.qvel.extend_from_slice(&o[s..]);
                        slot.ctrl.extend_from_slice(&action);
                        // At the end of the frame, from its last simulator step.
                        slot.contact.push(u8::from(slot.env.self_contact()));
                        if slot.contact.len() == lengths[i] {
                            ends[i] = End::Whole;
                        } else if pinned_frames > 0 && slot.env.pinned_frames() >= pinned_frames {
                            ends[i] = End::Cut;
                        }
                    }
                    Step::Implausible => ends[i] = End::Cut,
                    Step::Broken => ends[i] = End::Broken,
                }
            }
        }
        Ok(ends)
    }
}

/// Seed of an episode's random choices, below 2^53 so that every JSON reader keeps it exact.
fn episode_seed(plan: &Plan, episode: u64) -> u64 {
    let name = robert_base::fsio::sha256_hex(plan.agent.as_bytes());
    let code = u64::from_str_radix(name.get(..16).unwrap_or("0"), 16).unwrap_or(0);
    draw(plan.seed ^ code, Stream::Reset, (plan.index << EPISODE_BITS) + episode) >> 11
}

/// Frames of `qpos` (n, S) in which each joint is near a stop, (S).
fn near_limits(robot: &Described, qpos: &[f32]) -> Vec<u64> {
    let mut counts = vec![0; robot.joints.len()];
    for row in qpos.chunks_exact(counts.len().max(1)) {
        for j in robot.near_limits(row) {
            counts[j] += 1;
        }
    }
    counts
}

#[cfg(test)]
mod tests {
    use super::super::action_noise::NoiseBounds;
    use super::super::ddpg::Ddpg;
    use super::super::noise::NoiseRule;
    use super::super::policy::{Actor, Snapshot, SnapshotHeader};
    use super::*;
    use robert_dataset::Shard;

    fn plan(frames: usize) -> Plan {
        Plan {
            agent: "noise".to_owned(),
            snapshot_step: 0,
            index: 2,
            frames,
            episode_frames: 100,
            pinned_frames: 0,
            seed: 9,
            spec_sha256: "s".to_owned(),
        }
    }

    #[test]
    fn a_shard_is_the_same_alone_and_after_others() {
        let dir = tempfile::tempdir().unwrap();
        let robot = Arc::new(Robot::builtin("ur5e").unwrap());
        let policy = ExplorePolicy::Noise(NoiseRule::of(&robot));
        let never = Cancel::default();
        let make = |batch: &mut EnvBatch, plan: &Plan, name: &str| {
            batch.make(plan, &policy, (dir.path(), Path::new(name)), &never, &|_| ()).unwrap()
        };
        let mut batch = EnvBatch::new(&robot, None).unwrap();
        let first = make(&mut batch, &plan(1234), "a");
        make(&mut batch, &Plan { index: 3, ..plan(300) }, "b");
        let again = make(&mut batch, &plan(1234), "c");
        let alone = make(&mut EnvBatch::new(&robot, None).unwrap(), &plan(1234), "d");
        assert_eq!(first.sha256, again.sha256);
        assert_eq!(first.sha256, alone.sha256);
        assert_eq!(first.frames, 1234);
    }

    #[test]
    fn cut_episodes_end_neither_the_shard_nor_its_frames() {
        let dir = tempfile::tempdir().unwrap();
        let robot = Arc::new(Robot::builtin("ur5e_light").unwrap());
        let mut batch = EnvBatch::new(&robot, None).unwrap();
        let file = (dir.path(), Path::new("a"));
        let policy = ExplorePolicy::Noise(NoiseRule::of(&robot));
        let seen = std::cell::RefCell::new((0, vec![0; robot.state_dim()]));
        let tick = |made: &Made<'_>| {
            let (frames, near) = &mut *seen.borrow_mut();
            *frames += made.frames;
            near.iter_mut().zip(made.near_limit).for_each(|(n, m)| *n += m);
        };
        // Most episodes reach a stop long before 1000 frames, so many more are needed than complete
        // ones.
        let cut = Plan { episode_frames: 1000, pinned_frames: 5, ..plan(8000) };
        let made = batch.make(&cut, &policy, file, &Cancel::default(), &tick).unwrap();
        assert!((8000..8051).contains(&made.frames), "{made:?}");
        assert!(made.episodes > 16, "{made:?}");
        let (frames, near) = seen.into_inner();
        assert_eq!(frames, made.frames);
        let s = robot.state_dim();
        let shard = Shard::open(&dir.path().join("a"), s, robot.action_dim(), None).unwrap();
        assert_eq!(near, near_limits(&batch.described, shard.qpos()));
        assert!(near.iter().any(|&n| n > 0));
    }

    #[test]
    fn episodes_that_are_all_too_short_are_told_as_that() {
        let dir = tempfile::tempdir().unwrap();
        // Full torque on all joints of a hand: some joint is at its stop within a second.
        let robot = Arc::new(Robot::builtin("shadow_hand").unwrap());
        let (obs, act) = (2 * robot.state_dim(), robot.action_dim());
        let mut actor = Ddpg::<f32>::new(obs, act, 0, 4, 1).actor.params;
        let biases = actor.len() - act;
        actor[biases..].fill(100.0);
        let (mean, inv) = (vec![0.0; obs], vec![1.0; obs]);
        let header = SnapshotHeader::new(&robot, "rnd", 0, 4);
        let snapshot = Snapshot { header, actor, mean, inv };
        let policy = ExplorePolicy::Actor(Box::new(Actor::new(&snapshot)), NoiseBounds::WHITE);
        let mut batch = EnvBatch::new(&robot, None).unwrap();
        let file = (dir.path(), Path::new("a"));
        let short = Plan { pinned_frames: 1, ..plan(51) };
        let e = batch.make(&short, &policy, file, &Cancel::default(), &|_| ()).unwrap_err();
        assert!(matches!(e, Error::TooShort { short, tried, .. } if short == tried), "{e}");
        assert!(e.to_string().contains("raise pinned_frames"), "{e}");
        assert!(!dir.path().join("a").exists());
    }

    #[test]
    fn each_episode_has_a_plant_of_its_own() {
        let dir = tempfile::tempdir().unwrap();
        let robot = Arc::new(Robot::builtin("pointmass").unwrap());
        let never = Cancel::default();
        let speeds = |plants: Option<PlantRange>, name: &str| {
            let mut batch = EnvBatch::new(&robot, plants).unwrap();
            let file = (dir.path(), Path::new(name));
            let made =
                batch.make(&plan(800), &ExplorePolicy::Uniform, file, &never, &|_| ()).unwrap();
            let mut again = EnvBatch::new(&robot, plants).unwrap();
            let same =
                again.make(&plan(800), &ExplorePolicy::Uniform, file, &never, &|_| ()).unwrap();
            assert_eq!(made.sha256, same.sha256);
            let shard = Shard::open(&dir.path().join(name), 2, 2, None).unwrap();
            // The change of speed a unit of torque makes, from rest: gear over mass.
            let push = |&(start, _, _): &(u64, u64, _)| {
                let t = start as usize;
                let (u, v) = (shard.ctrl_rows(t, 1)[0], shard.qvel_rows(t + 1, 1)[0]);
                v / u
            };
            shard.episodes().map(|e| push(&e)).collect::<Vec<f32>>()
        };
        let one = speeds(None, "one");
        let many = speeds(Some("mass=.5..2,gear=.5..2".parse().unwrap()), "many");
        let spread = |v: &[f32]| {
            let (lo, hi) = v.iter().fold((f32::MAX, f32::MIN), |(a, b), x| (a.min(*x), b.max(*x)));
            hi / lo
        };
        assert!(spread(&one) < 1.01, "{one:?}");
        assert!(spread(&many) > 1.5, "{many:?}");
    }

    #[test]
    fn recorded_actions_lead_to_recorded_states() {
        let dir = tempfile::tempdir().unwrap();
        let robot = Arc::new(Robot::builtin("pointmass").unwrap());
        let mut batch = EnvBatch::new(&robot, None).unwrap();
        let file = (dir.path(), Path::new("a"));
        batch.make(&plan(200), &ExplorePolicy::Uniform, file, &Cancel::default(), &|_| ()).unwrap();
        let shard = Shard::open(&dir.path().join("a"), 2, 2, None).unwrap();
        let mut env = Env::new(&robot).unwrap();
        for (start, n, meta) in shard.episodes() {
            let (start, n) = (start as usize, n as usize);
            env.reset(&mut Rng::new(meta.seed, Stream::Reset, 0)).unwrap();
            let (mut q, mut v) = ([0.0; 2], [0.0; 2]);
            for t in start..start + n {
                env.observe(&mut q, &mut v);
                assert_eq!(shard.qpos_rows(t, 1), q);
                assert_eq!(shard.qvel_rows(t, 1), v);
                assert_eq!(env.step(shard.ctrl_rows(t, 1)), Step::Ok);
            }
        }
    }
}
