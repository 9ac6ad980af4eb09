//! All weights in one flat buffer, with named views; the names are those of the checkpoint.
//!
//! Weights of a linear map are stored as (inputs, outputs), row-major, since every product is `x ·
//! W`; `PyTorch` stores the transpose.

use std::ops::Range;

use super::Error;
use super::config::{MOST_WEIGHTS, Mixing, NetConfig, SkipKind, WINDOW};
use robert_base::rng::{Rng, Stream};
use robert_linalg::{Aligned, Real};

/// One tensor inside the flat buffer.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    /// Name in the checkpoint, such as `layers.0.qkv.weight`.
    pub name: String,
    /// Rows and columns, or the length alone.
    pub shape: Vec<usize>,
    /// Its place in the buffer.
    pub range: Range<usize>,
    /// Whether weight decay applies (weights of linear maps only).
    pub decays: bool,
}

/// Places of one layer's tensors; those of attention are empty without attention.
#[derive(Clone, Debug)]
#[allow(missing_docs)]
pub struct LayerAt {
    pub ln1_weight: Range<usize>,
    pub ln1_bias: Range<usize>,
    pub qkv_weight: Range<usize>,
    pub qkv_bias: Range<usize>,
    pub out_weight: Range<usize>,
    pub out_bias: Range<usize>,
    pub ln2_weight: Range<usize>,
    pub ln2_bias: Range<usize>,
    pub up_weight: Range<usize>,
    pub up_bias: Range<usize>,
    pub down_weight: Range<usize>,
    pub down_bias: Range<usize>,
}

/// The layout of all weights.
#[derive(Clone, Debug)]
#[allow(missing_docs)]
pub struct Layout {
    pub tensors: Vec<Tensor>,
    pub len: usize,
    pub embed_weight: Range<usize>,
    pub embed_bias: Range<usize>,
    pub position: Range<usize>,
    pub mask: Range<usize>,
    pub layers: Vec<LayerAt>,
    pub norm_weight: Range<usize>,
    pub norm_bias: Range<usize>,
    pub head_weight: Range<usize>,
    pub head_bias: Range<usize>,
}

/// Tensors start at a cache line, so that their rows of 16 numbers do too.
const STEP: usize = 16;

impl Layout {
    /// The layout of this network.
    pub fn new(cfg: &NetConfig) -> Self {
        let mut tensors = Vec::new();
        let mut len = 0;
        let mut put = |name: String, shape: &[usize], decays: bool| {
            let n: usize = shape.iter().product();
            let range = len..len + n;
            len = (len + n).next_multiple_of(STEP);
            tensors.push(Tensor { name, shape: shape.to_vec(), range: range.clone(), decays });
            range
        };
        let d = cfg.width;
        let embed_weight = put("embed.weight".into(), &[cfg.inputs, d], true);
        let embed_bias = put("embed.bias".into(), &[d], false);
        let position = put("position".into(), &[WINDOW, d], false);
        let mask = put("mask".into(), &[d], false);
        let mut layers = Vec::with_capacity(cfg.layers);
        for i in 0..cfg.layers {
            let mut at = |name: &str, shape: &[usize], decays| {
                put(format!("layers.{i}.{name}"), shape, decays)
            };
            let attends = cfg.mixing == Mixing::Attention;
            let mut mix = |name: &str, shape: &[usize], decays| {
                if attends { at(name, shape, decays) } else { 0..0 }
            };
            layers.push(LayerAt {
                ln1_weight: mix("ln1.weight", &[d], false),
                ln1_bias: mix("ln1.bias", &[d], false),
                qkv_weight: mix("qkv.weight", &[d, 3 * d], true),
                qkv_bias: mix("qkv.bias", &[3 * d], false),
                out_weight: mix("out.weight", &[d, d], true),
                out_bias: mix("out.bias", &[d], false),
                ln2_weight: at("ln2.weight", &[d], false),
                ln2_bias: at("ln2.bias", &[d], false),
                up_weight: at("up.weight", &[d, 4 * d], true),
                up_bias: at("up.bias", &[4 * d], false),
                down_weight: at("down.weight", &[4 * d, d], true),
                down_bias: at("down.bias", &[d], false),
            });
        }
        let norm_weight = put("norm.weight".into(), &[d], false);
        let norm_bias = put("norm.bias".into(), &[d], false);
        let head_weight = put("head.weight".into(), &[d, cfg.outputs()], true);
        let head_bias = put("head.bias".into(), &[cfg.outputs()], false);
        Layout {
            tensors,
            len,
            embed_weight,
            embed_bias,
            position,
            mask,
            layers,
            norm_weight,
            norm_bias,
            head_weight,
            head_bias,
        }
    }

    /// Number of learned numbers, without padding.
    pub fn count(&self) -> usize {
        self.tensors.iter().map(|t| t.range.len()).sum()
    }

    /// Initial weights: N(0, 0.02), zero biases, norms of 1. The head of a network with a skip
    /// starts at zero, so that the network starts as the linear prediction alone.
    pub fn init<T: Real>(&self, cfg: &NetConfig, seed: u64) -> Aligned<T> {
        let mut w = Aligned::zeros(self.len);
        for (index, tensor) in self.tensors.iter().enumerate() {
            let to = &mut w[tensor.range.clone()];
            let norm = tensor.name.ends_with("ln1.weight")
                || tensor.name.ends_with("ln2.weight")
                || tensor.name == "norm.weight";
            let silent = tensor.name == "head.weight" && cfg.skip != SkipKind::Off;
            if norm {
                to.fill(T::of(1.0));
            } else if !tensor.name.ends_with("bias") && !silent {
                let mut rng = Rng::new(seed, Stream::Init, index as u64);
                for w in to {
                    *w = T::of(0.02 * rng.normal());
                }
            }
        }
        w
    }
}

impl NetConfig {
    /// Refuses invalid sizes.
    ///
    /// # Errors
    /// [`Error::Config`] naming the field.
    pub fn check(&self) -> Result<(), Error> {
        self.check_sizes()?;
        // Valid sizes keep the sum far below 64 bits.
        let count = Layout::new(self).count();
        if count > MOST_WEIGHTS {
            let (layers, width) = (self.layers, self.width);
            let why = format!(
                "{width} with {layers} layers makes {count} weights, more than {MOST_WEIGHTS}"
            );
            return Err(Error::Config { field: "width", why });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn count(layers: usize, width: usize, inputs: usize, actions: usize) -> usize {
        let cfg = NetConfig {
            layers,
            width,
            heads: 4,
            inputs,
            actions,
            bins: 10,
            offset_weight: 10.0,
            mask_replaces: true,
            skip: SkipKind::Off,
            mixing: Mixing::Attention,
            dead_zone: 0.0,
        };
        Layout::new(&cfg).count()
    }

    #[test]
    fn parameter_counts_are_the_papers() {
        assert_eq!(count(6, 768, 5, 5), 42_619_452, "UR5e");
        assert_eq!(count(6, 768, 22, 18), 42_732_478, "Shadow Hand");
        assert_eq!(count(2, 64, 2, 2), 105_566, "Pointmass, smallest");
        assert_eq!(count(4, 1024, 2, 2), 50_474_014, "Pointmass, largest");
    }

    #[test]
    fn names_are_unique_and_ranges_disjoint() {
        let cfg = NetConfig {
            layers: 3,
            width: 32,
            heads: 2,
            inputs: 7,
            actions: 3,
            bins: 1,
            offset_weight: 1.0,
            mask_replaces: false,
            skip: SkipKind::Gated,
            mixing: Mixing::Attention,
            dead_zone: 0.0,
        };
        let layout = Layout::new(&cfg);
        let names: std::collections::BTreeSet<_> = layout.tensors.iter().map(|t| &t.name).collect();
        assert_eq!(names.len(), layout.tensors.len());
        assert!(layout.tensors.windows(2).all(|w| w[0].range.end <= w[1].range.start));
        assert_eq!(layout.tensors.last().unwrap().shape, [7]);
    }
}
