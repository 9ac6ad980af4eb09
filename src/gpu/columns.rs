//! Column sums: the gradients of biases, norms, positions and the mask vector.

use super::device::{Device, Span};
use super::kernel::{Kernel, Step};
use super::product::{Product, SLICES, words};

/// Column sums of three kinds.
#[derive(Debug)]
pub(crate) struct Columns {
    plain: Kernel,
    /// As `plain`, of factors of products.
    factors: Kernel,
    norm: Kernel,
    masked: Kernel,
    nothing: [Span; 3],
}

/// Rows of a slice, at least.
const SLICE: usize = 128;

/// The kernel for sums of 32-bit numbers and of factors.
pub(crate) const SOURCES: [fn() -> String; 2] = [|| source("vec4<f32>"), || source("$H4$")];

fn source(number: &str) -> String {
    include_str!("columns.wgsl").replace("$X$", number)
}

impl Columns {
    pub(crate) fn new(gpu: &Device) -> Self {
        let [wide, factors] = SOURCES.map(|source| source());
        let kernel = |source, mode| Kernel::new(gpu, "columns", source, &[("MODE", mode)]);
        Columns {
            plain: kernel(&wide, 0.0),
            factors: kernel(&factors, 0.0),
            norm: kernel(&factors, 1.0),
            masked: kernel(&wide, 2.0),
            nothing: [gpu.buffer(16), gpu.buffer(16), gpu.buffer(16)],
        }
    }

    /// Numbers that the slices of such a sum take.
    pub(crate) fn parts(rows: usize, width: usize) -> usize {
        2 * split(rows).1 * width
    }

    /// to += the sum of the rows of x (rows, width).
    pub(crate) fn plain(
        &self,
        gpu: &Device,
        product: &Product,
        shape: [usize; 2],
        x: &Span,
        parts: &Span,
        to: &Span,
    ) -> [Step; 2] {
        self.sum(&self.plain, gpu, product, shape, [x, &self.nothing[2], parts, to])
    }

    /// As [`Columns::plain`], for factors of products.
    pub(crate) fn factors(
        &self,
        gpu: &Device,
        product: &Product,
        shape: [usize; 2],
        x: &Span,
        parts: &Span,
        to: &Span,
    ) -> [Step; 2] {
        self.sum(&self.factors, gpu, product, shape, [x, &self.nothing[2], parts, to])
    }

    /// to += the sum of the rows of masked tokens.
    pub(crate) fn masked(
        &self,
        gpu: &Device,
        product: &Product,
        shape: [usize; 2],
        [x, info]: [&Span; 2],
        parts: &Span,
        to: &Span,
    ) -> [Step; 2] {
        self.sum(&self.masked, gpu, product, shape, [x, info, parts, to])
    }

    fn sum(
        &self,
        kernel: &Kernel,
        gpu: &Device,
        product: &Product,
        shape: [usize; 2],
        [x, info, parts, to]: [&Span; 4],
    ) -> [Step; 2] {
        let [normed, stats, _] = &self.nothing;
        let (step, slices) = one(kernel, gpu, shape, [x, normed, stats, info, parts]);
        [step, product.fold(gpu, shape[1] / 4, slices, parts, to)]
    }

    /// Gradients of a norm's weight and bias, added to both. dy are factors of products.
    pub(crate) fn norm(
        &self,
        gpu: &Device,
        product: &Product,
        shape: [usize; 2],
        [dy, x, stats]: [&Span; 3],
        parts: &Span,
        [gamma, beta]: [&Span; 2],
    ) -> [Step; 3] {
        let (step, slices) = one(&self.norm, gpu, shape, [dy, x, stats, &self.nothing[2], parts]);
        // The sums for the bias stand behind those for the weight; a width is a multiple of 16, and
        // slices are counted so that the second half begins where a binding may.
        let half = (4 * slices * shape[1]) as u64;
        let n = shape[1] / 4;
        [
            step,
            product.fold(gpu, n, slices, &parts.part(0, half), gamma),
            product.fold(gpu, n, slices, &parts.part(half, half), beta),
        ]
    }
}

fn one(kernel: &Kernel, gpu: &Device, [rows, width]: [usize; 2], on: [&Span; 5]) -> (Step, usize) {
    let (slice, slices) = split(rows);
    let params = words([rows, width / 4, slice, slices]);
    let grid = [width.div_ceil(64) as u32, slices as u32, 1];
    (kernel.step(gpu, &params, &on, grid), slices)
}

/// Rows of a slice, and slices: a multiple of four, so that 16 columns of them fill 256 bytes.
fn split(rows: usize) -> (usize, usize) {
    let slice = rows.div_ceil(SLICES).max(SLICE);
    (slice, rows.div_ceil(slice).next_multiple_of(4))
}
