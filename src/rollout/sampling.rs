//! Predictive sampling (Howell et al. 2022, "Predictive Sampling: Real-time Behaviour
//! Synthesis with MuJoCo", algorithm 1): perturb the best spline, keep the best rollout.
//! The simplest planner that works, and a yardstick for how much search alone buys.

use std::sync::Arc;

use super::belief::Belief;
use super::error::Error;
use super::policy::{Policy, View};
use super::window::{COMMAND, Window};
use crate::rng::{Rng, Stream};
use crate::robot::Robot;

/// Settings of [`PredictiveSampling`]; the defaults are those of the published planner.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct SamplingConfig {
    /// Candidate plans a frame, the unchanged one included.
    pub trajectories: usize,
    /// Standard deviation of the knots' perturbation, in actions.
    pub noise: f64,
    /// Spline knots over the horizon.
    pub knots: usize,
    /// Frames planned ahead.
    pub horizon: usize,
}

impl Default for SamplingConfig {
    fn default() -> Self {
        SamplingConfig { trajectories: 10, noise: 0.1, knots: 5, horizon: 10 }
    }
}

/// The planner.
#[derive(Debug)]
pub struct PredictiveSampling {
    config: SamplingConfig,
    belief: Belief,
    /// (knots, A).
    spline: Vec<f64>,
    seed: u64,
    goals: Window,
}

impl PredictiveSampling {
    /// A planner on the robot's own model.
    ///
    /// # Errors
    /// [`Error::Setup`], [`Error::Timestep`].
    pub fn new(robot: &Arc<Robot>, config: &SamplingConfig) -> Result<Self, Error> {
        let config = SamplingConfig {
            trajectories: config.trajectories.max(1),
            knots: config.knots.max(2),
            horizon: config.horizon.clamp(1, COMMAND),
            ..config.clone()
        };
        let spline = vec![0.0; config.knots * robot.action_dim()];
        let goals = Window::new(robot.state_dim());
        Ok(PredictiveSampling { belief: Belief::new(robot)?, config, spline, seed: 0, goals })
    }

    fn cost(&mut self, view: &View<'_>, spline: &[f64]) -> Result<f64, Error> {
        let actions = self.belief.robot.action_dim();
        let dim = self.goals.dim();
        let mut u = vec![0.0; actions];
        let mut cost = 0.0;
        let data = &mut self.belief.data;
        data.restore(view.state)?;
        for i in 0..self.config.horizon {
            evaluate(spline, actions, self.config.horizon, i as f64, &mut u);
            self.belief.robot.apply_action(data, &u)?;
            if data.step(self.belief.substeps).is_err() {
                return Ok(f64::INFINITY);
            }
            for (j, joint) in self.belief.robot.joints().iter().enumerate() {
                let e = data.qpos()[joint.qposadr] - self.goals.command[i * dim + j];
                cost += e * e;
            }
            cost += 1e-5 * u.iter().map(|a| a * a).sum::<f64>();
        }
        Ok(cost)
    }
}

/// Cubic Catmull-Rom value of the spline at frame `at` of `horizon`.
fn evaluate(spline: &[f64], actions: usize, horizon: usize, at: f64, out: &mut [f64]) {
    let knots = spline.len() / actions;
    let x = (at / horizon as f64 * (knots - 1) as f64).clamp(0.0, (knots - 1) as f64);
    let k = (x.floor() as usize).min(knots - 2);
    let s = x - k as f64;
    let knot = |i: isize, a: usize| {
        let i = i.clamp(0, knots as isize - 1) as usize;
        spline[i * actions + a]
    };
    for (a, o) in out.iter_mut().enumerate() {
        let k = k as isize;
        let (p0, p1, p2, p3) = (knot(k - 1, a), knot(k, a), knot(k + 1, a), knot(k + 2, a));
        let value = p1
            + 0.5
                * s
                * (p2 - p0
                    + s * (2.0 * p0 - 5.0 * p1 + 4.0 * p2 - p3 + s * (3.0 * (p1 - p2) + p3 - p0)));
        *o = value.clamp(-1.0, 1.0);
    }
}

impl Policy for PredictiveSampling {
    fn name(&self) -> String {
        "predictive-sampling".into()
    }

    fn uses_model(&self) -> bool {
        true
    }

    fn reset(&mut self, seed: u64) {
        self.seed = seed;
        self.spline.fill(0.0);
    }

    fn act(&mut self, view: &View<'_>, action: &mut [f64]) -> Result<(), Error> {
        self.goals.clone_from(view.window);
        self.goals.guide_linear();
        let actions = action.len();
        let mut best = self.spline.clone();
        let mut best_cost = self.cost(view, &best)?;
        for n in 1..self.config.trajectories {
            let index = view.frame as u64 * self.config.trajectories as u64 + n as u64;
            let mut rng = Rng::new(self.seed, Stream::Planner, index);
            let candidate: Vec<f64> = self
                .spline
                .iter()
                .map(|v| (v + self.config.noise * rng.normal()).clamp(-1.0, 1.0))
                .collect();
            let cost = self.cost(view, &candidate)?;
            if cost < best_cost {
                (best, best_cost) = (candidate, cost);
            }
        }
        evaluate(&best, actions, self.config.horizon, 0.0, action);
        // Warm start: the same curve, one frame on.
        let knots = self.config.knots;
        let step = self.config.horizon as f64 / (knots - 1) as f64;
        let mut shifted = vec![0.0; best.len()];
        for (k, row) in shifted.chunks_exact_mut(actions).enumerate() {
            evaluate(&best, actions, self.config.horizon, k as f64 * step + 1.0, row);
        }
        self.spline = shifted;
        Ok(())
    }

    fn memory(&self) -> Vec<f64> {
        self.spline.clone()
    }

    fn recall(&mut self, memory: &[f64]) {
        if memory.len() == self.spline.len() {
            self.spline.copy_from_slice(memory);
        }
    }
}
