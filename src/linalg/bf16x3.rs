//! Products in single precision on a unit that multiplies bfloat16.
//!
//! A number of 24 significant bits is the sum of three of 8: x = x₀ + x₁ + x₂, each the
//! nearest bfloat16 of what is left. The product of two such sums is the sum of nine
//! products, of which [`Tiles::multiply`] adds the six that matter in single precision
//! (Henry, Tang, Heinecke 2019, "Leveraging the bfloat16 Artificial Intelligence Datatype
//! for Higher-Precision Computations", section III). The result is as accurate as a chain of fused
//! multiply-adds (see the test). On data in the cache one core of a Sapphire Rapids reached 420
//! GFLOP/s, against 148 by vector instructions; a whole training step is 1.3 to 1.4 times as fast.
//!
//! The unit treats numbers below 2⁻¹²⁶ as zero, so third terms vanish below about 1e-31. Numbers
//! within 2⁻⁹ of the largest round to infinity. If a factor is not finite, the result is not
//! finite; it may be NaN where vector instructions give an infinity.
//!
//! Factors are divided into blocks of 32 × 32. An inner step of the unit takes pairs of numbers.
//! Since the order of a sum is free, a pair here consists of steps j and j + 16 of a block, which
//! are in two registers that are loaded anyway.

// Vector code must be inlined into the function that pulp compiles for the processor found.
#![allow(clippy::inline_always)]

use std::arch::x86_64::{__m512, __m512d};
use std::cell::RefCell;

use pulp::x86::V4;
use pulp::{NullaryFnOnce, Simd, f32x16, u32x16};

use super::aligned::Aligned;
use super::amx::{BLOCK, SIDE, TERMS, TILE, Tiles};
use super::mat::{Init, Mat, MatMut, Place, finish};

/// Inner blocks of one pass; a longer product is divided so that rows stay in the cache.
const PASS: usize = 16;
/// Blocks of one factor that stay in the second cache while the other factor is read once.
const STAY: usize = 128;
/// Blocks of the streamed factor.
const PASSING: usize = 64;
/// The most rows of blocks at once.
const ROWS: usize = 8;
/// Inner blocks for which the right factor stays in the first cache.
const CHUNK: usize = 4;

const _: () = assert!(PASS * ROWS <= STAY);

/// A right factor (k, n), split and in blocks; blocks of the same 32 columns are contiguous. Each
/// word of its data is a pair of bfloat16, not a number.
#[derive(Clone, Debug, Default)]
pub(super) struct Terms {
    data: Aligned<f32>,
    k: usize,
    n: usize,
}

/// A right factor: split before, or to be split.
#[derive(Clone, Copy, Debug)]
pub(super) enum Factor<'a> {
    /// Split before.
    Terms(&'a Terms),
    /// To be split.
    Mat(Mat<'a, f32>),
}

/// Buffers of a thread: parts of both factors, and sums of a column of blocks.
#[derive(Default)]
struct Scratch {
    left: Aligned<f32>,
    right: Aligned<f32>,
    sums: Aligned<f32>,
}

thread_local! {
    static SCRATCH: RefCell<Scratch> = RefCell::default();
}

/// Whether this machine has the tile unit.
pub(super) fn usable() -> bool {
    super::numerics::unlimited() && Tiles::usable() && V4::is_available()
}

/// Whether a right factor of this shape is multiplied faster on tiles.
pub(super) fn suits(k: usize, n: usize) -> bool {
    k >= SIDE && n >= SIDE && usable()
}

impl Terms {
    /// Splits `b` and reuses memory if it is large enough.
    pub(super) fn pack(&mut self, b: Mat<'_, f32>) {
        let Some(v4) = V4::try_new() else { unreachable!("nothing suits without AVX-512") };
        let (k, n) = b.shape();
        (self.k, self.n) = (k, n);
        let deep = k.div_ceil(SIDE);
        let len = n.div_ceil(SIDE) * deep * BLOCK;
        self.data.reserve(len);
        v4.vectorize(Pack { v4, out: &mut self.data[..len], b, deep });
    }
}

struct Pack<'a, 'b> {
    v4: V4,
    out: &'a mut [f32],
    b: Mat<'b, f32>,
    deep: usize,
}

impl NullaryFnOnce for Pack<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        split_right(self.v4, self.b, 0, [0, self.deep], self.out);
    }
}

/// out = init + a b.
///
/// # Panics
/// When the shapes disagree.
pub(super) fn product(
    out: &mut MatMut<'_, f32>,
    init: Init<'_, f32>,
    a: Mat<'_, f32>,
    b: Factor<'_>,
) {
    let (k, n) = match b {
        Factor::Terms(b) => (b.k, b.n),
        Factor::Mat(b) => b.shape(),
    };
    let (rows, inner) = a.shape();
    assert!(k == inner && out.shape() == (rows, n), "shapes of a product disagree");
    assert!(k > 0, "an empty inner dimension does not suit");
    let (Some(v4), Some(tiles)) = (V4::try_new(), Tiles::start()) else {
        unreachable!("nothing suits without tiles")
    };
    SCRATCH.with_borrow_mut(|scratch| {
        v4.vectorize(Product { v4, tiles: &tiles, out, init, a, b, scratch });
    });
}

struct Product<'a, 'b, 'c> {
    v4: V4,
    tiles: &'a Tiles,
    out: &'a mut MatMut<'c, f32>,
    init: Init<'b, f32>,
    a: Mat<'b, f32>,
    b: Factor<'b>,
    scratch: &'a mut Scratch,
}

impl NullaryFnOnce for Product<'_, '_, '_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Product { v4, tiles, out, init, a, b, scratch } = self;
        let Scratch { left, right, sums } = scratch;
        let ((rows, k), (_, n)) = (a.shape(), out.shape());
        if rows == 0 || n == 0 {
            return;
        }
        let (tall, deep, wide) = (rows.div_ceil(SIDE), k.div_ceil(SIDE), n.div_ceil(SIDE));
        let pass = deep.div_ceil(deep.div_ceil(PASS).max(1));
        let mut start = 0;
        while start < deep {
            let depth = pass.min(deep - start);
            let many = ROWS.min(tall);
            // If both factors must be split, the smaller one stays in the cache.
            let strip = match b {
                Factor::Terms(_) => wide,
                Factor::Mat(_) if many == tall => (PASSING / depth).clamp(1, wide),
                Factor::Mat(_) => (STAY / depth).clamp(1, wide),
            };
            left.reserve(many * depth * BLOCK);
            sums.reserve(many * SIDE * SIDE);
            let sums = sums.as_chunks_mut::<{ SIDE * SIDE }>().0;
            let mut ready = false;
            for col in (0..wide).step_by(strip) {
                let cols = strip.min(wide - col);
                if let Factor::Mat(b) = b {
                    right.reserve(cols * depth * BLOCK);
                    let to = &mut right[..cols * depth * BLOCK];
                    split_right(v4, b, col, [start, depth], to);
                }
                for row in (0..tall).step_by(many) {
                    let here = many.min(tall - row);
                    let left = &mut left[..here * depth * BLOCK];
                    if !ready {
                        split_left(v4, a, row, [start, depth], left);
                        ready = many == tall;
                    }
                    for (i, col) in (col..col + cols).enumerate() {
                        let right = match b {
                            Factor::Terms(b) => &b.data[(col * deep + start) * BLOCK..],
                            Factor::Mat(_) => &right[i * depth * BLOCK..],
                        };
                        let right = &right[..depth * BLOCK];
                        for (c, right) in right.chunks(CHUNK * BLOCK).enumerate() {
                            for (left, sums) in left.chunks(depth * BLOCK).zip(sums.iter_mut()) {
                                let left = &left[c * CHUNK * BLOCK..][..right.len()];
                                tiles.multiply(left, right, sums, c > 0);
                            }
                        }
                        let place = Place {
                            row: row * SIDE,
                            col: col * SIDE,
                            cols: SIDE.min(n - col * SIDE),
                            first: start == 0,
                            last: start + depth == deep,
                        };
                        for (i, sums) in sums.iter().enumerate().take(here) {
                            let place = Place { row: place.row + i * SIDE, ..place };
                            store(v4, out, init, sums, place);
                        }
                    }
                }
            }
            start += depth;
        }
    }
}

/// Adds the initial values and writes a block of sums to its place in the result.
#[inline(always)]
fn store(
    v4: V4,
    out: &mut MatMut<'_, f32>,
    init: Init<'_, f32>,
    sums: &[f32; SIDE * SIDE],
    place: Place,
) {
    let rows = out.shape().0.min(place.row + SIDE);
    for (row, line) in (place.row..rows).zip(sums.as_chunks::<SIDE>().0) {
        let place = Place { row, ..place };
        let (low, high) = (whole(line), whole(&line[16..]));
        if place.cols > 16 {
            finish::<f32, V4, 2>(v4, out, init, [low, high], &place);
        } else {
            finish::<f32, V4, 1>(v4, out, init, [low], &place);
        }
    }
}

/// Blocks of rows; blocks of the same 32 rows are contiguous; `[first inner block, how many]`.
#[inline(always)]
fn split_left(v4: V4, a: Mat<'_, f32>, row: usize, [start, depth]: [usize; 2], to: &mut [f32]) {
    let (rows, k) = a.shape();
    let (data, stride, transposed) = a.lines();
    for (at, block) in to.as_chunks_mut::<BLOCK>().0.iter_mut().enumerate() {
        let (row, step) = ((row + at / depth) * SIDE, (start + at % depth) * SIDE);
        let inside = !transposed && row + SIDE <= rows && step + SIDE <= k;
        for tile in 0..2 {
            // Rows of a tile are rows of the factor; steps step + j and step + 16 + j pair.
            let row = row + tile * 16;
            if inside {
                let from = &data[row * stride + step..];
                emit(v4, block, tile, |i| {
                    let line = &from[i * stride..][..SIDE];
                    (whole(line), whole(&line[16..]))
                });
            } else {
                let (low, high) = (a.square(v4, row, step), a.square(v4, row, step + 16));
                emit(v4, block, tile, |i| (low[i], high[i]));
            }
        }
    }
}

/// Blocks of columns; blocks of the same 32 columns are contiguous. Rows are read over the whole
/// strip, because sequential reads are faster.
#[inline(always)]
fn split_right(v4: V4, b: Mat<'_, f32>, col: usize, [start, depth]: [usize; 2], to: &mut [f32]) {
    let (k, n) = b.shape();
    let (data, stride, transposed) = b.lines();
    let blocks = to.as_chunks_mut::<BLOCK>().0;
    let cols = blocks.len() / depth.max(1);
    for step in 0..depth {
        for i in 0..cols {
            let block = &mut blocks[i * depth + step];
            let (col, step) = ((col + i) * SIDE, (start + step) * SIDE);
            let inside = !transposed && col + SIDE <= n && step + SIDE <= k;
            for tile in 0..2 {
                // Rows of a tile are inner steps, step + j and step + 16 + j in a pair.
                let col = col + tile * 16;
                if inside {
                    let from = &data[step * stride + col..];
                    emit(v4, block, tile, |j| {
                        (whole(&from[j * stride..]), whole(&from[(j + 16) * stride..]))
                    });
                } else {
                    let (low, high) = (b.square(v4, step, col), b.square(v4, step + 16, col));
                    emit(v4, block, tile, |i| (low[i], high[i]));
                }
            }
        }
    }
}

impl Mat<'_, f32> {
    /// Sixteen rows and columns from (row, col), zeros where the matrix ends.
    #[inline(always)]
    fn square(&self, v4: V4, row: usize, col: usize) -> [f32x16; 16] {
        let (data, stride, transposed) = self.lines();
        let (rows, cols) = self.shape();
        if transposed {
            transpose(v4, &lines(v4, data, stride, [col, cols], [row, rows]))
        } else {
            lines(v4, data, stride, [row, rows], [col, cols])
        }
    }
}

/// Sixteen lines of sixteen numbers; `[from, end]` of both.
#[inline(always)]
fn lines(
    v4: V4,
    data: &[f32],
    stride: usize,
    [row, rows]: [usize; 2],
    [col, cols]: [usize; 2],
) -> [f32x16; 16] {
    let mut to = [v4.splat_f32s(0.0); 16];
    if row + 16 <= rows && col + 16 <= cols {
        let from = &data[row * stride + col..];
        for (i, to) in to.iter_mut().enumerate() {
            *to = whole(&from[i * stride..]);
        }
    } else if col < cols {
        let wide = (cols - col).min(16);
        for (i, to) in to.iter_mut().enumerate().take(rows.saturating_sub(row)) {
            *to = v4.partial_load_f32s(&data[(row + i) * stride + col..][..wide]);
        }
    }
    to
}

/// The next sixteen numbers.
#[inline(always)]
fn whole(x: &[f32]) -> f32x16 {
    V4::as_simd_f32s(&x[..16]).0[0]
}

/// Splits pairs of numbers and writes them as rows of the tiles of a block.
#[inline(always)]
fn emit(v4: V4, block: &mut [f32; BLOCK], tile: usize, at: impl Fn(usize) -> (f32x16, f32x16)) {
    let block = V4::as_mut_simd_f32s(block).0;
    let tile = &mut block[tile * TILE / 16..];
    for i in 0..16 {
        let (low, high) = at(i);
        let (low, high) = (terms(v4, low), terms(v4, high));
        for t in 0..TERMS {
            tile[t * 2 * TILE / 16 + i] = pair(v4, low[t], high[t]);
        }
    }
}

/// The three terms of each number, in the upper halves of the words.
///
/// The first two are rounded by adding half of what is cut off. What is left then has no more
/// than seven bits, so that the last one is exact; it is cut so that NaN stays NaN.
#[inline(always)]
fn terms(v4: V4, x: f32x16) -> [u32x16; TERMS] {
    let (half, upper) = (v4.splat_u32s(0x8000), v4.splat_u32s(0xffff_0000));
    let nearest = |x: f32x16| v4.and_u32s(v4.add_u32s(v4.transmute_u32s_f32s(x), half), upper);
    let first = nearest(x);
    let rest = v4.sub_f32s(x, v4.transmute_f32s_u32s(first));
    let second = nearest(rest);
    let rest = v4.sub_f32s(rest, v4.transmute_f32s_u32s(second));
    [first, second, v4.and_u32s(v4.transmute_u32s_f32s(rest), upper)]
}

/// Upper halves of two words in one, that of `low` below.
#[inline(always)]
fn pair(v4: V4, low: u32x16, high: u32x16) -> f32x16 {
    let low = v4.avx512f._mm512_srli_epi32::<16>(pulp::cast(low));
    v4.transmute_f32s_u32s(v4.or_u32s(pulp::cast(low), high))
}

/// Rows become columns.
#[inline(always)]
fn transpose(v4: V4, x: &[f32x16; 16]) -> [f32x16; 16] {
    let f = v4.avx512f;
    let x: [__m512; 16] = pulp::cast(*x);
    let mut y = x;
    for i in (0..16).step_by(2) {
        y[i] = f._mm512_unpacklo_ps(x[i], x[i + 1]);
        y[i + 1] = f._mm512_unpackhi_ps(x[i], x[i + 1]);
    }
    let y: [__m512d; 16] = pulp::cast(y);
    let mut z = y;
    for i in (0..16).step_by(4) {
        z[i] = f._mm512_unpacklo_pd(y[i], y[i + 2]);
        z[i + 1] = f._mm512_unpackhi_pd(y[i], y[i + 2]);
        z[i + 2] = f._mm512_unpacklo_pd(y[i + 1], y[i + 3]);
        z[i + 3] = f._mm512_unpackhi_pd(y[i + 1], y[i + 3]);
    }
    // Now z[4 g + c] holds column 4 l + c of rows 4 g .. 4 g + 4 in its quarter l.
    let z: [__m512; 16] = pulp::cast(z);
    let (mut u, mut v) = (z, z);
    for c in 0..4 {
        u[c] = f._mm512_shuffle_f32x4::<0x88>(z[c], z[4 + c]);
        u[4 + c] = f._mm512_shuffle_f32x4::<0xdd>(z[c], z[4 + c]);
        u[8 + c] = f._mm512_shuffle_f32x4::<0x88>(z[8 + c], z[12 + c]);
        u[12 + c] = f._mm512_shuffle_f32x4::<0xdd>(z[8 + c], z[12 + c]);
    }
    for c in 0..4 {
        v[c] = f._mm512_shuffle_f32x4::<0x88>(u[c], u[8 + c]);
        v[8 + c] = f._mm512_shuffle_f32x4::<0xdd>(u[c], u[8 + c]);
        v[4 + c] = f._mm512_shuffle_f32x4::<0x88>(u[4 + c], u[12 + c]);
        v[12 + c] = f._mm512_shuffle_f32x4::<0xdd>(u[4 + c], u[12 + c]);
    }
    pulp::cast(v)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Packed, gemm, gemm_packed, gemm_tiled};
    use robert_base::rng::{Rng, Stream};

    fn random(n: usize, index: u64) -> Vec<f32> {
        let mut rng = Rng::new(1, Stream::Test, index);
        (0..n).map(|_| (rng.normal() * (3.0 * rng.normal()).exp()) as f32).collect()
    }

    #[test]
    fn squares_turn() {
        let Some(v4) = V4::try_new() else { return };
        let x: Vec<f32> = (0..256).map(|i| i as f32).collect();
        let a = Mat::new(&x, 16, 16);
        let (y, t): ([[f32; 16]; 16], [[f32; 16]; 16]) =
            (pulp::cast(a.square(v4, 0, 0)), pulp::cast(a.t().square(v4, 0, 0)));
        for i in 0..16 {
            for j in 0..16 {
                assert_eq!((y[i][j], t[i][j]), (x[i * 16 + j], x[j * 16 + i]));
            }
        }
    }

    #[test]
    fn three_terms_are_the_number() {
        let Some(v4) = V4::try_new() else { return };
        let mut x = random(4096, 9);
        x.extend([0.0, -0.0, 1.0, 1.0 - f32::EPSILON / 2.0, -3.999_999_8, 1e30, f32::MAX / 2.0]);
        x.extend([0x7fff_ffff, 0xffff_8000, 0x7f80_0001].map(f32::from_bits));
        x.extend([f32::NAN, f32::INFINITY, -f32::INFINITY, f32::MAX, 7e-30, 1.0]);
        for x in x.as_chunks::<16>().0 {
            let y: [[f32; 16]; 3] = terms(v4, pulp::cast(*x)).map(pulp::cast);
            for (i, &x) in x.iter().enumerate() {
                let sum = y[0][i] + (y[1][i] + y[2][i]);
                let edge = !x.is_finite() || x == f32::MAX;
                assert!(sum == x || edge && !sum.is_finite(), "{x}: {sum}");
                for t in &y {
                    assert_eq!(t[i].to_bits() & 0xffff, 0);
                }
            }
        }
    }

    /// A matrix with known values, stored by rows or by columns.
    fn stored(x: &[f32], rows: usize, cols: usize, turned: bool) -> Vec<f32> {
        let at = |i: usize| if turned { (i % rows) * cols + i / rows } else { i };
        (0..rows * cols).map(|i| x[at(i)]).collect()
    }

    fn mat(x: &[f32], rows: usize, cols: usize, turned: bool) -> Mat<'_, f32> {
        if turned { Mat::new(x, cols, rows).t() } else { Mat::new(x, rows, cols) }
    }

    /// The product is as close to double precision as that of the vector units, for every kind of
    /// product and for shapes of several passes, groups and strips.
    #[test]
    fn products_are_of_single_precision() {
        if !usable() {
            return;
        }
        let shapes = [
            (32, 32, 32),
            (51, 37, 45),
            (33, 32, 48),
            (64, 512, 200),
            (300, 1024, 300),
            (17, 1100, 65),
        ];
        for (m, k, n) in shapes {
            let (a, b, c) = (random(m * k, 0), random(k * n, 1), random(m * n, 2));
            let bias = random(n, 3);
            let (mut dot, mut scale) = (vec![0.0_f64; m * n], vec![0.0_f64; m * n]);
            for i in 0..m {
                for p in 0..k {
                    let x = f64::from(a[i * k + p]);
                    let line = dot[i * n..][..n].iter_mut().zip(&mut scale[i * n..][..n]);
                    for ((dot, scale), &y) in line.zip(&b[p * n..][..n]) {
                        *dot += x * f64::from(y);
                        *scale += (x * f64::from(y)).powi(2);
                    }
                }
            }
            for way in 0..6 {
                let (ta, tb) = (way % 2 == 1, way / 2 % 2 == 1);
                let (a, b) = (stored(&a, m, k, ta), stored(&b, k, n, tb));
                let (ma, mb) = (mat(&a, m, k, ta), mat(&b, k, n, tb));
                let init = match way {
                    0 => Init::Zero,
                    1 => Init::Add,
                    2 => Init::Bias(&bias),
                    3 => Init::AddBias(&bias),
                    4 => Init::Times(&c),
                    _ => Init::Residual(&bias, &c),
                };
                let (mut tiled, mut plain) = (c.clone(), c.clone());
                gemm_tiled(MatMut::new(&mut tiled, m, n), init, ma, mb);
                gemm(MatMut::new(&mut plain, m, n), init, ma, mb);
                assert!(tiled != plain, "the tiles were not asked");
                let mut packed = Packed::default();
                packed.pack_tiled(mb);
                let mut split = c.clone();
                gemm_packed(MatMut::new(&mut split, m, n), init, ma, &packed);
                assert!(split == tiled, "{m}x{k}x{n} {way}: split before, other bits");
                let (mut worst, mut error, mut peer) = (0.0_f64, 0.0, 0.0);
                for at in 0..m * n {
                    let (x, y) = (f64::from(c[at]), f64::from(bias[at % n]));
                    let want = match way {
                        0 => dot[at],
                        1 => dot[at] + x,
                        2 => dot[at] + y,
                        4 => dot[at] * x,
                        _ => dot[at] + x + y,
                    };
                    let size = scale[at].sqrt() * if way == 4 { x.abs() } else { 1.0 };
                    let size = size.max(x.abs().max(y.abs()) * f64::from(u8::from(way != 4)));
                    let off = |x: f32| (f64::from(x) - want) / size.max(1e-30);
                    error += off(tiled[at]).powi(2);
                    peer += off(plain[at]).powi(2);
                    worst = worst.max(off(tiled[at]).abs());
                }
                let what = format!("{m}x{k}x{n} {way}: {error:e} {peer:e} {worst:e}");
                assert!(error < 1.5 * peer && worst < 1e-5, "{what}");
            }
        }
    }

    #[test]
    fn what_is_not_finite_stays_in_its_row_and_column() {
        if !usable() {
            return;
        }
        let (m, k, n) = (40, 70, 50);
        let (a, b) = (random(m * k, 0), random(k * n, 1));
        let product = |a: &[f32], b: &[f32]| {
            let mut c = vec![0.0; m * n];
            gemm_tiled(MatMut::new(&mut c, m, n), Init::Zero, Mat::new(a, m, k), Mat::new(b, k, n));
            c
        };
        let clean = product(&a, &b);
        let bad =
            [0x7fff_ffff, 0xffff_8000, 0x7f80_0001, 0x7f80_0000, 0xff80_0000].map(f32::from_bits);
        for bad in bad {
            let (mut row, mut col) = (a.clone(), b.clone());
            row[33 * k + 65] = bad;
            col[65 * n + 47] = bad;
            for (at, (x, y)) in product(&row, &b).into_iter().zip(product(&a, &col)).enumerate() {
                assert!(if at / n == 33 { !x.is_finite() } else { x == clean[at] }, "{bad} {at}");
                assert!(if at % n == 47 { !y.is_finite() } else { y == clean[at] }, "{bad} {at}");
            }
        }
    }

    #[test]
    fn one_room_packs_either_way_again_and_again() {
        let mut room = Packed::default();
        for (k, n, tiled) in [
            (96, 64, true),
            (5, 7, false),
            (40, 33, true),
            (32, 16, true),
            (600, 70, true),
            (96, 64, true),
        ] {
            let b = random(k * n, 4);
            let pack = |to: &mut Packed<f32>| {
                let b = Mat::new(&b, k, n);
                if tiled { to.pack_tiled(b) } else { to.pack(b) }
            };
            let mut fresh = Packed::default();
            pack(&mut fresh);
            pack(&mut room);
            for m in [0, 1, 33] {
                let a = random(m * k, 5);
                let product = |by: &Packed<f32>| {
                    let mut c = vec![0.0; m * n];
                    gemm_packed(MatMut::new(&mut c, m, n), Init::Zero, Mat::new(&a, m, k), by);
                    c
                };
                assert_eq!(product(&room), product(&fresh), "{m}x{k}x{n}");
            }
        }
    }
}
