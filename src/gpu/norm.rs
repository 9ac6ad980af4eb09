//! Layer norm.

use super::device::{Device, Span};
use super::kernel::{Kernel, Step};
use super::product::words;

/// Layer norm, forward and the gradient of its input.
#[derive(Debug)]
pub(crate) struct Norm {
    forward: Kernel,
    back: Kernel,
}

impl Norm {
    pub(crate) fn new(gpu: &Device) -> Self {
        Norm {
            forward: Kernel::new(gpu, "norm", include_str!("norm.wgsl"), &[]),
            back: Kernel::new(gpu, "norm_back", include_str!("norm_back.wgsl"), &[]),
        }
    }

    /// y, and the statistics of x, which is (rows, width).
    pub(crate) fn forward(
        &self,
        gpu: &Device,
        [rows, width]: [usize; 2],
        x: &Span,
        [gamma, beta]: [&Span; 2],
        y: &Span,
        stats: &Span,
    ) -> Step {
        let grid = [rows.div_ceil(16) as u32, 1, 1];
        self.forward.step(gpu, &words([rows, width / 4]), &[x, gamma, beta, y, stats], grid)
    }

    /// dx of dy; added if `add`.
    pub(crate) fn back(
        &self,
        gpu: &Device,
        [rows, width]: [usize; 2],
        [dy, x, stats, gamma]: [&Span; 4],
        dx: &Span,
        add: bool,
    ) -> Step {
        let grid = [rows.div_ceil(16) as u32, 1, 1];
        let params = words([rows, width / 4, usize::from(add)]);
        self.back.step(gpu, &params, &[dy, x, stats, gamma, dx], grid)
    }
}
