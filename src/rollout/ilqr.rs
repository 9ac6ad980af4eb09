//! Receding-horizon iLQR with the true model: close to the best that physics allows.
//!
//! Tassa, Mansard, Todorov, "Control-limited differential dynamic programming" (ICRA 2014),
//! without second derivatives of the dynamics. One iteration per frame, warm-started with the
//! shifted plan of the frame before, is enough because the problem moves by one frame.
//!
//! The transition of a control step is taken from one simulator step at its start, raised to the
//! number of substeps n: A = As^n, B = (As^(n-1) + … + 1) Bs. That is ten times cheaper than
//! differentiating every substep. The line search runs the true simulation, so in contact the
//! approximation can slow down the search, but the accepted plan is still an improvement.
//!
//! In contact an iteration may fail to improve a bad plan. So in every frame the shifted plan is
//! compared with the plan of proportional control, and the better one is used.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::error::Error;
use super::nominal_model::NominalModel;
use super::pd::Pd;
use super::policy::{Policy, View};
use super::window::{COMMAND, Window};
use robert_mujoco::Snapshot;
use robert_robot::Robot;

/// Step lengths of the line search; each needs a simulation of the whole horizon.
const ALPHAS: [f64; 3] = [1.0, 0.4, 0.1];

/// Dampings to try before the plan is kept unchanged.
const DAMPINGS: usize = 3;

/// A step whose expected decrease of the cost is below this share of it is not simulated.
const CONVERGED: f64 = 1e-4;

/// Settings of [`Ilqr`].
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct IlqrConfig {
    /// Frames planned ahead, at most 20.
    pub horizon: usize,
    /// Iterations per frame with a warm start.
    pub iterations: usize,
    /// Iterations at the first frame.
    pub first_iterations: usize,
    /// Weight of a commanded frame.
    pub goal_weight: f64,
    /// Weight of a masked frame that the linear guide filled.
    pub guide_weight: f64,
    /// Weight of the squared action.
    pub action_weight: f64,
    /// Weight of the squared change of action between frames. It keeps actions from oscillating.
    pub change_weight: f64,
}

impl IlqrConfig {
    /// Settings for a robot. Arms plan over the whole window and need no guide; hands (22 joints,
    /// contacts) plan only as far as the time of a frame allows.
    pub fn for_robot(robot: &Robot) -> IlqrConfig {
        let small = robot.model().nv() <= 10;
        IlqrConfig {
            horizon: if small { 20 } else { 6 },
            iterations: 1,
            first_iterations: 6,
            goal_weight: 1.0,
            guide_weight: if small { 0.0 } else { 0.02 },
            action_weight: 1e-6,
            change_weight: 1e-6,
        }
    }
}

/// The planner.
#[derive(Debug)]
pub struct Ilqr {
    config: IlqrConfig,
    nominal: NominalModel,
    rival: Pd,
    /// Actions of the horizon; (H, A).
    plan: Vec<f64>,
    warm: bool,
    damping: f64,
    /// States along the current plan; H + 1.
    states: Vec<Snapshot>,
    trial_states: Vec<Snapshot>,
    goals: Window,
    last_action: Vec<f64>,
}

/// Local model of one control step.
struct Step {
    a: DMatrix<f64>,
    b: DMatrix<f64>,
}

/// Affine feedback of one frame.
struct Gain {
    k: DVector<f64>,
    feedback: DMatrix<f64>,
}

impl Ilqr {
    /// A planner on the robot's own model.
    ///
    /// # Errors
    /// [`Error::Setup`], [`Error::Timestep`].
    pub fn new(robot: &Arc<Robot>, config: &IlqrConfig) -> Result<Ilqr, Error> {
        let nominal = NominalModel::new(robot)?;
        let horizon = config.horizon.clamp(1, COMMAND);
        let snapshot = nominal.data.snapshot();
        let actions = robot.action_dim();
        Ok(Ilqr {
            plan: vec![0.0; horizon * actions],
            warm: false,
            damping: 1e-6,
            states: vec![snapshot.clone(); horizon + 1],
            trial_states: vec![snapshot; horizon + 1],
            goals: Window::new(robot.state_dim()),
            last_action: vec![0.0; actions],
            rival: Pd::new(robot)?,
            config: IlqrConfig { horizon, ..config.clone() },
            nominal,
        })
    }

    fn actions(&self) -> usize {
        self.nominal.robot.action_dim()
    }

    /// Weight of joint `j` at command index `i`.
    fn weight(&self, view: &View<'_>, i: usize, j: usize) -> f64 {
        if view.window.visible[i * view.window.dim() + j] {
            self.config.goal_weight
        } else {
            self.config.guide_weight
        }
    }

    /// Simulates the plan that `choose` makes, frame by frame, into the trial states. Returns the
    /// plan and its cost, which is infinite if the simulation diverges.
    fn simulate(
        &mut self,
        view: &View<'_>,
        mut choose: impl FnMut(&mut Self, usize, &mut [f64]) -> Result<(), Error>,
    ) -> Result<(Vec<f64>, f64), Error> {
        let actions = self.actions();
        let mut plan = vec![0.0; self.plan.len()];
        self.nominal.data.restore(view.state)?;
        for (i, u) in plan.chunks_exact_mut(actions).enumerate() {
            self.nominal.data.snapshot_into(&mut self.trial_states[i]);
            choose(self, i, u)?;
            self.nominal.robot.apply_action(&mut self.nominal.data, u)?;
            if self.nominal.data.step(self.nominal.substeps).is_err() {
                return Ok((plan, f64::INFINITY));
            }
        }
        if let Some(last) = self.trial_states.last_mut() {
            self.nominal.data.snapshot_into(last);
        }
        let cost = self.cost(view, &plan, &self.trial_states);
        Ok((plan, cost))
    }

    /// [`Ilqr::simulate`] of an existing plan.
    fn replay(&mut self, view: &View<'_>, plan: &[f64]) -> Result<(Vec<f64>, f64), Error> {
        self.simulate(view, |s, i, u| {
            let actions = s.actions();
            u.copy_from_slice(&plan[i * actions..(i + 1) * actions]);
            Ok(())
        })
    }

    /// Simulates the plan of proportional control on the guided goals into the trial states, and
    /// returns its cost.
    fn track(&mut self, view: &View<'_>) -> Result<(Vec<f64>, f64), Error> {
        let dim = view.window.dim();
        let mut current = vec![0.0; dim];
        self.simulate(view, |s, i, u| {
            s.nominal.robot.read_state(&s.nominal.data, &mut current);
            let target = &s.goals.command[i * dim..(i + 1) * dim];
            let data = &s.nominal.data;
            s.rival.drive((&current, target), data.qpos(), data.qvel(), u)
        })
    }

    /// Makes the plan in the trial states the current one.
    fn take(&mut self, plan: Vec<f64>) {
        self.plan = plan;
        std::mem::swap(&mut self.states, &mut self.trial_states);
    }

    fn cost(&self, view: &View<'_>, plan: &[f64], states: &[Snapshot]) -> f64 {
        let actions = self.actions();
        let dim = view.window.dim();
        let mut cost = 0.0;
        let mut before = self.last_action.as_slice();
        for (i, u) in plan.chunks_exact(actions).enumerate() {
            for (j, joint) in self.nominal.robot.joints().iter().enumerate() {
                let e = states[i + 1].qpos[joint.qposadr] - self.goals.command[i * dim + j];
                cost += 0.5 * self.weight(view, i, j) * e * e;
            }
            for (a, b) in u.iter().zip(before) {
                cost += 0.5 * self.config.action_weight * a * a;
                cost += 0.5 * self.config.change_weight * (a - b) * (a - b);
            }
            before = u;
        }
        cost
    }

    /// Local dynamics of frame `i` of the current plan, in (dq, dv) and scaled actions.
    fn linearise(&mut self, i: usize) -> Result<Step, Error> {
        let actions = self.actions();
        let robot = Arc::clone(&self.nominal.robot);
        let data = &mut self.nominal.data;
        let model = Arc::clone(data.model());
        let n = 2 * model.nv() + model.na();
        let (mut a, mut b) = (vec![0.0; n * n], vec![0.0; n * model.nu()]);
        data.restore(&self.states[i])?;
        robot.apply_action(data, &self.plan[i * actions..(i + 1) * actions])?;
        data.transition_fd(1e-6, false, &mut a, &mut b)?;
        let a_sub = DMatrix::from_row_slice(n, n, &a);
        let mut b_sub = DMatrix::from_row_slice(n, model.nu(), &b);
        for (k, actuator) in robot.actuators().iter().enumerate() {
            let [lo, hi] = actuator.ctrlrange;
            b_sub.column_mut(k).scale_mut(0.5 * (hi - lo));
        }
        let (mut a, mut b) = (a_sub.clone(), b_sub.clone());
        for _ in 1..self.nominal.substeps {
            b = &a_sub * b + &b_sub;
            a = &a_sub * a;
        }
        Ok(Step { a, b })
    }

    /// Backward pass: feedback, and the expected decrease of the cost. `None` if a Hessian is not
    /// positive at this damping.
    fn backward(&self, view: &View<'_>, steps: &[Step]) -> Option<(Vec<Gain>, f64)> {
        let (dim, actions) = (view.window.dim(), self.actions());
        let n = steps.first()?.a.nrows();
        let horizon = steps.len();
        let mut vx = DVector::zeros(n);
        let mut vxx = DMatrix::zeros(n, n);
        let mut gains = Vec::with_capacity(horizon);
        let mut expected = 0.0;
        for i in (0..horizon).rev() {
            // Cost of the state that this frame leads to.
            for (j, joint) in self.nominal.robot.joints().iter().enumerate() {
                let w = self.weight(view, i, j);
                let e = self.states[i + 1].qpos[joint.qposadr] - self.goals.command[i * dim + j];
                vx[joint.dofadr] += w * e;
                vxx[(joint.dofadr, joint.dofadr)] += w;
            }
            let Step { a, b } = &steps[i];
            let u = &self.plan[i * actions..(i + 1) * actions];
            let before =
                if i == 0 { &self.last_action } else { &self.plan[(i - 1) * actions..i * actions] };
            let mut qu = b.tr_mul(&vx);
            for k in 0..actions {
                qu[k] += self.config.action_weight * u[k]
                    + self.config.change_weight * (u[k] - before[k]);
            }
            let vb = &vxx * b;
            let mut quu = b.tr_mul(&vb);
            for k in 0..actions {
                quu[(k, k)] += self.config.action_weight + self.config.change_weight + self.damping;
            }
            let va = &vxx * a;
            let qux = b.tr_mul(&va);
            let gain = bounded_newton(&quu, &qu, &qux, u)?;
            expected -= gain.k.dot(&qu) + 0.5 * gain.k.dot(&(&quu * &gain.k));
            let qx = a.tr_mul(&vx);
            let qxx = a.tr_mul(&va);
            vx = qx + gain.feedback.tr_mul(&(&quu * &gain.k + &qu)) + qux.tr_mul(&gain.k);
            vxx = qxx
                + gain.feedback.tr_mul(&(&quu * &gain.feedback + &qux))
                + qux.tr_mul(&gain.feedback);
            vxx = (&vxx + vxx.transpose()) * 0.5;
            gains.push(gain);
        }
        gains.reverse();
        Some((gains, expected))
    }

    /// The plan of the gains at step length `alpha`.
    fn forward(
        &mut self,
        view: &View<'_>,
        gains: &[Gain],
        alpha: f64,
    ) -> Result<(Vec<f64>, f64), Error> {
        let nv = self.nominal.robot.model().nv();
        self.simulate(view, |s, i, u| {
            let (gain, data) = (&gains[i], &s.nominal.data);
            let mut dx = DVector::zeros(gain.feedback.ncols());
            for k in 0..nv {
                // Hinges and slides only: coordinates are the tangent.
                dx[k] = data.qpos()[k] - s.states[i].qpos[k];
                dx[nv + k] = data.qvel()[k] - s.states[i].qvel[k];
            }
            let du = &gain.k * alpha + &gain.feedback * dx;
            let old = &s.plan[i * u.len()..(i + 1) * u.len()];
            for (k, (new, old)) in u.iter_mut().zip(old).enumerate() {
                *new = (old + du[k]).clamp(-1.0, 1.0);
            }
            Ok(())
        })
    }

    /// One iteration; whether the plan improved.
    fn improve(&mut self, view: &View<'_>, cost: &mut f64) -> Result<bool, Error> {
        let steps =
            (0..self.config.horizon).map(|i| self.linearise(i)).collect::<Result<Vec<_>, _>>()?;
        for _ in 0..DAMPINGS {
            if let Some((gains, expected)) = self.backward(view, &steps) {
                if expected < CONVERGED * *cost {
                    return Ok(false);
                }
                for alpha in ALPHAS {
                    let (plan, trial) = self.forward(view, &gains, alpha)?;
                    if trial < *cost {
                        self.take(plan);
                        *cost = trial;
                        self.damping = (self.damping * 0.3).max(1e-8);
                        return Ok(true);
                    }
                }
            }
            self.damping = (self.damping * 10.0).min(1e2);
        }
        Ok(false)
    }

    /// Shifts the plan by one frame; the last action is kept.
    fn shift(&mut self) {
        let actions = self.actions();
        self.plan.copy_within(actions.., 0);
    }
}

/// Newton step within the box [-1, 1]: bounded dimensions are fixed at their bound and the
/// rest solved again until none more hits (Tassa 2014, section III-B, projected once per
/// new bound). `None` when the free Hessian is not positive.
fn bounded_newton(
    quu: &DMatrix<f64>,
    qu: &DVector<f64>,
    qux: &DMatrix<f64>,
    u: &[f64],
) -> Option<Gain> {
    let m = u.len();
    let mut free: Vec<usize> = (0..m).collect();
    let mut k = DVector::zeros(m);
    loop {
        let hessian = DMatrix::from_fn(free.len(), free.len(), |r, c| quu[(free[r], free[c])]);
        let chol = hessian.cholesky()?;
        let fixed_force = quu * &k;
        let rhs = DVector::from_fn(free.len(), |r, _| {
            let own: f64 = free.iter().map(|&c| quu[(free[r], c)] * k[c]).sum();
            -(qu[free[r]] + fixed_force[free[r]] - own)
        });
        let step = chol.solve(&rhs);
        for (r, &i) in free.iter().enumerate() {
            k[i] = step[r];
        }
        let hit: Vec<usize> = free
            .iter()
            .copied()
            .filter(|&i| u[i] + k[i] > 1.0 + 1e-12 || u[i] + k[i] < -1.0 - 1e-12)
            .collect();
        if hit.is_empty() {
            let mut feedback = DMatrix::zeros(m, qux.ncols());
            let rows = DMatrix::from_fn(free.len(), qux.ncols(), |r, c| -qux[(free[r], c)]);
            let solved = chol.solve(&rows);
            for (r, &i) in free.iter().enumerate() {
                feedback.row_mut(i).copy_from(&solved.row(r));
            }
            return Some(Gain { k, feedback });
        }
        for &i in &hit {
            k[i] = (u[i] + k[i]).clamp(-1.0, 1.0) - u[i];
        }
        free.retain(|i| !hit.contains(i));
        if free.is_empty() {
            return Some(Gain { k, feedback: DMatrix::zeros(m, qux.ncols()) });
        }
    }
}

impl Policy for Ilqr {
    fn name(&self) -> String {
        "ilqr".into()
    }

    fn uses_model(&self) -> bool {
        true
    }

    fn reset(&mut self, _seed: u64) {
        self.plan.fill(0.0);
        self.last_action.fill(0.0);
        self.warm = false;
        self.damping = 1e-6;
    }

    fn act(&mut self, view: &View<'_>, action: &mut [f64]) -> Result<(), Error> {
        self.act_from(view, None, action)
    }

    fn memory(&self) -> Vec<f64> {
        let mut memory = vec![f64::from(u8::from(self.warm)), self.damping];
        memory.extend_from_slice(&self.last_action);
        memory.extend_from_slice(&self.plan);
        memory
    }

    fn recall(&mut self, memory: &[f64]) {
        let actions = self.actions();
        let (Some((head, rest)), want) = (memory.split_at_checked(2), actions + self.plan.len())
        else {
            return self.reset(0);
        };
        if rest.len() != want {
            return self.reset(0);
        }
        self.warm = head[0] != 0.0;
        self.damping = head[1];
        self.last_action.copy_from_slice(&rest[..actions]);
        self.plan.copy_from_slice(&rest[actions..]);
    }
}

impl Ilqr {
    /// Plans one frame. A `hint` is another policy's action: the plan that begins with it becomes
    /// the start if it is better.
    ///
    /// # Errors
    /// As [`Policy::act`].
    pub(super) fn act_from(
        &mut self,
        view: &View<'_>,
        hint: Option<&[f64]>,
        action: &mut [f64],
    ) -> Result<(), Error> {
        self.goals.clone_from(view.window);
        self.goals.guide_linear();
        let iterations =
            if self.warm { self.config.iterations } else { self.config.first_iterations };
        let old = self.plan.clone();
        let (plan, mut cost) = self.replay(view, &old)?;
        self.take(plan);
        if let Some(hint) = hint {
            let mut hinted = old;
            let repeats = if self.warm { 1 } else { self.config.horizon };
            for u in hinted.chunks_exact_mut(hint.len()).take(repeats) {
                u.copy_from_slice(hint);
            }
            let (plan, trial) = self.replay(view, &hinted)?;
            if trial < cost {
                self.take(plan);
                cost = trial;
            }
        }
        let (plan, trial) = self.track(view)?;
        if trial < cost {
            self.take(plan);
            cost = trial;
        }
        if !cost.is_finite() {
            // The plan diverges, so begin again with zero actions.
            let rest = vec![0.0; self.plan.len()];
            let (plan, trial) = self.replay(view, &rest)?;
            self.take(plan);
            cost = trial;
        }
        for _ in 0..iterations {
            if !self.improve(view, &mut cost)? {
                break;
            }
        }
        let actions = self.actions();
        action.copy_from_slice(&self.plan[..actions]);
        self.last_action.copy_from_slice(action);
        self.warm = true;
        self.shift();
        Ok(())
    }
}
