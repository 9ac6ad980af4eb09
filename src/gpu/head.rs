//! The action head's loss.

use super::device::{Device, Span};
use super::kernel::{Kernel, Step};
use robert_net::{NetConfig, SkipKind};

/// Loss and gradient of the head.
#[derive(Debug)]
pub(crate) struct Head {
    kernel: Kernel,
}

/// The inputs of a batch's loss.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wanted<'a> {
    pub(crate) actions: &'a Span,
    pub(crate) linear: &'a Span,
    pub(crate) centres: &'a Span,
    pub(crate) info: &'a Span,
}

impl Head {
    pub(crate) fn new(gpu: &Device) -> Self {
        Head { kernel: Kernel::new(gpu, "head", include_str!("head.wgsl"), &[]) }
    }

    /// `out` (rows, stride) becomes its gradient, times the scale in `params`; `errors` gets two
    /// numbers a row.
    pub(crate) fn loss(
        &self,
        gpu: &Device,
        params: &wgpu::Buffer,
        rows: usize,
        wanted: Wanted<'_>,
        [out, errors]: [&Span; 2],
    ) -> Step {
        let Wanted { actions, linear, centres, info } = wanted;
        let on = [actions, linear, centres, info, out, errors];
        self.kernel.step_with(gpu, params, &on, [rows.div_ceil(64) as u32, 1, 1])
    }

    /// Parameters of the loss, as the kernel reads them; its gradient is multiplied by `scale`.
    pub(crate) fn words(cfg: &NetConfig, [rows, stride]: [usize; 2], scale: f32) -> [u32; 8] {
        [
            rows as u32,
            cfg.actions as u32,
            cfg.bins as u32,
            stride as u32,
            (offset_weight(cfg) as f32).to_bits(),
            u32::from(cfg.skip != SkipKind::Off),
            u32::from(cfg.skip == SkipKind::Gated),
            scale.to_bits(),
        ]
    }
}

/// Factor of the offset loss: without bins it is the whole loss.
pub(crate) fn offset_weight(cfg: &NetConfig) -> f64 {
    if cfg.bins > 1 { cfg.offset_weight } else { 1.0 }
}
