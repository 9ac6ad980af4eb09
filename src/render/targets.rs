//! The textures that a frame is drawn into, and the buffer from which it is read.

use super::gpu::{COLOR, DEPTH, Gpu, Pipelines};
use super::{Error, Picture};

/// Time limit of the driver for one frame, seconds.
const FRAME_SECS: u64 = 120;

#[derive(Debug)]
pub(super) struct Targets {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) objects: wgpu::TextureView,
    pub(super) depth: wgpu::TextureView,
    pub(super) compose: wgpu::BindGroup,
    /// Sky and floor with and without sun.
    pub(super) lit: wgpu::Texture,
    pub(super) backdrops: [wgpu::TextureView; 2],
    pub(super) picture: wgpu::Texture,
    pub(super) picture_view: wgpu::TextureView,
    readback: wgpu::Buffer,
    pitch: u32,
}

impl Targets {
    /// Targets for pictures of this size.
    pub(super) fn new(gpu: &Gpu, pipelines: &Pipelines, width: u32, height: u32) -> Targets {
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
            entries: &[(u32::from(samples > 1), &objects), (2, &backdrops[0]), (3, &backdrops[1])]
                .map(|(binding, view)| wgpu::BindGroupEntry {
                    binding,
                    resource: wgpu::BindingResource::TextureView(view),
                }),
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

    /// Copies the picture into the buffer that the processor can read.
    pub(super) fn copy_picture(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.copy_texture_to_buffer(
            self.picture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &self.readback,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(self.pitch),
                    rows_per_image: None,
                },
            },
            wgpu::Extent3d { width: self.width, height: self.height, depth_or_array_layers: 1 },
        );
    }

    /// The picture that was copied last.
    pub(super) fn read_back(&self, gpu: &Gpu) -> Result<Picture, Error> {
        let slice = self.readback.slice(..);
        let (send, receive) = std::sync::mpsc::sync_channel(1);
        slice.map_async(wgpu::MapMode::Read, move |r| {
            send.send(r).ok();
        });
        let wait = wgpu::PollType::Wait {
            submission_index: None,
            timeout: Some(std::time::Duration::from_secs(FRAME_SECS)),
        };
        gpu.device.poll(wait).map_err(|e| gpu.error(&e))?;
        match receive.try_recv() {
            Ok(Ok(())) => {}
            Ok(Err(e)) => return Err(gpu.error(&e)),
            Err(e) => return Err(gpu.error(&e)),
        }
        let mapped = slice.get_mapped_range().map_err(|e| gpu.error(&e))?;
        let row = self.width as usize * 4;
        let mut rgba = Vec::with_capacity(row * self.height as usize);
        for line in mapped.chunks_exact(self.pitch as usize).take(self.height as usize) {
            rgba.extend_from_slice(&line[..row]);
        }
        drop(mapped);
        self.readback.unmap();
        Ok(Picture { width: self.width, height: self.height, rgba })
    }
}

/// A texture that is drawn into.
pub(super) fn texture(
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
