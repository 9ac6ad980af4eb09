//! The forward pass of many rollouts on a device: an interface.
//!
//! A rollout needs one window at a time, and a graphics card is fast only with many. So the
//! rollouts of an evaluation run at the same time and ask the same [`Forward`], which computes all
//! windows that wait. `robert-gpu` implements it.

use std::ops::Range;
use std::sync::Arc;

use super::batch::Batch;
use super::model::Net;

/// A network on a device; rollouts ask it from several threads at once.
pub trait Forward: Send + Sync + std::fmt::Debug {
    /// Output of the head for these rows of the window in `window`, (rows, outputs); `None` once the
    /// device is lost.
    fn run(&self, window: &Batch<f32>, rows: Range<usize>) -> Option<Vec<f32>>;
}

/// A device that takes networks.
pub trait Forwards: Sync {
    /// The network on the device; `None` if it does not fit there.
    fn open(&self, net: &Net<f32>) -> Option<Arc<dyn Forward>>;
}
