//! The whole step against the processor: gradients of every variant, runs, resuming, lost devices.

use super::{close, device, narrow, random};
use crate::{Device, Error, GpuEngine, Room};
use robert_base::rng::{Rng, Stream};
use robert_net::{
    AdamConfig, Batch, CpuEngine, Engine, Mixing, Net, NetConfig, Setup, SkipKind, WINDOW,
};

pub(super) fn config(bins: usize, skip: SkipKind, mask_replaces: bool) -> NetConfig {
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

pub(super) fn setup(cfg: &NetConfig, batch: usize, spread: f32) -> Setup {
    let centres = random(cfg.bins * cfg.actions, 1).iter().map(|x| 0.4 * x).collect();
    let mut net = Net::<f32>::init(cfg.clone(), Some(centres), 1).unwrap();
    for (i, tensor) in net.layout.tensors.clone().into_iter().enumerate() {
        let noise = random(tensor.range.len(), 100 + i as u64);
        net.weights[tensor.range].iter_mut().zip(noise).for_each(|(w, x)| *w += spread * x);
    }
    let adam = AdamConfig::default();
    Setup { net, adam, batch, threads: 2, current_only: false, averages: true }
}

/// Window w of batch `index`: actions are a function of the tokens, so that something is learned.
pub(super) fn window(index: u64, w: usize, slot: usize, batch: &mut Batch<f32>) {
    let mut rng = Rng::new(7, Stream::Test, 1000 * index + w as u64);
    let slots = batch.masked.len() / WINDOW;
    let inputs = batch.tokens.len() / slots / WINDOW;
    let actions = batch.actions.len() / slots / WINDOW;
    for row in slot * WINDOW..(slot + 1) * WINDOW {
        let tokens = &mut batch.tokens[row * inputs..(row + 1) * inputs];
        tokens.iter_mut().for_each(|x| *x = rng.normal() as f32);
        for j in 0..actions {
            let told = tokens[j % inputs].tanh();
            batch.actions[row * actions + j] = told + 0.1 * rng.normal() as f32;
            if let Some(line) = batch.linear.get_mut(row * actions + j) {
                *line = 0.5 * told + 0.3 * rng.normal() as f32;
            }
        }
        batch.masked[row] = row % WINDOW > 30 && rng.uniform() < 0.5;
        batch.weight[row] = 0.5 + rng.uniform() as f32;
    }
}

/// Loss, norm and gradient of every tensor, card against processor; the largest difference.
fn compare(gpu: Device, setup: &Setup) -> f64 {
    let mut cpu = CpuEngine::new(setup.clone());
    let mut gpu = GpuEngine::new(gpu, setup).unwrap();
    let a = cpu.gradient(&window, 3, None).unwrap();
    let b = gpu.gradient(&window, 3, Some(4)).unwrap();
    let what = format!("{:?} current {}", setup.net.cfg, setup.current_only);
    assert!((b.sums.loss / a.sums.loss - 1.0).abs() < 1e-5, "{what}");
    assert!((b.grad_norm / a.grad_norm - 1.0).abs() < 1e-4, "{what}");
    for (x, y) in [(a.sums.square, b.sums.square), (a.sums.tokens, b.sums.tokens)] {
        assert!(x.iter().zip(y).all(|(x, y)| (x - y).abs() <= 1e-4 * x.abs()), "{what}");
    }
    let (want, got) = (cpu.last_gradient(), gpu.last_gradient().unwrap());
    let mut worst = 0.0_f64;
    for tensor in &setup.net.layout.tensors {
        let (want, got) = (&want[tensor.range.clone()], &got[tensor.range.clone()]);
        close(got, want, 1e-4, &format!("{} {what}", tensor.name));
        let norm = |x: &mut dyn Iterator<Item = f64>| x.map(|x| x * x).sum::<f64>().sqrt();
        let off = norm(&mut want.iter().zip(got).map(|(&w, &g)| f64::from(w) - f64::from(g)));
        let all = norm(&mut want.iter().map(|&w| f64::from(w)));
        worst = worst.max(if all > 0.0 { off / all } else { 0.0 });
    }
    // Held-out errors of a batch with the number of the one that was prepared ahead, which then
    // is the training's own.
    let held_out = |_: u64, w: usize, slot: usize, to: &mut _| window(77, w, slot, to);
    let (a, b) = (cpu.errors(&held_out, 4).unwrap(), gpu.errors(&held_out, 4).unwrap());
    assert!((b.loss / a.loss - 1.0).abs() < 1e-5, "{what}");
    assert_eq!(a.gap_windows, b.gap_windows);
    assert_eq!(a.place_tokens, b.place_tokens);
    let (a, b) = (cpu.gradient(&window, 4, None), gpu.gradient(&window, 4, None));
    assert!((b.unwrap().sums.loss / a.unwrap().sums.loss - 1.0).abs() < 1e-5, "{what}");
    close(&gpu.infer(&window, 9).unwrap(), &cpu.infer(&window, 9).unwrap(), 1e-4, &what);
    worst
}

#[test]
fn gradients_of_every_variant() {
    let variants = [
        (config(1, SkipKind::Off, true), false),
        (config(1, SkipKind::Off, false), true),
        (config(1, SkipKind::Additive, false), false),
        (config(1, SkipKind::Gated, false), false),
        (config(1, SkipKind::Gated, true), true),
        (config(4, SkipKind::Off, true), false),
        (config(10, SkipKind::Off, false), false),
        (NetConfig { mixing: Mixing::None, ..config(1, SkipKind::Gated, false) }, false),
        (NetConfig { width: 48, heads: 6, inputs: 8, ..config(1, SkipKind::Gated, false) }, false),
        (NetConfig { width: 144, heads: 1, layers: 1, ..config(3, SkipKind::Off, true) }, false),
    ];
    let mut worst = 0.0_f64;
    for (cfg, current_only) in variants {
        let Some(gpu) = device() else { return };
        let setup = Setup { current_only, ..setup(&cfg, 5, 0.1) };
        worst = worst.max(compare(gpu, &setup));
    }
    println!("largest difference of a tensor's gradient: {worst:.1e} relative");
}

#[test]
fn small_bindings_and_little_memory_take_more_pieces() {
    let cfg = NetConfig { width: 128, heads: 4, ..config(1, SkipKind::Gated, false) };
    let setup = setup(&cfg, 23, 0.05);
    let Some(gpu) = narrow() else { return };
    let engine = GpuEngine::new(gpu, &setup).unwrap();
    assert!(engine.device().unwrap().windows < 23, "{:?}", engine.device());
    drop(engine);
    let Some(gpu) = narrow() else { return };
    compare(gpu, &setup);
    // Weights that no binding can see are refused, in words.
    let Some(gpu) = narrow() else { return };
    let wide = NetConfig { width: 272, heads: 4, layers: 1, ..cfg };
    let e = GpuEngine::new(gpu, &self::setup(&wide, 2, 0.1)).unwrap_err();
    assert!(matches!(e, Error::Unfit { .. }) && e.to_string().contains("up.weight"), "{e}");
}

#[test]
fn two_hundred_steps_end_with_the_same_loss() {
    let cfg = NetConfig { layers: 1, ..config(1, SkipKind::Off, false) };
    let setup = setup(&cfg, 8, 0.0);
    let Some(gpu) = device() else { return };
    let mut engines: [Box<dyn Engine>; 2] =
        [Box::new(CpuEngine::new(setup.clone())), Box::new(GpuEngine::new(gpu, &setup).unwrap())];
    let [mut curves, mut first] = [[0.0; 2], [0.0; 2]];
    for (which, engine) in engines.iter_mut().enumerate() {
        for step in 0..200 {
            let view = engine.gradient(&window, step, Some(step + 1)).unwrap();
            engine.apply(3e-3, &view, 0.99).unwrap();
            if step == 0 {
                first[which] = view.sums.loss;
            }
            if step >= 180 {
                curves[which] += view.sums.loss / 20.0;
            }
        }
    }
    println!(
        "loss {:.5} -> {:.5} on the processor, {:.5} on the card",
        first[0], curves[0], curves[1]
    );
    assert!(curves[0] < 0.5 * first[0], "{first:?} {curves:?}");
    assert!((curves[1] / curves[0] - 1.0).abs() < 0.01, "{curves:?}");
    for averaged in [false, true] {
        let [a, b] = engines.each_mut().map(|e| e.net(averaged).unwrap().weights.to_vec());
        close(&b, &a, 0.02, "weights");
    }
}

/// Runs these steps.
fn train(engine: &mut dyn Engine, steps: std::ops::Range<u64>) {
    for step in steps.clone() {
        let next = Some(step + 1).filter(|n| steps.contains(n));
        let view = engine.gradient(&window, step, next).unwrap();
        assert!(view.is_finite());
        engine.apply(1e-3, &view, 0.9).unwrap();
    }
}

/// The setup and the state with which another engine continues.
fn handed_on(
    engine: &mut dyn Engine,
    setup: &Setup,
) -> (Setup, robert_net::checkpoint::OptimiserState) {
    let net = engine.net(false).unwrap();
    (Setup { net, ..setup.clone() }, engine.state().unwrap())
}

#[test]
fn a_run_goes_on_with_the_other_engine() {
    let setup = setup(&config(1, SkipKind::Gated, false), 6, 0.05);
    let Some(gpu) = device() else { return };
    let mut whole = CpuEngine::new(setup.clone());
    train(&mut whole, 0..12);
    // Card, processor, card.
    let mut first = GpuEngine::new(gpu, &setup).unwrap();
    train(&mut first, 0..4);
    let (next, state) = handed_on(&mut first, &setup);
    let mut second = CpuEngine::new(next);
    second.restore(&state).unwrap();
    train(&mut second, 4..8);
    let (next, state) = handed_on(&mut second, &setup);
    let Some(gpu) = device() else { return };
    let mut third = GpuEngine::new(gpu, &next).unwrap();
    third.restore(&state).unwrap();
    assert_eq!(third.state().unwrap(), state);
    train(&mut third, 8..12);
    for averaged in [false, true] {
        let want = whole.net(averaged).unwrap().weights.to_vec();
        close(&third.net(averaged).unwrap().weights, &want, 1e-3, "weights");
    }
    let (want, got) = (whole.state().unwrap(), third.state().unwrap());
    assert_eq!(want.count, got.count);
    close(&got.second, &want.second, 1e-2, "second moments");
    // Exchanging weights and average twice changes nothing, once everything.
    let before = [false, true].map(|a| third.net(a).unwrap().weights.to_vec());
    third.swap_average().unwrap();
    let after = [true, false].map(|a| third.net(a).unwrap().weights.to_vec());
    assert_eq!(before, after);
    assert_ne!(before[0], before[1]);
}

#[test]
fn the_same_adapter_gives_the_same_bits() {
    let setup = setup(&config(4, SkipKind::Off, true), 7, 0.05);
    let run = || {
        let gpu = device()?.within(Room { binding_bytes: u64::MAX, activation_bytes: 3 << 20 });
        let mut engine = GpuEngine::new(gpu, &setup).unwrap();
        train(&mut engine, 0..5);
        Some(engine.net(false).unwrap().weights.to_vec())
    };
    let Some(one) = run() else { return };
    assert_eq!(one, run().unwrap());
}

#[test]
fn a_lost_device_is_an_error_and_no_panic() {
    let setup = setup(&config(1, SkipKind::Off, false), 3, 0.05);
    let Some(gpu) = device() else { return };
    let mut engine = GpuEngine::new(gpu, &setup).unwrap();
    train(&mut engine, 0..2);
    engine.gpu().lose();
    let e = engine.gradient(&window, 2, None).unwrap_err();
    assert!(matches!(e, robert_net::Error::Lost { .. }), "{e}");
    assert!(engine.net(false).is_err() && engine.state().is_err());
}

#[test]
fn what_is_not_a_number_shows_in_the_norm() {
    let setup = setup(&config(1, SkipKind::Off, false), 3, 0.05);
    let Some(gpu) = device() else { return };
    let mut engine = GpuEngine::new(gpu, &setup).unwrap();
    let broken = |index: u64, w: usize, slot: usize, batch: &mut Batch<f32>| {
        window(index, w, slot, batch);
        if w == 1 {
            batch.tokens[slot * WINDOW * 5] = f32::NAN;
        }
    };
    assert!(!engine.gradient(&broken, 0, None).unwrap().is_finite());
    assert!(engine.gradient(&window, 1, None).unwrap().is_finite());
}
