//! Elementwise and row-wise vector code of the agents' small networks.
//!
//! The networks are so small (128 wide, 256 rows) that a scalar `tanh` would cost more than
//! all matrix products together; hence everything that touches every activation is written
//! once over [`Real`]'s registers and picked for the processor at run time.

// Vector code must be inlined into the function that pulp compiles for the processor found.
#![allow(clippy::inline_always)]

use pulp::{Arch, Simd, WithSimd};

use crate::net::real::Real;

/// Variance floor of layer normalisation, as in `PyTorch`.
const NORM_EPS: f64 = 1e-5;

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

#[inline(always)]
fn zip<T: Real, S: Simd>(s: S, x: &mut [T], y: &[T], f: impl Fn(T::V<S>, T::V<S>) -> T::V<S>) {
    let (xs, xt) = T::vectors_mut::<S>(x);
    let (ys, yt) = T::vectors::<S>(y);
    for (a, b) in xs.iter_mut().zip(ys) {
        *a = f(*a, *b);
    }
    if !xt.is_empty() {
        let v = f(T::load(s, xt), T::load(s, yt));
        T::store(s, xt, v);
    }
}

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
    let mut sum = T::vsum(s, acc);
    if !xt.is_empty() {
        // Missing lanes load as 0 and every use below adds 0 for them.
        sum += T::vsum(s, f(T::splat(s, T::default()), T::load(s, xt), T::load(s, yt)));
    }
    sum
}

/// tanh by one exponential; beyond +-9 (f32) or +-19 (f64) it is 1 to the last bit anyway.
#[inline(always)]
fn tanh_v<T: Real, S: Simd>(s: S, x: T::V<S>) -> T::V<S> {
    let bound = if size_of::<T>() == 4 { 9.0 } else { 19.0 };
    let (c, zero) = (T::splat(s, T::of(-bound)), T::splat(s, T::default()));
    let low = T::vmax(s, x, c);
    let inside = T::vsub(s, zero, T::vmax(s, T::vsub(s, zero, low), c));
    let one = T::splat(s, T::of(1.0));
    let e = T::exp(s, T::vadd(s, inside, inside));
    T::vsub(s, one, T::vdiv(s, T::splat(s, T::of(2.0)), T::vadd(s, e, one)))
}

/// x = tanh(x).
pub(super) fn tanh<T: Real>(x: &mut [T]) {
    struct Run<'a, T>(&'a mut [T]);
    impl<T: Real> WithSimd for Run<'_, T> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, s: S) {
            map(
                s,
                self.0,
                #[inline(always)]
                |v| tanh_v::<T, S>(s, v),
            );
        }
    }
    Arch::new().dispatch(Run(x));
}

/// Sum of x y.
pub(super) fn dot<T: Real>(x: &[T], y: &[T]) -> T {
    struct Run<'a, T>(&'a [T], &'a [T]);
    impl<T: Real> WithSimd for Run<'_, T> {
        type Output = T;
        #[inline(always)]
        fn with_simd<S: Simd>(self, s: S) -> T {
            fold(
                s,
                self.0,
                self.1,
                #[inline(always)]
                |acc, a, b| T::fma(s, a, b, acc),
            )
        }
    }
    Arch::new().dispatch(Run(x, y))
}

/// Sum of (x - y)^2.
pub(super) fn distance2<T: Real>(x: &[T], y: &[T]) -> T {
    struct Run<'a, T>(&'a [T], &'a [T]);
    impl<T: Real> WithSimd for Run<'_, T> {
        type Output = T;
        #[inline(always)]
        fn with_simd<S: Simd>(self, s: S) -> T {
            fold(
                s,
                self.0,
                self.1,
                #[inline(always)]
                |acc, a, b| {
                    let d = T::vsub(s, a, b);
                    T::fma(s, d, d, acc)
                },
            )
        }
    }
    Arch::new().dispatch(Run(x, y))
}

/// x = x + share (y - x): the moving average of target networks.
pub(super) fn follow<T: Real>(x: &mut [T], y: &[T], share: T) {
    struct Run<'a, T>(&'a mut [T], &'a [T], T);
    impl<T: Real> WithSimd for Run<'_, T> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, s: S) {
            let k = T::splat(s, self.2);
            zip(
                s,
                self.0,
                self.1,
                #[inline(always)]
                |a, b| T::fma(s, k, T::vsub(s, b, a), a),
            );
        }
    }
    Arch::new().dispatch(Run(x, y, share));
}

/// x = e^(scale (x - shift)) in place; returns the sum.
pub(super) fn exp_sum<T: Real>(x: &mut [T], scale: T, shift: T) -> T {
    struct Run<'a, T>(&'a mut [T], T, T);
    impl<T: Real> WithSimd for Run<'_, T> {
        type Output = T;
        #[inline(always)]
        fn with_simd<S: Simd>(self, s: S) -> T {
            let (k, c) = (T::splat(s, self.1), T::splat(s, self.2));
            map(
                s,
                self.0,
                #[inline(always)]
                |v| T::exp::<S>(s, T::vmul(s, k, T::vsub(s, v, c))),
            );
            let one = T::splat(s, T::of(1.0));
            fold(
                s,
                self.0,
                self.0,
                #[inline(always)]
                |acc, a, _| T::fma(s, a, one, acc),
            )
        }
    }
    Arch::new().dispatch(Run(x, scale, shift))
}

/// Layer normalisation with gain and bias, then tanh, row by row.
#[derive(Debug)]
pub(super) struct NormTanh<'a, T> {
    /// Gain, (n).
    pub(super) gain: &'a [T],
    /// Bias, (n).
    pub(super) bias: &'a [T],
    /// Input, then the normalised input, (rows, n).
    pub(super) x: &'a mut [T],
    /// 1 / standard deviation of each row, (rows).
    pub(super) rstd: &'a mut [T],
    /// Output, (rows, n).
    pub(super) y: &'a mut [T],
}

impl<T: Real> NormTanh<'_, T> {
    /// Computes the output; keeps what the backward pass needs in `x` and `rstd`.
    pub(super) fn forward(self) {
        Arch::new().dispatch(self);
    }
}

impl<T: Real> WithSimd for NormTanh<'_, T> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        let n = self.gain.len();
        let (inv, one) = (T::of(1.0 / n as f64), T::splat(s, T::of(1.0)));
        let rows = self.x.chunks_exact_mut(n).zip(self.y.chunks_exact_mut(n)).zip(self.rstd);
        for ((x, y), rstd) in rows {
            let mean = fold(
                s,
                x,
                x,
                #[inline(always)]
                |acc, a, _| T::fma(s, a, one, acc),
            ) * inv;
            let shift = T::splat(s, mean);
            // The tail's missing lanes would turn into -mean; sums below use x only.
            map(
                s,
                x,
                #[inline(always)]
                |v| T::vsub(s, v, shift),
            );
            let var = fold(
                s,
                x,
                x,
                #[inline(always)]
                |acc, a, b| T::fma(s, a, b, acc),
            ) * inv;
            let r = T::of(1.0 / (var.f64() + NORM_EPS).sqrt());
            *rstd = r;
            let scale = T::splat(s, r);
            map(
                s,
                x,
                #[inline(always)]
                |v| T::vmul(s, v, scale),
            );
            y.copy_from_slice(x);
            zip(
                s,
                y,
                self.gain,
                #[inline(always)]
                |a, g| T::vmul(s, a, g),
            );
            zip(
                s,
                y,
                self.bias,
                #[inline(always)]
                |a, b| tanh_v::<T, S>(s, T::vadd(s, a, b)),
            );
        }
    }
}

/// Gradient of [`NormTanh`].
#[derive(Debug)]
pub(super) struct NormTanhBack<'a, T> {
    /// Gain, (n).
    pub(super) gain: &'a [T],
    /// Normalised input as the forward pass left it, (rows, n).
    pub(super) x: &'a [T],
    /// As the forward pass left it, (rows).
    pub(super) rstd: &'a [T],
    /// Output of the forward pass, (rows, n).
    pub(super) y: &'a [T],
    /// Gradient by the output, then by the input, (rows, n).
    pub(super) d: &'a mut [T],
    /// Gradients by gain and bias are added here, (n) each.
    pub(super) dgain: &'a mut [T],
    /// See `dgain`.
    pub(super) dbias: &'a mut [T],
}

impl<T: Real> NormTanhBack<'_, T> {
    /// Runs the backward pass.
    pub(super) fn backward(self) {
        Arch::new().dispatch(self);
    }
}

impl<T: Real> WithSimd for NormTanhBack<'_, T> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        let n = self.gain.len();
        let inv = T::of(1.0 / n as f64);
        let one = T::splat(s, T::of(1.0));
        let rows = self.x.chunks_exact(n).zip(self.y.chunks_exact(n)).zip(self.rstd);
        for (((x, y), &r), d) in rows.zip(self.d.chunks_exact_mut(n)) {
            zip(
                s,
                d,
                y,
                #[inline(always)]
                |d, y| T::vmul(s, d, T::vsub(s, one, T::vmul(s, y, y))),
            );
            zip(
                s,
                self.dbias,
                d,
                #[inline(always)]
                |a, d| T::vadd(s, a, d),
            );
            add_product(s, self.dgain, d, x);
            zip(
                s,
                d,
                self.gain,
                #[inline(always)]
                |d, g| T::vmul(s, d, g),
            );
            let mean = T::splat(
                s,
                fold(
                    s,
                    d,
                    d,
                    #[inline(always)]
                    |acc, a, _| T::fma(s, a, one, acc),
                ) * inv,
            );
            let slope = T::splat(
                s,
                fold(
                    s,
                    d,
                    x,
                    #[inline(always)]
                    |acc, a, b| T::fma(s, a, b, acc),
                ) * inv,
            );
            let scale = T::splat(s, r);
            zip(
                s,
                d,
                x,
                #[inline(always)]
                |d, x| {
                    let centred = T::vsub(s, T::vsub(s, d, mean), T::vmul(s, x, slope));
                    T::vmul(s, centred, scale)
                },
            );
        }
    }
}

/// out += a b.
#[inline(always)]
fn add_product<T: Real, S: Simd>(s: S, out: &mut [T], a: &[T], b: &[T]) {
    let (ov, ot) = T::vectors_mut::<S>(out);
    let ((av, at), (bv, bt)) = (T::vectors::<S>(a), T::vectors::<S>(b));
    for ((o, a), b) in ov.iter_mut().zip(av).zip(bv) {
        *o = T::fma(s, *a, *b, *o);
    }
    if !ot.is_empty() {
        let v = T::fma(s, T::load(s, at), T::load(s, bt), T::load(s, ot));
        T::store(s, ot, v);
    }
}

/// One step of Adam (Kingma and Ba 2015) with beta .9 and .999, eps 1e-8.
#[derive(Debug)]
pub(super) struct AdamStep<'a, T> {
    /// Parameters.
    pub(super) params: &'a mut [T],
    /// Gradients.
    pub(super) grads: &'a [T],
    /// First moments.
    pub(super) m: &'a mut [T],
    /// Second moments.
    pub(super) v: &'a mut [T],
    /// lr / (1 - beta1^t).
    pub(super) rate: T,
    /// 1 / sqrt(1 - beta2^t).
    pub(super) scale: T,
}

impl<T: Real> AdamStep<'_, T> {
    /// Takes the step.
    pub(super) fn run(self) {
        Arch::new().dispatch(self);
    }
}

impl<T: Real> WithSimd for AdamStep<'_, T> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        let c = |x: f64| T::splat(s, T::of(x));
        zip(
            s,
            self.m,
            self.grads,
            #[inline(always)]
            |m, g| T::fma(s, c(0.1), T::vsub(s, g, m), m),
        );
        zip(
            s,
            self.v,
            self.grads,
            #[inline(always)]
            |v, g| T::fma(s, c(0.001), T::vsub(s, T::vmul(s, g, g), v), v),
        );
        let (rate, scale) = (T::splat(s, self.rate), T::splat(s, self.scale));
        let step = |p, m, v| {
            let spread = T::fma(s, T::vsqrt(s, v), scale, c(1e-8));
            T::vsub(s, p, T::vdiv(s, T::vmul(s, rate, m), spread))
        };
        let (pv, pt) = T::vectors_mut::<S>(self.params);
        let ((mv, mt), (vv, vt)) = (T::vectors::<S>(self.m), T::vectors::<S>(self.v));
        for ((p, m), v) in pv.iter_mut().zip(mv).zip(vv) {
            *p = step(*p, *m, *v);
        }
        if !pt.is_empty() {
            let v = step(T::load(s, pt), T::load(s, mt), T::load(s, vt));
            T::store(s, pt, v);
        }
    }
}
