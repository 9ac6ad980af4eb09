//! A single update of an agent, for benchmarks.

use super::agent::{AgentKind, Curiosity};
use super::aps::SKILL;
use super::batch::Batch;
use super::ddpg::Ddpg;
use super::preset::Preset;
use robert_base::rng::{Rng, Stream};

/// A single update, for benchmarks.
#[derive(Debug)]
pub struct UpdateBench {
    ddpg: Ddpg<f32>,
    curiosity: Curiosity,
    batch: Batch<f32>,
    reward: Vec<f32>,
    updates: u64,
}

impl UpdateBench {
    /// Networks of a preset for these sizes and a batch of random transitions; `None` for
    /// collectors that do not learn.
    pub fn new(kind: AgentKind, preset: &Preset, state_dim: usize, act: usize) -> Option<Self> {
        let obs = 2 * state_dim;
        let skill = if kind == AgentKind::Aps { SKILL } else { 0 };
        let mut rng = Rng::new(1, Stream::Replay, 0);
        let mut random = |n: usize| (0..n).map(|_| rng.range(-1.0, 1.0) as f32).collect::<Vec<_>>();
        let rows = preset.batch;
        Some(UpdateBench {
            ddpg: Ddpg::new(obs, act, skill, preset.hidden, 1),
            curiosity: Curiosity::new(kind, obs, act, preset.hidden, 1)?,
            batch: Batch {
                rows,
                obs: random(rows * obs),
                action: random(rows * act),
                next: random(rows * obs),
                skill: random(rows * skill),
            },
            reward: Vec::new(),
            updates: 0,
        })
    }

    /// Takes one update: curiosity, reward, critic, actor, target.
    pub fn update(&mut self) {
        let i = self.updates;
        self.curiosity.update(&self.batch, 1e-4, 1, i, &mut self.reward);
        self.ddpg.update(&self.batch, &self.reward, 1e-4, 1, i);
        self.updates += 1;
    }
}
