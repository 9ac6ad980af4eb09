//! The elementwise half of the network: normalisation, activation, softmax, optimiser.
//!
//! Rows are `width` numbers, a whole number of registers ([`super::config`] demands a
//! multiple of 16), except attention scores, which are padded to [`PAD`]. Reductions run
//! in a fixed order, so bits depend on the processor's register width and nothing else.

// Vector code must be inlined into the function that pulp compiles for the processor found.
#![allow(clippy::inline_always)]

use pulp::{Arch, Simd, WithSimd};

use super::real::Real;

/// Numbers in a padded row of attention scores: 51 frames rounded up to whole registers.
pub const PAD: usize = 64;

/// Added to the variance under the root of a layer norm.
pub const EPS: f64 = 1e-5;

/// Defines a function whose body is compiled for every register width.
macro_rules! kernel {
    ($(#[$doc:meta])* pub fn $name:ident<$t:ident, $simd:ident>
     ($s:ident; $($arg:ident: $ty:ty),* $(,)?) $body:block) => {
        $(#[$doc])*
        pub fn $name<'k, $t: Real>($($arg: $ty),*) {
            struct Kernel<'k, $t: Real> {
                $($arg: $ty,)*
                life: std::marker::PhantomData<&'k $t>,
            }
            impl<'k, $t: Real> WithSimd for Kernel<'k, $t> {
                type Output = ();
                #[inline(always)]
                fn with_simd<$simd: Simd>(self, $s: $simd) {
                    let Kernel { $($arg,)* life: _ } = self;
                    $body
                }
            }
            Arch::new().dispatch(Kernel { $($arg,)* life: std::marker::PhantomData });
        }
    };
}

kernel! {
    /// y = γ (x − mean) / sd + β, row by row; `stats` gets (mean, 1/sd) of each row.
    pub fn layer_norm<T, S>(s; x: &'k [T], gamma: &'k [T], beta: &'k [T], y: &'k mut [T], stats: &'k mut [[T; 2]]) {
        let width = gamma.len();
        let (gamma, beta) = (T::vectors::<S>(gamma).0, T::vectors::<S>(beta).0);
        let share = T::of(1.0 / width as f64);
        for ((x, y), stat) in x.chunks_exact(width).zip(y.chunks_exact_mut(width)).zip(stats) {
            let x = T::vectors::<S>(x).0;
            let mut sum = T::splat(s, T::default());
            for &x in x {
                sum = T::vadd(s, sum, x);
            }
            let mean = T::vsum(s, sum) * share;
            let means = T::splat(s, mean);
            let mut squares = T::splat(s, T::default());
            for &x in x {
                let c = T::vsub(s, x, means);
                squares = T::fma(s, c, c, squares);
            }
            let rstd = T::of(1.0 / ((T::vsum(s, squares) * share).f64() + EPS).sqrt());
            let rstds = T::splat(s, rstd);
            *stat = [mean, rstd];
            let y = T::vectors_mut::<S>(y).0;
            for (((y, &x), &g), &b) in y.iter_mut().zip(x).zip(gamma).zip(beta) {
                let hat = T::vmul(s, T::vsub(s, x, means), rstds);
                *y = T::fma(s, hat, g, b);
            }
        }
    }
}

kernel! {
    /// Backward of [`layer_norm`]: adds to `dx`, `dgamma` and `dbeta`.
    pub fn layer_norm_back<T, S>(s; dy: &'k [T], x: &'k [T], stats: &'k [[T; 2]], gamma: &'k [T],
                                 dx: &'k mut [T], dgamma: &'k mut [T], dbeta: &'k mut [T]) {
        let width = gamma.len();
        let gamma = T::vectors::<S>(gamma).0;
        let (dgamma, dbeta) = (T::vectors_mut::<S>(dgamma).0, T::vectors_mut::<S>(dbeta).0);
        let share = T::of(1.0 / width as f64);
        let rows = dy.chunks_exact(width).zip(x.chunks_exact(width)).zip(dx.chunks_exact_mut(width));
        for (((dy, x), dx), &[mean, rstd]) in rows.zip(stats) {
            let (dy, x) = (T::vectors::<S>(dy).0, T::vectors::<S>(x).0);
            let dx = T::vectors_mut::<S>(dx).0;
            let (means, rstds) = (T::splat(s, mean), T::splat(s, rstd));
            let (mut sum, mut dot) = (T::splat(s, T::default()), T::splat(s, T::default()));
            let terms = dy.iter().zip(x).zip(gamma).zip(dgamma.iter_mut().zip(dbeta.iter_mut()));
            for (((&dy, &x), &g), (dgamma, dbeta)) in terms {
                let hat = T::vmul(s, T::vsub(s, x, means), rstds);
                *dgamma = T::fma(s, dy, hat, *dgamma);
                *dbeta = T::vadd(s, *dbeta, dy);
                let d = T::vmul(s, dy, g);
                sum = T::vadd(s, sum, d);
                dot = T::fma(s, d, hat, dot);
            }
            let sums = T::splat(s, T::vsum(s, sum) * share);
            let dots = T::splat(s, T::vsum(s, dot) * share);
            for (((&dy, &x), &g), dx) in dy.iter().zip(x).zip(gamma).zip(dx) {
                let hat = T::vmul(s, T::vsub(s, x, means), rstds);
                let d = T::vsub(s, T::vmul(s, dy, g), sums);
                let d = T::vsub(s, d, T::vmul(s, hat, dots));
                *dx = T::fma(s, d, rstds, *dx);
            }
        }
    }
}

kernel! {
    /// `y` = GELU(u); u becomes the derivative, which is all that the backward pass needs.
    pub fn gelu<T, S>(s; u: &'k mut [T], y: &'k mut [T]) {
        for (u, y) in T::vectors_mut::<S>(u).0.iter_mut().zip(T::vectors_mut::<S>(y).0) {
            (*y, *u) = T::gelu(s, *u);
        }
    }
}

kernel! {
    /// a ← a b.
    pub fn scale_by<T, S>(s; a: &'k mut [T], b: &'k [T]) {
        for (a, &b) in T::vectors_mut::<S>(a).0.iter_mut().zip(T::vectors::<S>(b).0) {
            *a = T::vmul(s, *a, b);
        }
    }
}

kernel! {
    /// Rows of [`PAD`] scores become softmax(scale · row) over the first `used`; the rest 0.
    pub fn softmax<T, S>(s; rows: &'k mut [T], used: usize, scale: T) {
        let factor = T::splat(s, scale);
        for row in rows.chunks_exact_mut(PAD) {
            // Far below any score, so that padding vanishes in the exponential.
            let low = row.first().copied().unwrap_or_default();
            row[used..].fill(low);
            let row_v = T::vectors_mut::<S>(row).0;
            let Some(&first) = row_v.first() else { continue };
            let top = row_v.iter().fold(first, |m, &x| T::vmax(s, m, x));
            let tops = T::splat(s, T::top(s, top) * scale);
            for x in row_v {
                *x = T::exp(s, T::vsub(s, T::vmul(s, *x, factor), tops));
            }
            row[used..].fill(T::default());
            let row_v = T::vectors_mut::<S>(row).0;
            let mut sum = T::splat(s, T::default());
            for &mut x in &mut *row_v {
                sum = T::vadd(s, sum, x);
            }
            let share = T::splat(s, T::of(1.0) / T::vsum(s, sum));
            for x in row_v {
                *x = T::vmul(s, *x, share);
            }
        }
    }
}

kernel! {
    /// Backward of [`softmax`]: `d` holds the gradient of the weights `p` and becomes that
    /// of the scores, scale · p (d − Σ p d).
    pub fn softmax_back<T, S>(s; p: &'k [T], d: &'k mut [T], scale: T) {
        let factor = T::splat(s, scale);
        for (p, d) in p.chunks_exact(PAD).zip(d.chunks_exact_mut(PAD)) {
            let (p, d) = (T::vectors::<S>(p).0, T::vectors_mut::<S>(d).0);
            let mut dot = T::splat(s, T::default());
            for (&p, &mut d) in p.iter().zip(&mut *d) {
                dot = T::fma(s, p, d, dot);
            }
            let dots = T::splat(s, T::vsum(s, dot));
            for (&p, d) in p.iter().zip(d) {
                *d = T::vmul(s, T::vmul(s, p, factor), T::vsub(s, *d, dots));
            }
        }
    }
}

kernel! {
    /// `sums` += the columns of `x`, rows of `sums.len()` numbers.
    pub fn add_columns<T, S>(s; x: &'k [T], sums: &'k mut [T]) {
        let width = sums.len();
        if width == 0 {
            return;
        }
        let lanes = T::lanes::<S>();
        for (block, sums) in sums.chunks_mut(4 * lanes).enumerate() {
            let at = block * 4 * lanes;
            if sums.len() == 4 * lanes {
                let sums = T::vectors_mut::<S>(sums).0;
                let zero = T::splat(s, T::default());
                let mut acc = [zero; 4];
                for row in x.chunks_exact(width) {
                    let row = T::vectors::<S>(&row[at..][..4 * lanes]).0;
                    for (acc, &x) in acc.iter_mut().zip(row) {
                        *acc = T::vadd(s, *acc, x);
                    }
                }
                for (sum, acc) in sums.iter_mut().zip(acc) {
                    *sum = T::vadd(s, *sum, acc);
                }
            } else {
                for row in x.chunks_exact(width) {
                    for (sum, &x) in sums.iter_mut().zip(&row[at..]) {
                        *sum += x;
                    }
                }
            }
        }
    }
}

kernel! {
    /// a ← a + b; lengths need not be whole registers.
    pub fn add<T, S>(s; a: &'k mut [T], b: &'k [T]) {
        let (a, a_rest) = T::vectors_mut::<S>(a);
        let (b, b_rest) = T::vectors::<S>(b);
        for (a, &b) in a.iter_mut().zip(b) {
            *a = T::vadd(s, *a, b);
        }
        for (a, &b) in a_rest.iter_mut().zip(b_rest) {
            *a += b;
        }
    }
}

/// The figures of one optimiser step.
#[derive(Clone, Copy, Debug)]
pub struct AdamStep {
    /// Learning rate of this step.
    pub lr: f64,
    /// Decay of the first moment.
    pub beta1: f64,
    /// Decay of the second moment.
    pub beta2: f64,
    /// Added to the root of the second moment.
    pub eps: f64,
    /// Decoupled weight decay (0 for biases, norms, positions).
    pub decay: f64,
    /// Factor on the gradient (clipping).
    pub clip: f64,
    /// Number of this step, from 1.
    pub count: u64,
}

kernel! {
    /// One `AdamW` step (Loshchilov and Hutter 2019).
    pub fn adam<T, S>(s; step: &'k AdamStep, w: &'k mut [T], g: &'k [T], m: &'k mut [T], v: &'k mut [T]) {
        let count = i32::try_from(step.count).unwrap_or(i32::MAX);
        let rate = step.lr / (1.0 - step.beta1.powi(count));
        let root = (1.0 - step.beta2.powi(count)).sqrt();
        let keep = 1.0 - step.lr * step.decay;
        let all = |x: f64| T::splat(s, T::of(x));
        let (clip, b1, a1, b2, a2) = (
            all(step.clip), all(step.beta1), all(1.0 - step.beta1), all(step.beta2), all(1.0 - step.beta2),
        );
        let (rate, root, eps, keep) = (all(-rate), all(1.0 / root), all(step.eps), all(keep));
        let lanes = T::lanes::<S>();
        let moments = m.chunks_mut(lanes).zip(v.chunks_mut(lanes));
        for ((w, g), (m, v)) in w.chunks_mut(lanes).zip(g.chunks(lanes)).zip(moments) {
            let grad = T::vmul(s, T::load(s, g), clip);
            let first = T::fma(s, T::load(s, m), b1, T::vmul(s, grad, a1));
            let second = T::fma(s, T::load(s, v), b2, T::vmul(s, T::vmul(s, grad, grad), a2));
            T::store(s, m, first);
            T::store(s, v, second);
            let step = T::vdiv(s, first, T::fma(s, T::vsqrt(s, second), root, eps));
            let next = T::fma(s, step, rate, T::vmul(s, T::load(s, w), keep));
            T::store(s, w, next);
        }
    }
}

/// Σ x², in f64, in blocks of fixed length.
pub fn sum_of_squares<T: Real>(x: &[T]) -> f64 {
    x.chunks(16)
        .fold([0.0; 16], |mut acc, chunk| {
            for (a, &x) in acc.iter_mut().zip(chunk) {
                *a += x.f64() * x.f64();
            }
            acc
        })
        .iter()
        .sum()
}
