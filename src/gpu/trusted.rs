//! What `wgpu` does only if it is trusted: matrices, which are new there, and kernels whose indices
//! are not checked.

#![allow(unsafe_code)]

/// Leave to use matrices.
pub(crate) fn matrices() -> wgpu::ExperimentalFeatures {
    // SAFETY: wgpu asks for it because there may be mistakes in its matrices. Tests compare the
    // kernels that use them with the processor's results.
    unsafe { wgpu::ExperimentalFeatures::enabled() }
}

/// Compiles a source without checks of indices, which would keep drivers from reading 16 bytes at
/// once, and from unrolling loops.
pub(crate) fn module(device: &wgpu::Device, label: &str, text: &str) -> wgpu::ShaderModule {
    let description = wgpu::ShaderModuleDescriptor {
        label: Some(label),
        source: wgpu::ShaderSource::Wgsl(text.into()),
    };
    let checks = wgpu::ShaderRuntimeChecks::unchecked();
    // SAFETY: the sources are this crate's own. Their indices stay within the buffers, whose sizes
    // come from the same configuration; the only indices that are data are bins, which `Filler`
    // writes below their number. Loops end, and no divisor is 0.
    unsafe { device.create_shader_module_trusted(description, checks) }
}
