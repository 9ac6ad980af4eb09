//! Dense linear algebra: products, elementwise kernels, threads.
//!
//! [`gemm()`] multiplies matrices (some of them on tiles: `bf16x3.rs`), [`simd`] contains the
//! elementwise functions, and [`Real`] lets both be written once for single and double precision.
//! The network (`robert-net`) and the exploration agents (`robert-explore`) use it.

mod aligned;
#[cfg(target_arch = "x86_64")]
mod amx;
#[cfg(target_arch = "x86_64")]
mod bf16x3;
mod gemm;
mod mat;
mod numerics;
mod real;
pub mod simd;
mod threads;

pub use aligned::Aligned;
pub use gemm::{Packed, gemm, gemm_packed, gemm_tiled, tiled};
pub use mat::{Init, Mat, MatMut};
pub use numerics::{arch, limit_to_avx2, numerics};
pub use real::Real;
pub use threads::{next_of, on_threads};
