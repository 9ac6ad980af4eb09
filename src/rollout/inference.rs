//! The use of a trained network.

use robert_net::{Model, NetPolicyConfig, Threads};

use super::error::Error;
use super::learned::Learned;

/// How a trained network is used. Other policies ignore it, except that `ridge` has `gain` and
/// `observer`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Inference {
    /// Windows whose predictions for the current frame are averaged; 1 is off, 21 at most.
    pub ensemble: usize,
    /// Draw the action bin (as in the paper) instead of using the most likely one.
    pub sample: bool,
    /// Take the mean of all action bins, weighted by how likely each is; not with `sample`.
    pub mean: bool,
    /// Leave masked frames to the network, even if its file contains data to fill gaps.
    pub masks: bool,
    /// Show a single goal of each window: the one this many frames ahead, 1 to 20, or the next visible one, or the
    /// last. 0 shows all. The paper's curriculum ends with one visible frame a window, and a network that saw
    /// no others for long acts worse on the many goals of a dense command.
    pub ahead: usize,
    /// Scale the linear prediction by the ratio of applied to predicted actions in the past; for
    /// `ridge`.
    pub gain: bool,
    /// Percent that the newest frame counts in the disturbance that is added to each action, as in
    /// [`robert_net::observer`]; for `ridge`, too. `None` is what the model's file says.
    pub observer: Option<u8>,
    /// Threads that share one window; the action is the same to the last bit.
    pub threads: Threads,
}

impl Default for Inference {
    fn default() -> Self {
        Inference {
            ensemble: 1,
            sample: false,
            mean: false,
            masks: false,
            ahead: 0,
            gain: false,
            observer: None,
            threads: Threads::One,
        }
    }
}

impl Inference {
    /// The network of a model, used in this way.
    ///
    /// # Errors
    /// [`Error::Model`].
    pub fn network(self, model: Model) -> Result<Learned, Error> {
        let observer = self.observer.unwrap_or(model.card.observer);
        model.card.may_observe(observer)?;
        let options = NetPolicyConfig {
            ensemble: self.ensemble,
            sample_bins: self.sample,
            mean_bins: self.mean,
            observer,
            threads: self.threads,
            ..NetPolicyConfig::default()
        };
        Ok(Learned::new(model, options)?.with_masks(self.masks).with_ahead(self.ahead))
    }
}
