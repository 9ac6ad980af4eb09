//! Draws a frame: shadow, objects (4 samples), composition over the backdrop, readback.
//!
//! On a software driver every pixel is expensive, so unchanged content is not drawn again. The
//! backdrop (sky and endless floor) has no edges that need multisampling and changes only with the
//! camera. It is kept with and without sun, and the two are mixed where there is a shadow. The
//! shadow map is cleared only where it was used. Composition covers only the area of objects and
//! their shadows.

use std::collections::BTreeMap;

use glam::{Mat4, Vec3};
use wgpu::util::DeviceExt;

use super::caption::Captioner;
use super::frame::{FrameInput, SUN};
use super::gpu::{COLOR, DEPTH, Globals, Gpu, Instance, Pipelines, Segment};
use super::instances::{Batch, Drawn, Key, linear};
use super::prims::{Prim, Triangles};
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
/// Time limit of the driver for one frame, seconds.
const FRAME_SECS: u64 = 120;
/// Pixels beyond which four samples per pixel would not fit into the memory of small machines.
const SAMPLED_PX: u64 = 4096 * 4096;
/// x, y, width, height.
type Rect = [u32; 4];

/// Scenes whose meshes stay on the device.
const SCENES_KEPT: usize = 4;

#[derive(Debug)]
struct GpuMesh {
    vertices: wgpu::Buffer,
    indices: wgpu::Buffer,
    count: u32,
}

#[derive(Debug)]
struct Targets {
    width: u32,
    height: u32,
    objects: wgpu::TextureView,
    depth: wgpu::TextureView,
    compose: wgpu::BindGroup,
    /// Sky and floor with and without sun.
    lit: wgpu::Texture,
    backdrops: [wgpu::TextureView; 2],
    picture: wgpu::Texture,
    picture_view: wgpu::TextureView,
    readback: wgpu::Buffer,
    pitch: u32,
}

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
        let prims = Prim::ALL.into_iter().map(|p| (p, upload(device, &p.triangles()))).collect();
        let targets = targets(&gpu, &pipelines, config.width, config.height);
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
            self.targets = targets(&self.gpu, &self.pipelines, width, height);
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
        let globals = self.fill_globals(scene, input, &drawn, aspect);
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
        let t = &self.targets;
        encoder.copy_texture_to_buffer(
            t.picture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &t.readback,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(t.pitch),
                    rows_per_image: None,
                },
            },
            wgpu::Extent3d { width: t.width, height: t.height, depth_or_array_layers: 1 },
        );
        queue.submit([encoder.finish()]);
        self.gpu.check()?;
        (self.shadow_used, self.painted) = (Some(shadow_used), Some(still));
        let mut picture = self.read_back()?;
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
        let uploaded = scene.meshes.iter().map(|m| upload(device, &m.triangles)).collect();
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

    fn read_back(&self) -> Result<Picture, Error> {
        let t = &self.targets;
        let slice = t.readback.slice(..);
        let (send, receive) = std::sync::mpsc::sync_channel(1);
        slice.map_async(wgpu::MapMode::Read, move |r| {
            send.send(r).ok();
        });
        let wait = wgpu::PollType::Wait {
            submission_index: None,
            timeout: Some(std::time::Duration::from_secs(FRAME_SECS)),
        };
        self.gpu.device.poll(wait).map_err(|e| self.gpu.error(&e))?;
        match receive.try_recv() {
            Ok(Ok(())) => {}
            Ok(Err(e)) => return Err(self.gpu.error(&e)),
            Err(e) => return Err(self.gpu.error(&e)),
        }
        let mapped = slice.get_mapped_range().map_err(|e| self.gpu.error(&e))?;
        let row = t.width as usize * 4;
        let mut rgba = Vec::with_capacity(row * t.height as usize);
        for line in mapped.chunks_exact(t.pitch as usize).take(t.height as usize) {
            rgba.extend_from_slice(&line[..row]);
        }
        drop(mapped);
        t.readback.unmap();
        Ok(Picture { width: t.width, height: t.height, rgba })
    }

    fn fill_globals(
        &self,
        scene: &Scene,
        input: &FrameInput,
        drawn: &Drawn,
        aspect: f32,
    ) -> Globals {
        let camera = &input.camera;
        let (right, up, forward) = camera.axes();
        let half = camera.half_height();
        let ortho = matches!(camera.lens, super::Lens::Orthographic { .. });
        // Height of the picture at the target: the scale of cells and fog. It does not depend on
        // poses, so the floor does not move.
        let focus = 2.0 * camera.metres_a_px(camera.target, 2).max(1e-4);
        let cell = cell_size(focus / 5.0);
        let sun = input.sun.unwrap_or(SUN).normalize_or(Vec3::Z);
        // A shadow need not be finer than the picture, so texels have at least half a pixel. On a
        // software driver this saves a fifth of the frame: fewer texels are drawn, and lookups are
        // closer in memory.
        let least = 0.5 * camera.metres_a_px(drawn.centre, self.config.height);
        let reach = drawn.radius.max(0.5 * least * self.shadow_px as f32);
        let (light_proj, texel_m) = light_box(sun, drawn.centre, reach, self.shadow_px);
        let (a, b) = (linear([0.545, 0.575, 0.615]), linear([0.485, 0.515, 0.560]));
        let horizon = linear([0.735, 0.760, 0.790]);
        let zenith = linear([0.56, 0.62, 0.70]);
        let floor_z = scene.floor.map_or(-1e3, |f| f.z);
        Globals {
            view_proj: camera.matrix(aspect, drawn.near, drawn.far).to_cols_array_2d(),
            light_proj: light_proj.to_cols_array_2d(),
            eye: camera.eye.extend(f32::from(u8::from(ortho))).to_array(),
            forward: forward.extend(0.0).to_array(),
            ray_x: (right * half * aspect).extend(0.0).to_array(),
            ray_y: (up * half).extend(0.0).to_array(),
            sun: sun.extend(f32::from(u8::from(self.config.shadows)) * 0.92).to_array(),
            sun_color: [0.78, 0.75, 0.70, 0.22],
            sky: [0.36, 0.39, 0.44, 0.0],
            ground: [0.15, 0.14, 0.135, 0.0],
            zenith: [zenith[0], zenith[1], zenith[2], 0.0],
            horizon: [horizon[0], horizon[1], horizon[2], 0.0],
            floor_a: [a[0], a[1], a[2], cell],
            floor_b: [b[0], b[1], b[2], f32::from(u8::from(scene.floor.is_some()))],
            floor_pos: [camera.target.x, camera.target.y, floor_z, 0.9 * focus],
            floor_fog: [1.0 / (5.0 * focus), 0.10, 0.0, 0.0],
            shadow: [1.0 / self.shadow_px as f32, 1.5 * texel_m, 1.0, 1.4],
            view: [
                self.config.width as f32,
                self.config.height as f32,
                1.0 / self.config.width as f32,
                1.0 / self.config.height as f32,
            ],
        }
    }
}

/// The next of 1, 2, 5 times a power of ten, not below `wish`.
fn cell_size(wish: f32) -> f32 {
    let power = 10_f32.powf(wish.max(1e-6).log10().floor());
    let lead = wish / power;
    power
        * if lead <= 1.0 {
            1.0
        } else if lead <= 2.0 {
            2.0
        } else if lead <= 5.0 {
            5.0
        } else {
            10.0
        }
}

/// Orthographic light that covers a sphere, and the metres of one texel.
///
/// The size grows in steps of a tenth, and the centre is on the texel grid; otherwise the edge of a
/// shadow would flicker from frame to frame.
fn light_box(sun: Vec3, centre: Vec3, radius: f32, shadow_px: u32) -> (Mat4, f32) {
    let step = 1.1_f32;
    let radius = step.powf((radius.max(1e-4) * 1.03).log(step).ceil());
    let texel = 2.0 * radius / shadow_px as f32;
    let right = if sun.z.abs() > 0.999 { Vec3::X } else { Vec3::Z.cross(sun).normalize() };
    let up = sun.cross(right);
    let snap = |x: f32| (x / texel).round() * texel;
    let at = right * snap(centre.dot(right)) + up * snap(centre.dot(up)) + sun * centre.dot(sun);
    let eye = at + sun * 2.0 * radius;
    let view = Mat4::from_cols(
        Vec3::new(right.x, up.x, sun.x).extend(0.0),
        Vec3::new(right.y, up.y, sun.y).extend(0.0),
        Vec3::new(right.z, up.z, sun.z).extend(0.0),
        Vec3::new(-right.dot(eye), -up.dot(eye), -sun.dot(eye)).extend(1.0),
    );
    let proj = glam::camera::rh::proj::directx::orthographic(
        -radius,
        radius,
        -radius,
        radius,
        0.5 * radius,
        3.5 * radius,
    );
    (proj * view, texel)
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

fn texture(
    device: &wgpu::Device,
    label: &str,
    width: u32,
    height: u32,
    samples: u32,
    format: wgpu::TextureFormat,
) -> wgpu::Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: samples,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT
            | wgpu::TextureUsages::TEXTURE_BINDING
            | if samples == 1 {
                wgpu::TextureUsages::COPY_SRC | wgpu::TextureUsages::COPY_DST
            } else {
                wgpu::TextureUsages::empty()
            },
        view_formats: &[],
    })
}

fn targets(gpu: &Gpu, pipelines: &Pipelines, width: u32, height: u32) -> Targets {
    let device = &gpu.device;
    let view = wgpu::TextureViewDescriptor::default();
    let samples = pipelines.samples;
    let objects = texture(device, "objects", width, height, samples, COLOR).create_view(&view);
    let depth = texture(device, "depth", width, height, samples, DEPTH).create_view(&view);
    let picture = texture(device, "picture", width, height, 1, COLOR);
    let [lit, dark] =
        ["lit backdrop", "dark backdrop"].map(|l| texture(device, l, width, height, 1, COLOR));
    let backdrops = [&lit, &dark].map(|t| t.create_view(&view));
    let pitch = (4 * width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let compose = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("compose"),
        layout: &pipelines.compose_layout,
        entries: &[(u32::from(samples > 1), &objects), (2, &backdrops[0]), (3, &backdrops[1])].map(
            |(binding, view)| wgpu::BindGroupEntry {
                binding,
                resource: wgpu::BindingResource::TextureView(view),
            },
        ),
    });
    Targets {
        width,
        height,
        objects,
        depth,
        compose,
        lit,
        backdrops,
        picture_view: picture.create_view(&view),
        picture,
        readback: device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("readback"),
            size: u64::from(pitch) * u64::from(height),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        }),
        pitch,
    }
}

fn upload(device: &wgpu::Device, t: &Triangles) -> GpuMesh {
    let make = |label, contents, usage| {
        device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some(label),
            contents,
            usage,
        })
    };
    GpuMesh {
        vertices: make("vertices", bytemuck::cast_slice(&t.vertices), wgpu::BufferUsages::VERTEX),
        indices: make("indices", bytemuck::cast_slice(&t.indices), wgpu::BufferUsages::INDEX),
        count: t.indices.len() as u32,
    }
}

fn vertex_buffer(device: &wgpu::Device, bytes: u64) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("per frame"),
        size: bytes,
        usage: wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

fn put(device: &wgpu::Device, queue: &wgpu::Queue, buffer: &mut wgpu::Buffer, bytes: &[u8]) {
    let needed = bytes.len() as u64;
    if needed > buffer.size() {
        *buffer = vertex_buffer(device, needed.next_power_of_two());
    }
    if needed > 0 {
        queue.write_buffer(buffer, 0, bytes);
    }
}

/// Kept here so that sizes in the shader and on the host are defined once.
const _: () = assert!(size_of::<Instance>() == 80 && size_of::<Segment>() == 96);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_one_two_five() {
        for (wish, cell) in [(0.03, 0.05), (0.2, 0.2), (0.21, 0.5), (7.0, 10.0), (1.0, 1.0)] {
            assert!((cell_size(wish) / cell - 1.0).abs() < 1e-3, "{wish} {}", cell_size(wish));
        }
    }

    #[test]
    fn the_light_holds_its_ball() {
        for sun in [SUN.normalize(), Vec3::Z, Vec3::X] {
            let centre = Vec3::new(3.0, -1.0, 0.7);
            let (m, _) = light_box(sun, centre, 0.4, 1024);
            for d in [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::NEG_Z] {
                let p = m.project_point3(centre + d * 0.4);
                assert!(p.x.abs() <= 1.0 && p.y.abs() <= 1.0 && (0.0..=1.0).contains(&p.z), "{p}");
            }
        }
    }
}
