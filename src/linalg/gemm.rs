//! Matrix products; [`super::bf16x3`] computes some of them on tiles.
//!
//! A register-blocked product after Goto and van de Geijn (2008). The right factor is packed in
//! panels three registers wide, and a tile of 8 or 9 rows (4 with 16 registers) stays in registers
//! while the inner dimension runs. A row-major left factor is read in place. Of a column-major one
//! (gradients of weights), a block of rows is copied first: read in place, each step of a tile is
//! on another page, and products of activations outside the cache had .7 of the current speed.
//! Weights are packed once per step (or once per model, at inference) for all products that use
//! them. The code is safe: slicing before the inner loop proves the bounds. Rejected: the `gemm`
//! crate, whose entry point is unsafe and which packs the right factor again at every call.
//!
//! On processors with a tile unit, weights and their gradients are multiplied there
//! ([`gemm_tiled`], [`Packed::pack_tiled`]). Everything else is computed here.
//!
//! For given shapes each output is summed in a fixed order (one chain of fused multiply-adds here,
//! a fixed number of chains on tiles), so results never depend on threads. They do depend on the
//! kind of processor: the width of its registers, and whether it has tiles.

// Vector code must be inlined into the function that pulp compiles for the processor found.
#![allow(clippy::inline_always)]

use pulp::{Simd, WithSimd};

use super::aligned::Aligned;
#[cfg(target_arch = "x86_64")]
use super::bf16x3::{self, Factor, Terms};
use super::mat::{Init, Mat, MatMut, Place, finish, unrolled};
use super::numerics::arch;
use super::real::Real;

/// Registers in the width of a panel.
const NV: usize = 3;
/// Inner dimension of one pass; a longer one is divided so that a panel stays in the cache.
const KC: usize = 768;
/// Rows of a transposed left factor that are copied at once; they stay in the cache.
const MC: usize = 64;

/// A right factor (k, n) in panels, or in terms for the tile unit.
#[derive(Clone, Debug, Default)]
pub struct Packed<T: Real> {
    data: Aligned<T>,
    k: usize,
    n: usize,
    lanes: usize,
    #[cfg(target_arch = "x86_64")]
    terms: Terms,
    #[cfg(target_arch = "x86_64")]
    /// Whether the factor is stored as terms.
    tiled: bool,
}

impl<T: Real> Packed<T> {
    /// Packs `b` and reuses memory if it is large enough.
    pub fn pack(&mut self, b: Mat<'_, T>) {
        #[cfg(target_arch = "x86_64")]
        {
            self.tiled = false;
        }
        T::pack(self, b);
    }

    /// Packs `b` for products of many rows, for the tile unit if there is one.
    pub fn pack_tiled(&mut self, b: Mat<'_, T>) {
        #[cfg(target_arch = "x86_64")]
        if bf16x3::suits(b.rows, b.cols)
            && let Some(b) = b.single()
        {
            self.terms.pack(b);
            (self.k, self.n, self.tiled) = (b.shape().0, b.shape().1, true);
            return;
        }
        self.pack(b);
    }

    /// Rows of the packed factor.
    pub fn rows(&self) -> usize {
        self.k
    }

    /// A packed copy of `b`.
    pub fn new(b: Mat<'_, T>) -> Self {
        let mut packed = Packed::default();
        packed.pack(b);
        packed
    }
}

/// Whether products of many rows in single precision run on a tile unit here (Intel AMX).
pub fn tiled() -> bool {
    #[cfg(target_arch = "x86_64")]
    return bf16x3::usable();
    #[cfg(not(target_arch = "x86_64"))]
    false
}

/// The packing and the product for one type of number. They are compiled in this crate, once for
/// f32 and once for f64, instead of in every crate that multiplies.
pub trait Products<T: Real> {
    /// Packs `b` in panels.
    fn pack(out: &mut Packed<T>, b: Mat<'_, T>);
    /// out = init + a b.
    fn product(out: MatMut<'_, T>, init: Init<'_, T>, a: Mat<'_, T>, b: &Packed<T>);
}

macro_rules! products {
    ($t:ty) => {
        impl Products<$t> for $t {
            fn pack(out: &mut Packed<$t>, b: Mat<'_, $t>) {
                arch().dispatch(Pack { out, b });
            }

            fn product(out: MatMut<'_, $t>, init: Init<'_, $t>, a: Mat<'_, $t>, b: &Packed<$t>) {
                <$t>::with_left(|left| arch().dispatch(Gemm { out, init, a, b, left }));
            }
        }
    };
}

products!(f32);
products!(f64);

struct Pack<'a, 'b, T: Real> {
    out: &'a mut Packed<T>,
    b: Mat<'b, T>,
}

impl<T: Real> WithSimd for Pack<'_, '_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _s: S) {
        let (k, n, lanes) = (self.b.rows, self.b.cols, T::lanes::<S>());
        let out = self.out;
        out.data.reserve(k * n.next_multiple_of(lanes));
        (out.k, out.n, out.lanes) = (k, n, lanes);
        let mut rest: &mut [T] = &mut out.data;
        let mut first = 0;
        while first < n {
            let wide = (NV * lanes).min((n - first).next_multiple_of(lanes));
            let used = wide.min(n - first);
            let (panel, after) = std::mem::take(&mut rest).split_at_mut(k * wide);
            rest = after;
            if self.b.transposed {
                // Column j of b is contiguous: it is row first + j in memory.
                for j in 0..used {
                    let column = &self.b.data[(first + j) * self.b.stride..][..k];
                    for (row, &x) in panel.chunks_exact_mut(wide).zip(column) {
                        row[j] = x;
                    }
                }
                if used < wide {
                    for row in panel.chunks_exact_mut(wide) {
                        row[used..].fill(T::default());
                    }
                }
            } else {
                for (i, row) in panel.chunks_exact_mut(wide).enumerate() {
                    let from = &self.b.data[i * self.b.stride + first..][..used];
                    let (head, tail) = row.split_at_mut(used);
                    head.copy_from_slice(from);
                    tail.fill(T::default());
                }
            }
            first += wide;
        }
    }
}

/// out = init + a b, with `b` packed before.
///
/// # Panics
/// When the shapes disagree.
pub fn gemm_packed<T: Real>(out: MatMut<'_, T>, init: Init<'_, T>, a: Mat<'_, T>, b: &Packed<T>) {
    assert!(a.cols == b.k && out.rows == a.rows && out.cols == b.n, "shapes of a product disagree");
    #[cfg(target_arch = "x86_64")]
    if b.tiled {
        product_on_tiles(out, init, a, Factor::Terms(&b.terms));
        return;
    }
    T::product(out, init, a, b);
}

/// out = init + a b.
///
/// # Panics
/// When the shapes disagree.
pub fn gemm<T: Real>(out: MatMut<'_, T>, init: Init<'_, T>, a: Mat<'_, T>, b: Mat<'_, T>) {
    T::with_scratch(|scratch| {
        let mut packed = Packed { data: std::mem::take(scratch), ..Packed::default() };
        packed.pack(b);
        gemm_packed(out, init, a, &packed);
        *scratch = packed.data;
    });
}

/// out = init + a b for larger factors, by the tile unit if there is one.
///
/// # Panics
/// When the shapes disagree.
pub fn gemm_tiled<T: Real>(out: MatMut<'_, T>, init: Init<'_, T>, a: Mat<'_, T>, b: Mat<'_, T>) {
    #[cfg(target_arch = "x86_64")]
    if bf16x3::suits(b.rows, b.cols)
        && let Some(b) = b.single()
    {
        product_on_tiles(out, init, a, Factor::Mat(b));
        return;
    }
    gemm(out, init, a, b);
}

/// out = init + a b on the tile unit.
#[cfg(target_arch = "x86_64")]
fn product_on_tiles<T: Real>(out: MatMut<'_, T>, init: Init<'_, T>, a: Mat<'_, T>, b: Factor<'_>) {
    let (Some(mut out), Some(init), Some(a)) = (out.single(), init.single(), a.single()) else {
        unreachable!("double precision is never packed for the tile unit")
    };
    bf16x3::product(&mut out, init, a, b);
}

struct Gemm<'a, 'b, T: Real> {
    out: MatMut<'a, T>,
    init: Init<'b, T>,
    a: Mat<'b, T>,
    b: &'b Packed<T>,
    /// Buffer for a copy of some rows of a column-major left factor.
    left: &'a mut Aligned<T>,
}

impl<T: Real> WithSimd for Gemm<'_, '_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, s: S) {
        assert!(self.b.lanes == T::lanes::<S>(), "packed for another processor");
        let (k, n) = (self.b.k, self.b.n);
        let pass = k.div_ceil(k.div_ceil(KC).max(1));
        let mut start = 0;
        loop {
            let depth = pass.min(k - start);
            let mut first = 0;
            while first < self.out.rows || first == 0 {
                let rows = if self.a.transposed { MC } else { self.out.rows };
                let rows = rows.min(self.out.rows - first);
                if self.a.transposed {
                    self.copy_left(start, depth, first, rows, S::REGISTER_COUNT >= 32);
                }
                let mut panel_at = 0;
                let mut col = 0;
                while col < n {
                    let wide = (NV * self.b.lanes).min((n - col).next_multiple_of(self.b.lanes));
                    let panel = &self.b.data[panel_at + start * wide..][..depth * wide];
                    panel_at += k * wide;
                    let cols = wide.min(n - col);
                    let block = Block { start, depth, panel, col, cols, first, rows };
                    match wide / self.b.lanes {
                        1 => self.rows::<S, 1>(s, &block),
                        2 => self.rows::<S, 2>(s, &block),
                        _ => self.rows::<S, 3>(s, &block),
                    }
                    col += wide;
                }
                first += rows.max(1);
            }
            start += depth;
            if start >= k {
                return;
            }
        }
    }
}

/// One panel's share of the inner dimension.
struct Block<'a, T> {
    start: usize,
    depth: usize,
    panel: &'a [T],
    col: usize,
    cols: usize,
    /// Rows `first..first + rows` of the result.
    first: usize,
    rows: usize,
}

impl<T: Real> Gemm<'_, '_, T> {
    /// Copies a block of the transposed left factor, so that every tile is contiguous.
    #[inline(always)]
    fn copy_left(&mut self, start: usize, depth: usize, first: usize, rows: usize, wide: bool) {
        self.left.reserve(MC * depth);
        let mut i = 0;
        while i < rows {
            let left = rows - i;
            let m = if left >= 8 && wide {
                8
            } else if left >= 4 {
                4
            } else if left >= 2 {
                2
            } else {
                1
            };
            let to = &mut self.left[i * depth..][..m * depth];
            let from = &self.a.data[start * self.a.stride + first + i..];
            match m {
                8 => gather::<T, 8>(from, self.a.stride, to),
                4 => gather::<T, 4>(from, self.a.stride, to),
                2 => gather::<T, 2>(from, self.a.stride, to),
                _ => gather::<T, 1>(from, self.a.stride, to),
            }
            i += m;
        }
    }

    #[inline(always)]
    fn rows<S: Simd, const N: usize>(&mut self, s: S, block: &Block<'_, T>) {
        let m = block.first + block.rows;
        let mut i = block.first;
        // 24 or 27 accumulators where there are 32 registers, 12 where there are 16.
        if S::REGISTER_COUNT >= 32 {
            // 51 frames, and the 27 of a second thread, divide into tiles of 9 and 8. Remaining
            // rows would need too few registers to hide the latency of a sum.
            let over = (m - i) % 8;
            if !self.a.transposed && 9 * over <= m - i {
                for _ in 0..over {
                    self.tile::<S, 9, N>(s, block, i);
                    i += 9;
                }
            }
            while i + 8 <= m {
                self.tile::<S, 8, N>(s, block, i);
                i += 8;
            }
        }
        while i + 4 <= m {
            self.tile::<S, 4, N>(s, block, i);
            i += 4;
        }
        if i + 2 <= m {
            self.tile::<S, 2, N>(s, block, i);
            i += 2;
        }
        if i < m {
            self.tile::<S, 1, N>(s, block, i);
        }
    }

    #[inline(always)]
    fn tile<S: Simd, const M: usize, const N: usize>(
        &mut self,
        s: S,
        block: &Block<'_, T>,
        row: usize,
    ) {
        let (panel, _) = T::vectors::<S>(block.panel);
        let (panel, _) = panel.as_chunks::<N>();
        let acc = if self.a.transposed {
            // Whole tiles of 8 come first in the copy, then those of 4, 2 and 1.
            let lines = &self.left[(row - block.first) * block.depth..];
            along_columns::<T, S, M, N>(s, lines, M, panel)
        } else {
            let lines = &self.a.data[row * self.a.stride + block.start..];
            along_rows::<T, S, M, N>(s, lines, self.a.stride, panel)
        };
        let (first, last) = (block.start == 0, block.start + block.depth == self.b.k);
        unrolled!(M, [0 1 2 3 4 5 6 7 8], |I| {
            let place = Place { row: row + I, col: block.col, cols: block.cols, first, last };
            finish::<T, S, N>(s, &mut self.out, self.init, acc[I], &place);
        });
    }
}

#[inline(always)]
fn gather<T: Real, const M: usize>(from: &[T], stride: usize, to: &mut [T]) {
    let (to, _) = to.as_chunks_mut::<M>();
    for (k, to) in to.iter_mut().enumerate() {
        to.copy_from_slice(&from[k * stride..][..M]);
    }
}

// The two inner loops return their accumulators by value and use constant indices only. Otherwise
// the compiler unrolls loops over them too late and keeps the numbers on the stack, which is three
// times slower.

#[inline(always)]
fn step<T: Real, S: Simd, const M: usize, const N: usize>(
    s: S,
    acc: [[T::V<S>; N]; M],
    a: impl Fn(usize) -> T,
    b: &[T::V<S>; N],
) -> [[T::V<S>; N]; M] {
    let mut acc = acc;
    unrolled!(M, [0 1 2 3 4 5 6 7 8], |I| {
        let x = T::splat(s, a(I));
        unrolled!(N, [0 1 2], |J| {
            acc[I][J] = T::fma(s, x, b[J], acc[I][J]);
        });
    });
    acc
}

#[inline(always)]
fn along_rows<T: Real, S: Simd, const M: usize, const N: usize>(
    s: S,
    a: &[T],
    stride: usize,
    panel: &[[T::V<S>; N]],
) -> [[T::V<S>; N]; M] {
    let mut acc = [[T::splat(s, T::default()); N]; M];
    let depth = panel.len();
    let lines: [&[T]; M] = std::array::from_fn(|i| &a[i * stride..][..depth]);
    for (k, b) in panel.iter().enumerate() {
        acc = step::<T, S, M, N>(
            s,
            acc,
            #[inline(always)]
            |i| lines[i][k],
            b,
        );
    }
    acc
}

#[inline(always)]
fn along_columns<T: Real, S: Simd, const M: usize, const N: usize>(
    s: S,
    a: &[T],
    stride: usize,
    panel: &[[T::V<S>; N]],
) -> [[T::V<S>; N]; M] {
    let mut acc = [[T::splat(s, T::default()); N]; M];
    for (k, b) in panel.iter().enumerate() {
        let line = &a[k * stride..][..M];
        acc = step::<T, S, M, N>(
            s,
            acc,
            #[inline(always)]
            |i| line[i],
            b,
        );
    }
    acc
}

#[cfg(test)]
mod tests {
    use super::*;
    use robert_base::rng::{Rng, Stream};

    fn random<T: Real>(n: usize, index: u64) -> Vec<T> {
        let mut rng = Rng::new(1, Stream::Test, index);
        (0..n).map(|_| T::of(rng.normal())).collect()
    }

    fn check<T: Real>(m: usize, k: usize, n: usize, ta: bool, tb: bool, eps: f64) {
        let (a, b, c0) = (random::<T>(m * k, 0), random::<T>(k * n, 1), random::<T>(m * n, 2));
        let bias = random::<T>(n, 3);
        let at = |i: usize, p: usize| a[if ta { p * m + i } else { i * k + p }].f64();
        let bt = |p: usize, j: usize| b[if tb { j * k + p } else { p * n + j }].f64();
        let ma = if ta { Mat::new(&a, k, m).t() } else { Mat::new(&a, m, k) };
        let mb = if tb { Mat::new(&b, n, k).t() } else { Mat::new(&b, k, n) };
        for which in 0..6 {
            let mut c = c0.clone();
            let init = match which {
                0 => Init::Zero,
                1 => Init::Add,
                2 => Init::Bias(&bias),
                3 => Init::AddBias(&bias),
                4 => Init::Times(&c0),
                _ => Init::Residual(&bias, &c0),
            };
            gemm(MatMut::new(&mut c, m, n), init, ma, mb);
            for i in 0..m {
                for j in 0..n {
                    let mut want: f64 = (0..k).map(|p| at(i, p) * bt(p, j)).sum();
                    if which % 2 == 1 {
                        want += c0[i * n + j].f64();
                    }
                    if [2, 3, 5].contains(&which) {
                        want += bias[j].f64();
                    }
                    if which == 4 {
                        want *= c0[i * n + j].f64();
                    }
                    let got = c[i * n + j].f64();
                    let scale = (k as f64).sqrt() + 1.0;
                    assert!((got - want).abs() < eps * scale, "{m}x{k}x{n} {i},{j}: {got} {want}");
                }
            }
        }
    }

    #[test]
    fn products_agree_with_the_definition() {
        for (m, k, n) in [
            (1, 1, 1),
            (3, 5, 7),
            (8, 16, 48),
            (13, 33, 51),
            (51, 20, 97),
            (9, 800, 49),
            (77, 5, 3),
        ] {
            for (ta, tb) in [(false, false), (true, false), (false, true), (true, true)] {
                check::<f32>(m, k, n, ta, tb, 4e-6);
                check::<f64>(m, k, n, ta, tb, 1e-13);
            }
        }
    }

    #[test]
    fn empty_inner_dimension_still_initialises() {
        let mut c = [7.0_f32; 4];
        gemm(MatMut::new(&mut c, 2, 2), Init::Zero, Mat::new(&[], 2, 0), Mat::new(&[], 0, 2));
        assert_eq!(c, [0.0; 4]);
    }

    #[test]
    fn strides_leave_the_gaps_alone() {
        let a = [1.0_f64, 2.0, 9.0, 3.0, 4.0, 9.0];
        let mut c = [5.0; 6];
        let b = [1.0, 0.0, 0.0, 1.0];
        let out = MatMut::strided(&mut c, 2, 2, 3);
        gemm(out, Init::Zero, Mat::strided(&a, 2, 2, 3), Mat::new(&b, 2, 2));
        assert_eq!(c, [1.0, 2.0, 5.0, 3.0, 4.0, 5.0]);
    }
}
