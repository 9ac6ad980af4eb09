//! Training and evaluation on a graphics card by compute shaders (`wgpu`, WGSL).
//!
//! [`GpuEngine`] does on the card what [`robert_net::CpuEngine`] does on the processor: the whole
//! step from tokens to new weights, in single precision. [`adapter`] lists the cards, `device`
//! opens one, each kernel has a file beside its WGSL, and `plan` records the dispatches of a step
//! once. [`GpuForwards`] computes the windows of an evaluation's rollouts together. Sums run in
//! fixed trees and there are no float atomics, so that a run has the same bits on the same adapter.
//!
//! A *factor* is an operand of a matrix product. Factors have 32 bits, or 16 with
//! [`Arithmetic::Half`], which uses a card's matrix units; sums always have 32.

mod adam;
pub mod adapter;
mod attend;
mod columns;
mod device;
mod engine;
mod error;
mod forward;
mod head;
mod host;
mod kernel;
mod norm;
mod place;
mod plan;
mod product;
mod round;
mod slots;
mod squares;
#[cfg(test)]
mod tests;
mod trusted;
mod units;

pub use adapter::{Arithmetic, Card, Choice, Request, cards};
pub use device::{Device, Room};
pub use engine::GpuEngine;
pub use error::Error;
pub use forward::GpuForwards;
