//! AdamW with clipping, and the running average of the weights.

use super::device::{Device, Span};
use super::kernel::{Kernel, Step, line};
use robert_net::AdamConfig;

/// The update.
#[derive(Debug)]
pub(crate) struct Adam {
    kernel: Kernel,
}

/// The values that change from step to step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Update {
    pub(crate) adam: AdamConfig,
    pub(crate) lr: f64,
    /// Norm of the gradient.
    pub(crate) norm: f64,
    /// The factor of the gradient in the buffer.
    pub(crate) scale: f32,
    /// Steps applied, with this one.
    pub(crate) count: u64,
    /// Share of the new weights in the average.
    pub(crate) share: f32,
}

/// The buffers of a part of the weights; the last is not used without an average.
#[derive(Clone, Copy, Debug)]
pub(crate) struct State<'a> {
    pub(crate) decays: &'a Span,
    pub(crate) grads: &'a Span,
    pub(crate) weights: &'a Span,
    pub(crate) first: &'a Span,
    pub(crate) second: &'a Span,
    pub(crate) average: &'a Span,
}

impl Adam {
    pub(crate) fn new(gpu: &Device, averages: bool) -> Self {
        let averages = f64::from(u8::from(averages));
        let source = include_str!("adam.wgsl");
        Adam { kernel: Kernel::new(gpu, "adam", source, &[("AVERAGES", averages)]) }
    }

    /// The update of `len` weights; `params` holds what [`Update::words`] says.
    pub(crate) fn step(
        &self,
        gpu: &Device,
        len: usize,
        params: &wgpu::Buffer,
        on: State<'_>,
    ) -> Step {
        let State { decays, grads, weights, first, second, average } = on;
        let on = [decays, grads, weights, first, second, average];
        self.kernel.step_with(gpu, params, &on, line((len / 4).div_ceil(256)))
    }
}

impl Update {
    /// Parameters for `len` weights, as the kernel reads them.
    pub(crate) fn words(&self, len: usize) -> [u32; 12] {
        let Update { adam, lr, norm, scale, count, share } = *self;
        let clip = if norm > adam.clip { adam.clip / (norm + 1e-6) } else { 1.0 };
        let count = i32::try_from(count).unwrap_or(i32::MAX);
        let bits = |x: f64| (x as f32).to_bits();
        [
            bits(clip / f64::from(scale)),
            bits(adam.beta1),
            bits(1.0 - adam.beta1),
            bits(adam.beta2),
            bits(1.0 - adam.beta2),
            bits(lr / (1.0 - adam.beta1.powi(count))),
            bits(1.0 / (1.0 - adam.beta2.powi(count)).sqrt()),
            bits(adam.eps),
            bits(1.0 - lr * adam.weight_decay),
            share.to_bits(),
            (len / 4) as u32,
            0,
        ]
    }
}
