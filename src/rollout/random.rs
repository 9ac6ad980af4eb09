//! A new random action in every frame: what exploration without a purpose looks like.

use super::error::Error;
use super::policy::{Policy, View};
use robert_base::rng::{Rng, Stream};

/// Draws each action uniformly from the whole range.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Random {
    seed: u64,
}

impl Policy for Random {
    fn name(&self) -> String {
        "random".into()
    }

    fn reset(&mut self, seed: u64) {
        *self = Random { seed };
    }

    fn act(&mut self, view: &View<'_>, action: &mut [f64]) -> Result<(), Error> {
        let mut rng = Rng::new(self.seed, Stream::Noise, view.frame as u64);
        action.fill_with(|| rng.range(-1.0, 1.0));
        Ok(())
    }
}
