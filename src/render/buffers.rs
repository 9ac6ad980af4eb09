//! Buffers on the device: meshes, and what changes with every frame.

use wgpu::util::DeviceExt;

use super::prims::Triangles;

/// A mesh on the device.
#[derive(Debug)]
pub(super) struct GpuMesh {
    pub(super) vertices: wgpu::Buffer,
    pub(super) indices: wgpu::Buffer,
    pub(super) count: u32,
}

impl GpuMesh {
    /// Copies triangles to the device.
    pub(super) fn new(device: &wgpu::Device, t: &Triangles) -> GpuMesh {
        let make = |label, contents, usage| {
            device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some(label),
                contents,
                usage,
            })
        };
        GpuMesh {
            vertices: make(
                "vertices",
                bytemuck::cast_slice(&t.vertices),
                wgpu::BufferUsages::VERTEX,
            ),
            indices: make("indices", bytemuck::cast_slice(&t.indices), wgpu::BufferUsages::INDEX),
            count: t.indices.len() as u32,
        }
    }
}

/// A buffer for data of one frame, which is replaced when it becomes too small.
pub(super) fn vertex_buffer(device: &wgpu::Device, bytes: u64) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("per frame"),
        size: bytes,
        usage: wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

/// Writes the data of a frame, into a larger buffer if it does not fit.
pub(super) fn put(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    buffer: &mut wgpu::Buffer,
    bytes: &[u8],
) {
    let needed = bytes.len() as u64;
    if needed > buffer.size() {
        *buffer = vertex_buffer(device, needed.next_power_of_two());
    }
    if needed > 0 {
        queue.write_buffer(buffer, 0, bytes);
    }
}
