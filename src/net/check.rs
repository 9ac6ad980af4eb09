//! Tests: gradients against finite differences in f64 for every kind of parameter and every
//! variant, and equal bits for all thread counts.

use super::batch::Batch;
use super::config::{Mixing, NetConfig, SkipKind, WINDOW};
use super::model::Net;
use super::step::{AdamConfig, Learner};
use robert_base::rng::{Rng, Stream};
use robert_linalg::Real;

fn config(bins: usize, skip: SkipKind, mask_replaces: bool) -> NetConfig {
    NetConfig {
        layers: 2,
        width: 32,
        heads: 2,
        inputs: 5,
        actions: 3,
        bins,
        offset_weight: 10.0,
        mask_replaces,
        skip,
        mixing: Mixing::Attention,
        dead_zone: 0.0,
    }
}

/// Window w: a pure function of its number.
fn window<T: Real>(w: usize, slot: usize, batch: &mut Batch<T>) {
    let mut rng = Rng::new(7, Stream::Test, w as u64);
    let mut fill = |x: &mut [T], scale: f64| {
        x.iter_mut().for_each(|x| *x = T::of(scale * rng.normal()));
    };
    let part = |len: usize, slots: usize| len / slots * slot..len / slots * (slot + 1);
    let slots = batch.masked.len() / WINDOW;
    let r = part(batch.tokens.len(), slots);
    fill(&mut batch.tokens[r], 1.0);
    let r = part(batch.actions.len(), slots);
    fill(&mut batch.actions[r], 0.5);
    let r = part(batch.linear.len(), slots);
    fill(&mut batch.linear[r], 0.5);
    for i in 0..WINDOW {
        batch.masked[slot * WINDOW + i] = i > 30 && rng.uniform() < 0.5;
        batch.weight[slot * WINDOW + i] = T::of(0.5 + rng.uniform());
    }
}

fn learner<T: Real>(cfg: &NetConfig, batch: usize, threads: usize, spread: f64) -> Learner<T> {
    let mut rng = Rng::new(3, Stream::Test, 0);
    let centres = (0..cfg.bins * cfg.actions).map(|_| T::of(0.4 * rng.normal())).collect();
    let mut net = Net::<T>::init(cfg.clone(), Some(centres), 1).unwrap();
    for tensor in net.layout.tensors.clone() {
        for w in &mut net.weights[tensor.range] {
            *w += T::of(spread * rng.normal());
        }
    }
    Learner::new(net, AdamConfig::default(), batch, threads)
}

#[test]
fn gradients_agree_with_finite_differences() {
    let variants = [
        (config(1, SkipKind::Off, true), false),
        (config(1, SkipKind::Off, false), true),
        (config(1, SkipKind::Additive, false), false),
        (config(1, SkipKind::Gated, false), false),
        (config(1, SkipKind::Gated, true), true),
        (config(4, SkipKind::Off, true), false),
        (config(4, SkipKind::Off, false), false),
        (NetConfig { mixing: Mixing::None, ..config(1, SkipKind::Gated, false) }, false),
    ];
    for (cfg, current_only) in variants {
        let mut learner = learner::<f64>(&cfg, 3, 1, 0.15);
        learner.current_only = current_only;
        learner.evaluate(&window);
        let exact = learner.gradient().to_vec();
        let mut rng = Rng::new(5, Stream::Test, 9);
        for tensor in learner.net.layout.tensors.clone() {
            let scale = exact[tensor.range.clone()].iter().fold(0.0_f64, |m, g| m.max(g.abs()));
            // The logit of a single bin has no gradient; everything else must have one.
            assert!(scale > 1e-7, "{} gets no gradient: {cfg:?}", tensor.name);
            for _ in 0..5 {
                let i = tensor.range.start + rng.below(tensor.range.len() as u64) as usize;
                let (eps, kept) = (1e-4, learner.net.weights[i]);
                let mut at = |x: f64| {
                    learner.net.weights[i] = kept + x;
                    learner.weights_changed();
                    learner.gradients(&window).loss
                };
                let near = (at(eps) - at(-eps)) / (2.0 * eps);
                let far = (at(2.0 * eps) - at(-2.0 * eps)) / (4.0 * eps);
                at(0.0);
                let numeric = (4.0 * near - far) / 3.0;
                assert!(
                    (numeric - exact[i]).abs() <= 1e-5 * exact[i].abs().max(1e-2 * scale),
                    "{} [{}]: {numeric} numeric, {} exact, {cfg:?}",
                    tensor.name,
                    i - tensor.range.start,
                    exact[i]
                );
            }
        }
    }
}

#[test]
fn f32_follows_f64() {
    let cfg = config(4, SkipKind::Off, false);
    let (mut single, mut double) =
        (learner::<f32>(&cfg, 5, 1, 0.1), learner::<f64>(&cfg, 5, 1, 0.1));
    let (a, b) = (single.evaluate(&window), double.evaluate(&window));
    assert!((a.loss / b.loss - 1.0).abs() < 1e-5);
    for tensor in &double.net.layout.tensors {
        let range = tensor.range.clone();
        let (x, y) = (&single.gradient()[range.clone()], &double.gradient()[range]);
        let norm = y.iter().map(|y| y * y).sum::<f64>().sqrt();
        let off = x.iter().zip(y).map(|(&x, y)| (f64::from(x) - y).powi(2)).sum::<f64>().sqrt();
        assert!(off <= 1e-5 * norm, "{}: {off} of {norm}", tensor.name);
    }
}

#[test]
fn bits_do_not_depend_on_threads() {
    let run = |threads| {
        let cfg = config(1, SkipKind::Gated, false);
        let mut learner = learner::<f32>(&cfg, 70, threads, 0.0);
        for step in 0..3 {
            let fill = |w: usize, slot: usize, batch: &mut Batch<f32>| {
                window(1000 * step + w, slot, batch);
            };
            assert!(learner.step(1e-3, &fill).applied);
        }
        learner.net.weights.to_vec()
    };
    let one = run(1);
    assert_eq!(one, run(2));
    assert_eq!(one, run(3));
}

#[test]
fn learns_a_function_of_the_tokens() {
    let cfg = config(1, SkipKind::Off, false);
    let mut learner = learner::<f32>(&cfg, 32, 2, 0.0);
    let fill = |w: usize, slot: usize, batch: &mut Batch<f32>| {
        window(w % 64, slot, batch);
        for i in 0..WINDOW {
            let row = slot * WINDOW + i;
            for j in 0..3 {
                batch.actions[row * 3 + j] = batch.tokens[row * 5 + j].tanh();
            }
        }
    };
    let first = learner.gradients(&fill).loss;
    let mut last = first;
    for _ in 0..150 {
        last = learner.step(3e-3, &fill).sums.loss;
    }
    assert!(last < 0.1 * first, "{first} -> {last}");
}

#[test]
fn a_gradient_that_is_not_finite_changes_nothing() {
    let cfg = config(1, SkipKind::Off, false);
    let mut learner = learner::<f32>(&cfg, 4, 1, 0.0);
    let before = learner.net.weights.to_vec();
    let fill = |w: usize, slot: usize, batch: &mut Batch<f32>| {
        window(w, slot, batch);
        if w == 2 {
            batch.tokens[slot * WINDOW * 5] = f32::NAN;
        }
    };
    assert!(!learner.step(1e-3, &fill).applied);
    assert_eq!(before, learner.net.weights.to_vec());
    assert_eq!(learner.count, 0);
}
