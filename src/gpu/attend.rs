//! Attention over the 51 tokens of a window.

use super::device::{Device, Span};
use super::kernel::{Kernel, Step};
use robert_net::WINDOW;

/// Attention, forward and backward.
#[derive(Debug)]
pub(crate) struct Attend {
    forward: Kernel,
    back: Kernel,
}

const _: () = assert!(WINDOW == 51, "the kernels are written for windows of 51 tokens");

impl Attend {
    pub(crate) fn new(gpu: &Device) -> Self {
        Attend {
            forward: Kernel::new(gpu, "attend", include_str!("attend.wgsl"), &[]),
            back: Kernel::new(gpu, "attend_back", include_str!("attend_back.wgsl"), &[]),
        }
    }

    /// Weights and mixed values of `windows`, from queries, keys and values (rows, 3 width).
    pub(crate) fn forward(
        &self,
        gpu: &Device,
        shape: [usize; 3],
        qkv: &Span,
        probs: &Span,
        mixed: &Span,
    ) -> Step {
        let (params, grid, work) = sizes(shape);
        self.forward.step(gpu, &params, &[qkv, probs, mixed], grid).with_work(4.0 * work)
    }

    /// Gradients of queries, keys and values.
    pub(crate) fn back(
        &self,
        gpu: &Device,
        shape: [usize; 3],
        [qkv, probs, d_mixed]: [&Span; 3],
        d_qkv: &Span,
    ) -> Step {
        let (params, grid, work) = sizes(shape);
        self.back.step(gpu, &params, &[qkv, probs, d_mixed, d_qkv], grid).with_work(8.0 * work)
    }
}

fn sizes([windows, heads, width]: [usize; 3]) -> ([u32; 3], [u32; 3], f64) {
    let size = width / heads;
    let scale = (1.0 / (size as f64).sqrt()) as f32;
    let work = (WINDOW * WINDOW * width * windows) as f64;
    let params = [width as u32, size as u32, scale.to_bits()];
    (params, [heads as u32, windows as u32, 1], work)
}
