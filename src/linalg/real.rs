//! A numeric trait for f32 and f64: every kernel is written once and runs in f32 (training) and f64
//! (gradient checks, closed-form fits).
//!
//! Vector instructions come from `pulp`, which selects SSE, AVX2, AVX-512 or NEON at run time
//! behind a safe interface. Rejected: `target-cpu=native` (a released binary would be slow or not
//! start elsewhere) and the `gemm` crate's `unsafe fn` (this crate keeps unsafe code in the
//! simulator binding and the tile unit).

// Vector code must be inlined into the function that pulp compiles for the processor found.
#![allow(clippy::inline_always)]

use std::cell::RefCell;
use std::fmt::Debug;
use std::iter::Sum;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

use bytemuck::Pod;
use pulp::Simd;

use super::aligned::Aligned;
use super::gemm::Products;
use super::simd::Kernels;

/// f32 or f64, with the vector operations that the kernels use.
pub trait Real:
    Pod
    + Debug
    + Default
    + PartialOrd
    + Send
    + Sync
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + Sum
    + Kernels<Self>
    + Products<Self>
{
    /// A register of [`Real::lanes`] numbers.
    type V<S: Simd>: Pod + Debug + Send + Sync;

    /// Nearest number to `x`.
    fn of(x: f64) -> Self;
    /// This number in f64.
    fn f64(self) -> f64;
    /// Numbers in a register.
    fn lanes<S: Simd>() -> usize;
    /// All lanes `x`.
    fn splat<S: Simd>(s: S, x: Self) -> Self::V<S>;
    /// Whole registers and the rest.
    fn vectors<S: Simd>(x: &[Self]) -> (&[Self::V<S>], &[Self]);
    /// Whole registers and the rest, for writing.
    fn vectors_mut<S: Simd>(x: &mut [Self]) -> (&mut [Self::V<S>], &mut [Self]);
    /// The first lanes from `x`, the others 0.
    fn load<S: Simd>(s: S, x: &[Self]) -> Self::V<S>;
    /// The first `x.len()` lanes to `x`.
    fn store<S: Simd>(s: S, x: &mut [Self], v: Self::V<S>);
    /// a + b.
    fn vadd<S: Simd>(s: S, a: Self::V<S>, b: Self::V<S>) -> Self::V<S>;
    /// a − b.
    fn vsub<S: Simd>(s: S, a: Self::V<S>, b: Self::V<S>) -> Self::V<S>;
    /// a · b.
    fn vmul<S: Simd>(s: S, a: Self::V<S>, b: Self::V<S>) -> Self::V<S>;
    /// a / b.
    fn vdiv<S: Simd>(s: S, a: Self::V<S>, b: Self::V<S>) -> Self::V<S>;
    /// a · b + c.
    fn fma<S: Simd>(s: S, a: Self::V<S>, b: Self::V<S>, c: Self::V<S>) -> Self::V<S>;
    /// The larger number in each lane.
    fn vmax<S: Simd>(s: S, a: Self::V<S>, b: Self::V<S>) -> Self::V<S>;
    /// Square root.
    fn vsqrt<S: Simd>(s: S, a: Self::V<S>) -> Self::V<S>;
    /// Sum over the lanes.
    fn vsum<S: Simd>(s: S, a: Self::V<S>) -> Self;
    /// Largest lane.
    fn top<S: Simd>(s: S, a: Self::V<S>) -> Self;
    /// e^a; inputs below −87 give about e^−87 (f32).
    fn exp<S: Simd>(s: S, a: Self::V<S>) -> Self::V<S>;
    /// Lends the packing buffer of this thread, so that products allocate only while shapes grow.
    fn with_scratch<R>(f: impl FnOnce(&mut Aligned<Self>) -> R) -> R;
    /// Lends the buffer for the rows of a left factor.
    fn with_left<R>(f: impl FnOnce(&mut Aligned<Self>) -> R) -> R;
    /// The same numbers, if they are in single precision, for the tile unit.
    fn singles(x: &[Self]) -> Option<&[f32]>;
    /// The same numbers for writing, if they are in single precision.
    fn singles_mut(x: &mut [Self]) -> Option<&mut [f32]>;
    /// Exact GELU x Φ(x) and its derivative Φ(x) + x φ(x).
    fn vgelu<S: Simd>(s: S, a: Self::V<S>) -> (Self::V<S>, Self::V<S>);
}

macro_rules! vector_ops {
    ($t:ty, $vs:ident, $lanes:ident, $splat:ident, $as:ident, $as_mut:ident, $load:ident,
     $store:ident, $add:ident, $sub:ident, $mul:ident, $div:ident, $fma:ident, $max:ident,
     $sqrt:ident, $sum:ident, $top:ident) => {
        type V<S: Simd> = S::$vs;

        fn with_scratch<R>(f: impl FnOnce(&mut Aligned<Self>) -> R) -> R {
            thread_local! {
                static SCRATCH: RefCell<Aligned<$t>> = RefCell::default();
            }
            SCRATCH.with_borrow_mut(f)
        }

        fn with_left<R>(f: impl FnOnce(&mut Aligned<Self>) -> R) -> R {
            thread_local! {
                static LEFT: RefCell<Aligned<$t>> = RefCell::default();
            }
            LEFT.with_borrow_mut(f)
        }

        #[inline(always)]
        fn of(x: f64) -> Self {
            x as $t
        }
        #[inline(always)]
        fn f64(self) -> f64 {
            self as f64
        }
        #[inline(always)]
        fn lanes<S: Simd>() -> usize {
            S::$lanes
        }
        #[inline(always)]
        fn splat<S: Simd>(s: S, x: Self) -> S::$vs {
            s.$splat(x)
        }
        #[inline(always)]
        fn vectors<S: Simd>(x: &[Self]) -> (&[S::$vs], &[Self]) {
            S::$as(x)
        }
        #[inline(always)]
        fn vectors_mut<S: Simd>(x: &mut [Self]) -> (&mut [S::$vs], &mut [Self]) {
            S::$as_mut(x)
        }
        #[inline(always)]
        fn load<S: Simd>(s: S, x: &[Self]) -> S::$vs {
            s.$load(x)
        }
        #[inline(always)]
        fn store<S: Simd>(s: S, x: &mut [Self], v: S::$vs) {
            s.$store(x, v);
        }
        #[inline(always)]
        fn vadd<S: Simd>(s: S, a: S::$vs, b: S::$vs) -> S::$vs {
            s.$add(a, b)
        }
        #[inline(always)]
        fn vsub<S: Simd>(s: S, a: S::$vs, b: S::$vs) -> S::$vs {
            s.$sub(a, b)
        }
        #[inline(always)]
        fn vmul<S: Simd>(s: S, a: S::$vs, b: S::$vs) -> S::$vs {
            s.$mul(a, b)
        }
        #[inline(always)]
        fn vdiv<S: Simd>(s: S, a: S::$vs, b: S::$vs) -> S::$vs {
            s.$div(a, b)
        }
        #[inline(always)]
        fn fma<S: Simd>(s: S, a: S::$vs, b: S::$vs, c: S::$vs) -> S::$vs {
            s.$fma(a, b, c)
        }
        #[inline(always)]
        fn vmax<S: Simd>(s: S, a: S::$vs, b: S::$vs) -> S::$vs {
            s.$max(a, b)
        }
        #[inline(always)]
        fn vsqrt<S: Simd>(s: S, a: S::$vs) -> S::$vs {
            s.$sqrt(a)
        }
        #[inline(always)]
        fn vsum<S: Simd>(s: S, a: S::$vs) -> Self {
            s.$sum(a)
        }
        #[inline(always)]
        fn top<S: Simd>(s: S, a: S::$vs) -> Self {
            s.$top(a)
        }
    };
}

/// e^r on |r| ≤ ln 2 / 2, lowest power first; our own Chebyshev fit, error 2e-9.
#[allow(clippy::excessive_precision)] // as fitted
const EXP: [f32; 7] = [
    1.0,
    1.000_000_038,
    0.500_000_004_7,
    0.166_664_154_1,
    0.041_666_352_77,
    0.008_375_134_775,
    0.001_394_111_89,
];

/// erfc(z) = e^(−z²) t Q(t) with t = 1 / (1 + 0.35 z), the form of Abramowitz and Stegun
/// 7.1.26 with our own fit of degree 8 on z in 0..9, error of Q 2.7e-8.
const ERFC_P: f32 = 0.35;
#[allow(clippy::excessive_precision)] // as fitted
const ERFC_Q: [f32; 9] = [
    0.197_685_641_6,
    0.193_454_575_8,
    0.216_792_380_9,
    0.023_310_872_94,
    0.498_482_647_8,
    -0.541_137_249,
    0.697_492_656_6,
    -0.342_417_405_8,
    0.056_335_864_16,
];

#[inline(always)]
fn horner<S: Simd>(s: S, c: &[f32], x: S::f32s) -> S::f32s {
    let mut y = s.splat_f32s(0.0);
    for &k in c.iter().rev() {
        y = s.mul_add_e_f32s(y, x, s.splat_f32s(k));
    }
    y
}

impl Real for f32 {
    vector_ops!(
        f32,
        f32s,
        F32_LANES,
        splat_f32s,
        as_simd_f32s,
        as_mut_simd_f32s,
        partial_load_f32s,
        partial_store_f32s,
        add_f32s,
        sub_f32s,
        mul_f32s,
        div_f32s,
        mul_add_e_f32s,
        max_f32s,
        sqrt_f32s,
        reduce_sum_f32s,
        reduce_max_f32s
    );

    fn singles(x: &[Self]) -> Option<&[f32]> {
        Some(x)
    }

    fn singles_mut(x: &mut [Self]) -> Option<&mut [f32]> {
        Some(x)
    }

    /// Range reduction by Cody and Waite: x = n ln 2 + r, e^x = 2^n e^r.
    #[inline(always)]
    fn exp<S: Simd>(s: S, a: S::f32s) -> S::f32s {
        const MAGIC: f32 = 12_582_912.0; // 1.5 · 2^23: adding it rounds to an integer
        let a = s.min_f32s(s.max_f32s(a, s.splat_f32s(-87.0)), s.splat_f32s(88.0));
        let t = s.mul_add_e_f32s(a, s.splat_f32s(std::f32::consts::LOG2_E), s.splat_f32s(MAGIC));
        let n = s.sub_f32s(t, s.splat_f32s(MAGIC));
        let r = s.mul_add_e_f32s(n, s.splat_f32s(-355.0 / 512.0), a);
        let r = s.mul_add_e_f32s(n, s.splat_f32s(2.121_944_4e-4), r);
        let p = horner(s, &EXP, r);
        // The low bits of `t` hold n; shifted into the exponent field they multiply by 2^n.
        let n = s.wrapping_dyn_shl_u32s(s.transmute_u32s_f32s(t), s.splat_u32s(23));
        s.transmute_f32s_u32s(s.add_u32s(s.transmute_u32s_f32s(p), n))
    }

    #[inline(always)]
    fn vgelu<S: Simd>(s: S, x: S::f32s) -> (S::f32s, S::f32s) {
        let half = s.splat_f32s(0.5);
        let ax = s.abs_f32s(x);
        let z = s.mul_f32s(ax, s.splat_f32s(std::f32::consts::FRAC_1_SQRT_2));
        let t = s.div_f32s(
            s.splat_f32s(1.0),
            s.mul_add_e_f32s(z, s.splat_f32s(ERFC_P), s.splat_f32s(1.0)),
        );
        let e = <Self as Real>::exp(s, s.mul_f32s(s.mul_f32s(x, x), s.splat_f32s(-0.5)));
        let q = horner(s, &ERFC_Q, t);
        // Φ(−|x|), small and accurate to the last bits even far out.
        let tail = s.mul_f32s(s.mul_f32s(half, e), s.mul_f32s(t, q));
        let negative = s.less_than_f32s(x, s.splat_f32s(0.0));
        let phi = s.select_f32s(negative, tail, s.sub_f32s(s.splat_f32s(1.0), tail));
        let density = s.mul_f32s(e, s.splat_f32s(0.398_942_3));
        (s.mul_f32s(x, phi), s.mul_add_e_f32s(x, density, phi))
    }
}

impl Real for f64 {
    vector_ops!(
        f64,
        f64s,
        F64_LANES,
        splat_f64s,
        as_simd_f64s,
        as_mut_simd_f64s,
        partial_load_f64s,
        partial_store_f64s,
        add_f64s,
        sub_f64s,
        mul_f64s,
        div_f64s,
        mul_add_e_f64s,
        max_f64s,
        sqrt_f64s,
        reduce_sum_f64s,
        reduce_max_f64s
    );

    fn singles(_: &[Self]) -> Option<&[f32]> {
        None
    }

    fn singles_mut(_: &mut [Self]) -> Option<&mut [f32]> {
        None
    }

    #[inline(always)]
    fn exp<S: Simd>(_s: S, mut a: S::f64s) -> S::f64s {
        for x in bytemuck::cast_slice_mut::<S::f64s, f64>(std::slice::from_mut(&mut a)) {
            *x = x.exp();
        }
        a
    }

    #[inline(always)]
    fn vgelu<S: Simd>(_s: S, mut a: S::f64s) -> (S::f64s, S::f64s) {
        let mut d = a;
        let xs = bytemuck::cast_slice_mut::<S::f64s, f64>(std::slice::from_mut(&mut a));
        let ds = bytemuck::cast_slice_mut::<S::f64s, f64>(std::slice::from_mut(&mut d));
        for (x, d) in xs.iter_mut().zip(ds) {
            let phi = 0.5 * (1.0 + erf(*x * std::f64::consts::FRAC_1_SQRT_2));
            let density = (-0.5 * *x * *x).exp() * 0.398_942_280_401_432_7;
            *d = *x * density + phi;
            *x *= phi;
        }
        (a, d)
    }
}

/// erf to about 1e-16: its all-positive series (Abramowitz and Stegun 7.1.6) below 3, the
/// continued fraction of erfc (7.1.14) above.
fn erf(x: f64) -> f64 {
    let z = x.abs();
    let y = if z < 3.0 {
        let (mut term, mut sum, mut n) = (z, z, 1.0);
        while term > 1e-18 * sum {
            term *= 2.0 * z * z / (2.0 * n + 1.0);
            sum += term;
            n += 1.0;
        }
        std::f64::consts::FRAC_2_SQRT_PI * (-z * z).exp() * sum
    } else {
        let mut fraction = z;
        for k in (1..60).rev() {
            fraction = z + 0.5 * f64::from(k) / fraction;
        }
        1.0 - (-z * z).exp() / fraction * 0.5 * std::f64::consts::FRAC_2_SQRT_PI
    };
    y.copysign(x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pulp::{Arch, WithSimd};

    struct Eval<'a>(&'a [f32], &'a mut Vec<[f32; 3]>);
    impl WithSimd for Eval<'_> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, s: S) {
            for &x in self.0 {
                let v = s.splat_f32s(x);
                let lane = |v: S::f32s| bytemuck::cast_slice::<S::f32s, f32>(&[v])[0];
                let (y, d) = f32::vgelu(s, v);
                self.1.push([lane(<f32 as Real>::exp(s, v)), lane(y), lane(d)]);
            }
        }
    }

    #[test]
    fn f32_functions_are_accurate() {
        let xs: Vec<f32> = (-4000..4000_i16).map(|i| f32::from(i) * 0.005).collect();
        let mut ys = Vec::new();
        Arch::new().dispatch(Eval(&xs, &mut ys));
        for (&x, y) in xs.iter().zip(&ys) {
            let x = f64::from(x);
            let phi = 0.5 * (1.0 + erf(x / 2_f64.sqrt()));
            let density = (-0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt();
            assert!((f64::from(y[0]) / x.exp() - 1.0).abs() < 3e-7, "exp {x}");
            assert!((f64::from(y[1]) - x * phi).abs() < 2e-7 * x.abs().max(1.0), "gelu {x}");
            assert!((f64::from(y[2]) - (phi + x * density)).abs() < 3e-7, "gelu' {x}");
        }
    }

    #[test]
    fn erf_agrees_with_its_integral() {
        let (mut sum, n) = (0.0, 400_000);
        for i in 0..n {
            let t = (f64::from(i) + 0.5) * 5.0 / f64::from(n);
            sum += (-t * t).exp() * 5.0 / f64::from(n) * std::f64::consts::FRAC_2_SQRT_PI;
            if (i + 1) % 20_000 == 0 {
                let x = f64::from(i + 1) * 5.0 / f64::from(n);
                assert!((erf(x) - sum).abs() < 1e-10, "{x}");
                assert_eq!(erf(-x), -erf(x));
            }
        }
    }
}
