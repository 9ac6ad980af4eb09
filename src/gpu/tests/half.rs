//! Products of 16-bit factors on a card's matrix units, against the processor in 32 bits.

use super::super::product::{End, Product};
use super::steps::{config, setup, window};
use super::{close, half, put, random, run};
use crate::GpuEngine;
use robert_linalg::{Init, Mat, MatMut, gemm};
use robert_net::{CpuEngine, Engine, NetConfig, SkipKind};

/// A number of 16 bits has 11 of mantissa: rounding is off by up to 2^-11, .00049, of a factor.
const ROUNDED: f64 = 1e-3;

fn times(a: Mat<'_, f32>, b: Mat<'_, f32>, m: usize, n: usize) -> Vec<f32> {
    let mut c = vec![0.0; m * n];
    gemm(MatMut::new(&mut c, m, n), Init::Zero, a, b);
    c
}

#[test]
fn products_of_half_precision() {
    let Some(gpu) = half() else { return };
    let product = Product::new(&gpu);
    for [m, k, n] in [[1, 4, 4], [77, 20, 68], [130, 84, 132], [300, 260, 36]] {
        let (x, w) = (random(m * k, 1), random(k * n, 2));
        // A mean over many rows has small gradients.
        let dy: Vec<f32> = random(m * n, 4).iter().map(|x| 1e-5 * x / m as f32).collect();
        let bias = random(n, 3);
        let [gx, gw, gbias, gdy] = [&x, &w, &bias, &dy].map(|v| put(&gpu, v));
        let c = put(&gpu, &random(m * n, 5));
        let mut want = times(Mat::new(&x, m, k), Mat::new(&w, k, n), m, n);
        want.iter_mut().enumerate().for_each(|(i, v)| *v += bias[i % n]);
        let step = product.forward(&gpu, [m, k, n], &gx, &gw, End::Bias(&gbias), &c);
        close(&run(&gpu, [step], &c, m * n), &want, ROUNDED, &format!("forward {m} {k} {n}"));

        let dx = put(&gpu, &vec![0.0_f32; m * k]);
        let want = times(Mat::new(&dy, m, n), Mat::new(&w, k, n).t(), m, k);
        let step = product.back(&gpu, [m, k, n], &gdy, &gw, End::Store, &dx);
        close(&run(&gpu, [step], &dx, m * k), &want, ROUNDED, &format!("back {m} {k} {n}"));

        let want = times(Mat::new(&x, m, k).t(), Mat::new(&dy, m, n), k, n);
        for room in [64 * k * n, 4] {
            let (parts, dw) = (gpu.buffer(4 * room as u64), gpu.buffer(4 * (k * n) as u64));
            let steps = product.weight(&gpu, [m, k, n], &gx, &gdy, &parts, &dw);
            close(&run(&gpu, steps, &dw, k * n), &want, ROUNDED, &format!("weight {m} {k} {n}"));
        }
    }
}

#[test]
fn gradients_of_half_precision() {
    for cfg in [
        config(1, SkipKind::Gated, false),
        config(10, SkipKind::Off, true),
        NetConfig { width: 144, heads: 3, ..config(3, SkipKind::Off, true) },
    ] {
        let Some(gpu) = half() else { return };
        let setup = setup(&cfg, 37, 0.1);
        let mut cpu = CpuEngine::new(setup.clone());
        let mut gpu = GpuEngine::new(gpu, &setup).unwrap();
        let a = cpu.gradient(&window, 3, None).unwrap();
        let b = gpu.gradient(&window, 3, None).unwrap();
        assert!((b.sums.loss / a.sums.loss - 1.0).abs() < 1e-2, "{} {}", a.sums.loss, b.sums.loss);
        let (want, got) = (cpu.last_gradient(), gpu.last_gradient().unwrap());
        for tensor in &setup.net.layout.tensors {
            let range = tensor.range.clone();
            close(&got[range.clone()], &want[range], 2e-2, &format!("{} {cfg:?}", tensor.name));
        }
    }
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
