//! Proto: prototypical representations (Yarats et al. 2021, arXiv 2102.11271; state-based
//! form of URLB). Prototypes spread over the visited states, and states far from the candidates
//! that they select are rewarded.
//!
//! ```text
//! u    = C normalize(proj(pred(s))) / 0.1          online scores over 512 prototypes
//! q    = sinkhorn(C normalize(pred'(s')) / 0.1)     target, 3 iterations
//! loss = -mean sum q log softmax(u)
//! r    = distance of normalize(pred(s')) to its 3rd nearest entry of a queue of 2048,
//!        which each update extends by 512 candidates: one per prototype, drawn from the
//!        batch by softmax of its scores (no temperature)
//! ```
//!
//! pred' follows pred with share .05. Prototypes C (512, 128) have rows of unit length.

use super::batch::Batch;
use super::mlp::{Adam, Layer, Mlp, Tape};
use super::particle::Neighbours;
use super::state::{Field, Keep};
use robert_base::rng::{Rng, Stream};
use robert_linalg::{Init, Mat, MatMut, Real, gemm, simd};

/// Width of the representation.
const REP: usize = 128;
/// Hidden width of the projector.
const PROJECT: usize = 512;
/// Prototypes.
const PROTOS: usize = 512;
/// Candidates remembered.
const QUEUE: usize = 2048;
/// Temperature of the scores.
const TAU: f64 = 0.1;
/// The neighbour in the queue that determines the reward: the third nearest.
const NEIGHBOUR: usize = 3;
/// Sinkhorn iterations.
const ITERATIONS: usize = 3;
/// Share by which the target follows.
const FOLLOW: f64 = 0.05;

/// Sizes; the published ones unless a test shrinks them.
#[derive(Clone, Copy, Debug)]
struct Sizes {
    rep: usize,
    project: usize,
    protos: usize,
    queue: usize,
}

/// Predictor, projector, prototypes, and the queue of candidates.
#[derive(Clone, Debug)]
pub(crate) struct Proto<T> {
    sizes: Sizes,
    predictor: Mlp<T>,
    target: Mlp<T>,
    projector: Mlp<T>,
    /// (protos, rep).
    protos: Vec<T>,
    /// Predictor, projector, prototypes.
    adams: [Adam<T>; 3],
    /// (queue, rep).
    queue: Vec<T>,
    queue_at: u64,
    tapes: [Tape<T>; 3],
    unit: Vec<T>,
    scores: Vec<T>,
    goal: Vec<T>,
    d: Vec<T>,
    neighbours: Neighbours<T>,
}

impl<T: Real> Proto<T> {
    /// For `obs` states.
    pub(crate) fn new(obs: usize, seed: u64) -> Self {
        let sizes = Sizes { rep: REP, project: PROJECT, protos: PROTOS, queue: QUEUE };
        Self::with_sizes(obs, sizes, seed)
    }

    fn with_sizes(obs: usize, sizes: Sizes, seed: u64) -> Self {
        let Sizes { rep, project, protos: count, queue } = sizes;
        let predictor = Mlp::new(&[Layer::Linear(obs, rep)], seed, 100);
        let projector = Mlp::new(
            &[Layer::Linear(rep, project), Layer::Relu(project), Layer::Linear(project, rep)],
            seed,
            200,
        );
        let mut protos = Mlp::<T>::new(&[Layer::Linear(rep, count)], seed, 300).params;
        protos.truncate(count * rep);
        let adams = [predictor.params.len(), projector.params.len(), protos.len()].map(Adam::new);
        Proto {
            sizes,
            target: predictor.clone(),
            predictor,
            projector,
            protos,
            adams,
            queue: vec![T::default(); queue * rep],
            queue_at: 0,
            tapes: Default::default(),
            unit: Vec::new(),
            scores: Vec::new(),
            goal: Vec::new(),
            d: Vec::new(),
            neighbours: Neighbours::default(),
        }
    }

    /// One step of predictor, projector and prototypes; returns the loss.
    pub(crate) fn update(&mut self, batch: &Batch<T>, lr: f64) -> f64 {
        normalise_rows(&mut self.protos, self.sizes.rep);
        let loss = self.gradients(batch);
        let [a, b, c] = &mut self.adams;
        a.step(&mut self.predictor.params, lr);
        b.step(&mut self.projector.params, lr);
        c.step(&mut self.protos, lr);
        loss
    }

    fn gradients(&mut self, batch: &Batch<T>) -> f64 {
        let Sizes { rep, protos: count, .. } = self.sizes;
        let rows = batch.rows;
        let [online, projected, target] = &mut self.tapes;

        // Target assignment, without gradient.
        self.unit.clear();
        self.unit.extend_from_slice(self.target.forward(&batch.next, rows, target));
        normalise_rows(&mut self.unit, rep);
        scores(&self.unit, &self.protos, rep, &mut self.goal);
        sinkhorn(&mut self.goal, count);

        let s = self.predictor.forward(&batch.obs, rows, online);
        let z = self.projector.forward(s, rows, projected);
        self.unit.clear();
        self.unit.extend_from_slice(z);
        let norms = normalise_rows(&mut self.unit, rep);
        scores(&self.unit, &self.protos, rep, &mut self.scores);

        // Cross entropy; its gradient by the scores is (softmax * sum q - q) / (TAU rows).
        let mut loss = 0.0;
        let scale = T::of(1.0 / (TAU * rows as f64));
        for (u, q) in self.scores.chunks_exact_mut(count).zip(self.goal.chunks_exact(count)) {
            let top = u.iter().map(|v| v.f64()).fold(f64::MIN, f64::max);
            let along = simd::dot(u, q).f64();
            let mass = q.iter().map(|v| v.f64()).sum::<f64>();
            let sum = simd::exp_sum(u, T::of(1.0 / TAU), T::of(top)).f64();
            loss -= (along - mass * top) / TAU - mass * sum.ln();
            let share = T::of(mass / sum);
            for (u, &q) in u.iter_mut().zip(q) {
                *u = (*u * share - q) * scale;
            }
        }
        // dC = dscores^T unit; dunit = dscores C.
        gemm(
            MatMut::new(&mut self.adams[2].grads, count, rep),
            Init::Add,
            Mat::new(&self.scores, rows, count).t(),
            Mat::new(&self.unit, rows, rep),
        );
        self.d.resize(rows * rep, T::default());
        gemm(
            MatMut::new(&mut self.d, rows, rep),
            Init::Zero,
            Mat::new(&self.scores, rows, count),
            Mat::new(&self.protos, count, rep),
        );
        // Through the normalisation: (d - (d . u) u) / |z|.
        for ((d, u), &norm) in
            self.d.chunks_exact_mut(rep).zip(self.unit.chunks_exact(rep)).zip(&norms)
        {
            let along = simd::dot(d, u);
            let inv = T::of(1.0 / norm);
            d.iter_mut().zip(u).for_each(|(d, &u)| *d = (*d - along * u) * inv);
        }
        let [first, second, _] = &mut self.adams;
        self.projector.backward(projected, &mut self.d, Some(&mut second.grads), true);
        self.predictor.backward(online, &mut self.d, Some(&mut first.grads), false);
        loss / rows as f64
    }

    /// Reward of each transition; extends the queue and lets the target follow. Candidates
    /// are drawn from (seed, index).
    pub(crate) fn reward(&mut self, batch: &Batch<T>, seed: u64, index: u64, out: &mut Vec<T>) {
        let Sizes { rep, protos: count, queue, .. } = self.sizes;
        let rows = batch.rows;
        // The update changed their lengths slightly, which must not affect the scores.
        normalise_rows(&mut self.protos, rep);
        self.unit.clear();
        self.unit.extend_from_slice(self.predictor.forward(&batch.next, rows, &mut self.tapes[0]));
        normalise_rows(&mut self.unit, rep);
        // (protos, rows): row p holds the batch's scores for prototype p.
        scores(&self.protos, &self.unit, rep, &mut self.scores);
        let mut rng = Rng::new(seed, Stream::Skill, index);
        for p in self.scores.chunks_exact_mut(rows).take(count) {
            let top = p.iter().map(|v| v.f64()).fold(f64::MIN, f64::max);
            let sum = simd::exp_sum(p, T::of(1.0), T::of(top)).f64();
            let mut left = rng.uniform() * sum;
            let chosen = p.iter().position(|v| {
                left -= v.f64();
                left < 0.0
            });
            let from = chosen.unwrap_or(rows - 1) * rep;
            let to = (self.queue_at % queue as u64) as usize * rep;
            self.queue[to..to + rep].copy_from_slice(&self.unit[from..from + rep]);
            self.queue_at += 1;
        }
        let d = self.neighbours.nearest(&self.unit, &self.queue, rep, NEIGHBOUR, false);
        out.clear();
        out.extend(d.chunks_exact(NEIGHBOUR).map(|row| row[NEIGHBOUR - 1]));
        simd::follow(&mut self.target.params, &self.predictor.params, T::of(FOLLOW));
    }
}

/// (a rows, b rows) inner products of rows.
fn scores<T: Real>(a: &[T], b: &[T], cols: usize, out: &mut Vec<T>) {
    let (n, m) = (a.len() / cols, b.len() / cols);
    out.resize(n * m, T::default());
    gemm(MatMut::new(out, n, m), Init::Zero, Mat::new(a, n, cols), Mat::new(b, m, cols).t());
}

/// x = x by.
fn scale<T: Real>(x: &mut [T], by: T) {
    for v in x {
        *v = *v * by;
    }
}

/// Scales each row to unit length; returns the lengths (at least 1e-12).
fn normalise_rows<T: Real>(x: &mut [T], cols: usize) -> Vec<f64> {
    x.chunks_exact_mut(cols)
        .map(|row| {
            let norm = simd::dot(row, row).f64().sqrt().max(1e-12);
            let inv = T::of(1.0 / norm);
            scale(row, inv);
            norm
        })
        .collect()
}

/// Balanced soft assignment (Cuturi 2013): exp(x / TAU), then rows (samples) and columns
/// (prototypes) are scaled in turn to uniform masses; at the end each row sums to 1.
fn sinkhorn<T: Real>(x: &mut [T], cols: usize) {
    let rows = x.len() / cols;
    let top = x.iter().map(|v| v.f64()).fold(f64::MIN, f64::max);
    let total = simd::exp_sum(x, T::of(1.0 / TAU), T::of(top));
    let inv = T::of(1.0 / total.f64());
    scale(x, inv);
    for _ in 0..ITERATIONS {
        let mut sums = vec![T::default(); cols];
        for row in x.chunks_exact(cols) {
            sums.iter_mut().zip(row).for_each(|(s, &v)| *s += v);
        }
        // A prototype without mass would scale by infinity; it takes the largest finite scale.
        let mut shares: Vec<f64> = sums.iter().map(|s| 1.0 / (cols as f64 * s.f64())).collect();
        let most = shares.iter().copied().filter(|s| s.is_finite()).fold(0.0, f64::max);
        shares.iter_mut().filter(|s| !s.is_finite()).for_each(|s| *s = most);
        let shares: Vec<T> = shares.into_iter().map(T::of).collect();
        for row in x.chunks_exact_mut(cols) {
            row.iter_mut().zip(&shares).for_each(|(v, &k)| *v = *v * k);
            let sum = row.iter().map(|v| v.f64()).sum::<f64>();
            let k = T::of(1.0 / (rows as f64 * sum.max(f64::MIN_POSITIVE)));
            scale(row, k);
        }
    }
    for row in x.chunks_exact_mut(cols) {
        let k = T::of(1.0 / row.iter().map(|v| v.f64()).sum::<f64>().max(f64::MIN_POSITIVE));
        scale(row, k);
    }
}

impl<T: Real> Keep<T> for Proto<T> {
    fn keep(&mut self, visit: &mut dyn FnMut(&str, Field<'_, T>)) {
        visit("proto.predictor", Field::Reals(&mut self.predictor.params));
        visit("proto.target", Field::Reals(&mut self.target.params));
        visit("proto.projector", Field::Reals(&mut self.projector.params));
        visit("proto.protos", Field::Reals(&mut self.protos));
        visit("proto.queue", Field::Reals(&mut self.queue));
        visit("proto.queue_at", Field::Count(&mut self.queue_at));
        let names = ["proto.predictor_adam", "proto.projector_adam", "proto.protos_adam"];
        for (adam, name) in self.adams.iter_mut().zip(names) {
            adam.keep_as(name, visit);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::mlp::tests::{check_gradient, noise};
    use super::*;

    fn small() -> Proto<f64> {
        Proto::with_sizes(4, Sizes { rep: 6, project: 9, protos: 7, queue: 40 }, 3)
    }

    fn batch(rows: usize) -> Batch<f64> {
        Batch { rows, obs: noise(rows * 4, 1), next: noise(rows * 4, 2), ..Batch::default() }
    }

    #[test]
    fn sinkhorn_by_hand() {
        // Two samples, two prototypes, both prefer the first one.
        let mut x = [0.1, 0.0, 0.05, 0.0_f64];
        sinkhorn(&mut x, 2);
        // The same in plain steps.
        let mut q = [1.0_f64, (-1.0_f64).exp(), (-0.5_f64).exp(), (-1.0_f64).exp()];
        for _ in 0..3 {
            let (a, b) = (q[0] + q[2], q[1] + q[3]);
            q = [q[0] / a, q[1] / b, q[2] / a, q[3] / b];
            let (c, d) = (q[0] + q[1], q[2] + q[3]);
            q = [q[0] / c, q[1] / c, q[2] / d, q[3] / d];
        }
        assert!(x.iter().zip(q).all(|(a, b)| (a - b).abs() < 1e-12), "{x:?} {q:?}");
        assert!((x[0] + x[1] - 1.0).abs() < 1e-12);
    }

    #[test]
    fn loss_gradients() {
        let (b, mut p) = (batch(9), small());
        normalise_rows(&mut p.protos, 6);
        p.gradients(&b);
        let grads: Vec<Vec<f64>> = p.adams.iter().map(|a| a.grads.clone()).collect();
        let mut x = p.predictor.params.clone();
        let keep = p.target.params.clone();
        check_gradient("predictor", &mut x, &grads[0], 1, |x| {
            p.predictor.params.copy_from_slice(x);
            p.target.params.copy_from_slice(&keep);
            p.gradients(&b)
        });
        let mut x = p.projector.params.clone();
        check_gradient("projector", &mut x, &grads[1], 3, |x| {
            p.projector.params.copy_from_slice(x);
            p.gradients(&b)
        });
    }

    #[test]
    fn prototype_gradient() {
        // Prototypes also shape the target q, which carries no gradient: hold it fixed by
        // checking the cross entropy alone.
        let (b, mut p) = (batch(5), small());
        normalise_rows(&mut p.protos, 6);
        p.gradients(&b);
        let (q, unit, grad) = (p.goal.clone(), p.unit.clone(), p.adams[2].grads.clone());
        let mut c = p.protos.clone();
        check_gradient("prototypes", &mut c, &grad, 1, |c| {
            let mut u = Vec::new();
            scores(&unit, c, 6, &mut u);
            u.chunks(7).zip(q.chunks(7)).fold(0.0, |sum, (u, q)| {
                let log = u.iter().map(|v| (v / TAU).exp()).sum::<f64>().ln();
                sum - u.iter().zip(q).map(|(u, q)| q * (u / TAU - log)).sum::<f64>() / 5.0
            })
        });
    }

    #[test]
    fn queue_fills_and_far_states_earn_more() {
        let (mut b, mut p) = (batch(30), small());
        let mut r = Vec::new();
        for i in 0..20 {
            p.update(&b, 1e-3);
            p.reward(&b, 1, i, &mut r);
        }
        assert_eq!(p.queue_at, 140);
        let usual = r.iter().sum::<f64>() / 30.0;
        b.next[..4].copy_from_slice(&[9.0, -9.0, 9.0, 9.0]);
        p.reward(&b, 1, 99, &mut r);
        assert!(r[0] > usual, "{} {usual}", r[0]);
        let (mut plain, mut longer, mut q) = (small(), small(), Vec::new());
        for p in [&mut plain, &mut longer] {
            p.update(&b, 1e-3);
        }
        longer.protos.iter_mut().for_each(|x| *x *= 8.0);
        plain.reward(&b, 1, 0, &mut r);
        longer.reward(&b, 1, 0, &mut q);
        assert_eq!((&plain.queue, &r), (&longer.queue, &q), "only directions of prototypes count");
        let mut again = small();
        again.update(&b, 1e-3);
        assert!(again.predictor.params != again.target.params);
    }
}
