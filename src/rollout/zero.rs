//! No torque at all: the lower bound of every comparison.

use super::error::Error;
use super::policy::{Policy, View};

/// Applies nothing.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Zero;

impl Policy for Zero {
    fn name(&self) -> String {
        "zero".into()
    }

    fn reset(&mut self, _seed: u64) {}

    fn act(&mut self, _view: &View<'_>, action: &mut [f64]) -> Result<(), Error> {
        action.fill(0.0);
        Ok(())
    }
}
