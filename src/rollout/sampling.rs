//! Predictive sampling (Howell et al. 2022, "Predictive Sampling: Real-time Behaviour
//! Synthesis with MuJoCo", algorithm 1): perturb the best spline, keep the best rollout.
//! The simplest planner that works; it shows how much search alone achieves.
//!
//! The published planner samples targets of position servos. Our actuators are motors, and with a
//! spline of torque every error would remain until the next sample. So each candidate contains the
//! feedback of `pd`, and the samples are added to its action. With all samples zero the plan is
//! `pd`.
//!
//! Candidates are tried one after another here, so two things differ from the published algorithm.
//! Each candidate perturbs the best one so far instead of the plan of the frame before.
//! Perturbations come in pairs of opposite sign and in several widths: wide ones to find a plan,
//! and narrow ones to improve it.

use std::sync::Arc;

use super::error::Error;
use super::nominal_model::NominalModel;
use super::pd::Pd;
use super::policy::{Policy, View};
use super::window::{COMMAND, Window};
use robert_base::rng::{Rng, Stream};
use robert_robot::Robot;

/// Each width of the perturbations is the previous one times this.
const NARROWER: f64 = 0.35;

/// Settings of [`PredictiveSampling`].
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct SamplingConfig {
    /// Candidate plans per frame, including the unchanged one.
    pub trajectories: usize,
    /// Standard deviation of the widest perturbation of a knot, in actions.
    pub noise: f64,
    /// Widths of perturbations, taken in turns.
    pub widths: usize,
    /// Spline knots over the horizon.
    pub knots: usize,
    /// Frames planned ahead.
    pub horizon: usize,
    /// Weight of a masked frame that the linear guide filled; a commanded one has 1.
    pub guide_weight: f64,
    /// Weight of the squared action.
    pub action_weight: f64,
}

impl SamplingConfig {
    /// Settings for a robot; with few joints the horizon is longer.
    pub fn for_robot(robot: &Robot) -> SamplingConfig {
        let small = robot.model().nv() <= 10;
        SamplingConfig {
            trajectories: 33,
            noise: 0.2,
            widths: 4,
            knots: 4,
            horizon: if small { 8 } else { 4 },
            guide_weight: 0.02,
            action_weight: 1e-6,
        }
    }
}

/// The planner.
#[derive(Debug)]
pub struct PredictiveSampling {
    config: SamplingConfig,
    nominal: NominalModel,
    servos: Pd,
    /// The correction that is added to the servos' action; (knots, A).
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
            widths: config.widths.max(1),
            knots: config.knots.max(2),
            horizon: config.horizon.clamp(1, COMMAND),
            ..config.clone()
        };
        let spline = vec![0.0; config.knots * robot.action_dim()];
        let goals = Window::new(robot.state_dim());
        let (nominal, servos) = (NominalModel::new(robot)?, Pd::new(robot)?);
        Ok(PredictiveSampling { nominal, servos, config, spline, seed: 0, goals })
    }

    /// The cost of a plan that is simulated from the state of the view, and its first action. All
    /// terms are positive, so the simulation stops when the cost exceeds `bound`.
    fn cost(
        &mut self,
        view: &View<'_>,
        spline: &[f64],
        bound: f64,
        first: &mut [f64],
    ) -> Result<f64, Error> {
        let (actions, dim) = (first.len(), self.goals.dim());
        let mut u = vec![0.0; actions];
        let mut added = vec![0.0; actions];
        let mut current = vec![0.0; dim];
        let mut cost = 0.0;
        let data = &mut self.nominal.data;
        data.restore(view.state)?;
        for i in 0..self.config.horizon {
            let target = &self.goals.command[i * dim..(i + 1) * dim];
            self.nominal.robot.read_state(data, &mut current);
            self.servos.drive((&current, target), data.qpos(), data.qvel(), &mut u)?;
            evaluate(spline, actions, self.config.horizon, i as f64, &mut added);
            for (u, added) in u.iter_mut().zip(&added) {
                *u = (*u + added).clamp(-1.0, 1.0);
                cost += self.config.action_weight * *u * *u;
            }
            if i == 0 {
                first.copy_from_slice(&u);
            }
            self.nominal.robot.apply_action(data, &u)?;
            if data.step(self.nominal.substeps).is_err() {
                return Ok(f64::INFINITY);
            }
            for (j, joint) in self.nominal.robot.joints().iter().enumerate() {
                let e = data.qpos()[joint.qposadr] - target[j];
                let seen = view.window.visible[i * dim + j];
                cost += if seen { 1.0 } else { self.config.guide_weight } * e * e;
            }
            if cost >= bound {
                return Ok(f64::INFINITY);
            }
        }
        Ok(cost)
    }
}

/// Cubic Catmull-Rom value of the spline at frame `at` of `horizon`, clamped to the two units
/// between the bounds of an action.
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
        *o = value.clamp(-2.0, 2.0);
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
        let mut best_cost = self.cost(view, &best, f64::INFINITY, action)?;
        let mut first = vec![0.0; actions];
        let SamplingConfig { trajectories, noise, widths, .. } = self.config;
        for n in 1..trajectories {
            // The two candidates of a pair use the same random numbers with opposite signs.
            let (pair, sign) = ((n - 1) / 2, if n % 2 == 0 { -1.0 } else { 1.0 });
            let index = (view.frame * trajectories + pair) as u64;
            let mut rng = Rng::new(self.seed, Stream::Planner, index);
            let width = sign * noise * NARROWER.powi((pair % widths) as i32);
            let candidate: Vec<f64> =
                best.iter().map(|v| (v + width * rng.normal()).clamp(-2.0, 2.0)).collect();
            let cost = self.cost(view, &candidate, best_cost, &mut first)?;
            if cost < best_cost {
                (best, best_cost) = (candidate, cost);
                action.copy_from_slice(&first);
            }
        }
        // Warm start: the same curve, one frame on.
        let (knots, horizon) = (self.config.knots, self.config.horizon);
        let step = horizon as f64 / (knots - 1) as f64;
        for (k, row) in self.spline.chunks_exact_mut(actions).enumerate() {
            evaluate(&best, actions, horizon, k as f64 * step + 1.0, row);
        }
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
