//! Mask vector and positions.

use super::device::{Device, Span};
use super::kernel::{Kernel, Step, line};
use super::product::words;

/// Adds the mask vector and the positions to embedded tokens. In the backward pass the gradients of
/// replaced tokens are set to zero.
#[derive(Debug)]
pub(crate) struct Place {
    forward: Kernel,
    back: Kernel,
    nothing: [Span; 2],
}

impl Place {
    pub(crate) fn new(gpu: &Device) -> Self {
        let kernel =
            |back| Kernel::new(gpu, "place", include_str!("place.wgsl"), &[("BACK", back)]);
        Place { forward: kernel(0.0), back: kernel(1.0), nothing: [gpu.buffer(16), gpu.buffer(16)] }
    }

    /// x (rows, width) of embedded tokens, in place.
    pub(crate) fn forward(
        &self,
        gpu: &Device,
        [rows, width]: [usize; 2],
        replaces: bool,
        [mask, position, info]: [&Span; 3],
        x: &Span,
    ) -> Step {
        let quads = rows * width / 4;
        let params = words([quads, width / 4, usize::from(replaces)]);
        self.forward.step(gpu, &params, &[mask, position, info, x], line(quads.div_ceil(256)))
    }

    /// The rows of masked tokens become 0.
    pub(crate) fn back(
        &self,
        gpu: &Device,
        [rows, width]: [usize; 2],
        info: &Span,
        x: &Span,
    ) -> Step {
        let quads = rows * width / 4;
        let [mask, position] = &self.nothing;
        let params = words([quads, width / 4, 1]);
        self.back.step(gpu, &params, &[mask, position, info, x], line(quads.div_ceil(256)))
    }
}
