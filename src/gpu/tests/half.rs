//! Products of 16-bit factors on a card's matrix units, against the processor in 32 bits.

use super::super::device::Span;
use super::super::kernel::{Step, Tape};
use super::super::product::{End, Product};
use super::super::round::Round;
use super::steps::{config, setup, window};
use super::{close, half, put, random, run};
use crate::{Device, GpuEngine, Room};
use robert_linalg::{Init, Mat, MatMut, gemm, simd};
use robert_net::{CpuEngine, Engine, Mixing, NetConfig, Setup, SkipKind};

/// A number of 16 bits has 11 of mantissa: rounding is off by up to 2^-11, .00049, of a factor.
const ROUNDED: f64 = 1e-3;

fn times(a: Mat<'_, f32>, b: Mat<'_, f32>, m: usize, n: usize) -> Vec<f32> {
    let mut c = vec![0.0; m * n];
    gemm(MatMut::new(&mut c, m, n), Init::Zero, a, b);
    c
}

/// A buffer of these numbers as factors of products.
fn factors(gpu: &Device, x: &[f32]) -> Span {
    let mut tape = Tape::default();
    let wide = put(gpu, x);
    let copy = Round::new(gpu).new_copy(gpu, x.len(), &wide, &mut tape);
    tape.submit(gpu);
    copy
}

/// Runs the dispatches and reads the first `n` numbers of 16 bits of a buffer.
fn run_half(
    gpu: &Device,
    steps: impl IntoIterator<Item = Step>,
    from: &Span,
    n: usize,
) -> Vec<f32> {
    let pairs = run(gpu, steps, from, n.div_ceil(2));
    let halves = pairs.iter().flat_map(|x| [x.to_bits() as u16, (x.to_bits() >> 16) as u16]);
    halves.take(n).map(wide).collect()
}

/// The value of a number of 16 bits.
fn wide(bits: u16) -> f32 {
    let (exponent, mantissa) = (i32::from(bits >> 10 & 31), f32::from(bits & 1023));
    let size = match exponent {
        0 => mantissa * 2.0_f32.powi(-24),
        31 => f32::INFINITY,
        e => (1024.0 + mantissa) * 2.0_f32.powi(e - 25),
    };
    if bits >> 15 == 1 { -size } else { size }
}

#[test]
fn products_of_half_precision() {
    let Some(gpu) = half() else { return };
    let product = Product::new(&gpu);
    for [m, k, n] in [[1, 4, 4], [77, 20, 68], [130, 84, 132], [300, 260, 36]] {
        let what = |name: &str| format!("{name} {m} {k} {n}");
        let (x, w, dy) = (random(m * k, 1), random(k * n, 2), random(m * n, 4));
        let (bias, other) = (random(n, 3), random(m * n, 5));
        let [gx, gw, gdy] = [&x, &w, &dy].map(|v| factors(&gpu, v));
        let [gbias, gother] = [&bias, &other].map(|v| put(&gpu, v));
        let c = put(&gpu, &random(m * n, 6));
        let mut want = times(Mat::new(&x, m, k), Mat::new(&w, k, n), m, n);
        want.iter_mut().enumerate().for_each(|(i, v)| *v += bias[i % n]);
        let shape = [m, k, n];
        let step = product.forward(&gpu, shape, &gx, &gw, End::Bias(&gbias), &c);
        close(&run(&gpu, [step], &c, m * n), &want, ROUNDED, &what("bias"));
        let step = product.forward(&gpu, shape, &gx, &gw, End::Factors(&gbias), &c);
        close(&run_half(&gpu, [step], &c, m * n), &want, ROUNDED, &what("factors"));
        let second = gpu.factors(m * n);
        let step = product.forward(&gpu, shape, &gx, &gw, End::Gelu(&gbias, &second), &c);
        let mut slope = want.clone();
        slope.resize(slope.len().next_multiple_of(64), 0.0);
        let mut act = vec![0.0; slope.len()];
        simd::gelu(&mut slope, &mut act);
        close(&run_half(&gpu, [step], &c, m * n), &act[..m * n], ROUNDED, &what("gelu"));
        close(&run_half(&gpu, [], &second, m * n), &slope[..m * n], ROUNDED, &what("slope"));
        let end = End::Residual(&gbias, &gother);
        let step = product.forward(&gpu, shape, &gx, &gw, end, &c);
        want.iter_mut().zip(&other).for_each(|(v, o)| *v += o);
        close(&run(&gpu, [step], &c, m * n), &want, ROUNDED, &what("residual"));

        let dx = gpu.factors(m * k);
        let mut want = times(Mat::new(&dy, m, n), Mat::new(&w, k, n).t(), m, k);
        let step = product.back(&gpu, shape, &gdy, &gw, End::Store, &dx);
        close(&run_half(&gpu, [step], &dx, m * k), &want, ROUNDED, &what("back"));
        let step = product.back(&gpu, shape, &gdy, &gw, End::Times(&gx), &dx);
        want.iter_mut().zip(&x).for_each(|(v, x)| *v *= x);
        close(&run_half(&gpu, [step], &dx, m * k), &want, ROUNDED, &what("back times slope"));

        let begin = random(k * n, 7);
        let mut want = times(Mat::new(&x, m, k).t(), Mat::new(&dy, m, n), k, n);
        want.iter_mut().zip(&begin).for_each(|(w, b)| *w += b);
        for room in [64 * k * n, 4] {
            let (parts, dw) = (gpu.buffer(4 * room as u64), put(&gpu, &begin));
            let steps = product.weight(&gpu, shape, false, [&gx, &gdy], &parts, &dw);
            close(&run(&gpu, steps, &dw, k * n), &want, ROUNDED, &what("weight"));
        }
    }
}

/// Loss and gradients of every tensor, card against processor.
fn compare(gpu: Device, setup: &Setup) {
    let mut cpu = CpuEngine::new(setup.clone());
    let mut gpu = GpuEngine::new(gpu, setup).unwrap();
    let a = cpu.gradient(&window, 3, None).unwrap();
    let b = gpu.gradient(&window, 3, None).unwrap();
    assert!((b.sums.loss / a.sums.loss - 1.0).abs() < 1e-2, "{} {}", a.sums.loss, b.sums.loss);
    assert!((b.grad_norm / a.grad_norm - 1.0).abs() < 2e-2, "{} {}", a.grad_norm, b.grad_norm);
    let (want, got) = (cpu.last_gradient(), gpu.last_gradient().unwrap());
    for tensor in &setup.net.layout.tensors {
        let range = tensor.range.clone();
        close(&got[range.clone()], &want[range], 2e-2, &format!("{} {setup:?}", tensor.name));
    }
}

#[test]
fn gradients_of_half_precision() {
    let variants = [
        (config(1, SkipKind::Gated, false), false),
        (config(1, SkipKind::Off, true), true),
        (config(10, SkipKind::Off, true), false),
        (NetConfig { mixing: Mixing::None, ..config(1, SkipKind::Gated, false) }, false),
        (NetConfig { width: 48, heads: 6, ..config(1, SkipKind::Additive, false) }, false),
        (NetConfig { width: 144, heads: 3, ..config(3, SkipKind::Off, true) }, false),
    ];
    for (cfg, current_only) in variants {
        let Some(gpu) = half() else { return };
        compare(gpu, &Setup { current_only, ..setup(&cfg, 37, 0.1) });
    }
    // In pieces.
    let Some(gpu) = half() else { return };
    let room = Room { binding_bytes: 1 << 20, activation_bytes: 1 << 22 };
    compare(gpu.within(room), &setup(&config(1, SkipKind::Gated, true), 37, 0.1));
}

#[test]
fn a_gradient_that_overflows_16_bits_is_scaled_down() {
    let cfg = NetConfig { offset_weight: 1e4, ..config(4, SkipKind::Off, false) };
    let Some(gpu) = half() else { return };
    let setup = setup(&cfg, 8, 0.1);
    let mut cpu = CpuEngine::new(setup.clone());
    let want = cpu.gradient(&window, 0, None).unwrap().grad_norm;
    let mut gpu = GpuEngine::new(gpu, &setup).unwrap();
    let norms: Vec<f64> =
        (0..12).map(|_| gpu.gradient(&window, 0, None).unwrap().grad_norm).collect();
    let first = norms.iter().position(|n| n.is_finite());
    assert!(matches!(first, Some(1..=9)), "it overflows at first, and not in ten steps: {norms:?}");
    assert!((norms[11] / want - 1.0).abs() < 2e-2, "{norms:?} {want}");
}

#[test]
fn two_hundred_steps_of_half_precision() {
    let cfg = NetConfig { layers: 1, ..config(1, SkipKind::Off, false) };
    let setup = setup(&cfg, 8, 0.0);
    let Some(gpu) = half() else { return };
    let mut engines: [Box<dyn Engine>; 2] =
        [Box::new(CpuEngine::new(setup.clone())), Box::new(GpuEngine::new(gpu, &setup).unwrap())];
    let ends = engines.each_mut().map(|engine| {
        let losses = (0..200).map(|step| {
            let view = engine.gradient(&window, step, Some(step + 1)).unwrap();
            engine.apply(3e-3, &view, 0.99).unwrap();
            view.sums.loss
        });
        losses.skip(180).sum::<f64>()
    });
    assert!((ends[1] / ends[0] - 1.0).abs() < 0.02, "{ends:?}");
}
