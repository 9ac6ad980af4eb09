//! Factors of products from numbers of 32 bits.

use super::device::{Device, Span};
use super::kernel::{Kernel, Step, Tape, line};
use super::product::words;

/// Rounds to 16 bits where products take such factors.
#[derive(Debug)]
pub(crate) struct Round {
    kernel: Option<Kernel>,
}

impl Round {
    pub(crate) fn new(gpu: &Device) -> Self {
        let kernel = || Kernel::new(gpu, "round", include_str!("round.wgsl"), &[]);
        Round { kernel: gpu.units().map(|_| kernel()) }
    }

    /// The first `n` numbers of x as factors; x itself where products take it as it is.
    pub(crate) fn new_copy(&self, gpu: &Device, n: usize, x: &Span, tape: &mut Tape) -> Span {
        let copy = if self.kernel.is_some() { gpu.factors(n) } else { x.clone() };
        tape.extend(self.copy(gpu, n, x, &copy));
        copy
    }

    /// As [`Round::new_copy`], into a buffer.
    pub(crate) fn copy(&self, gpu: &Device, n: usize, x: &Span, copy: &Span) -> Option<Step> {
        let kernel = self.kernel.as_ref()?;
        let n = n.div_ceil(4);
        Some(kernel.step(gpu, &words([n]), &[x, copy], line(n.div_ceil(256))))
    }
}
