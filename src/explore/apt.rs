//! APT: active pre-training (Liu and Abbeel 2021, arXiv 2103.04551; ICM features as in
//! URLB). It rewards states whose representation has few neighbours.
//!
//! ```text
//! rep  = tanh(norm(s W + b)), 512 wide, shared by both models below
//! loss = mean |rep' - f(rep, a)| + mean |a - g(rep, rep')|
//! r    = particle entropy of rep(s) within the batch, k = 12
//! ```

use super::batch::{Batch, beside, left, norm_loss, right};
use super::mlp::{Adam, Layer, Mlp, Tape};
use super::particle::{Neighbours, Pbe, Rms};
use super::state::{Field, Keep};
use robert_linalg::Real;

/// Width of the representation.
const REP: usize = 512;
/// The reward's settings: no running mean, no clip.
const PBE: Pbe = Pbe { k: 12, clip: 0.0, rms: false };

/// Representation, forward and inverse model.
#[derive(Clone, Debug)]
pub(crate) struct Apt<T> {
    act: usize,
    rep: usize,
    trunk: Mlp<T>,
    forward: Mlp<T>,
    inverse: Mlp<T>,
    adams: [Adam<T>; 3],
    tapes: [Tape<T>; 4],
    x: Vec<T>,
    d: Vec<T>,
    norms: Vec<T>,
    drep: Vec<T>,
    dnext: Vec<T>,
    neighbours: Neighbours<T>,
}

impl<T: Real> Apt<T> {
    /// For `obs` states, `act` actions and hidden width `h`.
    pub(crate) fn new(obs: usize, act: usize, h: usize, seed: u64) -> Self {
        Self::with_rep(obs, act, h, REP, seed)
    }

    fn with_rep(obs: usize, act: usize, h: usize, rep: usize, seed: u64) -> Self {
        let trunk = Mlp::new(&[Layer::Linear(obs, rep), Layer::NormTanh(rep)], seed, 100);
        let forward = Mlp::new(
            &[Layer::Linear(rep + act, h), Layer::Relu(h), Layer::Linear(h, rep)],
            seed,
            200,
        );
        let inverse = Mlp::new(
            &[Layer::Linear(2 * rep, h), Layer::Relu(h), Layer::Linear(h, act), Layer::Tanh(act)],
            seed,
            300,
        );
        Apt {
            act,
            rep,
            adams: [&trunk, &forward, &inverse].map(|n| Adam::new(n.params.len())),
            trunk,
            forward,
            inverse,
            tapes: Default::default(),
            x: Vec::new(),
            d: Vec::new(),
            norms: Vec::new(),
            drep: Vec::new(),
            dnext: Vec::new(),
            neighbours: Neighbours::default(),
        }
    }

    /// One step of all three networks; returns the loss.
    pub(crate) fn update(&mut self, batch: &Batch<T>, lr: f64) -> f64 {
        let loss = self.gradients(batch);
        let nets = [&mut self.trunk, &mut self.forward, &mut self.inverse];
        for (net, adam) in nets.into_iter().zip(&mut self.adams) {
            adam.step(&mut net.params, lr);
        }
        loss
    }

    /// Loss; its gradients are added to those of the optimisers.
    fn gradients(&mut self, b: &Batch<T>) -> f64 {
        let (n, a) = (self.rep, self.act);
        let [here, there, forward, inverse] = &mut self.tapes;
        let [trunk_adam, forward_adam, inverse_adam] = &mut self.adams;
        self.trunk.forward(&b.obs, b.rows, here);
        self.trunk.forward(&b.next, b.rows, there);

        beside(here.output(), n, &b.action, a, &mut self.x);
        let guess = self.forward.forward(&self.x, b.rows, forward);
        let mut loss = norm_loss(guess, there.output(), n, &mut self.norms, &mut self.d);
        // The target depends on parameters too; its gradient is the opposite of the prediction's.
        self.dnext.clear();
        self.dnext.extend(self.d.iter().map(|&d| -d));
        self.forward.backward(forward, &mut self.d, Some(&mut forward_adam.grads), true);
        left(&self.d, n, a, false, &mut self.drep);

        beside(here.output(), n, there.output(), n, &mut self.x);
        let guess = self.inverse.forward(&self.x, b.rows, inverse);
        loss += norm_loss(guess, &b.action, a, &mut self.norms, &mut self.d);
        self.inverse.backward(inverse, &mut self.d, Some(&mut inverse_adam.grads), true);
        left(&self.d, n, n, true, &mut self.drep);
        right(&self.d, n, n, true, &mut self.dnext);

        self.trunk.backward(here, &mut self.drep, Some(&mut trunk_adam.grads), false);
        self.trunk.backward(there, &mut self.dnext, Some(&mut trunk_adam.grads), false);
        loss
    }

    /// Reward of each transition: entropy of the representation of s.
    pub(crate) fn reward(&mut self, batch: &Batch<T>, out: &mut Vec<T>) {
        let rep = self.trunk.forward(&batch.obs, batch.rows, &mut self.tapes[0]);
        PBE.reward(rep, self.rep, &mut Rms::default(), &mut self.neighbours, out);
    }
}

impl<T: Real> Keep<T> for Apt<T> {
    fn keep(&mut self, visit: &mut dyn FnMut(&str, Field<'_, T>)) {
        visit("apt.trunk", Field::Reals(&mut self.trunk.params));
        visit("apt.forward", Field::Reals(&mut self.forward.params));
        visit("apt.inverse", Field::Reals(&mut self.inverse.params));
        let names = ["apt.trunk_adam", "apt.forward_adam", "apt.inverse_adam"];
        for (adam, name) in self.adams.iter_mut().zip(names) {
            adam.keep_as(name, visit);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::mlp::tests::{check_gradient, noise};
    use super::*;

    #[test]
    fn loss_gradients() {
        let b = Batch {
            rows: 6,
            obs: noise(6 * 4, 1),
            action: noise(6 * 2, 2).iter().map(|x| x.tanh()).collect(),
            next: noise(6 * 4, 3),
            skill: Vec::new(),
        };
        let mut apt = Apt::<f64>::with_rep(4, 2, 8, 10, 3);
        apt.gradients(&b);
        let grads: Vec<Vec<f64>> = apt.adams.iter().map(|a| a.grads.clone()).collect();
        for (which, g) in grads.into_iter().enumerate() {
            let params = |apt: &mut Apt<f64>, p: Option<&[f64]>| {
                let net = match which {
                    0 => &mut apt.trunk,
                    1 => &mut apt.forward,
                    _ => &mut apt.inverse,
                };
                if let Some(p) = p {
                    net.params.copy_from_slice(p);
                }
                net.params.clone()
            };
            let mut p = params(&mut apt, None);
            let keep = p.clone();
            check_gradient("apt", &mut p, &g, 5, |p| {
                params(&mut apt, Some(p));
                apt.gradients(&b)
            });
            params(&mut apt, Some(&keep));
        }
    }

    #[test]
    fn loners_earn_more() {
        let mut apt = Apt::<f64>::with_rep(2, 1, 8, 16, 3);
        let mut obs: Vec<f64> = noise(64 * 2, 1).iter().map(|x| 1.0 + x * 0.05).collect();
        (obs[0], obs[1]) = (-2.0, 1.0);
        let b = Batch { rows: 64, obs, ..Batch::default() };
        let mut r = Vec::new();
        apt.reward(&b, &mut r);
        let best = r.iter().copied().fold(0.0, f64::max);
        assert_eq!(r[0], best);
    }
}
