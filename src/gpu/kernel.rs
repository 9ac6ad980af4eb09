//! Pipelines, their dispatches, and a tape of dispatches that is recorded once.

use super::device::{Device, Span};
use super::trusted;

/// A compiled kernel: parameters at binding 0, buffers from binding 1 on.
#[derive(Clone, Debug)]
pub(crate) struct Kernel {
    pipeline: wgpu::ComputePipeline,
}

/// One dispatch.
#[derive(Debug)]
pub(crate) struct Step {
    pipeline: wgpu::ComputePipeline,
    group: wgpu::BindGroup,
    grid: [u32; 3],
    /// Floating-point operations, roughly.
    work: f64,
}

/// A kernel's whole source.
fn text(half: bool, source: &str) -> String {
    let (begin, number, four) = if half {
        ("enable f16;\nenable wgpu_cooperative_matrix;\n", "f16", "vec4<f16>")
    } else {
        ("", "f32", "vec4<f32>")
    };
    let text = format!("{begin}{}\n{source}", include_str!("functions.wgsl"));
    text.replace("$H$", number).replace("$H4$", four)
}

/// The most operations in one submission: drivers reset a card whose submission takes seconds.
const WORK: f64 = 2e11;

/// Dispatches in their order.
#[derive(Debug, Default)]
pub(crate) struct Tape {
    steps: Vec<Step>,
}

impl Kernel {
    /// Compiles `source` after the functions of single numbers. `$H$` stands for the type of a
    /// factor of a product, `$H4$` for four of them.
    pub(crate) fn new(gpu: &Device, label: &str, source: &str, constants: &[(&str, f64)]) -> Self {
        let text = text(gpu.units().is_some(), source);
        let module = trusted::module(&gpu.device, label, &text);
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(label),
            layout: None,
            module: &module,
            entry_point: None,
            compilation_options: wgpu::PipelineCompilationOptions {
                constants,
                // Each kernel writes workgroup memory before it reads it.
                zero_initialize_workgroup_memory: false,
            },
            cache: None,
        });
        Kernel { pipeline }
    }

    /// A dispatch with these parameters and buffers.
    pub(crate) fn step(&self, gpu: &Device, params: &[u32], on: &[&Span], grid: [u32; 3]) -> Step {
        self.step_with(gpu, &gpu.uniform(params), on, grid)
    }

    /// As [`Kernel::step`], with parameters that change.
    pub(crate) fn step_with(
        &self,
        gpu: &Device,
        params: &wgpu::Buffer,
        on: &[&Span],
        grid: [u32; 3],
    ) -> Step {
        let parameters = wgpu::BindGroupEntry { binding: 0, resource: params.as_entire_binding() };
        let spans = on.iter().enumerate().map(|(i, span)| wgpu::BindGroupEntry {
            binding: i as u32 + 1,
            resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                buffer: &span.buffer,
                offset: span.offset,
                size: std::num::NonZero::new(span.bytes),
            }),
        });
        let entries: Vec<_> = std::iter::once(parameters).chain(spans).collect();
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        Step { pipeline: self.pipeline.clone(), group, grid, work: 0.0 }
    }
}

impl Step {
    pub(crate) fn with_work(self, work: f64) -> Self {
        Step { work, ..self }
    }
}

impl Tape {
    pub(crate) fn push(&mut self, step: Step) {
        self.steps.push(step);
    }

    pub(crate) fn extend(&mut self, steps: impl IntoIterator<Item = Step>) {
        self.steps.extend(steps);
    }

    /// Sends the dispatches to the card, in several submissions so that none takes long.
    pub(crate) fn submit(&self, gpu: &Device) {
        let mut rest = &self.steps[..];
        while !rest.is_empty() {
            let mut work = 0.0;
            let fits = |step: &&Step| {
                work += step.work;
                work <= WORK
            };
            let n = rest.iter().take_while(fits).count().max(1);
            let (now, later) = rest.split_at(n);
            rest = later;
            let mut encoder =
                gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            {
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
                for step in now {
                    let [x, y, z] = step.grid;
                    pass.set_pipeline(&step.pipeline);
                    pass.set_bind_group(0, &step.group, &[]);
                    pass.dispatch_workgroups(x, y, z);
                }
            }
            gpu.queue.submit([encoder.finish()]);
        }
    }
}

/// A grid of at least `n` workgroups; a kernel numbers them row by row.
pub(crate) fn line(n: usize) -> [u32; 3] {
    let across = n.clamp(1, 1 << 15);
    [across as u32, n.div_ceil(across).max(1) as u32, 1]
}

#[cfg(test)]
mod tests {
    /// Needs no card: the kernels are parsed and checked as the driver's front end would.
    #[test]
    fn the_kernels_are_valid() {
        use crate::columns::SOURCES;
        use crate::product::sources;
        use crate::units::Units;
        let large = Units { side: 16, lanes: 32 };
        for units in [None, Some(large), Some(Units { side: 8, lanes: 8 })] {
            let others = [
                ("adam", include_str!("adam.wgsl")),
                ("attend", include_str!("attend.wgsl")),
                ("attend_back", include_str!("attend_back.wgsl")),
                ("fold", include_str!("fold.wgsl")),
                ("head", include_str!("head.wgsl")),
                ("norm", include_str!("norm.wgsl")),
                ("norm_back", include_str!("norm_back.wgsl")),
                ("place", include_str!("place.wgsl")),
                ("round", include_str!("round.wgsl")),
                ("squares", include_str!("squares.wgsl")),
            ];
            let others = others.map(|(name, source)| (name, source.to_owned()));
            let columns = SOURCES.map(|of| ("columns", of()));
            let products = sources(units).map(|source| ("product", source));
            for (name, source) in others.into_iter().chain(columns).chain(products) {
                valid(name, &super::text(units.is_some(), &source), units.is_some());
            }
        }
    }

    fn valid(name: &str, text: &str, half: bool) {
        use wgpu::naga;
        let module = naga::front::wgsl::parse_str(text)
            .unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(text)));
        let flags = naga::valid::ValidationFlags::all();
        let capabilities = if half {
            naga::valid::Capabilities::all()
        } else {
            naga::valid::Capabilities::empty()
        };
        naga::valid::Validator::new(flags, capabilities)
            .validate(&module)
            .unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(text)));
        // WebGPU guarantees 16 KiB of workgroup memory. `units::fits` asks for what matrix units
        // need.
        let most = if half { 49_152 } else { 16_384 };
        let shared: u32 = module
            .global_variables
            .iter()
            .filter(|(_, v)| v.space == naga::AddressSpace::WorkGroup)
            .map(|(_, v)| module.types[v.ty].inner.size(module.to_ctx()))
            .sum();
        assert!(shared <= most, "{name} needs {shared} bytes of workgroup memory");
    }
}
