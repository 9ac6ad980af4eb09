//! Draws a frame: shadow, objects (4 samples), composition over the backdrop, readback.
//!
//! On a software driver every pixel is expensive, so unchanged content is not drawn again. The
//! backdrop (sky and endless floor) has no edges that need multisampling and changes only with the
//! camera. It is kept with and without sun, and the two are mixed where there is a shadow. The
//! shadow map is cleared only where it was used. Composition covers only the area of objects and
//! their shadows.

use std::collections::BTreeMap;

use glam::Mat4;

use super::buffers::{GpuMesh, put, vertex_buffer};
use super::caption::Captioner;
use super::frame::FrameInput;
use super::gpu::{DEPTH, Globals, Gpu, Instance, Pipelines, Segment};
use super::instances::{Batch, Drawn, Key};
use super::prims::Prim;
use super::targets::{Targets, texture};
use super::{Backend, Error, Picture, Scene};

/// The quality of a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Quality {
    /// Fast on a software driver: 1 sample, 1024 shadow, at most one ghost. On a GPU the same as
    /// export.
    Preview,
    /// 4 samples, 2048 shadow.
    #[default]
    Export,
}

/// Settings of a renderer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RenderConfig {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Samples, shadow, ghosts.
    pub quality: Quality,
    /// The adapter.
    pub backend: Backend,
    /// Whether objects cast shadows.
    pub shadows: bool,
}

impl Default for RenderConfig {
    fn default() -> Self {
        RenderConfig {
            width: 640,
            height: 480,
            quality: Quality::Export,
            backend: Backend::Auto,
            shadows: true,
        }
    }
}

/// Ghosts of a preview on a software driver: the command, the key before, the key after.
const CHEAP_GHOSTS: usize = 3;
/// Pixels beyond which four samples per pixel would not fit into the memory of small machines.
const SAMPLED_PX: u64 = 4096 * 4096;
/// x, y, width, height.
type Rect = [u32; 4];

/// Scenes whose meshes stay on the device.
const SCENES_KEPT: usize = 4;

/// An open device with all its resources. Keep it, because opening takes about 0.2 s.
#[derive(Debug)]
pub struct Renderer {
    gpu: Gpu,
    pipelines: Pipelines,
    prims: BTreeMap<Prim, GpuMesh>,
    meshes: Vec<(u64, Vec<GpuMesh>)>,
    globals: wgpu::Buffer,
    main_group: wgpu::BindGroup,
    shadow_group: wgpu::BindGroup,
    shadow_view: wgpu::TextureView,
    shadow_px: u32,
    /// The used part of the shadow map, texels; unknown before the first frame.
    shadow_used: Option<Rect>,
    /// The settings of the current backdrops.
    painted: Option<Globals>,
    instances: wgpu::Buffer,
    segments: wgpu::Buffer,
    targets: Targets,
    captioner: Captioner,
    config: RenderConfig,
}

impl Renderer {
    /// Opens a device.
    ///
    /// # Errors
    /// [`Error::NoAdapter`] with the line to run, [`Error::Device`], [`Error::Size`].
    pub fn new(config: RenderConfig) -> Result<Renderer, Error> {
        let gpu = Gpu::open(config.backend)?;
        check_size(&config, &gpu)?;
        let cheap = gpu.is_software() && config.quality == Quality::Preview;
        let pixels = u64::from(config.width) * u64::from(config.height);
        let samples = if cheap || pixels > SAMPLED_PX { 1 } else { 4 };
        if pixels > SAMPLED_PX {
            tracing::warn!(
                "{}x{} px is too large for 4 samples a pixel: edges will not be smoothed",
                config.width,
                config.height
            );
        }
        let shadow_px = match (config.shadows, cheap) {
            (false, _) => 1,
            (true, true) => 1024,
            (true, false) => 2048,
        };
        let pipelines = Pipelines::new(&gpu, samples);
        let device = &gpu.device;
        let globals = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("globals"),
            size: size_of::<Globals>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let shadow_view = texture(device, "shadow", shadow_px, shadow_px, 1, DEPTH)
            .create_view(&wgpu::TextureViewDescriptor::default());
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("shadow"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            compare: Some(wgpu::CompareFunction::LessEqual),
            ..wgpu::SamplerDescriptor::default()
        });
        let main_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("main"),
            layout: &pipelines.main_layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: globals.as_entire_binding() },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: wgpu::BindingResource::TextureView(&shadow_view),
                },
                wgpu::BindGroupEntry {
                    binding: 2,
                    resource: wgpu::BindingResource::Sampler(&sampler),
                },
            ],
        });
        let shadow_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("shadow"),
            layout: &pipelines.shadow_layout,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: globals.as_entire_binding() }],
        });
        let prims =
            Prim::ALL.into_iter().map(|p| (p, GpuMesh::new(device, &p.triangles()))).collect();
        let targets = Targets::new(&gpu, &pipelines, config.width, config.height);
        let renderer = Renderer {
            instances: vertex_buffer(device, 64 * 1024),
            segments: vertex_buffer(device, 16 * 1024),
            prims,
            meshes: Vec::new(),
            globals,
            main_group,
            shadow_group,
            shadow_view,
            shadow_px,
            shadow_used: None,
            painted: None,
            targets,
            captioner: Captioner::default(),
            config,
            pipelines,
            gpu,
        };
        renderer.gpu.check()?;
        Ok(renderer)
    }

    /// Name of the adapter, and whether it is a software driver.
    pub fn adapter(&self) -> (String, bool) {
        let info = &self.gpu.info;
        (format!("{} ({:?})", info.name, info.backend), self.gpu.is_software())
    }

    /// Samples per pixel, and texels along the shadow map's edge.
    pub fn samples(&self) -> (u32, u32) {
        (self.pipelines.samples, self.shadow_px)
    }

    /// Pixels of the pictures.
    pub fn size(&self) -> (u32, u32) {
        (self.config.width, self.config.height)
    }

    /// Changes the size of the following pictures.
    ///
    /// # Errors
    /// [`Error::Size`], [`Error::Device`].
    pub fn resize(&mut self, width: u32, height: u32) -> Result<(), Error> {
        let config = RenderConfig { width, height, ..self.config };
        check_size(&config, &self.gpu)?;
        if (width, height) != self.size() {
            self.targets = Targets::new(&self.gpu, &self.pipelines, width, height);
            self.painted = None;
            self.config = config;
        }
        self.gpu.check()
    }

    /// Draws one frame.
    ///
    /// # Errors
    /// [`Error::PoseCount`], [`Error::NotFinite`], [`Error::Device`].
    pub fn draw(&mut self, scene: &Scene, input: &FrameInput) -> Result<Picture, Error> {
        check_input(scene, input)?;
        self.keep_meshes(scene);
        let aspect = self.config.width as f32 / self.config.height as f32;
        let cheap = self.gpu.is_software() && self.config.quality == Quality::Preview;
        let ghosts = input
            .ghosts
            .get(..input.ghosts.len().min(if cheap { CHEAP_GHOSTS } else { usize::MAX }));
        let drawn =
            Drawn::collect(scene, input, ghosts.unwrap_or_default(), aspect, self.config.height);
        let globals = Globals::of_frame(&self.config, self.shadow_px, scene, input, &drawn, aspect);
        let device = &self.gpu.device;
        let queue = &self.gpu.queue;
        queue.write_buffer(&self.globals, 0, bytemuck::bytes_of(&globals));
        put(device, queue, &mut self.instances, bytemuck::cast_slice(&drawn.instances));
        put(device, queue, &mut self.segments, bytemuck::cast_slice(&drawn.segments));

        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let shadow_used = self.shadow_pass(&mut encoder, scene, &drawn, &globals);
        self.object_pass(&mut encoder, scene, &drawn);
        // The backdrop depends only on the rays of sky and floor, which are stored beside the
        // matrices.
        let still = Globals {
            view_proj: [[0.0; 4]; 4],
            light_proj: [[0.0; 4]; 4],
            shadow: [0.0; 4],
            ..globals
        };
        if self.painted != Some(still) {
            self.backdrop_pass(&mut encoder);
        }
        self.compose_pass(&mut encoder, &drawn);
        self.targets.copy_picture(&mut encoder);
        queue.submit([encoder.finish()]);
        self.gpu.check()?;
        (self.shadow_used, self.painted) = (Some(shadow_used), Some(still));
        let mut picture = self.targets.read_back(&self.gpu)?;
        if let Some(caption) = input.caption {
            self.captioner.draw(&mut picture, caption);
        }
        Ok(picture)
    }

    fn keep_meshes(&mut self, scene: &Scene) {
        if let Some(at) = self.meshes.iter().position(|(id, _)| *id == scene.id) {
            let kept = self.meshes.remove(at);
            self.meshes.push(kept);
            return;
        }
        let device = &self.gpu.device;
        let uploaded = scene.meshes.iter().map(|m| GpuMesh::new(device, &m.triangles)).collect();
        if self.meshes.len() >= SCENES_KEPT {
            self.meshes.remove(0);
        }
        self.meshes.push((scene.id, uploaded));
    }

    fn mesh(&self, scene: &Scene, key: Key) -> Option<&GpuMesh> {
        match key {
            Key::Prim(p) => self.prims.get(&p),
            Key::Mesh(i) => {
                self.meshes.iter().rev().find(|(id, _)| *id == scene.id).and_then(|(_, m)| m.get(i))
            }
        }
    }

    fn batches(&self, pass: &mut wgpu::RenderPass, scene: &Scene, batches: &[Batch]) {
        self.batches_as(pass, scene, batches, |key| key);
    }

    fn batches_as(
        &self,
        pass: &mut wgpu::RenderPass,
        scene: &Scene,
        batches: &[Batch],
        form: fn(Key) -> Key,
    ) {
        pass.set_vertex_buffer(1, self.instances.slice(..));
        for b in batches {
            let Some(mesh) = self.mesh(scene, form(b.key)) else { continue };
            pass.set_vertex_buffer(0, mesh.vertices.slice(..));
            pass.set_index_buffer(mesh.indices.slice(..), wgpu::IndexFormat::Uint32);
            pass.draw_indexed(0..mesh.count, 0, b.range.clone());
        }
    }

    /// Draws the shadow map, and returns its used part.
    fn shadow_pass(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        scene: &Scene,
        drawn: &Drawn,
        globals: &Globals,
    ) -> Rect {
        let light = Mat4::from_cols_array_2d(&globals.light_proj);
        // Without shadows the map is still read, so it must mean "lit everywhere".
        let used =
            if self.config.shadows { drawn.shadow_rect(&light, self.shadow_px) } else { [0; 4] };
        let mut pass = depth_pass(encoder, &self.shadow_view, self.shadow_used.is_none());
        pass.set_bind_group(0, &self.shadow_group, &[]);
        if let Some(old) = self.shadow_used {
            let [x, y, w, h] = union(old, used);
            if w > 0 && h > 0 {
                pass.set_scissor_rect(x, y, w, h);
                pass.set_pipeline(&self.pipelines.wipe);
                pass.draw(0..3, 0..1);
            }
        }
        let [x, y, w, h] = used;
        if w > 0 && h > 0 {
            pass.set_scissor_rect(x, y, w, h);
            pass.set_pipeline(&self.pipelines.shadow);
            self.batches_as(&mut pass, scene, &drawn.casters, Key::coarser);
        }
        used
    }

    fn object_pass(&self, encoder: &mut wgpu::CommandEncoder, scene: &Scene, drawn: &Drawn) {
        let t = &self.targets;
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("objects"),
            color_attachments: &[Some(color(
                &t.objects,
                wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
            ))],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &t.depth,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(1.0),
                    store: wgpu::StoreOp::Discard,
                }),
                stencil_ops: None,
            }),
            ..wgpu::RenderPassDescriptor::default()
        });
        if let Some([x, y, w, h]) = drawn.rect {
            pass.set_scissor_rect(x, y, w, h);
        }
        pass.set_bind_group(0, &self.main_group, &[]);
        if drawn.below_floor {
            pass.set_pipeline(&self.pipelines.floor_depth);
            pass.draw(0..6, 0..1);
        }
        let opaque = if self.config.shadows {
            &self.pipelines.opaque
        } else {
            &self.pipelines.opaque_unshadowed
        };
        pass.set_pipeline(opaque);
        self.batches(&mut pass, scene, &drawn.casters);
        self.batches(&mut pass, scene, &drawn.props);
        if !drawn.glass.is_empty() {
            pass.set_pipeline(&self.pipelines.glass);
            self.batches(&mut pass, scene, &drawn.glass);
        }
        if !drawn.ghosts.is_empty() {
            pass.set_pipeline(&self.pipelines.ghost_depth);
            self.batches(&mut pass, scene, &drawn.ghosts);
            pass.set_pipeline(&self.pipelines.ghost);
            self.batches(&mut pass, scene, &drawn.ghosts);
        }
        if !drawn.segments.is_empty() {
            pass.set_pipeline(&self.pipelines.line);
            pass.set_vertex_buffer(0, self.segments.slice(..));
            pass.draw(0..6, 0..drawn.segments.len() as u32);
        }
        if !drawn.signs.is_empty() {
            pass.set_pipeline(&self.pipelines.sign);
            self.batches(&mut pass, scene, &drawn.signs);
        }
    }

    fn backdrop_pass(&self, encoder: &mut wgpu::CommandEncoder) {
        let [lit, dark] = &self.targets.backdrops;
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("backdrop"),
            color_attachments: &[
                Some(color(lit, wgpu::LoadOp::Clear(wgpu::Color::BLACK))),
                Some(color(dark, wgpu::LoadOp::Clear(wgpu::Color::BLACK))),
            ],
            ..wgpu::RenderPassDescriptor::default()
        });
        pass.set_bind_group(0, &self.shadow_group, &[]);
        pass.set_pipeline(&self.pipelines.backdrop);
        pass.draw(0..3, 0..1);
    }

    fn compose_pass(&self, encoder: &mut wgpu::CommandEncoder, drawn: &Drawn) {
        let t = &self.targets;
        let size = wgpu::Extent3d { width: t.width, height: t.height, depth_or_array_layers: 1 };
        encoder.copy_texture_to_texture(t.lit.as_image_copy(), t.picture.as_image_copy(), size);
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("compose"),
            color_attachments: &[Some(color(&t.picture_view, wgpu::LoadOp::Load))],
            ..wgpu::RenderPassDescriptor::default()
        });
        let [x, y, w, h] = drawn.shaded.unwrap_or([0, 0, t.width, t.height]);
        if w > 0 && h > 0 {
            pass.set_scissor_rect(x, y, w, h);
            pass.set_pipeline(&self.pipelines.compose);
            pass.set_bind_group(0, &self.main_group, &[]);
            pass.set_bind_group(1, &t.compose, &[]);
            pass.draw(0..3, 0..1);
        }
    }
}

fn check_size(config: &RenderConfig, gpu: &Gpu) -> Result<(), Error> {
    let fits = |px: u32| (1..=gpu.max_px).contains(&px);
    if fits(config.width) && fits(config.height) {
        return Ok(());
    }
    Err(Error::Size { width: config.width, height: config.height, max_px: gpu.max_px })
}

fn check_input(scene: &Scene, input: &FrameInput) -> Result<(), Error> {
    scene.check("the achieved motion", input.poses)?;
    for (i, g) in input.ghosts.iter().enumerate() {
        scene.check(&format!("ghost {i}"), g.poses)?;
    }
    let bad = |what: &str| Err(Error::NotFinite { what: what.to_owned() });
    if !input.camera.is_finite() {
        return bad("the camera");
    }
    if input.sun.is_some_and(|s| !s.is_finite()) {
        return bad("the direction of the light");
    }
    if input.trails.iter().any(|t| !t.points.iter().all(|p| p.is_finite())) {
        return bad("a trail");
    }
    if input.marks.iter().any(|m| !m.at.is_finite()) {
        return bad("a mark");
    }
    Ok(())
}

/// The smallest rectangle that contains both; an empty one is ignored.
fn union(a: Rect, b: Rect) -> Rect {
    let empty = |r: Rect| r[2] == 0 || r[3] == 0;
    if empty(a) {
        return b;
    }
    if empty(b) {
        return a;
    }
    let (x, y) = (a[0].min(b[0]), a[1].min(b[1]));
    let end = |k: usize| (a[k] + a[k + 2]).max(b[k] + b[k + 2]);
    [x, y, end(0) - x, end(1) - y]
}

fn color(
    view: &wgpu::TextureView,
    load: wgpu::LoadOp<wgpu::Color>,
) -> wgpu::RenderPassColorAttachment<'_> {
    wgpu::RenderPassColorAttachment {
        view,
        depth_slice: None,
        resolve_target: None,
        ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
    }
}

fn depth_pass<'a>(
    encoder: &'a mut wgpu::CommandEncoder,
    view: &wgpu::TextureView,
    clear: bool,
) -> wgpu::RenderPass<'a> {
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("shadow"),
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view,
            depth_ops: Some(wgpu::Operations {
                load: if clear { wgpu::LoadOp::Clear(1.0) } else { wgpu::LoadOp::Load },
                store: wgpu::StoreOp::Store,
            }),
            stencil_ops: None,
        }),
        ..wgpu::RenderPassDescriptor::default()
    })
}

/// Kept here so that sizes in the shader and on the host are defined once.
const _: () = assert!(size_of::<Instance>() == 80 && size_of::<Segment>() == 96);
