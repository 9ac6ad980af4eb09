//! Small feed-forward networks of the agents: forward, backward, Adam, moving average.
//!
//! The layers are those of the published agents. Every product uses [`robert_linalg`]. Everything
//! is generic over f32 (training) and f64 (finite-difference checks of each agent's loss). A
//! network is one flat parameter vector, so that copying, averaging and saving are one line each.

use robert_base::rng::{Rng, Stream};
use robert_linalg::{
    Init, Mat, MatMut, Real, gemm,
    simd::{self, AdamStep},
};

/// One layer; sizes are input and output columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layer {
    /// x W + b.
    Linear(usize, usize),
    /// Layer normalisation with gain and bias, then tanh.
    NormTanh(usize),
    /// max(x, 0).
    Relu(usize),
    /// tanh.
    Tanh(usize),
}

impl Layer {
    fn outputs(self) -> usize {
        match self {
            Layer::Linear(_, n) | Layer::NormTanh(n) | Layer::Relu(n) | Layer::Tanh(n) => n,
        }
    }

    fn params(self) -> usize {
        match self {
            Layer::Linear(m, n) => m * n + n,
            Layer::NormTanh(n) => 2 * n,
            Layer::Relu(_) | Layer::Tanh(_) => 0,
        }
    }
}

/// A network: layers and one flat vector of parameters.
#[derive(Clone, Debug)]
pub struct Mlp<T> {
    layers: Vec<Layer>,
    /// Linear: W (inputs, outputs) then b; `NormTanh`: gain then bias.
    pub params: Vec<T>,
}

/// Values that the backward pass needs from the forward pass; reused from update to update.
#[derive(Clone, Debug, Default)]
pub struct Tape<T> {
    rows: usize,
    /// Input, then the output of each layer.
    values: Vec<Vec<T>>,
    /// (mean, 1 / std) of each row of each normalisation.
    stats: Vec<Vec<[T; 2]>>,
    spare: Vec<T>,
}

impl<T: Real> Tape<T> {
    /// Output of the last forward pass, (rows, outputs).
    pub fn output(&self) -> &[T] {
        self.values.last().map_or(&[], Vec::as_slice)
    }
}

impl<T: Real> Mlp<T> {
    /// Orthogonal weights of gain 1 (Saxe et al. 2014), zero biases, unit gains: the
    /// initialisation of the reference agents. Layer i draws from (seed, index + i).
    pub fn new(layers: &[Layer], seed: u64, index: u64) -> Self {
        let mut params = Vec::with_capacity(layers.iter().map(|l| l.params()).sum());
        for (i, &layer) in layers.iter().enumerate() {
            match layer {
                Layer::Linear(m, n) => {
                    let mut rng = Rng::new(seed, Stream::Init, index + i as u64);
                    params.extend(orthogonal(m, n, &mut rng).into_iter().map(T::of));
                    params.resize(params.len() + n, T::default());
                }
                Layer::NormTanh(n) => {
                    params.resize(params.len() + n, T::of(1.0));
                    params.resize(params.len() + n, T::default());
                }
                Layer::Relu(_) | Layer::Tanh(_) => {}
            }
        }
        Mlp { layers: layers.to_vec(), params }
    }

    /// Runs the network on `x` (rows, inputs) and keeps what the backward pass needs.
    pub fn forward<'t>(&self, x: &[T], rows: usize, tape: &'t mut Tape<T>) -> &'t [T] {
        tape.rows = rows;
        tape.values.resize_with(self.layers.len() + 1, Vec::new);
        tape.stats.resize_with(self.layers.len(), Vec::new);
        tape.values[0].clear();
        tape.values[0].extend_from_slice(x);
        let mut at = 0;
        for (i, &layer) in self.layers.iter().enumerate() {
            let (before, after) = tape.values.split_at_mut(i + 1);
            let (input, out) = (before[i].as_slice(), &mut after[0]);
            out.resize(rows * layer.outputs(), T::default());
            let params = &self.params[at..at + layer.params()];
            at += layer.params();
            match layer {
                Layer::Linear(m, n) => {
                    let (w, b) = params.split_at(m * n);
                    gemm(
                        MatMut::new(out, rows, n),
                        Init::Bias(b),
                        Mat::new(input, rows, m),
                        Mat::new(w, m, n),
                    );
                }
                Layer::NormTanh(n) => {
                    let stats = &mut tape.stats[i];
                    stats.resize(rows, [T::default(); 2]);
                    let (gain, bias) = params.split_at(n);
                    simd::layer_norm(input, gain, bias, out, stats);
                    simd::tanh(out);
                }
                Layer::Relu(_) => {
                    let zero = T::default();
                    for (o, &x) in out.iter_mut().zip(input) {
                        *o = if x > zero { x } else { zero };
                    }
                }
                Layer::Tanh(_) => {
                    out.copy_from_slice(input);
                    simd::tanh(out);
                }
            }
        }
        tape.output()
    }

    /// Takes `d` = gradient by the output (rows, outputs) back to the input: afterwards `d`
    /// holds the gradient by the input (rows, inputs), unless `want_input` is false.
    /// Parameter gradients are added to `grads` when given.
    pub fn backward(
        &self,
        tape: &mut Tape<T>,
        d: &mut Vec<T>,
        mut grads: Option<&mut [T]>,
        want_input: bool,
    ) {
        let rows = tape.rows;
        let mut end = self.params.len();
        for (i, &layer) in self.layers.iter().enumerate().rev() {
            let start = end - layer.params();
            let params = &self.params[start..end];
            let mine = grads.as_deref_mut().map(|g| &mut g[start..end]);
            end = start;
            let (input, output) = (&tape.values[i], &tape.values[i + 1]);
            match layer {
                Layer::Linear(m, n) => {
                    if let Some(g) = mine {
                        let (gw, gb) = g.split_at_mut(m * n);
                        gemm(
                            MatMut::new(gw, m, n),
                            Init::Add,
                            Mat::new(input, rows, m).t(),
                            Mat::new(d, rows, n),
                        );
                        for row in d.chunks_exact(n) {
                            for (b, &x) in gb.iter_mut().zip(row) {
                                *b += x;
                            }
                        }
                    }
                    if i == 0 && !want_input {
                        return;
                    }
                    tape.spare.resize(rows * m, T::default());
                    gemm(
                        MatMut::new(&mut tape.spare, rows, m),
                        Init::Zero,
                        Mat::new(d, rows, n),
                        Mat::new(&params[..m * n], m, n).t(),
                    );
                    std::mem::swap(d, &mut tape.spare);
                    d.truncate(rows * m);
                }
                Layer::NormTanh(n) => {
                    // Gradients of frozen networks are computed and discarded: 2 n numbers.
                    let mut waste = Vec::new();
                    let g = if let Some(g) = mine {
                        g
                    } else {
                        waste.resize(2 * n, T::default());
                        &mut waste
                    };
                    let (dgain, dbias) = g.split_at_mut(n);
                    through_tanh(d, output);
                    tape.spare.clear();
                    tape.spare.resize(rows * n, T::default());
                    let (stats, gain) = (&tape.stats[i], &params[..n]);
                    simd::layer_norm_back(d, input, stats, gain, &mut tape.spare, dgain, dbias);
                    std::mem::swap(d, &mut tape.spare);
                }
                Layer::Relu(_) => {
                    let zero = T::default();
                    for (d, &y) in d.iter_mut().zip(output) {
                        *d = if y > zero { *d } else { zero };
                    }
                }
                Layer::Tanh(_) => through_tanh(d, output),
            }
        }
    }
}

/// Gradient by the input of a tanh with these outputs.
fn through_tanh<T: Real>(d: &mut [T], output: &[T]) {
    for (d, &y) in d.iter_mut().zip(output) {
        *d = *d * (T::of(1.0) - y * y);
    }
}

/// (m, n) with orthonormal rows or columns, whichever are fewer: modified Gram-Schmidt on
/// normal draws, run twice because once loses orthogonality in the last columns.
fn orthogonal(m: usize, n: usize, rng: &mut Rng) -> Vec<f64> {
    let (count, len) = (m.min(n), m.max(n));
    let mut basis: Vec<Vec<f64>> = Vec::with_capacity(count);
    for _ in 0..count {
        let mut v: Vec<f64> = (0..len).map(|_| rng.normal()).collect();
        for _ in 0..2 {
            for b in &basis {
                let along = simd::dot(b, &v);
                for (x, y) in v.iter_mut().zip(b) {
                    *x -= along * y;
                }
            }
        }
        let norm = simd::dot(&v, &v).sqrt();
        for x in &mut v {
            *x /= norm;
        }
        basis.push(v);
    }
    let at = |i: usize, j: usize| if m <= n { basis[i][j] } else { basis[j][i] };
    (0..m).flat_map(|i| (0..n).map(move |j| (i, j))).map(|(i, j)| at(i, j)).collect()
}

/// Adam's state for one parameter vector.
#[derive(Clone, Debug)]
pub struct Adam<T> {
    /// First moments.
    pub m: Vec<T>,
    /// Second moments.
    pub v: Vec<T>,
    /// Steps taken.
    pub steps: u64,
    /// Gradients of the current step; zeroed after each.
    pub grads: Vec<T>,
}

impl<T: Real> Adam<T> {
    /// For a vector of this length.
    pub fn new(len: usize) -> Self {
        let zero = || vec![T::default(); len];
        Adam { m: zero(), v: zero(), steps: 0, grads: zero() }
    }

    /// Takes a step along the collected gradients and clears them.
    pub fn step(&mut self, params: &mut [T], lr: f64) {
        self.steps += 1;
        let step = AdamStep {
            lr,
            beta1: 0.9,
            beta2: 0.999,
            eps: 1e-8,
            decay: 0.0,
            clip: 1.0,
            count: self.steps,
        };
        simd::adam(&step, params, &self.grads, &mut self.m, &mut self.v);
        self.grads.fill(T::default());
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Random numbers for tests.
    pub(crate) fn noise(n: usize, index: u64) -> Vec<f64> {
        let mut rng = Rng::new(77, Stream::Test, index);
        (0..n).map(|_| rng.normal()).collect()
    }

    /// Central differences of `loss` by each listed entry of `x`.
    pub(crate) fn check_gradient(
        what: &str,
        x: &mut [f64],
        grad: &[f64],
        every: usize,
        mut loss: impl FnMut(&[f64]) -> f64,
    ) {
        assert_eq!(x.len(), grad.len());
        let scale = grad.iter().map(|g| g.abs()).fold(0.0, f64::max);
        assert!(scale > 0.0, "{what}: no gradient at all");
        for i in (0..x.len()).step_by(every) {
            let (old, h) = (x[i], 1e-6);
            x[i] = old + h;
            let up = loss(x);
            x[i] = old - h;
            let down = loss(x);
            x[i] = old;
            let want = (up - down) / (2.0 * h);
            let off = (grad[i] - want).abs();
            assert!(
                off < 1e-6 * scale.max(1.0) + 1e-5 * want.abs(),
                "{what}[{i}]: {} is not {want}",
                grad[i]
            );
        }
    }

    #[test]
    fn every_layer_has_the_right_gradient() {
        let layers = [
            Layer::Linear(5, 19),
            Layer::NormTanh(19),
            Layer::Linear(19, 17),
            Layer::Relu(17),
            Layer::Linear(17, 3),
            Layer::Tanh(3),
        ];
        let mut net = Mlp::<f64>::new(&layers, 1, 0);
        net.params.iter_mut().zip(noise(1000, 9)).for_each(|(p, n)| *p += 0.1 * n);
        let (mut x, c) = (noise(7 * 5, 0), noise(7 * 3, 1));
        let value =
            |net: &Mlp<f64>, x: &[f64]| simd::dot(net.forward(x, 7, &mut Tape::default()), &c);
        let mut tape = Tape::default();
        net.forward(&x, 7, &mut tape);
        let (mut d, mut g) = (c.clone(), vec![0.0; net.params.len()]);
        net.backward(&mut tape, &mut d, Some(&mut g), true);
        check_gradient("input", &mut x, &d, 1, |x| value(&net, x));
        let mut params = net.params.clone();
        check_gradient("params", &mut params, &g, 1, |p| {
            net.params.copy_from_slice(p);
            value(&net, &x)
        });
    }

    #[test]
    fn weights_start_orthogonal() {
        for (m, n) in [(4, 9), (9, 4), (6, 6)] {
            let w = orthogonal(m, n, &mut Rng::new(1, Stream::Test, 0));
            let k = m.min(n);
            for a in 0..k {
                for b in 0..k {
                    let dot: f64 = (0..m.max(n))
                        .map(|i| {
                            if m <= n {
                                w[a * n + i] * w[b * n + i]
                            } else {
                                w[i * n + a] * w[i * n + b]
                            }
                        })
                        .sum();
                    assert!((dot - f64::from(u8::from(a == b))).abs() < 1e-12);
                }
            }
        }
    }

    #[test]
    fn adam_is_the_published_one() {
        // Two steps by hand with g = 2 then g = -1, lr .1.
        let mut adam = Adam::<f64>::new(1);
        let mut p = [1.0];
        adam.grads[0] = 2.0;
        adam.step(&mut p, 0.1);
        assert!((p[0] - 0.9).abs() < 1e-8);
        adam.grads[0] = -1.0;
        adam.step(&mut p, 0.1);
        let (m, v) = (0.9 * 0.2 - 0.1, 0.999 * 0.004 + 0.001);
        let want = 0.9 - 0.1 * (m / 0.19) / ((v / 0.001_999_f64).sqrt() + 1e-8);
        assert!((p[0] - want).abs() < 1e-9, "{} {want}", p[0]);
        assert_eq!(adam.grads, [0.0]);
    }
}
