//! The elementwise functions of all networks: normalisation, activation, softmax, optimiser.
//!
//! Any length is allowed. Those of the transformer are whole registers (its width is a multiple of
//! 16), and attention scores are padded to [`PAD`]. Other lengths end with a partial register or a
//! few scalars. Reductions run in a fixed order, so bits depend only on the processor's register
//! width.

// Vector code must be inlined into the function that pulp compiles for the processor found.
#![allow(clippy::inline_always)]

use pulp::{Simd, WithSimd};

use super::numerics::arch;
use super::real::Real;

/// Numbers in a padded row of attention scores: 51 frames rounded up to whole registers.
pub const PAD: usize = 64;

/// Added to the variance under the root of a layer norm.
pub const EPS: f64 = 1e-5;

/// Defines functions whose bodies are compiled for every register width.
///
/// They are compiled here, once for f32 and once for f64, through [`Kernels`]. Otherwise each crate
/// that calls them would compile its own copies, which took longer than all other code.
macro_rules! kernels {
    (@returns) => { () };
    (@returns $out:ty) => { $out };
    ($t:ident, $simd:ident; $(
        $(#[$doc:meta])*
        pub fn $name:ident($s:ident; $($arg:ident: $ty:ty),* $(,)?) $(-> $out:ty)? $body:block
    )*) => {
        /// The functions of this module for one type of number.
        pub trait Kernels<$t> {$(
            $(#[$doc])*
            fn $name<'k>($($arg: $ty),*) $(-> $out)?;
        )*}

        $(
            $(#[$doc])*
            pub fn $name<'k, $t: Real>($($arg: $ty),*) $(-> $out)? {
                <$t as Kernels<$t>>::$name($($arg),*)
            }
        )*

        /// The bodies, for any number and register.
        mod body {
            use super::*;
            $(
                #[inline(always)]
                pub(super) fn $name<'k, $t: Real>($($arg: $ty),*) $(-> $out)? {
                    struct Kernel<'k, $t: Real> {
                        $($arg: $ty,)*
                        life: std::marker::PhantomData<&'k $t>,
                    }
                    impl<'k, $t: Real> WithSimd for Kernel<'k, $t> {
                        type Output = kernels!(@returns $($out)?);
                        #[inline(always)]
                        fn with_simd<$simd: Simd>(self, $s: $simd) -> Self::Output {
                            let Kernel { $($arg,)* life: _ } = self;
                            $body
                        }
                    }
                    arch().dispatch(Kernel { $($arg,)* life: std::marker::PhantomData })
                }
            )*
        }

        const _: () = {
            type $t = f32;
            impl Kernels<$t> for $t {$(
                fn $name<'k>($($arg: $ty),*) $(-> $out)? { body::$name::<f32>($($arg),*) }
            )*}
        };
        const _: () = {
            type $t = f64;
            impl Kernels<$t> for $t {$(
                fn $name<'k>($($arg: $ty),*) $(-> $out)? { body::$name::<f64>($($arg),*) }
            )*}
        };
    };
}

/// x = f(x), register by register; missing lanes of the last one are 0 and are not stored.
#[inline(always)]
fn map<T: Real, S: Simd>(s: S, x: &mut [T], f: impl Fn(T::V<S>) -> T::V<S>) {
    let (body, tail) = T::vectors_mut::<S>(x);
    for v in body {
        *v = f(*v);
    }
    if !tail.is_empty() {
        let v = f(T::load(s, tail));
        T::store(s, tail, v);
    }
}

/// Sum of f(accumulator, x, y) over all registers; `f` must add 0 for lanes that are 0.
#[inline(always)]
fn fold<T: Real, S: Simd>(
    s: S,
    x: &[T],
    y: &[T],
    f: impl Fn(T::V<S>, T::V<S>, T::V<S>) -> T::V<S>,
) -> T {
    let (xs, xt) = T::vectors::<S>(x);
    let (ys, yt) = T::vectors::<S>(y);
    let mut acc = T::splat(s, T::default());
    for (a, b) in xs.iter().zip(ys) {
        acc = f(acc, *a, *b);
    }
    if !xt.is_empty() {
        acc = f(acc, T::load(s, xt), T::load(s, yt));
    }
    T::vsum(s, acc)
}

/// The parameters of one optimiser step.
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

kernels! {
    T, S;

    /// y = γ (x − mean) / sd + β, row by row; `stats` gets (mean, 1/sd) of each row.
    pub fn layer_norm(s; x: &'k [T], gamma: &'k [T], beta: &'k [T], y: &'k mut [T], stats: &'k mut [[T; 2]]) {
        let width = gamma.len();
        let ((gamma, gamma_rest), (beta, beta_rest)) = (T::vectors::<S>(gamma), T::vectors::<S>(beta));
        let share = T::of(1.0 / width as f64);
        for ((x, y), stat) in x.chunks_exact(width).zip(y.chunks_exact_mut(width)).zip(stats) {
            let (x, x_rest) = T::vectors::<S>(x);
            let mut sum = T::splat(s, T::default());
            for &x in x {
                sum = T::vadd(s, sum, x);
            }
            let mut sum = T::vsum(s, sum);
            for &x in x_rest {
                sum += x;
            }
            let mean = sum * share;
            let means = T::splat(s, mean);
            let mut squares = T::splat(s, T::default());
            for &x in x {
                let c = T::vsub(s, x, means);
                squares = T::fma(s, c, c, squares);
            }
            let mut squares = T::vsum(s, squares);
            for &x in x_rest {
                squares += (x - mean) * (x - mean);
            }
            let rstd = T::of(1.0 / ((squares * share).f64() + EPS).sqrt());
            let rstds = T::splat(s, rstd);
            *stat = [mean, rstd];
            let (y, y_rest) = T::vectors_mut::<S>(y);
            for (((y, &x), &g), &b) in y.iter_mut().zip(x).zip(gamma).zip(beta) {
                let hat = T::vmul(s, T::vsub(s, x, means), rstds);
                *y = T::fma(s, hat, g, b);
            }
            for (((y, &x), &g), &b) in y_rest.iter_mut().zip(x_rest).zip(gamma_rest).zip(beta_rest) {
                *y = (x - mean) * rstd * g + b;
            }
        }
    }

    /// Backward of [`layer_norm`]: adds to `dx`, `dgamma` and `dbeta`.
    pub fn layer_norm_back(s; dy: &'k [T], x: &'k [T], stats: &'k [[T; 2]], gamma: &'k [T],
                                 dx: &'k mut [T], dgamma: &'k mut [T], dbeta: &'k mut [T]) {
        let width = gamma.len();
        let (gamma, gamma_rest) = T::vectors::<S>(gamma);
        let (dgamma, dgamma_rest) = T::vectors_mut::<S>(dgamma);
        let (dbeta, dbeta_rest) = T::vectors_mut::<S>(dbeta);
        let share = T::of(1.0 / width as f64);
        let rows = dy.chunks_exact(width).zip(x.chunks_exact(width)).zip(dx.chunks_exact_mut(width));
        for (((dy, x), dx), &[mean, rstd]) in rows.zip(stats) {
            let ((dy, dy_rest), (x, x_rest)) = (T::vectors::<S>(dy), T::vectors::<S>(x));
            let (dx, dx_rest) = T::vectors_mut::<S>(dx);
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
            let (mut sum, mut dot) = (T::vsum(s, sum), T::vsum(s, dot));
            for (i, ((&dy, &x), &g)) in dy_rest.iter().zip(x_rest).zip(gamma_rest).enumerate() {
                let hat = (x - mean) * rstd;
                dgamma_rest[i] += dy * hat;
                dbeta_rest[i] += dy;
                sum += dy * g;
                dot += dy * g * hat;
            }
            let (sum, dot) = (sum * share, dot * share);
            let (sums, dots) = (T::splat(s, sum), T::splat(s, dot));
            for (((&dy, &x), &g), dx) in dy.iter().zip(x).zip(gamma).zip(dx) {
                let hat = T::vmul(s, T::vsub(s, x, means), rstds);
                let d = T::vsub(s, T::vmul(s, dy, g), sums);
                let d = T::vsub(s, d, T::vmul(s, hat, dots));
                *dx = T::fma(s, d, rstds, *dx);
            }
            for (((&dy, &x), &g), dx) in dy_rest.iter().zip(x_rest).zip(gamma_rest).zip(dx_rest) {
                let hat = (x - mean) * rstd;
                *dx += (dy * g - sum - hat * dot) * rstd;
            }
        }
    }

    /// x ← tanh(x), by one exponential; beyond ±9 (f32) or ±19 (f64) it is 1 to the last bit.
    pub fn tanh(s; x: &'k mut [T]) {
        let bound = if size_of::<T>() == 4 { 9.0 } else { 19.0 };
        let all = |x: f64| T::splat(s, T::of(x));
        let (low, zero, one, two) = (all(-bound), all(0.0), all(1.0), all(2.0));
        map(
            s,
            x,
            #[inline(always)]
            |x| {
                let x = T::vsub(s, zero, T::vmax(s, T::vsub(s, zero, T::vmax(s, x, low)), low));
                let e = T::exp(s, T::vadd(s, x, x));
                T::vsub(s, one, T::vdiv(s, two, T::vadd(s, e, one)))
            },
        );
    }

    /// Σ x y.
    pub fn dot(s; x: &'k [T], y: &'k [T]) -> T {
        fold(
            s,
            x,
            y,
            #[inline(always)]
            |acc, a, b| T::fma(s, a, b, acc),
        )
    }

    /// Σ (x − y)².
    pub fn distance2(s; x: &'k [T], y: &'k [T]) -> T {
        fold(
            s,
            x,
            y,
            #[inline(always)]
            |acc, a, b| {
                let d = T::vsub(s, a, b);
                T::fma(s, d, d, acc)
            },
        )
    }

    /// x ← x + share (y − x): the moving average of target networks.
    pub fn follow(s; x: &'k mut [T], y: &'k [T], share: T) {
        let share = T::splat(s, share);
        let (x, x_rest) = T::vectors_mut::<S>(x);
        let (y, y_rest) = T::vectors::<S>(y);
        for (x, &y) in x.iter_mut().zip(y) {
            *x = T::fma(s, share, T::vsub(s, y, *x), *x);
        }
        if !x_rest.is_empty() {
            let (a, b) = (T::load(s, x_rest), T::load(s, y_rest));
            T::store(s, x_rest, T::fma(s, share, T::vsub(s, b, a), a));
        }
    }

    /// x ← e^(scale (x − shift)); returns the sum.
    pub fn exp_sum(s; x: &'k mut [T], scale: T, shift: T) -> T {
        let (k, c, one) = (T::splat(s, scale), T::splat(s, shift), T::splat(s, T::of(1.0)));
        map(
            s,
            x,
            #[inline(always)]
            |v| T::exp(s, T::vmul(s, k, T::vsub(s, v, c))),
        );
        fold(
            s,
            x,
            x,
            #[inline(always)]
            |acc, a, _| T::fma(s, a, one, acc),
        )
    }

    /// `y` = GELU(u); u becomes the derivative, which is all that the backward pass needs.
    pub fn gelu(s; u: &'k mut [T], y: &'k mut [T]) {
        for (u, y) in T::vectors_mut::<S>(u).0.iter_mut().zip(T::vectors_mut::<S>(y).0) {
            (*y, *u) = T::vgelu(s, *u);
        }
    }

    /// Rows of [`PAD`] scores become softmax(scale · row) over the first `used`; the rest 0.
    pub fn softmax(s; rows: &'k mut [T], used: usize, scale: T) {
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

    /// Backward of [`softmax`]: `d` holds the gradient of the weights `p` and becomes that
    /// of the scores, scale · p (d − Σ p d).
    pub fn softmax_back(s; p: &'k [T], d: &'k mut [T], scale: T) {
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

    /// `sums` += the columns of `x`, rows of `sums.len()` numbers.
    pub fn add_columns(s; x: &'k [T], sums: &'k mut [T]) {
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

    /// a ← a + b; lengths need not be whole registers.
    pub fn add(s; a: &'k mut [T], b: &'k [T]) {
        let (a, a_rest) = T::vectors_mut::<S>(a);
        let (b, b_rest) = T::vectors::<S>(b);
        for (a, &b) in a.iter_mut().zip(b) {
            *a = T::vadd(s, *a, b);
        }
        for (a, &b) in a_rest.iter_mut().zip(b_rest) {
            *a += b;
        }
    }

    /// One `AdamW` step (Loshchilov and Hutter 2019).
    pub fn adam(s; step: &'k AdamStep, w: &'k mut [T], g: &'k [T], m: &'k mut [T], v: &'k mut [T]) {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tanh_is_tanh() {
        for x in [-50.0, -9.5, -3.0, -0.1, 0.0, 1e-4, 0.7, 8.0, 100.0_f64] {
            let mut y = [x; 5];
            tanh(&mut y);
            assert!((y[4] - x.tanh()).abs() < 1e-15, "{x}");
            let mut y = [x as f32; 3];
            tanh(&mut y);
            assert!((f64::from(y[2]) - x.tanh()).abs() < 2e-7, "{x}");
        }
    }

    #[test]
    fn any_width_is_normalised_alike() {
        // 16 numbers are whole registers on every processor; 21 leave five over.
        for width in [3, 16, 21, 37] {
            let x: Vec<f64> = (0..2 * width).map(|i| (i as f64 * 1.7).sin() + 0.3).collect();
            let gamma: Vec<f64> = (0..width).map(|i| 1.0 + 0.1 * i as f64).collect();
            let beta: Vec<f64> = (0..width).map(|i| 0.2 * i as f64).collect();
            let (mut y, mut stats) = (vec![0.0; 2 * width], [[0.0; 2]; 2]);
            layer_norm(&x, &gamma, &beta, &mut y, &mut stats);
            for (x, y) in x.chunks(width).zip(y.chunks(width)) {
                let mean = x.iter().sum::<f64>() / width as f64;
                let var = x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / width as f64;
                for (i, y) in y.iter().enumerate() {
                    let want = gamma[i] * (x[i] - mean) / (var + EPS).sqrt() + beta[i];
                    assert!((y - want).abs() < 1e-12, "{width} {i}: {y} {want}");
                }
            }
        }
    }

    #[test]
    fn sums_and_averages_take_odd_lengths() {
        for n in [1, 7, 16, 19, 33] {
            let x: Vec<f32> = (0..n).map(|i| i as f32).collect();
            let y = vec![1.0_f32; n];
            let total = (n * (n - 1) / 2) as f32;
            assert_eq!(dot(&x, &y), total);
            assert_eq!(distance2(&x, &x), 0.0);
            let mut z = x.clone();
            follow(&mut z, &y, 0.5);
            assert!(z.iter().zip(&x).all(|(z, x)| *z == 0.5 * (x + 1.0)));
            let mut ones = vec![2.0_f32; n];
            assert!((exp_sum(&mut ones, 3.0, 2.0) - n as f32).abs() < 1e-5);
        }
    }
}
