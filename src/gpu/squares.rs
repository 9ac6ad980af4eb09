//! The norm of the gradient.

use super::device::{Device, Span};
use super::kernel::{Kernel, Step, line};
use super::product::words;

/// Sums of squares over pieces; the processor adds the pieces in double precision.
#[derive(Debug)]
pub(crate) struct Squares {
    kernel: Kernel,
}

/// Numbers of a piece.
pub(crate) const PIECE: usize = 4096;

impl Squares {
    pub(crate) fn new(gpu: &Device) -> Self {
        Squares { kernel: Kernel::new(gpu, "squares", include_str!("squares.wgsl"), &[]) }
    }

    /// Sums of the pieces of x (len), from place `first` of `out` on.
    pub(crate) fn step(
        &self,
        gpu: &Device,
        len: usize,
        x: &Span,
        out: &Span,
        first: usize,
    ) -> Step {
        let grid = line(len.div_ceil(PIECE));
        self.kernel.step(gpu, &words([len / 4, first]), &[x, out], grid)
    }
}
