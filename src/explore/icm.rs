//! ICM: intrinsic curiosity module (Pathak et al. 2017, arXiv 1705.05363; state-based form
//! of URLB). The reward is the prediction error of its forward model.
//!
//! ```text
//! loss = mean |s' - f(s, a)| + mean |a - g(s, s')|     norms, not their squares
//! r    = log(1 + |s' - f(s, a)|)
//! ```

use super::batch::{Batch, beside, norm_loss};
use super::mlp::{Adam, Layer, Mlp, Tape};
use super::state::{Field, Keep};
use robert_linalg::Real;

/// Forward and inverse model.
#[derive(Clone, Debug)]
pub(crate) struct Icm<T> {
    obs: usize,
    act: usize,
    forward: Mlp<T>,
    inverse: Mlp<T>,
    forward_adam: Adam<T>,
    inverse_adam: Adam<T>,
    tape: Tape<T>,
    x: Vec<T>,
    d: Vec<T>,
    norms: Vec<T>,
}

impl<T: Real> Icm<T> {
    /// For `obs` states, `act` actions and hidden width `h`.
    pub(crate) fn new(obs: usize, act: usize, h: usize, seed: u64) -> Self {
        let forward = Mlp::new(
            &[Layer::Linear(obs + act, h), Layer::Relu(h), Layer::Linear(h, obs)],
            seed,
            100,
        );
        let inverse = Mlp::new(
            &[Layer::Linear(2 * obs, h), Layer::Relu(h), Layer::Linear(h, act), Layer::Tanh(act)],
            seed,
            200,
        );
        Icm {
            obs,
            act,
            forward_adam: Adam::new(forward.params.len()),
            inverse_adam: Adam::new(inverse.params.len()),
            forward,
            inverse,
            tape: Tape::default(),
            x: Vec::new(),
            d: Vec::new(),
            norms: Vec::new(),
        }
    }

    /// One step of both models; returns the loss.
    pub(crate) fn update(&mut self, batch: &Batch<T>, lr: f64) -> f64 {
        let loss = self.forward_loss(batch);
        let grads = Some(self.forward_adam.grads.as_mut_slice());
        self.forward.backward(&mut self.tape, &mut self.d, grads, false);
        let loss = loss + self.inverse_loss(batch);
        let grads = Some(self.inverse_adam.grads.as_mut_slice());
        self.inverse.backward(&mut self.tape, &mut self.d, grads, false);
        self.forward_adam.step(&mut self.forward.params, lr);
        self.inverse_adam.step(&mut self.inverse.params, lr);
        loss
    }

    fn forward_loss(&mut self, b: &Batch<T>) -> f64 {
        beside(&b.obs, self.obs, &b.action, self.act, &mut self.x);
        let guess = self.forward.forward(&self.x, b.rows, &mut self.tape);
        norm_loss(guess, &b.next, self.obs, &mut self.norms, &mut self.d)
    }

    fn inverse_loss(&mut self, b: &Batch<T>) -> f64 {
        beside(&b.obs, self.obs, &b.next, self.obs, &mut self.x);
        let guess = self.inverse.forward(&self.x, b.rows, &mut self.tape);
        norm_loss(guess, &b.action, self.act, &mut self.norms, &mut self.d)
    }

    /// Reward of each transition.
    pub(crate) fn reward(&mut self, batch: &Batch<T>, out: &mut Vec<T>) {
        self.forward_loss(batch);
        out.clear();
        out.extend(self.norms.iter().map(|n| T::of(n.f64().ln_1p())));
    }
}

impl<T: Real> Keep<T> for Icm<T> {
    fn keep(&mut self, visit: &mut dyn FnMut(&str, Field<'_, T>)) {
        visit("icm.forward", Field::Reals(&mut self.forward.params));
        visit("icm.inverse", Field::Reals(&mut self.inverse.params));
        self.forward_adam.keep_as("icm.forward_adam", visit);
        self.inverse_adam.keep_as("icm.inverse_adam", visit);
    }
}

#[cfg(test)]
mod tests {
    use super::super::mlp::tests::{check_gradient, noise};
    use super::*;

    fn batch() -> Batch<f64> {
        let obs = noise(12 * 4, 1);
        let action: Vec<f64> = noise(12 * 2, 2).iter().map(|x| x.tanh()).collect();
        let next = obs.iter().zip(noise(12 * 4, 3)).map(|(s, n)| s + 0.3 * n).collect();
        Batch { rows: 12, obs, action, next, skill: Vec::new() }
    }

    #[test]
    fn loss_gradients() {
        let (b, mut icm) = (batch(), Icm::<f64>::new(4, 2, 8, 3));
        icm.forward_loss(&b);
        let (mut d, mut g) = (icm.d.clone(), vec![0.0; icm.forward.params.len()]);
        icm.forward.backward(&mut icm.tape, &mut d, Some(&mut g), false);
        let mut p = icm.forward.params.clone();
        check_gradient("icm forward", &mut p, &g, 3, |p| {
            icm.forward.params.copy_from_slice(p);
            icm.forward_loss(&b)
        });
        icm.inverse_loss(&b);
        let (mut d, mut g) = (icm.d.clone(), vec![0.0; icm.inverse.params.len()]);
        icm.inverse.backward(&mut icm.tape, &mut d, Some(&mut g), false);
        let mut p = icm.inverse.params.clone();
        check_gradient("icm inverse", &mut p, &g, 3, |p| {
            icm.inverse.params.copy_from_slice(p);
            icm.inverse_loss(&b)
        });
    }

    #[test]
    fn predictable_pays_less() {
        let (b, mut icm) = (batch(), Icm::<f64>::new(4, 2, 32, 3));
        let (mut first, mut last) = (Vec::new(), Vec::new());
        icm.reward(&b, &mut first);
        for _ in 0..500 {
            icm.update(&b, 1e-3);
        }
        icm.reward(&b, &mut last);
        assert!(last.iter().sum::<f64>() < 0.5 * first.iter().sum::<f64>());
        assert!(first.iter().zip(&last).all(|(a, b)| a.is_finite() && *b >= 0.0));
    }
}
