//! Borrowed matrices, the values that a product is added to, and how its sums are written.

// Vector code must be inlined into the function that pulp compiles for the processor found.
#![allow(clippy::inline_always)]

use pulp::Simd;

use super::real::Real;

/// Repeats a block with a constant index.
macro_rules! unrolled {
    ($n:ident, [$($i:literal)*], |$v:ident| $body:block) => {
        $(if $i < $n {
            const $v: usize = $i;
            $body
        })*
    };
}

pub(super) use unrolled;

/// A borrowed matrix: row-major with a stride, or the transpose of one.
#[derive(Clone, Copy, Debug)]
pub struct Mat<'a, T> {
    pub(super) data: &'a [T],
    pub(super) rows: usize,
    pub(super) cols: usize,
    pub(super) stride: usize,
    pub(super) transposed: bool,
}

impl<'a, T: Real> Mat<'a, T> {
    /// Dense row-major (rows, cols).
    ///
    /// # Panics
    /// When `data` is too short.
    pub fn new(data: &'a [T], rows: usize, cols: usize) -> Self {
        Self::strided(data, rows, cols, cols)
    }

    /// Row-major, row i starting at `i * stride`.
    ///
    /// # Panics
    /// When `data` is too short.
    pub fn strided(data: &'a [T], rows: usize, cols: usize, stride: usize) -> Self {
        assert!(fits(data.len(), rows, cols, stride), "matrix {rows}x{cols} does not fit");
        Mat { data, rows, cols, stride, transposed: false }
    }

    #[cfg(target_arch = "x86_64")]
    /// (rows, columns).
    pub(super) fn shape(&self) -> (usize, usize) {
        (self.rows, self.cols)
    }

    #[cfg(target_arch = "x86_64")]
    /// The layout: data, stride, and whether it is column-major.
    pub(super) fn lines(&self) -> (&'a [T], usize, bool) {
        (self.data, self.stride, self.transposed)
    }

    /// The same matrix, if it is in single precision.
    #[cfg(target_arch = "x86_64")]
    pub(super) fn single(self) -> Option<Mat<'a, f32>> {
        let Mat { data, rows, cols, stride, transposed } = self;
        Some(Mat { data: T::singles(data)?, rows, cols, stride, transposed })
    }

    /// The transpose, without moving anything.
    #[must_use]
    pub fn t(self) -> Self {
        Mat { rows: self.cols, cols: self.rows, transposed: !self.transposed, ..self }
    }
}

/// A row-major matrix to write.
#[derive(Debug)]
pub struct MatMut<'a, T> {
    pub(super) data: &'a mut [T],
    pub(super) rows: usize,
    pub(super) cols: usize,
    pub(super) stride: usize,
}

impl<'a, T: Real> MatMut<'a, T> {
    /// Dense row-major (rows, cols).
    ///
    /// # Panics
    /// When `data` is too short.
    pub fn new(data: &'a mut [T], rows: usize, cols: usize) -> Self {
        Self::strided(data, rows, cols, cols)
    }

    /// Row-major, row i starting at `i * stride`.
    ///
    /// # Panics
    /// When `data` is too short.
    pub fn strided(data: &'a mut [T], rows: usize, cols: usize, stride: usize) -> Self {
        assert!(fits(data.len(), rows, cols, stride), "matrix {rows}x{cols} does not fit");
        MatMut { data, rows, cols, stride }
    }

    /// The same matrix, if it is in single precision.
    #[cfg(target_arch = "x86_64")]
    pub(super) fn single(self) -> Option<MatMut<'a, f32>> {
        let MatMut { data, rows, cols, stride } = self;
        Some(MatMut { data: T::singles_mut(data)?, rows, cols, stride })
    }

    #[cfg(target_arch = "x86_64")]
    /// (rows, columns).
    pub(super) fn shape(&self) -> (usize, usize) {
        (self.rows, self.cols)
    }
}

fn fits(len: usize, rows: usize, cols: usize, stride: usize) -> bool {
    rows == 0 || cols == 0 || (cols <= stride && (rows - 1) * stride + cols <= len)
}

/// The values that a product is added to.
#[derive(Clone, Copy, Debug)]
pub enum Init<'a, T> {
    /// out = a b.
    Zero,
    /// out += a b.
    Add,
    /// out = a b + bias, one number per column.
    Bias(&'a [T]),
    /// out += a b + bias.
    AddBias(&'a [T]),
    /// out = a b + bias + residual; the residual is laid out as `out`.
    Residual(&'a [T], &'a [T]),
    /// out = (a b) ∘ factor, element by element; the factor is laid out as `out`.
    Times(&'a [T]),
}

#[cfg(target_arch = "x86_64")]
impl<'a, T: Real> Init<'a, T> {
    /// The same values, if they are in single precision.
    pub(super) fn single(self) -> Option<Init<'a, f32>> {
        Some(match self {
            Init::Zero => Init::Zero,
            Init::Add => Init::Add,
            Init::Bias(bias) => Init::Bias(T::singles(bias)?),
            Init::AddBias(bias) => Init::AddBias(T::singles(bias)?),
            Init::Residual(bias, rest) => Init::Residual(T::singles(bias)?, T::singles(rest)?),
            Init::Times(factor) => Init::Times(T::singles(factor)?),
        })
    }
}

/// Some columns of a row, and the pass over the inner dimension that computed their sums.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    /// Row of the result.
    pub(super) row: usize,
    /// First column.
    pub(super) col: usize,
    /// Columns.
    pub(super) cols: usize,
    /// Whether this is the first pass.
    pub(super) first: bool,
    /// Whether this is the last pass.
    pub(super) last: bool,
}

/// Writes N registers of sums, plus the values that they are added to.
#[inline(always)]
pub(super) fn finish<T: Real, S: Simd, const N: usize>(
    s: S,
    out: &mut MatMut<'_, T>,
    init: Init<'_, T>,
    acc: [T::V<S>; N],
    place: &Place,
) {
    let Place { row, col, cols, first, last } = *place;
    // A later pass adds to the earlier ones; a factor is applied to the complete sum.
    let init = match init {
        Init::Times(_) if first && !last => Init::Zero,
        Init::Times(factor) if last => Init::Times(factor),
        init if first => init,
        _ => Init::Add,
    };
    let at = row * out.stride + col;
    let out = &mut out.data[at..][..cols];
    let sum = match init {
        Init::Zero => acc,
        Init::Add => plus::<T, S, N>(s, acc, out),
        Init::Bias(bias) => plus::<T, S, N>(s, acc, &bias[col..][..cols]),
        Init::AddBias(bias) => {
            let sum = plus::<T, S, N>(s, acc, &bias[col..][..cols]);
            plus::<T, S, N>(s, sum, out)
        }
        Init::Times(factor) => {
            let sum = if first { acc } else { plus::<T, S, N>(s, acc, out) };
            zipped::<T, S, N>(
                s,
                sum,
                &factor[at..][..cols],
                #[inline(always)]
                |a, b| T::vmul(s, a, b),
            )
        }
        Init::Residual(bias, residual) => {
            let sum = plus::<T, S, N>(s, acc, &bias[col..][..cols]);
            plus::<T, S, N>(s, sum, &residual[at..][..cols])
        }
    };
    put::<T, S, N>(s, out, sum);
}

/// acc + x; `x` may be shorter than the N registers.
#[inline(always)]
fn plus<T: Real, S: Simd, const N: usize>(s: S, acc: [T::V<S>; N], x: &[T]) -> [T::V<S>; N] {
    zipped::<T, S, N>(
        s,
        acc,
        x,
        #[inline(always)]
        |a, b| T::vadd(s, a, b),
    )
}

/// f(acc, x), register by register; `x` may be shorter than the N registers.
#[inline(always)]
fn zipped<T: Real, S: Simd, const N: usize>(
    s: S,
    acc: [T::V<S>; N],
    x: &[T],
    f: impl Fn(T::V<S>, T::V<S>) -> T::V<S>,
) -> [T::V<S>; N] {
    let mut acc = acc;
    let (whole, rest) = T::vectors::<S>(x);
    unrolled!(N, [0 1 2], |J| {
        let x = if J < whole.len() { whole[J] } else { T::load(s, rest) };
        acc[J] = f(acc[J], x);
    });
    acc
}

#[inline(always)]
fn put<T: Real, S: Simd, const N: usize>(s: S, out: &mut [T], sum: [T::V<S>; N]) {
    let (whole, rest) = T::vectors_mut::<S>(out);
    unrolled!(N, [0 1 2], |J| {
        if J < whole.len() {
            whole[J] = sum[J];
        } else {
            T::store(s, rest, sum[J]);
        }
    });
}
