//! Off-screen pictures with wgpu.
