//! Adapter, device and pipelines, which live as long as the renderer.

use std::sync::{Arc, Mutex};

use wgpu::CompareFunction::{Always, Equal, Less, LessEqual};

use super::Error;
use super::prims::Vertex;

/// The choice of the adapter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Backend {
    /// A GPU if there is one, else the software driver.
    #[default]
    Auto,
    /// Only a GPU.
    Gpu,
    /// Only the software driver: same pixels on every machine with the same Mesa.
    Cpu,
}

/// The colour format: encoded by the shader, see `shader.wgsl`.
pub(super) const COLOR: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
pub(super) const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// One thing to draw, as the shader reads it: 80 bytes.
#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct Instance {
    pub rows: [[f32; 4]; 3],
    pub size: [f32; 4],
    pub color: [f32; 4],
}

/// A piece of a line: 96 bytes.
#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct Segment {
    pub a: [f32; 4],
    pub b: [f32; 4],
    pub prev: [f32; 4],
    pub next: [f32; 4],
    pub color_a: [f32; 4],
    pub color_b: [f32; 4],
}

/// The uniform block, field by field as in `shader.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct Globals {
    pub view_proj: [[f32; 4]; 4],
    pub light_proj: [[f32; 4]; 4],
    pub eye: [f32; 4],
    pub forward: [f32; 4],
    pub ray_x: [f32; 4],
    pub ray_y: [f32; 4],
    pub sun: [f32; 4],
    pub sun_color: [f32; 4],
    pub sky: [f32; 4],
    pub ground: [f32; 4],
    pub zenith: [f32; 4],
    pub horizon: [f32; 4],
    pub floor_a: [f32; 4],
    pub floor_b: [f32; 4],
    pub floor_pos: [f32; 4],
    pub floor_fog: [f32; 4],
    pub shadow: [f32; 4],
    pub view: [f32; 4],
}

/// An open device.
#[derive(Debug)]
pub(super) struct Gpu {
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    pub info: wgpu::AdapterInfo,
    pub max_px: u32,
    complaint: Arc<Mutex<Option<String>>>,
}

impl Gpu {
    pub(super) fn open(backend: Backend) -> Result<Gpu, Error> {
        let descriptor = wgpu::InstanceDescriptor {
            backends: wgpu::Backends::VULKAN | wgpu::Backends::GL,
            flags: wgpu::InstanceFlags::empty(),
            ..wgpu::InstanceDescriptor::new_without_display_handle()
        };
        let instance = wgpu::Instance::new(descriptor);
        let options = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            force_fallback_adapter: backend == Backend::Cpu,
            ..wgpu::RequestAdapterOptions::default()
        };
        let none = |reason: String| match backend {
            Backend::Gpu => Error::NoGpu { reason },
            Backend::Auto | Backend::Cpu => Error::NoAdapter { reason },
        };
        let adapter = pollster::block_on(instance.request_adapter(&options))
            .map_err(|e| none(e.to_string()))?;
        let info = adapter.get_info();
        if backend == Backend::Gpu && info.device_type == wgpu::DeviceType::Cpu {
            return Err(none(format!("there is only the software driver {}", info.name)));
        }
        let limits = wgpu::Limits::default().using_resolution(adapter.limits());
        let max_px = limits.max_texture_dimension_2d.min(robert_base::limits::PICTURE_PX);
        let device = wgpu::DeviceDescriptor {
            label: Some("robert"),
            required_limits: limits,
            ..wgpu::DeviceDescriptor::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&device))
            .map_err(|e| Error::Device { adapter: info.name.clone(), reason: e.to_string() })?;
        let complaint = Arc::new(Mutex::new(None));
        let slot = complaint.clone();
        // Without a handler wgpu panics; here the first error becomes that of the draw.
        device.on_uncaptured_error(Arc::new(move |e: wgpu::Error| {
            if let Ok(mut slot) = slot.lock() {
                slot.get_or_insert_with(|| e.to_string());
            }
        }));
        Ok(Gpu { device, queue, info, max_px, complaint })
    }

    /// Whether the processor draws the pixels.
    pub(super) fn is_software(&self) -> bool {
        self.info.device_type == wgpu::DeviceType::Cpu
    }

    /// The first error of the driver since the last call.
    pub(super) fn check(&self) -> Result<(), Error> {
        let complaint = self.complaint.lock().ok().and_then(|mut c| c.take());
        complaint.map_or(Ok(()), |reason| Err(self.error(&reason)))
    }

    pub(super) fn error(&self, reason: &(impl ToString + ?Sized)) -> Error {
        Error::Device { adapter: self.info.name.clone(), reason: reason.to_string() }
    }
}

/// Pipelines for one sample count.
#[derive(Debug)]
pub(super) struct Pipelines {
    pub opaque: wgpu::RenderPipeline,
    pub opaque_unshadowed: wgpu::RenderPipeline,
    pub floor_depth: wgpu::RenderPipeline,
    pub ghost_depth: wgpu::RenderPipeline,
    pub ghost: wgpu::RenderPipeline,
    pub glass: wgpu::RenderPipeline,
    pub line: wgpu::RenderPipeline,
    /// Symbols that are drawn over everything else.
    pub sign: wgpu::RenderPipeline,
    pub shadow: wgpu::RenderPipeline,
    /// Clears the shadow map.
    pub wipe: wgpu::RenderPipeline,
    pub compose: wgpu::RenderPipeline,
    pub backdrop: wgpu::RenderPipeline,
    /// Globals, shadow map, sampler.
    pub main_layout: wgpu::BindGroupLayout,
    /// Globals only (the shadow pass writes the map that the other one reads).
    pub shadow_layout: wgpu::BindGroupLayout,
    /// The drawn objects and the two backdrops.
    pub compose_layout: wgpu::BindGroupLayout,
    pub samples: u32,
}

/// The switches that distinguish the pipelines of the object pass; they are independent.
#[allow(clippy::struct_excessive_bools)]
#[derive(Clone, Copy)]
struct Pass {
    label: &'static str,
    vertex: &'static str,
    fragment: Option<&'static str>,
    lines: bool,
    blend: bool,
    depth_write: bool,
    compare: wgpu::CompareFunction,
    bias: bool,
    cull: bool,
}

const INSTANCE_ATTRIBUTES: [wgpu::VertexAttribute; 5] = wgpu::vertex_attr_array![2 => Float32x4, 3 => Float32x4, 4 => Float32x4, 5 => Float32x4, 6 => Float32x4];
const VERTEX_ATTRIBUTES: [wgpu::VertexAttribute; 2] =
    wgpu::vertex_attr_array![0 => Float32x4, 1 => Float32x4];
const SEGMENT_ATTRIBUTES: [wgpu::VertexAttribute; 6] = wgpu::vertex_attr_array![0 => Float32x4, 1 => Float32x4, 2 => Float32x4, 3 => Float32x4, 4 => Float32x4, 5 => Float32x4];

fn buffers() -> [Option<wgpu::VertexBufferLayout<'static>>; 2] {
    [
        Some(wgpu::VertexBufferLayout {
            array_stride: size_of::<Vertex>() as u64,
            step_mode: wgpu::VertexStepMode::Vertex,
            attributes: &VERTEX_ATTRIBUTES,
        }),
        Some(wgpu::VertexBufferLayout {
            array_stride: size_of::<Instance>() as u64,
            step_mode: wgpu::VertexStepMode::Instance,
            attributes: &INSTANCE_ATTRIBUTES,
        }),
    ]
}

const OVER: wgpu::BlendState = wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING;

impl Pipelines {
    pub(super) fn new(gpu: &Gpu, samples: u32) -> Pipelines {
        let device = &gpu.device;
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("shader.wgsl"),
            source: wgpu::ShaderSource::Wgsl(include_str!("shader.wgsl").into()),
        });
        let uniform = wgpu::BindGroupLayoutEntry {
            binding: 0,
            visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Uniform,
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        };
        let texture = |binding, sample_type, multisampled| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::FRAGMENT,
            ty: wgpu::BindingType::Texture {
                sample_type,
                view_dimension: wgpu::TextureViewDimension::D2,
                multisampled,
            },
            count: None,
        };
        let layout = |label, entries: &[wgpu::BindGroupLayoutEntry]| {
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some(label),
                entries,
            })
        };
        let main_layout = layout(
            "main",
            &[
                uniform,
                texture(1, wgpu::TextureSampleType::Depth, false),
                wgpu::BindGroupLayoutEntry {
                    binding: 2,
                    visibility: wgpu::ShaderStages::FRAGMENT,
                    ty: wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Comparison),
                    count: None,
                },
            ],
        );
        let shadow_layout = layout("shadow", &[uniform]);
        let float = wgpu::TextureSampleType::Float { filterable: false };
        let multisampled = samples > 1;
        let compose_layout = layout(
            "compose",
            &[
                texture(u32::from(multisampled), float, multisampled),
                texture(2, float, false),
                texture(3, float, false),
            ],
        );
        let pipeline_layout = |groups: &[Option<&wgpu::BindGroupLayout>]| {
            device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: None,
                bind_group_layouts: groups,
                immediate_size: 0,
            })
        };
        let main = pipeline_layout(&[Some(&main_layout)]);
        let shadow_only = pipeline_layout(&[Some(&shadow_layout)]);
        let composing = pipeline_layout(&[Some(&main_layout), Some(&compose_layout)]);

        let mesh_buffers = buffers();
        let line_buffers = [Some(wgpu::VertexBufferLayout {
            array_stride: size_of::<Segment>() as u64,
            step_mode: wgpu::VertexStepMode::Instance,
            attributes: &SEGMENT_ATTRIBUTES,
        })];
        let object = |p: Pass| {
            let target = [Some(wgpu::ColorTargetState {
                format: COLOR,
                blend: p.blend.then_some(OVER),
                write_mask: if p.fragment.is_some() {
                    wgpu::ColorWrites::ALL
                } else {
                    wgpu::ColorWrites::empty()
                },
            })];
            let buffers: &[Option<wgpu::VertexBufferLayout>] = match (p.lines, p.vertex) {
                (true, _) => &line_buffers,
                (_, "vs_floor") => &[],
                _ => &mesh_buffers,
            };
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(p.label),
                layout: Some(&main),
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some(p.vertex),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    buffers,
                },
                primitive: wgpu::PrimitiveState {
                    cull_mode: p.cull.then_some(wgpu::Face::Back),
                    ..wgpu::PrimitiveState::default()
                },
                depth_stencil: Some(wgpu::DepthStencilState {
                    format: DEPTH,
                    depth_write_enabled: Some(p.depth_write),
                    depth_compare: Some(p.compare),
                    stencil: wgpu::StencilState::default(),
                    // Ghosts are moved back a little, so that the solid surface wins where both
                    // nearly coincide, instead of ragged patches of both.
                    bias: if p.bias {
                        wgpu::DepthBiasState { constant: 4, slope_scale: 1.5, clamp: 0.0 }
                    } else {
                        wgpu::DepthBiasState::default()
                    },
                }),
                multisample: wgpu::MultisampleState {
                    count: samples,
                    ..wgpu::MultisampleState::default()
                },
                fragment: Some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some(p.fragment.unwrap_or("fs_depth_only")),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    targets: &target,
                }),
                multiview_mask: None,
                cache: None,
            })
        };
        let solid = Pass {
            label: "opaque",
            vertex: "vs_surface",
            fragment: Some("fs_opaque"),
            lines: false,
            blend: false,
            depth_write: true,
            compare: Less,
            bias: false,
            cull: true,
        };
        let veil = Pass { blend: true, depth_write: false, ..solid };
        let full_screen = |label, layout, entry, targets: &[Option<wgpu::ColorTargetState>]| {
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(label),
                layout: Some(layout),
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some("vs_backdrop"),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    buffers: &[],
                },
                primitive: wgpu::PrimitiveState::default(),
                depth_stencil: None,
                multisample: wgpu::MultisampleState::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some(entry),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    targets,
                }),
                multiview_mask: None,
                cache: None,
            })
        };
        let depth_only = |label, entry, buffers: &[_], cull_mode, compare, bias| {
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(label),
                layout: Some(&shadow_only),
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some(entry),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    buffers,
                },
                primitive: wgpu::PrimitiveState { cull_mode, ..wgpu::PrimitiveState::default() },
                depth_stencil: Some(wgpu::DepthStencilState {
                    format: DEPTH,
                    depth_write_enabled: Some(true),
                    depth_compare: Some(compare),
                    stencil: wgpu::StencilState::default(),
                    bias,
                }),
                multisample: wgpu::MultisampleState::default(),
                fragment: None,
                multiview_mask: None,
                cache: None,
            })
        };
        let bias = wgpu::DepthBiasState { constant: 2, slope_scale: 2.0, clamp: 0.0 };
        let back = Some(wgpu::Face::Back);
        let shadow = depth_only("shadow", "vs_shadow", &mesh_buffers, back, Less, bias);
        let unbiased = wgpu::DepthBiasState::default();
        let wipe = depth_only("wipe", "vs_far", &[], None, Always, unbiased);
        let compose_entry = if multisampled { "fs_compose_samples" } else { "fs_compose" };
        Pipelines {
            opaque: object(solid),
            opaque_unshadowed: object(Pass {
                label: "unshadowed",
                fragment: Some("fs_opaque_unshadowed"),
                ..solid
            }),
            floor_depth: object(Pass {
                label: "floor depth",
                vertex: "vs_floor",
                fragment: None,
                cull: false,
                ..solid
            }),
            ghost_depth: object(Pass { label: "ghost depth", fragment: None, bias: true, ..solid }),
            ghost: object(Pass {
                label: "ghost",
                fragment: Some("fs_ghost"),
                compare: Equal,
                bias: true,
                ..veil
            }),
            glass: object(Pass {
                label: "glass",
                fragment: Some("fs_glass"),
                compare: LessEqual,
                ..veil
            }),
            line: object(Pass {
                label: "line",
                vertex: "vs_line",
                fragment: Some("fs_line"),
                lines: true,
                compare: LessEqual,
                cull: false,
                ..veil
            }),
            sign: object(Pass {
                label: "sign",
                fragment: Some("fs_opaque_unshadowed"),
                compare: Always,
                depth_write: false,
                ..solid
            }),
            shadow,
            wipe,
            compose: full_screen("compose", &composing, compose_entry, &[Some(COLOR.into())]),
            backdrop: full_screen(
                "backdrop",
                &shadow_only,
                "fs_backdrop",
                &[Some(COLOR.into()), Some(COLOR.into())],
            ),
            main_layout,
            shadow_layout,
            compose_layout,
            samples,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Needs no GPU: the shader is parsed and checked as the driver's front end would.
    #[test]
    fn the_shader_is_valid_and_matches_the_structs() {
        use wgpu::naga;
        let module = naga::front::wgsl::parse_str(include_str!("shader.wgsl")).unwrap();
        let mut validator = naga::valid::Validator::new(
            naga::valid::ValidationFlags::all(),
            naga::valid::Capabilities::empty(),
        );
        validator.validate(&module).unwrap();
        let (_, globals) =
            module.types.iter().find(|(_, t)| t.name.as_deref() == Some("Globals")).unwrap();
        let naga::TypeInner::Struct { span, ref members } = globals.inner else { panic!() };
        assert_eq!(span as usize, size_of::<Globals>());
        assert_eq!(members.len(), 18);
        assert_eq!(size_of::<Instance>(), 80);
        assert_eq!(size_of::<Segment>(), 96);
    }
}
