//! One optimiser step on all cores, with bits that do not depend on their number.
//!
//! A batch is divided into micro-batches (which stay in the cache), and these are distributed over
//! a fixed number of gradient accumulators. Threads take accumulators from a queue. Accumulators
//! are summed pairwise in a fixed tree. So one thread or eight add the same numbers in the same
//! order. Rejected: one gradient per micro-batch (16 × 19 MB at 4.7 M parameters, without benefit)
//! and one per thread (bits would depend on the machine).

use std::sync::{Mutex, PoisonError};

use super::batch::Batch;
use super::head::Sums;
use super::model::{Arena, Net, Panels, backward, forward, score};
use robert_linalg::{
    Aligned, Real, next_of, on_threads,
    simd::{self, AdamStep},
};

/// The most accumulators; more cores than this do not speed up one step.
pub const ACCUMULATORS: usize = 8;
/// The most windows in a micro-batch.
const MICRO: usize = 16;
/// Weights per piece of the update.
const PIECE: usize = 1 << 16;

/// The settings of `AdamW` from Behaviour Transformers.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AdamConfig {
    /// Decay of the first moment.
    pub beta1: f64,
    /// Decay of the second moment.
    pub beta2: f64,
    /// Added to the root of the second moment.
    pub eps: f64,
    /// Weight decay, on the weights of linear maps only.
    pub weight_decay: f64,
    /// Largest norm of the gradient.
    pub clip: f64,
}

impl Default for AdamConfig {
    fn default() -> Self {
        AdamConfig { beta1: 0.9, beta2: 0.95, eps: 1e-8, weight_decay: 0.1, clip: 1.0 }
    }
}

/// Loss and gradient of a batch, before the update.
#[derive(Clone, Copy, Debug)]
pub struct GradientView {
    /// Loss and errors over the batch.
    pub sums: Sums,
    /// Norm of the gradient before clipping.
    pub grad_norm: f64,
}

impl GradientView {
    /// Whether a step can follow.
    pub fn is_finite(&self) -> bool {
        self.sums.loss.is_finite() && self.grad_norm.is_finite()
    }
}

/// The result of one step.
#[derive(Clone, Copy, Debug)]
pub struct StepReport {
    /// Loss and errors over the batch.
    pub sums: Sums,
    /// Norm of the gradient before clipping.
    pub grad_norm: f64,
    /// False if loss or gradient was not finite; the weights are then unchanged.
    pub applied: bool,
}

/// Network, optimiser and the memory of a training step.
#[derive(Debug)]
pub struct Learner<T: Real> {
    /// The network.
    pub net: Net<T>,
    /// First moment, laid out as the weights.
    pub first: Aligned<T>,
    /// Second moment.
    pub second: Aligned<T>,
    /// Steps applied.
    pub count: u64,
    /// Optimiser.
    pub adam: AdamConfig,
    /// Loss at the current frame alone instead of all 51.
    pub current_only: bool,
    batch: usize,
    micro: usize,
    threads: usize,
    panels: Panels<T>,
    accumulators: Vec<Accumulator<T>>,
    /// All accumulators but the first are zero.
    clean: bool,
    workers: Vec<Worker<T>>,
}

#[derive(Debug)]
struct Accumulator<T: Real> {
    grads: Aligned<T>,
    sums: Sums,
    /// Micro-batches `first..end`.
    first: usize,
    end: usize,
}

#[derive(Debug)]
struct Worker<T: Real> {
    arena: Arena<T>,
    batch: Batch<T>,
}

impl<T: Real> Learner<T> {
    /// Memory for steps of `batch` windows on `threads` threads.
    pub fn new(net: Net<T>, adam: AdamConfig, batch: usize, threads: usize) -> Self {
        let batch = batch.max(1);
        let micro = MICRO.min(batch.div_ceil(2));
        let micros = batch.div_ceil(micro);
        let accumulators = ACCUMULATORS.min(micros);
        let threads = threads.clamp(1, accumulators);
        let len = net.layout.len;
        Learner {
            first: Aligned::zeros(len),
            second: Aligned::zeros(len),
            count: 0,
            adam,
            current_only: false,
            batch,
            micro,
            threads,
            panels: Panels::new(&net),
            clean: true,
            accumulators: (0..accumulators)
                .map(|i| Accumulator {
                    grads: Aligned::zeros(len),
                    sums: Sums::default(),
                    first: micros * i / accumulators,
                    end: micros * (i + 1) / accumulators,
                })
                .collect(),
            workers: (0..threads)
                .map(|_| Worker {
                    arena: Arena::new(&net.cfg, micro),
                    batch: Batch::zeros(&net.cfg, micro),
                })
                .collect(),
            net,
        }
    }

    /// Windows in a step.
    pub fn batch(&self) -> usize {
        self.batch
    }

    /// Loss and gradient of one batch; `fill(w, slot, batch)` writes window w of 0..batch
    /// into `slot`. The sum of the gradients is [`Learner::gradient`].
    pub fn gradients(&mut self, fill: &(impl Fn(usize, usize, &mut Batch<T>) + Sync)) -> Sums {
        self.pass(fill, true)
    }

    fn pass(
        &mut self,
        fill: &(impl Fn(usize, usize, &mut Batch<T>) + Sync),
        gradients: bool,
    ) -> Sums {
        let clean = self.clean;
        self.clean &= !gradients;
        let Learner {
            net, panels, accumulators, workers, batch, micro, threads, current_only, ..
        } = self;
        let (batch, micro, current_only) = (*batch, *micro, *current_only);
        let tokens = if current_only { 1 } else { super::config::WINDOW };
        let scale = 1.0 / (batch * tokens) as f64;
        let workers: Vec<_> = workers.iter_mut().map(Mutex::new).collect();
        let queue = Mutex::new(accumulators.iter_mut().enumerate());
        on_threads(*threads, |t| {
            let mut worker = workers[t].lock().unwrap_or_else(PoisonError::into_inner);
            let Worker { arena, batch: windows } = &mut **worker;
            while let Some((index, part)) = next_of(&queue) {
                if gradients && !(clean && index > 0) {
                    part.grads.fill(T::default());
                }
                part.sums = Sums::default();
                for m in part.first..part.end {
                    let first = m * micro;
                    windows.count = micro.min(batch - first);
                    for slot in 0..windows.count {
                        fill(first + slot, slot, windows);
                    }
                    forward(net, panels, windows, arena);
                    let sums = if gradients {
                        backward(net, panels, windows, arena, &mut part.grads, scale, current_only)
                    } else {
                        score(net, windows, arena, scale, current_only)
                    };
                    part.sums.add(&sums);
                }
            }
        });
        let mut sums = Sums::default();
        self.accumulators.iter().for_each(|part| sums.add(&part.sums));
        sums
    }

    /// Sums the accumulators into the first one and returns the norm of the result. It goes through
    /// the whole tree piece by piece, so that a gradient passes through the cache once. The other
    /// accumulators are zero afterwards.
    fn reduce(&mut self) -> f64 {
        let (accumulators, threads) = (&mut self.accumulators, self.threads);
        let pieces = accumulators[0].grads.len().div_ceil(PIECE);
        let mut jobs: Vec<(Vec<&mut [T]>, f64)> =
            (0..pieces).map(|_| (Vec::with_capacity(accumulators.len()), 0.0)).collect();
        for part in accumulators.iter_mut() {
            for (job, piece) in jobs.iter_mut().zip(part.grads.chunks_mut(PIECE)) {
                job.0.push(piece);
            }
        }
        let queue = Mutex::new(jobs.iter_mut());
        on_threads(threads, |_| {
            while let Some((parts, squares)) = next_of(&queue) {
                let mut gap = 1;
                while gap < parts.len() {
                    for i in (0..parts.len()).step_by(2 * gap) {
                        let middle = (i + gap).min(parts.len());
                        let (low, high) = parts.split_at_mut(middle);
                        if let Some(b) = high.first() {
                            simd::add(low[i], b);
                        }
                    }
                    gap *= 2;
                }
                if let Some((sum, rest)) = parts.split_first_mut() {
                    *squares = simd::sum_of_squares(sum);
                    rest.iter_mut().for_each(|part| part.fill(T::default()));
                }
            }
        });
        let norm: f64 = jobs.iter().map(|(_, squares)| squares).sum();
        self.clean = true;
        norm.sqrt()
    }

    /// Gradient of the last step, laid out as the weights.
    pub fn gradient(&self) -> &[T] {
        &self.accumulators[0].grads
    }

    /// Loss and its whole gradient; the weights are unchanged.
    pub fn evaluate(&mut self, fill: &(impl Fn(usize, usize, &mut Batch<T>) + Sync)) -> Sums {
        let sums = self.gradients(fill);
        self.reduce();
        sums
    }

    /// Errors of one batch without gradients, for held-out data.
    pub fn errors(&mut self, fill: &(impl Fn(usize, usize, &mut Batch<T>) + Sync)) -> Sums {
        self.pass(fill, false)
    }

    /// One step at this learning rate. If loss or gradient is not finite, weights and moments are
    /// unchanged.
    pub fn step(
        &mut self,
        lr: f64,
        fill: &(impl Fn(usize, usize, &mut Batch<T>) + Sync),
    ) -> StepReport {
        let view = self.compute_gradient(fill);
        let applied = view.is_finite();
        if applied {
            self.apply(lr, &view);
        }
        StepReport { sums: view.sums, grad_norm: view.grad_norm, applied }
    }

    /// The first half of a step; weights and moments are unchanged. Weights with a finite result
    /// are worth keeping as a checkpoint.
    pub fn compute_gradient(
        &mut self,
        fill: &(impl Fn(usize, usize, &mut Batch<T>) + Sync),
    ) -> GradientView {
        let sums = self.gradients(fill);
        let grad_norm = self.reduce();
        GradientView { sums, grad_norm }
    }

    /// The second half: updates the weights by the gradient of [`Learner::compute_gradient`].
    pub fn apply(&mut self, lr: f64, view: &GradientView) {
        self.count += 1;
        self.update(lr, view.grad_norm);
        self.panels.refresh(&self.net, self.threads);
    }

    fn update(&mut self, lr: f64, norm: f64) {
        let adam = self.adam;
        let clip = if norm > adam.clip { adam.clip / (norm + 1e-6) } else { 1.0 };
        let Learner { net, first, second, accumulators, threads, count, .. } = self;
        let (mut w, mut g) = (&mut net.weights[..], &accumulators[0].grads[..]);
        let (mut m, mut v) = (&mut first[..], &mut second[..]);
        let mut jobs = Vec::with_capacity(net.layout.tensors.len());
        let mut at = 0;
        for tensor in &net.layout.tensors {
            let (skip, take) = (tensor.range.start - at, tensor.range.len());
            let (w_here, m_here, v_here);
            (w_here, w) = cut(w, skip, take);
            (m_here, m) = cut(m, skip, take);
            (v_here, v) = cut(v, skip, take);
            let here;
            (here, g) = g[skip..].split_at(take);
            at = tensor.range.end;
            let decay = if tensor.decays { adam.weight_decay } else { 0.0 };
            let moments = m_here.chunks_mut(PIECE).zip(v_here.chunks_mut(PIECE));
            let pieces = w_here.chunks_mut(PIECE).zip(here.chunks(PIECE)).zip(moments);
            jobs.extend(pieces.map(|((w, g), (m, v))| (decay, w, g, m, v)));
        }
        let queue = Mutex::new(jobs.into_iter());
        let step = AdamStep {
            lr,
            beta1: adam.beta1,
            beta2: adam.beta2,
            eps: adam.eps,
            decay: 0.0,
            clip,
            count: *count,
        };
        on_threads(*threads, |_| {
            while let Some((decay, w, g, m, v)) = next_of(&queue) {
                simd::adam(&AdamStep { decay, ..step }, w, g, m, v);
            }
        });
    }

    /// Packs the weights again after they were set from outside (a checkpoint).
    pub fn weights_changed(&mut self) {
        self.panels.refresh(&self.net, self.threads);
    }
}

/// The next `take` numbers after `skip`, and the rest.
fn cut<T>(x: &mut [T], skip: usize, take: usize) -> (&mut [T], &mut [T]) {
    let (_, rest) = x.split_at_mut(skip);
    rest.split_at_mut(take)
}
