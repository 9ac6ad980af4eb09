//! DDPG backbone: deterministic actor, twin critics, n-step targets.
//!
//! Source: Lillicrap et al. 2016 (arXiv 1509.02971) in the form of DrQ-v2 (Yarats et al.
//! 2021, arXiv 2107.09645) that URLB uses for states. With `Q_i` = w . `head_i` when the agent
//! has skills w (APS) and the head itself otherwise:
//!
//! ```text
//! actor   o-h-LayerNorm-tanh-h-relu-A-tanh
//! critic  (o + A)-h-LayerNorm-tanh, then twice h-h-relu-q
//! y       = r + gamma^3 min(Q1', Q2')(s', clamp(actor(s') + clip(sigma n, +-.3)))
//! critic loss  mean (Q1 - y)^2 + mean (Q2 - y)^2
//! actor loss   -mean min(Q1, Q2)(s, clamp(actor(s) + clip(sigma n, +-.3)))
//! ```
//!
//! Gradients pass straight through the clamp. The intrinsic reward is computed on (s, a, s') three
//! steps apart and replaces the n-step sum, as in the reference.

use super::aps::SKILL;
use super::batch::{Batch, beside, right};
use super::mlp::{Adam, Layer, Mlp, Tape};
use super::state::{Field, Keep};
use robert_base::rng::{Rng, Stream};
use robert_linalg::{Real, simd};

/// Steps between s and s'.
pub(crate) const N_STEP: usize = 3;
/// Discount of one step.
const GAMMA: f64 = 0.99;
/// Standard deviation of the acting and target noise.
pub(crate) const SIGMA: f64 = 0.2;
/// Bound of the target noise.
const NOISE_CLIP: f64 = 0.3;
/// Share by which the target critic follows.
const FOLLOW: f64 = 0.01;
/// Actions stay this far from +-1.
pub(crate) const EDGE: f64 = 1e-6;

/// Trunk and two heads.
#[derive(Clone, Debug)]
pub(crate) struct Critic<T> {
    trunk: Mlp<T>,
    heads: [Mlp<T>; 2],
}

#[derive(Clone, Debug, Default)]
struct CriticTape<T> {
    trunk: Tape<T>,
    heads: [Tape<T>; 2],
    /// Q of both heads, (rows) each.
    q: [Vec<T>; 2],
}

impl<T: Real> Critic<T> {
    fn new(inputs: usize, h: usize, outputs: usize, seed: u64) -> Self {
        let head = |index| {
            Mlp::new(&[Layer::Linear(h, h), Layer::Relu(h), Layer::Linear(h, outputs)], seed, index)
        };
        Critic {
            trunk: Mlp::new(&[Layer::Linear(inputs, h), Layer::NormTanh(h)], seed, 500),
            heads: [head(600), head(700)],
        }
    }

    /// Q1 and Q2 of each row; `skill` (rows, k) weighs the heads' outputs.
    fn forward(&self, x: &[T], rows: usize, skill: &[T], tape: &mut CriticTape<T>) {
        let features = self.trunk.forward(x, rows, &mut tape.trunk);
        for ((head, t), q) in self.heads.iter().zip(&mut tape.heads).zip(&mut tape.q) {
            let y = head.forward(features, rows, t);
            q.clear();
            if skill.is_empty() {
                q.extend_from_slice(y);
            } else {
                q.extend(
                    y.chunks_exact(SKILL)
                        .zip(skill.chunks_exact(SKILL))
                        .map(|(y, w)| simd::dot(y, w)),
                );
            }
        }
    }

    /// Takes the gradients `dq` by Q1 and Q2 back; returns the gradient by the input in `d`
    /// when `want_input`. Parameter gradients go to `adams` (trunk, head, head) when given.
    fn backward(
        &self,
        dq: &[Vec<T>; 2],
        skill: &[T],
        tape: &mut CriticTape<T>,
        mut adams: Option<&mut [Adam<T>; 3]>,
        want_input: bool,
        d: &mut Vec<T>,
    ) {
        let mut sum: Vec<T> = Vec::new();
        for (i, head) in self.heads.iter().enumerate() {
            d.clear();
            if skill.is_empty() {
                d.extend_from_slice(&dq[i]);
            } else {
                let rows = dq[i].iter().zip(skill.chunks_exact(SKILL));
                d.extend(rows.flat_map(|(&g, w)| w.iter().map(move |&w| g * w)));
            }
            let grads = adams.as_deref_mut().map(|a| a[i + 1].grads.as_mut_slice());
            head.backward(&mut tape.heads[i], d, grads, true);
            if i == 0 {
                sum.clone_from(d);
            } else {
                d.iter_mut().zip(&sum).for_each(|(a, &b)| *a += b);
            }
        }
        let grads = adams.map(|a| a[0].grads.as_mut_slice());
        self.trunk.backward(&mut tape.trunk, d, grads, want_input);
    }

    fn nets(&mut self) -> [&mut Mlp<T>; 3] {
        let [a, b] = &mut self.heads;
        [&mut self.trunk, a, b]
    }
}

/// Actor, critic, target critic and their optimisers.
#[derive(Clone, Debug)]
pub(crate) struct Ddpg<T> {
    /// Scaled observations.
    obs: usize,
    act: usize,
    skill: usize,
    /// The actor.
    pub(crate) actor: Mlp<T>,
    critic: Critic<T>,
    target: Critic<T>,
    actor_adam: Adam<T>,
    critic_adams: [Adam<T>; 3],
    actor_tape: Tape<T>,
    tape: CriticTape<T>,
    goal: CriticTape<T>,
    x: Vec<T>,
    input: Vec<T>,
    action: Vec<T>,
    d: Vec<T>,
    dq: [Vec<T>; 2],
}

/// Layers of the actor for these sizes.
pub(crate) fn actor_layers(inputs: usize, h: usize, act: usize) -> [Layer; 6] {
    [
        Layer::Linear(inputs, h),
        Layer::NormTanh(h),
        Layer::Linear(h, h),
        Layer::Relu(h),
        Layer::Linear(h, act),
        Layer::Tanh(act),
    ]
}

impl<T: Real> Ddpg<T> {
    /// For `obs` observations, `act` actions, skills of length `skill` (0 for none), hidden
    /// width `h`.
    pub(crate) fn new(obs: usize, act: usize, skill: usize, h: usize, seed: u64) -> Self {
        let actor = Mlp::new(&actor_layers(obs + skill, h, act), seed, 400);
        let critic = Critic::new(obs + skill + act, h, skill.max(1), seed);
        let [a, b, c] = critic.clone().nets().map(|n| Adam::new(n.params.len()));
        Ddpg {
            obs,
            act,
            skill,
            actor_adam: Adam::new(actor.params.len()),
            actor,
            target: critic.clone(),
            critic,
            critic_adams: [a, b, c],
            actor_tape: Tape::default(),
            tape: CriticTape::default(),
            goal: CriticTape::default(),
            x: Vec::new(),
            input: Vec::new(),
            action: Vec::new(),
            d: Vec::new(),
            dq: Default::default(),
        }
    }

    /// One step of critic, actor and target on this batch and these rewards (B). Noise is
    /// drawn from (seed, index). Returns critic loss and actor loss.
    pub(crate) fn update(
        &mut self,
        b: &Batch<T>,
        reward: &[T],
        lr: f64,
        seed: u64,
        index: u64,
    ) -> (f64, f64) {
        let mut rng = Rng::new(seed, Stream::Noise, index);
        let noise: Vec<T> = (0..2 * b.rows * self.act)
            .map(|_| T::of((SIGMA * rng.normal()).clamp(-NOISE_CLIP, NOISE_CLIP)))
            .collect();
        let (first, second) = noise.split_at(b.rows * self.act);

        let critic_loss = self.critic_loss(b, reward, first);
        let adams = Some(&mut self.critic_adams);
        self.critic.backward(&self.dq, &b.skill, &mut self.tape, adams, false, &mut self.d);
        for (net, adam) in self.critic.nets().into_iter().zip(&mut self.critic_adams) {
            adam.step(&mut net.params, lr);
        }

        let actor_loss = self.actor_loss(b, second);
        self.actor.backward(
            &mut self.actor_tape,
            &mut self.d,
            Some(&mut self.actor_adam.grads),
            false,
        );
        self.actor_adam.step(&mut self.actor.params, lr);

        for (slow, fast) in self.target.nets().into_iter().zip(self.critic.nets()) {
            simd::follow(&mut slow.params, &fast.params, T::of(FOLLOW));
        }
        (critic_loss, actor_loss)
    }

    /// `input` = [obs, skill], then the noisy action of the actor in `action`.
    fn act(&mut self, b: &Batch<T>, next: bool, noise: &[T]) {
        let obs = if next { &b.next } else { &b.obs };
        beside(obs, self.obs, &b.skill, self.skill, &mut self.input);
        let mu = self.actor.forward(&self.input, b.rows, &mut self.actor_tape);
        let bound = 1.0 - EDGE;
        self.action.clear();
        self.action
            .extend(mu.iter().zip(noise).map(|(&m, &n)| T::of((m + n).f64().clamp(-bound, bound))));
    }

    /// Critic loss; its gradient by Q1 and Q2 is left in `dq`.
    fn critic_loss(&mut self, b: &Batch<T>, reward: &[T], noise: &[T]) -> f64 {
        let inputs = self.obs + self.skill;
        self.act(b, true, noise);
        beside(&self.input, inputs, &self.action, self.act, &mut self.x);
        self.target.forward(&self.x, b.rows, &b.skill, &mut self.goal);

        beside(&b.obs, self.obs, &b.skill, self.skill, &mut self.input);
        beside(&self.input, inputs, &b.action, self.act, &mut self.x);
        self.critic.forward(&self.x, b.rows, &b.skill, &mut self.tape);

        let discount = GAMMA.powi(N_STEP as i32);
        let inv = 1.0 / b.rows as f64;
        let mut loss = 0.0;
        let [g1, g2] = &self.goal.q;
        for (q, d) in self.tape.q.iter().zip(&mut self.dq) {
            d.clear();
            for (((q, r), g1), g2) in q.iter().zip(reward).zip(g1).zip(g2) {
                let y = r.f64() + discount * g1.f64().min(g2.f64());
                let off = q.f64() - y;
                loss += off * off * inv;
                d.push(T::of(2.0 * off * inv));
            }
        }
        loss
    }

    /// Actor loss; its gradient by the actor's output is left in `d`.
    fn actor_loss(&mut self, b: &Batch<T>, noise: &[T]) -> f64 {
        let inputs = self.obs + self.skill;
        self.act(b, false, noise);
        beside(&self.input, inputs, &self.action, self.act, &mut self.x);
        self.critic.forward(&self.x, b.rows, &b.skill, &mut self.tape);
        let inv = T::of(-1.0 / b.rows as f64);
        let mut loss = 0.0;
        let [q1, q2] = &self.tape.q;
        let [d1, d2] = &mut self.dq;
        d1.clear();
        d2.clear();
        for (&a, &b) in q1.iter().zip(q2) {
            let low = a <= b;
            loss += (if low { a } else { b } * inv).f64();
            d1.push(if low { inv } else { T::default() });
            d2.push(if low { T::default() } else { inv });
        }
        let mut dx = Vec::new();
        self.critic.backward(&self.dq, &b.skill, &mut self.tape, None, true, &mut dx);
        right(&dx, inputs, self.act, false, &mut self.d);
        loss
    }
}

impl<T: Real> Keep<T> for Ddpg<T> {
    fn keep(&mut self, visit: &mut dyn FnMut(&str, Field<'_, T>)) {
        visit("actor", Field::Reals(&mut self.actor.params));
        self.actor_adam.keep_as("actor_adam", visit);
        let parts = ["trunk", "head1", "head2"];
        for (net, part) in self.critic.nets().into_iter().zip(parts) {
            visit(&format!("critic.{part}"), Field::Reals(&mut net.params));
        }
        for (net, part) in self.target.nets().into_iter().zip(parts) {
            visit(&format!("target.{part}"), Field::Reals(&mut net.params));
        }
        for (adam, part) in self.critic_adams.iter_mut().zip(parts) {
            adam.keep_as(&format!("critic_adam.{part}"), visit);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::mlp::tests::{check_gradient, noise};
    use super::*;

    fn batch(skill: usize) -> Batch<f64> {
        Batch {
            rows: 7,
            obs: noise(7 * 4, 1),
            action: noise(7 * 2, 2).iter().map(|x| x.tanh()).collect(),
            next: noise(7 * 4, 3),
            skill: noise(7 * skill, 4),
        }
    }

    #[test]
    fn critic_and_actor_gradients() {
        for skill in [0, SKILL] {
            let (b, r) = (batch(skill), noise(7, 5));
            let quiet: Vec<f64> = noise(14, 6).iter().map(|x| 0.1 * x).collect();
            let mut agent = Ddpg::<f64>::new(4, 2, skill, 8, 3);
            agent.critic_loss(&b, &r, &quiet);
            let adams = Some(&mut agent.critic_adams);
            agent.critic.backward(&agent.dq, &b.skill, &mut agent.tape, adams, false, &mut agent.d);
            for which in 0..3 {
                let g = agent.critic_adams[which].grads.clone();
                let mut p = agent.critic.nets()[which].params.clone();
                check_gradient("critic", &mut p, &g, 5, |p| {
                    agent.critic.nets()[which].params.copy_from_slice(p);
                    agent.critic_loss(&b, &r, &quiet)
                });
            }
            agent.actor_loss(&b, &quiet);
            let (mut d, mut g) = (agent.d.clone(), vec![0.0; agent.actor.params.len()]);
            agent.actor.backward(&mut agent.actor_tape, &mut d, Some(&mut g), false);
            let mut p = agent.actor.params.clone();
            check_gradient("actor", &mut p, &g, 3, |p| {
                agent.actor.params.copy_from_slice(p);
                agent.actor_loss(&b, &quiet)
            });
        }
    }

    #[test]
    fn target_by_hand() {
        let (b, r) = (batch(0), vec![0.5; 7]);
        let mut agent = Ddpg::<f64>::new(4, 2, 0, 8, 3);
        // Target heads always give 2 and 3, online heads always 0.
        for (i, head) in agent.target.heads.iter_mut().enumerate() {
            head.params.fill(0.0);
            *head.params.last_mut().unwrap() = 2.0 + i as f64;
        }
        for head in &mut agent.critic.heads {
            head.params.fill(0.0);
        }
        let loss = agent.critic_loss(&b, &r, &[0.0; 14]);
        let y = 0.5 + 0.99_f64.powi(3) * 2.0;
        assert!((loss - 2.0 * y * y).abs() < 1e-12, "{loss}");
    }

    #[test]
    fn it_learns_a_bandit() {
        // Reward 1 - |a - .5|: the actor must move to .5 whatever the state.
        let mut agent = Ddpg::<f32>::new(2, 1, 0, 32, 1);
        let mut rng = Rng::new(1, Stream::Test, 5);
        for i in 0..1500 {
            let obs: Vec<f32> = (0..128).map(|_| rng.normal() as f32).collect();
            let action: Vec<f32> = (0..64).map(|_| rng.range(-1.0, 1.0) as f32).collect();
            let reward: Vec<f32> = action.iter().map(|a| 1.0 - (a - 0.5).abs()).collect();
            let b = Batch { rows: 64, next: obs.clone(), obs, action, skill: Vec::new() };
            agent.update(&b, &reward, 3e-4, 9, i);
        }
        let mut tape = Tape::default();
        let out = agent.actor.forward(&[0.3, -0.2, 1.0, 1.0], 2, &mut tape);
        assert!(out.iter().all(|a| (a - 0.5).abs() < 0.25), "{out:?}");
    }
}
