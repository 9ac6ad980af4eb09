//! The settings of a network: sizes, token variant, head. They are saved in every checkpoint.

use serde::{Deserialize, Serialize};

use super::Error;

/// The most learned numbers of a network. A checkpoint contains each four times (weight, two
/// moments, average) and must stay below [`robert_base::limits::TENSOR_FILE_BYTES`].
pub const MOST_WEIGHTS: usize = 250_000_000;

/// Frames before the current one that the network sees.
pub const HISTORY: usize = 30;
/// Commanded frames after the current one.
pub const COMMAND: usize = 20;
/// Tokens in a window: history, current, command.
pub const WINDOW: usize = HISTORY + 1 + COMMAND;
/// Index of the current frame, whose action is applied.
pub const CURRENT: usize = HISTORY;

/// The way in which a frame becomes a token (algorithm of `RoBERT`; `pos` is the paper's).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum TokenKind {
    /// Normalised joint positions; the mask vector replaces a masked frame's embedding.
    #[serde(rename = "pos")]
    Pos,
    /// Positions, centred positions and differences; the mask vector replaces the embedding of a
    /// masked frame.
    #[serde(rename = "pos+d")]
    PosD,
    /// The features of `pos+d`, with masked frames interpolated; the mask vector is added.
    #[serde(rename = "fill")]
    Fill,
    /// Goal velocity, time to the goal, distances to stops, hinge angles; the mask vector is added.
    #[default]
    #[serde(rename = "goal")]
    Goal,
}

/// Whether a mask hides whole frames or single joints.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[derive(schemars::JsonSchema)]
pub enum MaskGranularity {
    /// Whole frames, as in the paper.
    #[default]
    State,
    /// Single joints; the token has one flag per joint.
    Joint,
}

/// The linear prediction beside the network.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SkipKind {
    /// None: the paper's network.
    #[default]
    Off,
    /// action = W x + r.
    Additive,
    /// action = (1 + g) W x + r, the gate g from the network.
    Gated,
}

/// The operation that passes information between frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mixing {
    /// Softmax attention over the window: the transformer.
    #[default]
    Attention,
    /// No operation: each frame passes through the same feed-forward layers alone. Comparing both
    /// shows what attention contributes.
    None,
}

/// Sizes of a network.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetConfig {
    /// Transformer layers.
    pub layers: usize,
    /// Width d of a token, a multiple of 16.
    pub width: usize,
    /// Attention heads; they divide the width.
    pub heads: usize,
    /// Numbers in a token before the embedding.
    pub inputs: usize,
    /// Actuators.
    pub actions: usize,
    /// Action bins K of the head; 1 is plain regression.
    pub bins: usize,
    /// Factor λ of the offset loss when K > 1.
    pub offset_weight: f64,
    /// Whether the mask vector replaces the embedding (`pos`, `pos+d`) or is added.
    pub mask_replaces: bool,
    /// The linear prediction beside the network; needs K = 1.
    pub skip: SkipKind,
    /// The operation that passes information between frames.
    #[serde(default)]
    pub mixing: Mixing,
    /// Corrections c of the linear prediction up to this size z are ignored at inference: c max(0,
    /// 1 - (z/c)^2), the garrote of Breiman (1995), which leaves large corrections nearly
    /// unchanged. Training does not use it. 0 without a skip.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub dead_zone: f64,
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde asks so")]
fn is_zero(x: &f64) -> bool {
    *x == 0.0
}

impl NetConfig {
    /// Outputs of the head per token: K logits, K offsets of A, gates.
    pub fn outputs(&self) -> usize {
        self.bins * (1 + self.actions) + if self.skip == SkipKind::Gated { self.actions } else { 0 }
    }

    /// Refuses invalid sizes, regardless of the total; [`NetConfig::check`] does the rest.
    ///
    /// # Errors
    /// [`Error::Config`] naming the field.
    pub(super) fn check_sizes(&self) -> Result<(), Error> {
        let refuse = |field, why: String| Err(Error::Config { field, why });
        let within = |field, x: usize, max: usize| {
            if (1..=max).contains(&x) {
                return Ok(());
            }
            Err(Error::Config { field, why: format!("{x} is not in 1..={max}") })
        };
        within("layers", self.layers, 64)?;
        within("width", self.width, 8192)?;
        within("heads", self.heads, self.width)?;
        within("inputs", self.inputs, 16_384)?;
        within("actions", self.actions, robert_base::limits::JOINTS)?;
        within("bins", self.bins, 96)?;
        if !self.width.is_multiple_of(16) {
            return refuse("width", format!("{} is not a multiple of 16", self.width));
        }
        if !self.width.is_multiple_of(self.heads) {
            return refuse("heads", format!("{} do not divide width {}", self.heads, self.width));
        }
        if self.skip != SkipKind::Off && self.bins != 1 {
            return refuse("skip", format!("the linear skip needs 1 bin, not {}", self.bins));
        }
        if !(0.0..=0.5).contains(&self.dead_zone) {
            return refuse("dead_zone", format!("{} is not in 0..=0.5", self.dead_zone));
        }
        if self.dead_zone > 0.0 && self.skip == SkipKind::Off {
            return refuse("dead_zone", "there is no linear skip to fall back to".to_owned());
        }
        if !(self.offset_weight.is_finite() && self.offset_weight > 0.0) {
            return refuse("offset_weight", format!("{} is not positive", self.offset_weight));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn networks_that_no_file_could_hold_are_refused() {
        let cfg = NetConfig {
            layers: 6,
            width: 768,
            heads: 6,
            inputs: 22,
            actions: 18,
            bins: 10,
            offset_weight: 10.0,
            mask_replaces: true,
            skip: SkipKind::Off,
            mixing: Mixing::Attention,
            dead_zone: 0.0,
        };
        cfg.check().unwrap();
        NetConfig { layers: 34, ..cfg.clone() }.check().unwrap();
        for (layers, width) in [(36, 768), (64, 8192), (1, 8192)] {
            let e = NetConfig { layers, width, heads: 8, ..cfg.clone() }.check().unwrap_err();
            let e = e.to_string();
            assert!(e.contains("width") && e.contains(&format!("{layers} layers")), "{e}");
        }
        const { assert!(16 * (MOST_WEIGHTS as u64) < robert_base::limits::TENSOR_FILE_BYTES) };
    }
}
