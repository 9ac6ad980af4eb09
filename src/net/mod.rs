//! The network: masked action-inverse inference.

pub mod mat;
pub mod real;
