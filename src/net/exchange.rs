//! Worked examples for other implementations: weights, a batch, the loss and every gradient in f64,
//! in one file per variant of the network. `benches/peers/reference.py` computes the same in
//! `PyTorch`.

use std::collections::BTreeMap;
use std::path::Path;

use super::batch::Batch;
use super::config::{Mixing, NetConfig, SkipKind, WINDOW};
use super::model::Net;
use super::step::{AdamConfig, Learner};
use super::tensors::{self, Out};
use super::{Error, mask::MaskKind, mask::past_is_visible};
use robert_base::rng::{Rng, Stream};
use robert_linalg::Real;

/// Windows in the example.
const WINDOWS: usize = 3;

/// The variants, by name: sizes and whether only the current frame counts.
pub fn variants() -> Vec<(String, NetConfig, bool)> {
    let base = NetConfig {
        layers: 2,
        width: 64,
        heads: 4,
        inputs: 9,
        actions: 3,
        bins: 1,
        offset_weight: 10.0,
        mask_replaces: true,
        skip: SkipKind::Off,
        mixing: Mixing::Attention,
        dead_zone: 0.0,
    };
    let mut all = Vec::new();
    for (bins, skip) in
        [(1, SkipKind::Off), (10, SkipKind::Off), (1, SkipKind::Additive), (1, SkipKind::Gated)]
    {
        for mask_replaces in [true, false] {
            for current in [false, true] {
                let name = format!(
                    "k{bins}-skip_{skip:?}-{}-{}",
                    if mask_replaces { "replace" } else { "add" },
                    if current { "current" } else { "all" }
                )
                .to_lowercase();
                all.push((name, NetConfig { bins, mask_replaces, skip, ..base.clone() }, current));
            }
        }
    }
    let alone = NetConfig { mixing: Mixing::None, skip: SkipKind::Gated, ..base };
    all.push(("k1-skip_gated-replace-all-alone".to_owned(), alone, false));
    all
}

/// Writes one variant's example, all numbers drawn from `seed`.
///
/// # Errors
/// [`Error::Config`], [`Error::Files`].
pub fn write(path: &Path, cfg: &NetConfig, current_only: bool, seed: u64) -> Result<(), Error> {
    let mut rng = Rng::new(seed, Stream::Test, 0);
    let mut normal =
        |n: usize, scale: f64| -> Vec<f64> { (0..n).map(|_| scale * rng.normal()).collect() };
    let centres = normal(cfg.bins * cfg.actions, 0.4);
    let mut net = Net::<f64>::init(cfg.clone(), Some(centres.clone()), seed)?;
    let shift = normal(net.weights.len(), 0.1);
    for t in &net.layout.tensors {
        for i in t.range.clone() {
            net.weights[i] += shift[i];
        }
    }
    let mut batch = Batch::<f64>::zeros(cfg, WINDOWS);
    batch.tokens.copy_from_slice(&normal(WINDOWS * WINDOW * cfg.inputs, 1.0));
    batch.actions = normal(WINDOWS * WINDOW * cfg.actions, 0.5);
    batch.linear = normal(batch.linear.len(), 0.5);
    batch.weight = normal(WINDOWS * WINDOW, 0.3).iter().map(|x| x.exp()).collect();
    let mut visible = vec![true; WINDOW];
    for (w, masked) in batch.masked.chunks_exact_mut(WINDOW).enumerate() {
        let mut rng = Rng::new(seed, Stream::Mask, w as u64);
        MaskKind::ClUniform.draw(1.0, super::MaskGranularity::State, 1, &mut rng, &mut visible);
        debug_assert!(past_is_visible(&visible, 1));
        masked.iter_mut().zip(&visible).for_each(|(m, v)| *m = !v);
    }

    let mut learner = Learner::new(net.clone(), AdamConfig::default(), WINDOWS, 1);
    learner.current_only = current_only;
    let fill = |w: usize, slot: usize, to: &mut Batch<f64>| copy_window(&batch, w, to, slot);
    let sums = learner.evaluate(&fill);

    let hidden: Vec<f64> = batch.masked.iter().map(|&m| f64::from(u8::from(m))).collect();
    let loss = [sums.loss];
    let mut all = BTreeMap::new();
    for t in &net.layout.tensors {
        let part = t.range.clone();
        all.insert(format!("weight.{}", t.name), Out::new(&t.shape, &net.weights[part.clone()]));
        all.insert(format!("grad.{}", t.name), Out::new(&t.shape, &learner.gradient()[part]));
    }
    let rows = [WINDOWS, WINDOW];
    let with = |last: usize| [WINDOWS, WINDOW, last];
    all.insert("tokens".into(), Out::new(&with(cfg.inputs), &batch.tokens[..]));
    all.insert("actions".into(), Out::new(&with(cfg.actions), &batch.actions));
    if cfg.skip != SkipKind::Off {
        all.insert("linear".into(), Out::new(&with(cfg.actions), &batch.linear));
    }
    all.insert("masked".into(), Out::new(&rows, &hidden));
    all.insert("token_weight".into(), Out::new(&rows, &batch.weight));
    all.insert("centres".into(), Out::new(&[cfg.bins, cfg.actions], &centres));
    all.insert("loss".into(), Out::new(&[1], &loss));
    let failed = |e: serde_json::Error| Error::File { why: e.to_string(), path: path.to_owned() };
    let settings = serde_json::json!({"net": cfg, "current_only": current_only});
    let metadata = BTreeMap::from([("exchange".to_owned(), settings.to_string())]);
    let bytes = tensors::serialise(&all, &metadata).map_err(failed)?;
    Ok(robert_base::fsio::write_atomic(path, &bytes)?)
}

/// Copies window `w` of one batch into a slot of another.
pub fn copy_window<T: Real>(from: &Batch<T>, w: usize, to: &mut Batch<T>, slot: usize) {
    fn part<T: Copy>(from: &[T], to: &mut [T], n: usize, w: usize, slot: usize) {
        to[slot * n..(slot + 1) * n].copy_from_slice(&from[w * n..(w + 1) * n]);
    }
    let each = |len: usize| len / from.count.max(1);
    part(&from.tokens, &mut to.tokens, each(from.tokens.len()), w, slot);
    part(&from.actions, &mut to.actions, each(from.actions.len()), w, slot);
    part(&from.linear, &mut to.linear, each(from.linear.len()), w, slot);
    part(&from.masked, &mut to.masked, WINDOW, w, slot);
    part(&from.weight, &mut to.weight, WINDOW, w, slot);
}
