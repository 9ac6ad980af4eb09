//! `robert`: a trained network. It sees only the window, and its own past actions.

use super::error::Error;
use super::model_frames::Frames;
use super::policy::{Policy, View};
use robert_net::forward::Forwards;
use robert_net::{self as net, Model};

/// A trained network.
#[derive(Clone, Debug)]
pub struct Learned {
    policy: net::NetPolicy,
    frames: Frames,
    card: Option<String>,
}

impl Learned {
    /// Whether a device computes; see [`Policy::on`].
    pub fn is_on_device(&self) -> bool {
        self.policy.is_on_device()
    }

    /// The network of a model.
    ///
    /// # Errors
    /// [`Error::Model`].
    pub fn new(model: Model, options: net::NetPolicyConfig) -> Result<Self, Error> {
        let frames = Frames::new(&model.encoder, model.card.reach.as_ref());
        let card = serde_json::to_string_pretty(&model.card).ok();
        Ok(Learned {
            policy: net::NetPolicy::new(model.net, model.encoder, options)?,
            frames,
            card,
        })
    }

    /// Leaves masked frames to the network, even if the model contains data to fill gaps.
    #[must_use]
    pub fn with_masks(mut self, masks: bool) -> Self {
        self.frames.masks = masks;
        self
    }

    /// Shows the network a single goal of each window; see [`super::inference::Inference::ahead`].
    #[must_use]
    pub fn with_ahead(mut self, ahead: usize) -> Self {
        self.frames.ahead = ahead;
        self
    }
}

impl Policy for Learned {
    fn name(&self) -> String {
        "robert".to_owned()
    }

    fn sees_plan(&self) -> bool {
        self.frames.sees_plan()
    }

    fn card(&self) -> Option<String> {
        self.card.clone()
    }

    fn reset(&mut self, seed: u64) {
        self.policy.reset(seed);
    }

    fn act(&mut self, view: &View<'_>, action: &mut [f64]) -> Result<(), Error> {
        self.frames.fill(view.window);
        let found = self.policy.act(&self.frames.q, &self.frames.visible, view.frame as u64);
        for (to, &x) in action.iter_mut().zip(found) {
            *to = f64::from(x);
        }
        Ok(())
    }

    fn applied(&mut self, action: &[f64]) {
        self.policy.applied(action);
    }

    fn on(&mut self, device: &dyn Forwards) {
        self.policy.on(device);
    }

    fn fork(&self) -> Option<Box<dyn Policy>> {
        Some(Box::new(self.clone()))
    }

    fn memory(&self) -> Vec<f64> {
        self.policy.memory()
    }

    fn recall(&mut self, memory: &[f64]) {
        self.policy.recall(memory);
    }
}

#[cfg(test)]
mod tests;
