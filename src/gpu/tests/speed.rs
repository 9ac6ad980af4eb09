//! Time of each kernel at the sizes of the paper's network: 512 windows, 768 wide. Run by hand on a
//! card: `cargo test --release -p robert-gpu speed -- --ignored --nocapture`.

use std::time::Instant;

use super::super::attend::Attend;
use super::super::columns::Columns;
use super::super::device::Span;
use super::super::kernel::{Step, Tape};
use super::super::norm::Norm;
use super::super::product::{End, Product};
use super::super::round::Round;
use super::{Arithmetic, cards, put, random};
use crate::Device;

/// Seconds of these dispatches.
fn clock(gpu: &Device, mut steps: impl FnMut() -> Vec<Step>) -> f64 {
    let end = gpu.buffer(16);
    let turn = |n: usize, steps: &mut dyn FnMut() -> Vec<Step>| {
        let mut tape = Tape::default();
        (0..n).for_each(|_| tape.extend(steps()));
        gpu.read::<f32>(&[&end], || ()).unwrap();
        let begin = Instant::now();
        tape.submit(gpu);
        gpu.read::<f32>(&[&end], || ()).unwrap();
        begin.elapsed().as_secs_f64()
    };
    turn(2, &mut steps);
    let (few, many) = (turn(2, &mut steps), turn(22, &mut steps));
    (many - few) / 20.0
}

#[test]
#[ignore = "a benchmark that is run by hand on a graphics card"]
fn speed() {
    let windows = std::env::var("WINDOWS").ok().and_then(|n| n.parse().ok()).unwrap_or(512);
    let (rows, d, heads) = (windows * 51, 768, 6);
    for arithmetic in [Arithmetic::Single, Arithmetic::Half] {
        let Some(gpu) =
            cards(false).into_iter().find_map(|card| Device::of(&card, arithmetic).ok())
        else {
            println!("{arithmetic:?}: no card");
            continue;
        };
        println!("{arithmetic:?} on {}", gpu.name());
        let noise = random(1 << 20, 1);
        let fill = |n: usize| {
            let wide: Vec<f32> = noise.iter().copied().cycle().take(n).collect();
            put(&gpu, &wide)
        };
        let round = Round::new(&gpu);
        let factor = |n: usize| -> Span {
            let mut tape = Tape::default();
            let copy = round.new_copy(&gpu, n, &fill(n), &mut tape);
            tape.submit(&gpu);
            copy
        };
        let product = Product::new(&gpu);
        let (x, wide) = (factor(rows * d), factor(rows * 4 * d));
        let (stream, bias, w) = (fill(rows * d), fill(4 * d), factor(4 * d * d));
        let (to, to_wide, slope) =
            (gpu.buffer(4 * (rows * d) as u64), gpu.factors(rows * 4 * d), factor(rows * 4 * d));
        let parts = gpu.buffer(4 * (16 * 4 * d * d) as u64);
        let dw = gpu.buffer(4 * (4 * d * d) as u64);
        let flop = |k: usize, n: usize| 2.0 * (rows * k * n) as f64;
        let show = |name: &str, work: f64, secs: f64| {
            println!("{name:24} {:8.3} ms {:7.1} TFLOP/s", 1e3 * secs, work / secs / 1e12);
        };
        let secs = clock(&gpu, || {
            vec![product.forward(&gpu, [rows, d, 3 * d], &x, &w, End::Factors(&bias), &to_wide)]
        });
        show("qkv forward", flop(d, 3 * d), secs);
        let secs = clock(&gpu, || {
            let end = End::Residual(&bias, &stream);
            vec![product.forward(&gpu, [rows, d, d], &x, &w, end, &to)]
        });
        show("out forward", flop(d, d), secs);
        let secs = clock(&gpu, || {
            let end = End::Gelu(&bias, &slope);
            vec![product.forward(&gpu, [rows, d, 4 * d], &x, &w, end, &to_wide)]
        });
        show("up forward", flop(d, 4 * d), secs);
        let secs = clock(&gpu, || {
            let end = End::Residual(&bias, &stream);
            vec![product.forward(&gpu, [rows, 4 * d, d], &wide, &w, end, &to)]
        });
        show("down forward", flop(d, 4 * d), secs);
        let secs = clock(&gpu, || {
            vec![product.back(&gpu, [rows, 4 * d, d], &x, &w, End::Times(&slope), &to_wide)]
        });
        show("down back", flop(d, 4 * d), secs);
        let secs =
            clock(&gpu, || vec![product.back(&gpu, [rows, d, 4 * d], &wide, &w, End::Store, &to)]);
        show("up back", flop(d, 4 * d), secs);
        let secs =
            clock(&gpu, || product.weight(&gpu, [rows, d, 4 * d], false, [&x, &wide], &parts, &dw));
        show("up weight", flop(d, 4 * d), secs);
        let secs = clock(&gpu, || product.weight(&gpu, [rows, d, d], false, [&x, &x], &parts, &dw));
        show("out weight", flop(d, d), secs);
        let attend = Attend::new(&gpu);
        let probs = gpu.buffer(4 * (windows * heads * 2601) as u64);
        let work = 4.0 * (51 * 51 * d * windows) as f64;
        let shape = [windows, heads, d];
        let secs = clock(&gpu, || vec![attend.forward(&gpu, shape, &wide, &probs, &x)]);
        show("attention", work, secs);
        let secs = clock(&gpu, || vec![attend.back(&gpu, shape, [&wide, &probs, &x], &to_wide)]);
        show("attention back", 2.0 * work, secs);
        let (norm, columns) = (Norm::new(&gpu), Columns::new(&gpu));
        let stats = gpu.buffer(8 * rows as u64);
        let secs = clock(&gpu, || {
            vec![norm.forward(&gpu, [rows, d], &stream, [&bias, &bias], &x, &stats)]
        });
        show("norm", 0.0, secs);
        let secs = clock(&gpu, || {
            vec![norm.back(&gpu, [rows, d], [&x, &stream, &stats, &bias], &to, true)]
        });
        show("norm back", 0.0, secs);
        let secs = clock(&gpu, || {
            let on = [&x, &stream, &stats];
            columns.norm(&gpu, &product, [rows, d], on, &parts, [&dw, &dw]).into()
        });
        show("columns of norm", 0.0, secs);
        let secs = clock(&gpu, || {
            columns.factors(&gpu, &product, [rows, 4 * d], &wide, &parts, &dw).into()
        });
        show("columns, wide", 0.0, secs);
        let secs = clock(&gpu, || {
            columns.plain(&gpu, &product, [windows, 51 * d], &stream, &parts, &to).into()
        });
        show("columns of positions", 0.0, secs);
        let secs = clock(&gpu, || round.copy(&gpu, rows * d, &stream, &x).into_iter().collect());
        show("round", 0.0, secs);
    }
}
