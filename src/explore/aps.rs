//! APS: active pre-training with successor features (Liu and Abbeel 2021, arXiv
//! 2108.13956; as in URLB). Skills are directions w in a learned feature space. The agent is
//! rewarded for moving along w and for reaching rarely visited places.
//!
//! ```text
//! phi(s) = net(s) / |net(s)|, 10 wide;   w uniform on the unit sphere
//! loss   = -mean w . phi(s')
//! r      = particle entropy of net(s') (k = 12, running mean, clip 1e-4) + w . phi(s')
//! Q(s, a, w) = w . psi(s, a, w)          the critic's heads give psi in R^10
//! ```

use super::batch::Batch;
use super::mlp::{Adam, Layer, Mlp, Tape};
use super::particle::{Neighbours, Pbe, Rms};
use super::state::{Field, Keep};
use robert_base::rng::Rng;
use robert_linalg::{Real, simd};

/// Length of skills and features.
pub(crate) const SKILL: usize = 10;
/// Environment steps for which a skill is kept.
pub(crate) const SKILL_STEPS: u64 = 5;
/// The entropy part's settings.
const PBE: Pbe = Pbe { k: 12, clip: 1e-4, rms: true };

/// The feature network.
#[derive(Clone, Debug)]
pub(crate) struct Aps<T> {
    phi: Mlp<T>,
    adam: Adam<T>,
    distance: Rms,
    tape: Tape<T>,
    d: Vec<T>,
    neighbours: Neighbours<T>,
}

/// A skill: uniform on the unit sphere of R^10.
pub(crate) fn skill(rng: &mut Rng) -> [f64; SKILL] {
    let mut w = [0.0; SKILL];
    for x in &mut w {
        *x = rng.normal();
    }
    let norm = simd::dot(&w, &w).sqrt().max(1e-12);
    w.map(|x| x / norm)
}

impl<T: Real> Aps<T> {
    /// For `obs` states and hidden width `h`.
    pub(crate) fn new(obs: usize, h: usize, seed: u64) -> Self {
        let phi = Mlp::new(
            &[
                Layer::Linear(obs, h),
                Layer::Relu(h),
                Layer::Linear(h, h),
                Layer::Relu(h),
                Layer::Linear(h, SKILL),
            ],
            seed,
            100,
        );
        Aps {
            adam: Adam::new(phi.params.len()),
            phi,
            distance: Rms::default(),
            tape: Tape::default(),
            d: Vec::new(),
            neighbours: Neighbours::default(),
        }
    }

    /// One step of the features; returns the loss.
    pub(crate) fn update(&mut self, batch: &Batch<T>, lr: f64) -> f64 {
        let loss = self.loss(batch);
        self.phi.backward(&mut self.tape, &mut self.d, Some(&mut self.adam.grads), false);
        self.adam.step(&mut self.phi.params, lr);
        loss
    }

    fn loss(&mut self, b: &Batch<T>) -> f64 {
        let y = self.phi.forward(&b.next, b.rows, &mut self.tape);
        let scale = 1.0 / b.rows as f64;
        let mut sum = 0.0;
        self.d.clear();
        for (y, w) in y.chunks_exact(SKILL).zip(b.skill.chunks_exact(SKILL)) {
            let (norm, along) = project(y, w);
            sum += along;
            // d(w . y / |y|) = (w - (w . phi) phi) / |y|
            self.d.extend(
                y.iter()
                    .zip(w)
                    .map(|(&y, &w)| T::of(-scale * (w.f64() - along * y.f64() / norm) / norm)),
            );
        }
        -sum * scale
    }

    /// Reward of each transition.
    pub(crate) fn reward(&mut self, batch: &Batch<T>, out: &mut Vec<T>) {
        let y = self.phi.forward(&batch.next, batch.rows, &mut self.tape);
        PBE.reward(y, SKILL, &mut self.distance, &mut self.neighbours, out);
        let rows = y.chunks_exact(SKILL).zip(batch.skill.chunks_exact(SKILL));
        for (r, (y, w)) in out.iter_mut().zip(rows) {
            *r += T::of(project(y, w).1);
        }
    }
}

/// |y| (at least 1e-12, as `PyTorch`'s normalize) and w . y / |y|.
fn project<T: Real>(y: &[T], w: &[T]) -> (f64, f64) {
    let norm = simd::dot(y, y).f64().sqrt().max(1e-12);
    (norm, simd::dot(y, w).f64() / norm)
}

impl<T: Real> Keep<T> for Aps<T> {
    fn keep(&mut self, visit: &mut dyn FnMut(&str, Field<'_, T>)) {
        visit("aps.phi", Field::Reals(&mut self.phi.params));
        self.adam.keep_as("aps.adam", visit);
        visit("aps.distance", Field::Doubles(&mut self.distance.state));
    }
}

#[cfg(test)]
mod tests {
    use super::super::mlp::tests::{check_gradient, noise};
    use super::*;
    use robert_base::rng::Stream;

    fn batch(rows: usize) -> Batch<f64> {
        let skill = (0..rows as u64).flat_map(|i| skill(&mut Rng::new(1, Stream::Test, i)));
        Batch { rows, next: noise(rows * 4, 3), skill: skill.collect(), ..Batch::default() }
    }

    #[test]
    fn loss_gradient() {
        let (b, mut aps) = (batch(9), Aps::<f64>::new(4, 8, 3));
        aps.loss(&b);
        let (mut d, mut g) = (aps.d.clone(), vec![0.0; aps.phi.params.len()]);
        aps.phi.backward(&mut aps.tape, &mut d, Some(&mut g), false);
        let mut p = aps.phi.params.clone();
        check_gradient("aps", &mut p, &g, 3, |p| {
            aps.phi.params.copy_from_slice(p);
            aps.loss(&b)
        });
    }

    #[test]
    fn skills_lie_on_the_sphere_and_features_learn_them() {
        let b = batch(64);
        for w in b.skill.chunks_exact(SKILL) {
            assert!((simd::dot(w, w) - 1.0).abs() < 1e-12);
        }
        let mut aps = Aps::<f64>::new(4, 64, 3);
        let first = aps.update(&b, 1e-3);
        for _ in 0..300 {
            aps.update(&b, 1e-3);
        }
        let last = aps.update(&b, 1e-3);
        assert!(last < -0.6 && first > -0.3, "{first} {last}");
        let mut r = Vec::new();
        aps.reward(&b, &mut r);
        assert!(r.iter().all(|r| r.is_finite() && *r > -1.0));
    }
}
