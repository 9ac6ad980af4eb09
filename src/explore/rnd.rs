//! RND: random network distillation (Burda et al. 2018, arXiv 1810.12894; state-based form
//! of URLB). A predictor f learns to match a frozen random network f*; its error is the reward,
//! large in new states.
//!
//! ```text
//! x    = clip(batch-normalised s, +-5)             no learned gain or bias
//! loss = mean over batch and outputs of (f(x) - f*(x))^2
//! r    = mean_j (f_j - f*_j)^2 / (sqrt(S) + 1e-8)    S: running variance of the error
//! ```

use super::batch::Batch;
use super::mlp::{Adam, Layer, Mlp, Tape};
use super::particle::Rms;
use super::state::{Field, Keep};
use robert_linalg::{Real, simd};

/// Outputs of both networks.
const OUTPUTS: usize = 512;
/// Bound of normalised observations.
const CLIP: f64 = 5.0;
/// Variance floor of batch normalisation.
const EPS: f64 = 1e-5;

/// The pair of networks and the scale of their disagreement.
#[derive(Clone, Debug)]
pub(crate) struct Rnd<T> {
    obs: usize,
    predictor: Mlp<T>,
    target: Mlp<T>,
    adam: Adam<T>,
    error: Rms,
    tape: Tape<T>,
    other: Tape<T>,
    x: Vec<T>,
    d: Vec<T>,
}

impl<T: Real> Rnd<T> {
    /// For `obs` inputs and hidden width `h`.
    pub(crate) fn new(obs: usize, h: usize, seed: u64) -> Self {
        let layers = [
            Layer::Linear(obs, h),
            Layer::Relu(h),
            Layer::Linear(h, h),
            Layer::Relu(h),
            Layer::Linear(h, OUTPUTS),
        ];
        let predictor = Mlp::new(&layers, seed, 100);
        Rnd {
            obs,
            adam: Adam::new(predictor.params.len()),
            target: Mlp::new(&layers, seed, 200),
            predictor,
            error: Rms::default(),
            tape: Tape::default(),
            other: Tape::default(),
            x: Vec::new(),
            d: Vec::new(),
        }
    }

    /// One step of the predictor on s; returns the loss.
    pub(crate) fn update(&mut self, batch: &Batch<T>, lr: f64) -> f64 {
        normalise(&batch.obs, self.obs, &mut self.x);
        self.target.forward(&self.x, batch.rows, &mut self.other);
        let loss = self.loss(batch.rows);
        self.predictor.backward(&mut self.tape, &mut self.d, Some(&mut self.adam.grads), false);
        self.adam.step(&mut self.predictor.params, lr);
        loss
    }

    /// Forward pass of the predictor on `x`; leaves the loss gradient in `d`.
    fn loss(&mut self, rows: usize) -> f64 {
        let f = self.predictor.forward(&self.x, rows, &mut self.tape);
        let goal = self.other.output();
        let scale = T::of(2.0 / (rows * OUTPUTS) as f64);
        self.d.clear();
        self.d.extend(f.iter().zip(goal).map(|(&a, &b)| (a - b) * scale));
        simd::distance2(f, goal).f64() / (rows * OUTPUTS) as f64
    }

    /// Reward of each transition, after the step on the same batch; it reuses the normalised input
    /// and the frozen network's output.
    pub(crate) fn reward(&mut self, batch: &Batch<T>, out: &mut Vec<T>) {
        let f = self.predictor.forward(&self.x, batch.rows, &mut self.tape);
        out.clear();
        out.extend(
            f.chunks_exact(OUTPUTS)
                .zip(self.other.output().chunks_exact(OUTPUTS))
                .map(|(a, b)| simd::distance2(a, b) * T::of(1.0 / OUTPUTS as f64)),
        );
        self.error.add(out);
        let scale = T::of(1.0 / (self.error.std() + 1e-8));
        for r in out {
            *r = *r * scale;
        }
    }
}

/// Each column with the batch's own mean and (biased) variance, clipped.
fn normalise<T: Real>(x: &[T], cols: usize, out: &mut Vec<T>) {
    let rows = (x.len() / cols).max(1) as f64;
    let (mut mean, mut var) = (vec![0.0; cols], vec![0.0; cols]);
    for row in x.chunks_exact(cols) {
        mean.iter_mut().zip(row).for_each(|(m, v)| *m += v.f64() / rows);
    }
    for row in x.chunks_exact(cols) {
        for ((s, m), v) in var.iter_mut().zip(&mean).zip(row) {
            *s += (v.f64() - m).powi(2) / rows;
        }
    }
    let scale: Vec<f64> = var.iter().map(|v| 1.0 / (v + EPS).sqrt()).collect();
    out.clear();
    for row in x.chunks_exact(cols) {
        out.extend(
            row.iter()
                .zip(&mean)
                .zip(&scale)
                .map(|((v, m), s)| T::of(((v.f64() - m) * s).clamp(-CLIP, CLIP))),
        );
    }
}

impl<T: Real> Keep<T> for Rnd<T> {
    fn keep(&mut self, visit: &mut dyn FnMut(&str, Field<'_, T>)) {
        visit("rnd.predictor", Field::Reals(&mut self.predictor.params));
        self.adam.keep_as("rnd.adam", visit);
        visit("rnd.error", Field::Doubles(&mut self.error.state));
    }
}

#[cfg(test)]
mod tests {
    use super::super::mlp::tests::{check_gradient, noise};
    use super::*;

    fn batch(rows: usize) -> Batch<f64> {
        Batch { rows, obs: noise(rows * 4, 1), ..Batch::default() }
    }

    #[test]
    fn loss_gradient() {
        let (b, mut rnd) = (batch(9), Rnd::<f64>::new(4, 8, 3));
        normalise(&b.obs, 4, &mut rnd.x);
        rnd.target.forward(&rnd.x, 9, &mut rnd.other);
        rnd.loss(9);
        let mut g = vec![0.0; rnd.predictor.params.len()];
        let mut d = rnd.d.clone();
        rnd.predictor.backward(&mut rnd.tape, &mut d, Some(&mut g), false);
        let mut params = rnd.predictor.params.clone();
        check_gradient("rnd", &mut params, &g, 7, |p| {
            rnd.predictor.params.copy_from_slice(p);
            rnd.loss(9)
        });
    }

    #[test]
    fn input_is_batch_normalised() {
        let mut out = Vec::new();
        normalise(&[1.0, 5.0, 3.0, 5.0_f64], 2, &mut out);
        assert!((out[0] + 1.0).abs() < 1e-4 && (out[2] - 1.0).abs() < 1e-4);
        assert_eq!((out[1], out[3]), (0.0, 0.0));
        let mut wide = vec![0.0; 100];
        wide[0] = 1e6;
        normalise(&wide, 1, &mut out);
        assert_eq!(out[0], CLIP);
    }

    #[test]
    fn familiar_states_lose_their_reward() {
        let (old, mut rnd) = (batch(64), Rnd::<f64>::new(4, 32, 3));
        let mut r = Vec::new();
        let first = rnd.update(&old, 1e-3);
        for _ in 0..300 {
            rnd.update(&old, 1e-3);
        }
        let last = rnd.update(&old, 1e-3);
        assert!(last < 0.2 * first, "{first} {last}");
        // In one batch, new states get a larger reward than states seen 300 times.
        let mut both = old.clone();
        both.obs[..32 * 4].copy_from_slice(&noise(32 * 4, 9));
        normalise(&both.obs, 4, &mut rnd.x);
        rnd.target.forward(&rnd.x, 64, &mut rnd.other);
        rnd.reward(&both, &mut r);
        let (new, seen) = r.split_at(32);
        let ratio = new.iter().sum::<f64>() / seen.iter().sum::<f64>();
        assert!(ratio > 1.5, "{ratio}");
    }
}
