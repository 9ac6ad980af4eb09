//! The measurement of `robert bench collect`: the roll-out phase against bare simulation.

use std::path::Path;
use std::sync::Arc;

use super::ddpg::Ddpg;
use super::env::Env;
use super::env_batch::{EnvBatch, Plan};
use super::error::Error;
use super::policy::{Actor, ExplorePolicy, Snapshot, SnapshotHeader};
use super::preset::Preset;
use robert_base::progress::Cancel;
use robert_base::rng::{Rng, Stream};
use robert_base::units::SUBSTEPS;
use robert_dataset::Shard;
use robert_mujoco::Data;
use robert_robot::Robot;

/// Frames of an episode.
const EPISODE: usize = 250;

/// One thread's share of the comparison.
#[derive(Debug)]
pub struct RolloutBench {
    robot: Arc<Robot>,
    batch: EnvBatch,
    policy: ExplorePolicy,
    env: Env,
    data: Data,
    index: u64,
    /// (start state, controls) of each episode of the last shard.
    episodes: Vec<(Vec<f64>, Vec<f64>)>,
}

impl RolloutBench {
    /// With an untrained actor of hidden width `h`; `index` separates the episodes of the threads.
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub fn new(robot: &Arc<Robot>, h: usize, index: u64) -> Result<Self, Error> {
        let obs = 2 * robot.state_dim();
        let agent = Ddpg::<f32>::new(obs, robot.action_dim(), 0, h, 1);
        let snapshot = Snapshot {
            header: SnapshotHeader::new(robot, "rnd", 0, h),
            actor: agent.actor.params,
            mean: vec![0.0; obs],
            inv: vec![1.0; obs],
        };
        Ok(RolloutBench {
            robot: Arc::clone(robot),
            batch: EnvBatch::new(robot, None)?,
            policy: ExplorePolicy::Actor(
                Box::new(Actor::new(&snapshot)),
                Preset::url_fast().spread,
            ),
            env: Env::new(robot)?,
            data: Data::new(robot.model())?,
            index: index << 16,
            episodes: Vec::new(),
        })
    }

    /// Makes and writes one shard of `frames` frames in `dir`: network, simulation, records,
    /// file. Returns the frames.
    ///
    /// # Errors
    /// As collecting.
    pub fn roll_out(&mut self, dir: &Path, frames: usize) -> Result<u64, Error> {
        self.index += 1;
        let plan = Plan {
            agent: "rnd".to_owned(),
            snapshot_step: 0,
            index: self.index,
            frames,
            episode_frames: EPISODE,
            pinned_frames: Preset::url_fast().pinned_frames,
            seed: 1,
            spec_sha256: String::new(),
        };
        let name = format!("{}.safetensors", self.index);
        let target = (dir, Path::new(&name));
        let entry = self.batch.make(&plan, &self.policy, target, &Cancel::default(), &|_| ())?;
        Ok(entry.frames)
    }

    /// Reads the episodes of the last [`RolloutBench::roll_out`]; not to be timed.
    ///
    /// # Errors
    /// As collecting.
    pub fn prepare(&mut self, dir: &Path) -> Result<(), Error> {
        let path = dir.join(format!("{}.safetensors", self.index));
        let (s, a) = (self.robot.state_dim(), self.robot.action_dim());
        let shard = Shard::open(&path, s, a, None).map_err(|message| {
            Error::Dataset(robert_dataset::Error::Shard { index: 0, message, path: path.clone() })
        })?;
        self.episodes.clear();
        for (start, length, meta) in shard.episodes() {
            self.env.reset(&mut Rng::new(meta.seed, Stream::Reset, 0))?;
            let actions = shard.ctrl_rows(start as usize, length as usize);
            let mut ctrl = Vec::with_capacity(actions.len());
            for row in actions.chunks_exact(a) {
                let row: Vec<f64> = row.iter().map(|&x| f64::from(x)).collect();
                ctrl.extend(self.robot.ctrl_of(&row)?);
            }
            self.episodes.push((self.env.qpos(), ctrl));
        }
        Ok(())
    }

    /// The same episodes again, with only controls and simulation.
    /// Returns the frames.
    ///
    /// # Errors
    /// [`Error::Simulator`].
    pub fn simulate(&mut self) -> Result<u64, Error> {
        let a = self.robot.action_dim();
        let mut frames = 0;
        for (qpos, ctrl) in &self.episodes {
            self.data.reset()?;
            self.data.set_qpos(qpos)?;
            for row in ctrl.chunks_exact(a) {
                self.data.set_ctrl(row)?;
                self.data.step(SUBSTEPS)?;
                frames += 1;
            }
        }
        Ok(frames)
    }
}
